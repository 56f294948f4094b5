"""Are residuals white, and what does their colour do to the errors of estimated parameters?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.stats import chi2

from testbench.core.record import FloatArray

LARGEST_ORDER = 20
LAG_SHARE = 5  # with gaps, autocorrelations are taken up to a fifth of the record (Klein and Morelli 2006, section 5.2)
_GAPS = 0.95  # share of samples that count below which an autoregression would take gaps for whiteness
_BLOCK = 2**16  # samples of a record that are shaped at a time
_FORGOTTEN, _ENDLESS = 1e-13, 2**60  # what is left of an impulse that has died away; samples of one that has not
_RIDGE = 1e-9  # of the variance, so that residuals of no noise at all can be inverted


def autocovariance(v: FloatArray, lags: int) -> FloatArray:
    """Return the autocovariance (lags + 1, p, p) of residuals v (N, p): R[k] = sum_i v[i] v[i + k]' / N."""
    N = len(v)
    size = next_fast_len(N + lags + 1, real=True)
    V = rfft(v, size, axis=0)
    cross = irfft(np.conj(V)[:, :, None] * V[:, None, :], size, axis=0)
    return np.asarray(cross[: lags + 1] / N)


class Autoregression(NamedTuple):
    """v[i] = sum_j A[j] v[i - 1 - j] + e[i]: coefficients (order, p, p) and covariance (p, p) of e."""

    A: FloatArray
    S: FloatArray

    def slowest(self) -> float:
        """Return the size of the root of 1 - sum A z^-j that dies away last; 0 for white residuals."""
        order, p = self.A.shape[:2]
        if not order:
            return 0.0
        companion = np.eye(order * p, k=-p)
        companion[:p] = self.A.transpose(1, 0, 2).reshape(p, -1)
        return float(np.abs(np.linalg.eigvals(companion)).max())

    def damped(self, slowest: float) -> Autoregression:
        """Return the autoregression whose roots are smaller by one factor, so that none is larger than ``slowest``."""
        share = min(1.0, slowest / max(self.slowest(), 1e-300))
        powers = share ** np.arange(1, len(self.A) + 1)
        return Autoregression(self.A * powers[:, None, None], self.S)

    def whitener(self, size: int) -> NDArray[np.complex128]:
        """Return 1 - sum A z^-j (f, p, p) at the frequencies of a real transform over ``size`` samples."""
        one = np.eye(len(self.S))[None]
        return np.asarray(rfft(np.concatenate([one, -self.A]), size, axis=0))

    def shaped(self, F: NDArray[np.complex128], size: int) -> NDArray[np.complex128]:
        """Return a spectrum F (f, p, k) over ``size`` samples through the conjugate transpose of 1 / whitener.

        The spectrum of the residuals is the inverse of the whitener, times S, times its conjugate transpose.
        """
        return np.asarray(np.linalg.solve(np.conj(self.whitener(size)).transpose(0, 2, 1), F))


def autoregression(residuals: Sequence[FloatArray], largest: int = LARGEST_ORDER) -> Autoregression:
    """Return the autoregression of residuals, each (N, p), by least squares; zero of order for white ones.

    The order has the least E. J. Hannan and B. G. Quinn criterion, Journal of the Royal Statistical Society B 41, 1979.
    """
    return autoregressions([residuals], largest)[0]


