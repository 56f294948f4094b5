"""After the flight: the runs of a plan found in its logs by what was commanded, and set against their cards.

A run is found where the recorded commands, less their mean, are those of a card. With t the command of the card less
its mean and x the recorded one over as many samples, likeness = 1 - |x - t|^2 / |t|^2; it is 1 for the same command,
and falls with a wrong amplitude as with a wrong time. With c = x.t / (|x| |t|), a command of the card's shape alone
has c^2 near 1: its amplitude, or its sign, is wrong. A run that was broken off has the card's command up to some time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.signal import correlate

from testbench.core.errors import RecordError
from testbench.core.record import AS_DESIGNED, FlightRecord, FloatArray
from testbench.design.limits import breaches
from testbench.page.words import listed
from testbench.questions.plan.result import Card, Plan

_FOUND = 0.5  # judged: below this a movement is no run of a card
_FAITHFUL = 0.9  # judged: below this the command was not the card's: repeat
_SHAPE = 0.8  # judged: c^2 from which a movement of another amplitude or sign is a run of a card,
_GAIN = (0.2, 5.0)  # with an amplitude between these parts of the card's
_OFF_GAIN = 0.2  # what a factor e of amplitude costs where several cards have one shape,
_REVERSED = 0.1  # and what the other sign costs: cards are told apart by it
_BROKEN = 0.4  # of the energy of a command, from which a run that was broken off is recognised
_UNITS = {"deg for rad": 57.3, "rad for deg": 1.0 / 57.3, "g for m/s2": 1.0 / 9.807, "m/s2 for g": 9.807}
_UNIT_OFF = 0.3  # judged: how far from a factor of units a response may be, of an aircraft that is not as believed
_AFTER_S = 0.5  # in which the controls are back at trim after it
_INSIDE = 0.8  # judged: a smaller part of the samples inside a 95 % band is no surprise of noise alone


@dataclass(frozen=True, eq=False)
class FlownRun:
    """A run of a card that was found in a log."""

    card: Card  # that was flown
    log: str  # name of its file
    start_s: float  # start of the input on the clock of the record
    likeness: float  # of the recorded command to the card's, at most 1; of a broken run up to where it was broken off
    V_m_s: float | None  # mean airspeed of the settling time; None if the log has none
    # channel -> part of the samples inside the card's 95 % band, deviations from the settling time
    inside: dict[str, float]
    faults: tuple[str, ...]  # why it must be repeated, in words; empty if it need not
    record: FlightRecord  # from the settling time to the end of the manoeuvre
    gain: float = 1.0  # amplitude of the recorded command over the card's; negative where its sign is the other one
    broken_s: float | None = None  # when it was broken off, from the start of the input; None if it was not
    met: bool = False  # whether the aircraft met a limit
    # channels that left the band of the card: the aircraft is not as believed. That is no fault of the run.
    strange: tuple[str, ...] = ()
    odd: tuple[str, ...] = ()  # what no aircraft explains of instruments, in sentences

    @property
    def anomalies(self) -> tuple[str, ...]:
        """What no aircraft explains, and what to check before anything is flown."""
        turned = "a command was recorded with the other sign than the card's: check the servo's direction on the ground"
        return (*((turned,) if self.gain < 0.0 else ()), *self.odd)

    @property
    def unexpected(self) -> bool:
        """Whether it must be evaluated before a faster one is flown."""
        return self.met or bool(self.strange)


@dataclass(frozen=True, eq=False)
class Closed:
    """A plan after its flights: the runs that were found, the logs that were searched, and why nothing was found."""

    plan: Plan
    logs: tuple[str, ...]
    runs: tuple[FlownRun, ...]
    why_none: str = ""

    def of(self, card: Card) -> list[FlownRun]:
        """Return the runs of a card."""
        return [r for r in self.runs if r.card is card]

    def good(self, card: Card) -> list[FlownRun]:
        """Return the runs of a card that were flown as it says."""
        return [r for r in self.of(card) if not r.faults]

    def missing(self, card: Card) -> int:
        """Return how many good runs of a card are still to be flown."""
        return max(card.repeats - len(self.good(card)), 0)


class _Match(NamedTuple):
    """A stretch of a record that may be a run: rank among others, its card, samples, likeness and amplitude."""

    rank: float
    card: Card
    start: int
    length: int
    likeness: float
    gain: float


def close_plan(plan: Plan, records: Sequence[tuple[str, FlightRecord]]) -> Closed:
    """Find the runs of a plan in the records of its logs.

    Args:
        plan: with its cards flown in the simulator.
        records: (name, whole record) of each log, with the commands ``de_cmd`` and so on, or else the surfaces.

    Raises:
        RecordError: no log holds a control of any card.
    """
    runs: list[FlownRun] = []
    cards = [c for c in plan.cards if c.status != "refused"]
    seen = False
    for name, record in records:
        moved = [(card, x) for card in cards if (x := _commands(record, card)) is not None]
        seen = seen or bool(moved)
        taken: list[tuple[int, int]] = []
        for find in (_whole, _broken):  # what is a whole run of some card is no broken one of another
            found = [m for card, x in moved for m in find(record, card, x)]
            for m in sorted(found, key=lambda m: -m.rank):
                end = m.start + m.length
                if all(end <= a or m.start >= b for a, b in taken):
                    taken.append((m.start, end))
                    runs.append(_run(plan, name, record, m))
    if not seen:
        wanted = sorted({f"{c}_cmd" for card in cards for c in card.spec.controls})
        raise RecordError(
            f"a log of this plan must hold a control of its cards ({', '.join(wanted)}), got none in "
            f"{', '.join(name for name, _ in records)}"
        )
    order = {id(card): k for k, card in enumerate(plan.cards)}
    names = [name for name, _ in records]
    runs.sort(key=lambda r: (order[id(r.card)], names.index(r.log), r.start_s))
    return Closed(plan, tuple(names), tuple(runs), "" if runs else why_none(plan, records))


def command_of(record: FlightRecord, control: str) -> str | None:
    """Return the channel that says what was commanded: the command, else the surface; None without both."""
    return next((c for c in (f"{control}_cmd", control) if c in record), None)


def _commands(record: FlightRecord, card: Card) -> FloatArray | None:
    """Return what was commanded (n, m); None if a control was not recorded."""
    names = [command_of(record, control) for control in card.spec.controls]
    return None if None in names else record.columns([n for n in names if n is not None])


def _target(record: FlightRecord, card: Card) -> FloatArray:
    """Return what the card commands (n, m), as deviations, at the samples of a record."""
    n = round(card.spec.duration_s / record.dt_s)
    return card.signal.at(np.arange(n) * record.dt_s, card.spec.controls)


class _Compared(NamedTuple):
    """For every start (k,): products with the card's command (k, m), and the energy of the recorded one (k,)."""

    products: FloatArray
    energy: FloatArray
    wanted: float


