"""The estimators of the study: each takes a case and records and returns estimates with the errors that it tells."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from estimator_cases import DT, ERRORS, LINES, OUTPUTS, PERIOD_S, RESPONDING, Case, closest, gradient, modal_of

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators import srivc, transfer_function
from testbench.estimators.frequency.equivalent import fit_equivalent
from testbench.estimators.frequency.response import estimate_frequency_response
from testbench.estimators.parametric import equation_error, filter_error, output_error
from testbench.estimators.parametric.kalman import ekf, ukf
from testbench.estimators.parametric.structures import longitudinal
from testbench.estimators.prediction_error import refine as prediction_error
from testbench.estimators.settings import (
    DsrE,
    EquationError,
    ExtendedFilter,
    FilterError,
    LowOrder,
    OutputError,
    Refinement,
    Srivc,
    Subspace,
    TransferFunctions,
    UnscentedFilter,
)
from testbench.estimators.subspace import dsr_e, family
from testbench.inference.instruments import every_error

HORIZONS = {"past_horizon": 15, "future_horizon": 15, "order": 4}
FAMILY = ("moesp", "n4sid", "cva", "dsr", "ssarx", "pbsid_opt")
REPLICAS = 25


class Found(NamedTuple):
    """Quantity -> (estimate, standard error or None if none is told), and whether the method warned."""

    values: dict[str, tuple[float, float | None]]
    warned: bool


Method = Callable[[Case, list[FlightRecord]], Found]


def _of_poles(
    pair: np.ndarray, true: dict[str, float], told: dict[str, float]
) -> dict[str, tuple[float, float | None]]:
    """Return the modal quantities; a complex pair where two real poles are true has no interval that holds them."""
    found = modal_of(pair)
    out: dict[str, tuple[float, float | None]] = {q: (v, told.get(q)) for q, v in found.items() if q in true}
    if "slow pole" in true and "slow pole" not in found and told:
        out |= {q: (float(pair[0].real), 0.0) for q in ("slow pole", "fast pole")}
    return out


def parametric(module: Any, settings: Any) -> Method:
    """Return a method that knows the equations; it starts from equation error, as in a scenario."""

    def run(case: Case, records: list[FlightRecord]) -> Found:
        true = case.structure
        structure = longitudinal(true.trim, outputs=OUTPUTS)
        if module is not equation_error:
            first = equation_error.estimate(records, structure, EquationError(held=("de",)))
            structure = structure.with_parameters(first.values)
        model = module.estimate(records, structure, settings(held=("de",)))
        pair = closest(np.linalg.eigvals(model.linear().A).astype(complex), case.pair)
        slopes = gradient(structure, model.params, pair)
        told = {q: float(np.sqrt(slope @ model.covariance @ slope)) for q, slope in slopes.items()}
        out = _of_poles(pair, case.true, told)
        free, errors = np.flatnonzero(structure.free), np.sqrt(np.diag(model.covariance))
        for i in free:
            out[f"derivatives: {structure.parameter_names[i]}"] = (float(model.params[i]), float(errors[i]))
        return Found(out, model.status != "good")

    return run


def subspace(method: str, replicas: int = 0) -> Method:
    """Return a subspace method without feedthrough; its errors are those of a bootstrap."""

    def run(case: Case, records: list[FlightRecord]) -> Found:
        if method == "dsr_e":
            model = dsr_e.estimate(records, ("de",), OUTPUTS, DsrE(**HORIZONS))
        else:
            model = family.estimate(records, ("de",), OUTPUTS, Subspace(method=method, bootstrap=replicas, **HORIZONS))
        (poles,) = model.poles().values()
        pair = closest(poles, case.pair)
        told: dict[str, float] = {}
        if replicas:
            d = model.diagnostics
            at = [int(np.argmin(np.abs(d["bootstrap_reference_poles"] - s))) for s in pair]
            if np.all(pair.imag == 0.0):
                told = {
                    "slow pole": float(d["poles_std"][at[int(np.argmax(pair.real))]]),
                    "fast pole": float(d["poles_std"][at[int(np.argmin(pair.real))]]),
                }
            else:
                told = {"wn": float(d["wn_std"][at[0]]), "zeta": float(d["zeta_std"][at[0]])}
        return Found(_of_poles(pair, case.true, told), model.status != "good")

    return run


def refined(disturbances: bool) -> Method:
    """Return prediction error from a CVA start."""

    def run(case: Case, records: list[FlightRecord]) -> Found:
        start = family.estimate(records, ("de",), OUTPUTS, Subspace(method="cva", stable=True, **HORIZONS))
        model = prediction_error(records, start, Refinement(disturbances=disturbances))
        (poles,) = model.poles().values()
        pair = closest(poles, case.pair)
        rows = [(a.pole, a.wn_std, a.zeta_std, a.real_std) for a in model.diagnostics["pole_accuracy"]]
        return Found(_of_poles(pair, case.true, _told(pair, rows)), model.status != "good")

    return run


def _told(pair: np.ndarray, rows: Sequence[tuple[complex, float, float, float]]) -> dict[str, float]:
    """Return the errors told of a pair from (pole, error of wn, of zeta, of the real part) of single modes."""
    near = [min(rows, key=lambda row: min(abs(row[0] - s), abs(np.conj(row[0]) - s))) for s in pair]
    if np.any(pair.imag != 0.0):
        return {"wn": float(near[0][1]), "zeta": float(near[0][2])}
    slow, fast = (near[int(i)] for i in (np.argmax(pair.real), np.argmin(pair.real)))
    return {"slow pole": float(slow[3]), "fast pole": float(fast[3])}


def _continuous(model: Any, output: str, case: Case) -> Found:
    """Return what a transfer function in continuous time says of the short period."""
    pair = closest(model.poles()[output], case.pair)
    rows = [(m.pole, m.wn_error_rad_s, m.zeta_error, m.wn_error_rad_s) for m in model.modes()[output]]
    told = {q: s for q, s in _told(pair, rows).items() if np.isfinite(s)} if np.size(model.covariance) else {}
    return Found(_of_poles(pair, case.true, told), model.status != "good")


def transfer(case: Case, records: list[FlightRecord]) -> Found:
    """Return the short period of the least-squares transfer function to q alone."""
    model = transfer_function.estimate(records, ("de",), ("q",), TransferFunctions(poles=4, zeros=(3,)))
    return Found(_of_poles(closest(model.poles()["q"], case.pair), case.true, {}), model.status != "good")


def instruments(case: Case, records: list[FlightRecord]) -> Found:
    """Return the short period of the SRIVC transfer function to q alone."""
    return _continuous(srivc.estimate(records, ("de",), ("q",), Srivc(poles=(4,), zeros=(3,), hold="zoh")), "q", case)


def _response(case: Case, records: list[FlightRecord]) -> Found:
    """Return gain and phase at the lines of the multisine; intervals as long as the response says."""
    r = _frequency_response(records)
    told = r.random_error * r.diagnostics["interval_factor"] / 1.96
    out: dict[str, tuple[float, float | None]] = {}
    for i, output in enumerate(RESPONDING):
        H, error = r.H[:, i, 0], told[:, i, 0]
        for f, h, true, e in zip(LINES / PERIOD_S, H, case.response[:, i], error, strict=True):
            out[f"gain: {output}, {f:.1f} Hz"] = (float(np.abs(h)), float(e * np.abs(h)))
            out[f"phase: {output}, {f:.1f} Hz"] = (float(np.angle(h / true)), float(e))
    return Found(out, r.status != "good")


def _frequency_response(records: list[FlightRecord]) -> Any:
    omega = 2.0 * np.pi * LINES / PERIOD_S
    return estimate_frequency_response(records[1:], ("de",), RESPONDING, window_s=20.0, omega_rad_s=omega)


def _equivalent(case: Case, records: list[FlightRecord]) -> Found:
    """Return the short period of a transfer function fitted to the response."""
    order = LowOrder(poles=4, zeros=3, delay=False, weighting="loes", hold="zoh")
    return _continuous(fit_equivalent(_frequency_response(records), order), ", ".join(RESPONDING), case)


def compatibility(case: Case, records: list[FlightRecord]) -> Found:
    """Return the errors of instruments: those found, and all that the data tell, estimated together."""
    every = every_error(records)
    if every is None:
        raise EstimationError("kinematics bind no channel")
    values: dict[str, tuple[float, float | None]] = {}
    for name, of in every.found.items():
        values |= {f"instrument errors: {name}": of} if name in ERRORS else {}
    return Found(values | {f"tested instrument errors: {name}": of for name, of in every.told.items()}, False)


LONGITUDINAL: dict[str, Method] = {
    "output_error": parametric(output_error, OutputError),
    **{name: subspace(name) for name in ("dsr_e", *FAMILY)},
    "equation_error": parametric(equation_error, EquationError),
    "transfer_function (q)": transfer,
    "srivc (q)": instruments,
    "prediction_error, K = 0": refined(False),
    "prediction_error": refined(True),
    "filter_error": parametric(filter_error, FilterError),
    "ekf": parametric(ekf, ExtendedFilter),
    "ukf": parametric(ukf, UnscentedFilter),
    **{f"{name}, bootstrap": subspace(name, REPLICAS) for name in FAMILY},
}
"""Method -> how it is run, on the 3-2-1-1 flights."""

MULTISINE: dict[str, Method] = {"frequency response, windowed": _response, "equivalent, windowed": _equivalent}
INSTRUMENTS: dict[str, Method] = {"data compatibility": compatibility}
METHODS = LONGITUDINAL | MULTISINE | INSTRUMENTS
assert set(DT) == {"taurus", "eolo"}
