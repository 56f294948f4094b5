"""How near each estimator comes to the Cramer-Rao bound, and whether its intervals hold the truth.

Run with ``make estimator-study``; the tables go to results/estimators/. Simulated: the linearised longitudinal motion
of an aircraft, two records of 320 and 240 samples (Taurus at 40 Hz, EOLO at 20 Hz), 3-2-1-1 multisteps of 0.05 rad of a
held elevator, each followed by its mirror image, white noise of the EOLO suite with the air data boom on V, alpha, q
and theta. Only the noise differs from seed to seed. Judged are frequency and damping of the short period against the
bound of the parametric structure, which knows the equations; black boxes know less and cannot reach it. EOLO's short
period is overdamped here: two real poles, whose product and sum stand for frequency and damping.

Methods that know the equations are judged by all their derivatives, too: the errors, whitened by the bound's covariance
(root mean square 1 at the bound), and the pooled share of 95 % intervals that hold the truth.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import binom

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "estimators" / "parametric"), str(ROOT / "tests" / "studies")]

from parametric_cases import fly  # noqa: E402
from rich.progress import Progress  # noqa: E402

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
LENGTHS, AMPLITUDE = (320, 240), 0.05
DT = {"taurus": 0.025, "eolo": 0.05}
UNITS = {"taurus": (0.15, 0.25), "eolo": (0.3, 0.5)}  # of the 3-2-1-1, s
HELD = np.ones(1, bool)
CONDITIONS = {"taurus": FlightCondition(12.0, 100.0), "eolo": FlightCondition(16.0, 547.0)}
HORIZONS = {"past_horizon": 15, "future_horizon": 15, "order": 4}
RESULTS = ROOT / "results" / "estimators"


class Truth(NamedTuple):
    """The structure with its true values, records without noise, noise (p,), the pair of poles, wn and zeta, bounds."""

    structure: Any
    clean: list[FlightRecord]
    std: np.ndarray
    pair: np.ndarray
    modal: np.ndarray  # wn, zeta
    bound: np.ndarray  # (2,) standard deviations of wn, zeta
    whiten: np.ndarray  # (f, f) takes errors of the free derivatives to unit covariance at the bound


class Estimate(NamedTuple):
    """wn and zeta of the short period with the standard errors that the method gives, None where it gives none.

    ``derivatives`` (2, f): whitened errors of the free derivatives, and errors over the standard errors told.
    """

    modal: np.ndarray
    told: np.ndarray | None
    warned: bool
    derivatives: np.ndarray | None = None


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


def elevator(name: str) -> list[np.ndarray]:
    """Return the input (n, 1) of each record: 3-2-1-1, its mirror image, and so on, with a rest between them."""
    out = []
    for samples, unit in zip(LENGTHS, UNITS[name], strict=True):
        u, width, k, sign = np.zeros((samples, 1)), round(unit / DT[name]), 10, 1.0
        while k < samples:
            for length in (3, 2, 1, 1, 3, 2, 1, 1):
                u[k : k + length * width] = sign * AMPLITUDE
                k, sign = k + length * width, -sign
            k += 2 * width
        out.append(u)
    return out


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
    for i, u in enumerate(elevator(name)):
        r = respond(structure, p, free.tolist(), u, DT[name], HELD, np.zeros(n))
        clean.append(fly(structure, p, u, DT[name], np.zeros(n), held=True))
        own = [r.dx0 if i == k else np.zeros((len(u), len(OUTPUTS), n)) for k in range(len(LENGTHS))]
        J.append((np.concatenate([r.dparams, *own], axis=2) / std[:, None]).reshape(len(u) * len(OUTPUTS), -1))
    stacked = np.vstack(J)
    covariance = np.linalg.inv(stacked.T @ stacked)[: free.size, : free.size]
    poles = np.linalg.eigvals(structure.matrices(p).A)
    pair = poles[np.argsort(-np.abs(poles))[:2]]
    slope = gradient(structure, p, pair)[:, free]
    bound = np.sqrt(np.einsum("ij,jk,ik->i", slope, covariance, slope))
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    return Truth(structure, clean, std, pair, modal_of(pair), bound, whiten)


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
        told = np.sqrt(np.einsum("ij,jk,ik->i", slope, model.covariance, slope))
        free = np.flatnonzero(structure.free)
        error = (model.params - truth.structure.values)[free]
        both = np.array([truth.whiten @ error, error / np.sqrt(np.diag(model.covariance))[free]])
        return Estimate(modal_of(pair), told, model.status == "warning", both)

    return run


def subspace(method: str) -> Callable[[Truth, list[FlightRecord]], Estimate]:
    """Return a subspace method without feedthrough."""

    def run(truth: Truth, records: list[FlightRecord]) -> Estimate:
        model = (
            dsr_e.estimate(records, ("de",), OUTPUTS, **HORIZONS)
            if method == "dsr_e"
            else family.estimate(records, ("de",), OUTPUTS, method=method, **HORIZONS)
        )
        (poles,) = model.poles().values()
        return Estimate(modal_of(closest(poles, truth.pair)), None, model.status == "warning")

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
        return Estimate(modal_of(pair), told, model.status == "warning")

    return run


def transfer(truth: Truth, records: list[FlightRecord], by_instruments: bool) -> Estimate:
    """Return the short period of the transfer function to q alone."""
    if not by_instruments:
        model: Any = transfer_function.estimate(records, ("de",), ("q",), poles=4, zeros=(3,))
        return Estimate(modal_of(closest(model.poles()["q"], truth.pair)), None, model.status == "warning")
    model = srivc.estimate(records, ("de",), ("q",), poles=4, zeros=3, hold="zoh")
    pair = closest(model.poles()["q"], truth.pair)
    told = None
    for mode in model.modes()["q"]:
        if abs(mode.pole.imag) > 0.0 and min(abs(mode.pole - pair)) < 1e-6 * abs(mode.pole):
            told = np.array([mode.wn_error_rad_s, mode.zeta_error])
    return Estimate(modal_of(pair), told, model.status == "warning")


METHODS: dict[str, tuple[float, Callable[[Truth, list[FlightRecord]], Estimate]]] = {
    "output_error": (1.0, parametric(output_error)),
    **{name: (0.5, subspace(name)) for name in ("dsr_e", "moesp", "n4sid", "cva", "dsr", "ssarx", "pbsid_opt")},
    "equation_error": (0.5, parametric(equation_error)),
    "transfer_function (q)": (0.5, lambda t, r: transfer(t, r, False)),
    "srivc (q)": (0.5, lambda t, r: transfer(t, r, True)),
    "prediction_error, K = 0": (0.25, refined(False)),
    "prediction_error": (0.1, refined(True)),
    "ekf": (0.15, parametric(ekf)),
    "ukf": (0.15, parametric(ukf)),
    "filter_error": (0.05, parametric(filter_error)),
}
"""Method -> share of the seeds that its cost allows, and how it is run."""

COLUMNS = (
    "aircraft",
    "method",
    "seeds",
    "refused",
    "warned",
    "rms_over_bound_wn",
    "rms_over_bound_zeta",
    "bias_percent_wn",
    "bias_percent_zeta",
    "rms_percent_wn",
    "rms_percent_zeta",
    "coverage_wn",
    "coverage_zeta",
    "binomial_low",
    "binomial_high",
    "rms_over_bound_derivatives",
    "coverage_derivatives",
)


def study(name: str, method: str, truth: Truth, seeds: int, step: Callable[[], Any]) -> dict[str, Any]:
    """Return one row of the table."""
    run = METHODS[method][1]
    found, refused = [], 0
    for seed in range(seeds):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)
                found.append(run(truth, noisy(truth, seed)))
        except EstimationError:
            refused += 1
        step()
    row: dict[str, Any] = dict.fromkeys(COLUMNS, "")
    row |= {"aircraft": name, "method": method, "seeds": seeds, "refused": refused}
    if not found:
        return row
    row["warned"] = sum(f.warned for f in found)
    errors = np.array([f.modal for f in found]) - truth.modal
    rms, bias = np.sqrt(np.mean(errors**2, axis=0)), errors.mean(axis=0)
    for i, what in enumerate(("wn", "zeta")):
        row[f"rms_over_bound_{what}"] = f"{rms[i] / truth.bound[i]:.2f}"
        row[f"bias_percent_{what}"] = f"{100.0 * bias[i] / truth.modal[i]:+.2f}"
        row[f"rms_percent_{what}"] = f"{100.0 * rms[i] / truth.modal[i]:.2f}"
    told = [(e, f.told) for e, f in zip(errors, found, strict=True) if f.told is not None]
    if len(told) >= 0.5 * seeds:
        covered = np.mean([np.abs(e) < 1.96 * t for e, t in told], axis=0)
        # Some forty coverages stand in the tables: limits that each leaves by chance once in a thousand.
        limits = binom.ppf([0.0005, 0.9995], len(told), 0.95) / len(told)
        row |= {"coverage_wn": f"{covered[0]:.3f}", "coverage_zeta": f"{covered[1]:.3f}"}
        row |= {"binomial_low": f"{limits[0]:.3f}", "binomial_high": f"{limits[1]:.3f}"}
    if found[0].derivatives is not None:
        whitened, normalised = np.stack([f.derivatives for f in found], axis=1)
        row["rms_over_bound_derivatives"] = f"{np.sqrt(np.mean(whitened**2)):.3f}"
        row["coverage_derivatives"] = f"{np.mean(np.abs(normalised) < 1.96):.3f}"
    return row


def main(arguments: list[str] | None = None) -> None:
    """Run the study for one or both aircraft and write scatter_<aircraft>.csv."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--aircraft", choices=list(CONDITIONS), nargs="*", default=list(CONDITIONS))
    parser.add_argument("--methods", choices=list(METHODS), nargs="*", default=list(METHODS))
    parser.add_argument("--seeds", type=int, default=400, help="of output error; slower methods take a share of them")
    parser.add_argument("--folder", type=Path, default=RESULTS)
    parser.add_argument("--resume", action="store_true", help="keep the rows that an interrupted study has left")
    given = parser.parse_args(arguments)
    given.folder.mkdir(parents=True, exist_ok=True)
    with Progress() as progress:
        for name in given.aircraft:
            file = given.folder / f"scatter_{name}.csv"
            rows = {}
            if given.resume and file.is_file():
                with file.open(encoding="utf-8", newline="") as stream:
                    rows = {row["method"]: row for row in csv.DictReader(stream)}
            truth = prepare(name)
            for method in given.methods:
                seeds = max(2, round(METHODS[method][0] * given.seeds))
                if str(rows.get(method, {}).get("seeds")) == str(seeds):
                    continue
                task = progress.add_task(f"{name} {method}", total=seeds)
                rows[method] = study(name, method, truth, seeds, lambda task=task: progress.advance(task))
                with file.open("w", encoding="utf-8", newline="") as stream:
                    table = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
                    table.writeheader()
                    table.writerows(rows[m] for m in METHODS if m in rows)
            progress.console.print(
                f"{name}: short period {truth.modal[0]:.3f} rad/s, damping {truth.modal[1]:.3f}; "
                f"bound {100 * truth.bound[0] / truth.modal[0]:.2f} % and {100 * truth.bound[1] / truth.modal[1]:.2f} %"
            )


if __name__ == "__main__":
    main()
