"""How well each estimator does what the Cramer-Rao bound allows, and whether its intervals hold the truth.

Run with ``make estimator-study``; the tables go to results/estimators/. Simulated: the linearised longitudinal motion
of an aircraft, two records of 12.5 and 8.75 s at 40 Hz with multisteps of a held elevator, white noise of the EOLO
suite with the air data boom on V, alpha, q and theta. Only the noise differs from seed to seed. Judged are frequency
and damping of the short period against the bound of the parametric structure, which knows the equations; black boxes
know less and cannot reach it.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "estimators" / "parametric"), str(ROOT / "tests" / "studies")]

from parametric_cases import fly, inputs  # noqa: E402

from testbench.aircraft import load_aircraft  # noqa: E402
from testbench.errors import EstimationError  # noqa: E402
from testbench.estimators import srivc, transfer_function  # noqa: E402
from testbench.estimators.parametric import equation_error, filter_error, output_error  # noqa: E402
from testbench.estimators.parametric.kalman import ekf, ukf  # noqa: E402
from testbench.estimators.parametric.response import respond  # noqa: E402
from testbench.estimators.parametric.structures import longitudinal  # noqa: E402
from testbench.estimators.prediction_error import estimate as prediction_error  # noqa: E402
from testbench.estimators.subspace import dsr_e, family  # noqa: E402
from testbench.evaluation.derivatives import dimensional_derivatives  # noqa: E402
from testbench.flight import FlightCondition, linearise, trim  # noqa: E402
from testbench.record import FlightRecord  # noqa: E402
from testbench.sensors import load_suite  # noqa: E402

OUTPUTS = ("V", "alpha", "q", "theta")
LENGTHS, DT = (500, 350), 0.025
HELD = np.ones(1, bool)
CONDITIONS = {"taurus": FlightCondition(12.0, 100.0), "eolo": FlightCondition(16.0, 547.0)}
HORIZONS = {"past_horizon": 20, "future_horizon": 30, "order": 4}
RESULTS = ROOT / "results" / "estimators"


class Truth(NamedTuple):
    """The structure with its true values, records without noise, noise (p,), the pair of poles, wn and zeta, bound."""

    structure: Any
    clean: list[FlightRecord]
    std: np.ndarray
    pair: np.ndarray
    modal: np.ndarray  # wn, zeta
    bound: np.ndarray  # (2,) standard deviations


class Estimate(NamedTuple):
    """wn and zeta of the short period with the standard errors that the method gives, None where it gives none."""

    modal: np.ndarray
    told: np.ndarray | None


def modal_of(pair: np.ndarray) -> np.ndarray:
    """Return natural frequency and damping ratio of a pair of poles, real or conjugate."""
    wn = np.sqrt(np.abs(pair[0] * pair[1]))
    return np.array([wn, -np.real(pair[0] + pair[1]) / (2.0 * wn)])


def closest(poles: np.ndarray, pair: np.ndarray) -> np.ndarray:
    """Return the two poles, together closed under conjugation, that lie nearest to the true pair."""
    best, least = None, np.inf
    for i in range(poles.size):
        for j in range(poles.size):
            a, b = poles[i], poles[j]
            if i == j or abs((a + b).imag) > 1e-6 * abs(a):
                continue
            apart = abs(a - pair[0]) + abs(b - pair[1])
            if apart < least:
                best, least = np.array([a, b]), apart
    if best is None:
        raise EstimationError("no pair of poles")
    return best


def prepare(name: str) -> Truth:
    """Return what all seeds of an aircraft share."""
    aircraft = load_aircraft(name)
    trimmed = trim(aircraft, CONDITIONS[name])
    derivatives = dimensional_derivatives(linearise(aircraft, trimmed), trimmed)
    values = {d.name: d.held if d.static is None else d.static for d in derivatives}
    structure = longitudinal(trimmed.condition.V_m_s, trimmed.alpha, trimmed.state["theta"], outputs=OUTPUTS)
    structure = structure.with_parameters({n: values[n] for n in structure.parameter_names if n in values})
    noise = {s.channel: s.noise_std for s in load_suite("eolo_alpha").sensors}
    std = np.array([noise[output] for output in OUTPUTS])
    p, free, n = structure.values, np.flatnonzero(structure.free), len(structure.states)
    clean, J = [], []
    for i, samples in enumerate(LENGTHS):
        u = inputs(structure, samples, 20 + i)
        r = respond(structure, p, free.tolist(), u, DT, HELD, np.zeros(n))
        clean.append(fly(structure, p, u, DT, np.zeros(n), held=True))
        own = [r.dx0 if i == k else np.zeros((samples, len(OUTPUTS), n)) for k in range(len(LENGTHS))]
        J.append((np.concatenate([r.dparams, *own], axis=2) / std[:, None]).reshape(samples * len(OUTPUTS), -1))
    stacked = np.vstack(J)
    covariance = np.linalg.inv(stacked.T @ stacked)[: free.size, : free.size]
    poles = np.linalg.eigvals(structure.matrices(p).A)
    pair = poles[np.argsort(-np.abs(poles))[:2]]
    slope = gradient(structure, p, pair)[:, free]
    bound = np.sqrt(np.einsum("ij,jk,ik->i", slope, covariance, slope))
    return Truth(structure, clean, std, pair, modal_of(pair), bound)


def gradient(structure: Any, params: np.ndarray, pair: np.ndarray) -> np.ndarray:
    """Return the derivatives (2, k) of wn and zeta by the parameters, by central differences."""
    out = np.zeros((2, params.size))
    for j in np.flatnonzero(structure.free):
        step = 1e-6 * max(abs(params[j]), 1.0)
        ends = []
        for sign in (1.0, -1.0):
            moved = params.copy()
            moved[j] += sign * step
            ends.append(modal_of(closest(np.linalg.eigvals(structure.matrices(moved).A), pair)))
        out[:, j] = (ends[0] - ends[1]) / (2.0 * step)
    return out


def noisy(truth: Truth, seed: int) -> list[FlightRecord]:
    """Return the records with the noise of a seed."""
    rng = np.random.default_rng(seed)
    out = []
    for r in truth.clean:
        e = rng.standard_normal((len(r), len(OUTPUTS)))
        data = np.column_stack([r["de"], r.columns(OUTPUTS) + truth.std * e])
        out.append(FlightRecord(r.t_s, ("de", *OUTPUTS), data, "measured"))
    return out


def parametric(module: Any, **settings: Any) -> Callable[[Truth, list[FlightRecord]], Estimate]:
    """Return a method that knows the equations; it starts from equation error, as in a scenario."""

    def run(truth: Truth, records: list[FlightRecord]) -> Estimate:
        structure = longitudinal(
            truth.structure.trim.V, truth.structure.trim.alpha, truth.structure.trim.theta, outputs=OUTPUTS
        )
        if module is not equation_error:
            first = equation_error.estimate(records, structure, held=("de",))
            structure = structure.with_parameters(first.values)
        model = module.estimate(records, structure, held=("de",), **settings)
        pair = closest(np.linalg.eigvals(model.linear().A), truth.pair)
        slope = gradient(structure, model.params, pair)
        return Estimate(modal_of(pair), np.sqrt(np.einsum("ij,jk,ik->i", slope, model.covariance, slope)))

    return run


def subspace(method: str, bootstrap: int = 0) -> Callable[[Truth, list[FlightRecord]], Estimate]:
    """Return a subspace method without feedthrough."""

    def run(truth: Truth, records: list[FlightRecord]) -> Estimate:
        model = (
            dsr_e.estimate(records, ("de",), OUTPUTS, **HORIZONS)
            if method == "dsr_e"
            else family.estimate(records, ("de",), OUTPUTS, method=method, bootstrap=bootstrap, **HORIZONS)
        )
        (poles,) = model.poles().values()
        return Estimate(modal_of(closest(poles, truth.pair)), None)

    return run


def refined(disturbances: bool) -> Callable[[Truth, list[FlightRecord]], Estimate]:
    """Return prediction error from a CVA start; its intervals are those of complex pairs."""

    def run(truth: Truth, records: list[FlightRecord]) -> Estimate:
        start = family.estimate(records, ("de",), OUTPUTS, method="cva", stable=True, **HORIZONS)
        model = prediction_error(records, start, disturbances=disturbances)
        (poles,) = model.poles().values()
        pair = closest(poles, truth.pair)
        told = None
        for a in model.diagnostics["pole_accuracy"]:
            if abs(a.pole.imag) > 0.0 and min(abs(a.pole - pair)) < 1e-6 * abs(a.pole):
                told = np.array([a.wn_std, a.zeta_std])
        return Estimate(modal_of(pair), told)

    return run


def transfer(truth: Truth, records: list[FlightRecord], by_instruments: bool) -> Estimate:
    """Return the short period of the transfer function to q alone."""
    if not by_instruments:
        model: Any = transfer_function.estimate(records, ("de",), ("q",), poles=4, zeros=(3,))
        return Estimate(modal_of(closest(model.poles()["q"], truth.pair)), None)
    model = srivc.estimate(records, ("de",), ("q",), poles=4, zeros=3, hold="zoh")
    pair = closest(model.poles()["q"], truth.pair)
    told = None
    for mode in model.modes()["q"]:
        if abs(mode.pole.imag) > 0.0 and min(abs(mode.pole - pair)) < 1e-6 * abs(mode.pole):
            told = np.array([mode.wn_error_rad_s, mode.zeta_error])
    return Estimate(modal_of(pair), told)


METHODS: dict[str, tuple[float, Callable[[Truth, list[FlightRecord]], Estimate]]] = {
    "output_error": (1.0, parametric(output_error)),
    "equation_error": (1.0, parametric(equation_error)),
    **{name: (1.0, subspace(name)) for name in ("dsr_e", "moesp", "n4sid", "cva", "dsr", "ssarx", "pbsid_opt")},
    "transfer_function (q)": (1.0, lambda t, r: transfer(t, r, False)),
    "srivc (q)": (0.5, lambda t, r: transfer(t, r, True)),
    "prediction_error, K = 0": (0.25, refined(False)),
    "prediction_error": (0.25, refined(True)),
    "ekf": (0.25, parametric(ekf)),
    "ukf": (0.25, parametric(ukf)),
    "filter_error": (0.25, parametric(filter_error)),
}
"""Method -> share of the seeds that its cost allows, and how it is run."""

COLUMNS = (
    "aircraft",
    "method",
    "seeds",
    "refused",
    "rms_over_bound_wn",
    "rms_over_bound_zeta",
    "median_error_over_bound_wn",
    "bias_over_bound_wn",
    "bias_over_bound_zeta",
    "bias_percent_wn",
    "bias_percent_zeta",
    "coverage_wn",
    "coverage_zeta",
    "binomial_low",
    "binomial_high",
    "ms_per_estimate",
)


def study(name: str, method: str, truth: Truth, seeds: int) -> dict[str, Any]:
    """Return one row of the table."""
    run = METHODS[method][1]
    errors, covered, refused, begun = [], [], 0, time.perf_counter()
    for seed in range(seeds):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)
                found = run(truth, noisy(truth, seed))
        except EstimationError:
            refused += 1
            continue
        errors.append(found.modal - truth.modal)
        if found.told is not None:
            covered.append(np.abs(errors[-1]) < 1.96 * found.told)
    spent = 1e3 * (time.perf_counter() - begun) / seeds
    row: dict[str, Any] = dict.fromkeys(COLUMNS, "")
    row |= {"aircraft": name, "method": method, "seeds": seeds, "refused": refused, "ms_per_estimate": f"{spent:.0f}"}
    if errors:
        e = np.array(errors)
        scaled = e / truth.bound
        rms, bias = np.sqrt(np.mean(scaled**2, axis=0)), scaled.mean(axis=0)
        percent = 100.0 * e.mean(axis=0) / truth.modal
        for i, what in enumerate(("wn", "zeta")):
            row[f"rms_over_bound_{what}"] = f"{rms[i]:.2f}"
            row[f"bias_over_bound_{what}"] = f"{bias[i]:+.2f}"
            row[f"bias_percent_{what}"] = f"{percent[i]:+.2f}"
        row["median_error_over_bound_wn"] = f"{np.median(np.abs(scaled[:, 0])) / 0.6745:.2f}"
    if len(covered) >= 0.5 * seeds:
        share = np.mean(covered, axis=0)
        half = 1.96 * np.sqrt(0.95 * 0.05 / len(covered))
        row |= {
            "coverage_wn": f"{share[0]:.3f}",
            "coverage_zeta": f"{share[1]:.3f}",
            "binomial_low": f"{0.95 - half:.3f}",
            "binomial_high": f"{min(0.95 + half, 1.0):.3f}",
        }
    return row


def main(arguments: list[str] | None = None) -> None:
    """Run the study for one or both aircraft and write results/estimators/scatter_<aircraft>.csv."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--aircraft", choices=list(CONDITIONS), nargs="*", default=list(CONDITIONS))
    parser.add_argument("--methods", choices=list(METHODS), nargs="*", default=list(METHODS))
    parser.add_argument("--seeds", type=int, default=400)
    parser.add_argument("--folder", type=Path, default=RESULTS)
    given = parser.parse_args(arguments)
    given.folder.mkdir(parents=True, exist_ok=True)
    for name in given.aircraft:
        truth = prepare(name)
        print(f"{name}: short period {truth.modal[0]:.3f} rad/s, {truth.modal[1]:.3f}; bound {truth.bound}", flush=True)
        file = given.folder / f"scatter_{name}.csv"
        with file.open("w", encoding="utf-8", newline="") as stream:
            table = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
            table.writeheader()
            for method in given.methods:
                row = study(name, method, truth, max(2, round(METHODS[method][0] * given.seeds)))
                table.writerow(row)
                stream.flush()
                print(" ".join(str(v) for v in row.values()), flush=True)


if __name__ == "__main__":
    main()
