"""StateSpaceModel: a discrete innovations model, simulated from its inputs with the initial state estimated.

The modes of a linear recursion, driven by every input alone and released: rows of one regression for all outputs.

Every output is a combination of the same signals: each mode driven by each input alone, each mode released from 1 at
rest, offsets and trends, and the inputs themselves. Least squares over all outputs together then needs the R factor
of those signals and of the outputs, once for all outputs that were sampled at the same times.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.signal import lfilter

from testbench.core.advice import as_json
from testbench.core.errors import EstimationError, RecordError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.words import array_found
from testbench.estimators.hankel import TALL, cholesky_factor, fold, triangle
from testbench.estimators.model import ComplexArray, IdentifiedModel, continuous_poles
from testbench.estimators.trajectories import Modes, Trajectories, read_out

# --- the modes of a linear recursion, driven by every input alone and released ----------------------------------------


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
    A: FloatArray, C: FloatArray, modes: Modes, series: Series, through: NDArray[np.intp], lead: int
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


# --- the state-space model --------------------------------------------------------------------------------------------


_RCOND = 1e-12
_AT_ONCE = 5000  # samples folded into a triangle at once


class Rows(NamedTuple):
    """R factors of one series' regressions, and their sizes."""

    # per output (r, own + count + 1), see :func:`fit_inputs`: own unknowns of the series, B and D, y
    R: list[FloatArray]
    own: int  # number of unknowns of this series alone
    counts: NDArray[np.int_]  # (p,) valid samples per output


class InputFit(NamedTuple):
    """What :func:`fit_inputs` found: B (n, m), D (p, m) and R, with || R [parameters; -1] || the output error.

    ``rows`` holds the same per series and output, initial states not yet eliminated.
    """

    B: FloatArray
    D: FloatArray
    R: FloatArray
    rows: list[Rows]

    def error(self, B: FloatArray, D: FloatArray, direct: NDArray[np.bool_]) -> float:
        """Return the summed squared output error of other matrices B, D on the same data, initial states re-fitted."""
        return float(np.sum((self.R @ _parameters(B, D, direct)) ** 2))

    def free_run_errors(self, B: FloatArray, D: FloatArray, direct: NDArray[np.bool_]) -> FloatArray:
        """Return the squared errors (p,) that :func:`free_run` leaves with other B, D, summed over all series."""
        out = np.zeros(len(D))
        for R, own, counts in self.rows:
            left = [r[:, own:] @ _parameters(B, D, direct) for r in R]
            size = np.array([np.sqrt(np.sum(r[:, -1] ** 2) / max(n, 1)) for r, n in zip(R, counts, strict=True)])
            weight = 1.0 / np.where(size > 0.0, size, 1.0)
            free = np.vstack([r[:, :own] * w for r, w in zip(R, weight, strict=True)])
            target = np.concatenate([e * w for e, w in zip(left, weight, strict=True)])
            start = np.linalg.lstsq(free, -target, rcond=_RCOND)[0]
            out += [np.sum((e + r[:, :own] @ start) ** 2) for e, r in zip(left, R, strict=True)]
        return out


def _parameters(B: FloatArray, D: FloatArray, direct: NDArray[np.bool_]) -> FloatArray:
    return np.concatenate([B.T.ravel(), D[:, direct].T.ravel(), [-1.0]])


def trend_columns(samples: int, p: int, lead: int) -> FloatArray:
    """Return (N, p, lead p): a constant (lead = 1) and a line from -1 to 1 (lead = 2) of each output's own."""
    terms = np.stack([np.ones(samples), np.linspace(-1.0, 1.0, samples)], axis=1)[:, :lead]
    return np.einsum("kl,ij->kilj", terms, np.eye(p)).reshape(samples, p, lead * p)


