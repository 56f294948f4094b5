"""What a cause would leave in the residuals of a model: regressors of delays, lags, bends, drifts, missing states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.causes.coloured_fit import (
    Stretch,
)
from testbench.estimators.causes.tangent import Direction, all_poles, slopes
from testbench.estimators.model import IdentifiedModel
from testbench.estimators.parametric.model import ParametricModel

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
