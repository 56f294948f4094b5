"""What a cause would leave in the residuals of a model: regressors of delays, lags, bends, drifts, missing states.

How the simulated outputs of an identified model move with its parameters, whatever the method it came from.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.causes.coloured_fit import (
    Stretch,
)
from testbench.estimators.continuous import ContinuousTransferModel
from testbench.estimators.discrete_transfer import TransferFunctionModel
from testbench.estimators.model import ComplexArray, IdentifiedModel
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.prediction_error import Layout, Matrices, orbit
from testbench.estimators.state_space import StateSpaceModel

_ARRAYS = ("params", "A", "B", "C", "D", "numerators", "denominators", "delays_s")  # what neighbours differ in
_STEP = 1e-5  # of a parameter's own size; simulations are exact to some 1e-12


class Direction(NamedTuple):
    """One way in which a model may move.

    Attributes:
        name: of the parameter; empty for a direction without a name.
        value: of the parameter.
        error: its standard error; NaN without one.
        step: length of the step that ``model`` stands away.
        model: the neighbour.
    """

    name: str
    value: float
    error: float
    step: float
    model: IdentifiedModel


def directions(model: IdentifiedModel) -> list[Direction]:
    """Return one neighbour for each free parameter; for a state-space model for each direction that shows outside.

    A model of another class, such as a user's own, has none.
    """
    for kind, neighbours in _KINDS:
        if isinstance(model, kind):
            return list(neighbours(model))
    return []


def slopes(model: IdentifiedModel, found: Sequence[Direction], record: FlightRecord, at: FloatArray) -> FloatArray:
    """Return the derivatives (N, p, k) of ``at`` (N, p), what ``model`` simulates, initial states fitted anew.

    Raises:
        EstimationError, ChannelError: what ``simulate`` of the model raises.
    """
    columns = [(_neighbour(model, d.model, record, at) - at) / d.step for d in found]
    return np.stack(columns, axis=2) if columns else np.zeros((*at.shape, 0))


def _neighbour(model: IdentifiedModel, other: IdentifiedModel, record: FlightRecord, at: FloatArray) -> FloatArray:
    """Return what a neighbour simulates; outputs whose own transfer function did not move stay as they are."""
    if not (isinstance(model, TransferFunctionModel) and isinstance(other, TransferFunctionModel)):
        return other.simulate(record)
    apart = np.any(other.numerators != model.numerators, axis=1)
    apart |= np.any(other.denominators != model.denominators, axis=1)
    rows = np.flatnonzero(apart)
    if rows.size == 0:
        return at
    part = replace(
        other,
        outputs=tuple(other.outputs[i] for i in rows),
        numerators=other.numerators[rows],
        denominators=other.denominators[rows],
        delays=tuple(other.delays[i] for i in rows),
    )
    out = at.copy()
    out[:, rows] = part.simulate(record)
    return out


def moved(model: IdentifiedModel, found: Sequence[Direction], change: FloatArray) -> IdentifiedModel:
    """Return the model after a change (k,) of its parameters along the directions found."""
    arrays = {}
    for name in _ARRAYS:
        here = getattr(model, name, None)
        if isinstance(here, np.ndarray):
            arrays[name] = here + sum(
                (c / d.step) * (getattr(d.model, name) - here) for d, c in zip(found, change, strict=True)
            )
    return replace(model, **arrays)


def moved_poles(
    first: IdentifiedModel, model: IdentifiedModel, found: Sequence[Direction], b: FloatArray
) -> tuple[float, float]:
    """Return by how much, relative to its size, the pole moves most from ``first`` to ``model`` and on by a change.

    The change b (k,) along the directions found at ``model`` counts to first order. Poles that it takes from complex to
    real ones, or back, are paired by the nearest. Infinite where a pole without continuous counterpart gets one.

    Returns:
        The shift over the size of the pole, and that size in rad/s (NaN where the shift is not finite).
    """
    start, here = all_poles(first), all_poles(model)
    if start.size != here.size:
        return np.inf, np.nan
    here = _nearest(start, here)
    total = here - start
    for d, c in zip(found, b, strict=True):
        other = all_poles(d.model)
        if other.size != start.size:
            return np.nan, np.nan
        total += (_nearest(here, other) - here) * (c / d.step)
    if not start.size:
        return 0.0, np.nan
    size = np.maximum(np.abs(start), 1e-9)
    i = int(np.argmax(np.abs(total) / size))
    return float(np.abs(total[i]) / size[i]), float(size[i])


def _nearest(poles: ComplexArray, other: ComplexArray) -> ComplexArray:
    return np.asarray(other[np.argmin(np.abs(poles[:, None] - other), axis=1)])


def feeds_through(model: IdentifiedModel) -> NDArray[np.bool_]:
    """Return (p,) which outputs answer an input in the same sample."""
    if isinstance(model, ParametricModel):
        direct = model.linear().D
    elif isinstance(model, StateSpaceModel):
        direct = model.D
    elif isinstance(model, ContinuousTransferModel):
        direct = model.numerators[:, :, 0] * (np.abs(model.denominators[:, :1]) > 0.0)
    else:
        direct = np.zeros((len(model.outputs), 1))
    return np.asarray(np.any(direct != 0.0, axis=1))


def all_poles(model: IdentifiedModel) -> ComplexArray:
    """Return the poles of all outputs in one array."""
    return np.concatenate([np.zeros(0, np.complex128), *model.poles().values()])


def _of_structure(model: ParametricModel) -> Iterator[Direction]:
    error = np.sqrt(np.diag(model.covariance))
    for i in np.flatnonzero(model.structure.free & (error > 0.0)):
        step = _STEP * max(abs(float(model.params[i])), float(error[i]))
        params = model.params.copy()
        params[i] += step
        yield Direction(
            model.structure.parameter_names[i],
            float(model.params[i]),
            float(error[i]),
            step,
            replace(model, params=params),
        )


def _of_states(model: StateSpaceModel) -> Iterator[Direction]:
    n, m, p = model.order, len(model.inputs), len(model.outputs)
    layout = Layout(n, m, p, bool(np.any(model.D)), False, False)
    size_u = np.linalg.norm(model.B, axis=0)
    size_y = np.linalg.norm(model.C, axis=1)
    u, y = 1.0 / np.where(size_u > 0.0, size_u, 1.0), np.where(size_y > 0.0, size_y, 1.0)
    scaled = Matrices(model.A, model.B * u, model.C / y[:, None], model.D * u / y[:, None], np.zeros((n, p)))
    for direction in orbit(scaled, layout).T:
        s = layout.moved(scaled, _STEP * direction)
        yield Direction(
            "", 0.0, np.nan, _STEP, replace(model, A=s.A, B=s.B / u, C=y[:, None] * s.C, D=y[:, None] * s.D / u)
        )


def _of_polynomials(model: ContinuousTransferModel) -> Iterator[Direction]:
    n = model.denominators.shape[1] - 1
    errors, common = model.standard_errors, model.common
    for i, output in enumerate(model.outputs):
        rows = slice(None) if common else i
        for k in range(1, n + 1) if not (common and i) else ():
            name = f"a{k}" if common else f"{output}: a{k}"
            step, moved = _entry(model.denominators, (rows, k))
            value = float(model.denominators[i, k])
            yield Direction(name, value, errors.get(name, np.nan), step, replace(model, denominators=moved))
        for j, given in enumerate(model.inputs):
            for k in np.flatnonzero(model.numerators[i, j]).tolist():
                name = f"{output}/{given}: b{n - k}"
                step, moved = _entry(model.numerators, (i, j, k))
                value = float(model.numerators[i, j, k])
                yield Direction(name, value, errors.get(name, np.nan), step, replace(model, numerators=moved))
            name = f"{output}/{given}: delay_s"
            if errors.get(name, 0.0) > 0.0:
                moved = model.delays_s.copy()
                moved[i, j] += _STEP * model.dt_s
                yield Direction(
                    name, float(model.delays_s[i, j]), errors[name], _STEP * model.dt_s, replace(model, delays_s=moved)
                )


def _of_differences(model: TransferFunctionModel) -> Iterator[Direction]:
    for i, k in np.argwhere(model.numerators):
        step, moved = _entry(model.numerators, (i, k))
        yield Direction("", float(model.numerators[i, k]), np.nan, step, replace(model, numerators=moved))
    for i, k in np.argwhere(model.denominators[:, 1:]):
        step, moved = _entry(model.denominators, (i, k + 1))
        yield Direction("", float(model.denominators[i, k + 1]), np.nan, step, replace(model, denominators=moved))


def _entry(array: FloatArray, at: tuple[object, ...]) -> tuple[float, FloatArray]:
    """Return a step for the entry of an array, and the array after it."""
    moved = array.copy()
    size = float(np.max(np.abs(array[at])))  # type: ignore[index]
    step = _STEP * (size if size > 0.0 else 1.0)
    moved[at] += step  # type: ignore[index]
    return step, moved


_KINDS: tuple[tuple[type[IdentifiedModel], Callable[..., Iterator[Direction]]], ...] = (
    (ParametricModel, _of_structure),
    (StateSpaceModel, _of_states),
    (ContinuousTransferModel, _of_polynomials),
    (TransferFunctionModel, _of_differences),
)


_LATER = (1, 2, 3, 4, 6, 8)  # samples: delays that are tried
_LAGS = (1.0, 2.0, 4.0, 8.0)  # samples: time constants that are tried
_KNOTS = (0, 1, 2, 3, 4, 6, 8, 11, 15, 20, 27, 36, 48, 64, 85, 113, 150)  # samples: hats of the linear response
_MODES = 4  # the slowest, through which a bend is looked for: aerodynamics that bend move the rigid body


class Data(NamedTuple):
    """Records with simulated outputs (N, p), residuals and slopes (p, N, k)."""

    records: list[FlightRecord]
    simulated: list[FloatArray]
    parts: list[Stretch]
    slopes: list[FloatArray]


class Candidate(NamedTuple):
    """Regressors (p, N, d) per record that a cause would leave, and what it is called."""

    code: str
    subject: str
    amount: float
    columns: list[FloatArray]


def busiest(record: FlightRecord, inputs: Sequence[str], longest: int) -> FlightRecord:
    """Return the stretch of at most ``longest`` samples in which the inputs move most."""
    if len(record) <= longest:
        return record
    step = np.abs(np.diff(record.columns(inputs), axis=0))
    activity = np.cumsum(np.concatenate([[0.0], np.sum(step / np.maximum(step.max(axis=0), 1e-300), axis=1)]))
    first = int(np.argmax(activity[longest - 1 :] - activity[: len(activity) - longest + 1]))
    return record.between(float(record.t_s[first]), float(record.t_s[first + longest - 1]))


def gather(model: IdentifiedModel, records: list[FlightRecord], found: Sequence[Direction]) -> Data:
    """Return the records with what the model simulates, what it leaves and how it moves with its parameters."""
    simulated, parts, moves = [], [], []
    for record in records:
        y, channels = model.simulate(record), record.select(model.outputs)
        good = np.all(channels.valid, axis=1)
        parts.append(Stretch(((channels.data - y) * good[:, None]).T, good))
        simulated.append(y)
        moves.append(turned(slopes(model, found, record, y)))
    return Data(records, simulated, parts, moves)


def _later(u: FloatArray, samples: float) -> FloatArray:
    at = np.arange(len(u)) - samples
    return np.asarray(np.interp(at, np.arange(len(u)), u))


def _lagged(u: FloatArray, samples: float) -> FloatArray:
    a = np.exp(-1.0 / samples)
    return np.asarray(lfilter([1.0 - a], [1.0, -a], u, zi=[a * u[0]])[0])


MOVES = {"delay": _later, "lag": _lagged}


def moved_inputs(model: IdentifiedModel, data: Data) -> list[Candidate]:
    """Return delays and lags of each input in turn."""
    out = []
    for name in model.inputs:
        for code, samples in [("delay", float(d)) for d in _LATER] + [("lag", T) for T in _LAGS]:
            move = MOVES[code]
            columns = [
                turned((model.simulate(r.with_columns({name: move(r[name], samples)})) - y)[:, :, None])
                for r, y in zip(data.records, data.simulated, strict=True)
            ]
            out.append(Candidate(code, name, samples * model.dt_s, columns))
    return out


def bends(model: IdentifiedModel, data: Data) -> list[Candidate]:
    """Return quadratic and cubic terms of each simulated output, through each mode, on every output."""
    out, p = [], len(model.outputs)
    poles = np.unique(np.round(all_poles(model), 9))
    poles = poles[poles.imag >= 0.0]
    z = np.exp(poles[np.argsort(np.abs(poles))][:_MODES] * model.dt_s)
    z = np.where(np.abs(z) < 1.0, z, 0.999 * z / np.maximum(np.abs(z), 1.0) ** 2)
    for i, name in enumerate(model.outputs):
        size = np.sqrt(np.mean(np.concatenate([y[:, i] for y in data.simulated]) ** 2))
        if size <= 0.0:
            continue
        columns = []
        for y in data.simulated:
            a = y[:, i] / size
            modes = [lfilter([0.0, 1.0], [1.0, -pole], g) for g in (a * np.abs(a), a**3) for pole in z]
            columns.append(each(np.stack([part for w in modes for part in _parts(w)], axis=1), p))
        out.append(Candidate("bend", name, 0.0, columns))
    return out


def _parts(w: FloatArray) -> list[FloatArray]:
    return [w.real, w.imag] if np.any(w.imag) else [w.real]


def drifts(model: IdentifiedModel, data: Data) -> list[Candidate]:
    """Return a constant and a line per output and record, less what the model estimates along."""
    p, terms = len(model.outputs), []
    have = _estimated_along(model)
    if have >= 2:
        return []
    for r in data.records:
        line = np.linspace(-1.0, 1.0, len(r))
        terms.append(each(np.stack([np.ones(len(r)), line], axis=1), p))
    return [Candidate("drift", "", 0.0, own(terms))]


def nuisances(model: IdentifiedModel, data: Data) -> list[FloatArray]:
    """Return the constants, and lines, that the method estimated along and ``simulate`` of its model leaves out."""
    p, have = len(model.outputs), 0 if isinstance(model, ParametricModel) else _estimated_along(model)
    lines = [np.stack([np.ones(len(r)), np.linspace(-1.0, 1.0, len(r))], axis=1)[:, :have] for r in data.records]
    return own([each(line, p) for line in lines])


def _estimated_along(model: IdentifiedModel) -> int:
    """Return 1 for models with a constant of their own per record, 2 for those with a line."""
    if isinstance(model, ParametricModel):
        return 2 if model.trended else 0
    offset = model.settings.get("offset", model.settings.get("offsets", False))
    return {"trend": 2, "offset": 1}.get(offset, 0) if isinstance(offset, str) else int(bool(offset))


def any_linear(model: IdentifiedModel, data: Data, first: int = 0) -> list[FloatArray]:
    """Return the inputs at the knots from ``first`` of any linear response, as many as a tenth of the data bears."""
    p, m = len(model.outputs), len(model.inputs)
    bears = sum(len(r) for r in data.records) // (20 * m)
    knots = [k for k in _KNOTS if k < min(len(r) for r in data.records) // 4][: max(bears, 2)]
    out = []
    for r in data.records:
        hats = [_hat(_deviation(r[name]), knots, i) for name in model.inputs for i in range(first, len(knots))]
        out.append(each(np.stack(hats, axis=1), p))
    return out


def slow_response(model: IdentifiedModel, data: Data) -> list[FloatArray]:
    """Return the inputs through lags from the longest hat to beyond the record, which a slow mode would leave."""
    longest, p = max(len(r) for r in data.records), len(model.outputs)
    lags = [_KNOTS[-1] * 2.0**k for k in range(max(int(np.ceil(np.log2(longest / _KNOTS[-1]))), 0) + 2)]
    return [
        each(np.stack([_lagged(_deviation(r[name]), T) for name in model.inputs for T in lags], axis=1), p)
        for r in data.records
    ]


def _deviation(u: FloatArray) -> FloatArray:
    return np.asarray(u - u[0])


def _hat(u: FloatArray, knots: Sequence[int], i: int) -> FloatArray:
    """Return u weighted by a hat over its past around knot i: linear interpolation of an impulse response."""
    left = knots[i - 1] if i else knots[i]
    right = knots[i + 1] if i + 1 < len(knots) else knots[i]
    lags = np.arange(left, right + 1)
    weights = np.interp(lags, [left, knots[i], right], [float(i == 0), 1.0, float(right == knots[i])])
    return np.asarray(lfilter(np.concatenate([np.zeros(left), weights]), [1.0], u))


def turned(x: FloatArray) -> FloatArray:
    """Return (N, p, d) as (p, N, d)."""
    return np.ascontiguousarray(x.transpose(1, 0, 2))


def each(columns: FloatArray, p: int) -> FloatArray:
    """Return columns (N, d) on each of p outputs by itself, (p, N, d p)."""
    N, d = columns.shape
    return np.asarray(np.einsum("nd,pq->pndq", columns, np.eye(p)).reshape(p, N, d * p))


def own(columns: list[FloatArray]) -> list[FloatArray]:
    """Return columns (p, N, d) per record as columns that belong to one record each, (p, N, d records)."""
    out = []
    for i, X in enumerate(columns):
        widths = [np.zeros((*X.shape[:2], Y.shape[2])) for Y in columns]
        widths[i] = X
        out.append(np.concatenate(widths, axis=2))
    return out


def joined(*blocks: Sequence[FloatArray]) -> list[FloatArray]:
    """Return the regressors of several blocks, per record, side by side."""
    return [np.concatenate(parts, axis=2) for parts in zip(*blocks, strict=True)]