def _compare(x: FloatArray, u: FloatArray) -> _Compared:
    """Compare recorded commands (N, m) with those of a card (n, m), means removed, at every start."""
    n, (products, energy, wanted) = len(u), ([], np.zeros(max(len(x) - len(u) + 1, 0)), 0.0)
    if len(x) < n or n < 2:
        return _Compared(np.empty((0, u.shape[1])), np.empty(0), 0.0)
    for j in range(u.shape[1]):
        t, y = u[:, j] - u[:, j].mean(), x[:, j] - x[:, j].mean()
        total, squares = (np.concatenate([[0.0], np.cumsum(v)]) for v in (y, y**2))
        mean = (total[n:] - total[:-n]) / n
        energy += squares[n:] - squares[:-n] - n * mean**2
        products.append(correlate(y, t, "valid", "fft"))
        wanted += float(np.sum(t**2))
    return _Compared(np.column_stack(products), energy, wanted)


def _whole(record: FlightRecord, card: Card, x: FloatArray) -> Iterator[_Match]:
    """Yield the stretches that have a card's command: as it is, or of another amplitude, or sign."""
    u = _target(record, card)
    found = _compare(x, u)
    if not found.wanted > 0.0:
        return
    for signs in product((1.0, -1.0), repeat=u.shape[1]):
        turned = min(signs) < 0.0
        gain = found.products @ np.array(signs) / found.wanted
        with np.errstate(divide="ignore", invalid="ignore"):
            shape = np.nan_to_num(np.maximum(gain, 0.0) ** 2 * found.wanted / found.energy)
        likeness = 2.0 * gain - found.energy / found.wanted
        usable = (shape > _SHAPE) & (gain > _GAIN[0]) & (gain < _GAIN[1])
        if not turned:
            usable |= likeness > _FOUND
        worth = np.where(usable, shape - _OFF_GAIN * np.abs(np.log(np.maximum(gain, 1e-9))), -np.inf)
        while worth.size and (best := float(worth.max())) > -np.inf:
            k = int(worth.argmax())
            off = _off_speed(record, card, k) + _REVERSED * turned
            same = 2.0 * float(found.products[k].sum()) / found.wanted - float(found.energy[k]) / found.wanted
            whole = _Match(best - off, card, k, len(u), same, float(gain[k]) * (-1.0 if turned else 1.0))
            broken = _cut_short(record, card, x, u, k) if not turned and same < _FAITHFUL else None
            yield whole if broken is None else broken._replace(rank=whole.rank)
            worth[max(k - len(u) + 1, 0) : k + len(u)] = -np.inf


