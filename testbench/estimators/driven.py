"""The modes of a linear recursion, driven by every input alone and released: rows of one regression for all outputs.

Every output is a combination of the same signals: each mode driven by each input alone, each mode released from 1 at
rest, offsets and trends, and the inputs themselves. Least squares over all outputs together then needs the R factor
of those signals and of the outputs, once for all outputs that were sampled at the same times.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.signal import lfilter

from testbench.core.record import FloatArray
from testbench.estimators.hankel import TALL, cholesky_factor, fold
from testbench.estimators.model import ComplexArray
from testbench.estimators.trajectories import Modes

_BLOCK = 16  # samples that one product of matrices runs a mode over
_CHUNK = 2048  # samples whose signals are held at once
_GROWTH = 1e3  # over the record, beyond which a mode is run backwards
_NOTHING = 1e-200  # states below this are zero: denormal numbers are slow
_CLEAR = 1e-4  # least share of an output that the signals must leave for a Gram matrix to keep enough digits


class Series(NamedTuple):
    """Inputs (N, m), outputs (N, p) and which outputs count (N, p), of one stretch of uniform samples."""

    u: FloatArray
    y: FloatArray
    valid: NDArray[np.bool_]


class DrivenModes:
    """Modes w[k+1] = z w[k] + f[k], driven by each input alone and released from 1, a block of samples at a time.

    Within a block, w[k + b] = z^b w[k] + sum over c < b of z^(b-1-c) f[k + c] is a product with a constant matrix; only
    the states at the beginning of the blocks are run one after the other. Modes that grow over the record are run
    backwards in time, by :class:`Modes`.

    Args:
        A: (n, n) state matrix with eigenvectors that can be told apart.
        modes: of A, over the samples of u.
        u: (N, m) inputs.

    Attributes:
        n: number of states.
        signals: n (m + 1), the rows that :meth:`write` writes.
        sizes: rows of each mode in turn, 2 for a complex pair.
    """

    def __init__(self, A: FloatArray, modes: Modes, u: FloatArray) -> None:
        self._u, self.n, self.signals = u, len(A), len(A) * (u.shape[1] + 1)
        self._whole: list[FloatArray] | None = None
        poles = np.linalg.eig(A)[0]
        z = poles[poles.imag >= 0.0]
        self.sizes = [2 if pole.imag > 0.0 else 1 for pole in z]
        if np.any(len(u) * np.log(np.maximum(np.abs(z), _NOTHING)) > np.log(_GROWTH)):
            self._whole = [modes.run(None)] + [modes.run(np.ascontiguousarray(f)) for f in u.T]
            return
        powers = np.concatenate([np.zeros((z.size, _BLOCK)), z[:, None] ** np.arange(_BLOCK)], axis=1)
        lag = np.arange(_BLOCK) - np.arange(_BLOCK)[:, None] + _BLOCK  # place of z^(b - c), 0 for b < c
        into = powers[:, lag - 1]  # (modes, c, b): of f[k + c] into w[k + b]
        self._T = np.zeros((self.n, _BLOCK + 2 * z.size, _BLOCK))
        row = 0
        for i, pole in enumerate(z):
            free = powers[i, _BLOCK:]
            col = _BLOCK + 2 * i
            self._T[row, :_BLOCK], self._T[row, col], self._T[row, col + 1] = into[i].real, free.real, -free.imag
            if pole.imag > 0.0:  # the second row of a pair is -Im w
                self._T[row + 1, :_BLOCK], self._T[row + 1, col], self._T[row + 1, col + 1] = (
                    -into[i].imag,
                    -free.imag,
                    -free.real,
                )
            row += 2 if pole.imag > 0.0 else 1
        self._starts = self._block_states(z, powers[:, : _BLOCK - 1 : -1])

    def _block_states(self, z: ComplexArray, powers: ComplexArray) -> FloatArray:
        """Return Re and Im of all modes at the beginning of all blocks, (m + 1, blocks, 2 modes)."""
        blocks = -(-len(self._u) // _BLOCK)
        onto = np.stack([powers.real, powers.imag], axis=2).transpose(1, 0, 2).reshape(_BLOCK, -1)
        x = np.zeros((self._u.shape[1] + 1, blocks + 1, 2 * z.size))
        x[0, 0, ::2] = 1.0
        for k in range(0, blocks, _CHUNK):
            part = self._inputs(k * _BLOCK, min((k + _CHUNK) * _BLOCK, len(self._u)))
            x[1:, k + 1 : k + 1 + part.shape[1]] = part @ onto
        out = x[:, :-1]
        for i, pole in enumerate(z):
            here = slice(2 * i, 2 * i + 2)
            leap = pole**_BLOCK
            if pole.imag == 0.0:
                out[:, :, 2 * i] = lfilter([1.0], [1.0, -leap.real], out[:, :, 2 * i], axis=1)
            else:
                f = np.ascontiguousarray(out[:, :, here]).view(np.complex128)[:, :, 0]
                out[:, :, here] = lfilter([1.0], [1.0, -leap], f, axis=1).view(np.float64).reshape(*f.shape, 2)
        out[np.abs(out) < _NOTHING] = 0.0
        return out

    def _inputs(self, begin: int, end: int) -> FloatArray:
        """Return the inputs (m, blocks, B), the last block filled up with zeros."""
        blocks = -(-(end - begin) // _BLOCK)
        out = np.zeros((self._u.shape[1], blocks * _BLOCK))
        out[:, : end - begin] = self._u[begin:end].T
        return out.reshape(len(out), blocks, _BLOCK)

    def write(self, begin: int, end: int, out: FloatArray) -> None:
        """Write the signals of samples ``begin`` (a multiple of the block) to ``end`` into rows of ``out``.

        Row r (m + 1) + j holds modal state r, released for j = 0, driven by input j - 1 else; columns beyond ``end``
        hold nothing of use. A pair's rows are Re w and -Im w.
        """
        if self._whole is not None:
            rows = out[: self.signals].reshape(self.n, len(self._whole), -1)
            for j, states in enumerate(self._whole):
                rows[:, j, : end - begin] = states[:, begin:end]
            return
        part = self._inputs(begin, end)
        blocks = part.shape[1]
        left = np.zeros((len(part) + 1, blocks, self._T.shape[1]))
        left[1:, :, :_BLOCK] = part
        left[:, :, _BLOCK:] = self._starts[:, begin // _BLOCK :][:, :blocks]
        for r, T in enumerate(self._T):
            target = out[r * len(left) : (r + 1) * len(left)].reshape(-1, _BLOCK)
            np.matmul(left.reshape(len(target), -1), T, out=target)


def output_rows(
    A: FloatArray,
    C: FloatArray,
    modes: Modes,
    series: Series,
    through: NDArray[np.intp],
    lead: int,
) -> list[FloatArray]:
    """Return, per output, rows R with R'R the Gram matrix of its regression over its valid samples.

    Columns: initial modal state (n), offsets and trends (lead p, of which this output has its own), B (m n, input by
    input, of the states, not of the modes), D (through p, input by input), y.

    Args:
        A: (n, n) state matrix.
        C: (p, n) output matrix.
        modes: of A, over the N samples.
        series: inputs and outputs.
        through: inputs with a column in D.
        lead: 0, 1 or 2, see :func:`testbench.estimators.state_space.fit_inputs`.
    """
    u, y, valid = series
    driven = DrivenModes(A, modes, u)
    width = driven.signals + lead + through.size
    out: list[FloatArray] = [np.zeros((0, 0))] * y.shape[1]
    maps = _maps(C @ modes.V, np.linalg.inv(modes.V), driven, through.size, lead)
    line = np.linspace(-1.0, 1.0, len(u)) if lead == 2 else None
    for group in _sampled_together(valid):
        counted = None if valid[:, group[0]].all() else valid[:, group[0]]

        def chunks(group: list[int] = group, counted: NDArray[np.bool_] | None = counted) -> Iterator[FloatArray]:
            for begin in range(0, len(u), _CHUNK):
                end = min(begin + _CHUNK, len(u))
                rows = np.empty((width + len(group), -(-(end - begin) // _BLOCK) * _BLOCK))
                driven.write(begin, end, rows)
                rows = rows[:, : end - begin]
                if lead:
                    rows[driven.signals] = 1.0
                if line is not None:
                    rows[driven.signals + 1] = line[begin:end]
                rows[driven.signals + lead : width] = u[begin:end, through].T
                rows[width:] = y[begin:end, group].T
                yield rows if counted is None else rows[:, counted[begin:end]]

        R11, R12, rest = _factor(chunks, width, len(group), len(u) if counted is None else int(counted.sum()))
        for at, i in enumerate(group):
            out[i] = np.zeros((len(R11) + 1, maps[i].shape[1] + 1))
            out[i][:-1, :-1], out[i][:-1, -1], out[i][-1, -1] = R11 @ maps[i], R12[:, at], rest[at]
    return out


def released(A: FloatArray, C: FloatArray, modes: Modes, samples: int, start: FloatArray) -> FloatArray:
    """Return the outputs (samples, p) from the initial modal state ``start`` (n,) of :func:`output_rows`."""
    driven = DrivenModes(A, modes, np.zeros((samples, 0)))
    weights = np.stack([M @ start for M in _maps(C @ modes.V, np.linalg.inv(modes.V), driven, 0, 0)])
    out = np.empty((samples, len(C)))
    for begin in range(0, samples, _CHUNK):
        end = min(begin + _CHUNK, samples)
        rows = np.empty((driven.signals, -(-(end - begin) // _BLOCK) * _BLOCK))
        driven.write(begin, end, rows)
        out[begin:end] = (weights @ rows[:, : end - begin]).T
    return out


def _sampled_together(valid: NDArray[np.bool_]) -> list[list[int]]:
    """Return the outputs in groups with the same valid samples."""
    if valid.all():
        return [list(range(valid.shape[1]))]
    groups: dict[bytes, list[int]] = {}
    for i, column in enumerate(valid.T):
        groups.setdefault(np.packbits(column).tobytes(), []).append(i)
    return list(groups.values())


def _factor(
    chunks: Callable[[], Iterator[FloatArray]], width: int, outputs: int, samples: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the triangle R11 of the signals, R12 of the outputs (one column each) and what they leave of each.

    By way of the Gram matrix, where neither signals nor residuals lose their digits by it (see ``hankel``).
    """
    both = width + outputs
    if samples >= TALL * both:
        G = np.zeros((both, both))
        for rows in chunks():
            G += rows @ rows.T
        R11 = cholesky_factor(G[:width, :width])
        if R11 is not None:
            silent = np.diag(R11) == 0.0
            R12 = solve_triangular(R11 + np.diag(silent.astype(float)), G[:width, width:], trans="T")
            total = np.diag(G)[width:]
            rest = total - np.sum(R12**2, axis=0)
            if np.all(rest > _CLEAR**2 * total):
                return R11, R12, np.sqrt(rest)
    R = np.zeros((0, both))
    for rows in chunks():
        R = fold(R, rows.T)
    R = np.vstack([R, np.zeros((both - len(R), both))])
    return R[:width, :width], R[:width, width:], np.sqrt(np.sum(R[width:, width:] ** 2, axis=0))


def _maps(CV: FloatArray, Vinv: FloatArray, driven: DrivenModes, through: int, lead: int) -> list[FloatArray]:
    """Return, per output, what the unknowns make of the signals, (signals + lead + through, unknowns)."""
    p, n = CV.shape
    inputs = driven.signals // n - 1
    own = n + lead * p
    out = []
    for i, c in enumerate(CV):
        M = np.zeros((driven.signals + lead + through, own + n * inputs + through * p))
        N = np.zeros((n, n))  # modal states of one input -> this output, per unit of drive on each modal coordinate
        at = 0
        for size in driven.sizes:
            N[at : at + size, at : at + size] = [[c[at]]] if size == 1 else [[c[at], c[at + 1]], [c[at + 1], -c[at]]]
            at += size
        M[: driven.signals : inputs + 1, :n] = N
        for j in range(inputs):
            M[j + 1 : driven.signals : inputs + 1, own + n * j : own + n * (j + 1)] = N @ Vinv
        for k in range(lead):
            M[driven.signals + k, n + k * p + i] = 1.0
        for k in range(through):
            M[driven.signals + lead + k, own + n * inputs + p * k + i] = 1.0
        out.append(M)
    return out
