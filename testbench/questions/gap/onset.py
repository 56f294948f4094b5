"""What begins, or ends, in flight: sought in the records, which are then cut there.

A payload that is dropped, a link that slips, ice on a vane: before it the model is right, after it something is
missing. An unknown motion that is needed in a part of a record alone tells when (:mod:`testbench.inference.onset`). The
record is cut there; what follows begins where the flight before it is then. Every effect is weighed twice, as what acts
in all records, and as what acts in those that show it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FlightRecord, FloatArray
from testbench.effects import Effect
from testbench.inference.evidence import Comparison
from testbench.inference.linear import Linearised, Motion
from testbench.inference.onset import Onset, find_onset
from testbench.inference.unknown import PULSE_S
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.commanded import starts_freely
from testbench.questions.gap.explain import P_ONSET, percent
from testbench.questions.gap.name import unknown_motion
from testbench.questions.gap.scenario import SHORTEST_S
from testbench.questions.gap.search.point import Point
from testbench.questions.gap.starts import Start, marked, start_of
from testbench.questions.gap.windows import begin_freely, begin_from, part_of

KNOWN = 0.1  # share of the priors of a start that remains where the flight before tells it
_ROUNDS = 4  # in which time and coefficients are found in turn
LATER = "_later"  # end of the name of an effect that acts in some records alone


@dataclass(frozen=True)
class Begun:
    """What begins, or ends, in flight."""

    record: str  # name of the record in which it does; "" if it acts throughout some of them
    at_s: float  # time there
    ends: bool  # whether it ends there
    probability: float  # that it does not act in all of them, if anything is missing
    shown: tuple[str, ...]  # names of the records, parts of them included, that it acts in
    places: int  # number of times and records that were compared

    @property
    def when(self) -> str:
        """Where it acts, in words."""
        listed = ", ".join(f"'{n}'" for n in self.shown if not self.record or not n.startswith(f"{self.record}, "))
        if not self.record:
            return f"in {listed} alone"
        there = f"{'until' if self.ends else 'from'} {self.at_s:.3g} s of '{self.record}'{'' if self.ends else ' on'}"
        return f"{there} and in {listed}" if listed else there

    @property
    def sentence(self) -> str:
        """The same as a sentence."""
        return f"the missing effect acts {self.when}, probability {percent(self.probability)}"


def seek(believed: Believed, records: Mapping[str, FlightRecord], table: Comparison) -> list[Begun]:
    """Return where what is missing may begin or end, by an unknown motion alone, the most probable first."""
    names, flown = list(records), tuple(records.values())
    # Coefficients as they are where an unknown motion does what is missing: re-tuned without it, they would do it.
    nuisances: Mapping[str, float] = table["nothing"].posterior.by_name
    moved, begins = zip(*(_pulses(believed, r) for r in flown), strict=True)
    scales = np.array([table.noise[channel][0] for channel in believed.outputs])
    found: Sequence[Onset] = ()
    for _ in range(_ROUNDS):
        point = Point.towards_unknown(believed, flown, nuisances)
        blocks = [
            Linearised(left, -T, Motion.none(taken := believed.taken(r)), taken)
            for r, left, T in zip(flown, point.by_record(point.exact), point.by_record(point.tangents), strict=True)
        ]
        mean = -point.deviations * point.prior_std
        found, before = find_onset(blocks, moved, begins, scales, mean, point.prior_std, P_ONSET), found
        if before and before[0].place == found[0].place:
            break
        nuisances = point.named(point.towards(point.nuisances + found[0].step))
    out = []
    for onset in (o for o in found if o.places > 1):
        shown = [n for i, (n, s) in enumerate(zip(names, onset.shows, strict=True)) if s and i != onset.record]
        begun = Begun("", 0.0, False, onset.probability, tuple(shown), onset.places)
        if onset.record >= 0:
            name = names[onset.record]
            at_s = float(records[name].t_s[onset.sample] - records[name].t_s[0])
            begun = replace(begun, record=name, at_s=at_s, ends=onset.ends)
            begun = replace(begun, shown=(*shown, _names(begun)[0 if onset.ends else 1]))
        out.append(begun)
    return out


def samples(records: Mapping[str, FlightRecord], begun: Begun) -> list[NDArray[np.bool_]]:
    """Return the samples (n,) of each record in which what begins acts."""
    out = []
    for name, record in records.items():
        later = record.t_s - record.t_s[0] >= begun.at_s - 1e-9
        whole = np.full(len(record), name in begun.shown)
        out.append(whole if name != begun.record else ~later if begun.ends else later)
    return out


def _pulses(believed: Believed, record: FlightRecord) -> tuple[FloatArray, list[int]]:
    """Return the pulses (n, outputs, m) of an unknown motion of a record, and the samples at which they begin.

    Unknown deflections of surfaces are left out: there are many, and what they do is seen in the motion.
    """
    U = unknown_motion(believed, record, deflections=False)
    each = range(0, len(record), max(1, round(PULSE_S / record.dt_s)))  # of every state in turn
    own = [*each] * (U.shape[2] // len(each))
    # What acts in less than a window can hardly be told from what acts in none.
    edge = SHORTEST_S / record.dt_s
    last = max((b for b in own if b < len(record) - edge), default=0)
    return U, [0 if b < edge else min(b, last) for b in own]


def _names(begun: Begun) -> tuple[str, str]:
    return f"{begun.record}, until {begun.at_s:.3g} s", f"{begun.record}, from {begun.at_s:.3g} s"


def begin_there(
    believed: Believed, records: Mapping[str, FlightRecord], begun: Begun, whole: FlightRecord, along: Believed
) -> Believed:
    """Return the belief with the starts of what lies before and after the cut.

    Where something begins, the flight before it tells where what follows does; where something ends, the readings do,
    as in windows. What comes before begins at trim, or is a window, too. ``along`` is a model without what begins, that
    fits the rest.
    """
    before, after = (records[n] for n in _names(begun))
    if begun.ends:
        return begin_freely(believed, {"before": before, "after": after}, along)
    found = begin_from(along, whole, after, KNOWN)
    return begin_freely(replace(believed, free_starts=found.free_starts), {"before": before}, along)


def divided(believed: Believed, records: Mapping[str, FlightRecord], begun: Begun) -> dict[str, FlightRecord]:
    """Return records, cut where something begins, each of which says whether it acts there."""
    out = {}
    for name, record in records.items():
        parts = {name: record}
        if name == begun.record:
            cut = int(np.searchsorted(record.t_s - record.t_s[0], begun.at_s - 1e-9))
            before, after = _names(begun)
            first = record.between(float(record.t_s[0]), float(record.t_s[cut - 1]))
            parts = {before: part_of(record, 0, cut) if starts_freely(record) else first}
            parts[after] = part_of(record, cut, len(record))
        for part, data in parts.items():
            start = start_of(data) or Start(believed.condition)
            out[part] = marked(data, replace(start, changed=part in begun.shown))
    return out


def later(effects: Mapping[str, Effect], begun: Begun) -> dict[str, Effect]:
    """Return effects that act where something shows alone, beside those that act in all records."""
    own = {
        f"{n}{LATER}": replace(e, name=f"{n}{LATER}", title=f"{e.title} {begun.when}", later=True, looks=begun.places)
        for n, e in effects.items()
        if e.met is None and e.over_time is None
    }
    return {**effects, **own}


def lasting(believed: Believed, amended: Believed, records: Mapping[str, FlightRecord]) -> dict[str, FlightRecord]:
    """Return records held out, each of which says whether what begins in flight acts there: as it is nearer to."""
    out = {}
    for name, record in records.items():
        start = start_of(record) or Start(believed.condition)
        both = [marked(record, replace(start, changed=changed)) for changed in (False, True)]
        left = [float(np.sum(amended.residuals(r) ** 2)) for r in both]
        out[name] = both[int(left[1] < left[0])]
    return out