def _broken(record: FlightRecord, card: Card, x: FloatArray) -> Iterator[_Match]:
    """Yield the stretches that have the beginning of a card's command, and then no more of it."""
    u = _target(record, card)
    first = _recognised(u)
    found = _compare(x, u[:first])
    if not found.wanted > 0.0:
        return
    likeness = 2.0 * found.products.sum(axis=1) / found.wanted - found.energy / found.wanted
    while likeness.size and float(likeness.max()) > _FAITHFUL:
        k = int(likeness.argmax())
        match = _cut_short(record, card, x, u, k)
        if match is not None:
            yield match
        likeness[max(k - first + 1, 0) : k + first] = -np.inf


def _recognised(u: FloatArray) -> int:
    """Return how many samples of a command it takes to recognise a run that was broken off."""
    energy = np.cumsum(np.sum((u - u.mean(axis=0)) ** 2, axis=1))
    return int(np.searchsorted(energy, _BROKEN * energy[-1])) + 1


def _cut_short(record: FlightRecord, card: Card, x: FloatArray, u: FloatArray, k: int) -> _Match | None:
    """Return the run at sample ``k`` whose command (n, m) stops early; None if it is none, or goes on otherwise."""
    first, most = _recognised(u), min(len(u), len(x) - k)
    y, t, n = x[k : k + most], u[:most], np.arange(1, most + 1)[:, None]

    def shared(a: FloatArray, b: FloatArray) -> FloatArray:
        """Return the sum of products up to each sample, means up to it removed."""
        return np.asarray(np.sum(np.cumsum(a * b, axis=0) - np.cumsum(a, axis=0) * np.cumsum(b, axis=0) / n, axis=1))

    likeness = (2.0 * shared(y, t) - shared(y, y))[first - 1 :] / shared(t, t)[first - 1 :]
    as_flown = int(np.argmin(np.append(likeness >= _FAITHFUL, False)))
    length = first - 1 + as_flown
    if not as_flown or length == len(u) or not _given_back(record, card, x, k, length):
        return None
    same = float(likeness[as_flown - 1])
    return _Match(same - _off_speed(record, card, k), card, k, length, same, 1.0)


def _given_back(record: FlightRecord, card: Card, x: FloatArray, start: int, n: int) -> bool:
    """Return whether the controls went back to where they were before a run that was broken off, or the log ends."""
    after = x[start + n : start + n + max(1, round(_AFTER_S / record.dt_s))]
    if not len(after):
        return True
    peak = np.abs(card.signal.u).max()
    return bool(np.all(np.abs(np.median(after, axis=0) - x[_settled(record, card, start)].mean(axis=0)) < 0.5 * peak))


def _settled(record: FlightRecord, card: Card, start: int) -> slice:
    """Return the rows of the settling time before a start, or the first sample of the run if there are none."""
    return slice(max(start - round(card.spec.settle_s / record.dt_s), 0), max(start, 1))


def _off_speed(record: FlightRecord, card: Card, start: int) -> float:
    """Return by which part of its speed a run was flown beside the speed of a card; 0 if nobody knows."""
    if "V" not in record:
        return 0.0
    return abs(float(record["V"][_settled(record, card, start)].mean()) / card.point.V_m_s - 1.0)


def _run(plan: Plan, log: str, record: FlightRecord, m: _Match) -> FlownRun:
    card, start = m.card, m.start
    before = _settled(record, card, start)
    t0 = float(record.t_s[start])
    cut = record.between(float(record.t_s[before.start]), float(record.t_s[start + m.length - 1]) + 0.5 * record.dt_s)
    cut = replace(cut, provenance={**cut.provenance, AS_DESIGNED: m.likeness})
    window = plan.scenario.autopilot.speed_window_m_s
    whole = m.length >= round(card.spec.duration_s / record.dt_s)
    broken = None if whole else m.length * record.dt_s
    faults = list(_faults_of_command(m, broken))
    V = float(record["V"][before].mean()) if "V" in record else None
    if V is not None and abs(V - card.point.V_m_s) > 2.0 * window:
        faults.append(f"it began at {V:.1f} m/s instead of {card.point.V_m_s:g}")
    bands = {x.channel: (x.low, x.high) for x in card.limits if x.channel in record and x.channel not in "de da dr thr"}
    met = [b._replace(t_s=b.t_s - t0).sentence for b in breaches(cut, bands)]
    faults += met
    inside = _inside(record, card, start, m.length, before)
    strange = [name for name, part in inside.items() if part < _INSIDE]
    odd = tuple(_odd(record, card, start, m, before, strange))
    return FlownRun(
        card, log, t0, m.likeness, V, inside, tuple(faults), cut, m.gain, broken, bool(met), tuple(strange), odd
    )


