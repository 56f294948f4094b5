"""A design from scenario to ranking.

screen every family -> refine by information -> fly, at the amplitude that the ensemble allows -> rank -> realise: fly,
sense and identify the best many times
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

from testbench.aircraft.believed import with_priors
from testbench.core.blas import on_one_thread
from testbench.core.constants import PERCENT
from testbench.core.errors import EstimationError, LimitError, located
from testbench.core.named import Named, obtain
from testbench.design.amplitude import Ensemble
from testbench.design.ensemble import Flier, Placed, draw, softer_and_stiffer
from testbench.design.problem import Screened, design_of, obstacles, seen_in, total_errors
from testbench.design.realise import Elsewhere, elsewhere, repeats
from testbench.design.search import best_of_families, for_the_worst, screen, search
from testbench.flight import load_aircraft
from testbench.flight.batch.jobs import Simulator
from testbench.line import Report
from testbench.pooling.prior import Prior
from testbench.questions.design.check import draws_of
from testbench.questions.design.known import believe
from testbench.questions.design.pose import own_input, pose, problem_of, range_of, setting_of
from testbench.questions.design.result import DesignResult
from testbench.questions.design.scenario import DesignScenario
from testbench.sensors import load_suite

_FLOWN = 7  # designs that are flown,
_CLASSICS = ("doublet", "3211")  # and these for comparison


@on_one_thread
def run_design(
    scenario: Named[DesignScenario],
    seed: int | None = None,
    progress: Report | None = None,
    simulator: Simulator = "auto",
    after: Prior | None = None,
) -> DesignResult:
    """Design the input that a scenario asks for, or judge the one that it gives.

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
    where, flier = scenario.file, Flier(simulator)
    if seed is not None:
        scenario = scenario.changed(seed=seed)
    aircraft = load_aircraft(scenario.aircraft, scenario.wings)
    suite, *further_suites = [load_suite(name) for name in scenario.suites]
    say("trim and linearise")
    believed, known = pose(scenario, aircraft, suite), None
    if after is not None:
        say("use the previous flights")
        believed, known = believe(scenario, believed, suite, after)
    problem, setting = believed.problem, setting_of(scenario, believed, suite)
    start = time.perf_counter()
    if scenario.input:
        with located(where, "input"):
            ranked = [own_input(scenario, problem)]
        designs = [design_of(problem, ranked[0])]
    else:
        say("screen every family by spectral energy and information")
        ranked = screen(problem)
    screened = (len(ranked), time.perf_counter() - start)
    if not scenario.input:
        with located(where, "targets"):
            designs = search(problem, say, ranked)
    draws = None
    with located(where, "draws"):
        if count := draws_of(scenario, believed.aircraft):
            draws = draw(setting, with_priors(believed.aircraft), count, scenario.seed, designs[0], flier)
    if scenario.robust and draws is not None and not draws.judged:
        raise EstimationError(
            f"robust = true needs drawn aircraft that can be judged, but none of {draws.asked} can: "
            f"{draws.lost[0].reason}"
        )
    with located(where, "suites"):
        range_ = range_of(scenario, believed, suite, flier)
    changed = softer_and_stiffer(setting, believed) if scenario.realise and not range_.moves else []
    others, _ = flier.rested(changed, designs[0])
    probability = scenario.breach_percent * PERCENT
    ensemble = Ensemble(range_, draws, others, scenario.robust, scenario.realise, probability)
    if scenario.input:
        ensemble = replace(ensemble, most=1.0)
    searched = draws is not None and scenario.robust and not scenario.input
    further = for_the_worst(problem, designs, draws, say) if draws is not None and searched else ()
    say("fly the designs")
    taken = [*(d for k, d in enumerate(designs) if k < _FLOWN or d.family in _CLASSICS), *further]
    flown = ensemble.started(taken)
    admissible = sorted((f for f in flown if f.admissible), key=lambda f: f.design.cost)
    if not admissible:
        raise LimitError(f"no design keeps the limits when it is flown: {flown[0].breach}; widen them")
    nominal = next((f.predicted for f in admissible if not any(f.predicted is d for d in further)), None)
    ranking = ensemble.ranked(admissible, say)
    # what the believed aircraft takes least time for is not known to be enough for the others
    shortest = None if scenario.robust or scenario.input else ensemble.shortest(ranked, ranking[0], say)
    there: tuple[Elsewhere, ...] = ()
    if scenario.realise:
        ranking = ensemble.realised(ranking, say)
        there = elsewhere(setting, range_, ranking[0].design, repeats(scenario.realise), say)
    if draws is not None:
        say(f"judge the designs over {draws.asked} drawn aircraft")
        ranking = ensemble.over(ranking)
    best = ranking[0].design
    through = {}
    for other in further_suites:
        at = believed.aircraft, believed.trimmed, believed.linear, believed.modes
        seen = problem_of(scenario, Placed(*at), other, problem.prediction.limits, starts=True)
        seen = replace(seen, known=problem.known)
        through[other.name] = total_errors(seen, seen_in(seen, best))
    return DesignResult(
        scenario,
        believed,
        ensemble,
        screened,
        _families(ranked),
        tuple(ranking),
        tuple(f for f in flown if not f.admissible),
        shortest,
        through,
        obstacles(problem, best),
        there,
        next((k for k, f in enumerate(ranking) if f.predicted is nominal), None) if scenario.robust else None,
        known,
    )


def _families(ranked: Sequence[Screened]) -> dict[str, tuple[int, float, float]]:
    """Return family -> its candidates, their lowest cost, and their best signal-to-noise ratio of the worst mode."""
    snr: dict[str, list[float]] = {}
    for entry in ranked:
        snr.setdefault(entry.candidate.family, []).append(entry.snr_db)
    best = best_of_families(ranked)
    return {family: (len(snr[family]), entry.cost, max(snr[family])) for family, entry in best.items()}
