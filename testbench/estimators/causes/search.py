"""The search for causes: the best model of the same kind first, then what explains most of what it leaves.

Hypotheses side by side: white residuals, white columns, and what each explains beside the others.

Do the inputs react to the outputs? What is new in an input, against the residuals around it.

What an open loop leaves as residuals knows nothing of the inputs. In a closed loop, gusts are in the residuals and in
what the input does beyond its own past (C. W. J. Granger, Econometrica 37, 1969). One number per output is tested, what
moves the aircraft in the residual of the same sample: a damper has sensors of its own, whose noise is not that of the
outputs, which a Wiener filter over this sample and the two before it therefore takes away. Each of these samples by
itself would add degrees of freedom and little news. What is new in the input is clipped, so that the steps of a pilot
do not drown a damper that works at every sample. Where the aircraft bends, steps go with residuals without any loop:
these samples are then left out, though the test misses more loops without them.

An input that moves between samples reaches the outputs before the next sample. Part of one sample's response, anything
from nothing (held inputs) to all of it (inputs that are stamped a sample late), is therefore taken from the residuals
first: the part that leaves least to find. A loop that damps or stiffens has the other sign and is found all the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Sized
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from testbench.core.advice import ranked
from testbench.core.constants import WHITE
from testbench.core.errors import EstimationError, Refusal
from testbench.core.record import AS_DESIGNED, FlightRecord, FloatArray
from testbench.estimators.causes.found import SLOW, Found
from testbench.estimators.causes.leavings import (
    MOVES,
    Candidate,
    Data,
    Direction,
    Regression,
    Stretch,
    Whitener,
    any_linear,
    bends,
    directions,
    drifts,
    each,
    feeds_through,
    gather,
    joined,
    moved,
    moved_inputs,
    moved_poles,
    normal,
    nuisances,
    own,
    regress,
    regress_from,
    regress_plainly,
    settled,
    slow_response,
    solved,
    turned,
)
from testbench.estimators.model import IdentifiedModel
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.prediction_error import predict
from testbench.estimators.residuals import Autoregression, autoregression, ljung_box
from testbench.estimators.state_space import StateSpaceModel
from testbench.estimators.transfer_function import TransferFunctionModel, in_free_run

# --- do the inputs react to the outputs? ------------------------------------------------------------------------------


_PAST = 40  # samples of its own past that may explain an input
_FILTERED = 2  # samples before the present one that tell the noise of sensors from what moves the aircraft
_ROUNDS = 5
_CLIP = 4.0  # robust standard deviations of what is new in an input
_PARTS = (0.0, 0.25, 0.5, 0.75, 1.0)  # of one sample's response that may lie within the sample
_NEWS = 1e-6  # of an input, below which what is new in it is rounding: its past tells all of a multisine of few lines
_HELD = 0.5  # an input that stays exactly where it was in more than half of its samples follows no noisy output


class Feedback(NamedTuple):
    """Which input reacts, the share of what is new in it that the residuals explain, and the test's statistic.

    ``news`` is the (robust) deviation of what is new in it, relative to that of the input.
    """

    at: int
    share: float
    statistic: float
    degrees: int
    news: float = 0.0


def testable(records: Sequence[FlightRecord], inputs: Sequence[str]) -> bool:
    """Return whether any input moves at most samples, as one does that follows outputs with noise."""
    return any(not _steps([r[name] for r in records]) for name in inputs)


def _steps(inputs: Sequence[FloatArray]) -> bool:
    return bool(np.mean(np.concatenate([np.diff(u) == 0.0 for u in inputs])) > _HELD)


def strongest_feedback(
    inputs: Sequence[FloatArray],
    left: Sequence[FloatArray],
    good: Sequence[NDArray[np.bool_]],
    noise: Autoregression,
    first: FloatArray,
    steps: bool = True,
) -> Feedback | None:
    """Return the input that reacts most; None where white residuals or held inputs leave nothing to test.

    Args:
        inputs: (N, m) per record.
        left: residuals (p, N) per record, without what follows inputs of samples before.
        good: (N,) per record, samples that count.
        noise: autoregression of the residuals.
        first: (p, m) how the outputs answer an input one sample after it.
        steps: whether samples in which an input steps count.
    """
    if not len(noise.A):
        return None
    rows = [settled(g, min(2 * _PAST, len(g) // 8)) for g in good]
    lags = min(_PAST, min(len(g) for g in good) // 8)
    left, gain = _moving(left)
    first, found = gain @ first, []
    for j in range(inputs[0].shape[1]):
        if _steps([u[:, j] for u in inputs]):
            continue
        past = np.vstack([_past(u[:, j], lags)[r] for u, r in zip(inputs, rows, strict=True)])
        now = np.concatenate([u[r, j] for u, r in zip(inputs, rows, strict=True)])
        known = np.vstack([x.T[r] for x, r in zip(left, rows, strict=True)])
        if len(now) > 2 * (past.shape[1] + known.shape[1]):
            found.append(_test(j, past, now, known, first[:, j], steps))
    return max(found, key=lambda f: f.statistic, default=None)


def _moving(left: Sequence[FloatArray]) -> tuple[list[FloatArray], FloatArray]:
    """Return the residuals (p, N) per record without white noise, by a causal Wiener filter, and its first gain (p, p).

    What is not white has the autocovariance of the residuals, but at no lag, where it follows on a line from lags one
    and two. Its regression on the present residuals and those before is the filter.
    """
    lags, p = range(_FILTERED + 1), left[0].shape[0]
    R = np.sum([[v[:, k:] @ v[:, : v.shape[1] - k].T for k in (*lags, _FILTERED + 1)] for v in left], axis=0)
    size = np.sqrt(np.maximum(np.diag(R[0]), 1e-300))
    R = R / np.outer(size, size)
    values, vectors = np.linalg.eigh(R[1] + R[1].T - 0.5 * (R[2] + R[2].T))
    now = (vectors * np.maximum(values, 0.0)) @ vectors.T
    whole = np.block([[R[b - a] if b >= a else R[a - b].T for b in lags] for a in lags])
    goal = np.hstack([now, *R[1 : _FILTERED + 1]])
    filters = np.linalg.lstsq(whole.T, goal.T, rcond=1e-10)[0].T.reshape(p, len(lags), p) * size[:, None, None] / size
    out = []
    for v in left:
        moved = np.zeros_like(v)
        for k in lags:
            moved[:, k:] += filters[:, k] @ v[:, : v.shape[1] - k]
        out.append(moved)
    return out, filters[:, 0]


def _past(u: FloatArray, lags: int) -> FloatArray:
    """Return the samples before (N, lags + 1) and a constant; zeros before the record."""
    out = np.ones((len(u), lags + 1))
    for k in range(1, lags + 1):
        out[:, k - 1] = np.concatenate([np.zeros(k), u[:-k]])
    return out


def _test(
    j: int, past: FloatArray, now: FloatArray, known: FloatArray, first: FloatArray, steps: bool = True
) -> Feedback:
    weight, new, size = np.ones(len(now)), now, 0.0
    for _ in range(_ROUNDS):
        b = np.linalg.lstsq(past * weight[:, None], now * weight, rcond=1e-10)[0]
        new = now - past @ b
        size = _CLIP * 1.4826 * float(np.median(np.abs(new)))
        if size <= _CLIP * _NEWS * float(np.std(now)):
            return Feedback(j, 0.0, 0.0, known.shape[1])
        weight = np.sqrt(np.minimum(1.0, size / np.maximum(np.abs(new), 1e-300)))
    if not steps:
        counts = np.abs(new) <= size
        past, new, known = past[counts], new[counts], known[counts]
    clipped = np.clip(new, -size, size)
    Q = np.linalg.qr(past)[0]
    clipped, new, known = (x - Q @ (Q.T @ x) for x in (clipped, new, known))
    total, samples = float(clipped @ clipped), len(new) - past.shape[1] - known.shape[1]
    if total <= 0.0:
        return Feedback(j, 0.0, 0.0, known.shape[1])
    rest = total
    for part in _PARTS:
        left = known - part * new[:, None] * first
        rest_of_it = clipped - left @ np.linalg.lstsq(left, clipped, rcond=1e-10)[0]
        rest = max(rest if part else 0.0, float(rest_of_it @ rest_of_it))
    share = max(1.0 - rest / total, 0.0)
    news = size / (_CLIP * float(np.std(now)))
    return Feedback(j, share, -samples * float(np.log(max(1.0 - share, 1e-12))), known.shape[1], news)


# --- hypotheses side by side ------------------------------------------------------------------------------------------


CHANCE = 1e-4  # false-alarm probability of the tests of one round of causes together
SLOPES, NUISANCES, RESPONSE, MOVED = "slopes", "nuisances", "response", "moved inputs"


class Tried(NamedTuple):
    """A candidate, the sum of squares that it takes, degrees of freedom, tests that share the chance, where it leads.

    ``statistic`` is tested, beside any linear response for what is none. ``order`` puts causes in order: of a linear
    response it is what it takes beside all others. Both count in variances of the noise.
    """

    candidate: Candidate
    statistic: float
    order: float
    degrees: int
    tests: int
    data: Data | None = None

    def significant(self, freedom: int) -> bool:
        """Return whether F tells it from chance; the noise is known with ``freedom`` degrees."""
        degrees = max(self.degrees, 1)
        return bool(f_distribution.sf(max(self.statistic, 0.0) / degrees, degrees, freedom) * self.tests < CHANCE)

    def gain(self, samples: int) -> float:
        """Return what it takes beyond what its degrees of freedom cost."""
        return self.order - self.degrees * float(np.log(samples))


def name_of(c: Candidate) -> str:
    """Return the name of the block of a candidate."""
    return f"{c.code} {c.subject}" if c.subject not in ("", SLOW) else c.code


class Board:
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

    def replaced(self, parts: Sequence[Stretch], slopes: list[FloatArray], **more: list[FloatArray]) -> Board:
        """Return a board with other residuals and slopes, and more blocks."""
        other = object.__new__(Board)
        other.noise = self.noise
        other.Z = self.Z | {name: self.noise(columns) for name, columns in ({SLOPES: slopes} | more).items()}
        other._multiply(parts)
        return other

    def left(self, names: Sequence[str], extra: NDArray[np.intp] | None = None) -> float:
        """Return the sum of squares that the blocks named, and ``extra`` columns, leave."""
        at = np.concatenate([self.at[n] for n in names] + ([] if extra is None else [extra]))
        return self.products.total - self.products.of(at).explained()


def width_of(columns: list[FloatArray]) -> int:
    """Return the number of regressors."""
    return int(columns[0].shape[2])


# --- the search for causes --------------------------------------------------------------------------------------------


# of the test of feedback, which is not made on held inputs or white residuals; with the part of a response that leaves
# least to find taken first, 8 of 396 open loops of noisy inputs in coloured noise lay beyond it
_CHANCE_LOOP = 0.04
_LITTLE_NEWS = 0.05  # of an input: less of it is new where it is smooth, and what it has bent before tells that
_SCREEN = 1e-3  # of all regressors at once, before any of them is looked at
_SHARE = 0.5  # of what any linear response explains: from here on a delay or lag is the better name
_DESIGNED = 0.98  # likeness to planned commands; what is left is sampling, a servo and noise
_LAGS_WHITE = 20  # samples over which innovations are tested for colour
_NAMED = 2  # causes at most
_NO_TIME = 0.02  # samples of delay or lag that are none
_STEPS = 5  # of Gauss-Newton towards the best model of the same kind
_SHARES = (1.0, 0.25, 0.06)  # of a step that are tried
_SURE = 2.0  # standard deviations that a shift must stand above zero to count
_LINEAR = {"delay", "lag", "order_too_low"}
_TOLD_APART = 7.0  # 2 ln L by which inputs that are held must follow the records better than straight lines do
_PREFERRED = 9.0  # 2 ln L that a delay, with its size and its slope, must explain beyond a hold: by chance once in 90
_AT_MOST = 1.5  # samples of delay or lag up to which a hold, which is half a sample late, may be what is meant


class _Best(NamedTuple):
    """The best model of the same kind as that of ``model``: what it leaves, and on which data."""

    model: IdentifiedModel
    found: list[Direction]
    data: Data
    fit: Regression


def search(model: IdentifiedModel, data: Data, found: Sequence[Direction]) -> list[Found]:
    """Return the causes of the residuals, the one that explains most first.

    A model with gusts whose innovations are noise lacks nothing, whatever gusts do to its free run: whether there is
    feedback is all that is asked.
    """
    if model.settings.get("process_noise") and np.all(np.asarray(model.diagnostics.get("whiteness_p", 0.0)) > WHITE):
        loop = _loop(model, data)
        return [] if loop is None else [loop]
    samples = sum(int(s.good.sum()) for s in data.parts)
    steady_parts = nuisances(model, data)
    start = regress_from(data.parts, steady_parts, [s.v for s in data.parts])
    steady = joined(steady_parts, *[c.columns for c in drifts(model, data)])  # a slow pole would else follow a drift
    still = regress_from(data.parts, steady, [s.v for s in data.parts])
    loop = _loop(model, data)
    given = _Best(model, list(found), data, still)
    best = _best_of_its_kind(model, given, steady)
    data, linear = best.data, any_linear(model, best.data)
    crooked = {name_of(c): c for c in (*bends(best.model, data), *drifts(model, data))}
    base = joined(data.slopes, steady_parts)
    whole = regress(data.parts, joined(base, linear, *[c.columns for c in crooked.values()]))
    blocks = {SLOPES: data.slopes, NUISANCES: steady_parts, RESPONSE: linear}
    board = Board(
        Whitener(whole.noise, data.parts), data.parts, blocks | {name: c.columns for name, c in crooked.items()}
    )
    least = board.left(list(board.Z))
    freedom = max(len(board.e) - len(board.products.g), 1)
    noise = least / freedom
    added = len(board.products.g) - len(board.at[SLOPES]) - len(board.at[NUISANCES])
    chosen: list[Tried] = []
    also = [SLOPES, NUISANCES]
    everything = (board.left(also) - least) / noise
    if f_distribution.sf(max(everything, 0.0) / max(added, 1), max(added, 1), freedom) < _SCREEN:
        while len(chosen) < _NAMED:
            now, taken = board.left(also), {t.candidate.code for t in chosen}
            free = board.left([*also, RESPONSE])
            tests = len(crooked) + 1
            tried = [
                Tried(c, taken_up, taken_up, width_of(c.columns), tests)
                for name, c in crooked.items()
                if c.code not in taken
                for taken_up in [(free - board.left([*also, RESPONSE, name])) / noise]
            ]
            if not taken & _LINEAR:
                response = Candidate("order_too_low", "", 0.0, linear)
                beside = (board.left([*also, *crooked]) - board.left([*also, *crooked, RESPONSE])) / noise
                any_response = Tried(response, (now - free) / noise, beside, width_of(linear), tests)
                if any_response.significant(freedom):
                    tried.append(_best_linear(best, data, board, also, now, noise, any_response))
            sure = [t for t in tried if t.significant(freedom) and t.gain(samples) > 0.0]
            if not sure:
                break
            first = max(sure, key=lambda t: t.gain(samples))
            if first.candidate.code == "drift" and not _sure_of_drift(best.model, data, board, noise, freedom):
                first = first._replace(candidate=first.candidate._replace(subject=SLOW))
            chosen.append(first)
            name = name_of(first.candidate)
            if first.data is not None:
                data = first.data
                board = board.replaced(data.parts, data.slopes, **{name: first.candidate.columns})
            elif name not in board.Z:
                name = RESPONSE
            also = [*also, name]
    columns = {name: c.columns for name, c in crooked.items()} | {
        name_of(t.candidate): t.candidate.columns for t in chosen
    }
    causes = [c for name, c in columns.items() if name in also] + ([linear] if RESPONSE in also else [])
    fit = regress(data.parts, joined(data.slopes, steady_parts, *causes)) if chosen else best.fit
    out = [_measured(model, best, start, fit, t) for t in chosen]
    held = None
    if all(c.code in _LINEAR - {"order_too_low"} and c.amount <= _AT_MOST * model.dt_s for c in out):
        late = best.fit.criterion - regress(data.parts, joined(data.slopes, steady, *causes)).criterion if out else 0.0
        held = _held(best, given, steady, start, late)
    if held is not None:
        out = [held, *[c for c in out if c.code not in _LINEAR]]
    elif not chosen:  # what a cause leaves moves the best of the kind as well
        out += [c for c in (_far_from_best(model, best, still), _coloured(model, best)) if c is not None]
    if loop is not None and any(t.candidate.code == "bend" for t in chosen):
        loop = _loop(model, given.data, steps=False)
    if loop is not None:  # what else is found presumes inputs that know nothing of the outputs
        errors, moved_most, relative = _shift(model, best, fit)
        out.insert(0, loop._replace(errors=errors, moved=moved_most, relative=relative))
    return out[:_NAMED]


def _sure_of_drift(model: IdentifiedModel, data: Data, board: Board, noise: float, freedom: int) -> bool:
    """Return whether a drift is needed beside all else, and a slow response to the inputs, such as of a phugoid."""
    slow = board.replaced(data.parts, data.slopes, **{SLOW: slow_response(model, data)})
    drift = "drift"
    names = [name for name in slow.Z if name != drift]
    taken = (slow.left(names) - slow.left([*names, drift])) / noise
    degrees = len(slow.at[drift])
    return bool(f_distribution.sf(max(taken, 0.0) / degrees, degrees, freedom) < CHANCE)


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
        data = gather(model, from_.data.records, found)
        if len(found) != len(from_.found) or not all(np.all(np.isfinite(s.v)) for s in data.parts):
            return None
        reached = regress_from(data.parts, nuisances, [s.v for s in data.parts]).criterion
        return _Best(model, found, data, _stepped(data, nuisances)), reached
    except (Refusal, np.linalg.LinAlgError):
        return None


def _stepped(data: Data, nuisances: list[FloatArray]) -> Regression:
    return regress_from(data.parts, joined(data.slopes, nuisances), [s.v for s in data.parts])


def _best_linear(
    best: _Best, data: Data, board: Board, also: list[str], now: float, noise: float, any_response: Tried
) -> Tried:
    """Return the delay or lag that explains most, or any linear response if they explain much less than it does."""
    model, found = best.model, best.found
    candidates = moved_inputs(model, data)
    moves = board.replaced(data.parts, data.slopes, **{MOVED: joined(*[c.columns for c in candidates])})
    left = [moves.left(also, moves.at[MOVED][[i]]) for i in range(len(candidates))]
    refined = []
    for code in MOVES:
        i = min((i for i, c in enumerate(candidates) if c.code == code), key=lambda i: left[i])
        c = candidates[i]
        acting = _acting(model, data, found, c)
        farther = _acting_later(model, acting, c)
        there = board.replaced(acting.parts, acting.slopes, **{MOVED: farther})
        at = np.concatenate([*(there.at[n] for n in also), there.at[MOVED]])
        b, _ = solved(there.products.of(at))
        unit = model.dt_s if c.code == "delay" else 0.5 * c.amount
        amount = c.amount + unit * float(b[-1])
        if amount < _NO_TIME * model.dt_s:
            continue  # what it explains is no lag
        ratio = (now - there.left([*also, MOVED])) / noise
        refined.append(
            Tried(
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


def _acting(model: IdentifiedModel, data: Data, found: Sequence[Direction], c: Candidate) -> Data:
    """Return the data with the input of a delay or lag moved by it."""
    move, samples = MOVES[c.code], c.amount / model.dt_s
    records = [r.with_columns({c.subject: move(r[c.subject], samples)}) for r in data.records]
    return gather(model, records, found)


def _acting_later(model: IdentifiedModel, moved: Data, c: Candidate) -> list[FloatArray]:
    """Return what another sample of delay, or half as much lag again, would change (p, N, 1) per record."""
    further = 1.0 if c.code == "delay" else 0.5 * c.amount / model.dt_s
    return [
        turned((model.simulate(r.with_columns({c.subject: MOVES[c.code](r[c.subject], further)})) - y)[:, :, None])
        for r, y in zip(moved.records, moved.simulated, strict=True)
    ]


def _as_designed(record: FlightRecord) -> float:
    """Return the likeness of a record's commands to planned ones, as it or the file that it was read from says."""
    told = record.provenance
    return float(told.get(AS_DESIGNED, told.get("recorded", {}).get(AS_DESIGNED, 0.0)))


