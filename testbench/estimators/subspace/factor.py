"""The R factor of past and future, from which all that follows is computed, and its VARX predictor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.hankel import block_factor, thin_svd, window_starts
from testbench.estimators.subspace.data import EXACT, Stretch

RANK = 1e-12
"""Truncation of projections of noise-free data, relative to the largest singular value."""
RANK_NOISY = 1e-8
"""Truncation with noise: weaker directions add only noise."""
_HIDDEN = 0.6  # directions of the past that move no output by more than this share of its noise are left out


class Factor(NamedTuple):
    """R factor of the windows [z_0, ..., z_{H-1}], z = [u, y]: its columns stand for the rows of the Hankel matrix.

    Inner products of its columns are those of the rows of the block Hankel matrix, whatever the number of samples.

    Attributes:
        R: (w, H (m + p)).
        m: number of inputs.
        p: number of outputs.
        J: past horizon; the future begins at block J.
        columns: number of windows less the offsets and trends estimated along.
        noisy: (p,) False for an output that its past and the inputs predict exactly.
        deviation: (p,) of the innovations in the units of the stretches; outputs in R are in units of it.
        theta: (J (m + p) + m, p) VARX coefficients on [z_0, ..., z_{J-1}, u_J]; the last m rows zero without D.
        excitation: weakest over strongest singular value of all blocks of inputs.
        condition: of the past.
        feedback: F statistic's share, see :func:`feedback_share`.
    """

    R: FloatArray
    m: int
    p: int
    J: int
    columns: int
    noisy: NDArray[np.bool_]
    deviation: FloatArray
    theta: FloatArray
    excitation: float
    condition: float
    feedback: float

    def blocks(self, begin: int, end: int) -> FloatArray:
        """Columns of z_begin, ..., z_{end-1}."""
        d = self.m + self.p
        return self.R[:, begin * d : end * d]

    def inputs(self, begin: int, end: int) -> FloatArray:
        """Columns of u_begin, ..., u_{end-1}."""
        return self._part(begin, end, slice(0, self.m))

    def outputs(self, begin: int, end: int) -> FloatArray:
        """Columns of y_begin, ..., y_{end-1}."""
        return self._part(begin, end, slice(self.m, self.m + self.p))

    def _part(self, begin: int, end: int, which: slice) -> FloatArray:
        blocks = self.blocks(begin, end).reshape(self.R.shape[0], end - begin, self.m + self.p)
        return blocks[:, :, which].reshape(self.R.shape[0], -1)

    @property
    def exact(self) -> bool:
        """Whether no output holds noise."""
        return not bool(self.noisy.any())

    @property
    def tolerance(self) -> float:
        """Truncation of projections."""
        return RANK if self.exact else RANK_NOISY


def basis(M: FloatArray, tolerance: float) -> FloatArray:
    """Return an orthonormal basis of the columns of M, directions below ``tolerance`` times the largest left out."""
    U, s, _ = thin_svd(M)
    out: FloatArray = U[:, s > tolerance * max(s[0], 1e-300)]
    return out


def factorise(stretches: Sequence[Stretch], J: int, H: int, direct: bool, lead: int, method: str) -> Factor:
    """Return the factor of all windows of H samples that touch no invalid one, and the VARX predictor of order J.

    Raises:
        EstimationError: fewer windows than rows.
    """
    m, p = stretches[0].u.shape[1], stretches[0].y.shape[1]
    d = m + p
    starts = [window_starts(s.good, H) for s in stretches]
    R, columns = block_factor([s.both for s in stretches], starts, H, lead)
    if columns < H * d:
        dropped = sum(max(len(s.u) - H + 1 - lead, 0) for s in stretches) - columns
        raise EstimationError(
            f"{method} needs at least as many columns as rows: horizons of {J} and {H - J} samples give {H * d} rows, "
            f"got {max(columns, 0)} columns ({dropped} dropped for invalid samples); shorten the horizons, give more "
            "data" + (", or decimate to the rate of the slowest sensor" if dropped else "")
        )
    q = J * d + (m if direct else 0)
    theta, noisy, deviation, condition = _predictor(R, J, m, p, direct, columns)
    is_output = np.arange(H * d) % d >= m
    own = np.tile(deviation, H)
    R = R.copy()
    R[:, is_output] /= own
    theta = theta / deviation
    past = is_output[: len(theta)]
    theta[past] *= own[: past.sum(), None]
    if noisy.any():
        theta[:q] = regularised(R[:, :q], R[:, J * d + m : (J + 1) * d], weak_level(deviation, columns))
    inputs = np.linalg.svd(R[:, ~is_output], compute_uv=False)
    feedback = feedback_share(R, J, H, m, p, columns) if noisy.any() else 0.0
    return Factor(
        R, m, p, J, columns, noisy, deviation, theta, float(inputs[-1] / inputs[0]), condition, feedback=feedback
    )


def shortened(f: Factor, J: int, direct: bool) -> Factor:
    """Return the factor with the last J blocks of the past alone, and their VARX predictor."""
    d = f.m + f.p
    R = f.R[:, (f.J - J) * d :]
    q = J * d + (f.m if direct else 0)
    theta = np.zeros((J * d + f.m, f.p))
    theta[:q] = regularised(R[:, :q], R[:, J * d + f.m : (J + 1) * d], weak_level(f.deviation, f.columns))
    return f._replace(R=R, J=J, theta=theta)


def weak_level(deviation: FloatArray, columns: int) -> float:
    """Return the singular value of the past, in units of the noise, below which a direction adds only noise.

    The past outputs of noisy data stand at the noise, sqrt(columns), or above it; what is weaker are inputs. An input
    of unit root mean square moves the outputs by some 1 / deviation, an input of this level by less than the noise.
    """
    return float(_HIDDEN * min(float(deviation.min()), 0.05) * np.sqrt(columns))


def regularised(past: FloatArray, now: FloatArray, level: float) -> FloatArray:
    """Return the regression of ``now`` on ``past`` on the directions whose singular values exceed ``level``."""
    U, s, Vt = thin_svd(past)
    kept = s > max(level, RANK_NOISY * s[0])
    out: FloatArray = Vt[kept].T @ ((U[:, kept].T @ now) / s[kept, None])
    return out


def _predictor(
    R: FloatArray, J: int, m: int, p: int, direct: bool, columns: int
) -> tuple[FloatArray, NDArray[np.bool_], FloatArray, float]:
    """Return VARX coefficients, which outputs are noisy, the innovations' deviation and the condition of the past."""
    d = m + p
    q = J * d + (m if direct else 0)
    past, now = R[:, :q], R[:, J * d + m : (J + 1) * d]
    U, sigma, Vt = thin_svd(past)
    size = np.sqrt(np.sum(now**2, axis=0))
    theta, noisy, rest, rank = np.zeros((J * d + m, p)), np.ones(p, bool), size, q
    for tolerance in (RANK, RANK_NOISY):
        rank = int(np.sum(sigma > tolerance * sigma[0]))
        theta[:q, noisy] = Vt[:rank].T @ ((U[:, :rank].T @ now[:, noisy]) / sigma[:rank, None])
        rest = np.sqrt(np.sum((now - past @ theta[:q]) ** 2, axis=0))
        noisy = rest > EXACT * size
        if not noisy.any():
            break
    deviation = rest / np.sqrt(max(columns - rank, 1))
    deviation = np.maximum(deviation, 1e-4) if noisy.any() else np.ones(p)
    return theta, noisy, deviation, float(sigma[0] / sigma[-1]) if sigma[-1] > 0.0 else np.inf