def fit_inputs(
    A: FloatArray, C: FloatArray, series: Sequence[Series], direct: NDArray[np.bool_], lead: int = 0
) -> InputFit:
    """Return B and D that minimise the output error for given A and C, the initial states of all series eliminated.

    Linear least squares of y[k] = C A^k x0 + C sum_j A^(k-1-j) B u[j] + D u[k] over all valid samples of all series.

    Args:
        A: (n, n) state matrix.
        C: (p, n) output matrix.
        series: the data; outputs weigh as they are scaled.
        direct: (m,) True for the inputs that have a column in D; the other columns of D are zero.
        lead: 1 if each series has an offset of its own in every output, 2 if it has a linear trend too.

    Raises:
        EstimationError: fewer valid output samples than unknowns.
    """
    n, p, m = A.shape[0], C.shape[0], direct.size
    through = np.flatnonzero(direct)
    count = n * m + p * through.size
    own = n + lead * p  # unknowns of each series alone
    R, found, samples = np.zeros((0, count + 1)), [], 0
    for part in series:
        valid, modes = part.valid, Modes(A, len(part.u))
        rows = output_rows(A, C, modes, part, through, lead) if modes.usable else _plain_rows(A, C, part, through, lead)
        found.append(Rows(rows, own, valid.sum(axis=0)))
        if valid.sum() > own:
            samples += int(valid.sum()) - own
            R = triangle(R, triangle(np.zeros((0, own + count + 1)), np.vstack(rows))[own:, own:])
    if samples < count:
        raise EstimationError(
            f"B and D need at least {count} samples beyond the initial states, got {samples}; give more data"
        )
    parameters = np.linalg.lstsq(R[:, :-1], R[:, -1], rcond=_RCOND)[0]
    B = parameters[: n * m].reshape(m, n).T
    D = np.zeros((p, m))
    D[:, through] = parameters[n * m :].reshape(through.size, p).T
    return InputFit(B, D, R, found)


def _plain_rows(A: FloatArray, C: FloatArray, series: Series, through: NDArray[np.intp], lead: int) -> list[FloatArray]:
    """Return what :func:`output_rows` does, for an A whose modes cannot be told apart: every state on its own."""
    u, y, valid = series
    n, p, m = A.shape[0], C.shape[0], u.shape[1]
    own, count = n + lead * p, n * m + p * through.size
    paths = Trajectories(A, len(u))
    driven = [paths.free()] + [paths.forced(u[:, j, None, None] * np.eye(n)) for j in range(m)]
    out = [np.zeros((0, own + count + 1))] * p
    line = trend_columns(len(u), p, lead)
    for k in range(0, len(u), _AT_ONCE):
        part = slice(k, min(k + _AT_ONCE, len(u)))
        block = np.zeros((part.stop - k, p, own + count + 1))
        block[:, :, n:own] = line[part]
        for j in range(m + 1):
            at = own + n * (j - 1) if j else 0
            block[:, :, at : at + n] = read_out(C, driven[j][part])
        for i, column in enumerate(through):
            at = own + n * m + p * i
            block[:, range(p), range(at, at + p)] = u[part, column, None]
        block[:, :, -1] = y[part]
        out = [fold(R, block[valid[part, i], i]) for i, R in enumerate(out)]
    return out


def free_run(A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, series: Series, lead: int = 0) -> FloatArray:
    """Return the outputs (N, p) driven by the inputs, from the initial state that fits the valid outputs best.

    Linear least squares; each output weighted by the inverse of its root mean square. ``lead`` as in
    :func:`fit_inputs`: offsets and trends of the outputs that are fitted along.
    """
    u, y, valid = series
    modes, p = Modes(A, len(u)), len(C)
    none, silent = np.zeros(0, np.intp), np.zeros((len(u), 0))
    if modes.usable:
        forced = (C @ modes.V @ modes.run(modes.drive(np.linalg.solve(modes.V, B) @ u.T))).T + u @ D.T
        rows = output_rows(A, C, modes, Series(silent, y - forced, valid), none, lead)
    else:
        paths = Trajectories(A, len(u))
        forced = paths.forced((u @ B.T)[:, :, None])[:, :, 0] @ C.T + u @ D.T
        rows = _plain_rows(A, C, Series(silent, y - forced, valid), none, lead)
    counts = np.maximum(valid.sum(axis=0), 1)
    size = np.sqrt(np.sum(y**2, axis=0, where=valid) / counts)
    both = np.vstack([R / (s if s > 0.0 else 1.0) for R, s in zip(rows, size, strict=True)])
    start = np.linalg.lstsq(both[:, :-1], both[:, -1], rcond=_RCOND)[0]
    if modes.usable:
        forced += released(A, C, modes, len(u), start[: len(A)])
    else:
        forced += paths.free() @ start[: len(A)] @ C.T
    if lead:
        forced += trend_columns(len(u), p, lead) @ start[len(A) :]
    return forced


