"""Generalised least squares of the coefficients of several logs, each constant or linear in one variable.

    y_i = H_i b + e_i,    e_i ~ N(0, P_i),    b^ = (sum H_i' P_i^-1 H_i)^-1 sum H_i' P_i^-1 y_i

with y_i the coefficients of log i and P_i their whole covariance; b holds every coefficient at the reference and, for
those with a trend, its slope. A log that lacks a coefficient has no row of it. A. C. Aitken, Proc. Royal Society of
Edinburgh 55, 1936.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray

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
    """Which coefficients are linear in which variable, counted from a reference.

    Attributes:
        variable: "V", "qbar" or "alpha"; "" if all are constant.
        reference: of the variable, SI.
        names: of the coefficients that have a slope.
    """

    variable: str = ""
    reference: float = 0.0
    names: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Fit:
    """The result of generalised least squares.

    Attributes:
        names: (k,) coefficients; their values at the reference are the first k of ``b``, then come the slopes.
        trend: which of them have a slope.
        b: (k + s,) estimates.
        information: (k + s, k + s).
        residuals: per log, (k_i,): what its estimate lies above the fit.
        chi2, dof: weighted sum of squares of the residuals, and its degrees of freedom.
    """

    names: tuple[str, ...]
    trend: Trend
    b: FloatArray
    information: FloatArray
    residuals: tuple[FloatArray, ...]
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


def fit(
    logs: Sequence[LogCoefficients],
    trend: Trend = Trend(),
    extra: Sequence[FloatArray] | None = None,
) -> Fit:
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
