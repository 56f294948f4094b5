"""Why do the residuals of an identified model look as they do? The same causes, by the same tests, for every method.

Residuals of the free run are regressed on how the model moves with its parameters (:mod:`.tangent`) and on what a cause
would leave, in noise that may be coloured (:mod:`.coloured_fit`):

==========  ============================================================================================
delay, lag  how the outputs move if an input acts later, or through a first-order lag
bend        quadratic and cubic terms of a simulated output, through the model's own modes
drift       a constant and a line per output and record
order       the inputs of the samples before, through any linear response
feedback    what is new in an input, against the residuals around it (:mod:`.feedback`)
==========  ============================================================================================

A cause is named if the likelihood ratio exceeds what chance gives in ``_CHANCE`` of clean records, and if it explains
more than its degrees of freedom cost (G. Schwarz, Annals of Statistics 6, 1978); that with most left is the first, what
still explains something then the next. Bend, drift and feedback are tested beside any linear response, so that a delay
is none of them. The coefficients of the parameters are one Gauss-Newton step towards the estimates with the cause in
the model: by how much the cause has shifted them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter
from scipy.stats import chi2

from testbench.core.advice import Advice, Severity
from testbench.core.errors import TestbenchError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators import feedback
from testbench.estimators.coloured_fit import Regression, Stretch, regress
from testbench.estimators.model import IdentifiedModel
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.tangent import Direction, all_poles, directions, moved_poles, slopes

_CHANCE = 1e-4  # false-alarm probability of each test of a regression
_CHANCE_LOOP = 0.01  # of the test of feedback, which white residuals do not reach
_SCREEN = 1e-3  # of all regressors at once, before any of them is looked at
_LONGEST = 3000  # samples of all outputs looked at; of longer records the stretch where the inputs move most
_SHARE = 0.5  # of what any linear response explains: from here on a delay or lag is the better name
_PER_UNKNOWN = 10.0  # valid output samples per unknown below which data are few
_NAMED = 2  # causes at most
_ROUNDING = 1e-6  # residuals below this share of every output are no noise
_LATER = (1, 2, 3, 4, 6, 8)  # samples: delays that are tried
_LAGS = (1.0, 2.0, 4.0, 8.0)  # samples: time constants that are tried
_REFINED = 3  # delays and lags that are tried once more with the model's slopes there
_KNOTS = (0, 1, 2, 3, 4, 6, 8, 11, 15, 20, 27, 36, 48, 64, 85, 113, 150)  # samples: hats of the linear response
_ERRORS = 4.0  # standard errors of shift beyond which an estimate is wrong if it moves by _TENTH as well
_TENTH = 0.1  # relative
_HARDLY = 1.0  # standard error of shift below which a cause is only worth a note
_SURE = 2.0  # standard deviations that a shift must stand above zero to count
_MOST = 0.5  # share of the residuals that missing dynamics explain, beyond which the model is wrong
_LITTLE = 0.02  # relative shift of the poles below which it is, where there are no standard errors


class Found(NamedTuple):
    """A cause: its code, whom it concerns, what it explains of the residuals, and how far it shifts the estimates.

    Attributes:
        code: "delay", "lag", "bend", "drift", "order_too_low", "closed_loop".
        subject: input or output; empty where all are concerned.
        amount: seconds of delay or lag, else 0.
        share: of the squared residuals, or for feedback of what is new in the input, that it explains.
        errors: largest shift of a parameter over its standard error; NaN without standard errors.
        moved: name of that parameter.
        relative: its shift over its value; without standard errors that of the pole that moves most.
        statistic: likelihood ratio 2 ln L.
        degrees: of freedom.
    """

    code: str
    subject: str
    amount: float
    share: float
    errors: float
    moved: str
    relative: float
    statistic: float
    degrees: int


class _Data(NamedTuple):
    """Records with simulated outputs (N, p), residuals and slopes (p, N, k)."""

    records: list[FlightRecord]
    simulated: list[FloatArray]
    parts: list[Stretch]
    slopes: list[FloatArray]


class _Candidate(NamedTuple):
    """Regressors (p, N, d) per record that a cause would leave, and what it is called."""

    code: str
    subject: str
    amount: float
    columns: list[FloatArray]


def with_causes(model: IdentifiedModel, records: Sequence[FlightRecord]) -> IdentifiedModel:
    """Return the model with the causes of its residuals before its own advice, and in ``diagnostics["causes"]``.

    A model without known parameters, such as one of a user's own class, stays as it is, and so does one that cannot fly
    its records.

    Args:
        model: of any method.
        records: those it was identified from.

    Example:
        >>> import testbench as tb
        >>> model = tb.estimate("dsr_e", [record], ["de"], ["q"], past_horizon=20, future_horizon=20)  # doctest: +SKIP
        >>> [a.code for a in tb.with_causes(model, [record]).advice]  # doctest: +SKIP
        ['delay']
    """
    found = directions(model)
    if not found:
        return model
    try:
        advice, causes = _named(model, list(records), found)
    except TestbenchError:  # it diverges over its records, as its own advice says, or too few samples follow each other
        return model
    if not advice:
        return model
    named = {a.code for a in advice}
    if causes:  # a bend or a delay looks like feedback to the innovations of subspace methods, which know neither
        named.add("closed_loop")
    rest = [a for a in model.advice if getattr(a, "code", "") not in named]
    return replace(
        model, advice=(*advice, *rest), diagnostics={**model.diagnostics, "causes": [c._asdict() for c in causes]}
    )


def _named(
    model: IdentifiedModel, records: list[FlightRecord], found: list[Direction]
) -> tuple[list[Advice], list[Found]]:
    advice = _few(model, records, len(found))
    if advice:
        return advice, []
    data = _gather(
        model, [_busiest(r, model.inputs, _LONGEST // (len(records) * len(model.outputs))) for r in records], found
    )
    size = np.sqrt(np.mean(np.hstack([s.v for s in data.parts]) ** 2, axis=1))
    moved = np.sqrt(np.mean(np.vstack(data.simulated) ** 2, axis=0))
    if not np.all(np.isfinite(size)) or np.all(size <= _ROUNDING * moved):
        return [], []
    causes = search(model, data, found)
    return [_in_words(model, c) for c in causes], causes


def _few(model: IdentifiedModel, records: Sequence[FlightRecord], unknowns: int) -> list[Advice]:
    states = len(all_poles(model))
    total = unknowns + states * len(records)
    values = sum(int(r.select(model.outputs).valid.sum()) for r in records)
    if values >= _PER_UNKNOWN * total:
        return []
    return [
        Advice(
            f"{values} output samples for {total} unknowns are few: what is wrong with the model would not show, and "
            "errors are known only roughly; give more records, or free fewer parameters",
            "doubt",
            "few_data",
        )
    ]


def _busiest(record: FlightRecord, inputs: Sequence[str], longest: int) -> FlightRecord:
    """Return the stretch of at most ``longest`` samples in which the inputs move most."""
    if len(record) <= longest:
        return record
    step = np.abs(np.diff(record.columns(inputs), axis=0))
    activity = np.cumsum(np.concatenate([[0.0], np.sum(step / np.maximum(step.max(axis=0), 1e-300), axis=1)]))
    first = int(np.argmax(activity[longest - 1 :] - activity[: len(activity) - longest + 1]))
    return record.between(float(record.t_s[first]), float(record.t_s[first + longest - 1]))


def _gather(model: IdentifiedModel, records: list[FlightRecord], found: Sequence[Direction]) -> _Data:
    simulated, parts, moves = [], [], []
    for record in records:
        y, channels = model.simulate(record), record.select(model.outputs)
        good = np.all(channels.valid, axis=1)
        parts.append(Stretch(((channels.data - y) * good[:, None]).T, good))
        simulated.append(y)
        moves.append(_turned(slopes(model, found, record, y)))
    return _Data(records, simulated, parts, moves)


# --- what a cause would leave -----------------------------------------------------------------------------------------


def _later(u: FloatArray, samples: float) -> FloatArray:
    at = np.arange(len(u)) - samples
    return np.asarray(np.interp(at, np.arange(len(u)), u))


def _lagged(u: FloatArray, samples: float) -> FloatArray:
    a = np.exp(-1.0 / samples)
    return np.asarray(lfilter([1.0 - a], [1.0, -a], u, zi=[a * u[0]])[0])


_MOVES = {"delay": _later, "lag": _lagged}


def _moved_inputs(model: IdentifiedModel, data: _Data) -> list[_Candidate]:
    """Return delays and lags of each input in turn."""
    out = []
    for name in model.inputs:
        for code, samples in [("delay", float(d)) for d in _LATER] + [("lag", T) for T in _LAGS]:
            move = _MOVES[code]
            columns = [
                _turned((model.simulate(r.with_columns({name: move(r[name], samples)})) - y)[:, :, None])
                for r, y in zip(data.records, data.simulated, strict=True)
            ]
            out.append(_Candidate(code, name, samples * model.dt_s, columns))
    return out


def _bends(model: IdentifiedModel, data: _Data) -> list[_Candidate]:
    """Return quadratic and cubic terms of each simulated output, through each mode, on every output."""
    out, p = [], len(model.outputs)
    z = np.exp(np.unique(np.round(all_poles(model), 9)) * model.dt_s)
    z = z[z.imag >= 0.0]
    z = np.where(np.abs(z) < 1.0, z, 0.999 * z / np.maximum(np.abs(z), 1.0) ** 2)
    for i, name in enumerate(model.outputs):
        size = np.sqrt(np.mean(np.concatenate([y[:, i] for y in data.simulated]) ** 2))
        if size <= 0.0:
            continue
        columns = []
        for y in data.simulated:
            a = y[:, i] / size
            modes = [lfilter([0.0, 1.0], [1.0, -pole], g) for g in (a * np.abs(a), a**3) for pole in z]
            columns.append(_each(np.stack([part for w in modes for part in _parts(w)], axis=1), p))
        out.append(_Candidate("bend", name, 0.0, columns))
    return out


def _parts(w: FloatArray) -> list[FloatArray]:
    return [w.real, w.imag] if np.any(w.imag) else [w.real]


def _drifts(model: IdentifiedModel, data: _Data) -> list[_Candidate]:
    """Return a constant and a line per output and record, less what the model estimates along."""
    p, terms = len(model.outputs), []
    have = _estimated_along(model)
    if have >= 2:
        return []
    for r in data.records:
        line = np.linspace(-1.0, 1.0, len(r))
        terms.append(_each(np.stack([np.ones(len(r)), line], axis=1), p))
    return [_Candidate("drift", "", 0.0, _own(terms))]


def _nuisances(model: IdentifiedModel, data: _Data) -> list[FloatArray]:
    """Return the constants, and lines, that the method estimated along and ``simulate`` of its model leaves out."""
    p, have = len(model.outputs), 0 if isinstance(model, ParametricModel) else _estimated_along(model)
    lines = [np.stack([np.ones(len(r)), np.linspace(-1.0, 1.0, len(r))], axis=1)[:, :have] for r in data.records]
    return _own([_each(line, p) for line in lines])


def _estimated_along(model: IdentifiedModel) -> int:
    """Return 1 for models with a constant of their own per record, 2 for those with a line."""
    if isinstance(model, ParametricModel):
        return 2 if model.trended else 0
    offset = model.settings.get("offset", model.settings.get("offsets", False))
    return {"trend": 2, "offset": 1}.get(offset, 0) if isinstance(offset, str) else int(bool(offset))


def _any_linear(model: IdentifiedModel, data: _Data) -> list[FloatArray]:
    """Return the inputs at the knots of any linear response, as many as a tenth of the data bears."""
    p, m = len(model.outputs), len(model.inputs)
    bears = sum(len(r) for r in data.records) // (20 * m)
    knots = [k for k in _KNOTS if k < min(len(r) for r in data.records) // 4][: max(bears, 2)]
    out = []
    for r in data.records:
        hats = [_hat(_deviation(r[name]), knots, i) for name in model.inputs for i in range(len(knots))]
        out.append(_each(np.stack(hats, axis=1), p))
    return out


def _deviation(u: FloatArray) -> FloatArray:
    return np.asarray(u - u[0])


def _hat(u: FloatArray, knots: Sequence[int], i: int) -> FloatArray:
    """Return u weighted by a hat over its past around knot i: linear interpolation of an impulse response."""
    left = knots[i - 1] if i else knots[i]
    right = knots[i + 1] if i + 1 < len(knots) else knots[i]
    lags = np.arange(left, right + 1)
    weights = np.interp(lags, [left, knots[i], right], [float(i == 0), 1.0, float(right == knots[i])])
    return np.asarray(lfilter(np.concatenate([np.zeros(left), weights]), [1.0], u))


def _turned(x: FloatArray) -> FloatArray:
    """Return (N, p, d) as (p, N, d)."""
    return np.ascontiguousarray(x.transpose(1, 0, 2))


def _each(columns: FloatArray, p: int) -> FloatArray:
    """Return columns (N, d) on each of p outputs by itself, (p, N, d p)."""
    N, d = columns.shape
    return np.asarray(np.einsum("nd,pq->pndq", columns, np.eye(p)).reshape(p, N, d * p))


def _own(columns: list[FloatArray]) -> list[FloatArray]:
    """Return columns (p, N, d) per record as columns that belong to one record each, (p, N, d records)."""
    out = []
    for i, X in enumerate(columns):
        widths = [np.zeros((*X.shape[:2], Y.shape[2])) for Y in columns]
        widths[i] = X
        out.append(np.concatenate(widths, axis=2))
    return out


# --- the search -------------------------------------------------------------------------------------------------------


def _joined(*blocks: Sequence[FloatArray]) -> list[FloatArray]:
    return [np.concatenate(parts, axis=2) for parts in zip(*blocks, strict=True)]


class _Tried(NamedTuple):
    """A candidate, its likelihood ratio, degrees of freedom, how many share the test, and the data it leads to."""

    candidate: _Candidate
    statistic: float
    degrees: int
    tests: int
    data: _Data | None = None

    @property
    def significant(self) -> bool:
        return bool(chi2.sf(max(self.statistic, 0.0), max(self.degrees, 1)) * self.tests < _CHANCE)

    def gain(self, samples: int) -> float:
        return self.statistic - self.degrees * float(np.log(samples))


def search(model: IdentifiedModel, data: _Data, found: Sequence[Direction]) -> list[Found]:
    """Return the causes of the residuals, the one that explains most first."""
    samples = sum(int(s.good.sum()) for s in data.parts)
    nuisances, linear = _nuisances(model, data), _any_linear(model, data)
    crooked = [*_bends(model, data), *_drifts(model, data)]
    base = _joined(data.slopes, nuisances)
    start = regress(data.parts, base)
    everything = _joined(linear, *[c.columns for c in crooked])
    whole = regress(data.parts, _joined(base, everything))
    chosen: list[_Tried] = []
    fit, also = start, nuisances
    if chi2.sf(max(start.criterion - whole.criterion, 0.0), everything[0].shape[2]) < _SCREEN:
        while len(chosen) < _NAMED:
            columns, taken = _joined(data.slopes, also), {t.candidate.code for t in chosen}
            free = regress(data.parts, _joined(columns, linear))
            tried = [
                _Tried(
                    c, free.criterion - regress(data.parts, _joined(columns, linear, c.columns)).criterion, _width(c), 4
                )
                for c in crooked
                if c.code not in taken
            ]
            if not taken & _LINEAR:
                tried.append(_best_linear(model, data, found, also, fit, free, linear))
            best = max(tried, key=lambda t: t.gain(samples), default=None)
            if best is None or not best.significant or best.gain(samples) <= 0.0:
                break
            chosen.append(best)
            data = best.data or data
            also = _joined(also, best.candidate.columns)
            fit = regress(data.parts, _joined(data.slopes, also))
    out = [_measured(model, found, start, fit, t) for t in chosen]
    loop = _loop(model, data, _joined(data.slopes, also, linear))
    if loop is not None:
        index = 0 if not chosen or loop.statistic > chosen[0].gain(samples) else 1
        errors, moved, relative = _shift(model, found, fit)
        out.insert(index, loop._replace(errors=errors, moved=moved, relative=relative))
    return out[:_NAMED]


_LINEAR = {"delay", "lag", "order_too_low"}


def _width(c: _Candidate) -> int:
    return int(c.columns[0].shape[2])


def _best_linear(
    model: IdentifiedModel,
    data: _Data,
    found: Sequence[Direction],
    also: list[FloatArray],
    fit: Regression,
    free: Regression,
    linear: list[FloatArray],
) -> _Tried:
    """Return the delay or lag that explains most, or any linear response if they explain much less than it does."""
    whole = fit.criterion - free.criterion
    any_response = _Tried(_Candidate("order_too_low", "", 0.0, linear), whole, linear[0].shape[2], 1)
    if not any_response.significant:
        return any_response
    tried = []
    for c in _moved_inputs(model, data):
        tried.append((fit.criterion - regress(data.parts, _joined(data.slopes, also, c.columns)).criterion, c))
    tried.sort(key=lambda t: -t[0])
    refined = []
    for _, c in tried[:_REFINED]:
        moved = _acting(model, data, found, c)
        farther = _acting_later(model, moved, c)
        there = regress(moved.parts, _joined(moved.slopes, also, farther))
        unit = model.dt_s if c.code == "delay" else 0.5 * c.amount
        amount = max(c.amount + unit * float(there.b[-1]), 0.0)
        ratio = fit.criterion - there.criterion
        refined.append(_Tried(c._replace(columns=farther, amount=amount), ratio, 2, len(tried), moved))
    best = max(refined, key=lambda t: t.statistic, default=any_response)
    return best if best.statistic > _SHARE * whole else any_response


def _acting(model: IdentifiedModel, data: _Data, found: Sequence[Direction], c: _Candidate) -> _Data:
    """Return the data with the input of a delay or lag moved by it."""
    move, samples = _MOVES[c.code], c.amount / model.dt_s
    records = [r.with_columns({c.subject: move(r[c.subject], samples)}) for r in data.records]
    return _gather(model, records, found)


def _acting_later(model: IdentifiedModel, moved: _Data, c: _Candidate) -> list[FloatArray]:
    """Return what another sample of delay, or half as much lag again, would change (p, N, 1) per record."""
    further = 1.0 if c.code == "delay" else 0.5 * c.amount / model.dt_s
    return [
        _turned((model.simulate(r.with_columns({c.subject: _MOVES[c.code](r[c.subject], further)})) - y)[:, :, None])
        for r, y in zip(moved.records, moved.simulated, strict=True)
    ]


def _loop(model: IdentifiedModel, data: _Data, columns: list[FloatArray]) -> Found | None:
    """Return feedback, if what is new in an input goes with what any linear response leaves of the residuals."""
    left = regress(data.parts, columns)
    inputs = [r.columns(model.inputs) for r in data.records]
    f = feedback.strongest(inputs, left.left, [s.good for s in data.parts], left.noise)
    if f is None or chi2.sf(f.statistic, f.degrees) * len(model.inputs) > _CHANCE_LOOP:
        return None
    return Found("closed_loop", model.inputs[f.at], 0.0, f.share, np.nan, "", np.nan, f.statistic, f.degrees)


def _measured(
    model: IdentifiedModel, found: Sequence[Direction], start: Regression, fit: Regression, t: _Tried
) -> Found:
    before = np.sum(np.hstack(start.left) ** 2, axis=1)
    share = 1.0 - float(np.mean(np.sum(np.hstack(fit.left) ** 2, axis=1) / np.where(before > 0.0, before, 1.0)))
    errors, moved, relative = (np.nan, "", np.nan) if t.candidate.code == "order_too_low" else _shift(model, found, fit)
    return Found(
        t.candidate.code,
        t.candidate.subject,
        t.candidate.amount,
        share,
        errors,
        moved,
        relative,
        t.statistic,
        t.degrees,
    )


def _shift(model: IdentifiedModel, found: Sequence[Direction], fit: Regression) -> tuple[float, str, float]:
    """Return the largest shift over its standard error, whose it is, and relative to the value; the pole's without."""
    b, std = fit.b[: len(found)], fit.std[: len(found)]
    error = np.array([d.error for d in found])
    if not np.all(np.isfinite(error)):
        return np.nan, "", moved_poles(model, found, b)
    size = np.where(np.abs(b) > _SURE * std, np.abs(b), 0.0) / error
    i = int(np.argmax(size))
    return float(size[i]), found[i].name, float(abs(b[i]) / max(abs(found[i].value), 1e-300))


