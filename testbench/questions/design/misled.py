"""What the estimates of a design are off by without any noise, and amplitudes that weigh it against the noise.

The aircraft bends, servos and commands move between samples, sensors lag: what its sensors show in still air differs
from what the estimator's model has at the true parameters. To first order, the estimates move by the least-squares
answer to that difference. Standard errors fall with the amplitude and what bends grows with it, so that there is a best
amplitude, which may lie below all limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbench.questions.design.flown import Envelope, Flown
from testbench.questions.design.problem import best_share, rescaled
from testbench.questions.design.realise import Range

_ROUNDS = 2  # of flights at a lower amplitude, at most
_LOWER = 0.9  # share of the amplitude from which lowering it is worth a flight


def weighed(range_: Range, flown: Sequence[Flown], envelope: Envelope) -> list[Flown]:
    """Return designs with what they are off by, at the amplitudes at which that and the noise weigh least together.

    Args:
        range_: where they fly, and by what they are identified.
        flown: at amplitudes that keep the limits.
        envelope: the limits.
    """
    problem = range_.problem
    shares = np.ones(len(flown))
    best = range_.off([f.design for f in flown])
    for _ in range(_ROUNDS):
        lower = {i: best_share(problem, d, off) for i, (d, off) in enumerate(best) if off is not None}
        tried = {i: shares[i] * r for i, r in lower.items() if r < _LOWER}
        again = range_.off([rescaled(problem, flown[i].design, r, flown[i].design.limit) for i, r in tried.items()])
        better = False
        for (i, r), (design, off) in zip(tried.items(), again, strict=True):
            if off is not None and design.cost < best[i][0].cost:
                best[i], shares[i], better = (design, off), r, True
        if not better:
            break
    out = [replace(f, design=d, curbed=float(s)) for f, (d, _), s in zip(flown, best, shares, strict=True)]
    lowered = {i: f.design for i, f in enumerate(out) if f.curbed < 1.0}
    return range_.flown_as(out, lowered, envelope)
