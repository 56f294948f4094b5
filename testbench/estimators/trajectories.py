"""Trajectories of linear recursions over many samples, in few operations."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm, schur, solve_sylvester
from scipy.signal import lfilter

from testbench.core.record import FloatArray
from testbench.estimators.model import ComplexArray

_GROWTH = 1e3  # a mode that grows by more than this over a record is run backwards in time
_DISTINCT = 1e6  # condition of the eigenvectors up to which modes are run one by one


class Trajectories:
    """All trajectories of x[k+1] = A x[k] + f[k] over ``samples`` samples, in numbers that stay bounded.

    Forward recursion of an unstable A loses all digits: the forced response and the response to the initial state
    both grow and cancel. A is therefore decoupled (ordered real Schur form, Sylvester equation) into modes that run
    forwards from x[0] = 0 and modes that grow by more than a factor 1000 over the record, which run backwards from
    x[N-1] = 0. The set {forced + free a} over all a is the same set of trajectories; only its origin differs.

    Args:
        A: (n, n) state matrix.
        samples: number of samples N.
    """

    def __init__(self, A: FloatArray, samples: int) -> None:
        self.samples = samples
        limit = _GROWTH ** (1.0 / max(samples, 1))
        T, Q, m = schur(A, output="real", sort=lambda re, im: np.hypot(re, im) <= limit)
        n = T.shape[0]
        S = np.eye(n)
        if 0 < m < n:
            S[:m, m:] = solve_sylvester(T[:m, :m], -T[m:, m:], -T[:m, m:])
        V = Q @ S
        self._forward, self._backward = T[:m, :m], T[m:, m:]
        if m < n:
            self._backward, Q2 = schur(np.linalg.inv(T[m:, m:]), output="real")
            V[:, m:] = V[:, m:] @ Q2
        self._V, self._Vinv, self._m = V, np.linalg.inv(V), m

    def forced(self, f: FloatArray) -> FloatArray:
        """Return one trajectory per column of the forcing ``f`` (N, n, b), same shape."""
        g = _times(self._Vinv, f.transpose(1, 2, 0))
        m = self._m
        x = np.zeros(g.shape)
        x[:m] = _recursion(self._forward, g[:m])
        if m < len(x):
            back = _times(-self._backward, g[m:])[:, :, -2::-1]  # x[k] = A^-1 (x[k+1] - f[k])
            back = np.concatenate([back, np.zeros((*back.shape[:2], 1))], axis=2)
            x[m:] = _recursion(self._backward, back)[:, :, ::-1]
        return _times(self._V, x).transpose(2, 0, 1)

    def free(self) -> FloatArray:
        """Return a basis (N, n, n) of the solutions of x[k+1] = A x[k]."""
        N, n, m = self.samples, self._V.shape[0], self._m
        x = np.zeros((n, n, N))
        for T, part, step in ((self._forward, slice(0, m), 1), (self._backward, slice(m, n), -1)):
            if T.size:
                start = np.zeros((T.shape[0], T.shape[0], N + 1))
                start[:, :, 0] = np.eye(T.shape[0])
                x[part, part] = _recursion(T, start)[:, :, 1:][:, :, ::step]
        return _times(self._V, x).transpose(2, 0, 1)


def driven(
    A: FloatArray, B: FloatArray, inputs: Sequence[FloatArray], dt_s: float, starts: Sequence[FloatArray] | None = None
) -> list[FloatArray]:
    """Return the states (n, k) of xdot = A x + B u, one array for each input (n, m), held between samples.

    All run side by side, from rest or from ``starts`` (k,); a shorter one is at rest once it ends.
    """
    k, m = B.shape
    block = np.zeros((k + m, k + m))
    block[:k] = np.hstack([A, B])
    step = expm(block * dt_s)
    longest = max(len(u) for u in inputs)
    f = np.zeros((longest, k, len(inputs)))
    for i, u in enumerate(inputs):
        f[: len(u) - 1, :, i] = u[:-1] @ step[:k, k:].T
    if starts is not None:  # the first step leads to them
        f = np.concatenate([np.stack(starts, axis=1)[None], f])
        x = Trajectories(step[:k, :k], longest + 1).forced(f)[1:]
    else:
        x = Trajectories(step[:k, :k], longest).forced(f)
    return [x[: len(u), :, i] for i, u in enumerate(inputs)]


def _times(M: FloatArray, x: FloatArray) -> FloatArray:
    """Return M x[:, j, k] for all j and k, in one product of matrices; time is last, where it is contiguous."""
    return (M @ x.reshape(x.shape[0], -1)).reshape(M.shape[0], *x.shape[1:])


def _recursion(T: FloatArray, f: FloatArray) -> FloatArray:
    """Return x (n, b, N) with x[k=0] = 0, x[k+1] = T x[k] + f[k], for a quasi-triangular T, mode by mode."""
    n = T.shape[0]
    x = np.zeros(f.shape)
    i = n
    while i > 0:
        pair = i > 1 and T[i - 1, i - 2] != 0.0
        rows = slice(i - 2, i) if pair else slice(i - 1, i)
        drive = f[rows] + _times(T[rows, i:], x[i:]) if i < n else f[rows]
        if pair:  # standardised block [[a, b], [c, a]] with b c < 0: one complex mode of first order
            a, b, c = T[i - 2, i - 2], T[i - 2, i - 1], T[i - 1, i - 2]
            w = np.sqrt(-b * c)
            zeta = lfilter([0.0, 1.0], [1.0, -(a + 1j * w)], drive[0] / (2 * b) - 1j * drive[1] / (2 * w))
            x[i - 2], x[i - 1] = 2 * b * zeta.real, -2 * w * zeta.imag
        else:
            x[i - 1] = lfilter([0.0, 1.0], [1.0, -T[i - 1, i - 1]], drive[0])
        i = rows.start
    return x


def carried(transition: FloatArray, force: FloatArray, start: FloatArray) -> FloatArray:
    """Return x (N, n, m) of x[k+1] = transition[k] x[k] + force[k] from x[0] = ``start`` (n, m).

    Stretches of about sqrt(N) samples run side by side, each from the unit matrix and from zero, and are joined
    afterwards: 2 sqrt(N) products of arrays instead of N of matrices.

    Args:
        transition: (N, n, n); the last one is not used.
        force: (N, n, m); the last one is not used.
        start: initial states.
    """
    N, n, m = force.shape
    length = math.isqrt(N - 1) + 1
    count = -(-N // length)
    A, f = np.zeros((count * length, n, n)), np.zeros((count * length, n, m))
    A[:N], f[:N] = transition, force
    A, f = A.reshape(count, length, n, n), f.reshape(count, length, n, m)
    own = np.empty((length + 1, count, n, n + m))
    own[0] = np.eye(n, n + m)
    for k in range(length):
        np.matmul(A[:, k], own[k], out=own[k + 1])
        own[k + 1, :, :, n:] += f[:, k]
    starts = np.empty((count, n, m))
    for i, last in enumerate(own[length]):
        starts[i], start = start, last[:, :n] @ start + last[:, n:]
    x = np.matmul(own[:length, :, :, :n], starts) + own[:length, :, :, n:]
    joined: FloatArray = x.transpose(1, 0, 2, 3).reshape(count * length, n, m)[:N]
    return joined


class Modes:
    """The same trajectories mode by mode, where the eigenvectors of A can be told apart: one filter for each mode.

    With real eigenvectors r, s of a complex pair, A [r s] = [r s] [[a, b], [-b, a]], the pair (x1, x2) is one complex
    mode w = x1 - i x2 of first order, w[k+1] = (a + i b) w[k] + f1[k] - i f2[k]. What drives x2 alone gives what
    drives x1 alone, turned by a right angle: both columns come of one filter. Modes that grow run backwards in time.

    Args:
        A: (n, n) state matrix.
        samples: number of samples N.

    Attributes:
        usable: whether the eigenvectors are well enough conditioned.
        V: (n, n) real eigenvectors, those of a pair side by side.
    """

    def __init__(self, A: FloatArray, samples: int) -> None:
        self.samples = samples
        z, E = np.linalg.eig(A)
        kept = z.imag >= 0.0
        self._z, self._first = z[kept], np.cumsum([0, *np.where(z[kept].imag > 0.0, 2, 1)])[:-1]
        columns = [part for v, pole in zip(E.T[kept], self._z, strict=True) for part in (v.real, v.imag)[: _size(pole)]]
        self.V = np.stack(columns, axis=1)
        self.usable = bool(np.linalg.cond(self.V) < _DISTINCT)
        self._limit = _GROWTH ** (1.0 / max(samples, 1))

    def run(self, f: FloatArray | ComplexArray | None) -> FloatArray:
        """Return modal states (n, N): driven by f (N,), f (modes, N) or, for None, released from 1 at rest.

        A pair's rows are Re w and -Im w of the complex mode.
        """
        out = np.zeros((self.V.shape[0], self.samples))
        for i, (z, at) in enumerate(zip(self._z, self._first, strict=True)):
            drive = np.eye(1, self.samples + 1)[0] if f is None else (f if f.ndim == 1 else f[i])
            pole = z if z.imag > 0.0 else z.real
            if z.imag == 0.0:
                drive = drive.real
            if abs(z) <= self._limit:
                w = lfilter([0.0, 1.0], [1.0, -pole], drive)
                w = w[1:] if f is None else w
            elif f is None:
                w = lfilter([0.0, 1.0], [1.0, -1.0 / pole], drive)[:0:-1]
            else:  # w[k] = (w[k+1] - f[k]) / z from w[N-1] = 0
                w = np.zeros(self.samples, dtype=np.result_type(pole, drive))
                w[:-1] = lfilter([-1.0 / pole], [1.0, -1.0 / pole], drive[-2::-1])[::-1]
            out[at] = w.real
            if z.imag > 0.0:
                out[at + 1] = -w.imag
        return out

    def drive(self, f: FloatArray) -> ComplexArray:
        """Return f1 - i f2 of every mode (modes, N), of a forcing (n, N) in modal coordinates."""
        pair = self._z.imag > 0.0
        out = f[self._first].astype(np.complex128)
        out[pair] -= 1j * f[self._first[pair] + 1]
        return out


def _size(z: complex) -> int:
    return 2 if z.imag > 0.0 else 1


def read_out(C: FloatArray, x: FloatArray) -> FloatArray:
    """Return C x (N, p, b) of trajectories (N, n, b)."""
    out: FloatArray = _times(C, x.transpose(1, 2, 0)).transpose(2, 0, 1)
    return out
