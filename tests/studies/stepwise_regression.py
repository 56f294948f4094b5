"""Stepwise regression by partial F, as a baseline that studies compare with.

V. Klein, E. A. Morelli, Aircraft System Identification, AIAA 2006, ch. 5, with errors corrected for the colour of the
residuals: E. A. Morelli, V. Klein, Journal of Guidance, Control, and Dynamics 20(1), 1997.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from testbench.core.record import FloatArray

Records = Sequence[tuple[FloatArray, FloatArray]]
"""Of each record, its candidates (n, m) and its target (n,)."""

_SPAN = 1e-6  # a candidate with less than this share of its length outside the chosen terms is one of them
_F = 12.0  # P(F(1, inf) > 12) = 5.3e-4 per candidate
_DONE = 1e-24  # share of the target's energy that is rounding


class Regression(NamedTuple):
    """Least squares on the chosen candidates and a constant, which is the last."""

    params: FloatArray
    std_plain: FloatArray
    std: FloatArray  # corrected for the colour of the residuals


def stepwise(records: Records) -> tuple[list[int], Regression | None]:
    """Return the candidates that stay and the regression on them; none and None where no candidate enters.

    The candidate with the largest partial correlation with what is left of the target enters if its partial
    F = (theta / std)^2 after entry is at least 12; then terms whose partial F falls below 12 leave, the weakest first.
    With white residuals a candidate without effect enters with probability 5e-4. Coloured residuals make this F too
    large, often 3 to 10 times, and let noise in: in the end terms leave by an F of errors corrected for the colour.
    (Not before: what still lacks terms leaves residuals as coloured as the motion.)
    """
    X, y = np.vstack([x for x, _ in records]), np.concatenate([goal for _, goal in records])
    chosen: list[int] = []
    visited: set[frozenset[int]] = set()
    while (free := _enters(X, y, chosen)) is not None:
        chosen = _pruned(records, [*chosen, free], corrected=False)
        if frozenset(chosen) in visited:  # a term that left has come back
            break
        visited.add(frozenset(chosen))
    chosen = _pruned(records, chosen, corrected=True)
    return chosen, regress(records, chosen) if chosen else None


def _pruned(records: Records, chosen: list[int], *, corrected: bool) -> list[int]:
    """Return the terms without those, the weakest first, whose partial F is too small."""
    while chosen:
        found = regress(records, chosen)
        F = (found.params / (found.std if corrected else found.std_plain))[:-1] ** 2
        weakest = int(np.argmin(F))
        if F[weakest] >= _F:
            break
        chosen = chosen[:weakest] + chosen[weakest + 1 :]
    return chosen


def _enters(X: FloatArray, y: FloatArray, chosen: Sequence[int]) -> int | None:
    """Return the candidate with the largest partial F if that is large enough.

    With the parts orthogonal to the chosen terms, F = (N - n) g / (v'v - g), g = (x'v)^2 / x'x what it takes from v'v.
    """
    basis = np.linalg.qr(
        np.column_stack([np.ones(len(y)), X[:, list(chosen)] / np.linalg.norm(X[:, list(chosen)], axis=0)])
    )[0]
    outside = X - basis @ (basis.T @ X)
    outside = outside - basis @ (basis.T @ outside)
    rest = y - basis @ (basis.T @ y)
    free = np.linalg.norm(outside, axis=0) > _SPAN * np.linalg.norm(X - X.mean(axis=0), axis=0)
    left = [i for i in range(X.shape[1]) if i not in chosen and free[i]]
    energy, parameters = float(rest @ rest), len(chosen) + 2
    if not left or energy <= _DONE * float((y - y.mean()) @ (y - y.mean())) or len(y) < 2 * parameters:
        return None
    gain = np.sum(outside[:, left] * rest[:, None], axis=0) ** 2 / np.sum(outside[:, left] ** 2, axis=0)
    best = int(np.argmax(gain))
    enough = (len(y) - parameters) * float(gain[best]) >= _F * (energy - float(gain[best]))
    return left[best] if enough else None


def regress(records: Records, chosen: Sequence[int]) -> Regression:
    """Return least squares on the chosen candidates and a constant, with errors that count the residuals' colour.

    The corrected covariance is (X'X)^-1 [sum_i x(i) sum_j R(i - j) x(j)'] (X'X)^-1, R(l) = sum_i v(i) v(i + l) / N the
    autocorrelation of the residuals at all lags within a record. It comes out low, because the fit takes the share
    p(f) = sum_j |U_j(f)|^2 / N out of the residuals' spectrum, U the orthonormal terms: each variance, a mean of the
    spectrum with weights W(f), is made up for by sum W / sum W (1 - p).
    """
    parts = [np.column_stack([x[:, list(chosen)], np.ones(len(x))]) for x, _ in records]
    X, y = np.vstack(parts), np.concatenate([goal for _, goal in records])
    n, k = X.shape
    size = np.linalg.norm(X, axis=0)
    Z = X / size
    U, s, Vt = np.linalg.svd(Z, full_matrices=False)
    inverse = Vt.T / s
    theta = inverse @ (U.T @ y)
    theta = theta + inverse @ (U.T @ (y - Z @ theta))  # one step of refinement
    v = y - Z @ theta
    H, params = inverse @ inverse.T, theta / size
    length = 1 << (2 * max(len(x) for x in parts) - 1).bit_length()
    sides = np.full(length // 2 + 1, 2.0)  # how often each line counts in a sum over both signs of frequency
    sides[[0, -1]] = 1.0
    power = np.zeros(sides.size)
    for x, (_, goal) in zip(parts, records, strict=True):
        power += np.abs(np.fft.rfft(goal - x @ params, length)) ** 2
    R = np.fft.irfft(power, length)[: max(len(x) for x in parts)] / n
    kernel = np.zeros(length)
    kernel[: R.size] = R
    kernel[length - R.size + 1 :] = R[1:][::-1]
    spectrum = np.fft.rfft(kernel).real * sides
    score, share, W = np.zeros((k, k)), np.zeros(sides.size), np.zeros((sides.size, k))
    for x in parts:
        F = np.fft.rfft(x / size, length, axis=0)
        score += np.real(np.conj(F).T @ (F * spectrum[:, None])) / length
        F = F @ inverse
        share += np.sum(np.abs(F) ** 2, axis=1) / n
        W += np.abs(F @ inverse.T) ** 2 * sides[:, None]
    factor = np.sum(W, axis=0) / np.sum(W * (1.0 - share)[:, None], axis=0)
    corrected = np.diag(H @ score @ H) * factor
    plain = float(v @ v) / (n - k) * np.diag(H)
    return Regression(params, np.sqrt(plain) / size, np.sqrt(np.maximum(corrected, 0.0)) / size)