def _loop(model: IdentifiedModel, data: Data, steps: bool = True) -> Found | None:
    """Return feedback, if what is new in an input goes with what any linear response to its past leaves of the outputs.

    The model has no part in it: one that is wrong hides what it is wrong for. Outputs with direct feedthrough follow
    what is new in an input in any case and are left out. Where little is new in an input, such as a multisine, what
    bends would leave is taken out in a second test: the input is told by what it has bent before, without any loop.
    """
    apart = ~feeds_through(model)
    if all(_as_designed(r) > _DESIGNED for r in data.records):
        return None  # what was chosen before the flight does not react to it
    if not np.any(apart) or not testable(data.records, model.inputs):
        return None
    p, m = len(model.outputs), len(model.inputs)
    parts = [
        Stretch((r.columns(model.outputs) - r.columns(model.outputs)[0]).T * s.good, s.good)
        for r, s in zip(data.records, data.parts, strict=True)
    ]
    lines = [np.stack([np.ones(len(r)), np.linspace(-1.0, 1.0, len(r))], axis=1) for r in data.records]
    response, steady = any_linear(model, data, 1), own([each(line, p) for line in lines])

    def strongest(along: list[FloatArray]) -> tuple[Feedback | None, float]:
        # by ordinary least squares: a whole flight of gusts is not to be whitened away
        b, left = regress_plainly(parts, along)
        width = response[0].shape[2] // (m * p)
        first = b[: m * width * p].reshape(m, width, p)[:, 0].T  # the response one sample later
        f = strongest_feedback(
            [r.columns(model.inputs) for r in data.records],
            [v[apart] for v in left],
            [s.good for s in parts],
            autoregression([v.T for v in left]),
            first[apart],
            steps,
        )
        return f, 1.0 if f is None else float(chi2.sf(f.statistic, f.degrees) * m)

    f, chance = strongest(joined(response, steady))
    if f is None or chance > _CHANCE_LOOP:
        return None
    if f.news < _LITTLE_NEWS:
        bent = [c.columns for c in bends(model, data)]
        if strongest(joined(response, steady, *bent))[1] > _CHANCE_LOOP:
            return None
    return Found("closed_loop", model.inputs[f.at], 0.0, f.share, np.nan, "", np.nan, f.statistic, f.degrees)


