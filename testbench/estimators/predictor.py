"""One-step prediction errors of a discrete state-space model, and their exact derivatives by all its entries."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.state_space import Series
from testbench.estimators.trajectories import Trajectories, carried

_GROWTH = 1e3  # over a series, beyond which digits are lost in a recursion forwards


class Matrices(NamedTuple):
    """x[k+1] = A x + B u + K e, y = C x + D u + e."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    K: FloatArray


class Layout(NamedTuple):
    """Order n, inputs m, outputs p, and what is free besides A, B and C: D, K, a constant per output and record.

    Entries stand in the order A, B, C, D, K, each row by row, those that are not free left out; then, per record, the
    initial state and the constants.
    """

    n: int
    m: int
    p: int
    direct: bool
    disturbances: bool
    offsets: bool

    @property
    def nuisances(self) -> int:
        """Unknowns of one record."""
        return self.n + (self.p if self.offsets else 0)

    @property
    def shapes(self) -> list[tuple[int, int]]:
        """Shapes of A, B, C, D and K; without entries where not free."""
        n, m, p = self.n, self.m, self.p
        return [(n, n), (n, m), (p, n), (p if self.direct else 0, m), (n if self.disturbances else 0, p)]

    @property
    def size(self) -> int:
        """Number of free entries."""
        return sum(a * b for a, b in self.shapes)

    @property
    def size_abcd(self) -> int:
        """Number of free entries without K."""
        return sum(a * b for a, b in self.shapes[:4])

    def moved(self, s: Matrices, step: FloatArray) -> Matrices:
        """Return the matrices with ``step`` (size,) added to their free entries."""
        parts = np.split(step, np.cumsum([a * b for a, b in self.shapes])[:-1])
        return Matrices(*(M + part.reshape(M.shape) if part.size else M for M, part in zip(s, parts, strict=True)))

    def vector(self, s: Matrices) -> FloatArray:
        """Return the free entries (size,)."""
        return np.concatenate([M.ravel() for M, (a, b) in zip(s, self.shapes, strict=True) if a * b])

    def units(self, size_u: FloatArray, size_y: FloatArray) -> FloatArray:
        """Return (size,) what an entry for channels divided by their sizes is multiplied by for SI units."""
        n, one = self.n, np.ones(self.n)
        y = size_y[:, None]
        full = Matrices(np.ones((n, n)), one[:, None] / size_u, y * one, y / size_u, one[:, None] / size_y)
        return self.vector(full)

    def with_direct(self, covariance: FloatArray) -> FloatArray:
        """Return a covariance of A, B, C and D with zeros for D where it is not free."""
        missing = 0 if self.direct else self.p * self.m
        return np.pad(covariance, (0, missing))


class Run(NamedTuple):
    """Errors e (N, p), zero where not measured, states x (N, n), and derivatives de (N, p, size + nuisances)."""

    e: FloatArray
    x: FloatArray
    de: FloatArray


def errors(s: Matrices, series: Series, nuisance: FloatArray, layout: Layout, derivatives: bool = False) -> Run:
    """Return one-step prediction errors over a series from the initial state and constants in ``nuisance``.

    The predictor x+ = (A - K M C) x + (B - K M D) u + K M (y - o), M = 1 where measured, is linear, and its
    sensitivities obey the same recursion with other inputs: sample by sample all of them at once, or, where it grows
    over the series, by :class:`.trajectories.Trajectories` in numbers that stay bounded (all outputs measured).

    Raises:
        EstimationError: it grows so fast that its initial state leaves nothing to be seen at the first sample.
    """
    u, y, valid = series
    n, p, N = layout.n, layout.p, len(u)
    x0, o = nuisance[:n], nuisance[n:] if layout.offsets else np.zeros(p)
    mask = valid.astype(float)
    rest = mask * (y - u @ s.D.T - o)
    A = s.A - np.einsum("ij,kj,jl->kil", s.K, mask, s.C)
    paths, free = None, np.zeros((0, n, n))
    if valid.all() and N * np.log(max(np.max(np.abs(np.linalg.eigvals(A[0]))), 1e-300)) > np.log(_GROWTH):
        paths = Trajectories(A[0], N)
        free = paths.free()
        try:
            free = free @ np.linalg.inv(free[0])
        except np.linalg.LinAlgError:
            said = "the predictor grows so fast that no initial state can be found; lower the order"
            raise EstimationError(said) from None

    def path(drive: FloatArray, first: FloatArray) -> FloatArray:
        """Return x (N, n, b) from ``first`` (n, b) under the drive (N, n, b)."""
        if paths is not None:
            out = paths.forced(drive)
            return np.asarray(out + np.matmul(free, first - out[0]))
        return carried(A, drive, first)

    x = path((u @ s.B.T + rest @ s.K.T)[:, :, None], x0[:, None])[:, :, 0]
    e = rest - mask * (x @ s.C.T)
    if not derivatives:
        return Run(e, x, np.zeros((N, p, 0)))
    force, direct = _forces(x, u, e, layout)
    force -= np.matmul(s.K, mask[:, :, None] * direct)
    first = np.zeros((n, force.shape[2]))
    first[:, layout.size : layout.size + n] = np.eye(n)
    dx = path(force, first)
    return Run(e, x, -mask[:, :, None] * (np.matmul(s.C, dx) + direct))


def _forces(x: FloatArray, u: FloatArray, e: FloatArray, layout: Layout) -> tuple[FloatArray, FloatArray]:
    """Return what each unknown adds to x+ at given e, (N, n, b), and to the predicted output at given x, (N, p, b)."""
    N, n, p = len(x), layout.n, layout.p

    def spread(rows: int, signal: FloatArray) -> FloatArray:
        return np.einsum("ij,ks->kijs", np.eye(rows), signal).reshape(N, rows, -1)

    states = [(x, True), (u, True), (x, False), (u, False), (e, True)]
    force, direct = [], []
    for (signal, drives), (rows, columns) in zip(states, layout.shapes, strict=True):
        if not rows * columns:
            continue
        part, none = spread(rows, signal), np.zeros((N, p if drives else n, rows * columns))
        force.append(part if drives else none)
        direct.append(none if drives else part)
    force.append(np.zeros((N, n, layout.nuisances)))
    constants = np.zeros((N, p, layout.nuisances))
    if layout.offsets:
        constants[:, :, n:] = np.eye(p)
    direct.append(constants)
    return np.concatenate(force, axis=2), np.concatenate(direct, axis=2)


def orbit(s: Matrices, layout: Layout) -> FloatArray:
    """Return a basis (size, size - n^2) of the changes of the entries that no change of the states' basis makes.

    A change x -> (I + E) x adds E A - A E, E B, -C E, 0 and E K; the basis is orthonormal and orthogonal to these.
    """
    n = layout.n
    tangent = np.zeros((layout.size, n * n))
    for j in range(n * n):
        E = np.zeros((n, n))
        E.flat[j] = 1.0
        tangent[:, j] = layout.vector(Matrices(E @ s.A - s.A @ E, E @ s.B, -s.C @ E, np.zeros_like(s.D), E @ s.K))
    return np.asarray(np.linalg.qr(tangent, mode="complete")[0][:, n * n :])