# --- in words ---------------------------------------------------------------------------------------------------------


def _in_words(model: IdentifiedModel, c: Found) -> Advice:
    said = {
        "delay": f"{c.subject} acts some {c.amount:.2g} s later than the model takes it to",
        "lag": f"{c.subject} acts through a lag of some {c.amount:.2g} s, as of a servo, that the model lacks",
        "bend": f"the response bends: it is not linear in {c.subject}",
        "drift": "the outputs carry biases or drifts that the model does not estimate",
        "order_too_low": "the outputs follow the inputs through dynamics that the model lacks",
        "closed_loop": f"{c.subject} reacts to the outputs (closed loop), and the residuals are coloured",
    }[c.code]
    part = "of what is new in it" if c.code == "closed_loop" else "of the residuals"
    verb = "the residuals explain" if c.code == "closed_loop" else "this explains"
    # estimates far from the best of their kind may fit better by another step than by the cause: no share is said then
    explained = f": {verb} {100.0 * c.share:.0f} % {part}" if c.share > 0.005 else ""
    return Advice(f"{said}{explained}{_shifted(c)}; {_remedy(model, c)}", _severity(c), c.code)


def _shifted(c: Found) -> str:
    if np.isfinite(c.errors) and c.moved:
        return f", and it shifts {c.moved} by some {c.errors:.2g} of its standard errors ({100.0 * c.relative:.0f} %)"
    return f", and it shifts a pole by some {100.0 * c.relative:.0f} %" if np.isfinite(c.relative) else ""


