"""After the flight: the runs of a plan found in its logs by what was commanded, and set against their cards.

A run is found where the recorded commands, less their mean, are those of a card. With t the command of the card less
its mean and x the recorded one over as many samples, likeness = 1 - |x - t|^2 / |t|^2; it is 1 for the same command,
and falls with a wrong amplitude as with a wrong time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import correlate

from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord, FloatArray
from testbench.questions.design.limits import breaches
from testbench.questions.plan.result import Card, Plan

_FOUND = 0.5  # judged: below this a movement is no run of a card
_FAITHFUL = 0.9  # judged: below this the command was not the card's: repeat
_INSIDE = 0.8  # judged: a smaller part of the samples inside a 95 % band is no surprise of noise alone


@dataclass(frozen=True, eq=False)
class FlownRun:
    """A run of a card that was found in a log.

    Attributes:
        card: that was flown.
        log: name of its file.
        start_s: start of the input on the clock of the record.
        likeness: of the recorded command to the card's, at most 1.
        V_m_s: mean airspeed of the settling time; None if the log has none.
        inside: channel -> part of the samples inside the card's 95 % band, deviations from the settling time.
        faults: why it must be repeated, in words; empty if it need not.
        record: from the settling time to the end of the manoeuvre.
    """

    card: Card
    log: str
    start_s: float
    likeness: float
    V_m_s: float | None
    inside: dict[str, float]
    faults: tuple[str, ...]
    record: FlightRecord


@dataclass(frozen=True, eq=False)
class Closed:
    """A plan after its flights: the runs that were found, and the logs that were searched."""

    plan: Plan
    logs: tuple[str, ...]
    runs: tuple[FlownRun, ...]

    def of(self, card: Card) -> list[FlownRun]:
        """Return the runs of a card."""
        return [r for r in self.runs if r.card is card]

    def missing(self, card: Card) -> int:
        """Return how many good runs of a card are still to be flown."""
        return max(card.repeats - sum(not r.faults for r in self.of(card)), 0)

    @property
    def following(self) -> Card | None:
        """The first card of the build-up that is not flown as often as it should be."""
        return next((c for c in self.plan.cards if self.missing(c)), None)


def close_plan(plan: Plan, records: Sequence[tuple[str, FlightRecord]]) -> Closed:
    """Find the runs of a plan in the records of its logs.

    Args:
        plan: with its cards flown in the simulator.
        records: (name, whole record) of each log, with the commands ``de_cmd`` and so on, or else the surfaces.

    Raises:
        RecordError: no log holds a control of any card.
    """
    runs: list[FlownRun] = []
    cards = [c for c in plan.cards if c.status != "refused"]
    seen = False
    for name, record in records:
        candidates: list[tuple[float, float, Card, int]] = []
        for card in cards:
            found = _likeness(record, card)
            if found is None:
                continue
            seen = True
            n = round(card.spec.duration_s / record.dt_s)
            while found.size and (best := float(found.max())) > _FOUND:
                start = int(found.argmax())
                candidates.append((best - _off_speed(record, card, start), best, card, start))
                found[max(start - n + 1, 0) : start + n] = -np.inf
        taken: list[tuple[int, int]] = []
        for _, likeness, card, start in sorted(candidates, key=lambda c: -c[0]):
            end = start + round(card.spec.duration_s / record.dt_s)
            if all(end <= a or start >= b for a, b in taken):
                taken.append((start, end))
                runs.append(_run(plan, card, name, record, start, likeness))
    if not seen:
        wanted = sorted({f"{c}_cmd" for card in cards for c in card.spec.controls})
        raise RecordError(
            f"a log of this plan must hold a control of its cards ({', '.join(wanted)}), got none in "
            f"{', '.join(name for name, _ in records)}"
        )
    order = {id(card): k for k, card in enumerate(plan.cards)}
    names = [name for name, _ in records]
    runs.sort(key=lambda r: (order[id(r.card)], names.index(r.log), r.start_s))
    return Closed(plan, tuple(names), tuple(runs))


def _commands(record: FlightRecord, card: Card) -> FloatArray | None:
    """Return what was commanded (n, m); None if a control was not recorded."""
    columns = []
    for control in card.spec.controls:
        name = next((c for c in (f"{control}_cmd", control) if c in record), None)
        if name is None:
            return None
        columns.append(record[name])
    return np.column_stack(columns)


def _likeness(record: FlightRecord, card: Card) -> FloatArray | None:
    """Return the likeness of the recorded commands to the card's for every start (k,); None without its controls."""
    x = _commands(record, card)
    n = round(card.spec.duration_s / record.dt_s)
    if x is None:
        return None
    if len(x) < n or n < 2:
        return np.empty(0)
    rows = np.minimum((np.arange(n) * record.dt_s / card.signal.dt_s + 1e-6).astype(int), len(card.signal.u) - 1)
    energy, error = 0.0, np.zeros(len(x) - n + 1)
    for j, control in enumerate(card.spec.controls):
        t = card.signal.u[rows, card.signal.channels.index(control)]
        t = t - t.mean()
        y = x[:, j] - x[:, j].mean()
        total, squares = (np.concatenate([[0.0], np.cumsum(v)]) for v in (y, y**2))
        mean = (total[n:] - total[:-n]) / n
        own = squares[n:] - squares[:-n] - n * mean**2
        error += own - 2.0 * correlate(y, t, "valid", "fft") + np.sum(t**2)
        energy += float(np.sum(t**2))
    return 1.0 - error / energy if energy > 0.0 else np.empty(0)


