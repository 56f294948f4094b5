"""Follow a flight: what its channels tell, plane by plane, and what is to be called out. Nothing is sent."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import partial

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.adapter import SURFACES
from testbench.core.constants import G0_M_S2
from testbench.core.errors import RecordError, Refusal
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.words import with_error
from testbench.inference.changes import FASTEST_HZ as FASTEST_CHANGES_HZ
from testbench.inference.changes import SURE, Watch
from testbench.inference.multiple_models import Weighed
from testbench.page.shown import Shown
from testbench.questions.identify.derivatives import servos_of
from testbench.questions.importing.changes import change_sentence
from testbench.questions.live.belief import CONTROLS, DRAWS, Believed
from testbench.questions.live.careful import TOGETHER, Beside, Careful, Run, identified
from testbench.questions.live.clock import FASTEST_HZ, Clock, Rate
from testbench.questions.live.course import Course, Outlook
from testbench.questions.live.stream import Sample, Source
from testbench.questions.live.track import QUIET_S, Estimate, Plane
from testbench.questions.plan.close import FlownRun, close_plan
from testbench.questions.plan.result import Card, Plan, Point

UPDATE_S = 0.5
LISTEN_S = 3.0
"""Before anything is said of the flight: what the link gives is measured first."""
_AT_ONCE = 2
_CARDS_EVERY = 8  # updates: whole runs are looked for, which take longer
LEAST_HZ = 4.0
WANTED = 0.1
"""Standard error that is wanted relative to the value where no card says it."""
_LONG_AGO_S = 15.0  # after a run in which no card is recognised
_SAID = 3  # derivatives of a careful estimate that are called out
_SLOW = 0.8  # of the slowest speed of the aircraft, below which it does not fly
_OTHER_SPEED = 0.25  # share by which the speed may differ from that at which derivatives are believed
_ANGLE = {"longitudinal": ("alpha", ("q", "az")), "lateral": ("beta", ("p", "r", "phi", "ay"))}
_REST = {"longitudinal": ("q",), "lateral": ("p", "r", "phi")}
_KINEMATIC_S, _KINEMATIC, _LEAST_V = 2.0, 8.0, 0.12  # of airspeed against forces: over, deviations, share of V
_FROZEN_S, _SAME = 1.0, 1e-9  # of samples that differ by less than this share of themselves


@dataclass(frozen=True)
class Call:
    """What is called out."""

    t_s: float  #: when, on the clock of the source
    kind: str  #: "limit", "stop", "instrument", "change", "enough", "run", "careful" or "next"
    channel: str = ""  #: that it is of; "" if of none
    #: value, other: what was found, and what it is set against
    value: float = 0.0
    other: float = 0.0
    words: str = ""  #: what else the sentence needs


@dataclass(frozen=True)
class Update:
    """What is known at one time: plane -> derivatives so far, whether it answers as believed, and what is called."""

    t_s: float
    active: tuple[str, ...]
    estimates: Mapping[str, tuple[Estimate, ...]]
    weighed: Mapping[str, tuple[Weighed, ...]]
    calls: tuple[Call, ...]
    outlook: Outlook | None = None
    changed: float | None = None  #: probability that something is changed now; None if nobody asked

    def line(self) -> str:
        """Return it as a line of JSON; the same samples give the same line."""
        return json.dumps(asdict(self), allow_nan=True) + "\n"


@dataclass(eq=False)
class Session(Shown, page="testbench.questions.live.page:live_page"):
    """A flight that is followed."""

    source: str  #: its name
    aircraft: Aircraft  #: what is believed to fly
    plan: Plan | None = None  #: whose cards are flown; None without one
    rates: Mapping[str, Rate] = field(default_factory=dict)  #: channel -> what the link gave while it was listened to
    told: dict[str, str] = field(default_factory=dict)  #: plane -> why its derivatives cannot be told, "" if they can
    updates: list[Update] = field(default_factory=list)  #: every half second, without those that hold nothing
    calls: list[Call] = field(default_factory=list)  #: all that was called out
    course: Course | None = None  #: what is known for each card; None without a plan
    outlook: Outlook | None = None  #: what to fly from now on; None before the first run
    beginning_s: float | None = None  #: flight at the beginning that changes are sought from; None if they are not
    flown: dict[int, int] = field(default_factory=dict)  #: card -> its good runs
    notes: list[str] = field(default_factory=list)  #: in sentences
    #: V_m_s, h_m: condition that the derivatives are given at, however the speed has changed
    V_m_s: float = np.nan
    h_m: float = np.nan

    @property
    def next_card(self) -> Card | None:
        """The card to fly next; None without a plan, or if nothing is left to fly."""
        cards = () if self.plan is None else self.plan.cards
        if self.outlook is not None:
            return next((c for c in cards if c.number == self.outlook.card), None)
        return next((c for c in cards if c.repeats > self.flown.get(c.number, 0)), None)

    def latest(self, plane: str) -> tuple[Estimate, ...]:
        """Return the last derivatives of a plane."""
        return next((u.estimates[plane] for u in reversed(self.updates) if u.estimates.get(plane)), ())


def fly_along(
    source: Source,
    aircraft: Aircraft,
    plan: Plan | None = None,
    wanted: float = WANTED,
    keep: Callable[[Sample | Careful], None] | None = None,
    session: Session | None = None,
    draws: int = DRAWS,
) -> Iterator[Update]:
    """Follow a flight from its samples; yield what is known, every half second of its clock.

    When a run has ended, a process beside this one identifies it carefully (:mod:`.careful`); what it finds takes the
    place of what was found in flight, from the next update on.

    Args:
        source: of :func:`testbench.questions.live.stream.open_source`.
        aircraft: believed to fly.
        plan: whose cards are flown: wanted accuracies, and which card is next.
        wanted: standard error of derivatives relative to their values, where no card says it.
        keep: called with every sample as it arrives, and with every careful estimate.
        session: takes all that is found; its last state is the answer.
        draws: aircraft drawn within the uncertainty of the believed one.

    Raises:
        RecordError: the stream ended before anything could be told of it.

    Example:
        >>> source = open_source("flight.ulg", {}, {}, None, True, 0.0)  # doctest: +SKIP
        >>> for update in fly_along(source, tb.load_aircraft("taurus")):  # doctest: +SKIP
        ...     print(update.t_s, update.calls)
    """
    session = Session(source.name, aircraft, plan) if session is None else session
    behind = {} if plan is None else {s.channel: s.lag_s + s.delay_s for s in plan.suite.sensors}
    clock, follower, due, awaits = Clock(behind), None, np.inf, source.careful == "awaited"
    with Beside() as beside:

        def know(wait: bool) -> None:
            while follower is not None and source.careful and (found := beside.take(wait)) is not None:
                if keep is not None:
                    keep(found)
                follower.know(found)

        for sample in source.samples:
            if keep is not None:
                keep(sample)
            if isinstance(sample, Careful):
                if follower is not None:
                    follower.know(sample)
                continue
            clock.add(sample)
            if follower is None:
                if clock.newest_s - clock.first_s < LISTEN_S:
                    continue
                follower = _Follower(session, clock, wanted, draws)
                due = clock.newest_s + UPDATE_S
            if clock.newest_s >= due:
                due += UPDATE_S * max(1.0, np.floor((clock.newest_s - due) / UPDATE_S) + 1.0)
                update = follower.update(beside)
                if update is not None:
                    session.updates.append(update)
                    session.calls += update.calls
                    yield update
                know(awaits)
        know(True)
    if follower is not None and (update := follower.last()) is not None:
        session.updates.append(update)
        session.calls += update.calls
        yield update
    if follower is None:
        raise RecordError(
            f"'{source.name}' must give {LISTEN_S:g} s of samples before anything can be told, got "
            f"{max(clock.newest_s - clock.first_s, 0.0):.3g} s"
        )


class _Follower:
    """Everything that is remembered of a flight between updates."""

    def __init__(self, session: Session, clock: Clock, wanted: float, draws: int) -> None:
        self.session, self.clock, self.wanted, self.draws = session, clock, wanted, draws
        self.plan, self.aircraft = session.plan, session.aircraft
        session.rates = rates = clock.rates()
        if not rates:
            raise RecordError(f"'{session.source}' gave fewer than four samples of every channel in {LISTEN_S:g} s")
        self.uses, angles = {}, {}
        for plane in CONTROLS:
            use, integrated, why = _usable(plane, rates, self.aircraft)
            session.told[plane] = why
            if not why:
                self.uses[plane], angles[plane] = use, integrated
        self.angles = angles
        needed = {c for use in self.uses.values() for c in use} or set(rates)
        self.rate_hz = float(min(FASTEST_HZ, *(rates[c].hz for c in needed)))
        self.rate_hz = round(self.rate_hz) if self.rate_hz > 10.0 else self.rate_hz
        clock.start(self.rate_hz)
        self.names = tuple(sorted(rates))
        self.planes: dict[str, Plane] = {}
        self.V = self.h = np.nan
        self.flies, self.drawn, self.updates = False, 0, 0
        self.believed: Believed | None = None
        self.blocks: deque[FlightRecord] = deque()
        self.outside: set[str] = set()
        self.enough: set[str] = set()
        self.speed = _Speed(1.0 / self.rate_hz)
        self.frozen: dict[str, int] = {}
        self.changes: dict[str, int] = {}
        self.counted: set[tuple[int, float]] = set()
        session.course = self.course = None if self.plan is None else Course(self.plan, wanted)
        self.ahead, self.named = False, ("", "")
        self.watch, self.passed, self.different = self._watching(), 0, ("", "")
        self.careful: list[tuple[Plane, Run, str]] = []
        self.anew: set[str] = set()
        self.asked: set[float] = set()

    def _watching(self) -> Watch | None:
        """Return what changes are watched for with, on every so many samples of the clock."""
        self.stride = int(np.ceil(self.rate_hz / FASTEST_CHANGES_HZ - 1e-6))
        if self.session.beginning_s is None:
            return None
        try:
            return Watch(self.names, self.stride / self.rate_hz, self.session.beginning_s)
        except RecordError as error:
            self.session.notes.append(f"no changes are watched for: {error}")
            return None

    def update(self, beside: Beside) -> Update | None:
        block = self.clock.block(self.names)
        if block is None:
            return None
        t_s = float(block.t_s[-1])
        low, high = self.aircraft.limits.get("V", (0.0, np.inf))
        V = self.clock.mean("V", LISTEN_S, self.aircraft.design_V_m_s)
        self.flies = _SLOW * low <= V <= high / _SLOW  # on the ground nothing is believed, nor out of limits
        calls = [*self._limits(block, t_s), *self._instruments(block, t_s)] if self.flies else []
        changed, different = self._changes(block, t_s)
        calls += different
        self._believe(block)
        self._draw()
        self.blocks.append(block)
        while self.blocks and self.blocks[0].t_s[0] < t_s - 180.0:
            self.blocks.popleft()
        estimates, weighed, active, done = {}, {}, [], []
        for name, plane in self.planes.items():
            ended = plane.take(block)
            if ended:
                self._learn(plane)
                done.append(plane)
            if plane.active or ended:
                active.append(name)
            if plane.active or ended or name in self.anew:
                estimates[name] = plane.estimates()
                weighed[name] = plane.weighed()
                found = plane.unexpected(weighed[name])
                if found is not None:
                    calls.append(Call(t_s, "stop", plane.name_of(found), found.value, found.probability, found.kind))
            calls += self._enough(name, estimates.get(name, ()), t_s)
        self.anew.clear()
        self.updates += 1
        if done or self.updates % _CARDS_EVERY == 0:
            calls += self._cards(t_s)
            for plane in self.planes.values():
                self._ask(plane, beside)
        calls += self._careful(t_s)
        outlook = None
        if self.course is not None and self.course.expect() and self.ahead and not active:
            outlook = self._look_ahead()
            what = str(outlook.card or ""), outlook.words
            if what != self.named:
                calls.append(Call(t_s, "next", what[0], outlook.left_s, outlook.printed_s, what[1]))
            self.named = what
        return Update(t_s, tuple(active), estimates, weighed, tuple(calls), outlook, changed)

    def _changes(self, block: FlightRecord, t_s: float) -> tuple[float | None, list[Call]]:
        """Return the probability that something is changed now, and what is called out: once, and again if renamed."""
        if self.watch is None:
            return None, []
        rows = (self.passed + np.arange(len(block))) % self.stride == 0
        self.passed += len(block)
        valid = block.valid[rows] & self.flies
        try:
            self.watch.take(FlightRecord(block.t_s[rows], block.channels, block.data[rows], "measured", valid))
        except RecordError as error:
            self.session.notes.append(f"no changes are watched for: {error}")
            self.watch = None
            return None, []
        changed = 1.0 - float(self.watch.now[0])
        if changed < 0.5:
            self.different = ("", "")
        if changed < SURE:
            return changed, []
        what = self.watch.found(smoothed=False)[-1]
        if (what.kind, what.part) == self.different:
            return changed, []
        self.different = what.kind, what.part
        return changed, [Call(t_s, "change", what.part, what.factor, changed, change_sentence(what))]

    def _learn(self, plane: Plane) -> None:
        """Let the course of the plan know what a plane tells now."""
        if self.course is not None:
            self.course.learn(plane)
            self.ahead = True

    def _point(self, V_m_s: float) -> Point | None:
        """Return the point of the plan whose airspeed is nearest; None without a plan."""
        points = () if self.plan is None else self.plan.points
        return min(points, key=lambda p: abs(p.V_m_s - V_m_s), default=None)

    def _ask(self, plane: Plane, beside: Beside) -> None:
        """Let the runs of a plane at one point be identified carefully, once there is a new one."""
        flown = [run for run in plane.runs if set(run.moved) & set(CONTROLS[plane.name])]
        if not flown or flown[-1].begun_s in self.asked:
            return
        self.asked.add(flown[-1].begun_s)
        of = [self._point(run.V_m_s) for run in flown]
        runs = [run for run, point in zip(flown, of, strict=True) if point is of[-1]]
        runs = runs[(len(runs) - 1) // TOGETHER * TOGETHER :]
        said = Careful(plane.name, tuple(run.number for run in runs), runs[-1].begun_s)
        beside.begin((plane.name, runs[0].number), partial(identified, plane.so_far, runs, said))

    def _card(self, plane: Plane, run: Run) -> int:
        """Return the last card of the motion of a plane that a run holds; 0 if it holds none."""
        cards = {c.number: c.spec for c in (() if self.plan is None else self.plan.cards) if c.spec.plane == plane.name}
        end_s = run.begun_s + run.record.duration_s
        return max((n for n, at in self.counted if n in cards and run.begun_s - cards[n].duration_s < at < end_s),
                   default=0)  # fmt: skip

    def know(self, found: Careful) -> None:
        """Let a careful estimate take the place of what its runs said in flight, and call it out."""
        plane = self.planes.get(found.plane)
        run = None if plane is None else next((r for r in plane.runs if r.begun_s == found.begun_s), None)
        if plane is None or run is None:  # the condition has changed since
            return
        if found.why:
            self.careful.append((plane, run, f"no estimate: {found.why}"))
            return
        before = {e.name: e for e in plane.estimates()}
        plane.told(found)
        self._learn(plane)
        self.anew.add(plane.name)
        now = sorted((e for e in plane.estimates() if e.wanted), key=lambda e: e.std / max(abs(e.value), 1e-12))
        told = [e for e in now if e.name in found.names][:_SAID]
        words = [
            ", ".join(f"{e.name} {with_error(e.value, e.std)}" for e in told),
            ", ".join(with_error(before[e.name].value, before[e.name].std) for e in told if e.name in before),
        ]
        self.careful.append((plane, run, "; live said ".join(w for w in words if w)))

    def _careful(self, t_s: float, ended: bool = False) -> Iterator[Call]:
        """Yield what was found carefully, once it is known of which card: of none, if its run has ended long ago."""
        waiting, self.careful = self.careful, []
        for plane, run, words in waiting:
            card = self._card(plane, run)
            if card or ended or self.plan is None or t_s > run.begun_s + run.record.duration_s + _LONG_AGO_S:
                yield Call(t_s, "careful", f"card {card}" if card else plane.name, words=words)
            else:
                self.careful.append((plane, run, words))

    def _look_ahead(self) -> Outlook:
        """Return what to fly from now on."""
        assert self.course is not None
        self.ahead = False
        self.session.outlook = outlook = self.course.outlook(self.session.flown)
        return outlook

    def last(self) -> Update | None:
        """Return the runs of cards that the end of the flight holds; None if there are none."""
        t_s = float(self.blocks[-1].t_s[-1]) if self.blocks else 0.0
        calls = (*self._cards(t_s, ended=True), *self._careful(t_s, ended=True)) if self.blocks else ()
        return Update(t_s, (), {}, {}, calls) if calls else None

    def _believe(self, block: FlightRecord) -> None:
        """Take the aircraft at the speed and height that are flown, at first and whenever both have changed."""
        if not self.uses or not self.flies or any(p.active for p in self.planes.values()):
            return
        usual = {"V": self.aircraft.design_V_m_s, "h": self.aircraft.design_h_m}
        V, h = (self.clock.mean(n, LISTEN_S, x) for n, x in usual.items())
        if (point := self._point(V)) is not None:
            V, h = point.V_m_s, point.h_m  # what a run has made of the speed is none that a plan wants anything of
        if abs(V - self.V) <= _OTHER_SPEED * self.V:
            return
        self.V, self.h, self.planes = V, h, {}
        self.session.V_m_s, self.session.h_m = V, h
        try:
            believed = Believed.of(self.aircraft, V, h)
        except Refusal as error:
            self.session.notes.append(f"at {V:.3g} m/s nothing is believed: {error.message}")
            return
        for name, use in self.uses.items():
            sources = {c: next(n for n in use if n in (c, f"{c}_cmd")) for c in CONTROLS[name] if
                       any(n in (c, f"{c}_cmd") for n in use)}  # fmt: skip
            servos = servos_of(self.aircraft, list(sources.values()))
            lags = {c: s.lag_s for c, n in sources.items() if (s := servos.get(n)) and isinstance(s.lag_s, float)}
            wanted = {"": self.wanted, **self._of_cards(name)}
            how = (1.0 / self.rate_hz, self.angles[name], "V" in block, self._noise)
            self.planes[name] = Plane(name, sources, lags, believed, wanted, *how)
            self._learn(self.planes[name])
        self.enough.clear()
        self.believed, self.drawn = believed, 0

    def _noise(self, name: str) -> float:
        return self.clock.noise(name, QUIET_S)

    def _draw(self) -> None:
        """Draw some more aircraft of the uncertainty: all at once would take longer than an update may."""
        if self.believed is None or self.drawn >= self.draws:
            return
        more = range(self.drawn, min(self.drawn + _AT_ONCE, self.draws))
        self.believed, self.drawn = self.believed.with_draws(more), more.stop
        for plane in self.planes.values():
            plane.expect(self.believed)

    def _of_cards(self, plane: str) -> dict[str, float]:
        cards = () if self.plan is None else self.plan.cards
        return {n: x / 100.0 for c in cards if c.spec.plane == plane for n, x in c.spec.accuracy_percent.items()}

    def _limits(self, block: FlightRecord, t_s: float) -> Iterator[Call]:
        """Yield the limits of the aircraft that are left, once each time."""
        values = {n: block[n] for n in block.channels}
        if "az" in block:
            values["nz"] = -block["az"] / G0_M_S2
        bands = dict(self.aircraft.limits)
        if self.plan is not None:
            bands |= {x.channel: (x.low, x.high) for c in self.plan.cards[:1] for x in c.limits}
        for name, (low, high) in bands.items():
            if name not in values:
                continue
            worst = max((float(values[name].min()), float(values[name].max())), key=lambda x: max(low - x, x - high))
            if low <= worst <= high:
                self.outside.discard(name)
            elif name not in self.outside:
                self.outside.add(name)
                yield Call(t_s, "limit", name, worst, high if worst > high else low)

    def _instruments(self, block: FlightRecord, t_s: float) -> Iterator[Call]:
        """Yield instruments that stand still, and an airspeed that does not follow the forces."""
        for name in block.channels:
            if name.removesuffix("_cmd") in (*SURFACES, "thr"):
                continue
            x = block[name][block.valid[:, block.channels.index(name)]]
            still = x.size > 0 and float(np.ptp(x)) <= _SAME * abs(float(x[0]))
            self.frozen[name] = self.frozen.get(name, 0) + 1 if still else 0
            self.changes[name] = self.changes.get(name, 0) + (not still)
            lively = self.changes[name] > 5 and self.frozen[name] * UPDATE_S >= _FROZEN_S
            if lively and self.frozen[name] == round(_FROZEN_S / UPDATE_S):
                yield Call(t_s, "instrument", name, float(x[-1]), words="frozen")
        off = self.speed.take(block)
        if off is not None:
            yield Call(t_s, "instrument", "V", off, words="forces")

    def _enough(self, name: str, estimates: tuple[Estimate, ...], t_s: float) -> Iterator[Call]:
        targets = [e for e in estimates if e.wanted > 0.0]
        if not targets or name in self.enough or not all(e.reached for e in targets):
            return
        self.enough.add(name)
        card = self.session.next_card
        yield Call(t_s, "enough", name, words="" if card is None else str(card.number))

    def _cards(self, t_s: float, ended: bool = False) -> Iterator[Call]:
        """Yield the runs of cards that the last minutes hold and that have not been told yet."""
        if self.plan is None:
            return
        names = self.blocks[0].channels
        data, valid = (np.vstack([getattr(b, part) for b in self.blocks]) for part in ("data", "valid"))
        t = np.concatenate([b.t_s for b in self.blocks])
        record = FlightRecord(t, names, data, "measured", valid)
        try:
            runs: tuple[FlownRun, ...] = close_plan(self.plan, [("live", record)]).runs
        except Refusal:
            return
        for run in runs:
            number, length_s = run.card.number, run.card.spec.duration_s
            if not ended and t[-1] < run.start_s + length_s + 1.0:
                continue  # it is still being flown
            if any(of == number and abs(start - run.start_s) < length_s for of, start in self.counted):
                continue
            key = number, run.start_s
            self.counted.add(key)
            if not run.faults:
                self.session.flown[run.card.number] = self.session.flown.get(run.card.number, 0) + 1
            after = self.session.next_card
            yield Call(t_s, "run", str(run.card.number), run.likeness, after.number if after else 0,
                       "; ".join((*run.faults, *run.anomalies)))  # fmt: skip


class _Speed:
    """Airspeed against what forces and gravity make of it over two seconds: dV = integral of ax - g sin(theta)."""

    def __init__(self, dt_s: float) -> None:
        self.dt_s = dt_s
        self._rows: deque[tuple[float, float]] = deque(maxlen=max(2, round(_KINEMATIC_S / dt_s) + 1))
        self._seen: deque[float] = deque(maxlen=200)
        self._sum, self._odd = 0.0, 0

    def take(self, block: FlightRecord) -> float | None:
        """Take samples; return by how much the airspeed has left the forces, m/s, if it has, in two blocks in a row."""
        if any(name not in block for name in ("V", "ax", "theta")):
            return None
        if not all(block.valid[:, block.channels.index(n)].all() for n in ("V", "ax", "theta")):
            self._rows.clear()  # nothing is known of what was lost: two whole seconds are needed again
            self._odd = 0
            return None
        rate: FloatArray = block["ax"] - G0_M_S2 * np.sin(block["theta"])
        for V, dV in zip(block["V"].tolist(), rate.tolist(), strict=True):
            self._sum += self.dt_s * dV
            self._rows.append((V, self._sum))
        if len(self._rows) < (self._rows.maxlen or 0):
            return None
        (V0, s0), (V1, s1) = self._rows[0], self._rows[-1]
        off = (V1 - V0) - (s1 - s0)
        usual = float(np.median(self._seen)) if self._seen else 0.0
        spread = 1.5 * float(np.median(np.abs(np.array(self._seen) - usual))) if len(self._seen) > 9 else np.inf
        odd = abs(off - usual) > max(_KINEMATIC * spread, _LEAST_V * V0)
        if not odd:
            self._seen.append(off)
        self._odd = self._odd + 1 if odd else 0
        return off - usual if self._odd == 2 else None


def _usable(plane: str, rates: Mapping[str, Rate], aircraft: Aircraft) -> tuple[tuple[str, ...], bool, str]:
    """Return the channels of a plane of motion, whether its flow angle is integrated, and why it cannot be told."""
    angle, integral = _ANGLE[plane]
    have = {n for n, r in rates.items() if r.hz >= LEAST_HZ}
    named = [next((n for n in (c, f"{c}_cmd") if n in have), None) for c in CONTROLS[plane] if c in aircraft.controls]
    controls = tuple(n for n in named if n is not None)
    slow = [n for n in (*_REST[plane], angle, *integral) if n in rates and n not in have]
    if not controls:
        return (), False, f"no {' or '.join(f'{c} or {c}_cmd' for c in CONTROLS[plane])} at {LEAST_HZ:g} Hz or more"
    missing = [n for n in _REST[plane] if n not in have]
    if missing:
        why = "comes too slowly" if set(missing) <= set(slow) else "does not come"
        return (), False, f"{', '.join(missing)} {why}: {LEAST_HZ:g} Hz at least"
    if angle in have:
        return (*_REST[plane], angle, *controls), False, ""
    if set(integral) <= have:
        return (*dict.fromkeys((*_REST[plane], *integral)), *controls), True, ""
    return (), False, f"neither {angle} nor {' and '.join(integral)} come at {LEAST_HZ:g} Hz or more"
