"""A smaller amplitude where flights show that the estimates are off by more than linear theory foresees.

:mod:`testbench.questions.design.misled` weighs the bias of a bent response to first order. The estimator is not linear:
process noise takes a part of what bends, and correlated estimates move together. Where most of the realised error is a
mean error, half the amplitude is realised, too, and counts if it is clearly better.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from testbench.questions.design.flown import Envelope, Flown
from testbench.questions.design.known import total_errors
from testbench.questions.design.problem import Design, rescaled
from testbench.questions.design.realise import Range, Realised

CLEARLY = 0.7
"""Share of a realised criterion below which another is better beyond the chance of 20 flights."""
_HALF = 0.5
_HALVINGS = 3  # down to an eighth: an input below that drowns in noise
_MOST = 0.5  # of the mean square error: a bias of which a smaller amplitude may take away enough to count


def realised_cost(range_: Range, design: Design, realised: Realised) -> float:
    """Return the largest error to plan with over the wanted one, earlier flights counted."""
    return float(np.max(total_errors(range_.problem, design, realised.headline) / range_.targets.wanted))


def misleads(range_: Range, design: Design, realised: Realised) -> bool:
    """Return whether the worst target misses what is wanted, against the promise, for a mean error above all."""
    total = total_errors(range_.problem, design, realised.headline) / range_.targets.wanted
    k = int(np.argmax(total))
    if not (total[k] > 1.0 and realised.differs[k] and realised.found.n):
        return False
    return realised.found.lasting(k) ** 2 > _MOST * float(realised.found.rms[k]) ** 2


def gentler(
    range_: Range, flown: Flown, realised: Realised, envelope: Envelope, n: int, say: Callable[[str], None]
) -> tuple[Flown, Realised]:
    """Return a design at the amplitude whose realised errors are clearly the best, and what was realised there.

    Args:
        range_: where it flies, and by what it is identified.
        flown: the design.
        realised: what ``n`` flights of it have shown.
        envelope: the limits.
        n: flights of each amplitude.
        say: called with a few words before each amplitude.
    """
    share = 1.0
    for _ in range(_HALVINGS):
        if not misleads(range_, flown.design, realised):
            break
        say(f"realise the {flown.design.family} at half its amplitude, which bends less: {n} times")
        ((design, _),) = range_.off([rescaled(range_.problem, flown.design, _HALF, flown.design.limit)])
        found = range_.realised(design, n, say)
        if realised_cost(range_, design, found) > CLEARLY * realised_cost(range_, flown.design, realised):
            break
        share *= _HALF
        flown, realised = replace(flown, design=design), found
    if share < 1.0:
        (flown,) = range_.flown_as([replace(flown, curbed=flown.curbed * share)], {0: flown.design}, envelope)
    return flown, realised