def _settled(record: FlightRecord, card: Card, start: int) -> slice:
    """Return the rows of the settling time before a start, or the first sample of the run if there are none."""
    return slice(max(start - round(card.spec.settle_s / record.dt_s), 0), max(start, 1))


def _off_speed(record: FlightRecord, card: Card, start: int) -> float:
    """Return by which part of its speed a run was flown beside the speed of a card; 0 if nobody knows."""
    if "V" not in record:
        return 0.0
    return abs(float(record["V"][_settled(record, card, start)].mean()) / card.point.V_m_s - 1.0)


def _run(plan: Plan, card: Card, log: str, record: FlightRecord, start: int, likeness: float) -> FlownRun:
    n = round(card.spec.duration_s / record.dt_s)
    before = _settled(record, card, start)
    t0 = float(record.t_s[start])
    cut = record.between(float(record.t_s[before.start]), float(record.t_s[start + n - 1]))
    window = plan.scenario.autopilot.speed_window_m_s
    faults = []
    if likeness < _FAITHFUL:
        faults.append(f"the command was not the card's (likeness {likeness:.2f})")
    V = float(record["V"][before].mean()) if "V" in record else None
    if V is not None and abs(V - card.point.V_m_s) > 2.0 * window:
        faults.append(f"it began at {V:.1f} m/s instead of {card.point.V_m_s:g}")
    bands = {x.channel: (x.low, x.high) for x in card.limits if x.channel in record and x.channel not in "de da dr thr"}
    faults += [b._replace(t_s=b.t_s - t0).sentence for b in breaches(cut, bands)]
    inside = _inside(record, card, start, before)
    strange = [name for name, part in inside.items() if part < _INSIDE]
    if strange:
        faults.append(f"the response left its band: {', '.join(strange)}")
    return FlownRun(card, log, t0, likeness, V, inside, tuple(faults), cut)


def _inside(record: FlightRecord, card: Card, start: int, before: slice) -> dict[str, float]:
    """Return channel -> part of the samples of a run that lie inside the card's band, as deviations from before it."""
    n = round(card.spec.duration_s / record.dt_s)
    t = np.arange(n) * record.dt_s
    still = card.t_s < 0.0
    out = {}
    for name, half in card.band.items():
        if name not in record:
            continue
        flown = record[name][start : start + n] - record[name][before].mean()
        trim = card.expected[name][still].mean() if still.any() else card.expected[name][0]
        off = np.abs(flown - np.interp(t, card.t_s, card.expected[name] - trim))
        taken = record.valid[start : start + n, record.channels.index(name)]
        if taken.any():
            out[name] = float(np.mean(off[taken] <= np.interp(t, card.t_s, half)[taken]))
    return out
