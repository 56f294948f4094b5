"""MOESP, N4SID, CVA and DSR: the future outputs, projected on the past, without what the future inputs do.

The first three are one algorithm with three weights (P. Van Overschee and B. De Moor, "A unifying theorem for three
subspace system identification algorithms", Automatica 31(12), 1995, table 1). With the past W, future inputs U_f,
future outputs Y_f, Pi the projection on the orthogonal complement of U_f, and the oblique projection
O = Y_f /_(U_f) W, the singular vectors of W1 O W2 give the range of W1 times the extended observability matrix:

    N4SID   W1 = I                       W2 = I
    MOESP   W1 = I                       W2 = Pi                (past outputs as instruments: PO-MOESP)
    CVA     W1 = (Y_f Pi Y_f')^(-1/2)    W2 = Pi

O Pi is the orthogonal projection of Y_f Pi on W Pi, so that only N4SID needs the oblique projection proper. Inputs
that are nearly predictable from their past make W Pi nearly singular, and N4SID divides by it; directions of W Pi
are therefore weighted by Tikhonov's s / (s^2 + (|w| / 2)^2) instead of 1 / s, with s what Pi leaves of a direction of
length |w|; a weight from the right leaves the range alone. A is the shift of the observability matrix.

DSR (D. Di Ruscio, "Combined deterministic and stochastic system identification and realization: DSR", Modeling,
Identification and Control 17(3), 1996) takes MOESP's projection with one more block row and A from
Z_{J+1|L} = A~ Z_{J|L}, A~ = O_L A O_L^+, instead of the shift: all L block rows bear on A.

All four correlate the noise with future inputs if these react to outputs: in closed loop they are biased.

SSARX and PBSID-opt: a long VARX predictor first, states from it after; consistent in closed loop.

The innovations model in predictor form, x[k+1] = (A - K C) x[k] + (B - K D) u[k] + K y[k], has no noise, whatever made
u react to y. Its Markov parameters are the coefficients of a VARX model of order J, up to (A - K C)^J. With D free,
u[k] must not react to y[k] in the same sample: a direct feedthrough and an undelayed loop cannot be told apart.

SSARX (M. Jansson, "Subspace identification and ARX modeling", IFAC SYSID 2003): the Markov parameters take the effect
of future inputs and outputs out of the future outputs; what is left is a function of the state at J, which canonical
correlations with the past find.

PBSID-opt (A. Chiuso, "The role of vector autoregressive modeling in predictor-based subspace identification",
Automatica 43, 2007): the Markov parameters are put together to the product of predictor observability and past
controllability; its singular vectors, weighted by the past, give the state as a combination of the past.

Directions of the past so weak that no output shows them are left out of both regressions (``factor.weak_level``):
inputs confined to a part of the band have many.

Both then regress: y on (x, u) for C, D and the innovations e; x[k+1] on (x, u, e) for A, B, K.

The R factor of past and future, from which all that follows is computed, and its VARX predictor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.hankel import block_factor, thin_svd
from testbench.estimators.subspace.data import EXACT, Stretch, choose_order

# --- the R factor of past and future, and its VARX predictor ----------------------------------------------------------


RANK = 1e-12
"""Truncation of projections of noise-free data, relative to the largest singular value."""
RANK_NOISY = 1e-8
"""Truncation with noise: weaker directions add only noise."""
_HIDDEN = 0.6  # directions of the past that move no output by more than this share of its noise are left out


class Factor(NamedTuple):
    """R factor of the windows [z_0, ..., z_{H-1}], z = [u, y]: its columns stand for the rows of the Hankel matrix.

    Inner products of its columns are those of the rows of the block Hankel matrix, whatever the number of samples.
    """

    R: FloatArray  # (w, H (m + p))
    m: int  # number of inputs
    p: int  # number of outputs
    J: int  # past horizon; the future begins at block J
    columns: int  # number of windows less the offsets and trends estimated along
    noisy: NDArray[np.bool_]  # (p,) False for an output that its past and the inputs predict exactly
    deviation: FloatArray  # (p,) of the innovations in the units of the stretches; outputs in R are in units of it
    # (J (m + p) + m, p) VARX coefficients on [z_0, ..., z_{J-1}, u_J]; the last m rows zero without D
    theta: FloatArray
    excitation: float  # weakest over strongest singular value of all blocks of inputs
    condition: float  # of the past
    feedback: float  # F statistic's share, see :func:`feedback_share`

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
    R, columns = block_factor([s.both for s in stretches], [s.good for s in stretches], H, lead)
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


# --- the projections of MOESP, N4SID, CVA and DSR ---------------------------------------------------------------------


_OBLIQUE = 0.5  # N4SID damps directions of the past of which the future inputs hide more than about this share


class Realisation(NamedTuple):
    """A (n, n), C (p, n) in the factor's units; singular values over the noise floor; B, D, K if regressed along."""

    A: FloatArray
    C: FloatArray
    singular_values: FloatArray
    order_choice: str
    B: FloatArray | None = None
    D: FloatArray | None = None
    K: FloatArray | None = None


