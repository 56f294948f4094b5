"""The aircraft that an input may meet, and their flights.

The believed aircraft is one of many. Its coefficients are drawn as :func:`testbench.aircraft.believed.drawn` does, and
every drawn aircraft is trimmed and linearised anew. The predicted errors of an input are those of each aircraft by its
own information. No prior enters them: output error, and every other estimator that is not told one, does not have it.

Cm_alpha, or Cn_beta, may also be another about the trim, which stays: 0.7 and 1.3 times the believed one, or what gives
the short period, or the Dutch roll, 0.7 and 1.3 times its natural frequency.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal, NamedTuple

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.amend import Amendment, Increment
from testbench.aircraft.believed import drawn, stated_deviations
from testbench.core.errors import EstimationError, Refusal
from testbench.core.record import FlightRecord, FloatArray
from testbench.design.candidates import scaled
from testbench.design.limits import Tightest
from testbench.design.problem import Design, Problem, seen_in, total_errors
from testbench.evaluation.envelope import Onset
from testbench.evaluation.modes import roots_of
from testbench.flight import LinearModel, TrimmedFlight
from testbench.flight.air import Air
from testbench.flight.batch.jobs import Job, Simulator, Tally
from testbench.flight.simulate import Manoeuvre

FACTORS = (0.7, 1.3)
"""Static stability, or natural frequency, over the believed one. These are two standard deviations of the 15 % by which
``plan`` lets derivatives be uncertain unless told otherwise."""
ABORTED = 1.0 / 0.6
"""Share of a limit without a name that a flight uses which ends before its time."""
SHOWN = ("V", "alpha", "q", "theta", "h", "az")
_MODE = {
    "longitudinal": ("short period", "Cm", "alpha", -1.0, ("q", "w")),
    "lateral": ("Dutch roll", "Cn", "beta", 1.0, ("r", "v")),
}  # mode, coefficient, its angle, the sign that stiffens, and where the stiffness stands in A
_STEP = 0.02  # 1/rad, by which slopes are found
_TRIES, _NEAR = 6, 0.01  # steps of the secant method, and how near they must come to a frequency
_LOG_HZ = 200.0  # least rate at which flights are held against the limits


class Placed(NamedTuple):
    """An aircraft at the condition of a design: trimmed, linearised, with name -> pole of the modes of its plane."""

    aircraft: Aircraft
    trimmed: TrimmedFlight
    linear: LinearModel
    modes: Mapping[str, complex]


@dataclass(frozen=True, eq=False)
class Member:
    """An aircraft that may fly an input, as a design problem with its own truth and limits."""

    #: aircraft, trimmed, linear, modes: as :class:`Placed` has them
    aircraft: Aircraft
    trimmed: TrimmedFlight
    linear: LinearModel
    modes: Mapping[str, complex]
    problem: Problem  #: its design problem
    onsets: tuple[Onset, ...] = ()  #: elastic modes that become unstable at some speed
    words: str = "the a-priori model"  #: which aircraft it is


@dataclass(frozen=True, eq=False)
class Setting:
    """How any aircraft comes to the condition of a design."""

    plane: Literal["longitudinal", "lateral"]  #: of the motion
    place: Callable[[Aircraft], Placed]  #: trims and linearises an aircraft there
    #: makes it a design problem, too, with the wanted errors and the known information of the believed one
    pose: Callable[[Aircraft], Member]


# --- flights ----------------------------------------------------------------------------------------------------------


class HeldFlight(NamedTuple):
    """A flight held against the limits."""

    shares: FloatArray  #: (limits,) largest share that it uses of the distance from trim to each
    tightest: Tightest  #: the limit that it uses up most
    breach: str  #: the first that it breaks, in words; "" if none
    record: FlightRecord | None = None  #: of the flight; None if there is none


@dataclass(frozen=True)
class Flier:
    """What flies, see :mod:`testbench.flight.batch.jobs`, and the tally of all that was flown."""

    simulator: Simulator = "auto"
    tally: Tally = field(default_factory=Tally)

    def fly(self, jobs: Sequence[Job]) -> list[FlightRecord | Refusal]:
        """Return the truth of flights, all at once where they can be; one that cannot be flown is its error."""
        from testbench.flight.batch.fly import FEWEST, fly_jobs

        fewest = 1 if self.tally.batch else FEWEST  # a model that has been judged is worth it for few flights, too
        return fly_jobs(jobs, self.simulator, self.tally, fewest)

    def held(self, flights: Sequence[tuple[Member, Design, Air | None]]) -> list[HeldFlight | Refusal]:
        """Fly designs with members of an ensemble through some air, and hold the flights against their limits."""
        jobs, envelopes = [], [member.problem.envelope for member, *_ in flights]
        for (member, design, air), envelope in zip(flights, envelopes, strict=True):
            rate = member.trimmed.rate_hz
            names = [*envelope.channels, *design.controls, *(f"{c}_cmd" for c in design.controls), *SHOWN]
            manoeuvre = Manoeuvre.of(design.family, design.specs, design.duration_s, rate)
            log = rate / max(1, int(rate // _LOG_HZ))
            jobs.append(Job(member.aircraft, member.trimmed, manoeuvre, log, tuple(dict.fromkeys(names)), air))
        out: list[HeldFlight | Refusal] = []
        for record, job, envelope in zip(self.fly(jobs), jobs, envelopes, strict=True):
            if isinstance(record, Refusal):
                out.append(record)
            elif record.outcome == "aborted":
                end_s = len(record) / job.log_rate_hz
                text = f"the flight leaves the aircraft's limits at t = {end_s:.2f} s: {record.reason}"
                out.append(lost(len(envelope.names), text, end_s, record))
            else:
                broken = envelope.broken(record)
                said = broken[0] if broken else ""
                out.append(HeldFlight(envelope.shares(record), envelope.tightest(record), said, record))
        return out

    def rested(self, members: Sequence[Member], design: Design) -> tuple[tuple[Member, ...], tuple[Lost, ...]]:
        """Return the members that keep the limits while the controls rest for as long, and those that do not."""
        still = replace(design, specs=scaled(design.candidate.specs, 0.0))
        judged, out = [], []
        for member, flight in zip(members, self.held([(m, still, None) for m in members]), strict=True):
            if isinstance(flight, Refusal):
                out.append(Lost(member.words, flight.message))
            elif flight.breach:
                out.append(Lost(member.words, f"without any input {flight.breach}"))
            else:
                judged.append(member)
        return tuple(judged), tuple(out)


def lost(limits: int, why: str, t_s: float = 0.0, record: FlightRecord | None = None) -> HeldFlight:
    """Return a flight that ends before its time: it uses up more than all of every limit."""
    return HeldFlight(np.full(limits, ABORTED), Tightest("", ABORTED, t_s), why, record)


# --- drawn aircraft ---------------------------------------------------------------------------------------------------


class Lost(NamedTuple):
    """A member of an ensemble for which no input can be judged, and why."""

    words: str
    reason: str


@dataclass(frozen=True, eq=False)
class Draws:
    """The drawn aircraft: those that can be judged, and those that cannot."""

    judged: tuple[Member, ...]
    lost: tuple[Lost, ...]

    @property
    def asked(self) -> int:
        """How many were drawn."""
        return len(self.judged) + len(self.lost)


@dataclass(frozen=True, eq=False)
class Told:
    """What one input tells of each drawn aircraft.

    Attributes:
        costs: (d,) the criterion, in wanted errors.
        ratios: (d, t) predicted standard errors over the wanted ones; NaN where the draw does not have the target.
        reached: number of draws in which every target is known as well as wanted.
    """

    costs: FloatArray
    ratios: FloatArray
    reached: int

    def over(self, how: Callable[[FloatArray], float]) -> FloatArray:
        """Return the largest ratios (t,), or their medians, over the draws that have the target; NaN if none has."""
        have = [column[~np.isnan(column)] for column in self.ratios.T]
        return np.array([how(some) if some.size else np.nan for some in have])


@dataclass(frozen=True, eq=False)
class OverDraws:
    """One design over all drawn aircraft: what it tells of each, and one flight per draw if it was flown with them."""

    told: Told
    flights: tuple[HeldFlight, ...] = ()

    @property
    def broken(self) -> tuple[HeldFlight, ...]:
        """The flights in which the input breaks a limit."""
        return tuple(f for f in self.flights if f.breach)

    @property
    def rank(self) -> tuple[float, float]:
        """By which designs for all draws are ordered: the worst criterion, then the median."""
        return float(self.told.costs.max()), float(np.median(self.told.costs))


def draw(setting: Setting, aircraft: Aircraft, count: int, seed: int, rest: Design, flier: Flier) -> Draws:
    """Return aircraft drawn by the uncertainty that the believed one states, as design problems.

    The wanted errors are those of the believed aircraft, not shares of the draw's own values: of a coefficient that is
    drawn near zero no relative accuracy can be wanted.

    Args:
        setting: where they fly.
        aircraft: as believed.
        count: how many.
        seed: of the draws.
        rest: any design. An aircraft that breaks a limit while its controls rest for as long is lost.
        flier: what flies.

    Raises:
        ModelError: the aircraft does not state its uncertainty.
    """
    stated_deviations(aircraft)
    made, unposed = [], []
    for index in range(count):
        try:
            made.append(replace(setting.pose(drawn(aircraft, seed, index)), words=f"drawn aircraft {index}"))
        except Refusal as error:
            unposed.append(Lost(f"drawn aircraft {index}", error.message))
    judged, restless = flier.rested(made, rest)
    return Draws(judged, tuple(sorted((*unposed, *restless), key=lambda x: int(x.words.split()[-1]))))


def told(design: Design, members: Sequence[Member], names: Sequence[str]) -> Told:
    """Return what a design, its commands unchanged, tells of each member, of the targets ``names`` (t,)."""
    costs, ratios, reached = [], [], 0
    for member in members:
        seen, targets = seen_in(member.problem, design), member.problem.targets
        costs.append(seen.cost)
        found = dict(zip(targets.names, total_errors(member.problem, seen) / targets.wanted, strict=True))
        ratios.append([found.get(name, np.nan) for name in names])
        reached += all(ratio <= 1.0 for ratio in found.values())
    return Told(np.array(costs), np.array(ratios), reached)


# --- other static stability -------------------------------------------------------------------------------------------


def softer_and_stiffer(setting: Setting, believed: Member) -> list[Member]:
    """Return the aircraft with 0.7 and 1.3 times the believed static stability, each trimmed; those that there are."""
    out: list[Member] = []
    _, coefficient, angle, *_ = _MODE[setting.plane]
    for factor in FACTORS:
        try:
            at, _ = _changed(setting, believed, partial(_stiffness, setting.plane), factor)
        except Refusal:  # a model that cannot be amended has no margin of this kind
            continue
        words = f"{factor:g} times its {coefficient}_{angle}"
        out.append(replace(believed, aircraft=at.aircraft, trimmed=at.trimmed, words=words))
    return out


def with_mode(setting: Setting, believed: Member, factor: float) -> Member:
    """Return the aircraft whose mode has ``factor`` times its frequency; its words say what that takes.

    Raises:
        EstimationError: the mode has no frequency, or nothing gives the wanted one but an aircraft without static
            stability: a mode that is damped as much as it is stiff.
        TestbenchError: the aircraft cannot be changed or trimmed so.
    """
    mode, coefficient, angle, *_ = _MODE[setting.plane]

    def square(at: Placed) -> float:
        """Return the square of the natural frequency."""
        roots = list(roots_of(at.modes, mode).values()) if any(n.startswith(mode) for n in at.modes) else []
        found = (roots[0] * (roots[1] if len(roots) == 2 else roots[0].conjugate())).real if roots else math.nan
        if not found > 0.0:
            raise EstimationError(f"the {mode} has no frequency")
        return found

    there, more = _changed(setting, believed, square, factor**2)
    if _stiffness(setting.plane, setting.place(believed.aircraft)) > 0.0 >= _stiffness(setting.plane, there):
        raise EstimationError(
            f"damping contributes most of its frequency, so that this requires {coefficient}_{angle} {more:+.3g}, an "
            "aircraft without static stability"
        )
    words = f"{mode_words(setting.plane, factor)}, {coefficient}_{angle} {more:+.3g}"
    return replace(setting.pose(there.aircraft), words=words)


def _stiffness(plane: str, at: Placed) -> float:
    """Return M_alpha, or N_beta, per unit of speed (1/(m s)); positive where it returns the aircraft to its trim."""
    *_, stiffens, (row, column) = _MODE[plane]
    return stiffens * float(at.linear.A[at.linear.states.index(row), at.linear.states.index(column)])


def _changed(setting: Setting, believed: Member, of: Callable[[Placed], float], times: float) -> tuple[Placed, float]:
    """Return the aircraft that has ``times`` a quantity, and what that adds to the coefficient about the trim, 1/rad.

    Both quantities, M_alpha or N_beta and the square of a frequency, are nearly linear in it: secant method.
    """
    _, coefficient, angle, stiffens, _ = _MODE[setting.plane]
    at_trim = believed.trimmed.alpha if angle == "alpha" else believed.trimmed.state.get("beta", 0.0)
    about = f"<difference><property>aero/{angle}-rad</property><value>{float(at_trim)!r}</value></difference>"
    name, words = f"aero/coefficient/{coefficient}_model_error", f"another {coefficient}_{angle}"
    now = of(setting.place(believed.aircraft))
    wanted, old, more = now * times, (0.0, now), math.copysign(_STEP, stiffens * (times - 1.0))
    for _ in range(_TRIES):
        change = Increment(coefficient, name, (f"<value>{more!r}</value>", about))
        there = setting.place(believed.aircraft.amended(Amendment("model error", words, (change,))))
        found = of(there)
        if abs(math.sqrt(max(found / wanted, 0.0)) - 1.0) < _NEAR:
            return there, more
        slope = (found - old[1]) / (more - old[0])
        if slope == 0.0:
            break
        old, more = (more, found), more + (wanted - found) / slope
    raise EstimationError(f"no {coefficient}_{angle} was found that gives {times:.3g} times that of the a-priori model")


def mode_words(plane: str, factor: float) -> str:
    """Return in words which mode has ``factor`` times its frequency."""
    return f"{_MODE[plane][0]} at {factor:g} times its frequency"
