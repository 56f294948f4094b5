"""Why do the residuals of an identified model look as they do? The same causes, by the same tests, for every method.

The estimates are first taken to the best model of the same kind, by Gauss-Newton steps of the free run: what noise has
done to a method that it biases would else look like missing dynamics. Residuals of the free run are regressed on how
the model moves with its parameters (:mod:`.tangent`) and on what a cause would leave, in noise that may be coloured
(:mod:`.coloured_fit`):

==========  ============================================================================================
delay, lag  how the outputs move if an input acts later, or through a first-order lag
bend        quadratic and cubic terms of a simulated output, through the model's own slow modes
drift       a constant and a line per output and record
order       the inputs of the samples before, through any linear response
feedback    what is new in an input, against the residual of the same sample (:mod:`.feedback`)
far         nothing of these, but the best of the kind is measurably better
colour      nothing of these, but the innovations are not white
==========  ============================================================================================

All regressors at once must explain more than chance gives in ``_SCREEN`` of records, which bounds the false alarms of
all of them together. Each is then tested by F at ``_CHANCE`` over their number (Bonferroni), in the noise that is left
beside all regressors, and must explain more than its degrees of freedom cost (G. Schwarz, Annals of Statistics 6,
1978). Bend and drift are tested beside any linear response, so that a delay is none of them; that with most left is the
first, what still explains something then the next. The coefficients of the parameters are one step towards the
estimates with the cause in the model: by how much the cause has shifted them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from testbench.core.advice import Advice, Severity, ranked
from testbench.core.errors import TestbenchError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators import feedback
from testbench.estimators.coloured_fit import (
    Regression,
    Stretch,
    Whitener,
    normal,
    regress,
    regress_from,
    regress_plainly,
    solved,
)
from testbench.estimators.discrete_transfer import TransferFunctionModel, in_free_run
from testbench.estimators.model import IdentifiedModel
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.prediction_error import predict
from testbench.estimators.residuals import autoregression, ljung_box
from testbench.estimators.state_space import StateSpaceModel
from testbench.estimators.tangent import Direction, all_poles, directions, feeds_through, moved, moved_poles, slopes

_CHANCE = 1e-4  # false-alarm probability of the tests of one round of causes together
_CHANCE_LOOP = 0.02  # at most, of the test of feedback, which is not made on held inputs or white residuals
_SCREEN = 1e-3  # of all regressors at once, before any of them is looked at
_LONGEST = 3000  # samples of all outputs looked at; of longer records the stretch where the inputs move most
_SHARE = 0.5  # of what any linear response explains: from here on a delay or lag is the better name
_PER_UNKNOWN = 10.0  # valid output samples per unknown below which data are few
_LAGS_WHITE = 20  # samples over which innovations are tested for colour
_NAMED = 2  # causes at most
_ROUNDING = 1e-6  # residuals below this share of every output are no noise
_LATER = (1, 2, 3, 4, 6, 8)  # samples: delays that are tried
_LAGS = (1.0, 2.0, 4.0, 8.0)  # samples: time constants that are tried
_KNOTS = (0, 1, 2, 3, 4, 6, 8, 11, 15, 20, 27, 36, 48, 64, 85, 113, 150)  # samples: hats of the linear response
_ERRORS = 4.0  # standard errors of shift beyond which an estimate is wrong if it moves by _TENTH as well
_TENTH = 0.1  # relative
_MODES = 4  # the slowest, through which a bend is looked for: aerodynamics that bend move the rigid body
_STEPS = 5  # of Gauss-Newton towards the best model of the same kind
_SHARES = (1.0, 0.25, 0.06)  # of a step that are tried
_HARDLY = 2.0  # standard errors of shift that a 95 % interval holds: below them a cause is only worth a note
_SCATTER = 3.0  # the same for what scatter alone may do to any of some five estimates in a hundredth of flights
_SURE = 2.0  # standard deviations that a shift must stand above zero to count
_MOST = 0.5  # share of the residuals beyond which missing dynamics make a model wrong, and any cause a doubt
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
    if any(a.severity != "note" for a in advice):
        rest = [_without_comfort(a) for a in ranked(rest)]
    return replace(
        model, advice=(*advice, *rest), diagnostics={**model.diagnostics, "causes": [c._asdict() for c in causes]}
    )


def _without_comfort(advice: Advice) -> Advice:
    """Return advice on coloured residuals without the word that errors are corrected: no correction holds a bias."""
    if advice.code != "coloured_residuals" or "corrected" not in advice:
        return advice
    said = f"{advice.rpartition(': ')[0]}: no correction of standard errors holds what the cause above has done"
    return Advice(said, advice.severity, advice.code)


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


def _any_linear(model: IdentifiedModel, data: _Data, first: int = 0) -> list[FloatArray]:
    """Return the inputs at the knots from ``first`` of any linear response, as many as a tenth of the data bears."""
    p, m = len(model.outputs), len(model.inputs)
    bears = sum(len(r) for r in data.records) // (20 * m)
    knots = [k for k in _KNOTS if k < min(len(r) for r in data.records) // 4][: max(bears, 2)]
    out = []
    for r in data.records:
        hats = [_hat(_deviation(r[name]), knots, i) for name in model.inputs for i in range(first, len(knots))]
        out.append(_each(np.stack(hats, axis=1), p))
    return out


def _slow_response(model: IdentifiedModel, data: _Data) -> list[FloatArray]:
    """Return the inputs through lags from the longest hat to beyond the record, which a slow mode would leave."""
    longest, p = max(len(r) for r in data.records), len(model.outputs)
    lags = [_KNOTS[-1] * 2.0**k for k in range(max(int(np.ceil(np.log2(longest / _KNOTS[-1]))), 0) + 2)]
    return [
        _each(np.stack([_lagged(_deviation(r[name]), T) for name in model.inputs for T in lags], axis=1), p)
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
    """A candidate, the sum of squares that it takes, degrees of freedom, tests that share the chance, where it leads.

    ``statistic`` is tested, beside any linear response for what is none. ``order`` puts causes in order: of a linear
    response it is what it takes beside all others. Both count in variances of the noise.
    """

    candidate: _Candidate
    statistic: float
    order: float
    degrees: int
    tests: int
    data: _Data | None = None

    def significant(self, freedom: int) -> bool:
        """Return whether F tells it from chance; the noise is known with ``freedom`` degrees."""
        degrees = max(self.degrees, 1)
        return bool(f_distribution.sf(max(self.statistic, 0.0) / degrees, degrees, freedom) * self.tests < _CHANCE)

    def gain(self, samples: int) -> float:
        return self.order - self.degrees * float(np.log(samples))


def _name_of(c: _Candidate) -> str:
    return f"{c.code} {c.subject}" if c.subject not in ("", _SLOW) else c.code


class _Board:
    """White residuals and white columns of all hypotheses with their products, in blocks by name."""

    def __init__(self, noise: Whitener, parts: Sequence[Stretch], blocks: Mapping[str, list[FloatArray]]) -> None:
        self.noise = noise
        self.Z = {name: noise(columns) for name, columns in blocks.items()}
        self._multiply(parts)

    def _multiply(self, parts: Sequence[Stretch]) -> None:
        self.e = self.noise([s.v[:, :, None] for s in parts])[:, 0]
        ends = np.cumsum([0, *(Z.shape[1] for Z in self.Z.values())])
        self.at = {name: np.arange(a, b) for name, a, b in zip(self.Z, ends[:-1], ends[1:], strict=True)}
        self.products = normal(np.hstack(list(self.Z.values())), self.e)

    def replaced(self, parts: Sequence[Stretch], slopes: list[FloatArray], **more: list[FloatArray]) -> _Board:
        """Return a board with other residuals and slopes, and more blocks."""
        other = object.__new__(_Board)
        other.noise = self.noise
        other.Z = self.Z | {name: self.noise(columns) for name, columns in ({_SLOPES: slopes} | more).items()}
        other._multiply(parts)
        return other

    def left(self, names: Sequence[str], extra: NDArray[np.intp] | None = None) -> float:
        """Return the sum of squares that the blocks named, and ``extra`` columns, leave."""
        at = np.concatenate([self.at[n] for n in names] + ([] if extra is None else [extra]))
        return self.products.total - self.products.of(at).explained()


_SLOW = "slow motion"
_SLOPES, _NUISANCES, _RESPONSE, _MOVED = "slopes", "nuisances", "response", "moved inputs"


class _Best(NamedTuple):
    """The best model of the same kind as that of ``model``: what it leaves, and on which data."""

    model: IdentifiedModel
    found: list[Direction]
    data: _Data
    fit: Regression


def search(model: IdentifiedModel, data: _Data, found: Sequence[Direction]) -> list[Found]:
    """Return the causes of the residuals, the one that explains most first."""
    samples = sum(int(s.good.sum()) for s in data.parts)
    nuisances = _nuisances(model, data)
    start = regress_from(data.parts, nuisances, [s.v for s in data.parts])
    steady = _joined(nuisances, *[c.columns for c in _drifts(model, data)])  # a slow pole would else follow a drift
    still = regress_from(data.parts, steady, [s.v for s in data.parts])
    loop = _loop(model, data)
    best = _best_of_its_kind(model, _Best(model, list(found), data, still), steady)
    data, linear = best.data, _any_linear(model, best.data)
    crooked = {_name_of(c): c for c in (*_bends(best.model, data), *_drifts(model, data))}
    base = _joined(data.slopes, nuisances)
    whole = regress(data.parts, _joined(base, linear, *[c.columns for c in crooked.values()]))
    blocks = {_SLOPES: data.slopes, _NUISANCES: nuisances, _RESPONSE: linear}
    board = _Board(
        Whitener(whole.noise, data.parts), data.parts, blocks | {name: c.columns for name, c in crooked.items()}
    )
    least = board.left(list(board.Z))
    freedom = max(len(board.e) - len(board.products.g), 1)
    noise = least / freedom
    added = len(board.products.g) - len(board.at[_SLOPES]) - len(board.at[_NUISANCES])
    chosen: list[_Tried] = []
    also = [_SLOPES, _NUISANCES]
    everything = (board.left(also) - least) / noise
    if f_distribution.sf(max(everything, 0.0) / max(added, 1), max(added, 1), freedom) < _SCREEN:
        while len(chosen) < _NAMED:
            now, taken = board.left(also), {t.candidate.code for t in chosen}
            free = board.left([*also, _RESPONSE])
            tests = len(crooked) + 1
            tried = [
                _Tried(c, taken_up, taken_up, _width(c), tests)
                for name, c in crooked.items()
                if c.code not in taken
                for taken_up in [(free - board.left([*also, _RESPONSE, name])) / noise]
            ]
            if not taken & _LINEAR:
                response = _Candidate("order_too_low", "", 0.0, linear)
                beside = (board.left([*also, *crooked]) - board.left([*also, *crooked, _RESPONSE])) / noise
                any_response = _Tried(response, (now - free) / noise, beside, _width_of(linear), tests)
                if any_response.significant(freedom):
                    tried.append(_best_linear(best, data, board, also, now, noise, any_response))
            sure = [t for t in tried if t.significant(freedom) and t.gain(samples) > 0.0]
            if not sure:
                break
            first = max(sure, key=lambda t: t.gain(samples))
            if first.candidate.code == "drift" and not _sure_of_drift(best.model, data, board, noise, freedom):
                first = first._replace(candidate=first.candidate._replace(subject=_SLOW))
            chosen.append(first)
            name = _name_of(first.candidate)
            if first.data is not None:
                data = first.data
                board = board.replaced(data.parts, data.slopes, **{name: first.candidate.columns})
            elif name not in board.Z:
                name = _RESPONSE
            also = [*also, name]
    columns = {name: c.columns for name, c in crooked.items()} | {
        _name_of(t.candidate): t.candidate.columns for t in chosen
    }
    causes = [c for name, c in columns.items() if name in also] + ([linear] if _RESPONSE in also else [])
    fit = regress(data.parts, _joined(data.slopes, nuisances, *causes)) if chosen else best.fit
    out = [_measured(model, best, start, fit, t) for t in chosen]
    if not chosen:  # what a cause leaves moves the best of the kind as well
        out += [c for c in (_far_from_best(model, best, still), _coloured(model, best)) if c is not None]
    if loop is not None:  # what else is found presumes inputs that know nothing of the outputs
        errors, moved_most, relative = _shift(model, best, fit)
        out.insert(0, loop._replace(errors=errors, moved=moved_most, relative=relative))
    return out[:_NAMED]


_LINEAR = {"delay", "lag", "order_too_low"}


def _width_of(columns: list[FloatArray]) -> int:
    return int(columns[0].shape[2])


def _width(c: _Candidate) -> int:
    return _width_of(c.columns)


def _sure_of_drift(model: IdentifiedModel, data: _Data, board: _Board, noise: float, freedom: int) -> bool:
    """Return whether a drift is needed beside all else, and a slow response to the inputs, such as of a phugoid."""
    slow = board.replaced(data.parts, data.slopes, **{_SLOW: _slow_response(model, data)})
    drift = "drift"
    names = [name for name in slow.Z if name != drift]
    taken = (slow.left(names) - slow.left([*names, drift])) / noise
    degrees = len(slow.at[drift])
    return bool(f_distribution.sf(max(taken, 0.0) / degrees, degrees, freedom) < _CHANCE)


def _best_of_its_kind(model: IdentifiedModel, first: _Best, nuisances: list[FloatArray]) -> _Best:
    """Return the model after Gauss-Newton steps of its free run in coloured noise; the first where none helps.

    What noise has done to the estimates of a method that does not minimise the errors of its free run would else look
    like missing dynamics.
    """
    best, reached = first._replace(fit=_stepped(first.data, nuisances)), first.fit.criterion
    if isinstance(model, TransferFunctionModel):  # whose equation errors may be so biased that no step leads back
        other = _tried(in_free_run(model, first.data.records), first, nuisances)
        if other is not None and other[1] < reached:
            best, reached = other
    for _ in range(_STEPS):
        change = best.fit.b[: len(best.found)]
        if reached - best.fit.criterion < chi2.isf(_SCREEN, max(len(best.found), 1)):
            break
        for share in _SHARES:
            other = _tried(moved(best.model, best.found, share * change), best, nuisances)
            if other is not None and other[1] < reached:
                best, reached = other
                break
        else:
            break
    return best


def _tried(model: IdentifiedModel, from_: _Best, nuisances: list[FloatArray]) -> tuple[_Best, float] | None:
    """Return a model with its data and the criterion of what it leaves; None if it cannot fly the records."""
    found = directions(model)
    try:
        data = _gather(model, from_.data.records, found)
        if len(found) != len(from_.found) or not all(np.all(np.isfinite(s.v)) for s in data.parts):
            return None
        reached = regress_from(data.parts, nuisances, [s.v for s in data.parts]).criterion
        return _Best(model, found, data, _stepped(data, nuisances)), reached
    except (TestbenchError, np.linalg.LinAlgError):
        return None


def _stepped(data: _Data, nuisances: list[FloatArray]) -> Regression:
    return regress_from(data.parts, _joined(data.slopes, nuisances), [s.v for s in data.parts])


def _best_linear(
    best: _Best, data: _Data, board: _Board, also: list[str], now: float, noise: float, any_response: _Tried
) -> _Tried:
    """Return the delay or lag that explains most, or any linear response if they explain much less than it does."""
    model, found = best.model, best.found
    candidates = _moved_inputs(model, data)
    moves = board.replaced(data.parts, data.slopes, **{_MOVED: _joined(*[c.columns for c in candidates])})
    left = [moves.left(also, moves.at[_MOVED][[i]]) for i in range(len(candidates))]
    refined = []
    for code in _MOVES:
        i = min((i for i, c in enumerate(candidates) if c.code == code), key=lambda i: left[i])
        c = candidates[i]
        acting = _acting(model, data, found, c)
        farther = _acting_later(model, acting, c)
        there = board.replaced(acting.parts, acting.slopes, **{_MOVED: farther})
        at = np.concatenate([*(there.at[n] for n in also), there.at[_MOVED]])
        b, _ = solved(there.products.of(at))
        unit = model.dt_s if c.code == "delay" else 0.5 * c.amount
        amount = max(c.amount + unit * float(b[-1]), 0.0)
        ratio = (now - there.left([*also, _MOVED])) / noise
        refined.append(
            _Tried(
                c._replace(columns=farther, amount=amount),
                ratio,
                min(ratio, any_response.order),
                2,
                len(candidates) * any_response.tests,
                acting,
            )
        )
    first = max(refined, key=lambda t: t.statistic, default=any_response)
    return first if first.statistic > _SHARE * any_response.statistic else any_response


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


def _loop(model: IdentifiedModel, data: _Data) -> Found | None:
    """Return feedback, if what is new in an input goes with what any linear response to its past leaves of the outputs.

    The model has no part in it: one that is wrong hides what it is wrong for. Outputs with direct feedthrough follow
    what is new in an input in any case and are left out.
    """
    apart = ~feeds_through(model)
    if not np.any(apart) or not feedback.testable(data.records, model.inputs):
        return None
    p, m = len(model.outputs), len(model.inputs)
    parts = [
        Stretch((r.columns(model.outputs) - r.columns(model.outputs)[0]).T * s.good, s.good)
        for r, s in zip(data.records, data.parts, strict=True)
    ]
    lines = [np.stack([np.ones(len(r)), np.linspace(-1.0, 1.0, len(r))], axis=1) for r in data.records]
    response, steady = _any_linear(model, data, 1), _own([_each(line, p) for line in lines])
    # by ordinary least squares: a whole flight of gusts is not to be whitened away
    b, left = regress_plainly(parts, _joined(response, steady))
    width = response[0].shape[2] // (m * p)
    first = b[: m * width * p].reshape(m, width, p)[:, 0].T  # the response one sample later
    f = feedback.strongest(
        [r.columns(model.inputs) for r in data.records],
        [v[apart] for v in left],
        [s.good for s in parts],
        autoregression([v.T for v in left]),
        first[apart],
    )
    if f is None or chi2.sf(f.statistic, f.degrees) * m > _CHANCE_LOOP:
        return None
    return Found("closed_loop", model.inputs[f.at], 0.0, f.share, np.nan, "", np.nan, f.statistic, f.degrees)


def _measured(model: IdentifiedModel, best: _Best, start: Regression, fit: Regression, t: _Tried) -> Found:
    before = np.sum(np.hstack(start.left) ** 2, axis=1)
    share = 1.0 - float(np.mean(np.sum(np.hstack(fit.left) ** 2, axis=1) / np.where(before > 0.0, before, 1.0)))
    errors, moved, relative = (np.nan, "", np.nan) if t.candidate.code == "order_too_low" else _shift(model, best, fit)
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


def _coloured(model: IdentifiedModel, best: _Best) -> Found | None:
    """Return colour of what the best of the kind leaves, for methods that do not test it, or test their own filter.

    Of a state-space model it is what its predictor leaves, which white process noise does not colour.
    """
    if any(getattr(a, "code", "") == "coloured_residuals" and a.severity != "note" for a in ranked(model.advice)):
        return None
    if isinstance(model, StateSpaceModel):
        innovations = [predict(model, record)[1][3 * model.order :] for record in best.data.records]
    elif model.method == "equation_error":
        innovations = [left.T for left in best.fit.left]
    else:
        return None
    lags = max(2, min(_LAGS_WHITE, min(len(e) for e in innovations) // 4))
    p = [min(ljung_box(e[:, i], lags) for e in innovations) for i in range(len(model.outputs))]
    tests = len(p) * len(innovations)
    coloured = [name for name, chance in zip(model.outputs, p, strict=True) if chance * tests < _CHANCE]
    if not coloured:
        return None
    return Found("coloured_residuals", ", ".join(coloured), 0.0, 0.0, np.nan, "", np.nan, np.nan, lags)


def _far_from_best(model: IdentifiedModel, best: _Best, start: Regression) -> Found | None:
    """Return how far the estimates are from the best of their kind, if the free run errs measurably more for it."""
    if best.model is model:
        return None
    statistic, degrees = start.criterion - best.fit.criterion, len(best.found)
    before, after = (np.sum(np.hstack(r.left) ** 2, axis=1) for r in (start, best.fit))
    share = 1.0 - float(np.mean(after / np.where(before > 0.0, before, 1.0)))
    errors, name, relative = _shift(model, best, best.fit)
    return Found("far_from_best", "", 0.0, share, errors, name, relative, statistic, degrees)


def _shift(model: IdentifiedModel, best: _Best, fit: Regression) -> tuple[float, str, float]:
    """Return the largest shift over its standard error, whose it is, and relative to the value; the pole's without."""
    found = best.found
    b, std = fit.b[: len(found)], fit.std[: len(found)]
    first = directions(model)
    error = np.array([d.error for d in first])
    if len(first) != len(found) or not np.all(np.isfinite(error)):
        return np.nan, "", moved_poles(model, best.model, found, b)
    b = b + np.array([d.value for d in found]) - np.array([d.value for d in first])
    size = np.where(np.abs(b) > _SURE * std, np.abs(b), 0.0) / error
    i = int(np.argmax(size))
    return float(size[i]), first[i].name, float(abs(b[i]) / max(abs(first[i].value), 1e-300))


