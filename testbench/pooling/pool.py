"""Several logs into one set of coefficients: pooled, judged for agreement, and joined with a prior.

Logs that disagree by more than their errors: by how much, which one, and what would explain it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2 as chi_square

from testbench.core.blas import on_one_thread
from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.pooling import TrendVariable
from testbench.pooling.least_squares import Fit, LogCoefficients, Trend, alone, best_trend, fit, inverse, rows, solve
from testbench.pooling.prior import Prior
from testbench.pooling.scales import shared_errors

# --- logs that disagree by more than their errors ---------------------------------------------------------------------


_RATES = ("_p", "_q", "_r")
_SIZES = (0.01, 0.02, 0.05, 0.1, 0.2)  # relative deviations from log to log that a cause is tried with
_HALVINGS = 40


@dataclass(frozen=True)
class Cause:
    """One quantity whose errors from log to log would explain a disagreement."""

    what: str  #: in words
    size: float  #: relative standard deviation, log to log, with which the logs agree
    deviations: Mapping[str, float]  #: log -> relative error of the quantity, as the coefficients show it


@dataclass(frozen=True)
class Disagreement:
    """What is known of a disagreement."""

    between: Mapping[str, float]  #: coefficient -> standard deviation from log to log beyond the logs' own errors
    outlying: str  #: the one log without which the others agree; "" if there is no such
    causes: tuple[Cause, ...]  #: quantities of which an error would explain it


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


# --- several logs into one set of coefficients ------------------------------------------------------------------------


class PoolCriteria(NamedTuple):
    """What decides; derived from the false alarms that are admitted, but for the last, which is judged."""

    trend: float = 0.01  #: share of sets of logs without a trend that show one
    agree: float = 0.01  #: share of sets of logs that agree but are said not to
    #: standard deviations of their difference between data and prior from which they contradict each other
    conflict: float = 3.0


CRITERIA = PoolCriteria()


@dataclass(frozen=True)
class PooledCoefficient:
    """One coefficient of all logs, at the reference of its trend."""

    name: str  #: such as "Cm_alpha"
    logs: int  #: how many hold it
    #: value, std: what the data say, and its standard error, with ``between`` and the factor for scatter in it
    value: float
    std: float
    own_std: float  #: standard error by the logs' own errors alone
    between: float  #: standard deviation from log to log beyond the logs' own errors; 0 where these explain the scatter
    #: slope, slope_std: per unit of the trend's variable, SI; None if it is constant
    slope: float | None
    slope_std: float | None
    #: prior, prior_std: believed before; None without
    prior: float | None
    prior_std: float | None
    #: posterior, posterior_std: data and prior together; the data alone without a prior
    posterior: float
    posterior_std: float
    #: posterior_slope, posterior_slope_std: the same of the slope
    posterior_slope: float | None
    posterior_slope_std: float | None
    #: quantity -> part of ``std`` by the error of airspeed, mass or inertia that all logs share
    shared: Mapping[str, float] = field(default_factory=dict)

    @property
    def shared_std(self) -> float:
        """Part of ``std`` that errors of airspeed, mass and inertia make, root of the sum of squares."""
        return math.sqrt(sum(v**2 for v in self.shared.values()))

    @property
    def mostly(self) -> str:
        """The quantity whose error makes more than half of the variance of the data; "" if none does."""
        most = max(self.shared, key=self.shared.__getitem__, default="")
        return most if most and self.shared[most] ** 2 > 0.5 * self.std**2 else ""

    @property
    def added(self) -> float | None:
        """Share of what is known that the data added: 1 - (posterior variance)/(prior variance)."""
        return None if self.prior_std is None else 1.0 - (self.posterior_std / self.prior_std) ** 2

    @property
    def bits(self) -> float | None:
        """The same in bits: log2 of the factor by which the data narrowed the error."""
        return None if self.prior_std is None else math.log2(self.prior_std / self.posterior_std)

    @property
    def distance(self) -> float | None:
        """Data minus prior, in standard deviations of that difference."""
        if self.prior is None or self.prior_std is None:
            return None
        return (self.value - self.prior) / math.hypot(self.std, self.prior_std)

    @property
    def in_conflict(self) -> bool:
        """Whether data and prior contradict each other."""
        return self.distance is not None and abs(self.distance) > CRITERIA.conflict


@dataclass(frozen=True, eq=False)
class Pooled:
    """Several logs together.

    Attributes:
        logs: what each of them gave.
        coefficients: one entry per coefficient.
        trend: which coefficients have a slope, in what.
        chi2, dof: of the logs about the pooled coefficients, by their own errors; dof is 0 for one log.
        disagreement: None if the logs agree within their errors.
        factor: by which all errors were multiplied because deviations from log to log of single coefficients do not
            explain the scatter; 1 else. R. T. Birge, Physical Review 40, 1932.
        prior: what was believed before; None without.
        covariance: (k + s, k + s) of the posterior: coefficients at the reference, then slopes.
        scale_uncertainty: quantity -> relative standard deviation whose effect is in the errors; empty if none stated.
    """

    logs: tuple[LogCoefficients, ...]
    coefficients: tuple[PooledCoefficient, ...]
    trend: Trend
    chi2: float
    dof: int
    disagreement: Disagreement | None
    factor: float
    prior: Prior | None
    covariance: FloatArray
    scale_uncertainty: Mapping[str, float] = field(default_factory=dict)

    @property
    def chance(self) -> float:
        """Probability that logs that agree scatter as much as these."""
        return float(chi_square.sf(self.chi2, self.dof)) if self.dof else 1.0

    @property
    def agree(self) -> bool:
        """Whether the logs agree within their errors."""
        return self.disagreement is None

    @property
    def in_conflict(self) -> tuple[PooledCoefficient, ...]:
        """Coefficients of which data and prior contradict each other."""
        return tuple(c for c in self.coefficients if c.in_conflict)

    def coefficient(self, name: str) -> PooledCoefficient:
        """Return one coefficient.

        Raises:
            KeyError: no log holds it.
        """
        found = next((c for c in self.coefficients if c.name == name), None)
        if found is None:
            raise KeyError(f"{name}: must be one of {', '.join(c.name for c in self.coefficients)}")
        return found

    def at(self, name: str, x: float) -> tuple[float, float]:
        """Return value and standard error of a coefficient, posterior, where the trend's variable is ``x`` (SI)."""
        c = self.coefficient(name)
        if c.posterior_slope is None:
            return c.posterior, c.posterior_std
        names = [c.name for c in self.coefficients]
        row = np.zeros(len(self.covariance))
        away = x - self.trend.reference
        row[names.index(name)], row[len(names) + self.trend.names.index(name)] = 1.0, away
        return c.posterior + c.posterior_slope * away, float(np.sqrt(row @ self.covariance @ row))

    def written(self) -> dict[str, Any]:
        """Return what a later pooling takes as its prior, as JSON values."""
        k = len(self.coefficients)
        return {
            "coefficients": {c.name: c.posterior for c in self.coefficients},
            "covariance": self.covariance[:k, :k].tolist(),
            "slopes": {name: self.coefficient(name).posterior_slope for name in self.trend.names},
            "covariance_with_slopes": self.covariance.tolist(),
            "trend": {"variable": self.trend.variable, "reference": self.trend.reference},
            "logs": [log.log for log in self.logs],
            "scale_uncertainty": dict(self.scale_uncertainty),
            "chi2": self.chi2,
            "dof": self.dof,
        }