def _severity(c: Found) -> Severity:
    if c.code == "order_too_low":
        return "wrong" if c.share > _MOST else "doubt"
    if np.isfinite(c.errors):
        if c.errors > _ERRORS and c.relative > _TENTH:
            return "wrong"
        return "doubt" if c.errors > _HARDLY else "note"
    return "wrong" if c.relative > _TENTH else "doubt" if c.relative > _LITTLE else "note"


def _remedy(model: IdentifiedModel, c: Found) -> str:
    structured, time = isinstance(model, ParametricModel), f"{c.amount:.2g}"
    if c.code in ("delay", "lag"):
        way = f"set delays_s = {{{c.subject} = {time}}}" if structured else f"give the input {time} s later"
        return f"{way}, or take the position of the surface as the input instead of its command"
    if c.code == "bend":
        way = "a structure whose aerodynamics bend" if structured else "a model that bends"
        return f"fly smaller inputs, use the part of the record where {c.subject} stays small, or take {way}"
    if c.code == "drift":
        if structured:
            return "name the outputs in output_biases and output_trends, or remove the drift"
        have = {"dsr_e", "moesp", "n4sid", "cva", "dsr", "ssarx", "pbsid_opt"}
        if model.method in have:
            return 'set offset = "trend", or remove the drift'
        return "remove biases and drifts from the records first, or estimate them where the method can"
    if c.code == "order_too_low":
        return "free what is fixed or take a structure with more states" if structured else "raise the order"
    return (
        "take a method that is consistent in closed loop (filter_error with process noise, prediction_error with "
        "disturbances, ssarx or pbsid_opt with closed_loop = true), and excite the loop by a signal of its own"
    )
