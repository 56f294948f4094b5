"""What errors of airspeed, mass and inertia do to coefficients, to first order.

Coefficients are made of derivatives with those quantities, c = w(s) x. Their relative errors d are shared by all logs:
one balance, one pitot tube, one swing test. A log moves by G_i d with G_i = dc_i/dln s, generalised least squares by

    db = C sum H_i' P_i^-1 G_i d = J d,    cov(b^) = C + J Sigma J',    Sigma = diag(std of d)^2,

with C the covariance by the logs' own errors. More logs make C small and leave J Sigma J' as it is. Errors of the
conversion alone are held: what a wrong airspeed does to the estimates of a structure that flies at it is not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbench.aircraft.model import SCALES
from testbench.core.record import FloatArray
from testbench.estimators.parametric.model import ParametricModel
from testbench.evaluation.coefficients import Scaling, weights
from testbench.pooling.least_squares import Fit, LogCoefficients, inverse, rows

_STEP = 1e-4  # of the logarithm of a quantity, for differences
_OF_MASS = {"mass": "mass_kg", **{name: name for name in ("Ixx", "Iyy", "Izz", "Ixz")}}


def changes_by_scale(model: ParametricModel, names: Sequence[str], scaling: Scaling) -> dict[str, FloatArray]:
    """Return quantity -> (k,) change of the coefficients of derivatives ``names`` per relative change of it.

    Parameters that are coefficients themselves were estimated with the quantities of their estimator: they move by
    the same powers, -2 of the airspeed (-1 by rates), 1 of mass or inertia.
    """
    out = {}
    for quantity in SCALES:
        ends = [_coefficients(model, names, scaled(scaling, quantity, sign * _STEP)) for sign in (1.0, -1.0)]
        out[quantity] = (ends[0] - ends[1]) / (2.0 * _STEP)
        for i, name in enumerate(names):
            if name[0] == "C":
                out[quantity][i] = _power(name, quantity) * model.values[name]
    return out


def scaled(scaling: Scaling, quantity: str, log_change: float) -> Scaling:
    """Return a scaling with one quantity times exp(log_change); dynamic pressure goes with the airspeed squared."""
    factor = math.exp(log_change)
    if quantity == "airspeed":
        return replace(scaling, V_m_s=scaling.V_m_s * factor, qbar_Pa=scaling.qbar_Pa * factor**2)
    key = _OF_MASS[quantity]
    value = getattr(scaling.mass, key)
    return scaling if value is None else replace(scaling, mass=replace(scaling.mass, **{key: value * factor}))


def _coefficients(model: ParametricModel, names: Sequence[str], scaling: Scaling) -> FloatArray:
    made = (weights(model.structure.meaning, model.structure.parameter_names, name, scaling) for name in names)
    return np.array([0.0 if found is None else float(found[1] @ model.params) for found in made])


def _power(name: str, quantity: str) -> float:
    if quantity == "airspeed":
        return -1.0 if name.endswith(("_p", "_q", "_r")) else -2.0
    return float(quantity == {"m": "Iyy", "l": "Ixx", "n": "Izz"}.get(name[1], "mass"))


def shared_errors(
    logs: Sequence[LogCoefficients], found: Fit, extra: Sequence[FloatArray] | None, stated: Mapping[str, float]
) -> dict[str, FloatArray]:
    """Return quantity -> (k + s,) what one standard deviation of it moves the pooled coefficients and slopes by.

    Args:
        logs: that ``found`` was fitted to.
        found: coefficients of all logs.
        extra: per log, (k_i, k_i) that was added to its covariance.
        stated: quantity -> relative standard deviation.
    """
    out = {}
    for quantity, std in stated.items():
        right = np.zeros(len(found.b))
        for i, log in enumerate(logs):
            W = log.information if extra is None else inverse(log.covariance + extra[i])
            moved = log.scales.get(quantity, np.zeros(len(log.names)))
            right += rows(log, found.names, found.trend).T @ W @ moved
        if np.any(right):
            out[quantity] = std * (found.covariance @ right)
    return out