# --- in words ---------------------------------------------------------------------------------------------------------


def _bears_feedback(model: IdentifiedModel) -> bool:
    """Return whether a loop does not bias the method: it estimates gusts and leaves nothing of them in what is new."""
    return model.method == "filter_error" and "coloured_residuals" not in {a.code for a in ranked(model.advice)}


def _in_words(model: IdentifiedModel, c: Found) -> Advice:
    said = {
        "delay": f"{c.subject} acts some {c.amount:.2g} s later than the model takes it to",
        "lag": f"{c.subject} acts through a lag of some {c.amount:.2g} s, as of a servo, that the model lacks",
        "bend": f"the response bends: it is not linear in {c.subject}",
        "drift": (
            "the outputs move slowly in a way that the model does not follow: biases or drifts of the sensors, or a "
            "slow mode that it lacks, such as the phugoid, which this record does not tell apart"
            if c.subject == _SLOW
            else "the outputs carry biases or drifts that the model does not estimate"
        ),
        "far_from_best": (
            "a model of the same kind follows the records better in free run: noise of the outputs has moved these "
            "estimates"
        ),
        "coloured_residuals": (
            f"the innovations of {c.subject} are not white: gusts, or noise of the sensors that is slower than the "
            "model's states, move the poles beyond their scatter in white noise"
        ),
        "order_too_low": "the outputs follow the inputs through dynamics that the model lacks",
        "closed_loop": f"{c.subject} reacts to the outputs (closed loop), and the residuals are coloured",
    }[c.code]
    part = "of what is new in it" if c.code == "closed_loop" else "of the residuals"
    verb = "the residuals explain" if c.code == "closed_loop" else "this explains"
    # estimates far from the best of their kind may fit better by another step than by the cause: no share is said then
    explained = f": {verb} {100.0 * c.share:.0f} % {part}" if c.share > 0.005 else ""
    if c.code == "closed_loop" and _bears_feedback(model):
        return Advice(f"{said}{explained}; {model.method} as it is set here is not biased by it", "note", c.code)
    return Advice(f"{said}{explained}{_shifted(c)}; {_remedy(model, c)}", _severity(c), c.code)


