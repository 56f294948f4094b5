"""Maximum likelihood with noisy measured inputs, when the noise of all instruments is known.

An input is measured as u + n, and it is u that moves the aircraft: driven by the measured input, the residuals of the
true parameters are

    v = e - H n,    cov v = Omega^-1 = R + H S H'

R: noise of the outputs, S: noise of the inputs, H: response to the inputs at the samples. Every output shows the same
n, filtered by the aircraft. Output error takes v for white and independent from output to output: it is unbiased to
first order, but scatters more than the estimate that minimises v' Omega v, which is that of maximum likelihood for a
given Omega (errors in variables: T. Soderstrom, Automatica 43(6), 2007). Omega is that of the start values; a Kalman
filter applies it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtri

from testbench.core.advice import doubt
from testbench.core.constants import WHITE
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.model import check_records
from testbench.estimators.parametric.accuracy import accuracy, advice_in_words, correlations, whiteness
from testbench.estimators.parametric.gauss_newton import Minimum, Sensitivities, minimise
from testbench.estimators.parametric.likelihood import Driven, Layout, Likelihood, held_inputs, stretch
from testbench.estimators.parametric.model import ParametricModel, named
from testbench.estimators.parametric.response import Sampling, discretise
from testbench.estimators.parametric.structure import LinearStructure
from testbench.estimators.settings import OutputError
from testbench.estimators.trajectories import carried

_TOLERANCE = 1e-6  # the search ends where a full step would lower the cost by this much: a thousandth of an error


class Whitening:
    """The innovations filter of a structure whose inputs are noisy: it makes v = e - H n white, of unit variance.

    n moves the states as the inputs do; with xi = [x, n], inputs joined by lines or held (``response.discretise``),

        xi[k+1] = F xi[k] + [H, 1] n[k+1],    v[k] / sigma = [C, D] / sigma xi[k] + e[k],

    the flight beginning in trim. The filter is the time-varying one of Kalman, exact from the first sample on. Samples
    that were not taken leave it as it is.

    Args:
        structure: the equations.
        params: (k,) the parameters whose response passes the noise on.
        sampling: of the record.
        input_std: (m,) noise of the inputs, 0 for none.
        output_std: (p,) noise of the outputs.
        taken: (N, p) root of the share of samples that were taken; 1 if all were.

    Raises:
        EstimationError: the structure diverges over the record.
    """

    def __init__(
        self,
        structure: LinearStructure,
        params: FloatArray,
        sampling: Sampling,
        input_std: FloatArray,
        output_std: FloatArray,
        taken: FloatArray,
    ) -> None:
        noisy = np.flatnonzero(input_std > 0.0)
        m = structure.matrices(params)
        d = discretise(m, sampling.dt_s, sampling.held)
        n = len(d.A)
        self._F = np.zeros((n + noisy.size, n + noisy.size))
        self._F[:n, :n], self._F[:n, n:] = d.A, (d.G - d.H)[:, noisy]
        drive = np.vstack([d.H[:, noisy], np.eye(noisy.size)]) * input_std[noisy]
        self._C = np.hstack([m.C, m.D[:, noisy]]) / output_std[:, None]
        self._taken, self._noisy = taken, bool(noisy.size)
        N, p = taken.shape
        self._gain, self._root = np.empty((N, len(self._F), p)), np.empty((N, p, p))
        if self._noisy:
            P = np.zeros_like(self._F)
            P[n:, n:] = np.diag(input_std[noisy] ** 2)
            self._run(P, drive @ drive.T)

    def _run(self, P: FloatArray, Q: FloatArray) -> None:
        """Fill in gains (N, n, p) and inverse Cholesky factors (N, p, p) of the innovations, from P (n, n) on."""
        one, lost = np.eye(self._C.shape[0]), 0
        for k, taken in enumerate(self._taken):
            C = self._C * taken[:, None]
            PC = P @ C.T
            factor, lost = dpotrf(C @ PC + one, lower=1)  # LAPACK itself: numpy takes twice as long
            if lost:
                break
            root, _ = dtrtri(factor, lower=1)
            half = self._F @ PC @ root.T
            self._root[k], self._gain[k] = root, half @ root
            P = self._F @ P @ self._F.T - half @ half.T + Q
            P = 0.5 * (P + P.T)
        if lost or not np.all(np.isfinite(P)):
            raise EstimationError("the model diverges from its start values; start from others, or from equation error")

    def apply(self, x: FloatArray) -> FloatArray:
        """Return ``x`` (N, p, k), in units of the outputs' noise and zero where not taken, whitened (N, p, k)."""
        if not self._noisy:
            return x
        C = self._taken[:, :, None] * self._C
        rest = np.zeros((len(self._F), x.shape[2]))
        states = carried(self._F - np.matmul(self._gain, C), np.matmul(self._gain, x), rest)
        return np.asarray(np.matmul(self._root, x - np.matmul(C, states)))


