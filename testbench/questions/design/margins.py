"""Amplitudes with a margin that the air asks for, from extremes over flights in turbulence, or the model's doubt.

A design flies several times in turbulence. Of every limit the share used by each flight's extreme has a mean and a
standard deviation; the amplitude is lowered until mean + k deviations stays inside. With k = t(n - 1, 1 - P)
sqrt(1 + 1/n) the next flight meets the limit with probability P, if extremes are normal. In still air the extremes
of one aircraft are all alike; there the limits hold for aircraft of less and more static stability, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from testbench.aircraft import Aircraft
from testbench.flight import TrimmedFlight
from testbench.questions.design.flown import ABORTED, SHOWN, Envelope, Flight, Flown, Margin, fly_each
from testbench.questions.design.problem import Design, rescaled
from testbench.questions.design.realise import Range

_ROUNDS = 4  # of flights, at most, until the extremes stay inside
_LEAST = 0.25  # of the amplitude: where less would be needed, the air itself meets the limit
_LESS = 0.98  # of the amplitude at which mean + k deviations would just meet the limit


@dataclass(frozen=True, eq=False)
class _Extremes:
    """Share of each limit that each flight's extreme uses, (n, limits), and how many flights met some limit."""

    shares: np.ndarray
    met: int


def with_margins(range_: Range, flown: Sequence[Flown], envelope: Envelope, n: int, probability: float) -> list[Flown]:
    """Return designs at amplitudes whose extremes stay inside the limits in turbulence, each with its margin.

    The turbulence's part of an extreme is taken as the same at every amplitude from one round of flights to the next.

    Args:
        range_: where they fly; its air must move.
        flown: at amplitudes that keep the limits in still air.
        envelope: the limits.
        n: flights of each design.
        probability: that the next flight meets a limit.
    """
    k = float(student.ppf(1.0 - probability, n - 1) * np.sqrt(1.0 + 1.0 / n))
    names = envelope.names
    designs = [f.design for f in flown]
    still = [envelope.shares(f.record) for f in flown]
    factors = np.ones(len(flown))
    margins: list[Margin | None] = [None] * len(flown)
    open_ = list(range(len(flown)))
    for _ in range(_ROUNDS):
        if not open_:
            break
        extremes = _extremes(range_, [designs[i] for i in open_], envelope, n)
        left = []
        for i, found in zip(open_, extremes, strict=True):
            mean, deviation = found.shares.mean(axis=0), found.shares.std(axis=0, ddof=1)
            reach = mean + k * deviation
            tight = int(np.argmax(reach))
            margins[i] = Margin(
                n,
                probability,
                names[tight],
                float(mean[tight]),
                float(deviation[tight]),
                float(reach[tight]),
                found.met,
                float(factors[i]),
            )
            if reach[tight] <= 1.0 or factors[i] <= _LEAST:
                continue
            own = still[i] * factors[i]
            over = reach > 1.0
            ratio = (1.0 - (reach - own))[over] / np.maximum(own[over], 1e-9)
            factors[i] = max(_LEAST, factors[i] * min(_LESS * float(ratio.min()), _LESS))
            designs[i] = rescaled(range_.problem, flown[i].design, float(factors[i]), names[tight])
            left.append(i)
        open_ = left
    out = [replace(f, margin=m) for f, m in zip(flown, margins, strict=True)]
    return range_.flown_as(out, {i: designs[i] for i in range(len(flown)) if factors[i] < 1.0}, envelope)


def for_others(
    range_: Range, flown: Sequence[Flown], envelope: Envelope, others: Sequence[tuple[Aircraft, TrimmedFlight]]
) -> list[Flown]:
    """Return designs at amplitudes at which other aircraft, too, keep the limits in still air.

    Args:
        range_: where the believed aircraft flies.
        flown: at amplitudes with which that one keeps the limits.
        envelope: the limits.
        others: the other aircraft.
    """
    factors, designs = np.ones(len(flown)), [f.design for f in flown]
    open_ = list(range(len(flown))) if others else []
    for _ in range(_ROUNDS):
        pairs = [(i, *other) for i in open_ for other in others]
        found = fly_each(
            [a for _, a, _ in pairs], [t for _, _, t in pairs], [designs[i] for i, *_ in pairs],
            [envelope] * len(pairs), range_.simulator, range_.tally,
        )  # fmt: skip
        worst = dict.fromkeys(open_, 0.0)
        for (i, *_), flight in zip(pairs, found, strict=True):
            if isinstance(flight, Flight):
                worst[i] = max(worst[i], flight.tightest.share)
        open_ = [i for i in open_ if worst[i] > 1.0 and factors[i] > _LEAST]
        for i in open_:
            factors[i] = max(_LEAST, factors[i] * _LESS / worst[i])
            designs[i] = rescaled(range_.problem, flown[i].design, float(factors[i]), flown[i].design.limit)
        if not open_:
            break
    out = [replace(f, for_others=float(factor)) for f, factor in zip(flown, factors, strict=True)]
    return range_.flown_as(out, {i: designs[i] for i in range(len(flown)) if factors[i] < 1.0}, envelope)


def _extremes(range_: Range, designs: Sequence[Design], envelope: Envelope, n: int) -> list[_Extremes]:
    """Return the extremes of each design over the same ``n`` airs."""
    flights = range_.fly_each(designs, range_.airs(0, n), (*envelope.channels, *SHOWN), fewest=1)
    aborted = np.full(len(envelope.names), 1.0 / ABORTED)
    shares = [
        np.array([aborted if isinstance(record, str) else envelope.shares(record) for record in own]) for own in flights
    ]
    return [_Extremes(part, int(np.count_nonzero(part.max(axis=1) > 1.0))) for part in shares]