def _explained(start: Regression, fit: Regression) -> float:
    """Return the share of the squared residuals of all outputs that a regression explains of those of another."""
    before, after = (np.sum(np.hstack(r.left) ** 2, axis=1) for r in (start, fit))
    return 1.0 - float(np.mean(after / np.where(before > 0.0, before, 1.0)))


def _measured(model: IdentifiedModel, best: _Best, start: Regression, fit: Regression, t: Tried) -> Found:
    c = t.candidate
    shift = (np.nan, "", np.nan) if c.code == "order_too_low" else _shift(model, best, fit)
    return Found(c.code, c.subject, c.amount, _explained(start, fit), *shift, t.statistic, t.degrees)


def _coloured(model: IdentifiedModel, best: _Best) -> Found | None:
    """Return colour of what the best of the kind leaves, for methods that do not test it, or test their own filter.

    Of a state-space model it is what its predictor leaves, which white process noise does not colour.
    """
    if any(getattr(a, "code", "") == "coloured_residuals" and a.severity != "note" for a in ranked(model.advice)):
        return None
    if isinstance(model, StateSpaceModel):
        try:
            innovations = [predict(model, record)[1][3 * model.order :] for record in best.data.records]
        except EstimationError:
            return None  # a predictor that cannot be run says nothing of colour
    elif model.method == "equation_error":
        innovations = [left.T for left in best.fit.left]
    else:
        return None
    lags = _lags(innovations)
    p = [min(ljung_box(e[:, i], lags) for e in innovations) for i in range(len(model.outputs))]
    tests = len(p) * len(innovations)
    coloured = [name for name, chance in zip(model.outputs, p, strict=True) if chance * tests < CHANCE]
    if not coloured:
        return None
    return Found("coloured_residuals", ", ".join(coloured), 0.0, 0.0, np.nan, "", np.nan, np.nan, lags)