def estimate(
    record: FlightRecord,
    structure: LinearStructure,
    output_std: Mapping[str, float],
    input_std: Mapping[str, float],
    *,
    max_iterations: int = 50,
) -> ParametricModel:
    """Estimate the free parameters of a linear structure, the flight beginning in trim.

    Every output and every noisy input has an unknown offset: the error of its trim value by noise.

    Args:
        record: measured record.
        structure: the equations; its values are the start and give the weights.
        output_std: output -> standard deviation of its white noise, every output.
        input_std: input -> the same; inputs left out are known exactly.
        max_iterations: Gauss-Newton steps.

    Returns:
        The model. ``covariance`` is the inverse of the information with this noise; ``noise_covariance`` that of the
        outputs' own noise. Diagnostics: ``cost`` v' Omega v, ``freedom`` its expectation, ``iterations``,
        ``converged``, ``at_bound``, ``condition``, ``residual_std`` (p,), ``offsets`` (p,), ``input_biases`` (b,),
        ``whiteness_p`` (p,) of the weighed residuals and the ``correlation`` (f, f) of the estimates.

    Raises:
        EstimationError: an output without noise, a noise of what is no input or output, nothing free, fewer samples
            than unknowns, or unknowns that no output feels.
        ChannelError: the record lacks a channel.
    """
    check_records([record], structure.must_move, structure.outputs)
    sigma = named(output_std, structure.outputs, "a noise")
    if not np.all(sigma > 0.0):
        name = structure.outputs[int(np.argmin(sigma))]
        raise EstimationError(
            f"every output needs a noise above 0 to be weighed by, got none for '{name}'; give its std"
        )
    if not structure.free.any():
        raise EstimationError(f"structure '{structure.name}' has no free parameter; free some, or simulate it instead")
    held, noise = held_inputs(structure.inputs, None)[0], named(input_std, structure.inputs, "a noise")
    settings = OutputError(initial_states="zero", output_biases=structure.outputs)
    seen = stretch(record, structure, np.zeros(len(structure.inputs)), settings)
    biased = tuple(np.flatnonzero(noise > 0.0).tolist())
    layout = Layout(np.flatnonzero(structure.free), False, biased, len(structure.states), len(structure.outputs))
    sampling = Sampling(record.dt_s, held)
    likelihood = Likelihood(structure, [seen], layout, sampling)
    values = structure.values
    taken = seen.valid.astype(float)
    weights = Whitening(structure, values, sampling, noise, sigma, taken)

    def problem(point: FloatArray) -> tuple[FloatArray, FloatArray]:
        with np.errstate(all="ignore"):  # a trial point may diverge: the search sees that and steps back
            v, s = next(likelihood.evaluate(point, values))
            both = np.concatenate([v[:, :, None], s.values], axis=2) / sigma[:, None]
            if not np.all(np.isfinite(both)):
                return np.full(1, np.inf), np.full((1, layout.chosen.size + layout.per_record), np.inf)
            rows = weights.apply(both).reshape(-1, both.shape[2])
        return rows[:, 0], rows[:, 1:]

    low, high = likelihood.bounds()
    tolerance = _TOLERANCE / float(likelihood.counts.sum())
    found = minimise(problem, likelihood.start(values), low, high, tolerance=tolerance, max_iterations=max_iterations)
    given = {"structure": structure.name, "output_std": dict(output_std), "input_std": dict(input_std)}
    return _model(likelihood, weights, sigma, found, problem(found.point)[1], given)


def _model(
    likelihood: Likelihood,
    weights: Whitening,
    sigma: FloatArray,
    found: Minimum,
    J: FloatArray,
    settings: Mapping[str, Any],
) -> ParametricModel:
    """Return the model at the end of a search, ``J`` (r, k) the weighted sensitivities there."""
    structure, seen, f = likelihood.structure, likelihood.stretches[0], likelihood.layout.chosen.size
    params = likelihood.parameters(found.point, structure.values)
    (v,) = likelihood.residuals(found.point, structure.values)
    moving, names = ~found.at_bound, likelihood.names()
    felt = [Sensitivities.of_all(J[:, None, :])]
    reached = accuracy([np.zeros((len(J), 1))], lambda: felt, np.eye(1), np.zeros(moving.size), moving, names)
    covariance = reached.plain[:f, :f]
    white = weights.apply((v / sigma)[:, :, None])[:, :, 0]
    own = likelihood.layout.split(found.point, 0)
    whole = likelihood.layout.embedded(covariance, params.size)
    model = Driven(np.zeros(len(structure.inputs)), likelihood.sampling.held).model(
        structure,
        settings,
        method="output_error",
        dt_s=likelihood.sampling.dt_s,
        diagnostics={
            "cost": found.cost,
            "freedom": float(likelihood.counts.sum() - likelihood.unknowns),
            "iterations": found.iterations,
            "converged": found.converged,
            "at_bound": [n for n, b in zip(names[:f], found.at_bound[:f], strict=True) if b],
            "condition": reached.condition,
            "residual_std": np.std(v, axis=0),
            "whiteness_p": np.ones(sigma.size),
            "correlation": correlations(covariance),
            "offsets": own.offsets,
            "input_biases": own.biases,
        },
        params=params,
        covariance=whole,
        covariance_plain=whole,
        noise_covariance=np.diag(sigma**2),
        biased=structure.outputs,
        biased_inputs=tuple(structure.inputs[j] for j in likelihood.layout.biased_inputs),
        operating_point=(np.zeros(len(structure.states)), seen.u[0]),
    )
    model = advice_in_words(model)
    p = whiteness([white], [seen.valid], np.std(white, axis=0), np.eye(sigma.size))
    coloured = [o for o, value in zip(structure.outputs, p, strict=True) if value < WHITE]
    said = doubt(
        "coloured_residuals",
        f"the residuals of {', '.join(coloured)} are not white even when weighted (turbulence, a nonlinear flight, or "
        "missing terms of the model): the standard errors are not valid",
    )
    diagnostics = {**model.diagnostics, "whiteness_p": p}
    advice = (*model.advice, said) if coloured else model.advice
    return replace(model, diagnostics=diagnostics, advice=advice)
