"""A model over its records in free run, whatever the method it came from: what it leaves, and how it moves.

    v = S b + X a + n,    n[k] = sum_j A[j] n[k - j] + e[k]

What a model leaves of the outputs is regressed on the slopes S of its parameters, and of the lateness of an input, and
on other columns X: generalised least squares with autoregressive noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular
from scipy.signal import lfilter

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.continuous import ContinuousTransferModel
from testbench.estimators.model import ComplexArray, IdentifiedModel
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.prediction_error import Layout, Matrices, orbit
from testbench.estimators.residuals import LARGEST_ORDER, Autoregression, autoregression
from testbench.estimators.state_space import StateSpaceModel
from testbench.estimators.transfer_function import TransferFunctionModel

_ARRAYS = ("params", "A", "B", "C", "D", "numerators", "denominators", "delays_s")  # what neighbours differ in
_STEP = 1e-5  # of a parameter's own size; simulations are exact to some 1e-12
_LATER, SOONEST = 0.1, 0.05  # of the lateness, over which its slope is taken; samples of delay or lag that are none


class Neighbour(NamedTuple):
    """The model ``model`` a ``step`` away, by one parameter: its name (or none), value and standard error (or NaN)."""

    name: str
    value: float
    error: float
    step: float
    model: IdentifiedModel


class Late(NamedTuple):
    """An input that acts later than it is logged: "delay", "lag" or "rate_limit", held between its samples or not.

    ``samples`` are those of the delay, of the lag, or that the limit takes over ``span``, the range of the input.
    """

    code: str
    name: str
    samples: float
    held: bool
    span: float = 0.0

    def acting(self, record: FlightRecord) -> FlightRecord:
        """Return the record with the input as it acts: at each sample, or over the one that it is held for."""
        u = record[self.name]
        return record.with_columns({self.name: getattr(self, f"_{self.code}")(u)})

    def _delay(self, u: FloatArray) -> FloatArray:
        at = np.arange(len(u))
        return np.asarray(np.interp(at - self.samples, at, u))

    def _lag(self, u: FloatArray) -> FloatArray:
        a = np.exp(-1.0 / self.samples)
        mean = self.samples * (1.0 - a)  # of what is left of the way to a new command over a sample
        if not self.held:
            return np.asarray(lfilter([1.0 - mean, mean - a], [1.0, -a], u, zi=[mean * u[0]])[0])
        x = lfilter([0.0, 1.0 - a], [1.0, -a], u, zi=[u[0]])[0]
        return np.asarray(u + mean * (x - u))

    def _rate_limit(self, u: FloatArray) -> FloatArray:
        most, x, out = max(self.span / self.samples, 1e-300), float(u[0]), u.copy()
        for k, way in enumerate(u.tolist()):
            left = way - x
            moved = min(max(left, -most), most)
            out[k] = way - 0.5 * left * abs(left) / most if abs(left) < most else x + 0.5 * moved
            x += moved
            if not self.held:
                out[k] = x
        return out

    def later(self, samples: float) -> Late:
        """Return the same, later by some samples, but never early."""
        return self._replace(samples=max(self.samples + samples, SOONEST))


@dataclass(frozen=True, eq=False)
class Flown:
    """A model over records, one of its inputs perhaps late, and how it moves with its parameters and the lateness.

    One array per record each: what it simulates (N, p), what it leaves (p, N), which samples count (N,).
    """

    model: IdentifiedModel
    records: list[FlightRecord]
    late: Late | None
    simulated: list[FloatArray]
    left: list[FloatArray]
    good: list[NDArray[np.bool_]]

    @classmethod
    def of(cls, model: IdentifiedModel, records: list[FlightRecord], late: Late | None = None) -> Flown:
        """Fly a model over records.

        Raises:
            EstimationError, ChannelError: what ``simulate`` of the model raises.
        """
        simulated = [model.simulate(r if late is None else late.acting(r)) for r in records]
        measured = [r.select(model.outputs) for r in records]
        good = [np.all(m.valid, axis=1) for m in measured]
        left = [((m.data - y) * g[:, None]).T for m, y, g in zip(measured, simulated, good, strict=True)]
        if not all(np.all(np.isfinite(v)) for v in left):
            raise EstimationError("a model must predict numbers over its records, got others")
        return cls(model, records, late, simulated, left, good)

    @cached_property
    def near(self) -> list[Neighbour]:
        """One for each way in which the model may move."""
        return list(neighbours(self.model))

    @cached_property
    def slopes(self) -> list[FloatArray]:
        """Per record (p, N, k), that by the lateness last."""
        late, out = self.late, []
        for record, y in zip(self.records, self.simulated, strict=True):
            given = record if late is None else late.acting(record)
            columns = [(self._beside(n.model, given, y) - y) / n.step for n in self.near]
            if late is not None:
                step = _LATER * late.samples
                columns.append((self.model.simulate(late.later(step).acting(record)) - y) / step)
            out.append(np.ascontiguousarray(np.stack(columns, axis=2).transpose(1, 0, 2)))
        return out

    def _beside(self, other: IdentifiedModel, record: FlightRecord, y: FloatArray) -> FloatArray:
        """Return what a neighbour simulates: of transfer functions, only the outputs whose coefficients differ anew."""
        here = self.model
        if not (isinstance(here, TransferFunctionModel) and isinstance(other, TransferFunctionModel)):
            return other.simulate(record)
        same = (here.numerators == other.numerators).all(axis=1) & (here.denominators == other.denominators).all(axis=1)
        out = y.copy()
        out[:, ~same] = other.simulate(record, ~same)
        return out

    def stepped(self, change: FloatArray) -> tuple[IdentifiedModel, Late | None]:
        """Return model and lateness after a change of the parameters, and of the lateness behind them."""
        return self.moved(change), None if self.late is None else self.late.later(float(change[len(self.near)]))

    def moved(self, change: FloatArray) -> IdentifiedModel:
        """Return the model after a change of its parameters, the first of ``change``."""
        arrays = {}
        for name in _ARRAYS:
            here = getattr(self.model, name, None)
            if isinstance(here, np.ndarray):
                each = zip(self.near, change, strict=False)
                arrays[name] = here + sum((c / n.step) * (getattr(n.model, name) - here) for n, c in each)
        if "delays_s" in arrays:  # no model answers before its input
            arrays["delays_s"] = np.maximum(arrays["delays_s"], 0.0)
        return replace(self.model, **arrays)


def neighbours(model: IdentifiedModel) -> Iterator[Neighbour]:
    """Yield one neighbour for each free parameter; for a state-space model for each direction that shows outside.

    A model of another class, such as a user's own, has none.
    """
    if isinstance(model, ParametricModel):
        error = np.sqrt(np.diag(model.covariance))
        for i in np.flatnonzero(model.structure.free & (error > 0.0)):
            value, params = float(model.params[i]), model.params.copy()
            step = _STEP * max(abs(value), float(error[i]))
            params[i] += step
            name = model.structure.parameter_names[i]
            yield Neighbour(name, value, float(error[i]), step, replace(model, params=params))
    elif isinstance(model, StateSpaceModel):
        n, m, p = model.order, len(model.inputs), len(model.outputs)
        layout = Layout(n, m, p, bool(np.any(model.D)), False, False)
        u, y = (
            1.0 / np.where(s > 0.0, s, 1.0)
            for s in (np.linalg.norm(model.B, axis=0), np.linalg.norm(model.C.T, axis=0))
        )
        scaled = Matrices(model.A, model.B * u, y[:, None] * model.C, y[:, None] * model.D * u, np.zeros((n, p)))
        for direction in orbit(scaled, layout).T:
            s = layout.moved(scaled, _STEP * direction)
            back = replace(model, A=s.A, B=s.B / u, C=s.C / y[:, None], D=s.D / y[:, None] / u)
            yield Neighbour("", 0.0, np.nan, _STEP, back)
    elif isinstance(model, TransferFunctionModel | ContinuousTransferModel):
        errors = getattr(model, "standard_errors", {})
        for key, at, name in _entries(model):
            array = getattr(model, key).copy()
            value = float(np.ravel(array[at])[0])
            step = _STEP * (model.dt_s if key == "delays_s" else float(np.max(np.abs(array[at]))) or 1.0)
            array[at] += step
            if key != "delays_s" or errors.get(name, 0.0) > 0.0:
                yield Neighbour(name, value, errors.get(name, np.nan), step, replace(model, **{key: array}))


def _entries(model: TransferFunctionModel | ContinuousTransferModel) -> Iterator[tuple[str, tuple[object, ...], str]]:
    """Yield the array, the place in it, and the name of each coefficient that is free."""
    n = model.denominators.shape[1] - 1
    if isinstance(model, TransferFunctionModel):
        yield from (("numerators", (i, k), "") for i, k in np.argwhere(model.numerators))
        yield from (("denominators", (i, k + 1), "") for i, k in np.argwhere(model.denominators[:, 1:]))
        return
    for i, output in enumerate(model.outputs):
        if not (model.common and i):
            for k in range(1, n + 1):
                at, name = ((slice(None), k), f"a{k}") if model.common else ((i, k), f"{output}: a{k}")
                yield "denominators", at, name
        for j, given in enumerate(model.inputs):
            for k in np.flatnonzero(model.numerators[i, j]).tolist():
                yield "numerators", (i, j, k), f"{output}/{given}: b{n - k}"
            yield "delays_s", (i, j), f"{output}/{given}: delay_s"


def all_poles(model: IdentifiedModel) -> ComplexArray:
    """Return the poles of all outputs in one array."""
    return np.concatenate([np.zeros(0, np.complex128), *model.poles().values()])


def feeds_through(model: IdentifiedModel) -> NDArray[np.bool_]:
    """Return (p,) which outputs answer an input in the same sample."""
    direct = np.zeros((len(model.outputs), 1))
    if isinstance(model, ParametricModel):
        direct = model.linear().D
    elif isinstance(model, StateSpaceModel):
        direct = model.D
    elif isinstance(model, ContinuousTransferModel):
        direct = model.numerators[:, :, 0] * (np.abs(model.denominators[:, :1]) > 0.0)
    return np.asarray(np.any(direct != 0.0, axis=1))


# --- regression of residuals whose noise is coloured: generalised least squares with autoregressive noise -------------


_ROUNDS = 3
_SETTLED = 0.01  # of the criterion, between two rounds
_DEPENDENT = 1e-6  # sine of the angle to the columns before below which a column adds nothing


class Regression(NamedTuple):
    """Coefficients b (d,), their standard deviations, what they leave of v per record (p, N), noise and criterion.

    ``criterion`` is -2 ln L with the penalty of Hannan and Quinn on the order of the noise.
    """

    b: FloatArray
    std: FloatArray
    left: list[FloatArray]
    noise: Autoregression
    criterion: float


def solved(Z: FloatArray, e: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients (d,) of e (n,) on Z (n, d), and their deviations for errors of unit size.

    Columns that add nothing to others have no coefficient, and zero deviation.
    """
    size = np.sqrt(np.sum(Z**2, axis=0))
    b, std = np.zeros(size.size), np.zeros(size.size)
    alive = np.flatnonzero(size > 0.0)
    if alive.size:
        Q, R, order = qr(Z[:, alive] / size[alive], mode="economic", pivoting=True)
        rank = int(np.sum(np.abs(np.diag(R)) > _DEPENDENT * abs(R[0, 0])))
        inverse = solve_triangular(R[:rank, :rank], np.eye(rank))
        at = alive[order[:rank]]
        b[at], std[at] = inverse @ (Q[:, :rank].T @ e) / size[at], np.sqrt(np.sum(inverse**2, axis=1)) / size[at]
    return b, std


