"""Before flight: which effects could these manoeuvres show, and what would be stated of them?

The question that will be asked of the records is asked of flights that are drawn from the priors, to first order: how
often is the truth named, what is it taken for, and what are stated probabilities worth? A manoeuvre is added if more
effects could then be named, by the same probabilities.

Effects are flown at usual sizes and at some that are drawn from their priors. A truth leaves in the residuals what one
of these changes, what coefficients change, an unknown motion and noise. All of the library is asked about it as the
first stage of naming asks; of the truth the right size is among those that are weighed, where a search would rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from testbench.core.blas import on_one_thread
from testbench.core.channels import CONTROLS
from testbench.core.constants import DEG_RAD, PERCENT
from testbench.core.errors import located
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.scenario.base import Manoeuvre
from testbench.core.scenario.inputs import Doublet, Input, Pulse, StandardMultistep, Sweep
from testbench.effects import Effect, library
from testbench.effects.base import SIZE
from testbench.flight import load_aircraft
from testbench.inference.calibrate import SURE, Power, Reliability, Trial, calibrate_together
from testbench.inference.first_order import Columns, FirstOrder, Left, Sums, sum_of
from testbench.inference.fit import WHOLE, whole_and_part
from testbench.inference.linear import KAPPAS, fewer
from testbench.inputs import build
from testbench.line import condition_of
from testbench.page.words import grouped
from testbench.questions.gap.again import CUT, SEED, Journal, Reflown, sizes_of
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.drive import comparing
from testbench.questions.gap.evidence.air import AirFound, in_air
from testbench.questions.gap.evidence.commanded import commands, not_compared, quiet_samples, starts_freely
from testbench.questions.gap.explain import Explanation, Weights, wrong_coefficient
from testbench.questions.gap.name import (
    COEFFICIENTS,
    INVISIBLE,
    MOST,
    WIDE,
    WIDER,
    columns_of,
    not_sought,
    starts_of,
    unknown_motion,
)
from testbench.questions.gap.search.point import NOT_FLOWN, Point, changes
from testbench.questions.run.scenario import Scenario
from testbench.sensors import load_suite

DRAWS = 900  # flights that are drawn, if nothing else is said: some five of every effect
_TOGETHER = 60
_QUIET_S = 2.0  # before a manoeuvre that is added to records without quiet flight: that of scenarios
# Airspeeds of manoeuvres that may be added, as shares of the planned one; how far from those flown they must be; and
# how far within the limits of the aircraft, as manoeuvres change the airspeed.
_SPEEDS, _NEW_SPEED, _CLEAR = (1.25, 0.85), 0.1, 1.1
_AT_OTHER_SPEEDS = ("elevator 3211", "rudder 3211", "aileron doublet")
_TAKEN_FOR = 0.1  # mean probability from which an effect is said to be taken for another
_SAID = 6  # effects that a sentence lists


@dataclass(frozen=True, eq=False)
class Addition:
    """Manoeuvres that could be flown, and the probability that each effect would be given at its usual size."""

    words: str
    given: Mapping[str, float]

    @property
    def named(self) -> tuple[str, ...]:
        """The effects that would be named."""
        return tuple(n for n, p in self.given.items() if p >= SURE)

    @property
    def worth(self) -> tuple[int, float]:
        """What is to be made large: effects named, and the sum of all probabilities."""
        return len(self.named), sum(self.given.values())


@dataclass(frozen=True, eq=False)
class GapPlan:
    """What would be stated of planned manoeuvres, and what adding one of a small family would change."""

    scenario: Scenario  # the scenario
    believed: Believed  # aircraft, sensors and condition
    manoeuvres: tuple[str, ...]  # names of those planned
    effects: Mapping[str, Effect]  # the library, by name
    unseen: Mapping[str, str]  # effect that these manoeuvres cannot show -> why
    drawn: Reliability  # flights that were drawn from the priors, and what was stated of them
    interrupted: bool  # whether more was asked for
    planned: Addition  # what the manoeuvres give as they are planned
    additions: tuple[Addition, ...]  # the same with one more, best first
    skipped: Mapping[str, str]  # additions that the believed aircraft cannot fly, with the reason

    @cached_property
    def power(self) -> dict[str, Power]:
        """Effect -> what was stated where it flew, those that were found best first."""
        found = {n: p for n, p in self.drawn.power().items() if n in self.effects}
        return dict(sorted(found.items(), key=lambda one: (-one[1].sure, -one[1].given.get(one[0], 0.0))))

    def title(self, name: str) -> str:
        """Return the name for people of an explanation."""
        words = {"nothing": "nothing", "unknown": "something that the library lacks"}
        return self.effects[name].title if name in self.effects else words.get(name, f"a wrong {name}")

    def taken_for(self, name: str) -> tuple[str, float]:
        """Return what a truth is most often taken for, and the probability that this was given on average."""
        given = self.power[name].given
        return next(((n, p) for n, p in given.items() if n != name), ("nothing", 0.0))

    @property
    def sentences(self) -> tuple[str, ...]:
        """The answer in words."""
        power, flown = self.power, self.drawn.trials
        often = [n for n, p in power.items() if p.sure >= 0.5]
        out = [
            f"of {len(self.effects)} effects of the library these manoeuvres can reveal "
            f"{len(self.effects) - len(self.unseen)}; drawn from their priors, {len(often)} of them are named in at "
            f"least half of their flights with {100.0 * SURE:g} % or more"
        ]
        if self.interrupted:
            out.append(f"interrupted: these are the results of {len(flown)} drawn flights")
        if flown:
            wrong, quiet = self.drawn.false_alarms()
            out += [self.drawn.sentence(0.95), self.drawn.sentence(1.0)]
            sure = f"{100.0 * SURE:g} % or more"
            out.append(f"in {wrong} of {quiet} flights without an effect a false statement is made with {sure}")
        pairs = [(n, *self.taken_for(n)) for n in power]
        pairs = sorted((x for x in pairs if x[1] in self.effects and x[2] >= _TAKEN_FOR), key=lambda x: -x[2])
        if pairs:
            told = "; ".join(f"{self.title(a)} for {self.title(b)} ({100.0 * p:.0f} %)" for a, b, p in pairs[:3])
            more = f", and {len(pairs) - 3} more" if len(pairs) > 3 else ""
            out.append(f"they could mistake {told}{more}")
        for why, names in grouped(self.unseen).items():
            titles = [self.title(n) for n in names]
            more = f" and {len(titles) - _SAID} more" if len(titles) > _SAID else ""
            out.append(f"{', '.join(titles[:_SAID])}{more} would not be visible: {why}")
        if self.additions or self.skipped:
            best = self.additions[0] if self.additions else self.planned
            gained = [self.title(n) for n in best.named if n not in self.planned.named]
            if len(best.named) <= len(self.planned.named) or not gained:
                out.append("none of the tried manoeuvres would allow a further effect to be named at its usual size")
            else:
                out.append(f"fly {best.words} as well: {', '.join(gained)} could then be named at the usual size")
        return (*out, *not_compared(self.believed.suite))


@on_one_thread
def plan_gap(
    scenario: Scenario, progress: Callable[[str], None] | None = None, draws: int = DRAWS, file: Path | None = None
) -> GapPlan:
    """Return what would be stated of the manoeuvres of a scenario, and what to add.

    The first suite of the scenario is believed. If it logs no commands, they are known all the same. An interrupt ends
    the draws, or the search for more manoeuvres, with what is known by then.

    Args:
        scenario: whose manoeuvres, aircraft, suite and air.
        progress: called with a few words as each stage begins.
        draws: number of flights that are drawn from the priors.
        file: keeps them, so that none is asked about twice.

    Raises:
        ScenarioError, ModelError: aircraft or suite cannot be read.
        EstimationError: ``draws`` is below 1.
        FlightAborted, TrimError, LimitError: the believed aircraft cannot fly the manoeuvres.
        RecordError, WriteError: the file cannot be read or written.
    """
    say = progress or (lambda text: None)
    aircraft, suite = load_aircraft(scenario.aircraft, scenario.wings), load_suite(scenario.suites[0])
    rate = scenario.simulation.rate_hz or aircraft.rate_hz
    with located(None, f"sensors '{suite.name}'"):
        still = comparing(Believed(aircraft, suite, condition_of(scenario.condition), rate))
    known = {n: e for n, e in library(suite, aircraft).items() if e.met is None}  # nobody plans to meet a gust
    records = [as_record(still, spec) for spec in scenario.manoeuvre]
    rms, height = scenario.air.turbulence_rms_m_s, scenario.air.height_m or scenario.condition.h_m
    air = AirFound(rms > 0.0, rms, height, 0.0, 0.0, 0.0)  # as if it had been heard
    believed = in_air(still, air)
    say("fly the library")
    sought = [e for e in known.values() if e.over_time is None]
    foreseen = Foreseen.of(believed, records, usual_sizes(sought), drawn=SIZES)
    unseen = {
        n: not_sought(foreseen.base, e)
        or "in these manoeuvres their influence could equally be absorbed by adjusted coefficients"
        for n, e in known.items()
        if n not in foreseen.effects
    }
    drawn, planned = Reliability(()), Addition("as planned", {})
    additions: list[Addition] = []
    skipped: dict[str, str] = {}
    interrupted = False
    try:
        kept = Journal(file, Reflown(believed, records, air).fingerprint)
        drawn = Reliability(tuple(kept.rows(Trial)[:draws]))
        done = len(drawn.trials)
        for found in calibrate_together(foreseen.drawn, foreseen.stated, draws, drawn.trials, _TOGETHER):
            kept.write([asdict(trial) for trial in found.trials[done:]], done)
            drawn, done = found, len(found.trials)
            say(f"{done} of {draws} flights drawn")
        few = foreseen.few
        planned = Addition("as planned", few.at_usual_size(few.sums))
        for there, spec, words in candidates(still, scenario.manoeuvre):
            say(f"what {spec.name} would add")
            try:
                more = Foreseen.of(in_air(there, air), [as_record(there, spec)], few.points, few.base.priors)
            except NOT_FLOWN as error:
                skipped[words] = str(error)
                continue
            additions.append(Addition(words, few.at_usual_size(few.sums + more.sums)))
    except KeyboardInterrupt:
        interrupted = True
    additions.sort(key=lambda a: a.worth, reverse=True)
    names = tuple(m.name for m in scenario.manoeuvre)
    return GapPlan(scenario, still, names, known, unseen, drawn, interrupted, planned, tuple(additions), skipped)


def as_record(believed: Believed, spec: Manoeuvre) -> FlightRecord:
    """Return what sensors without noise would read of a planned manoeuvre, flown from the believed trim."""
    dt = 1.0 / believed.suite.rate_hz
    signal = build(spec.input, spec.duration_s, believed.suite.rate_hz)
    quiet = max(round(spec.settle_s / dt), round(1.0 / dt))
    trim = believed.trimmed.controls
    names = tuple(n for n in CONTROLS if n in trim)
    u = np.tile([trim[n] for n in names], (quiet + signal.u.shape[0], 1))
    for i, name in enumerate(signal.channels):
        u[quiet:, names.index(name)] += signal.u[:, i]
    data = np.hstack([np.zeros((len(u), len(believed.outputs))), u])
    valid = np.ones(data.shape, bool)
    own_hz = {s.channel: s.rate_hz or believed.suite.rate_hz for s in believed.suite.sensors}
    for i, name in enumerate(believed.outputs):  # a slow sensor takes few samples
        valid[:, i] = np.arange(len(u)) % round(believed.suite.rate_hz / own_hz[name]) == 0
    channels = (*believed.outputs, *(f"{n}_cmd" for n in names))
    t = np.arange(len(u), dtype=np.float64) * dt
    record = FlightRecord(t_s=t, channels=channels, data=data, kind="measured", valid=valid)
    return record.with_columns(dict(zip(believed.outputs, believed.predict(record).T, strict=True)))


def separate(believed: Believed, records: Sequence[FlightRecord], fits: Sequence[Explanation]) -> str:
    """Return, in words, which manoeuvre would tell apart effects that ``records`` do not.

    Each of a family of manoeuvres is added to the records in turn. The best one makes the true one of two effects lead
    the other the furthest, to first order at their fitted sizes, where these two are most alike.
    """
    points = [(f.effect, np.array(list(f.values.values()))) for f in fits]
    plain = replace(believed, whiten=None)
    flown = Foreseen.of(plain, records, points)
    quiet = max((quiet_samples(r) * r.dt_s for r in records if not starts_freely(r)), default=_QUIET_S)
    best, words = 0.0, ""
    for there, spec, text in candidates(plain, (), records):
        try:
            added = as_record(there, spec.model_copy(update={"settle_s": quiet}))
            more = Foreseen.of(there, [added], points, flown.base.priors)
        except NOT_FLOWN:
            continue
        lead = _lead(flown, flown.sums + more.sums)
        if lead > best:
            best, words = lead, text
    now, needed = _lead(flown, flown.sums), math.log(SURE / (1.0 - SURE))
    if best < needed:
        return (
            f"none of the tried manoeuvres would separate them (the true one would lead by {best:.3g} in ln p at most, "
            f"{needed:.2g} needed); to separate them: {fits[0].effect.separated_by}"
        )
    return (
        f"fly next: {words}; the true one of the two most similar would then lead by {best:.3g} in ln p, against "
        f"{now:.3g} now ({needed:.2g} needed)"
    )


def _lead(foreseen: Foreseen, sums: Sums) -> float:
    """Return by how much in ln p each effect, if it is the true one, leads the others, the least of all."""
    k, effects = len(foreseen.coefficients), {e.name: e for e, _ in foreseen.points}
    said = foreseen.weighed(sums.left_by(range(k, k + len(effects))), sums, effects)
    whole = [{n: w.logs[n][0] for n in effects} for w in said]
    return min(ln[n] - max(v for m, v in ln.items() if m != n) for n, ln in zip(effects, whole, strict=True))


def candidates(
    believed: Believed, planned: Sequence[Manoeuvre], flown: Sequence[FlightRecord] = ()
) -> list[tuple[Believed, Manoeuvre, str]]:
    """Return what may be added: the belief where it is flown, a manoeuvre of the :func:`family`, and words for it.

    Some of the family are also flown at another airspeed: the moment of a damper grows with its square and that of
    Cm_q with the airspeed itself, so that no manoeuvre at one airspeed separates them. Airspeeds that were flown, and
    those near or beyond the limits of the aircraft, are left out.
    """
    here = family(believed, planned, flown)
    out = [(believed, spec, words) for spec, words in here]
    known = [believed.condition.V_m_s, *(b.condition.V_m_s for b in believed.at_each(flown))]
    low, high = believed.aircraft.limits.get("V", (0.0, np.inf))
    for share in _SPEEDS:
        V = float(f"{share * believed.condition.V_m_s:.3g}")
        if any(abs(V / v - 1.0) < _NEW_SPEED for v in known) or not _CLEAR * low <= V <= high / _CLEAR:
            continue
        there = replace(believed, condition=replace(believed.condition, V_m_s=V))
        out += [
            (there, spec.model_copy(update={"name": f"{spec.name} at {V:g} m per s"}), f"{words}, at {V:g} m/s")
            for spec, words in here
            if spec.name in _AT_OTHER_SPEEDS
        ]
    return out


def family(
    believed: Believed, planned: Sequence[Manoeuvre], flown: Sequence[FlightRecord] = ()
) -> list[tuple[Manoeuvre, str]]:
    """Return manoeuvres that may be added, each with words for it, as large as the largest that is planned or flown.

    Manoeuvres of aileron and rudder are among them only if one of these is planned or was flown.
    """
    rate = believed.suite.rate_hz
    largest = {"de": 2.0 * DEG_RAD, "da": 2.0 * DEG_RAD, "dr": 2.0 * DEG_RAD, "thr": 10.0 * PERCENT}
    moves = [build(spec.input, spec.duration_s, rate) for spec in planned]
    sizes = [(s.channels, s.u) for s in moves] + [commands(r) for r in flown]
    lateral = False
    for names, u in sizes:
        for name, column in zip(names, u.T, strict=True):
            if name in largest:
                size = float(np.max(np.abs(column)))
                largest[name] = max(largest[name], size)
                lateral = lateral or (name in ("da", "dr") and size > 1e-3)
    de, da, dr, thr = *(largest[c] / DEG_RAD for c in ("de", "da", "dr")), largest["thr"] / PERCENT
    fast = min(10.0, 0.1 * rate)  # a sweep whose samples are held goes no higher
    multistep = StandardMultistep(signal="3211", control="de", amplitude_deg=de, step_s=0.4)
    sweep = Sweep(signal="sweep", control="de", amplitude_deg=de, f_start_hz=0.5, f_end_hz=fast, sweep_s=18.0)
    small = Doublet(signal="doublet", control="de", amplitude_deg=0.25 * de, period_s=0.4, repeats=4, spacing_s=2.0)
    throttle = Doublet(signal="doublet", control="thr", amplitude_percent=thr, period_s=6.0)
    elevator = Doublet(signal="doublet", control="de", amplitude_deg=de, period_s=1.0, repeats=4, spacing_s=3.0)
    pull = Pulse(signal="pulse", control="de", amplitude_deg=-0.6 * de, width_s=4.0)
    out: list[tuple[str, float, tuple[Input, ...], str]] = [
        ("elevator 3211", 12.0, (multistep,), f"an elevator 3-2-1-1 of {de:.3g} deg with steps of 0.4 s"),
        ("elevator sweep", 20.0, (sweep,), f"an elevator sweep of {de:.3g} deg from 0.5 to {fast:.3g} Hz"),
        ("small elevator doublets", 12.0, (small,), "short elevator doublets of a quarter of the amplitude, "
         f"{0.25 * de:.2g} deg"),
        ("throttle doublet", 20.0, (throttle,), f"a throttle doublet of {thr:.3g} % with a period of 6 s"),
        ("throttle and elevator", 20.0, (throttle, elevator), "throttle and elevator doublets at once"),
        ("slow pull", 15.0, (pull,), f"an elevator pulse of {0.6 * de:.2g} deg nose up, held for 4 s"),
    ]  # fmt: skip
    if lateral:
        rudder = StandardMultistep(signal="3211", control="dr", amplitude_deg=dr, step_s=0.5)
        aileron = Doublet(signal="doublet", control="da", amplitude_deg=da, period_s=1.6)
        short = Doublet(signal="doublet", control="dr", amplitude_deg=dr, period_s=0.4, repeats=3, spacing_s=2.0)
        bank = Pulse(signal="pulse", control="da", amplitude_deg=0.5 * da, width_s=1.0)
        out += [
            ("rudder 3211", 12.0, (rudder,), f"a rudder 3-2-1-1 of {dr:.3g} deg with steps of 0.5 s"),
            ("aileron doublet", 12.0, (aileron,), f"an aileron doublet of {da:.3g} deg with a period of 1.6 s"),
            ("short rudder doublets", 12.0, (short,), f"short rudder doublets of {dr:.3g} deg"),
            ("turn", 20.0, (bank,), f"an aileron pulse of {0.5 * da:.2g} deg for 1 s into a turn, held for 18 s"),
        ]
    controls = believed.aircraft.controls
    return [
        (Manoeuvre(name=name, use="identification", duration_s=duration, input=spec), words)
        for name, duration, spec, words in out
        if all(s.control in controls for s in spec)
    ]


# Of nine truths: the priors of explain.py, of one error at a time.
KINDS = ("nothing", "effect", "nothing", "coefficient", "nothing", "effect", "unknown", "nothing", "effect")
SIZES = 3  # of each effect that are drawn from its prior and flown
_TRIED = 4  # times that those which cannot be flown are drawn again
_WHOLE, _PART = (tuple(k for k in KAPPAS if (k <= WHOLE) == whole) for whole in (True, False))
Sized = tuple[Effect, FloatArray]  # an effect and its parameter values (p,)


def usual_sizes(effects: Sequence[Effect]) -> list[Sized]:
    """Return the usual sizes of effects."""
    return [(e, x) for e in effects for x in starts_of(e)]


@dataclass(frozen=True, eq=False)
class Foreseen:
    """Records and what effects change in them about the believed model."""

    base: Point  # the believed model in them
    points: tuple[Sized, ...]  # (h,) whose changes the own columns are: ``usual`` sizes, then those that were drawn
    usual: int
    # of each record, the columns of the k coefficients, the h own ones, and again those of the coefficients, each of
    # which may be wrong
    parts: tuple[Columns, ...]

    @classmethod
    def of(
        cls,
        believed: Believed,
        records: Sequence[FlightRecord],
        points: Sequence[Sized],
        priors: Mapping[str, float] | None = None,
        drawn: int = 0,
    ) -> Foreseen:
        """Fly effects, and sizes ``drawn`` from the prior of each, through records; what cannot fly changes nothing."""
        base = Point.at(believed, believed, tuple(records), priors=priors)
        own = [np.zeros(base.exact.size) if c is None else c for c in _changes(base, points)]
        points, usual = list(points), len(points)
        rng = np.random.default_rng(SEED)
        missing = [e for e in dict.fromkeys(e for e, _ in points) for _ in range(drawn)]
        for _ in range(_TRIED if missing else 0):
            sizes = [(e, np.array(list(sizes_of(e, rng).values()))) for e in missing]
            found = _changes(base, sizes)
            flown = [(x, c) for x, c in zip(sizes, found, strict=True) if c is not None]
            points, own = [*points, *(x for x, _ in flown)], [*own, *(c for _, c in flown)]
            missing = [e for e, c in zip(missing, found, strict=True) if c is None]
        columns = -np.column_stack([base.tangents, *own, base.tangents])
        directions = [fewer(unknown_motion(believed, r), believed.taken(r)) for r in base.records]
        return cls(base, tuple(points), usual, tuple(columns_of(base, columns, directions)))

    @property
    def coefficients(self) -> tuple[str, ...]:
        """The coefficients, each of which may be wrong."""
        return tuple(self.base.priors)

    @cached_property
    def effects(self) -> dict[str, Effect]:
        """The effects that can be seen in these records, by name."""
        k = len(self.coefficients)
        squares = self.sums.squares[0, k:-k]
        return {e.name: e for (e, _), square in zip(self.points, squares, strict=True) if square > INVISIBLE}

    @cached_property
    def sums(self) -> Sums:
        """What the evidence needs of the columns."""
        return sum_of(c.sums for c in self.parts)

    def weighed(
        self, left: Left, sums: Sums | None = None, effects: Mapping[str, Effect] | None = None
    ) -> list[Weights]:
        """Return what is said of residuals, of each apart.

        Naming flies what comes nearest at the usual sizes; so that alone is weighed, at all sizes. ``sums`` are those
        of all records that these are residuals of, ``effects`` those that are sought: of those here if not given.
        """
        std, k = self.base.prior_std, len(self.coefficients)
        effects = self.effects if effects is None else effects
        sizes = np.concatenate([[_multiple(*point) for point in self.points], WIDER * std])
        found = FirstOrder.of(self.sums if sums is None else sums, left, np.zeros(k), std, sizes)
        owners = np.array([*(e.name for e, _ in self.points), *self.coefficients])
        near = np.arange(len(owners)) < self.usual
        logs = {"nothing": whole_and_part(found.alone)}
        logs |= {n: whole_and_part(found.logs[:, owners == n].max(axis=1)) for n in (*effects, *self.coefficients)}
        first = {n: found.logs[:, (owners == n) & near].max(axis=(0, 1)) for n in effects}
        wrong = {n: found.logs[:, owners == n].max(axis=(0, 1)) for n in self.coefficients}
        named = {**effects, **{n: wrong_coefficient(n) for n in self.coefficients}}
        out = []
        for i in range(left.c.shape[1]):
            flown = [*_nearest(first, i, MOST), *_nearest(wrong, i, COEFFICIENTS)]
            said = {n: (float(logs[n][0, i]), float(logs[n][1, i])) for n in ("nothing", *flown)}
            out.append(Weights(said, {n: named[n] for n in flown}, max(1, len(effects)), k))
        return out

    def stated(self, left: Sequence[Left]) -> list[dict[str, float]]:
        """Return what is stated of each of several residuals: explanation -> probability."""
        return [w.stated for w in self.weighed(Left.beside(left))]

    def drawn(self, numbers: Sequence[int]) -> list[tuple[str, Left]]:
        """Return truths of these numbers, drawn from the priors: name, and the sums of what they leave."""
        out = []
        for number in numbers:
            rng = np.random.default_rng([SEED, number])
            name, multiples, kappa = self.truth(number, rng)
            pulses = [np.asarray(kappa * rng.standard_normal(c.U.shape[1])) for c in self.parts]
            out.append((name, sum_of(c.drawn(multiples, u, rng) for c, u in zip(self.parts, pulses, strict=True))))
        return out

    def truth(self, number: int, rng: np.random.Generator) -> tuple[str, FloatArray, float]:
        """Return the truth of a number: name, multiples (K,) of all columns, and size of the unknown motion."""
        turn, place = divmod(number, len(KINDS))
        kind, k = KINDS[place], len(self.coefficients)
        before = turn * KINDS.count(kind) + KINDS[:place].count(kind)  # of its kind
        multiples = np.zeros(2 * k + len(self.points))
        multiples[:k] = self.base.prior_std * np.clip(rng.standard_normal(k), -CUT, CUT)
        kappa = float(rng.choice(_PART if kind == "unknown" else _WHOLE))
        if kind == "coefficient":
            multiples[before % k] *= WIDE
            return self.coefficients[before % k], multiples, kappa
        imitated = kind == "unknown" and before % 2 == 1
        if kind == "nothing" or (kind == "unknown" and not imitated) or not self._truths:
            return "nothing" if kind == "effect" else kind, multiples, kappa
        effect, point = self._truths[(before // 2 if imitated else before) % len(self._truths)]
        multiples[k + point] = 1.0
        return kind if imitated else effect, multiples, kappa

    @cached_property
    def _truths(self) -> list[tuple[str, int]]:
        """Return effects and the places of their sizes that were drawn: each effect in turn, in an order of chance."""
        places: dict[str, list[int]] = {}
        for i, (effect, _) in enumerate(self.points[self.usual :], self.usual):
            if effect.name in self.effects:
                places.setdefault(effect.name, []).append(i)
        names = list(places)
        order = np.random.default_rng(SEED).permutation(len(names))
        return [(names[i], places[names[i]][turn % len(places[names[i]])]) for turn in range(SIZES) for i in order]

    @cached_property
    def few(self) -> Foreseen:
        """The same with the first usual size of each effect alone."""
        k, names = len(self.coefficients), [e.name for e, _ in self.points]
        first = [names.index(n) for n in dict.fromkeys(names)]
        last = range(k + len(names), 2 * k + len(names))
        at = [*range(k), *(k + i for i in first), *last]
        points = tuple(self.points[i] for i in first)
        return replace(self, points=points, usual=len(points), parts=tuple(c.some(at) for c in self.parts))

    def at_usual_size(self, sums: Sums) -> dict[str, float]:
        """Return effect -> probability that it would be given if it were there at its one size here.

        Without noise, coefficients as they are believed: ln p is then what it is on average, to first order. The sums
        are those of all records that would be flown.
        """
        k = len(self.coefficients)
        seen = sums.squares[0, k:-k] > INVISIBLE
        shown = [(k + i, e) for i, (e, _) in enumerate(self.points) if seen[i]]
        said = self.weighed(sums.left_by([i for i, _ in shown]), sums, {e.name: e for _, e in shown}) if shown else []
        return {e.name: w[e.name] for (_, e), w in zip(shown, said, strict=True)}


def _changes(base: Point, points: Sequence[Sized]) -> list[FloatArray | None]:
    """Return what effects change in the residuals (samples,); None for those that cannot fly or are not sought."""
    sought = [i for i, (effect, _) in enumerate(points) if base.lateral or not effect.lateral]
    found = dict(zip(sought, changes(base, [points[i] for i in sought]), strict=True))
    return [c if (c := found.get(i)) is not None and np.all(np.isfinite(c)) else None for i in range(len(points))]


def _nearest(logs: Mapping[str, FloatArray], i: int, most: int) -> list[str]:
    """Return the names of the largest of ln p (r,) of one residual."""
    return sorted(logs, key=lambda n: -logs[n][i])[:most]


def _multiple(effect: Effect, x: FloatArray) -> float:
    """Return the prior deviation of a multiple of what an effect changes at values (p,)."""
    sizes = [(q, v) for q, v in zip(effect.parameters, x, strict=True) if q.none is not None]
    if len(sizes) != 1:
        return SIZE
    (q, v), none = sizes[0], sizes[0][0].none or 0.0
    return SIZE * max(abs(s - none) for s in q.starts) / max(abs(float(v) - none), 1e-9)
