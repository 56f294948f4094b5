"""How much too small are errors that were corrected for the colour of residuals, because a fit takes colour away?

A fit takes out of the residuals just those slow motions that its unknowns can imitate. In a short record that is much
of their colour, and the errors that are corrected for what is left are too small (``make coloured-errors-study``).
Simulations say how much: noise of the colour found is drawn, what the unknowns can imitate is taken out of it, and its
errors are corrected as those of the record were (a parametric bootstrap: B. Efron and R. J. Tibshirani, "An
Introduction to the Bootstrap", 1993, sections 6.5 and 12.5).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from testbench.core.record import FloatArray
from testbench.estimators.parametric.sensitivities import Sensitivities
from testbench.estimators.residuals import LAG_SHARE, Autoregression, Colour, autoregression, sides

DRAWS = 32  # the factor then scatters by some 5 % for a variance that scatters by 60 %
LONG_ENOUGH = 300.0  # correlation times in the records, beyond which the factor is below 1.01
LARGEST = 2e7  # of the sensitivities' numbers, that are kept for all records at once
_SEED = 30


def shortfall(
    residuals: Sequence[FloatArray],
    sensitivities: Callable[[], Iterable[Sensitivities]],
    R: FloatArray,
    plain: FloatArray,
    colour: Colour,
) -> FloatArray:
    """Return by how much variances (k,) corrected for colour fall short; 1 for white residuals and for long records.

    It is the mean of (variance of the noise drawn) / (variance as corrected in a draw), at least 1. The mean of the
    inverse also widens intervals for the scatter of the corrected variances, as Student's distribution does.

    Args:
        residuals: per record (N, p); zero where not valid.
        sensitivities: gives those of each record, zero where not valid.
        R: (p, p) covariance that weighs the residuals.
        plain: (k, k) covariance of the unknowns for white residuals; rows of zero are not estimated.
        colour: of the residuals.
    """
    k = len(plain)
    model, samples, p = colour.model, sum(len(v) for v in residuals), len(R)
    moved = np.flatnonzero(np.diag(plain) > 0.0)
    if model is None or not len(model.A) or not moved.size:
        return np.ones(k)
    if -np.log(model.slowest()) * samples > LONG_ENOUGH or samples * p * (k + 2 * DRAWS) > LARGEST:
        return np.ones(k)
    # A root that dies away over the whole record is one of chance: what is drawn with it would say nothing of the next.
    model = model.damped(float(np.exp(-LAG_SHARE / max(map(len, residuals)))))
    inverse, rng = np.asarray(np.linalg.inv(R), dtype=np.float64), np.random.default_rng(_SEED)
    felt = [_Felt.of(s, inverse, plain, moved) for s in sensitivities()]
    drawn = [_drawn(model, v, rng) for v in residuals]
    off = plain @ sum(f.score(x, k) for f, x in zip(felt, drawn, strict=True))
    total = np.zeros(moved.size)
    left = [x - f.s.values @ off[f.s.columns] for f, x in zip(felt, drawn, strict=True)]
    for b in range(DRAWS):
        again = autoregression([x[:, :, b] for x in left])
        total += 1.0 / sum(f.variances(again) for f in felt)
    out = np.ones(k)
    out[moved] = np.maximum(sum(f.variances(model) for f in felt) * total / DRAWS, 1.0)
    return out


class _Felt(NamedTuple):
    """One record: sensitivities, the same times the inverse covariance, and the spectrum of the estimates by samples.

    ``gain`` (f, p, m) is the transform, over ``size`` samples, of the matrix that maps residuals to estimates.
    """

    s: Sensitivities
    weighted: FloatArray
    gain: NDArray[np.complex128]
    size: int

    @classmethod
    def of(cls, s: Sensitivities, inverse: FloatArray, plain: FloatArray, moved: NDArray[np.intp]) -> _Felt:
        weighted = inverse @ s.values
        size = next_fast_len(2 * len(weighted), real=True)
        return cls(s, weighted, rfft(weighted @ plain[np.ix_(s.columns, moved)], size, axis=0), size)

    def score(self, drawn: FloatArray, k: int) -> FloatArray:
        """Return the score (k, draws) of noise (N, p, draws)."""
        out = np.zeros((k, drawn.shape[2]))
        out[self.s.columns] = np.einsum("iak,iab->kb", self.weighted, drawn, optimize=True)
        return out

    def variances(self, model: Autoregression) -> FloatArray:
        """Return this record's share (m,) of the variances of the estimates for residuals of the colour ``model``."""
        G = model.shaped(self.gain, self.size)
        power = np.einsum("fak,ab,fbk->fk", np.conj(G), model.S, G, optimize=True).real
        return np.asarray(sides(self.size) @ power / self.size)


def _drawn(model: Autoregression, residuals: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return noise (N, p, draws) of the colour ``model``, zero where a residual (N, p) is."""
    size = next_fast_len(2 * len(residuals), real=True)
    white = np.linalg.cholesky(model.S) @ rng.standard_normal((size, len(model.S), DRAWS))
    noise = irfft(np.linalg.solve(model.whitener(size), rfft(white, axis=0)), size, axis=0)[: len(residuals)]
    return np.asarray(np.where(residuals[:, :, None] == 0.0, 0.0, noise))