def noise_floor(f: Factor, rows: int, largest: float) -> float:
    """Return the largest singular value that unit white noise projected on the past would have; for exact data, max."""
    return largest if f.exact else np.sqrt(f.R[:, : f.J * (f.m + f.p)].shape[1]) + np.sqrt(rows)


def pick(values: FloatArray, f: Factor, order: int | None, most: int) -> tuple[int, str]:
    """Return the given order, or the one that the singular values show."""
    return (order, "given") if order is not None else choose_order(values, not f.exact, most)


def _cleared(f: Factor, L: int) -> tuple[FloatArray, FloatArray]:
    """Return past and future outputs (columns) without what the future inputs explain."""
    Q = basis(f.inputs(f.J, f.J + L), f.tolerance)
    past, future = f.blocks(0, f.J), f.outputs(f.J, f.J + L)
    return past - Q @ (Q.T @ past), future - Q @ (Q.T @ future)


def _past_basis(f: Factor, past: FloatArray) -> FloatArray:
    """Basis of the cleared past; directions that were wholly in the future inputs are rounding and left out."""
    U, s, _ = thin_svd(past)
    size = np.linalg.norm(f.blocks(0, f.J), 2)
    out: FloatArray = U[:, s > max(f.tolerance, 1e-11) * size]
    return out


def by_shift(O_L: FloatArray, p: int) -> tuple[FloatArray, FloatArray]:
    """Return A and C from the extended observability matrix: O_L without its last block, times A, is its shift."""
    A: FloatArray = np.linalg.lstsq(O_L[:-p], O_L[p:], rcond=None)[0]  # type: ignore[assignment]
    return A, O_L[:p]


def moesp(f: Factor, L: int, order: int | None) -> Realisation:
    """PO-MOESP (M. Verhaegen 1994)."""
    past, future = _cleared(f, L)
    Z = _past_basis(f, past).T @ future
    _, s, Vt = thin_svd(Z)
    values = s / noise_floor(f, f.p * L, s[0])
    n, choice = pick(values, f, order, f.p * (L - 1))
    return Realisation(*by_shift(Vt[:n].T * np.sqrt(s[:n]), f.p), values, choice)


def n4sid(f: Factor, L: int, order: int | None) -> Realisation:
    """N4SID: the oblique projection without weights, A from the shift (its "robust" form takes states)."""
    if f.exact:
        return moesp(f, L, order)
    past, future = _cleared(f, L)
    U, s, Vt = thin_svd(past)
    W = f.blocks(0, f.J) @ Vt.T  # the same directions of the past, future inputs not taken out
    gain = W * s / np.maximum(s**2 + _OBLIQUE**2 * np.sum(W**2, axis=0), 1e-300)
    _, values, Vt = thin_svd(gain @ (U.T @ future))
    # unit noise times gain: the expected norm of a Gaussian matrix between given weights (Chevet's inequality)
    floor = np.linalg.norm(gain) + np.linalg.norm(gain, 2) * np.sqrt(f.p * L)
    n, choice = pick(values / floor, f, order, f.p * (L - 1))
    return Realisation(*by_shift(Vt[:n].T * np.sqrt(values[:n]), f.p), values / floor, choice)


def cva(f: Factor, L: int, order: int | None) -> Realisation:
    """CVA (W. E. Larimore 1990): canonical correlations c, shown as c / sqrt(1 - c^2), which noise leaves near 1."""
    if f.exact:
        return moesp(f, L, order)
    past, future = _cleared(f, L)
    O_L, values, _ = canonical(f, _past_basis(f, past), future)
    n, choice = pick(values, f, order, f.p * (L - 1))
    return Realisation(*by_shift(O_L[:, :n], f.p), values, choice)