def _held(best: _Best, first: _Best, nuisances: list[FloatArray], start: Regression, late: float) -> Found | None:
    """Return that inputs which the model takes as straight lines are held, if the records are followed better so.

    A smooth input that is held at every sample does not show its steps; what it moves is half a sample late. Only where
    a model with held inputs leaves white residuals can this be told.

    Args:
        best: of straight lines, after steps towards the best of its kind.
        first: the same before them.
        nuisances: what both estimate along.
        start: the residuals that are explained.
        late: what delay or lag explain of 2 ln L, which count instead if they explain more.
    """
    model = first.model
    if not isinstance(model, ParametricModel) or all(model.held):
        return None
    flown = _tried(replace(model, held=(True,) * len(model.held)), first, nuisances)
    if flown is None:
        return None
    tried, reached = flown
    steps = _best_of_its_kind(tried.model, tried._replace(fit=tried.fit._replace(criterion=reached)), nuisances)
    gain = best.fit.criterion - steps.fit.criterion
    if len(steps.fit.noise.A) or gain < max(_TOLD_APART, late - _PREFERRED):
        return None
    names = ", ".join(n for n, held in zip(model.inputs, model.held, strict=True) if not held)
    share = _explained(start, steps.fit)
    return Found("held", names, 0.5 * model.dt_s, share, *_shift(model, steps, steps.fit), gain, 0)


