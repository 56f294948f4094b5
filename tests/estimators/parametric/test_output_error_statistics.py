"""Output error over many seeds: scatter at the Cramer-Rao bound, intervals that cover, also in coloured noise."""

from typing import NamedTuple

import numpy as np
import pytest
from parametric_cases import fly, inputs
from scipy.signal import lfilter

from testbench.core.record import FlightRecord
from testbench.estimators.parametric import output_error
from testbench.estimators.parametric.response import Sampling, respond
from testbench.estimators.parametric.structures import Trim, longitudinal
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.flight import linearise
from testbench.sensors import load_suite

OUTPUTS = ("V", "alpha", "q", "theta")
LENGTHS = (500, 350)


class Study(NamedTuple):
    """Normalised errors: of the estimates over the Cramer-Rao bound (seeds, f), and over the errors that were told."""

    whitened: np.ndarray
    over_bound: np.ndarray
    over_plain: np.ndarray
    over_corrected: np.ndarray


def study(aircraft, trimmed, dt_s: float, seeds: int, rho: float = 0.0) -> Study:
    """Estimate the longitudinal derivatives of a linearised aircraft again and again, the noise alone being new.

    Noise: what the EOLO suite with the air data boom has, white or first-order coloured with pole ``rho``.
    """
    derivatives = dimensional_derivatives(linearise(aircraft, trimmed), trimmed)
    values = {d.name: d.held if d.static is None else d.static for d in derivatives}
    structure = longitudinal(Trim(trimmed.condition.V_m_s, trimmed.alpha, trimmed.state["theta"]), outputs=OUTPUTS)
    structure = structure.with_parameters({n: values[n] for n in structure.parameter_names if n in values})
    sensors = {s.channel: s.noise_std for s in load_suite("eolo_alpha").sensors}
    std = np.array([sensors[name] for name in OUTPUTS])
    free, p, n = np.flatnonzero(structure.free), structure.values, len(structure.states)
    clean, J = [], []
    for i, samples in enumerate(LENGTHS):
        u = inputs(structure, samples, 20 + i)
        r = respond(structure, p, free.tolist(), u, Sampling(dt_s, np.zeros(1, bool)), np.zeros(n))
        clean.append(fly(structure, p, u, dt_s, np.zeros(n)))
        own = [r.dx0 if i == k else np.zeros((samples, len(OUTPUTS), n)) for k in range(2)]
        J.append((np.concatenate([r.dparams, *own], axis=2) / std[:, None]).reshape(samples * len(OUTPUTS), -1))
    stacked = np.vstack(J)
    bound = np.linalg.inv(stacked.T @ stacked)[: free.size, : free.size]
    whiten = np.linalg.inv(np.linalg.cholesky(bound))
    rows = []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        records = []
        for r in clean:
            e = rng.standard_normal((len(r) + 300, len(OUTPUTS)))
            e = lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], e, axis=0)[300:]
            data = np.column_stack([r["de"], r.columns(OUTPUTS) + std * e])
            records.append(FlightRecord(r.t_s, ("de", *OUTPUTS), data, "measured"))
        model = output_error.estimate(records, structure)
        error = (model.params - p)[free]
        told = [np.sqrt(np.diag(c))[free] for c in (model.covariance_plain, model.covariance)]
        rows.append((whiten @ error, error / np.sqrt(np.diag(bound)), error / told[0], error / told[1]))
    return Study(*(np.array(column) for column in zip(*rows, strict=True)))


def coverage(normalised: np.ndarray) -> np.ndarray:
    """Return the share of 95 % intervals that hold the truth, per parameter."""
    return np.mean(np.abs(normalised) < 1.96, axis=0)


@pytest.mark.slow
def test_errors_reach_the_bound_over_a_few_seeds(taurus, taurus_trim):
    s = study(taurus, taurus_trim, 0.025, 30)
    # chi-squared with 30 x 14 degrees of freedom: its root scatters by 1 / sqrt(2 x 420) = 3.5 %; five of them
    assert np.sqrt(np.mean(s.whitened**2)) == pytest.approx(1.0, abs=0.18)
    # 420 correlated intervals of 95 %: were they 60 independent ones, four standard deviations would be 11 %
    assert coverage(s.over_plain).mean() == pytest.approx(0.95, abs=0.11)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["taurus", "eolo"])
def test_errors_reach_the_cramer_rao_bound_and_intervals_cover(name, request):
    s = study(request.getfixturevalue(name), request.getfixturevalue(f"{name}_trim"), 0.025, 400)
    # pooled: chi-squared with 400 x 14 degrees of freedom, its root scatters by 1.0 %: 5 % is a false alarm of 1e-6
    assert np.sqrt(np.mean(s.whitened**2)) == pytest.approx(1.0, abs=0.05)
    # one by one: 1 / sqrt(800) = 3.5 %; 4.5 of them for 14 parameters, false alarm 1e-4
    assert np.sqrt(np.mean(s.over_bound**2, axis=0)) == pytest.approx(1.0, abs=0.16)
    # no bias: mean over 400 seeds scatters by 5 % of an error; 4.5 of them
    assert np.abs(s.over_bound.mean(axis=0)).max() < 0.225
    # binomial: standard deviation 1.1 % of 400 intervals; 4.5 of them
    covered = coverage(s.over_plain)
    assert np.all(np.abs(covered - 0.95) < 0.049)
    # pooled over parameters whose errors are correlated: 1.1 % if they were all one; two of them
    assert covered.mean() == pytest.approx(0.95, abs=0.022)
    # the correction costs nothing where nothing is to be corrected
    assert coverage(s.over_corrected).mean() == pytest.approx(0.95, abs=0.022)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["taurus", "eolo"])
def test_in_coloured_noise_corrected_intervals_cover_and_plain_ones_do_not(name, request):
    s = study(request.getfixturevalue(name), request.getfixturevalue(f"{name}_trim"), 0.025, 400, rho=0.9)
    # binomial standard deviation of the pooled share at most 1.1 %
    assert 0.90 < coverage(s.over_corrected).mean() < 0.97
    assert coverage(s.over_plain).mean() < 0.80