@on_one_thread
def pool(
    logs: Sequence[LogCoefficients],
    prior: Prior | None = None,
    trend: TrendVariable = "auto",
    scale_uncertainty: Mapping[str, float] = MappingProxyType({}),
) -> Pooled:
    """Return several logs as one set of coefficients, with trend, agreement, and what the data added to a prior.

    The information matrices of the logs are added (:func:`fit`), slopes are kept where the logs show them
    (:func:`best_trend`). If chi-square of the logs about the result is one that logs that agree exceed in 1 % only,
    what is missing is added to the errors: to every coefficient its standard deviation from log to log, and if that is
    not enough a common factor. A prior is one more information matrix, on the coefficients at the reference.

    Args:
        logs: at least one.
        prior: of some of the coefficients, or of others too.
        trend: variable of slopes: "V", "qbar", "alpha"; the best of them ("auto"), or "none".
        scale_uncertainty: quantity of ``LogCoefficients.scales`` -> relative standard deviation of the error that all
            logs share in it; propagated to first order (:mod:`testbench.pooling.scales`).

    Raises:
        EstimationError: no log, or no coefficient in them; a variable that is not known of every log.

    Example:
        >>> import numpy as np
        >>> import testbench as tb
        >>> logs = [
        ...     tb.LogCoefficients("slow", ("Cm_alpha",), np.array([-0.70]), np.array([[0.02**2]]), {"V": 12.0}),
        ...     tb.LogCoefficients("fast", ("Cm_alpha",), np.array([-0.74]), np.array([[0.02**2]]), {"V": 18.0}),
        ... ]
        >>> prior = tb.Prior(("Cm_alpha",), np.array([-0.60]), np.array([[0.12**2]]), "handbook")
        >>> found = tb.pool(logs, prior).coefficient("Cm_alpha")
        >>> f"{found.value:.3f} +- {found.std:.3f}, with the prior {found.posterior:.3f} +- {found.posterior_std:.3f}"
        '-0.720 +- 0.014, with the prior -0.718 +- 0.014'
        >>> f"the data added {found.added:.0%}, {found.bits:.1f} bits"
        'the data added 99%, 3.1 bits'
    """
    if not any(log.names for log in logs):
        raise EstimationError("pooling needs a coefficient of at least one log, got none")
    own = best_trend(logs, trend, CRITERIA.trend)
    apart, found, factor, extra = None, own, 1.0, None
    if own.dof and chi_square.sf(own.chi2, own.dof) < CRITERIA.agree:
        apart = disagreement(logs, own, trend, CRITERIA.agree, CRITERIA.trend)
        extra = added(logs, apart.between)
        found = fit(logs, own.trend, extra)
        if chi_square.sf(found.chi2, found.dof) < CRITERIA.agree:
            factor = math.sqrt(found.chi2 / found.dof)
    shared = shared_errors(logs, found, extra, scale_uncertainty)
    information = found.information / factor**2
    if shared:
        information = inverse(inverse(information) + sum(np.outer(v, v) for v in shared.values()))
    b, M = _with_prior(found, information, prior)
    between: Mapping[str, float] = apart.between if apart is not None else {}
    own_std, std, post_std = (np.sqrt(np.diag(C)) for C in (own.covariance, inverse(information), inverse(M)))
    coefficients = []
    for i, name in enumerate(found.names):
        s = len(found.names) + found.trend.names.index(name) if name in found.trend.names else None
        believed = prior.of([name]) if prior is not None and name in prior.names else None
        coefficients.append(
            PooledCoefficient(
                name,
                sum(name in log.names for log in logs),
                float(found.b[i]),
                float(std[i]),
                float(own_std[i]),
                between.get(name, 0.0),
                None if s is None else float(found.b[s]),
                None if s is None else float(std[s]),
                None if believed is None else float(believed.values[0]),
                None if believed is None else float(believed.covariance[0, 0]) ** 0.5,
                float(b[i]),
                float(post_std[i]),
                None if s is None else float(b[s]),
                None if s is None else float(post_std[s]),
                {quantity: abs(float(v[i])) for quantity, v in shared.items()},
            )
        )
    return Pooled(
        tuple(logs),
        tuple(coefficients),
        own.trend,
        own.chi2,
        own.dof,
        apart,
        factor,
        prior,
        inverse(M),
        dict(scale_uncertainty),
    )


def _with_prior(found: Fit, information: FloatArray, prior: Prior | None) -> tuple[FloatArray, FloatArray]:
    """Return estimates and information of data and prior together."""
    if prior is None:
        return found.b, information
    M, right = information.copy(), information @ found.b
    known = [name for name in prior.names if name in found.names]
    at = [found.names.index(name) for name in known]
    W = inverse(prior.of(known).covariance)
    M[np.ix_(at, at)] += W
    right[at] += W @ prior.of(known).values
    return solve(M, right), M