@dataclass(frozen=True, eq=False, kw_only=True)
class StateSpaceModel(IdentifiedModel):
    """x[k+1] = A x[k] + B u[k] + K e[k], y[k] = C x[k] + D u[k] + e[k] (EOLO paper, equation 2, with D).

    Inputs and outputs are deviations from trim in SI units; the states have no physical meaning of their own.

    Attributes:
        A: (n, n) state matrix.
        B: (n, m) input matrix.
        C: (p, n) output matrix.
        D: (p, m) direct feedthrough.
        K: (n, p) gain of the innovations e; zeros if the estimator gives none.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    K: FloatArray = field(default=None)  # type: ignore[arg-type]

    def __post_init__(self) -> None:
        n, m, p = np.atleast_2d(self.A).shape[0], len(self.inputs), len(self.outputs)
        if self.K is None:
            object.__setattr__(self, "K", np.zeros((n, p)))
        for name, shape in (("A", (n, n)), ("B", (n, m)), ("C", (p, n)), ("D", (p, m)), ("K", (n, p))):
            matrix = np.array(getattr(self, name), dtype=np.float64)
            if matrix.shape != shape or not np.all(np.isfinite(matrix)):
                raise EstimationError(f"{name} must be finite and of shape {shape}, got {array_found(matrix)}")
            matrix.setflags(write=False)
            object.__setattr__(self, name, matrix)

    @property
    def order(self) -> int:
        """Number of states n."""
        return self.A.shape[0]

    def simulate(self, record: FlightRecord) -> FloatArray:
        """Return the free-run outputs (N, p): the record's inputs, and the initial state that fits its outputs best.

        The initial state is a linear least-squares estimate over all valid output samples. For a model with unstable
        modes it is carried by the end of the record (see :class:`Trajectories`), which is the same estimate in
        numbers that do not overflow.

        Raises:
            ChannelError: the record lacks an input or output of the model.
            RecordError: its sample time differs from the model's by more than 1 %.
        """
        check_sample_time(record, self.dt_s)
        u, y = record.columns(self.inputs), record.columns(self.outputs)
        series = Series(u, y, np.asarray(record.select(self.outputs).valid))
        return free_run(self.A, self.B, self.C, self.D, series)

    def poles(self) -> dict[str, ComplexArray]:
        """Return the continuous-time poles ln(z)/dt in rad/s under all outputs' names joined by ", "."""
        return {
            ", ".join(self.outputs): continuous_poles(np.linalg.eigvals(self.A).astype(np.complex128), self.dt_s)[0]
        }

    def frequency_response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Return C (zI - A)^-1 B + D at z = exp(j w dt), shape (k, p, m).

        Raises:
            EstimationError: a frequency lies above the Nyquist frequency pi/dt, or on a pole of the model.
        """
        z = unit_circle(omega_rad_s, self.dt_s)
        try:
            inner = np.linalg.solve(z[:, None, None] * np.eye(self.order) - self.A, self.B.astype(complex))
        except np.linalg.LinAlgError as error:
            raise EstimationError(
                "the frequency response is infinite at a pole; choose frequencies off the poles"
            ) from error
        return np.asarray(self.C @ inner + self.D, dtype=np.complex128)

    def to_dict(self) -> dict[str, Any]:
        """Return names, sample time, matrices (lists of rows), settings, status and advice as JSON values."""
        matrices = {name: getattr(self, name).tolist() for name in "ABCDK"}
        return {**description(self), **matrices}

    def to_control(self) -> Any:
        """Return the model from inputs to outputs as ``control.StateSpace`` with signal names."""
        import control

        return control.ss(
            self.A, self.B, self.C, self.D, self.dt_s, inputs=list(self.inputs), outputs=list(self.outputs)
        )


def description(model: IdentifiedModel) -> dict[str, Any]:
    """Return what every model's ``to_dict`` begins with, as JSON values."""
    return {
        "method": model.method,
        "time": "continuous" if model.continuous else "discrete",
        "inputs": list(model.inputs),
        "outputs": list(model.outputs),
        "dt_s": model.dt_s,
        "settings": dict(model.settings),
        "status": model.status,
        "advice": as_json(model.advice),
    }


def check_sample_time(record: FlightRecord, dt_s: float) -> None:
    """Check that a record can drive a model of sample time ``dt_s``.

    Raises:
        RecordError: the sample times differ by more than 1 %.
    """
    if abs(record.dt_s - dt_s) > 0.01 * dt_s:
        raise RecordError(
            f"record and model must share their sample time, got {record.dt_s:g} s and {dt_s:g} s; "
            "resample the record or identify at its rate"
        )


def unit_circle(omega_rad_s: FloatArray, dt_s: float) -> ComplexArray:
    """Return exp(j w dt) for frequencies (k,) up to the Nyquist frequency.

    Raises:
        EstimationError: a frequency lies above pi/dt, where a discrete model says nothing.
    """
    omega = np.atleast_1d(np.asarray(omega_rad_s, dtype=np.float64))
    if omega.size and np.max(np.abs(omega)) > np.pi / dt_s * (1.0 + 1e-9):
        raise EstimationError(
            f"a discrete model answers up to its Nyquist frequency {np.pi / dt_s:.4g} rad/s, "
            f"got {np.max(np.abs(omega)):.4g} rad/s; shorten the frequency grid"
        )
    return np.exp(1j * omega * dt_s)
