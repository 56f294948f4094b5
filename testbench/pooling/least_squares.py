"""Generalised least squares of the coefficients of several logs, each constant or linear in one variable.

    y_i = H_i b + e_i,    e_i ~ N(0, P_i),    b^ = (sum H_i' P_i^-1 H_i)^-1 sum H_i' P_i^-1 y_i

with y_i the coefficients of log i and P_i their whole covariance; b holds every coefficient at the reference and, for
those with a trend, its slope. A log that lacks a coefficient has no row of it. A. C. Aitken, Proc. Royal Society of
Edinburgh 55, 1936.

Which coefficients change with the flight condition: slopes kept by two tests, the variable by Akaike's criterion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import chi2 as chi_square
from scipy.stats import f as f_distribution

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.pooling import TrendVariable

_SINGULAR = 1e-13  # least eigenvalue of a correlation matrix that can be inverted with some digits left


@dataclass(frozen=True, eq=False)
class LogCoefficients:
    """Nondimensional coefficients that one log gave.

    Attributes:
        log: its name.
        names: (k,) such as "Cm_alpha".
        values: (k,) estimates.
        covariance: (k, k) of the estimates, positive definite.
        at: variable -> where the log was flown, SI: "V", "qbar", "alpha", "mass"; those that are known.
        scales: quantity ("airspeed", "mass", "Iyy", ...) -> (k,) change of the values per relative change of it.

    Raises:
        EstimationError: shapes do not agree, a value is not finite, or the covariance is not positive definite.

    Example:
        >>> import numpy as np
        >>> import testbench as tb
        >>> log = tb.LogCoefficients("day 1", ("Cm_q",), np.array([-12.0]), np.array([[0.25]]), {"V": 14.0})
        >>> log.names, log.at["V"]
        (('Cm_q',), 14.0)
    """

    log: str
    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    at: Mapping[str, float]
    scales: Mapping[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        y, P, k = np.array(self.values, float), np.array(self.covariance, float), len(self.names)
        if y.shape != (k,) or P.shape != (k, k) or len(set(self.names)) != k:
            raise EstimationError(
                f"log '{self.log}' must have one value and one row of the covariance per coefficient, each name once, "
                f"got {k} names, values {y.shape}, covariance {P.shape}"
            )
        size = np.sqrt(np.maximum(np.diag(P), 0.0))
        if not (np.all(np.isfinite(y)) and np.all(np.isfinite(P)) and np.all(size > 0.0)):
            raise EstimationError(
                f"coefficients of log '{self.log}' must be finite with errors > 0, got {y.tolist()} with "
                f"errors {size.tolist()}"
            )
        if k and np.linalg.eigvalsh(P / np.outer(size, size))[0] < _SINGULAR:
            raise EstimationError(
                f"the covariance of log '{self.log}' must be positive definite, but some of "
                f"{', '.join(self.names)} stand for one another; fix one of them in its estimator"
            )
        y.flags.writeable = P.flags.writeable = False
        object.__setattr__(self, "values", y)
        object.__setattr__(self, "covariance", P)

    @cached_property
    def information(self) -> FloatArray:
        """(k, k): the inverse of the covariance."""
        return inverse(self.covariance)


@dataclass(frozen=True, eq=False)
class Trend:
    """Which coefficients are linear in which variable, counted from a reference."""

    variable: str = ""  #: "V", "qbar" or "alpha"; "" if all are constant
    reference: float = 0.0  #: of the variable, SI
    names: tuple[str, ...] = ()  #: of the coefficients that have a slope


@dataclass(frozen=True, eq=False)
class Fit:
    """The result of generalised least squares."""

    #: (k,) coefficients; their values at the reference are the first k of ``b``, then come the slopes
    names: tuple[str, ...]
    trend: Trend  #: which of them have a slope
    b: FloatArray  #: (k + s,) estimates
    information: FloatArray  #: (k + s, k + s)
    residuals: tuple[FloatArray, ...]  #: per log, (k_i,): what its estimate lies above the fit
    #: chi2, dof: weighted sum of squares of the residuals, and its degrees of freedom
    chi2: float
    dof: int

    @property
    def covariance(self) -> FloatArray:
        """(k + s, k + s) of the estimates."""
        return inverse(self.information)


def all_names(logs: Sequence[LogCoefficients]) -> tuple[str, ...]:
    """Return the coefficients of all logs, in the order in which they come."""
    return tuple(dict.fromkeys(name for log in logs for name in log.names))


def alone(logs: Sequence[LogCoefficients], name: str) -> list[LogCoefficients]:
    """Return one coefficient of the logs that hold it, nothing being known of the others."""
    return [
        LogCoefficients(log.log, (name,), log.values[[i]], log.covariance[np.ix_([i], [i])], log.at)
        for log in logs
        if name in log.names
        for i in [log.names.index(name)]
    ]


def rows(log: LogCoefficients, names: Sequence[str], trend: Trend) -> FloatArray:
    """Return H (k_i, k + s) of a log."""
    out = np.zeros((len(log.names), len(names) + len(trend.names)))
    for i, name in enumerate(log.names):
        out[i, names.index(name)] = 1.0
        if name in trend.names:
            out[i, len(names) + trend.names.index(name)] = log.at[trend.variable] - trend.reference
    return out


def fit(logs: Sequence[LogCoefficients], trend: Trend = Trend(), extra: Sequence[FloatArray] | None = None) -> Fit:
    """Return the coefficients of all logs together.

    Args:
        logs: at least one.
        trend: which coefficients have a slope.
        extra: per log, (k_i, k_i) that is added to its covariance.

    Raises:
        EstimationError: the logs do not decide a slope.
    """
    names = all_names(logs)
    size = len(names) + len(trend.names)
    M, right, weights = np.zeros((size, size)), np.zeros(size), []
    for i, log in enumerate(logs):
        W = log.information if extra is None else inverse(log.covariance + extra[i])
        H = rows(log, names, trend)
        M += H.T @ W @ H
        right += H.T @ W @ log.values
        weights.append((W, H))
    b = solve(M, right)
    left = tuple(log.values - H @ b for log, (_, H) in zip(logs, weights, strict=True))
    chi2 = float(sum(r @ W @ r for r, (W, _) in zip(left, weights, strict=True)))
    return Fit(names, trend, b, M, left, chi2, sum(len(log.names) for log in logs) - size)


def solve(M: FloatArray, right: FloatArray) -> FloatArray:
    """Return M^-1 right of a symmetric positive definite matrix, scaled to a diagonal of ones first.

    Raises:
        EstimationError: M is not positive definite.
    """
    size = np.sqrt(np.maximum(np.diag(M), 0.0))
    if not np.all(size > 0.0) or np.linalg.eigvalsh(M / np.outer(size, size))[0] < _SINGULAR:
        raise EstimationError(
            "the logs must decide every slope: three of them at different conditions for each; take trend = 'none'"
        )
    scaled = right / (size if right.ndim == 1 else size[:, None])
    out = cho_solve(cho_factor(M / np.outer(size, size)), scaled)
    return np.asarray(out / (size if right.ndim == 1 else size[:, None]))


def inverse(M: FloatArray) -> FloatArray:
    """Return the inverse of a symmetric positive definite matrix, symmetric again."""
    if not len(M):
        return M
    out = solve(M, np.eye(len(M)))
    return np.asarray(0.5 * (out + out.T))


# --- which coefficients change with the flight condition --------------------------------------------------------------


VARIABLES = ("V", "qbar", "alpha")
_APART = 0.1  # two conditions are two if they differ by this share of the range of all
_RANGES = {"V": 0.05, "qbar": 0.1, "alpha": 0.0}  # least range of a variable, as a share of its largest value
_RANGE_ALPHA = 0.01  # rad; alpha may be about zero
_TRUSTED = 0.05  # probability of the scatter about all slopes above which the errors of the logs are taken as they are
_LEAST = 3  # conditions that a line needs for one to be left over that it is judged by


def best_trend(logs: Sequence[LogCoefficients], asked: TrendVariable, level: float) -> Fit:
    """Return the fit with the slopes that the logs show.

    Forward: the slope that lowers chi-square most comes next, as long as chi-square with one degree of freedom says
    that chance would not do so. That trusts the errors of the logs. Where the logs scatter more than their errors even
    about all slopes, the slope of a coefficient must also pass an F test against the scatter of that coefficient
    alone. The level is divided by the number of slopes still left to try and by the number of variables (S. Holm,
    Scandinavian Journal of Statistics 6, 1979), so that of sets of logs without trends at most that share shows one.
    Of several variables that with the least chi-square + 2 x slopes is taken (H. Akaike, IEEE Transactions on
    Automatic Control 19(6), 1974; the errors are known).

    Raises:
        EstimationError: the variable that is asked for is not known of every log.
    """
    flat = fit(logs)
    if asked == "none":
        return flat
    wanted = VARIABLES if asked == "auto" else (asked,)
    known = [v for v in wanted if all(v in log.at for log in logs)]
    if asked != "auto" and not known:
        lacking = ", ".join(log.log for log in logs if asked not in log.at)
        raise EstimationError(f"a trend with {asked} needs it of every log, but it is not known of {lacking}")
    tried = [_forward(logs, flat, v, level / len(known)) for v in known]
    return min([flat, *tried], key=lambda found: found.chi2 + 2.0 * len(found.trend.names))


def _forward(logs: Sequence[LogCoefficients], flat: Fit, variable: str, level: float) -> Fit:
    reference = sum(log.at[variable] for log in logs) / len(logs)
    left = [name for name in all_names(logs) if _conditions(logs, name, variable) >= _LEAST]
    if not left:
        return flat
    full = fit(logs, Trend(variable, reference, tuple(left)))
    trusted = float(chi_square.sf(full.chi2, full.dof)) > _TRUSTED
    own = {} if trusted else {name: _chance_by_scatter(logs, name, variable, reference) for name in left}
    found = flat
    while left:
        tried = [fit(logs, Trend(variable, reference, (*found.trend.names, name))) for name in left]
        best = min(tried, key=lambda t: t.chi2)
        gain = max(found.chi2 - best.chi2, 0.0)
        chance = max(float(chi_square.sf(gain, 1)), own.get(best.trend.names[-1], 0.0))
        if chance * len(left) >= level:
            break
        found = best
        left.remove(best.trend.names[-1])
    return found


def _chance_by_scatter(logs: Sequence[LogCoefficients], name: str, variable: str, reference: float) -> float:
    """Return the probability that scatter of one coefficient about a constant looks as much like a slope (F test)."""
    own = alone(logs, name)
    flat, line = fit(own), fit(own, Trend(variable, reference, (name,)))
    if line.chi2 <= 0.0:
        return 0.0
    return float(f_distribution.sf((flat.chi2 - line.chi2) / (line.chi2 / line.dof), 1, line.dof))


def _conditions(logs: Sequence[LogCoefficients], name: str, variable: str) -> int:
    """Return at how many different values of the variable logs hold a coefficient."""
    x = sorted(log.at[variable] for log in logs if name in log.names)
    reach = x[-1] - x[0]
    if reach <= max(_RANGES[variable] * abs(x[-1]), _RANGE_ALPHA):
        return 1
    return 1 + sum(b - a > _APART * reach for a, b in pairwise(x))
