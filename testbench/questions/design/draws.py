"""The aircraft that the believed one may be, each as a design problem, and what one input does with all of them.

The coefficients are drawn as :func:`testbench.aircraft.believed.drawn` does, and every drawn aircraft is trimmed and
linearised anew. The predicted errors of an input are those of each aircraft by its own information. No prior enters
them: output error, and every other estimator that is not told one, does not have it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.believed import drawn, stated_deviations
from testbench.core.errors import Refusal
from testbench.core.record import FloatArray
from testbench.evaluation.envelope import Onset
from testbench.flight import TrimmedFlight, linearise
from testbench.flight.batch.jobs import Simulator, Tally
from testbench.information.modes import modes_of
from testbench.line import trim_for
from testbench.questions.design.build import limits_of, problem_of
from testbench.questions.design.candidates import Candidate
from testbench.questions.design.flown import ABORTED, Envelope, Flown, Tightest, fly_all, fly_each
from testbench.questions.design.known import total_errors
from testbench.questions.design.problem import Design, Problem, rescaled, seen_in
from testbench.questions.design.scenario import DesignScenario
from testbench.sensors import SensorSuite

_DRAWS = 20  # of an aircraft that states its uncertainty
_ROUNDS = 5  # of flights through all draws, at most, until an amplitude keeps the limits in each
_LESS = 0.98  # of the amplitude at which the worst draw would just meet its limit
_ENOUGH = 0.95  # share of its limit that the worst draw uses; the amplitude is not raised beyond


def draws_of(scenario: DesignScenario, aircraft: Aircraft) -> int:
    """Return how many aircraft a design is judged over; 0: the believed one alone."""
    if scenario.draws is not None:
        return scenario.draws
    return _DRAWS if aircraft.uncertainty or scenario.robust else 0


@dataclass(frozen=True, eq=False)
class Draw:
    """One drawn aircraft at its own trim, as a design problem with its own truth.

    The wanted errors are those of the believed aircraft, not shares of the draw's own values: of a coefficient that is
    drawn near zero no relative accuracy can be wanted.
    """

    index: int
    aircraft: Aircraft
    trimmed: TrimmedFlight
    problem: Problem
    envelope: Envelope


@dataclass(frozen=True)
class Lost:
    """A drawn aircraft for which no input can be judged, and why."""

    index: int
    reason: str


@dataclass(frozen=True, eq=False)
class Draws:
    """The drawn aircraft: those that can be judged, and those that cannot."""

    judged: tuple[Draw, ...]
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

    @property
    def median_cost(self) -> float:
        """The median criterion over the draws."""
        return float(np.median(self.costs))

    def median(self, k: int) -> float:
        """Return the median of the ratio of target ``k`` over the draws that have it."""
        have = self.ratios[~np.isnan(self.ratios[:, k]), k]
        return float(np.median(have)) if have.size else float("nan")

    def worst(self, k: int) -> float:
        """Return the largest ratio of target ``k`` over the draws that have it."""
        have = self.ratios[~np.isnan(self.ratios[:, k]), k]
        return float(have.max()) if have.size else float("nan")


class InDraw(NamedTuple):
    """The flight of one input with a drawn aircraft: the limit used up most, and the first that breaks ("": none)."""

    tightest: Tightest
    breach: str


@dataclass(frozen=True, eq=False)
class OverDraws:
    """One design over all drawn aircraft.

    Attributes:
        told: what it tells of each.
        flights: one per draw that can be judged; none if it was not flown with them.
        lowered: its amplitude over the one that the believed aircraft takes.
    """

    told: Told
    flights: tuple[InDraw, ...] = ()
    lowered: float = 1.0

    @property
    def broken(self) -> tuple[InDraw, ...]:
        """The flights in which the input breaks a limit."""
        return tuple(f for f in self.flights if f.breach)


def draw_aircraft(
    scenario: DesignScenario,
    aircraft: Aircraft,
    problem: Problem,
    suite: SensorSuite,
    onsets: Sequence[Onset],
    design: Design,
    simulator: Simulator,
    tally: Tally,
) -> Draws | None:
    """Return the drawn aircraft of a design as design problems; None if none are asked for.

    Args:
        scenario: what is asked; its seed is that of the draws.
        aircraft: as believed.
        problem: of the believed aircraft. A mode that oscillates there keeps frequency and damping in draws where it
            splits into two real roots.
        suite: the sensors.
        onsets: of vibration of the believed aircraft; the draws keep its highest speed.
        design: any one. An aircraft that breaks a limit while its controls rest for as long is lost.
        simulator: see :mod:`testbench.flight.batch.jobs`.
        tally: is told of every flight.

    Raises:
        ModelError: the aircraft does not state its uncertainty.
    """
    count = draws_of(scenario, aircraft)
    if not count:
        return None
    stated_deviations(aircraft)
    still = replace(design, specs=Candidate(design.family, design.words, design.specs, design.u).scaled(0.0))
    made, judged, lost = [], [], []
    for index in range(count):
        one = drawn(aircraft, scenario.seed, index)
        try:
            made.append(_draw(scenario, index, one, suite, onsets, problem))
        except Refusal as error:
            lost.append(Lost(index, error.message))
    models, trims, limits = [d.aircraft for d in made], [d.trimmed for d in made], [d.envelope for d in made]
    flights = fly_each(models, trims, [still] * len(made), limits, simulator, tally)
    for draw, flight in zip(made, flights, strict=True):
        if isinstance(flight, Refusal):
            lost.append(Lost(draw.index, flight.message))
        elif flight.broken:
            lost.append(Lost(draw.index, f"without any input {flight.broken[0]}"))
        else:
            judged.append(draw)
    return Draws(tuple(judged), tuple(sorted(lost, key=lambda x: x.index)))


def _draw(
    scenario: DesignScenario,
    index: int,
    aircraft: Aircraft,
    suite: SensorSuite,
    onsets: Sequence[Onset],
    of: Problem,
) -> Draw:
    believed = of.targets
    whole = [m for m in scenario.targets.modes if f"wn of {m}" in believed.names]
    trimmed = trim_for(scenario, aircraft)
    linear = linearise(aircraft, trimmed)
    modes = modes_of(linear, aircraft, scenario.plane)
    limits = limits_of(scenario, aircraft, trimmed, onsets)
    problem = problem_of(scenario, aircraft, trimmed, linear, modes, suite, limits, whole, starts=True)
    wanted = dict(zip(believed.names, believed.wanted, strict=True))
    own = problem.targets
    same = np.array([wanted.get(name, w) for name, w in zip(own.names, own.wanted, strict=True)])
    problem = replace(problem, targets=replace(own, wanted=same), known=of.known)
    return Draw(index, aircraft, trimmed, problem, Envelope.of(limits, problem))


def told(design: Design, draws: Draws, names: Sequence[str]) -> Told:
    """Return what a design tells of each drawn aircraft.

    Args:
        design: its commands are the same in all of them.
        draws: at least one that can be judged.
        names: (t,) targets of the believed aircraft.
    """
    costs, ratios, reached = [], [], 0
    for draw in draws.judged:
        seen, targets = seen_in(draw.problem, design), draw.problem.targets
        costs.append(seen.cost)
        errors = total_errors(draw.problem, seen)
        found = dict(zip(targets.names, errors / targets.wanted, strict=True))
        ratios.append([found.get(name, np.nan) for name in names])
        reached += all(ratio <= 1.0 for ratio in found.values())
    return Told(np.array(costs), np.array(ratios), reached)


def flown_in(design: Design, draws: Draws, simulator: Simulator, tally: Tally) -> tuple[InDraw, ...]:
    """Fly a design in the nonlinear simulator with each drawn aircraft, from its own trim.

    Commands that a trim leaves no room for break a limit like any other.
    """
    of = draws.judged
    models, trims, limits = [d.aircraft for d in of], [d.trimmed for d in of], [d.envelope for d in of]
    out = []
    for flight in fly_each(models, trims, [design] * len(of), limits, simulator, tally):
        if isinstance(flight, Refusal):
            out.append(InDraw(Tightest("", 1.0 / ABORTED, 0.0), flight.message))
        else:
            out.append(InDraw(flight.tightest, flight.broken[0] if flight.broken else ""))
    return tuple(out)


def kept_in_all(
    aircraft: Aircraft,
    trimmed: TrimmedFlight,
    problem: Problem,
    flown: Flown,
    envelope: Envelope,
    draws: Draws,
    simulator: Simulator,
    tally: Tally,
) -> tuple[Flown, OverDraws]:
    """Return a flown design at the largest amplitude that breaks no limit in any draw, and the design over the draws.

    The amplitude never grows beyond what the believed aircraft takes. The response is taken as proportional to it from
    one round of flights to the next. If no amplitude of a few rounds keeps all limits, the smallest one stands, and its
    flights say what breaks.
    """
    factor, low, high = 1.0, 0.0, 1.0
    tried = []
    for _ in range(_ROUNDS):
        design = flown.design if factor == 1.0 else rescaled(problem, flown.design, factor, flown.design.limit)
        flights = flown_in(design, draws, simulator, tally)
        broken, share = any(f.breach for f in flights), max(f.tightest.share for f in flights)
        tried.append((not broken, factor, design, flights))
        low, high = (low, factor) if broken else (factor, high)
        if not broken and (factor == 1.0 or share >= _ENOUGH):
            break
        factor *= _LESS / max(share, 1e-6)
        if not low < factor < high:
            factor = 0.5 * (low + high)
    good = [t for t in tried if t[0]]
    _, factor, design, flights = max(good, key=lambda t: t[1]) if good else min(tried, key=lambda t: t[1])
    if factor < 1.0:
        ((record, _, tight),) = fly_all(aircraft, trimmed, [design], envelope, simulator, tally)
        limit = max((f.tightest for f in flights), key=lambda t: t.share).name
        flown = replace(flown, design=replace(design, limit=limit), record=record, tightest=tight)
    return flown, OverDraws(told(design, draws, problem.targets.names), flights, factor)