def samples_lost(left: Sequence[FloatArray]) -> int:
    """Return how many samples at the start of every record only serve the autoregression."""
    lengths = [v.shape[1] for v in left]
    return max(0, min(LARGEST_ORDER, min(lengths) // 4, sum(lengths) // (10 * left[0].shape[0])))


def settled(good: NDArray[np.bool_], lost: int) -> NDArray[np.bool_]:
    """Return which samples (N,) are good and have ``lost`` good ones before them."""
    run = np.cumsum(np.concatenate([np.zeros(lost + 1), good]))
    return np.asarray((run[lost + 1 :] - run[: len(good)] == lost + 1) & (np.arange(len(good)) >= lost))


def whitened(
    noise: Autoregression, good: Sequence[NDArray[np.bool_]], signals: Sequence[FloatArray], lost: int
) -> FloatArray:
    """Return signals (p, N, d), one per record, as white (rows, d), the outputs of a sample together.

    What has died away before the first sample that counts is zero.
    """
    p, d = len(noise.S), signals[0].shape[2]
    inverse = np.linalg.inv(np.linalg.cholesky(noise.S + 1e-12 * np.trace(noise.S) * np.eye(p)))
    out, whole, here = [], np.zeros(d), np.zeros(d)
    for x, g in zip(signals, good, strict=True):
        counts = settled(g, lost)
        whole += np.sum(x**2, axis=(0, 1))
        here += np.sum(x[:, counts] ** 2, axis=(0, 1))
        e = x.copy()
        for j, A in enumerate(noise.A, start=1):
            e[:, j:] -= np.tensordot(A, x[:, :-j], 1)
        e = np.tensordot(inverse, e[:, counts], 1)
        out.append(e.transpose(1, 0, 2).reshape(e.shape[0] * e.shape[1], d))
    return np.vstack(out) * (here > _DEPENDENT**2 * whole)


def regress(at: Flown, columns: Sequence[FloatArray], twice: bool = False) -> Regression:
    """Return the regression of what a model leaves on columns X (p, N, d), one array per record.

    Regression and autoregression in turns (D. Cochrane and G. H. Orcutt, Journal of the American Statistical
    Association 44, 1949), from the residuals as they are; ``twice`` also from those that plain least squares leaves,
    and the better likelihood is kept: what drifts looks like noise of a long memory from the first, and a strong
    disturbance like signal from the second.

    Raises:
        EstimationError: no more samples are left than there are columns, as where outputs have other rates.
    """
    starts = [at.left] + ([plainly(at.left, at.good, columns)[1]] if twice and columns[0].shape[2] else [])
    return min((_in_turns(at, columns, left) for left in starts), key=lambda found: found.criterion)


def plainly(
    left: Sequence[FloatArray], good: Sequence[NDArray[np.bool_]], columns: Sequence[FloatArray]
) -> tuple[FloatArray, list[FloatArray]]:
    """Return the coefficients (d,) of ordinary least squares, outputs of unit size, and what they leave (p, N)."""
    size = np.sqrt(np.sum([np.sum(v**2, axis=1) for v in left], axis=0))
    noise = Autoregression(np.zeros((0, size.size, size.size)), np.diag(np.where(size > 0.0, size, 1.0) ** 2))
    b, _ = solved(whitened(noise, good, columns, 0), whitened(noise, good, [v[:, :, None] for v in left], 0)[:, 0])
    return b, [v - g * (X @ b) for v, g, X in zip(left, good, columns, strict=True)]


def _in_turns(at: Flown, columns: Sequence[FloatArray], left: Sequence[FloatArray]) -> Regression:
    p, lost, width, criterion = len(at.left[0]), samples_lost(at.left), columns[0].shape[2], np.inf
    longest = max(len(g) for g in at.good)
    if sum(int(settled(g, lost).sum()) for g in at.good) <= width:
        raise EstimationError(
            "residuals of coloured noise need samples of all outputs one after the other, got too few"
        )
    for _ in range(_ROUNDS):
        # Noise does not grow: else it would explain all that a model leaves that diverges.
        noise = autoregression([r.T for r in left], lost).damped(math.exp(-1.0 / longest))
        e = whitened(noise, at.good, [v[:, :, None] for v in at.left], lost)[:, 0]
        Z = whitened(noise, at.good, columns, lost)
        b, std = solved(Z, e)
        left = [v - g * (X @ b) for v, g, X in zip(at.left, at.good, columns, strict=True)]
        E = (e - Z @ b).reshape(-1, p) @ np.linalg.cholesky(noise.S + 1e-12 * np.trace(noise.S) * np.eye(p)).T
        n, last = len(E), criterion
        penalty = 2.0 * np.log(np.log(max(n, 3))) * len(noise.A) * p * p
        criterion = float(n * np.linalg.slogdet(E.T @ E / n)[1] + penalty)
        if width == 0 or not abs(last - criterion) > _SETTLED:
            break
    return Regression(b, std, list(left), noise, criterion)


class Beside:
    """What white columns (n, d) leave of white residuals (n,), and of further columns."""

    def __init__(self, Z: FloatArray, e: FloatArray) -> None:
        size = np.sqrt(np.sum(Z**2, axis=0))
        Q, R, _ = qr(Z[:, size > 0.0] / size[size > 0.0], mode="economic", pivoting=True)
        self.rank = int(np.sum(np.abs(np.diag(R)) > _DEPENDENT))
        self.Q = Q[:, : self.rank]
        self.e = e - self.Q @ (self.Q.T @ e)
        self.square = float(self.e @ self.e)

    def beside(self, Z: FloatArray) -> tuple[float, int]:
        """Return the sum of squares that is left with further columns (n, k), and the rank of all."""
        if not Z.size:
            return self.square, self.rank
        size = np.sqrt(np.sum(Z**2, axis=0))
        Z = Z / np.where(size > 0.0, size, 1.0)
        Q, R, _ = qr(Z - self.Q @ (self.Q.T @ Z), mode="economic", pivoting=True)
        rank = int(np.sum(np.abs(np.diag(R)) > _DEPENDENT))
        return self.square - float(np.sum((Q[:, :rank].T @ self.e) ** 2)), self.rank + rank