def autoregressions(drawn: Sequence[Sequence[FloatArray]], largest: int = LARGEST_ORDER) -> list[Autoregression]:
    """Return the autoregression of each of several sets of residuals, whose records are equally long in all sets."""
    lengths, p = [len(v) for v in drawn[0]], drawn[0][0].shape[1]
    total = sum(lengths)
    largest = max(0, min(largest, min(lengths) // 4, total // (10 * p)))
    rows = total - largest * len(lengths)
    sizes = np.sqrt([np.sum([np.sum(v**2, axis=0) for v in residuals], axis=0) / total for residuals in drawn])
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    gram = np.zeros((len(drawn), (largest + 1) * p, (largest + 1) * p))
    for sums, residuals, size in zip(gram, drawn, sizes, strict=True):
        for v in residuals:
            past = np.hstack([v[largest - j : len(v) - j] / size for j in range(largest + 1)])  # the present one first
            sums += past.T @ past
    present, link, lags = gram[:, :p, :p], gram[:, p:, :p], gram[:, p:, p:] + _RIDGE * rows * np.eye(largest * p)
    # Orders are nested: one factor of all lags says what each lag takes away beyond those before it.
    known = np.linalg.cholesky(lags) if np.isfinite(gram).all() else np.full(lags.shape, np.nan)
    each = np.linalg.solve(known, link).reshape(len(drawn), largest, p, p)
    S = np.repeat(present[:, None], largest + 1, axis=1)
    S[:, 1:] -= np.cumsum(each.transpose(0, 1, 3, 2) @ each, axis=1)
    determinant = np.linalg.slogdet(S / rows + _RIDGE * np.eye(p))[1]
    criteria = rows * determinant + 2.0 * np.log(np.log(rows)) * p * p * np.arange(largest + 1)
    out = []
    for i, order in enumerate(np.argmin(np.where(np.isnan(criteria), np.inf, criteria), axis=1)):
        B = np.linalg.solve(lags[i, : order * p, : order * p], link[i, : order * p])
        A = B.T.reshape(p, order, p).transpose(1, 0, 2) * sizes[i, :, None] / sizes[i]
        covariance = (present[i] - B.T @ link[i, : order * p]) / rows * np.outer(sizes[i], sizes[i])
        out.append(Autoregression(np.asarray(A), np.asarray(covariance)))
    return out


class Colour(NamedTuple):
    """How residuals are correlated in time: as an autoregression; where samples are missing, as autocovariances.

    ``autocovariance`` (lags + 1, p, p) comes from pairs of valid samples.
    """

    model: Autoregression | None
    autocovariance: FloatArray

    @classmethod
    def of(cls, residuals: Sequence[FloatArray]) -> Colour:
        """Return the colour of residuals, per record (N, p), zero where not valid.

        It comes from an autoregression: sample autocorrelations, cut or tapered, are too small at just those
        frequencies that the fit has taken out of the residuals, and intervals then cover too little.
        """
        share = sum(np.count_nonzero(v) for v in residuals) / max(sum(v.size for v in residuals), 1)
        if share < _GAPS:
            return cls(None, _over_gaps(residuals))
        return cls(autoregression(residuals), np.zeros((0, 0, 0)))

    def score(self, W: FloatArray) -> FloatArray:
        """Return the covariance (k, k) of sum_i W[i]' v[i] over a record, W (N, p, k), but for rounding symmetric."""
        if self.model is None:
            return _score_over_gaps(W, self.autocovariance)
        lead = _settles(self.model)
        if lead + _BLOCK > len(W):
            return _score(W, self.model)
        # Later samples act on earlier ones: before the first sample too, and for as long as the model rings.
        p, k = W.shape[1:]
        out = np.zeros((k, k))
        for start in range(-lead, len(W), _BLOCK):
            block = np.zeros((_BLOCK + lead, p, k))
            seen = W[max(start, 0) : start + _BLOCK + lead]
            block[max(-start, 0) :][: len(seen)] = seen
            size = next_fast_len(_BLOCK + 2 * lead, real=True)
            g = irfft(self.model.shaped(rfft(block, size, axis=0), size), size, axis=0)[: min(_BLOCK, len(W) - start)]
            out += np.einsum("iak,ab,ibl->kl", g, self.model.S, g, optimize=True)
        return out


def coloured_information(weighted: Sequence[FloatArray], residuals: Sequence[FloatArray]) -> FloatArray:
    """Return the covariance of the score sum_i W[i]' v[i] of residuals v that are correlated in time.

        sum_i sum_j W[i]' R(j - i) W[j]

    with the autocorrelation R of the residuals, all records together (E. A. Morelli and V. Klein, "Accuracy of
    aerodynamic model parameters estimated from flight test data", Journal of Guidance, Control, and Dynamics 20(1),
    1997), as :class:`Colour` finds it. For residuals that are white this is the information matrix W' R W.

    Args:
        weighted: per record (N, p, k), sensitivities times the inverse noise covariance; zero where not valid.
        residuals: per record (N, p); zero where not valid.
    """
    colour = Colour.of(residuals)
    out = np.sum([colour.score(W) for W in weighted], axis=0)
    return np.asarray(0.5 * (out + out.T))


def _settles(model: Autoregression) -> int:
    """Return the samples after which an impulse through 1 / (1 - sum A z^-j) is forgotten; very many if it is not."""
    order, slowest = len(model.A), model.slowest()
    if slowest >= 1.0:
        return _ENDLESS
    return min(_ENDLESS, order + int(np.ceil(np.log(_FORGOTTEN) / np.log(max(slowest, 1e-3)))))


def _score(W: FloatArray, model: Autoregression) -> FloatArray:
    """Return the covariance of the score over a record that is short enough to be taken as one."""
    size = next_fast_len(2 * len(W), real=True)
    G = model.shaped(rfft(W, size, axis=0), size)
    part = np.einsum("fak,ab,fbl->kl", np.conj(G) * sides(size)[:, None, None], model.S, G, optimize=True)
    return np.asarray(part.real / size)


def sides(size: int) -> FloatArray:
    """Return (f,) how often each frequency of a real transform over ``size`` samples counts in the two-sided one."""
    out = np.full(size // 2 + 1, 2.0)
    out[0] = 1.0
    if size % 2 == 0:
        out[-1] = 1.0
    return out


def _over_gaps(residuals: Sequence[FloatArray]) -> FloatArray:
    """Return sample autocovariances over pairs of valid samples, tapered by Parzen's window (1961)."""
    lags = [max(1, len(v) // LAG_SHARE) for v in residuals]
    p = residuals[0].shape[1]
    R, pairs = (np.zeros((max(lags) + 1, p, p)) for _ in range(2))
    for v, lag in zip(residuals, lags, strict=True):
        R[: lag + 1] += autocovariance(v, lag) * len(v)
        pairs[: lag + 1] += autocovariance((v != 0.0).astype(float), lag) * len(v)
    R = np.divide(R, pairs, out=np.zeros_like(R), where=pairs > 0.5)
    x = np.arange(len(R)) / len(R)
    R *= np.where(x < 0.5, 1.0 - 6.0 * x**2 * (1.0 - x), 2.0 * (1.0 - x) ** 3)[:, None, None]
    return np.asarray(R)


def _score_over_gaps(W: FloatArray, R: FloatArray) -> FloatArray:
    """Return the covariance of the score over a record from autocovariances R (lags + 1, p, p)."""
    lag = max(1, len(W) // LAG_SHARE)
    size = next_fast_len(len(W) + lag + 1, real=True)
    kernel = np.zeros((size, *R.shape[1:]))
    kernel[: lag + 1] = R[: lag + 1]
    kernel[-lag:] = R[1 : lag + 1][::-1].transpose(0, 2, 1)
    spectrum = np.conj(rfft(kernel, size, axis=0))  # correlation, not convolution: sum_j R(j - i) W[j]
    smoothed = irfft(np.einsum("fab,fbk->fak", spectrum, rfft(W, size, axis=0)), size, axis=0)[: len(W)]
    return np.asarray(np.einsum("iak,ial->kl", W, smoothed))


def corrected_covariance(plain: FloatArray, score: FloatArray) -> FloatArray:
    """Return plain @ score @ plain, no variance below zero; rows of zero variance stay zero."""
    size = np.sqrt(np.diag(plain))
    size = np.where(size > 0.0, size, 1.0)  # so that units do not matter to what is clipped
    values, vectors = np.linalg.eigh(plain @ score @ plain / np.outer(size, size))
    out = np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(size, size))
    out[np.diag(plain) == 0.0] = 0.0
    out[:, np.diag(plain) == 0.0] = 0.0
    return out


def ljung_box(v: FloatArray, lags: int) -> float:
    """Return the probability that white residuals v (N,) show at least these autocorrelations up to ``lags``.

    G. M. Ljung and G. E. P. Box, Biometrika 65, 1978.
    """
    N = v.size
    r = autocovariance((v - v.mean())[:, None], lags)[:, 0, 0]
    if r[0] <= 0.0:
        return 1.0
    statistic = N * (N + 2.0) * np.sum((r[1:] / r[0]) ** 2 / (N - np.arange(1, lags + 1)))
    return float(chi2.sf(statistic, lags))
