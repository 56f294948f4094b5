"""A design from scenario to ranking.

screen every family -> refine by information -> fly -> scale -> rank -> judge over the aircraft that it may be
-> keep a margin for the air -> realise: fly, sense and identify the best many times
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.blas import on_one_thread
from testbench.core.constants import PERCENT
from testbench.core.errors import EstimationError, LimitError, located
from testbench.core.named import Named, obtain
from testbench.core.record import FloatArray
from testbench.flight import LinearModel, TrimmedFlight, load_aircraft
from testbench.flight.batch.jobs import Simulator, Tally
from testbench.line import Report
from testbench.questions.design.air import expected_air
from testbench.questions.design.build import problem_of
from testbench.questions.design.draws import Draws, OverDraws, draw_aircraft, flown_in, kept_in_all, told
from testbench.questions.design.elsewhere import Elsewhere, elsewhere, softer_and_stiffer
from testbench.questions.design.flown import Envelope, Flown, fly_designs
from testbench.questions.design.gentler import CLEARLY, gentler, realised_cost
from testbench.questions.design.identified import identified_by
from testbench.questions.design.known import total_errors
from testbench.questions.design.limits import Limits
from testbench.questions.design.margins import for_others, with_margins
from testbench.questions.design.maximin import for_the_worst
from testbench.questions.design.misled import weighed
from testbench.questions.design.obstacles import obstacles
from testbench.questions.design.posed import believe, pose
from testbench.questions.design.problem import Design, Problem, seen_in
from testbench.questions.design.realise import Range, Realised, repeats
from testbench.questions.design.refine import minimum_time
from testbench.questions.design.result import DesignResult, Ranked
from testbench.questions.design.scenario import DesignScenario
from testbench.questions.design.search import best_of_families, screen, search
from testbench.questions.identify.pool.prior import Prior
from testbench.sensors import SensorSuite, load_suite

_FLOWN = 7  # designs that are flown,
_CLASSICS = ("doublet", "3211")  # and these for comparison
_REALISED = 3  # designs that are realised, at most


@on_one_thread
def run_design(
    scenario: Named[DesignScenario],
    seed: int | None = None,
    progress: Report | None = None,
    simulator: Simulator = "auto",
    after: Prior | None = None,
) -> DesignResult:
    """Design the input that a scenario asks for.

    Args:
        scenario: of :meth:`DesignScenario.load`.
        seed: of the random starts, instead of the scenario's.
        progress: called with a few words as each stage begins.
        simulator: "jsbsim" flies one flight after the other; "auto" flies designs, and drawn aircraft, at once
            where their model has been found equal to JSBSim.
        after: what earlier flights told of the derivatives; see :func:`testbench.known_after`. The input is designed at
            those values, for what is known and what the flight adds to it.

    Raises:
        AllKnown: ``after`` tells every target as well as wanted.
        TestbenchError: with the file and key that it comes from; above the onset of vibration, or where no signal
            tells anything of some target.

    Example:
        >>> import testbench as tb
        >>> result = tb.run_design(tb.load("design/taurus_short_period"))  # doctest: +SKIP
        >>> result.best.design.family  # doctest: +SKIP
    """
    scenario = obtain(DesignScenario, scenario)
    say = progress or (lambda text: None)
    where, tally = scenario.file, Tally()
    if seed is not None:
        scenario = scenario.changed(seed=seed)
    aircraft = load_aircraft(scenario.aircraft, scenario.wings)
    suites = [load_suite(name) for name in scenario.suites]
    say("trim and linearise")
    posed, known = pose(scenario, aircraft, suites[0]), None
    if after is not None:
        say("believe what was flown before")
        posed, known = believe(scenario, posed, suites[0], after)
    aircraft, trimmed, linear, onsets, modes, limits, problem = posed
    with located(where, "limits"):
        envelope = Envelope.of(limits, problem)
    say("screen every family by spectral energy and information")
    start = time.perf_counter()
    ranked = screen(problem)
    screened = (len(ranked), time.perf_counter() - start)
    with located(where, "targets"):
        designs = search(problem, say, ranked)
    with located(where, "draws"):
        draws = draw_aircraft(scenario, aircraft, problem, suites[0], onsets, designs[0], simulator, tally)
    further = (
        for_the_worst(problem, designs, draws, say) if draws is not None and scenario.robust and draws.judged else ()
    )
    say("fly the designs")
    taken = [*(d for k, d in enumerate(designs) if k < _FLOWN or d.family in _CLASSICS), *further]
    flown = fly_designs(aircraft, trimmed, problem, taken, envelope, simulator, tally)
    admissible = sorted((f for f in flown if f.admissible), key=lambda f: f.design.cost)
    if not admissible:
        raise LimitError(f"no design keeps the limits when it is flown: {flown[0].breach}; widen them")
    believed = next((f.predicted for f in admissible if not any(f.predicted is d for d in further)), None)
    over: list[OverDraws | None] = [None] * len(admissible)
    if draws is not None:
        say(f"judge the designs over {draws.asked} drawn aircraft")
        admissible, over = _over(scenario, aircraft, trimmed, problem, admissible, envelope, draws, simulator, tally)
    shortest = None
    with located(where, "suites"):
        range_ = range_of(scenario, aircraft, trimmed, problem, suites[0], simulator, tally)
    others: list[tuple[Aircraft, TrimmedFlight]] = []
    if scenario.realise:
        say("fly them in the air that is expected")
        others = [] if range_.moves else softer_and_stiffer(scenario, range_)
        admissible, over = _kept(scenario, range_, admissible, over, envelope, others)
    if not scenario.robust:  # what the believed aircraft takes least time for is not known to be enough for the others
        say("find the shortest input that reaches the wanted accuracy")
        shortest = _shortest(scenario, problem, ranked, admissible, range_, envelope, others)
    realised: dict[int, Realised] = {}
    there: tuple[Elsewhere, ...] = ()
    if scenario.realise:
        admissible, over, realised = _realised(scenario, range_, admissible, over, envelope, draws, say)
        there = elsewhere(scenario, range_, limits, admissible[0].design, repeats(scenario.realise), say)
    best = admissible[0].design
    through = {
        suite.name: _through(scenario, aircraft, trimmed, linear, modes, suite, limits, best, problem.known)
        for suite in suites[1:]
    }
    counts: dict[str, list[float]] = {}
    for entry in ranked:
        counts.setdefault(entry.candidate.family, []).append(entry.snr_db)
    families = {
        family: (len(counts[family]), entry.cost, max(counts[family]))
        for family, entry in best_of_families(ranked).items()
    }
    assert problem.bands is not None
    bands = replace(problem.bands, modes=dict(modes))  # of all modes, targets or not
    return DesignResult(
        scenario,
        aircraft,
        trimmed,
        linear,
        suites[0],
        problem,
        modes,
        limits,
        envelope,
        screened,
        families,
        tuple(
            Ranked(f, bands.analyse(f.design.u), o, realised.get(id(f.design)))
            for f, o in zip(admissible, over, strict=True)
        ),
        tuple(f for f in flown if not f.admissible),
        Ranked(shortest, bands.analyse(shortest.design.u)) if shortest else None,
        through,
        obstacles(problem, best),
        tuple(o for o in onsets if o.V_m_s is not None),
        draws,
        tally,
        range_.identified,
        range_.air if scenario.realise else None,
        there,
        next((k for k, f in enumerate(admissible) if f.predicted is believed), None) if scenario.robust else None,
        known,
    )


def range_of(
    scenario: DesignScenario,
    aircraft: Aircraft,
    trimmed: TrimmedFlight,
    problem: Problem,
    suite: SensorSuite,
    simulator: Simulator,
    tally: Tally,
) -> Range:
    """Return where designs are flown and identified."""
    assert problem.deflected is not None
    air, h_m = expected_air(scenario, aircraft), scenario.condition.h_m
    moves = air.turbulence_rms_m_s > 0.0
    identified = identified_by(problem.deflected, suite, problem.servo_lag_s, problem.experiment.samples, moves)
    targets, seed = problem.targets, scenario.seed
    return Range(aircraft, trimmed, problem, targets, suite, identified, air, h_m, seed, simulator, tally)


def _kept(
    scenario: DesignScenario,
    range_: Range,
    flown: list[Flown],
    over: list[OverDraws | None],
    envelope: Envelope,
    others: Sequence[tuple[Aircraft, TrimmedFlight]],
) -> tuple[list[Flown], list[OverDraws | None]]:
    """Return the designs at amplitudes that mislead least and with a margin for the air, best first, each with what it
    is over the draws.
    """
    told = weighed(range_, flown, envelope)
    pairs = list(zip(told, over, strict=True))
    if not scenario.robust:  # a robust order is by the worst draw, whose errors grow alike
        pairs.sort(key=lambda pair: pair[0].design.cost)
    head = pairs[:_REALISED]  # margins take many flights: those have them that may be recommended
    kept = _with_margins(scenario, range_, [f for f, _ in head], envelope, others)
    head = [(f, o) for f, (_, o) in zip(kept, head, strict=True)]
    if not scenario.robust:
        head.sort(key=lambda pair: pair[0].design.cost)
    pairs = [*head, *pairs[_REALISED:]]
    return [f for f, _ in pairs], [o for _, o in pairs]


def _with_margins(
    scenario: DesignScenario,
    range_: Range,
    flown: Sequence[Flown],
    envelope: Envelope,
    others: Sequence[tuple[Aircraft, TrimmedFlight]],
) -> list[Flown]:
    """Return designs at amplitudes that keep the limits in the air that is expected, and what they are off by there.

    In still air they keep them with the aircraft of less and more static stability, too.
    """
    if range_.moves:
        kept = with_margins(range_, flown, envelope, scenario.realise, scenario.breach_percent * PERCENT)
    else:
        kept = for_others(range_, flown, envelope, others)
    lower = [k.design is not f.design for k, f in zip(kept, flown, strict=True)]
    again = iter(range_.off([k.design for k, changed in zip(kept, lower, strict=True) if changed]))
    return [replace(k, design=next(again)[0]) if changed else k for k, changed in zip(kept, lower, strict=True)]


def _realised(
    scenario: DesignScenario,
    range_: Range,
    flown: list[Flown],
    over: list[OverDraws | None],
    envelope: Envelope,
    draws: Draws | None,
    say: Report,
) -> tuple[list[Flown], list[OverDraws | None], dict[int, Realised]]:
    """Return the designs, the best by realised errors first, what each is over the draws, and what was realised.

    Designs are realised in the order of their promises, until no promise of a further one is clearly better than what
    has been realised, or a few have been. The others keep their order behind. The best flies at a smaller amplitude
    where that is clearly better. A robust order and its amplitudes stay.
    """
    n, found = scenario.realise, {}
    pairs, first = list(zip(flown, over, strict=True)), None
    for pair in pairs[:_REALISED]:
        design = pair[0].design
        if first is not None and (scenario.robust or design.cost > CLEARLY * first[0]):
            break
        say(f"realise the {design.family}: fly and identify it {n} times")
        found[id(design)] = range_.realised(design, n, say)
        cost = realised_cost(range_, design, found[id(design)])
        if first is None or cost < CLEARLY * first[0]:
            first = cost, pair
    assert first is not None
    best, behind = first[1], [p for p in pairs if p is not first[1]]
    if not scenario.robust:
        before = best[0].design
        lower, there = gentler(range_, best[0], found[id(before)], envelope, n, say)
        if lower.design is not before:
            if range_.moves:
                (lower,) = _with_margins(scenario, range_, [lower], envelope, ())
            best = lower, best[1]
            if best[1] is not None and draws is not None:
                best = lower, _in_draws(range_.problem, lower.design, draws, range_.simulator, range_.tally)
            found[id(lower.design)] = there
    pairs, design = [best, *behind], best[0].design
    found[id(design)] = range_.certain(design, n, found[id(design)], say)
    return [f for f, _ in pairs], [o for _, o in pairs], found


def _over(
    scenario: DesignScenario,
    aircraft: Aircraft,
    trimmed: TrimmedFlight,
    problem: Problem,
    flown: list[Flown],
    envelope: Envelope,
    draws: Draws,
    simulator: Simulator,
    tally: Tally,
) -> tuple[list[Flown], list[OverDraws | None]]:
    """Return the flown designs, best first, and each of them over the drawn aircraft.

    The best of a robust design has the smallest worst criterion over the draws, and amplitudes keep the limits in all
    of them. Otherwise the order stays, and the best alone is flown with them.

    Raises:
        EstimationError: a robust design without one draw that can be judged.
    """
    if not draws.judged:
        if scenario.robust:
            raise EstimationError(
                f"robust = true needs drawn aircraft that can be judged, but none of {draws.asked} can: "
                f"{draws.lost[0].reason}"
            )
        return flown, [None] * len(flown)
    if scenario.robust:
        kept = [kept_in_all(aircraft, trimmed, problem, f, envelope, draws, simulator, tally) for f in flown]
        kept.sort(key=lambda pair: (float(pair[1].told.costs.max()), float(np.median(pair[1].told.costs))))
        return [f for f, _ in kept], [o for _, o in kept]
    out: list[OverDraws | None] = [OverDraws(told(f.design, draws, problem.targets.names)) for f in flown]
    best = flown[0].design
    out[0] = _in_draws(problem, best, draws, simulator, tally)
    return flown, out


def _in_draws(problem: Problem, design: Design, draws: Draws, simulator: Simulator, tally: Tally) -> OverDraws:
    """Return a design over the drawn aircraft, and flown with each."""
    return OverDraws(told(design, draws, problem.targets.names), flown_in(design, draws, simulator, tally))


def _shortest(
    scenario: DesignScenario,
    problem: Problem,
    ranked: Sequence[Any],
    flown: Sequence[Flown],
    range_: Range,
    envelope: Envelope,
    others: Sequence[tuple[Aircraft, TrimmedFlight]],
) -> Flown | None:
    """Return the shortest input that reaches the wanted accuracy in flight, with its margin for the air, or None.

    Its first aim allows for the amplitude that the best design lost in flight; if that was not enough, it aims again.
    """
    aim = min(1.0, flown[0].factor)
    aircraft, trimmed, simulator, tally = range_.aircraft, range_.trimmed, range_.simulator, range_.tally
    for _ in range(2):
        design = minimum_time(problem, ranked, aim)
        if design is None:
            return None
        (out,) = fly_designs(aircraft, trimmed, problem, [design], envelope, simulator, tally)
        if not out.admissible:
            return None
        if scenario.realise:
            (out,) = _with_margins(scenario, range_, weighed(range_, [out], envelope), envelope, others)
        if out.design.cost <= 1.0:
            return out
        aim *= 0.97 / out.design.cost
    return None


def _through(
    scenario: DesignScenario,
    aircraft: Aircraft,
    trimmed: TrimmedFlight,
    linear: LinearModel,
    modes: Mapping[str, complex],
    suite: SensorSuite,
    limits: Limits,
    design: Design,
    known: FloatArray | None,
) -> FloatArray:
    """Return the standard errors (t,) of the targets after a flight of a design through another suite."""
    other = replace(problem_of(scenario, aircraft, trimmed, linear, modes, suite, limits, starts=True), known=known)
    return total_errors(other, seen_in(other, design))
