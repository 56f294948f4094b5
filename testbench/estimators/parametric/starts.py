"""Where searches start: at the structure's own values and at those of equation error, and where else if need be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.parametric import equation_error
from testbench.estimators.parametric.kalman.likelihood import FilterLikelihood
from testbench.estimators.parametric.kalman.search import search
from testbench.estimators.parametric.likelihood import Likelihood
from testbench.estimators.parametric.reconstructed import with_flow_angle
from testbench.estimators.parametric.structure import ModelStructure

_SPREAD = 0.5  # of the values that others scatter about, relative
_ROUNDS, _STEPS = 8, 10  # of filter error where it only gives a start


def first_points(
    likelihood: Likelihood,
    records: Sequence[FlightRecord],
    delays_s: Mapping[str, float] | None,
    held: Sequence[str] | None,
) -> list[FloatArray]:
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
            found = equation_error.estimate(records, structure, delays_s=delays_s, held=held).params
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
