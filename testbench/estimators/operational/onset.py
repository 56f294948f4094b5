"""The onset of flutter from modes found at rising speeds, all of them below it, as a posterior.

Two modes in quasi-steady flow, det(s^2 + s (C0 + V C1) + K0 + V^2 K2) = s^4 + A1 s^3 + A2 s^2 + A3 s + A4, have
coefficients A_j that are polynomials of degree j in V. Routh's criterion holds, all A_j > 0 and the flutter margin

    F = A2 (A3 / A1) - (A3 / A1)^2 - A4 > 0,

up to the onset (N. H. Zimmerman and J. T. Weissenburger, Journal of Aircraft 1(4), 1964; for more modes S. J. Price and
B. H. K. Lee, 30(3), 1993). The measured poles, each with its error, give the polynomials by Gauss-Newton steps from
their priors; a pole that was not found at a speed is left out there. Damping alone may rise until shortly before the
onset; frequencies that approach each other, and F, tell it from far below. The terms that quasi-steady flow has not,
small in the prior, stand for the lag of real flow. Each pair of neighbouring modes has its own margin, and the onset is
the least of them. Divergence of a pole that does not oscillate is not seen by this, nor a mode that no sensor feels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.model import ComplexArray
from testbench.estimators.operational.realise import mac
from testbench.estimators.operational.result import Criteria, OperationalMode, OperationalModes

ORDER = 24
CRITERIA = Criteria(frequency=0.02, frequency_error=0.1, damping_error=0.5, least_orders=3)
"""Of modes that an onset is sought from: their errors enter the posterior, so that heavily damped ones may stay."""
RISK, STEP = 0.01, 0.1
"""Probability of an onset at or below the speed that is cleared, and the largest step as a part of the speed."""
CLEARANCE = "models/clearance.json"
"""Where the folder of a result keeps what was cleared, for the cards of the next flight."""
_FARTHEST = 0.6  # |ln(s / s')| + 1 - MAC from which on a mode is another one
_SPLIT = 0.2  # the same, within which two modes of one speed are one that was split
_PRIOR = (  # (mean, standard deviation) of the terms of A1 to A4 in V over the fastest one flown, poles over their mean
    ((0.06, 0.04), (0.4, 0.5), (0.0, 0.1)),
    ((2.0, 1.5), (0.0, 0.1), (0.0, 1.0), (0.0, 0.1)),
    ((0.06, 0.04), (0.4, 0.5), (0.0, 0.1), (0.0, 0.5)),
    ((1.0, 1.0), (0.0, 0.1), (0.0, 1.0), (0.0, 0.1), (0.0, 0.5)),
)
_ORDER = np.array([j for j, terms in enumerate(_PRIOR) for _ in terms])
_POWER = np.array([p for terms in _PRIOR for p in range(len(terms))])
_MEAN, _STD = (np.array([x[k] for terms in _PRIOR for x in terms]) for k in (0, 1))
_NOISE = 1.5  # errors of poles found over those that are stated
_FORM = 0.02  # of the onset that two modes in quasi-steady air have beside one in air that lags; from wings of draw A
_STEPS = 30
_DRAWS = 2000
_LEAST = 20  # draws that are stable at every speed flown, for a posterior
_BEYOND = 2.0  # speeds over the fastest flown up to which the onset is looked for
_STRIDE = 0.01


@dataclass(frozen=True, eq=False)
class Onset:
    """The posterior of the flutter onset."""

    V_m_s: FloatArray  # (k,) speeds flown, rising. The aircraft was stable at all of them.
    # each mode through the speeds, None where it was not found; by their first frequency
    tracks: tuple[tuple[OperationalMode | None, ...], ...]
    pairs: tuple[tuple[int, int], ...]  # numbers of the two tracks of each margin
    # (draws,) onset, beyond the fastest speed flown; infinite where it lies beyond twice that speed
    draws_m_s: FloatArray

    def risk(self, V_m_s: float) -> float:
        """Return the probability that the onset lies at or below a speed."""
        return float(np.mean(self.draws_m_s <= V_m_s))

    def quantile(self, probability: float) -> float:
        """Return the speed below which the onset lies with a probability; infinite where that is not told."""
        return float(np.sort(self.draws_m_s)[int(probability * len(self.draws_m_s))])

    def cleared(self, risk: float = RISK, step: float = STEP) -> float:
        """Return the highest speed at which the risk is at most ``risk``, no more than a part ``step`` faster.

        It is the fastest speed flown where nothing beyond is cleared.
        """
        top = float(self.V_m_s[-1])
        return max(min(self.quantile(risk), (1.0 + step) * top), top)


def onset(V_m_s: Sequence[float], found: Sequence[OperationalModes | None], seed: int = 0) -> Onset:
    """Return the onset that modes found at several speeds point to.

    Args:
        V_m_s: (k,) airspeeds at one height, rising.
        found: modes at each speed, of the same channels; None where none were found.
        seed: of the draws of the posterior.

    Raises:
        EstimationError: fewer than two speeds, speeds that do not rise, or fewer than two modes seen at two speeds.
    """
    V = np.asarray(V_m_s, float)
    if len(V) < 2 or np.any(np.diff(V) <= 0.0):
        raise EstimationError(
            f"the onset takes records at two speeds or more, rising, got {', '.join(f'{v:g}' for v in V)} m/s"
        )
    tracks = tracked(found)
    pairs = [(i, j) for i, j in combinations(range(len(tracks)), 2) if j - i <= 2]
    if not pairs:
        raise EstimationError(
            f"flutter takes two modes, each found at two speeds; got {len(tracks)}: give longer records, a wider band, "
            "or sensors that measure both bending and torsion"
        )
    rng = np.random.default_rng(seed)
    draws = np.full(_DRAWS, np.inf)
    for i, j in pairs:
        draws = np.minimum(draws, _pair_onset(V, list(zip(tracks[i], tracks[j], strict=True)), rng))
    draws = np.maximum(draws * np.exp(_FORM * rng.standard_normal(_DRAWS)), 1.0)
    return Onset(V, tuple(tracks), tuple(pairs), draws * V[-1])


def tracked(found: Sequence[OperationalModes | None]) -> list[tuple[OperationalMode | None, ...]]:
    """Return the modes that were found at two speeds or more, each through all speeds, by their first frequency.

    A mode is that of the last speed at which it was seen that is nearest in |ln(s / s')| + 1 - MAC, one to one.
    """
    tracks: list[list[OperationalMode | None]] = []
    for k, result in enumerate(found):
        modes = _single(result.modes) if result is not None else ()
        last = [next(m for m in reversed(t) if m is not None) for t in tracks]
        cost = np.full((len(modes), len(last) + len(modes)), _FARTHEST)
        for a, mode in enumerate(modes):
            for b, other in enumerate(last):
                likeness = mac(mode.scaled_shape, other.scaled_shape)
                cost[a, b] = abs(np.log(mode.pole / other.pole)) + 1.0 - likeness
        taken = {int(b): int(a) for a, b in zip(*linear_sum_assignment(cost), strict=True) if cost[a, b] < _FARTHEST}
        for b, track in enumerate(tracks):
            track.append(modes[taken[b]] if b in taken else None)
        tracks += [[*[None] * k, m] for a, m in enumerate(modes) if a not in taken.values()]
    seen = [tuple(t) for t in tracks if sum(m is not None for m in t) > 1]
    return sorted(seen, key=lambda t: next(m.frequency_hz for m in t if m is not None))


def _single(modes: Sequence[OperationalMode]) -> list[OperationalMode]:
    """Return the modes without those that another one, stable at more orders, was split from."""
    kept: list[OperationalMode] = []
    for mode in sorted(modes, key=lambda m: -len(m.orders)):
        if all(abs(np.log(mode.pole / m.pole)) + 1.0 - mac(mode.scaled_shape, m.scaled_shape) > _SPLIT for m in kept):
            kept.append(mode)
    return sorted(kept, key=lambda m: m.frequency_hz)


def _pair_onset(
    V: FloatArray, pair: Sequence[tuple[OperationalMode | None, OperationalMode | None]], rng: np.random.Generator
) -> FloatArray:
    """Return draws of the onset of two modes over the fastest speed flown, of those that are stable up to there."""
    poles = [m.pole for both in pair for m in both if m is not None]
    scale = float(np.exp(np.mean(np.log(np.abs(poles)))))
    v = V / V[-1]
    seen = [(k, m) for k, both in enumerate(pair) for m in both if m is not None]
    weights = [np.linalg.inv(_covariance(m, scale)) / _NOISE**2 for _, m in seen]
    c, P = _fitted(v, np.array([k for k, _ in seen]), np.array([m.pole / scale for _, m in seen]), np.array(weights))
    ahead = np.arange(1.0 + _STRIDE, _BEYOND, _STRIDE)
    stable = _stable(rng.multivariate_normal(c, P, _DRAWS, method="cholesky"), np.concatenate([v, ahead]))
    unstable = ~stable[stable[:, : len(v)].all(axis=1), len(v) :]
    if len(unstable) < _LEAST:
        return np.ones(
            _DRAWS
        )  # two modes as these would not have been stable where they were flown: nothing is cleared
    return np.asarray(
        rng.choice(np.where(unstable.any(axis=1), ahead[unstable.argmax(axis=1)] - _STRIDE, np.inf), _DRAWS)
    )


def _covariance(mode: OperationalMode, scale: float) -> FloatArray:
    """Return the covariance (2, 2) of real and imaginary part of a pole over ``scale``."""
    s = mode.pole / scale
    wn, zeta = abs(s), mode.damping
    by = np.array([[s.real / wn, s.imag / wn], [-wn, -wn * zeta / np.sqrt(1.0 - zeta**2)]]).T
    std = np.array([2.0 * np.pi * mode.frequency_std_hz / scale, mode.damping_std])
    own = np.outer(std, std) * np.array([[1.0, mode.correlation], [mode.correlation, 1.0]])
    return np.asarray(by @ own @ by.T + 1e-8 * wn**2 * np.eye(2))


def _coefficients(c: FloatArray, v: FloatArray) -> FloatArray:
    """Return A1 to A4 (..., speeds, 4) of terms (..., 14)."""
    powers = v[:, None] ** _POWER
    return np.stack([c[..., j == _ORDER] @ powers[:, j == _ORDER].T for j in range(4)], axis=-1)


def _stable(c: FloatArray, v: FloatArray) -> NDArray[np.bool_]:
    """Return whether (draws, speeds) Routh's criterion holds."""
    A1, A2, A3, A4 = np.moveaxis(_coefficients(c, v), -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        margin = A2 * (A3 / A1) - (A3 / A1) ** 2 - A4
    return np.asarray((A1 > 0.0) & (A2 > 0.0) & (A3 > 0.0) & (A4 > 0.0) & (margin > 0.0))


def _fitted(
    v: FloatArray, k: NDArray[np.intp], measured: ComplexArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the terms (14,) and their covariance, by Gauss-Newton steps with their prior.

    Args:
        v: speeds over the fastest.
        k: (poles,) number of the speed of each measured pole.
        measured: (poles,) scaled.
        weights: (poles, 2, 2) inverse covariances of their real and imaginary parts.
    """
    prior = np.diag(_STD**-2.0)

    def linear(c: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """Return cost, residuals (poles, 2) and their slopes (poles, 2, 14)."""
        A = np.concatenate([np.ones((len(v), 1)), _coefficients(c, v)], axis=1)
        roots = _upper(A)
        s = np.empty(len(k), complex)
        for number in range(len(v)):
            mine = np.flatnonzero(k == number)
            cost = np.abs(measured[mine, None] - roots[number])
            rows, columns = linear_sum_assignment(cost)
            s[mine[rows]] = roots[number, columns]
        slope = 4.0 * s**3 + 3.0 * A[k, 1] * s**2 + 2.0 * A[k, 2] * s + A[k, 3]
        slope = np.where(np.abs(slope) < 1e-3, 1e-3, slope)
        by = -(s[:, None] ** (3 - _ORDER)) / slope[:, None] * v[k, None] ** _POWER
        r = measured - s
        r2, by2 = np.stack([r.real, r.imag], axis=1), np.stack([by.real, by.imag], axis=1)
        cost = float(np.einsum("ki,kij,kj", r2, weights, r2) + np.sum(((c - _MEAN) / _STD) ** 2))
        return cost, r2, by2

    c = _begun(v, k, measured)
    cost, r, by = linear(c)
    for _ in range(_STEPS):
        H = np.einsum("kia,kij,kjb->ab", by, weights, by) + prior
        step = np.linalg.solve(H, np.einsum("kia,kij,kj->a", by, weights, r) - prior @ (c - _MEAN))
        for share in 0.5 ** np.arange(8):
            tried = linear(c + share * step)
            if tried[0] < cost:
                break
        else:
            break
        c, before, (cost, r, by) = c + share * step, cost, tried
        if before - cost < 1e-3:
            break
    data = np.einsum("kia,kij,kjb->ab", by, weights, by)
    chi2 = float(np.einsum("ki,kij,kj", r, weights, r))
    free = 2 * len(k) - float(np.trace(np.linalg.solve(data + prior, data)))
    P = np.linalg.inv(data / max(1.0, chi2 / max(free, 1.0)) + prior)
    return c, 0.5 * (P + P.T)


def _upper(A: FloatArray) -> ComplexArray:
    """Return the two roots (speeds, 2) of largest imaginary part of polynomials (speeds, 5)."""
    companion = np.zeros((len(A), 4, 4))
    companion[:, 0], companion[:, 1:, :3] = -A[:, 1:], np.eye(3)
    s = np.linalg.eigvals(companion).astype(complex)
    return np.asarray(np.take_along_axis(s, np.argsort(-s.imag, axis=1)[:, :2], axis=1))


def _begun(v: FloatArray, k: NDArray[np.intp], measured: ComplexArray) -> FloatArray:
    """Return the terms nearest to the prior that have the poles of the speeds at which both were found, within 2 %."""
    rows, values = [np.diag(1.0 / _STD)], [_MEAN / _STD]
    for number in range(len(v)):
        both = measured[k == number]
        if len(both) == 2:
            A = np.poly([*both, *np.conj(both)]).real[1:]
            error = 0.02 * np.maximum(np.abs(A), 0.1)
            rows.append((np.arange(4)[:, None] == _ORDER) * v[number] ** _POWER / error[:, None])
            values.append(A / error)
    return np.asarray(np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0])
