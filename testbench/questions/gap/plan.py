"""Before flight: which effects could these manoeuvres show, and what would be stated of them?

The question that will be asked of the records is asked of flights that are drawn from the priors
(:mod:`testbench.questions.gap.foreseen`): how often is the truth named, what is it taken for, and what are stated
probabilities worth? A manoeuvre is added if more effects could then be named, by the same probabilities.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from testbench.core.blas import on_one_thread
from testbench.core.channels import CONTROLS
from testbench.core.constants import DEG_RAD, PERCENT
from testbench.core.errors import LimitError, TrimError, located
from testbench.core.record import FlightAborted, FlightRecord
from testbench.core.scenario.base import Manoeuvre
from testbench.core.scenario.inputs import Doublet, Input, Pulse, StandardMultistep, Sweep
from testbench.effects import Effect, library
from testbench.flight import load_aircraft
from testbench.inference.calibrate import SURE, Power, Reliability, calibrate_together
from testbench.inference.first_order import Sums
from testbench.inputs import build
from testbench.line import condition_of
from testbench.page.words import grouped
from testbench.questions.gap.again import Kept, fingerprint
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.drive import comparing
from testbench.questions.gap.evidence.air import AirFound, in_air
from testbench.questions.gap.evidence.commanded import commands, not_compared, quiet_samples, starts_freely
from testbench.questions.gap.explain import Explanation
from testbench.questions.gap.foreseen import SIZES, Foreseen, usual_sizes
from testbench.questions.gap.name import not_sought
from testbench.questions.run.scenario import Scenario
from testbench.sensors import load_suite

DRAWS = 900
"""Flights that are drawn, if nothing else is said: some five of every effect."""
_TOGETHER = 60
_QUIET_S = 2.0  # before a manoeuvre that is added to records without quiet flight: that of scenarios
# Airspeeds of manoeuvres that may be added, as shares of the planned one; how far from those flown they must be; and
# how far within the limits of the aircraft, as manoeuvres change the airspeed.
_SPEEDS, _NEW_SPEED, _CLEAR = (1.25, 0.85), 0.1, 1.1
_AT_OTHER_SPEEDS = ("elevator 3211", "rudder 3211", "aileron doublet")
_TAKEN_FOR = 0.1  # mean probability from which an effect is said to be taken for another
_SAID = 6  # effects that a sentence lists
_NOT_FLOWN = (FlightAborted, LimitError, TrimError)


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
    """What would be stated of planned manoeuvres, and what adding one of a small family would change.

    Attributes:
        scenario: the scenario.
        believed: aircraft, sensors and condition.
        manoeuvres: names of those planned.
        effects: the library, by name.
        unseen: effect that these manoeuvres cannot show -> why.
        drawn: flights that were drawn from the priors, and what was stated of them.
        interrupted: whether more was asked for.
        planned: what the manoeuvres give as they are planned.
        additions: the same with one more, best first.
        skipped: additions that the believed aircraft cannot fly, with the reason.
    """

    scenario: Scenario
    believed: Believed
    manoeuvres: tuple[str, ...]
    effects: Mapping[str, Effect]
    unseen: Mapping[str, str]
    drawn: Reliability
    interrupted: bool
    planned: Addition
    additions: tuple[Addition, ...]
    skipped: Mapping[str, str]

    @cached_property
    def power(self) -> dict[str, Power]:
        """Effect -> what was stated where it flew, those that were found best first."""
        found = {n: p for n, p in self.drawn.power().items() if n in self.effects}
        return dict(sorted(found.items(), key=lambda one: (-one[1].sure, -one[1].given.get(one[0], 0.0))))

    def title(self, name: str) -> str:
        """Return the name for people of an explanation."""
        return self.effects[name].title if name in self.effects else _WORDS.get(name, f"a wrong {name}")

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
            f"of {len(self.effects)} effects of the library these manoeuvres can show "
            f"{len(self.effects) - len(self.unseen)}; drawn from their priors, {len(often)} of them are named in at "
            f"least half of their flights with {100.0 * SURE:g} % or more"
        ]
        if self.interrupted:
            out.append(f"interrupted: this is what {len(flown)} flights that were drawn say")
        if flown:
            wrong, quiet = self.drawn.false_alarms()
            out += [self.drawn.sentence(0.95), self.drawn.sentence(1.0)]
            out.append(
                f"in {wrong} of {quiet} flights with nothing in them something is stated with {100.0 * SURE:g} % or "
                "more"
            )
        pairs = [(n, *self.taken_for(n)) for n in power]
        pairs = sorted((x for x in pairs if x[1] in self.effects and x[2] >= _TAKEN_FOR), key=lambda x: -x[2])
        if pairs:
            told = "; ".join(f"{self.title(a)} for {self.title(b)} ({100.0 * p:.0f} %)" for a, b, p in pairs[:3])
            more = f", and {len(pairs) - 3} more" if len(pairs) > 3 else ""
            out.append(f"they could mistake {told}{more}")
        for why, names in grouped(self.unseen).items():
            titles = [self.title(n) for n in names]
            more = f" and {len(titles) - _SAID} more" if len(titles) > _SAID else ""
            out.append(f"{', '.join(titles[:_SAID])}{more} would not show: {why}")
        return (*out, *self._to_fly, *not_compared(self.believed.suite))

    @property
    def _to_fly(self) -> tuple[str, ...]:
        if not self.additions and not self.skipped:
            return ()
        best = self.additions[0] if self.additions else self.planned
        gained = [self.title(n) for n in best.named if n not in self.planned.named]
        if len(best.named) <= len(self.planned.named) or not gained:
            return ("no manoeuvre that was tried would add an effect that can be named at its usual size",)
        return (f"fly {best.words} as well: {', '.join(gained)} could then be named at the usual size",)


_WORDS = {"nothing": "nothing", "unknown": "something that the library lacks"}


@on_one_thread
def plan_gap(
    scenario: Scenario,
    progress: Callable[[str], None] | None = None,
    draws: int = DRAWS,
    file: Path | None = None,
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
        n: not_sought(foreseen.base, e) or "these manoeuvres change no more by them than coefficients do"
        for n, e in known.items()
        if n not in foreseen.effects
    }
    drawn, planned = Reliability(()), Addition("as planned", {})
    additions: list[Addition] = []
    skipped: dict[str, str] = {}
    interrupted = False
    try:
        kept = Kept(file, fingerprint(believed, records, air))
        drawn = Reliability(tuple(kept.read()[:draws]))
        done, begun = len(drawn.trials), time.monotonic()
        first = done
        for found in calibrate_together(foreseen.drawn, foreseen.stated, draws, drawn.trials, _TOGETHER):
            kept.add(found.trials[done:], done)
            drawn, done = found, len(found.trials)
            left_s = (time.monotonic() - begun) / max(done - first, 1) * (draws - done)
            say(f"{done} of {draws} flights drawn, {left_s:.0f} s left")
        few = foreseen.few
        planned = Addition("as planned", few.at_usual_size(few.sums))
        for there, spec, words in candidates(still, scenario.manoeuvre):
            say(f"what {spec.name} would add")
            try:
                more = Foreseen.of(in_air(there, air), [as_record(there, spec)], few.points, few.base.priors)
            except _NOT_FLOWN as error:
                skipped[words] = str(error)
                continue
            additions.append(Addition(words, few.at_usual_size(few.sums + more.sums)))
    except KeyboardInterrupt:
        interrupted = True
    additions.sort(key=lambda a: a.worth, reverse=True)
    names = tuple(m.name for m in scenario.manoeuvre)
    return GapPlan(scenario, still, names, known, unseen, drawn, interrupted, planned, tuple(additions), skipped)


def as_record(believed: Believed, spec: Manoeuvre) -> FlightRecord:
    """Return what sensors without noise would read of a planned manoeuvre, flown from the believed trim.

    Raises:
        FlightAborted, TrimError, LimitError: the believed aircraft cannot fly it.
    """
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
        except _NOT_FLOWN:
            continue
        lead = _lead(flown, flown.sums + more.sums)
        if lead > best:
            best, words = lead, text
    now, needed = _lead(flown, flown.sums), math.log(SURE / (1.0 - SURE))
    if best < needed:
        return (
            f"no manoeuvre that was tried would separate them (the true one would lead by {best:.3g} in ln p at most, "
            f"{needed:.2g} needed); what would separate them: {fits[0].effect.separated_by}"
        )
    return (
        f"fly next: {words}; of the two most alike the true one would then lead by {best:.3g} in ln p, where it leads "
        f"by {now:.3g} now ({needed:.2g} needed)"
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
