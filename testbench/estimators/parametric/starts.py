"""Where searches start: at the structure's own values and at those of equation error, and where else if need be.

Where a method that fits a structure starts: the structure of its entry, with values from equation error.

Output and filter error look for start values by themselves, from Python too (see ``starts``), but for lags of servos.

Angle of attack or sideslip where no vane was flown: integrated from rates and accelerations, to start a search from.

    alphadot = q + az / V,    betadot = (ay + g cos(theta0) phi) / V + p sin(alpha0) - r cos(alpha0)

as deviations from trim. Biases of gyro and accelerometer make the integral drift; the straight line that fits it best
is taken out. What is left is good for start values only: slow motion is lost in that line. V. Klein, E. A. Morelli,
Aircraft System Identification, 2006, section 10.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.parametric import equation_error
from testbench.estimators.parametric.kalman.likelihood import FilterLikelihood, search
from testbench.estimators.parametric.likelihood import Likelihood
from testbench.estimators.parametric.servo import START_LAGS_S, SUBSTEPS, in_front
from testbench.estimators.parametric.structure import ModelStructure
from testbench.estimators.parametric.structures.build import build
from testbench.estimators.settings import EquationError
from testbench.estimators.structured import Fitted, Structured

# --- angle of attack or sideslip where no vane was flown --------------------------------------------------------------


def with_flow_angle(structure: Any, record: FlightRecord) -> FlightRecord:
    """Return the record with the flow angle that a structure has as state and the record lacks; itself if it can't be.

    Args:
        structure: with a trim, behind servos or not.
        record: prepared: deviations from trim, SI.
    """
    trim = getattr(getattr(structure, "base", structure), "trim", None)
    if trim is None:
        return record
    rate: FloatArray
    if "alpha" in structure.states and "alpha" not in record and {"q", "az"} <= set(record.channels):
        name, rate = "alpha", record["q"] + record["az"] / trim.V
    elif "beta" in structure.states and "beta" not in record and {"p", "r", "phi", "ay"} <= set(record.channels):
        side = (record["ay"] + trim.g * np.cos(trim.theta) * record["phi"]) / trim.V
        name, rate = "beta", side + np.sin(trim.alpha) * record["p"] - np.cos(trim.alpha) * record["r"]
    else:
        return record
    angle = record.dt_s * np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))])
    t = record.t_s - record.t_s[0]
    return record.with_columns({name: angle - np.polyval(np.polyfit(t, angle, 1), t)})


# --- where searches start ---------------------------------------------------------------------------------------------


_BY_THEMSELVES = ("equation_error", "output_error", "filter_error")


def of_servos(entry: Any) -> Any:
    """Return an entry whose known delays of servos stand among its delays, and whose steps are fine enough for them.

    Raises:
        EstimationError: equation error is asked to estimate a servo, which it takes as known; or a delay stands twice.
    """
    servos = {name: servo for name, servo in entry.servo.items() if not servo.ignore}
    for name, servo in servos.items():
        limited = servo.rate_limit_deg_s is not None
        able = ("output_error",) if limited else ("output_error", "filter_error")
        if "estimate" in (servo.lag_s, servo.delay_s) and entry.method not in able:
            raise EstimationError(
                f"{entry.method} needs a known servo of '{name}'{' with its rate limit' if limited else ''}; give "
                f"lag_s and delay_s as numbers, or let {' or '.join(able)} estimate them"
            )
        if servo.delay_s and name in entry.delays_s:
            raise EstimationError(f"the delay of '{name}' is given in delays_s and in its servo; give it once")
    known = {n: float(s.delay_s) for n, s in servos.items() if s.delay_s != "estimate" and s.delay_s > 0.0}
    changes: dict[str, Any] = {"delays_s": {**entry.delays_s, **known}} if known else {}
    if hasattr(entry, "substeps") and any(s.rate_limit_deg_s is not None for s in servos.values()):
        changes["substeps"] = max(entry.substeps, SUBSTEPS)
    return entry.model_copy(update=changes) if changes else entry


def started(
    entry: Structured, records: Sequence[FlightRecord], inputs: Sequence[str], outputs: Sequence[str]
) -> ModelStructure:
    """Return the structure of an entry; equation error gives its start values where all its states are measured.

    Values that the entry's ``start`` names stay. Lags that are to be estimated start from the one, of some, with which
    equation error leaves least.

    Args:
        entry: of a scenario.
        records: prepared records.
        inputs: (m,) input channels of the identification.
        outputs: (p,) output channels of the identification.

    Raises:
        EstimationError: see :func:`.structures.build.build`.
    """
    structure: ModelStructure = build(entry, inputs, outputs, records)
    measured = structure.states[: len(structure.states) - len(structure.followers)]
    lags, method = _lags(structure, entry), getattr(entry, "method", "")
    alone = method == "equation_error" or (method in _BY_THEMSELVES and not lags[0])
    if alone or not all(s in r for s in measured for r in records):
        return structure
    first = None
    for values in lags:
        try:
            tried = equation_error.estimate(records, structure.with_parameters(values), _as_told(entry, structure))
        except EstimationError:
            continue  # its own start must do; what the data do not decide, the method itself says
        left = float(np.sum(np.log(np.maximum(tried.diagnostics["residual_std"], 1e-300))))
        if first is None or left < first[0]:
            first = left, tried
    if first is None:
        return structure
    return structure.with_parameters({name: v for name, v in first[1].values.items() if name not in entry.start})


def _as_told(settings: Fitted, structure: ModelStructure) -> EquationError:
    """Return equation error with the delays and holds of the settings of another method."""
    delays = {name: delay for name, delay in settings.delays_s.items() if name in structure.inputs}
    return EquationError(delays_s=delays, held=settings.held)


def _lags(structure: Any, entry: Structured) -> list[dict[str, float]]:
    """Return the values of unknown lags to try; one set without any if there are none."""
    unknown = structure.unknown if in_front(structure) else ()
    names = [name for name in unknown if name.startswith("tau_") and name not in entry.start]
    return [dict.fromkeys(names, lag) for lag in START_LAGS_S] if names else [{}]  # one servo is much like another


_SPREAD = 0.5  # of the values that others scatter about, relative
_ROUNDS, _STEPS = 8, 10  # of filter error where it only gives a start


def first_points(likelihood: Likelihood, records: Sequence[FlightRecord], settings: Fitted) -> list[FloatArray]:
    """Return the structure's values and, where all its states are measured, those of equation error, (k,) each.

    A flow angle that was not measured is reconstructed from rates and accelerations for it.

    The one that follows the records better as it stands comes first.
    """
    structure = likelihood.structure
    points = [structure.values]
    measured = structure.states[: len(structure.states) - len(structure.followers)]
    records = [with_flow_angle(structure, record) for record in records]
    if all(state in record for state in measured for record in records):
        try:
            found = equation_error.estimate(records, structure, _as_told(settings, structure)).params
        except EstimationError:
            return points  # its own values must do; what the data do not decide, the method itself says
        points.append(np.where(structure.free, found, structure.values))
    misses = [_miss(likelihood, values) for values in points]
    return [points[i] for i in np.argsort(misses, kind="stable")]


def _miss(likelihood: Likelihood, values: FloatArray) -> float:
    """Return the log likelihood of the outputs as simulated, less what all points share; smaller is better."""
    with np.errstate(all="ignore"):
        residuals = likelihood.residuals(likelihood.start(values), values)
        squares = np.sum(np.vstack(residuals) ** 2, axis=0) / likelihood.counts
        miss = float(likelihood.counts @ np.log(squares + (1e-12 * likelihood.size) ** 2))
    return miss if np.isfinite(miss) else np.inf


def point_of_filter_error(likelihood: Likelihood, values: FloatArray) -> FloatArray | None:
    """Return roughly what filter error finds from ``values`` (k,), all states but servos noisy; None if it fails.

    Its predictions start afresh from every sample, so that it has far fewer false minima than a simulation.
    """
    states = len(likelihood.structure.states)
    noisy = range(states - len(likelihood.structure.followers))
    try:
        found = search(FilterLikelihood(likelihood, noisy, np.zeros(states)), values, _STEPS, _ROUNDS)
    except EstimationError:
        return None
    return likelihood.parameters(found.minimum.point, likelihood.structure.values)


def scattered(structure: ModelStructure, about: FloatArray, count: int, rng: np.random.Generator) -> list[FloatArray]:
    """Return points (k,) that scatter by half of the values ``about`` (k,), or over bounds that are finite.

    Args:
        structure: says which values are free, and their bounds.
        about: the values.
        count: how many points.
        rng: draws them.
    """
    low, high = structure.bounds
    bounded = np.isfinite(low) & np.isfinite(high)
    points = []
    for _ in range(count):
        near = about + _SPREAD * np.abs(about) * rng.standard_normal(about.size)
        inside = rng.uniform(np.where(bounded, low, 0.0), np.where(bounded, high, 1.0))
        point = np.where(bounded, inside, np.clip(near, low, high))
        points.append(np.where(structure.free, point, structure.values))
    return points