def _lags(records: Sequence[Sized]) -> int:
    """Return over how many samples records are tested for colour."""
    return max(2, min(_LAGS_WHITE, min(map(len, records)) // 4))


def _far_from_best(model: IdentifiedModel, best: _Best, start: Regression) -> Found | None:
    """Return how far the estimates are from the best of their kind, if the free run errs measurably more for it.

    Those of output error are the best but for the colour of the noise, which its own advice weighs.
    """
    if best.model is model or model.method == "output_error":
        return None
    statistic, degrees = start.criterion - best.fit.criterion, len(best.found)
    shift = _shift(model, best, best.fit)
    return Found("far_from_best", "", 0.0, _explained(start, best.fit), *shift, statistic, degrees)


def _shift(model: IdentifiedModel, best: _Best, fit: Regression) -> tuple[float, str, float]:
    """Return the largest shift over its standard error, whose it is, and relative to the value.

    Without standard errors it is the shift of the pole that moves most, relative to its size; in words in rad/s.

    What is left of trim values takes up every drift, which need not touch the others: it counts where nothing else is.
    """
    found = best.found
    b, std = fit.b[: len(found)], fit.std[: len(found)]
    first = directions(model)
    error = np.array([d.error for d in first])
    if len(first) != len(found) or not np.all(np.isfinite(error)):
        relative, pole = moved_poles(model, best.model, found, b)
        return np.nan, f"a pole of {pole:.2g} rad/s by some {relative * pole:.2g} rad/s", relative
    b = b + np.array([d.value for d in found]) - np.array([d.value for d in first])
    size = np.where(np.abs(b) > _SURE * std, np.abs(b), 0.0) / error
    constants = model.structure.trim_constants if isinstance(model, ParametricModel) else ()
    counts = np.array([d.name not in constants for d in first])
    if np.any(counts):
        size = np.where(counts, size, 0.0)
    i = int(np.argmax(size))
    return float(size[i]), first[i].name, float(abs(b[i]) / max(abs(first[i].value), 1e-300))