def feedback_share(R: FloatArray, J: int, H: int, m: int, p: int, columns: int) -> float:
    """Return the share of the innovations' variance that later inputs explain beyond chance, 0 to 1.

    In open loop the inputs are independent of the innovations: adding future inputs to the predictor then explains no
    more than their number over the number of samples (C. A. Sims, "Money, income, and causality", 1972).
    """
    d = m + p
    known = basis(R[:, : J * d + m], RANK_NOISY)
    rest = R[:, J * d + m : (J + 1) * d]
    rest = rest - known @ (known.T @ rest)
    later = R[:, (J + 1) * d :].reshape(R.shape[0], H - J - 1, d)[:, :, :m].reshape(R.shape[0], -1)
    if later.shape[1] == 0:
        return 0.0
    size = np.sqrt(np.sum(later**2))
    later = later - known @ (known.T @ later)
    U, s, _ = thin_svd(later)
    U = U[:, s > 1e-3 * size]  # what the past tells of the later inputs already is no news
    free = max(columns - known.shape[1] - U.shape[1], 1)
    before = np.maximum(np.sum(rest**2, axis=0), 1e-300)
    share = np.sum((U.T @ rest) ** 2, axis=0) / before
    chance = (U.shape[1] + 4.0 * np.sqrt(2.0 * U.shape[1])) / free
    return float(max(np.max(share) - chance, 0.0))