def canonical(f: Factor, Q: FloatArray, future: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return O_L, singular values over the noise floor and states in the basis Q of the past, best correlated first.

    With the residual covariance E'E of the future, Z (E'E)^(-1/2) has the same singular vectors as the correlations.
    """
    Z = Q.T @ future
    rest = future - Q @ Z
    _, s, Vt = thin_svd(rest)
    unit = np.sqrt(max(f.columns - Q.shape[1], 1))
    s = np.maximum(s, 1e-6 * s[0]) / unit  # a future known exactly in some direction would weigh without bound
    X, values, Wt = thin_svd((Z @ Vt.T) / s)
    O_L = (Vt.T * s) @ Wt.T * np.sqrt(values)
    return O_L, values / noise_floor(f, future.shape[1], values[0]), X * np.sqrt(values)


def dsr(f: Factor, L: int, order: int | None) -> Realisation:
    """DSR: A from Z_{J+1|L} = A~ Z_{J|L}; the factor holds one more future block than L."""
    past, future = _cleared(f, L + 1)
    Z = _past_basis(f, past).T @ future
    p = f.p
    U, s, Vt = thin_svd(Z[:, : p * L])
    values = s / noise_floor(f, p * L, s[0])
    n, choice = pick(values, f, order, p * (L - 1))
    A = Vt[:n] @ Z[:, p:].T @ U[:, :n] / s[:n]
    return Realisation(A, Vt[:n, :p].T, values, choice)


PROJECTIONS: dict[str, Callable[[Factor, int, int | None], Realisation]] = {
    "moesp": moesp,
    "n4sid": n4sid,
    "cva": cva,
    "dsr": dsr,
}


def _past_predictor(f: Factor, L: int) -> FloatArray:
    """Return (J d, p L): coefficients on the past of what y_J, ..., y_{J+L-1} hold of it, nothing from J on known.

    Block i takes z_{J-l} with the VARX coefficient of lag i + l; lags beyond J are zero.
    """
    d = f.m + f.p
    out = np.zeros((f.J * d, f.p * L))
    for i in range(min(L, f.J)):
        out[i * d :, i * f.p : (i + 1) * f.p] = f.theta[: (f.J - i) * d]
    return out


def _future_without_inputs(f: Factor, L: int) -> FloatArray:
    """Return y_J, ..., y_{J+L-1} without what the predictor makes of u and y from J on."""
    d, p, m = f.m + f.p, f.p, f.m
    lags, direct = f.theta[: f.J * d], f.theta[f.J * d :]
    out = f.outputs(f.J, f.J + L).copy()
    for i in range(L):
        reach = min(i, f.J)
        here = slice(i * p, (i + 1) * p)
        if reach:
            out[:, here] -= f.blocks(f.J + i - reach, f.J + i) @ lags[(f.J - reach) * d :]
        out[:, here] -= f.inputs(f.J + i, f.J + i + 1) @ direct[:m]
    return out


def _regress(f: Factor, T: FloatArray, values: FloatArray, choice: str, direct: bool) -> Realisation:
    """Return the model whose state is past @ T (T of shape (J d, n)), by two linear regressions."""
    n, m = T.shape[1], f.m
    x, after = f.blocks(0, f.J) @ T, f.blocks(1, f.J + 1) @ T
    u, y = f.inputs(f.J, f.J + 1), f.outputs(f.J, f.J + 1)
    left = np.hstack([x, u]) if direct else x
    read: FloatArray = np.linalg.lstsq(left, y, rcond=None)[0]  # type: ignore[assignment]
    e = (y - left @ read)[:, f.noisy]
    step: FloatArray = np.linalg.lstsq(np.hstack([x, u, e]), after, rcond=None)[0]  # type: ignore[assignment]
    K = np.zeros((n, f.p))
    K[:, f.noisy] = step[n + m :].T
    D = read[n:].T if direct else np.zeros((f.p, m))
    return Realisation(step[:n].T, read[:n].T, values, choice, step[n : n + m].T, D, K)


def ssarx(f: Factor, L: int, order: int | None, direct: bool) -> Realisation:
    """SSARX; noise-free data leave K and with it the predictor undefined: MOESP's projection then."""
    if f.exact:
        return moesp(f, L, order)
    past = f.blocks(0, f.J)
    U, s, Vt = thin_svd(past)
    kept = s > max(f.tolerance * s[0], weak_level(f.deviation, f.columns))
    U, s, Vt = U[:, kept], s[kept], Vt[kept]
    future = _future_without_inputs(f, L)
    _, values, states = canonical(f, U, future)
    n, choice = pick(values, f, order, f.p * (L - 1))
    return _regress(f, Vt.T @ (states[:, :n] / s[:, None]), values, choice, direct)


def pbsid_opt(f: Factor, L: int, order: int | None, direct: bool) -> Realisation:
    """PBSID-opt; noise-free data leave K and with it the predictor undefined: MOESP's projection then."""
    if f.exact:
        return moesp(f, L, order)
    product = _past_predictor(f, L)
    _, s, Vt = thin_svd(f.blocks(0, f.J) @ product)
    values = s / noise_floor(f, f.p * L, s[0])
    n, choice = pick(values, f, order, f.p * (L - 1))
    return _regress(f, product @ Vt[:n].T / np.sqrt(s[:n]), values, choice, direct)


PREDICTORS: dict[str, Callable[[Factor, int, int | None, bool], Realisation]] = {"ssarx": ssarx, "pbsid_opt": pbsid_opt}
