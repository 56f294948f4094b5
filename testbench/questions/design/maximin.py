"""Designs for the aircraft in which the best one does worst: maximin over drawn aircraft, by exchange.

The design whose worst criterion over the draws is smallest has some draw in which it does worst. Designs are searched
for that aircraft, join the others, and the question is asked again. Two more are made for all of them at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.questions.design.draws import Draws, told
from testbench.questions.design.for_all import for_all
from testbench.questions.design.problem import Design, Problem, seen_in
from testbench.questions.design.search import search

_ROUNDS = 3  # draws that designs are searched for, at most
_EACH = 3  # designs that each of them adds


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
    names, out, done = problem.targets.names, [], set()
    costs = [_costs(d, draws, names) for d in designs]
    for _ in range(_ROUNDS):
        best = min(costs, key=lambda c: float(c.max()))
        worst = int(np.argmax(best))
        if worst in done:
            break
        done.add(worst)
        draw = draws.judged[worst]
        say(f"search for the drawn aircraft {draw.index}, in which the best design does worst")
        try:
            found = search(draw.problem)[:_EACH]
        except EstimationError:
            continue
        more = [seen_in(problem, d) for d in found]
        out += more
        costs += [_costs(d, draws, names) for d in more]
    say("search for all drawn aircraft at once")
    out += for_all(problem, [*designs, *out], draws)
    return tuple(out)


def _costs(design: Design, draws: Draws, names: Sequence[str]) -> FloatArray:
    return told(design, draws, names).costs
