"""SSARX and PBSID-opt: a long VARX predictor first, states from it after; consistent in closed loop.

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
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from testbench.core.record import FloatArray
from testbench.estimators.hankel import thin_svd
from testbench.estimators.subspace.factor import Factor, weak_level
from testbench.estimators.subspace.projections import Realisation, canonical, moesp, noise_floor, pick


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


PREDICTORS: dict[str, Callable[[Factor, int, int | None, bool], Realisation]] = {
    "ssarx": ssarx,
    "pbsid_opt": pbsid_opt,
}
