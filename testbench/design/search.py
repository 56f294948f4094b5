"""The search for an input: screen every family, refine the best, design switching signals and line powers.

Every candidate is judged at the largest admissible amplitude that the linearised aircraft predicts. For drawn aircraft
the smallest worst criterion is sought, at the amplitude that keeps the limits of all:

    minimise over u:  max_d cost_d(u) / min_d f_d(u),    f_d the largest admissible factor on u in draw d.

The best design has some draw in which it does worst. Designs are searched for that aircraft, join the others, and the
question is asked again. Then two kinds are made for all draws at once: switching signals by exchange, and a multisine
whose line powers come from the multiplicative algorithm with the draws weighed by how badly they do: a draw's weight
grows with its cost in every round (maximin by multiplicative weights).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.core.scenario.inputs import Multisine
from testbench.design.candidates import candidates
from testbench.design.ensemble import Draws, Member, told
from testbench.design.problem import Design, Problem, Screened, by_energy, by_information, design_of, seen_in
from testbench.design.refine import (
    Lines,
    Switching,
    designed_multisine,
    designed_switching,
    exchange,
    refined,
    steps_of,
    switched,
    worst_cost,
)
from testbench.information.fisher import accuracy

_UPPER, _LEAST = 0.4, 5  # share of each family, and least number, whose information is computed
_REFINED = 3  # families whose free times are refined
_DRAWS, _EACH = 3, 3  # draws that designs are searched for, at most, and designs that each of them adds
_STARTS, _RANDOM = 5, 2  # designs, random signs, and random signs with rests, that the exchange starts from
_KEPT = 2  # of its results: which is best when it is flown is not certain
_ROUNDS, _LOOK = 240, 10  # of the multiplicative algorithm, and how often the multisine itself is judged
_PULL = 0.3  # exponent with which a draw's weight follows its cost


def screen(problem: Problem, progress: Callable[[int], None] | None = None) -> list[Screened]:
    """Return every candidate of every family, best first.

    All are judged by spectral energy: the signal-to-noise ratio of the mode that a candidate shows worst, at the sensor
    that shows this mode best. The best of each family are then judged by information; the others rank behind them.

    Raises:
        EstimationError: no signal of any family fits.
    """
    families: dict[str, list[Screened]] = {}
    for count, candidate in enumerate(candidates(problem), 1):
        families.setdefault(candidate.family, []).append(by_energy(problem, candidate))
        if progress is not None:
            progress(count)
    if not families:
        raise EstimationError(
            f"no signal fits into duration_s = {problem.duration_s:g} with steps of at least {problem.shortest_s:g} s; "
            "lengthen the manoeuvre or shorten the shortest step"
        )
    out = []
    for members in families.values():
        upper = max(_LEAST, round(_UPPER * len(members))) if problem.bands is not None else len(members)
        members = sorted(members, key=lambda s: -s.snr_db)
        out += [by_information(problem, entry) if i < upper else entry for i, entry in enumerate(members)]
    return sorted(out, key=lambda s: s.cost)


def best_of_families(ranked: Sequence[Screened]) -> dict[str, Screened]:
    """Return family -> its best candidate, best family first."""
    best: dict[str, Screened] = {}
    for entry in ranked:
        best.setdefault(entry.candidate.family, entry)
    return best


def search(
    problem: Problem, progress: Callable[[str], None] | None = None, ranked: list[Screened] | None = None
) -> list[Design]:
    """Return the best of every family, the designed switching signal and the designed multisine, best first.

    Args:
        problem: the design problem.
        progress: called with a few words as each stage begins.
        ranked: what :func:`screen` found, if that has been done.

    Raises:
        EstimationError: no signal of any family fits, or none tells anything of some target.
    """
    say = progress or (lambda text: None)
    if ranked is None:
        say("screen every family")
        ranked = screen(problem)
    best = best_of_families(ranked)
    if not np.isfinite(ranked[0].cost):
        raise EstimationError(_untold(problem, ranked))
    say("refine the best by information")
    for family in list(best)[:_REFINED]:
        best[family] = refined(problem, best[family])
    designed = [design_of(problem, entry) for entry in best.values() if np.isfinite(entry.cost)]
    say("design a switching signal")
    designed += designed_switching(problem, ranked)
    if not problem.by_hand:
        say("design a multisine")
        designed += designed_multisine(problem, best.get("multisine"))
    return sorted(designed, key=lambda d: d.cost)


def _untold(problem: Problem, ranked: list[Screened]) -> str:
    """Return the error that says which targets no candidate tells."""
    lost: set[str] = set(problem.targets.names)
    for entry in ranked:
        M = problem.experiment.information(entry.candidate.u)
        errors = problem.targets.errors(accuracy(M if problem.known is None else M + problem.known))
        lost &= {n for n, e in zip(problem.targets.names, errors, strict=True) if not np.isfinite(e)}
        if not lost:
            break
    which = f"anything of {', '.join(sorted(lost))}" if lost else "all targets separately"
    return (
        "a design needs a signal that determines all targets, but with the sensors "
        f"{', '.join(problem.experiment.structure.outputs)} no signal of any family on {', '.join(problem.controls)} "
        f"determines {which}; leave targets out, or add sensors or controls"
    )


# --- for drawn aircraft -----------------------------------------------------------------------------------------------


def worst_of(members: Sequence[Member], u: FloatArray, cut: float = np.inf) -> float:
    """Return the worst criterion over members of an input (samples, m) at the amplitude that keeps limits in all.

    Args:
        members: at least one.
        u: at any amplitude.
        cut: from which the worst need not be known.
    """
    of = [m.problem for m in members]
    return worst_cost(of, (p.experiment.information(u) for p in of), [p.prediction.response(u) for p in of], cut)


def for_the_worst(
    problem: Problem, designs: Sequence[Design], draws: Draws, say: Callable[[str], None]
) -> tuple[Design, ...]:
    """Return further designs: the best of drawn aircraft in which the best of those before does worst, and for all.

    Args:
        problem: of the believed aircraft, which judges them, too.
        designs: of the believed aircraft.
        draws: at least one that can be judged.
        say: called with a few words as each search begins.
    """
    members, out, done = draws.judged, list[Design](), set[int]()

    def costs_of(some: Sequence[Design]) -> list[FloatArray]:
        """Return the criterion of designs in every draw."""
        return [told(d, members, problem.targets.names).costs for d in some]

    costs = costs_of(designs)
    for _ in range(_DRAWS):
        worst = int(np.argmax(min(costs, key=lambda c: float(c.max()))))
        if worst in done:
            break
        done.add(worst)
        say(f"search for the {members[worst].words}, in which the best design is worst")
        try:
            found = search(members[worst].problem)[:_EACH]
        except EstimationError:
            continue
        more = [seen_in(problem, d) for d in found]
        out += more
        costs += costs_of(more)
    say("search for all drawn aircraft at once")
    ranked = sorted([*designs, *out], key=lambda d: worst_of(members, d.u))
    shape = [] if problem.by_hand else _shaped_for_all(problem, ranked, members)
    return (*out, *shape, *_switched_for_all(problem, [*shape, *ranked], members))


def _switched_for_all(problem: Problem, ranked: Sequence[Design], members: Sequence[Member]) -> list[Design]:
    steps = steps_of(problem)
    forms = [Switching.of(m.problem, steps) for m in members]
    points = [steps.signs_of(d.u) for d in ranked[:_STARTS]]
    rng = np.random.default_rng(problem.seed)
    for levels in ([1.0, -1.0], [1.0, -1.0, 0.0]):
        points += [rng.choice(levels, len(forms[0].K)) for _ in range(_RANDOM)]
    found = sorted((exchange(forms, s) for s in points if np.any(s)), key=lambda pair: pair[1])
    best = [found[0][0], *(s for s, _ in found[1:] if not np.array_equal(s, found[0][0]))][:_KEPT]
    return [switched(problem, s, steps, "switching for all draws") for s in best]


def _shaped_for_all(problem: Problem, ranked: Sequence[Design], members: Sequence[Member]) -> list[Design]:
    spec = next((d.specs[0] for d in ranked if len(d.specs) == 1 and isinstance(d.specs[0], Multisine)), None)
    if not isinstance(spec, Multisine):
        return []
    of = [m.problem for m in members]
    lines = Lines.of(problem, spec, of)
    power, weight = np.full(lines.free.size, 1.0 / lines.free.size), np.full(len(of), 1.0 / len(of))
    best: tuple[float, Design] | None = None
    for k in range(1, _ROUNDS + 1):
        worth, costs = np.zeros(power.size), np.zeros(len(of))
        for i, p in enumerate(of):
            half = lines.half(i, p, power)
            variances = np.einsum("ti,it->t", p.targets.gradient, half)
            worst = int(np.argmax(variances))
            costs[i] = variances[worst]
            worth += weight[i] * np.einsum("i,lij,j->l", half[:, worst], lines.K[i], half[:, worst])
        weight = weight * np.exp(_PULL * costs / costs.max())
        weight /= weight.sum()
        power = power * np.sqrt(worth)
        power /= power.sum()
        if k % _LOOK == 0:
            design = lines.design(power, "multisine for all draws", "powers shaped for all draws")
            value = worst_of(members, design.u, np.inf if best is None else best[0])
            if best is None or value < best[0]:
                best = value, design
    return [] if best is None else [best[1]]