def _odd(
    record: FlightRecord, card: Card, start: int, m: _Match, before: slice, strange: Sequence[str]
) -> Iterator[str]:
    """Yield what no aircraft explains of channels beside their bands: the other sign, or another unit."""
    t = np.arange(m.length) * record.dt_s
    for name in strange:
        flown = record[name][start : start + m.length] - record[name][before].mean()
        expected = np.interp(t, card.t_s, card.expected[name])
        expected = (expected - expected[0]) * np.sign(m.gain)
        size = float(np.linalg.norm(flown) * np.linalg.norm(expected))
        like = float(flown @ expected) / size if size else 0.0
        if like < -_SHAPE:
            yield f"{name} responds with the opposite sign: check the axis of its sensor"
        slope = float(np.linalg.norm(flown) / max(float(np.linalg.norm(expected)), 1e-300))
        if like > _SHAPE and (unit := next((u for u, k in _UNITS.items() if abs(slope / k - 1.0) < _UNIT_OFF), "")):
            yield f"the response of {name} is {slope:.3g} times the expected one: check its unit ({unit})"


def why_none(plan: Plan, records: Sequence[tuple[str, FlightRecord]]) -> str:
    """Return why no run of a plan was found in logs that hold its controls: unit, throw, or clock."""
    for _, record in records:
        for card in plan.cards:
            x = _commands(record, card)
            if x is None or not len(x):
                continue
            peak, wanted = float(np.ptp(x, axis=0).max()), float(np.ptp(card.signal.u, axis=0).max())
            ratio = peak / wanted if wanted else 0.0
            names = listed([command_of(record, c) or c for c in card.spec.controls])
            if ratio < _GAIN[0]:
                return f"{names} moves by {ratio:.2g} of what card {card.number} commands: check its unit and --throw"
            if ratio > _GAIN[1]:
                return (
                    f"{names} moves {ratio:.3g} times as far as card {card.number} commands: check its unit and --throw"
                )
            if record.duration_s < card.spec.duration_s:
                return f"the log lasts {record.duration_s:.3g} s, and card {card.number} {card.spec.duration_s:g} s"
    return (
        "the controls move as far as the cards command, but in no card's shape: check the clock of the log and its rate"
    )


def _faults_of_command(m: _Match, broken_s: float | None) -> Iterator[str]:
    if broken_s is not None:
        yield f"it was aborted after {broken_s:.1f} of {m.card.spec.duration_s:g} s"
    elif m.gain < 0.0:
        yield (
            f"the command was not the card's: it was recorded with the other sign, {100.0 * abs(m.gain):.0f} % of the "
            "amplitude; a servo is reversed, or the log has another sign than the card"
        )
    elif m.likeness < _FAITHFUL:
        off = abs(m.gain - 1.0) > 1.0 - _FAITHFUL
        what = f"{100.0 * m.gain:.0f} % of its amplitude" if off else f"likeness {m.likeness:.2f}"
        yield f"the command was not the card's ({what})"


def _inside(record: FlightRecord, card: Card, start: int, n: int, before: slice) -> dict[str, float]:
    """Return channel -> part of the n samples of a run inside the card's band, as deviations from before it."""
    t = np.arange(n) * record.dt_s
    still = card.t_s < 0.0
    out = {}
    for name, half in card.band.items():
        if name not in record:
            continue
        flown = record[name][start : start + n] - record[name][before].mean()
        trim = card.expected[name][still].mean() if still.any() else card.expected[name][0]
        off = np.abs(flown - np.interp(t, card.t_s, card.expected[name] - trim))
        taken = record.valid[start : start + n, record.channels.index(name)]
        if taken.any():
            out[name] = float(np.mean(off[taken] <= np.interp(t, card.t_s, half)[taken]))
    return out