def _shifted(c: Found) -> str:
    if np.isfinite(c.errors) and c.moved:
        return f", and it shifts {c.moved} by some {c.errors:.2g} of its standard errors ({100.0 * c.relative:.0f} %)"
    return f", and it shifts a pole by some {100.0 * c.relative:.0f} %" if np.isfinite(c.relative) else ""


def _severity(c: Found) -> Severity:
    by_shift = _severity_of_shift(c)  # which knows no bias that a loop gives to the best of the kind as well
    return "doubt" if by_shift == "note" and (c.share > _MOST or c.code == "closed_loop") else by_shift


def _severity_of_shift(c: Found) -> Severity:
    if c.code == "coloured_residuals":
        return "doubt"
    if c.code == "order_too_low":
        return "wrong" if c.share > _MOST else "doubt"
    if np.isfinite(c.errors):
        if c.errors > _ERRORS and c.relative > _TENTH:
            return "wrong"
        # the best of the kind lies within the scatter of a method that is less efficient, by chance beyond two errors
        return "doubt" if c.errors > (_SCATTER if c.code == "far_from_best" else _HARDLY) else "note"
    return "wrong" if c.relative > _TENTH else "doubt" if c.relative > _LITTLE else "note"


def _remedy(model: IdentifiedModel, c: Found) -> str:
    structured, time = isinstance(model, ParametricModel), f"{c.amount:.2g}"
    if c.code in ("delay", "lag"):
        way = f"set delays_s = {{{c.subject} = {time}}}" if structured else f"give the input {time} s later"
        return f"{way}, or take the position of the surface as the input instead of its command"
    if c.code == "bend":
        way = "a structure whose aerodynamics bend" if structured else "a model that bends"
        return f"fly smaller inputs, use the part of the record where {c.subject} stays small, or take {way}"
    if c.code == "drift" and c.subject == _SLOW:
        return "estimate offsets where the method can, free the slow mode or raise the order, and see which fits"
    if c.code == "drift":
        if structured:
            return "name the outputs in output_biases and output_trends, or remove the drift"
        have = {"dsr_e", "moesp", "n4sid", "cva", "dsr", "ssarx", "pbsid_opt"}
        if model.method in have:
            return 'set offset = "trend", or remove the drift'
        return "remove biases and drifts from the records first, or estimate them where the method can"
    if c.code == "coloured_residuals":
        return "compare a higher order and prediction_error with disturbances"
    if c.code == "far_from_best":
        return "refine them by " + ("output_error" if structured else "prediction_error")
    if c.code == "order_too_low":
        return "free what is fixed or take a structure with more states" if structured else "raise the order"
    return (
        "take a method that is consistent in closed loop (filter_error with process noise; prediction_error with "
        "disturbances, ssarx or pbsid_opt with closed_loop = true, of an order that holds the gusts as well), and "
        "excite the loop by a signal of its own"
    )
