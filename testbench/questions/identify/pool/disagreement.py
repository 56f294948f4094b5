"""Logs that disagree by more than their errors: by how much, which one, and what would explain it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2 as chi_square

from testbench.core.record import FloatArray
from testbench.questions.identify.pool.least_squares import Fit, LogCoefficients, Trend, alone, fit, inverse, rows
from testbench.questions.identify.pool.trends import best_trend
from testbench.questions.identify.scenario import TrendVariable

_RATES = ("_p", "_q", "_r")
_SIZES = (0.01, 0.02, 0.05, 0.1, 0.2)  # relative deviations from log to log that a cause is tried with
_HALVINGS = 40


@dataclass(frozen=True)
class Cause:
    """One quantity whose errors from log to log would explain a disagreement.

    Attributes:
        what: in words.
        size: relative standard deviation, log to log, with which the logs agree.
        deviations: log -> relative error of the quantity, as the coefficients show it.
    """

    what: str
    size: float
    deviations: Mapping[str, float]


@dataclass(frozen=True)
class Disagreement:
    """What is known of a disagreement.

    Attributes:
        between: coefficient -> standard deviation from log to log beyond the logs' own errors.
        outlying: the one log without which the others agree; "" if there is no such.
        causes: quantities of which an error would explain it.
    """

    between: Mapping[str, float]
    outlying: str
    causes: tuple[Cause, ...]


def disagreement(
    logs: Sequence[LogCoefficients], found: Fit, asked: TrendVariable, agree: float, trend: float
) -> Disagreement:
    """Return what is known of logs that disagree with the fit of all of them.

    Args:
        logs: all of them.
        found: by their own errors.
        asked: variable that a trend may have.
        agree: share of sets of logs that agree but are said not to.
        trend: share of sets of logs without a trend that show one.
    """
    outlying = _outlying(logs, asked, agree, trend)
    return Disagreement(_between(logs, found), outlying, _causes(logs, found, agree))


def added(logs: Sequence[LogCoefficients], between: Mapping[str, float]) -> list[FloatArray]:
    """Return what deviations from log to log add to the covariance of each log."""
    return [np.diag([between.get(name, 0.0) ** 2 for name in log.names]) for log in logs]


def _between(logs: Sequence[LogCoefficients], found: Fit) -> dict[str, float]:
    """Return the standard deviation from log to log of every coefficient of which the errors explain too little.

    Each coefficient by itself: the variance with which its weighted sum of squares is what it should be. R. C. Paule
    and J. Mandel, Journal of Research of the National Bureau of Standards 87(5), 1982.
    """
    out = {}
    for name in found.names:
        own = alone(logs, name)
        kept = (name,) if name in found.trend.names else ()
        X = np.vstack([rows(log, (name,), Trend(found.trend.variable, found.trend.reference, kept)) for log in own])
        y = np.array([log.values[0] for log in own])
        v = np.array([log.covariance[0, 0] for log in own])
        dof = len(own) - X.shape[1]
        if dof < 1 or _weighted_squares(X, y, v) <= dof:
            continue
        low, high = 0.0, float(np.max(v)) ** 0.5
        while _weighted_squares(X, y, v + high**2) > dof:
            high *= 2.0
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _weighted_squares(X, y, v + middle**2) > dof else (low, middle)
        out[name] = high
    return out


def _weighted_squares(X: FloatArray, y: FloatArray, v: FloatArray) -> float:
    """Return the weighted sum of squares of what X (n, s) leaves of y (n,) with variances v (n,)."""
    A, b = X / np.sqrt(v)[:, None], y / np.sqrt(v)
    left = b - A @ np.linalg.lstsq(A, b, rcond=None)[0]
    return float(left @ left)


def _outlying(logs: Sequence[LogCoefficients], asked: TrendVariable, level: float, trend_level: float) -> str:
    """Return the log that the others do not predict, if they agree among themselves about a trend of their own.

    "" if there is none or more than one.
    """
    found = []
    for i, log in enumerate(logs):
        rest = [*logs[:i], *logs[i + 1 :]]
        if len(rest) < 2:
            continue
        others = best_trend(rest, asked, trend_level)
        seen = [k for k, name in enumerate(log.names) if name in others.names]
        if not seen or others.dof < 1 or chi_square.sf(others.chi2, others.dof) < level:
            continue
        names = tuple(log.names[k] for k in seen)
        part = LogCoefficients(log.log, names, log.values[seen], log.covariance[np.ix_(seen, seen)], log.at)
        H = rows(part, others.names, others.trend)
        off = part.values - H @ others.b
        S = part.covariance + H @ others.covariance @ H.T
        if chi_square.sf(float(off @ inverse(S) @ off), len(seen)) * len(logs) < level:
            found.append(log.log)
    return found[0] if len(found) == 1 else ""


def _causes(logs: Sequence[LogCoefficients], found: Fit, level: float) -> tuple[Cause, ...]:
    """Return the quantities of which errors from log to log make the logs agree, the smallest error first.

    An error d of a quantity moves the coefficients of a log by g d: twice the airspeed's for those by angles, once for
    those by rates (q cbar / 2V holds one speed itself), once the mass's for forces, the inertia's for moments,
    and both for all.
    """
    out = []
    for what, share in _SHARES.items():
        for size in _SIZES:
            g = [
                np.array([share(name) for name in log.names]) * (log.values - r)
                for log, r in zip(logs, found.residuals, strict=True)
            ]
            if not any(np.any(v) for v in g):
                break
            extra = [size**2 * np.outer(v, v) for v in g]
            tried = fit(logs, found.trend, extra)
            if chi_square.sf(tried.chi2, tried.dof) < level:
                continue
            deviations = {
                log.log: float(size**2 * v @ inverse(log.covariance + e) @ r)
                for log, v, e, r in zip(logs, g, extra, tried.residuals, strict=True)
            }
            out.append(Cause(what, size, deviations))
            break
    return tuple(sorted(out, key=lambda cause: cause.size))


_SHARES = {
    "airspeed": lambda name: -1.0 if name.endswith(_RATES) else -2.0,
    "mass": lambda name: float(name[1] in "XYZ"),
    "pitch inertia": lambda name: float(name.startswith("Cm")),
    "mass and inertia alike": lambda name: 1.0,
    "roll and yaw inertia": lambda name: float(name.startswith(("Cl_", "Cn_"))),
}
"""Quantity -> its share in the relative error of a coefficient."""
