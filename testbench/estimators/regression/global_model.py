"""Global aerodynamic models: coefficients as functions of flow angles, rates and controls over many flights.

A function is a sum of terms: products of signals, and of hinges max(alpha - knot, 0) where it may bend; multivariate
orthogonal functions and their evidence choose them (J. A. Grauer, E. A. Morelli, "Generic Global Aerodynamic Model for
Aircraft", Journal of Aircraft 52(1), 2015; E. A. Morelli, "Global Nonlinear Aerodynamic Modeling Using Multivariate
Orthogonal Functions", Journal of Aircraft 32(2), 1995; V. Klein, E. A. Morelli, Aircraft System Identification, AIAA
2006, ch. 5).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from testbench.core.constants import DEG_RAD
from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.residuals import autoregression, coloured_information, corrected_covariance

Signals = Mapping[str, FloatArray]
"""Signal -> (n,) samples; flow angles and deflections in rad, rates and speeds nondimensional."""
AT_ZERO = ("beta", "de", "da", "dr")
"""Signals whose size a coefficient may follow."""
_BENDS = 12  # knots at most
_BESIDE = 0.02  # share of the samples that must lie on either side of a knot
_MIDDLE = (0.01, 0.99)  # quantiles between which a signal counts as flown
_FLOWN = 0.98  # share of the samples of a band of alpha that its ellipsoid holds
BAND_RAD = 2.0 * DEG_RAD
"""Width of the bands of alpha that a domain is made of."""
_LEAST, _LEAST_RATE = 1e-3, 1e-5  # half range of a signal that rests: rad or V_rel, and a nondimensional rate


# --- terms ------------------------------------------------------------------------------------------------------------


BIAS = "1"
"""Name of the constant term."""


def factors(term: str) -> tuple[tuple[str, int], ...]:
    """Return a term, as "alpha", "alpha^2" or "alpha*q_hat", as (signal, power) pairs; the constant "1" has none."""
    if term == BIAS:
        return ()
    parts = (part.partition("^") for part in term.split("*"))
    return tuple((name, int(power or 1)) for name, _, power in parts)


def polynomial_terms(signals: Sequence[str], order: int) -> tuple[str, ...]:
    """Return all products of ``signals`` of degree 1 to ``order``, lowest degree first."""
    out = []
    for degree in range(1, order + 1):
        for chosen in combinations_with_replacement(range(len(signals)), degree):
            counts = {i: chosen.count(i) for i in chosen}
            out.append("*".join(signals[i] + (f"^{c}" if c > 1 else "") for i, c in counts.items()))
    return tuple(out)


def knots(flights: Sequence[Signals], signals: Sequence[str]) -> dict[str, tuple[str, float]]:
    """Return the hinges that flights allow: name -> (signal, knot, rad).

    Alpha may bend at whole degrees that have flights on either side; sideslip and deflections at zero, as what follows
    their size does.
    """
    low, high = np.quantile(np.concatenate([f["alpha"] for f in flights]), (_BESIDE, 1.0 - _BESIDE)) / DEG_RAD
    step = max(1, int(np.ceil((high - low) / _BENDS)))
    at = np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step
    out = {f"alpha_over_{'m' if d < 0 else ''}{abs(d):.0f}deg": ("alpha", float(d) * DEG_RAD) for d in at}
    for s in signals:
        below = np.mean(np.concatenate([f[s] for f in flights]) < 0.0)
        if s in AT_ZERO and _BESIDE <= below <= 1.0 - _BESIDE:
            out[f"{s}_over_0deg"] = (s, 0.0)
    return out


def candidates(signals: Sequence[str], hinges: Mapping[str, tuple[str, float]]) -> tuple[str, ...]:
    """Return the terms that a function may have: products of two signals, cubes, hinges, and these times one signal."""
    bent = [f"{h}*{s}" for h, (of, _) in hinges.items() for s in signals if s != of and of == "alpha"]
    return (*polynomial_terms(signals, 2), *(f"{s}^3" for s in signals), *hinges, *bent)


def columns(signals: Signals, hinges: Mapping[str, tuple[str, float]], terms: Sequence[str]) -> FloatArray:
    """Return the terms as columns (n, len(terms))."""
    made = {**signals, **{name: np.maximum(signals[of] - knot, 0.0) for name, (of, knot) in hinges.items()}}
    out = np.ones((len(signals["alpha"]), len(terms)))
    for i, term in enumerate(terms):
        for name, power in factors(term):
            out[:, i] *= made[name] ** power
    return out


# --- which terms stay: multivariate orthogonal functions and evidence -------------------------------------------------


_SPAN = 1e-6  # a candidate with less than this share of its length outside the chosen terms is one of them
_DONE = 1e-24  # share of the target's energy that is rounding
_MOST = 60  # terms


def orthogonal_order(X: FloatArray, y: FloatArray) -> tuple[list[int], list[float]]:
    """Return candidates (columns of X) in the order in which they lower the fit error, and that error after each.

    Every candidate is orthogonalised by modified Gram-Schmidt to the functions p_j that are already chosen; the one
    that takes most from the fit error, (p_j'y)^2 / p_j'p_j, is next. Each function is one candidate less its part along
    those before, so that n functions span n candidates. (Morelli orthogonalises in a fixed order and ranks afterwards,
    so that a kept function may bring in other candidates.)

    Args:
        X: (n, m) candidates, less their parts along what is always there.
        y: (n,) target, likewise.

    Returns:
        Columns, and v'v before the first and after each of them.
    """
    length = np.linalg.norm(X, axis=0)
    P = X / np.where(length > 0.0, length, 1.0)
    rest, closed = y.copy(), length <= 0.0
    order: list[int] = []
    Q = np.empty((len(y), 0))
    errors = [float(rest @ rest)]
    while len(order) < min(X.shape[1], _MOST, len(y) // 2 - 1) and errors[-1] > _DONE * errors[0]:
        size = np.linalg.norm(P, axis=0)
        open_ = (size > _SPAN) & ~closed
        if not open_.any():
            break
        best = int(np.argmax(np.where(open_, (P.T @ rest) ** 2 / np.where(open_, size**2, 1.0), -1.0)))
        p = P[:, best] - Q @ (Q.T @ P[:, best])  # twice is enough for orthogonality to rounding
        p /= np.linalg.norm(p)
        rest = rest - p * float(p @ rest)
        P = P - np.outer(p, p @ P)
        Q = np.column_stack([Q, p])
        order.append(best)
        closed[best] = True
        errors.append(float(rest @ rest))
    return order, errors


def choose(parts: Sequence[tuple[FloatArray, FloatArray, FloatArray]]) -> list[int]:
    """Return which candidates stay, by evidence.

    With n of m candidates, v'v the fit error and N_e independent samples of the residuals, -2 log of the posterior
    probability of a set of terms is, by Laplace's approximation and with all numbers of terms equally probable before,

        N_e log v'v + n log N_e + 2 log (m over n)

    (G. Schwarz, Annals of Statistics 6, 1978; J. Chen and Z. Chen, Biometrika 95, 2008). The last term pays for the
    choice among many candidates, of which the best one looks good by chance. N_e = N / (S(0) / var v), S the spectrum
    of the residuals where all are taken: residuals at a high sample rate hang together, and N of them say less. The
    predicted squared error counts neither and needs a bound that somebody has to give.

    The best number of orthogonal functions is taken; then terms leave whose loss raises the evidence, the weakest
    first.

    Args:
        parts: of each record, what is always there (n_r, f), candidates (n_r, m) and target (n_r,).
    """
    F, X, y = (np.concatenate(x) for x in zip(*parts, strict=True))
    basis = np.linalg.qr(F / np.linalg.norm(F, axis=0))[0]
    length = np.linalg.norm(X, axis=0)
    for _ in range(2):
        X, y = X - basis @ (basis.T @ X), y - basis @ (basis.T @ y)
    X = np.where(np.linalg.norm(X, axis=0) > _SPAN * length, X, 0.0)
    N, m = X.shape
    order, errors = orthogonal_order(X, y)
    least = max(_DONE * errors[0], 1e-300)
    v = y - X[:, order] @ np.linalg.lstsq(X[:, order], y, rcond=None)[0]
    ends = np.cumsum([len(p[2]) for p in parts])[:-1]
    independent = _independent(np.split(v, ends)) if errors[-1] > least else float(N)

    def score(error: float, n: int) -> float:
        among = gammaln(m + 1) - gammaln(n + 1) - gammaln(m - n + 1)
        return float(independent * np.log(max(error, least)) + n * np.log(independent) + 2.0 * among)

    best = int(np.argmin([score(e, n) for n, e in enumerate(errors)]))
    chosen, now = order[:best], score(errors[best], best)
    while chosen:
        theta, inverse, error = least_squares(X[:, chosen], y)
        loss = theta**2 / np.diag(inverse)
        weakest = int(np.argmin(loss))
        without = score(error + float(loss[weakest]), len(chosen) - 1)
        if without > now:
            break
        chosen, now = chosen[:weakest] + chosen[weakest + 1 :], without
    return sorted(chosen)


def least_squares(X: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return the parameters (k,), (X'X)^-1 (k, k), and v'v."""
    size = np.linalg.norm(X, axis=0)
    U, s, Vt = np.linalg.svd(X / size, full_matrices=False)
    theta = Vt.T @ ((U.T @ y) / s)
    v = y - (X / size) @ theta
    theta = theta + Vt.T @ ((U.T @ v) / s)  # one step of refinement
    v = y - (X / size) @ theta
    return theta / size, (Vt.T / s**2) @ Vt / np.outer(size, size), float(v @ v)


def _independent(residuals: Sequence[FloatArray]) -> float:
    """Return the number of independent samples of residuals, N var v / S(0)."""
    model = autoregression([v[:, None] for v in residuals])
    gain = float(1.0 / max(1.0 - model.A.sum(), 1e-3))
    together = np.concatenate(residuals)
    return together.size / max(1.0, gain**2 * float(model.S[0, 0]) / float(np.mean(together**2)))


# --- the functions ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class CoefficientFunction:
    """One coefficient as a function of the signals."""

    name: str  #: of the coefficient
    terms: tuple[str, ...]  #: "1" first
    params: FloatArray  #: (k,)
    covariance: FloatArray  #: (k, k), of residuals that are correlated in time, and of what instruments may err by
    hinges: Mapping[str, tuple[str, float]]  #: name -> (signal, knot, rad)
    #: signal beside the function -> its multiple and standard error: what no aerodynamic coefficient follows
    apart: Mapping[str, tuple[float, float]]
    residual_rms: float  #: of the flights that it was fitted to
    span: float  #: range of the coefficient in those flights, between the quantiles 0.01 and 0.99
    #: the functions that the flights less one of them each give, their terms chosen anew
    others: tuple[CoefficientFunction, ...] = ()

    @property
    def std(self) -> FloatArray:
        """(k,) standard errors of the parameters."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def at(self, signals: Signals, less: Signals | None = None) -> tuple[FloatArray, FloatArray]:
        """Return values, or their differences from those at ``less``, and standard errors, (n,) each.

        The covariance of the parameters knows nothing of terms that were chosen wrongly or lack. What that does shows
        when a flight is left out and terms are chosen anew: with f_i so found and n flights, the variance is

            x' P x + (n - 1) / n sum_i (f_i - f)^2

        (the jackknife: M. H. Quenouille, Biometrika 43, 1956; J. W. Tukey, Annals of Mathematical Statistics 29, 1958).
        """
        X, value = self._contrast(signals, less)
        variance = np.sum((X @ self.covariance) * X, axis=1)
        n = len(self.others)
        for other in self.others:
            variance = variance + (n - 1) / n * (other._contrast(signals, less)[1] - value) ** 2
        return value, np.sqrt(np.maximum(variance, 0.0))

    def _contrast(self, signals: Signals, less: Signals | None) -> tuple[FloatArray, FloatArray]:
        X = columns(signals, self.hinges, self.terms)
        X = X if less is None else X - columns(less, self.hinges, self.terms)
        return X, X @ self.params

    def beside(self, signals: Signals) -> FloatArray:
        """Return what is in the coefficient as felt (n,) beside the function."""
        return np.asarray(sum((c * signals[n] for n, (c, _) in self.apart.items()), np.zeros(len(signals["alpha"]))))


def fit(
    name: str,
    flights: Sequence[Signals],
    signals: Sequence[str],
    hinges: Mapping[str, tuple[str, float]],
    apart: Sequence[str] = (),
) -> CoefficientFunction:
    """Choose the terms of a coefficient and fit them.

    Args:
        name: of the coefficient, a signal of every flight.
        flights: signals of each.
        signals: of which terms are made; "alpha" is one.
        hinges: see :func:`knots`.
        apart: signals that the coefficient as felt may follow though no aerodynamic one does; always there.

    Raises:
        EstimationError: the coefficient never moves.
    """
    terms = candidates(signals, hinges)
    if not np.ptp(np.concatenate([f[name] for f in flights])) > 0.0:
        raise EstimationError(f"'{name}' never moves in these flights: there is nothing to explain")
    parts = [(_always(f, apart), columns(f, hinges, terms), f[name]) for f in flights]

    def chosen(use: Sequence[int]) -> CoefficientFunction:
        own = (BIAS, *(terms[i] for i in choose([parts[k] for k in use])))
        return refit(name, [flights[k] for k in use], own, hinges, apart)

    every = range(len(flights))
    others = tuple(chosen([k for k in every if k != out]) for out in every) if len(flights) > 2 else ()
    return replace(chosen(every), others=others)


def refit(
    name: str,
    flights: Sequence[Signals],
    terms: Sequence[str],
    hinges: Mapping[str, tuple[str, float]],
    apart: Sequence[str] = (),
) -> CoefficientFunction:
    """Return the function with these terms by least squares, its errors corrected for coloured residuals.

    (X'X)^-1 [sum_i x(i) sum_j R(i - j) x(j)'] (X'X)^-1 with R the autocorrelation of the residuals (E. A. Morelli and
    V. Klein, Journal of Guidance, Control, and Dynamics 20(1), 1997).
    """
    X = [np.hstack([columns(f, hinges, terms), _always(f, apart)[:, 1:]]) for f in flights]
    y = np.concatenate([f[name] for f in flights])
    theta, plain, error = least_squares(np.vstack(X), y)
    variance = max(error / max(len(y) - theta.size, 1), 1e-300)
    left = [(f[name] - x @ theta)[:, None] for f, x in zip(flights, X, strict=True)]
    score = coloured_information([x[:, None, :] / variance for x in X], left)
    covariance, k = corrected_covariance(variance * plain, score), len(terms)
    beside = zip(apart, theta[k:].tolist(), np.sqrt(np.diag(covariance)[k:]).tolist(), strict=True)
    return CoefficientFunction(
        name, tuple(terms), theta[:k], covariance[:k, :k], dict(hinges), {n: (c, s) for n, c, s in beside},
        float(np.sqrt(error / len(y))), float(np.diff(np.quantile(y, _MIDDLE))[0]),
    )  # fmt: skip


def _always(signals: Signals, apart: Sequence[str]) -> FloatArray:
    return np.column_stack([np.ones(len(signals["alpha"])), *(signals[n] for n in apart)])


# --- where it holds ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class FlownDomain:
    """Where flights were: over alpha, the part of a box that an ellipsoid cuts out of it.

    The distance of a state is 1 at the edge and 0 in the middle: the largest of |x - middle| / half of each signal, of
    the root of their sum of squares over ``radius``, and beyond the flown alpha of 1 + what it is beyond, in bands.
    """

    alpha: FloatArray  #: (b,) where middle and half are given, rad; between them they are linear, beyond them constant
    signals: tuple[str, ...]  #: (k,) without alpha
    #: middle, half: (b, k) of the range of each signal
    middle: FloatArray
    half: FloatArray
    radius: FloatArray  #: (b,) of the ellipsoid, in half ranges
    #: low, high: flown alpha, rad
    low: float
    high: float

    @classmethod
    def of(cls, flights: Sequence[Signals], signals: Sequence[str]) -> FlownDomain:
        """Return the domain of flights over ``signals``."""
        names = tuple(s for s in signals if s != "alpha")
        alpha = np.concatenate([f["alpha"] for f in flights])
        x = np.stack([np.concatenate([f[s] for f in flights]) for s in names], axis=1)
        low, high = np.quantile(alpha, _MIDDLE)
        at = np.linspace(low, high, max(2, round((high - low) / BAND_RAD) + 1))
        least = [_LEAST_RATE if s.endswith("_hat") else _LEAST for s in names]
        middle, half, radius = np.empty((at.size, len(names))), np.empty((at.size, len(names))), np.empty(at.size)
        for i, a in enumerate(at):
            own = x[np.abs(alpha - a) <= max(0.5 * (high - low) / (at.size - 1), 1e-9)]
            ends = np.quantile(own if len(own) else x, _MIDDLE, axis=0)
            middle[i], half[i] = ends.mean(axis=0), np.maximum(0.5 * np.diff(ends, axis=0)[0], least)
            away = np.sqrt(np.sum(((own - middle[i]) / half[i]) ** 2, axis=1))
            radius[i] = max(1.0, float(np.quantile(away, _FLOWN))) if len(own) else 1.0
        return cls(at, names, middle, half, radius, float(low), float(high))

    def distance(self, signals: Signals) -> FloatArray:
        """Return how far states are from the middle of the domain, (n,), 1 at its edge."""
        a = signals["alpha"]
        z = np.stack(
            [
                (signals[s] - np.interp(a, self.alpha, self.middle[:, i])) / np.interp(a, self.alpha, self.half[:, i])
                for i, s in enumerate(self.signals)
            ]
        )
        round_ = np.sqrt(np.sum(z**2, axis=0)) / np.interp(a, self.alpha, self.radius)
        beyond = np.maximum(self.low - a, a - self.high) / BAND_RAD
        ends = np.where(beyond > 0.0, 1.0 + beyond, 0.0)
        return np.asarray(np.maximum.reduce([np.abs(z).max(axis=0), round_, ends]))

    def inside(self, signals: Signals) -> NDArray[np.bool_]:
        """Return (n,) whether states are in the domain."""
        return self.distance(signals) <= 1.0


@dataclass(frozen=True, eq=False)
class GlobalModel:
    """All coefficients of an aircraft over the flown domain."""

    functions: Mapping[str, CoefficientFunction]  #: coefficient -> its function
    domain: FlownDomain  #: where they hold

    def at(self, signals: Signals) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Return coefficient -> values and standard errors, (n,) each; NaN outside of the flown domain."""
        inside = self.domain.inside(signals)
        found = {name: f.at(signals) for name, f in self.functions.items()}
        return {n: (np.where(inside, v, np.nan), np.where(inside, s, np.nan)) for n, (v, s) in found.items()}
