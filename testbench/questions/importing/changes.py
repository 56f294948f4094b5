"""Whether something has changed in a flight that was logged: when, in which part, and with which probability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord
from testbench.inference.changes import FASTEST_HZ, NOMINAL_S, Change, Watch
from testbench.logs.stretches import flown_parts
from testbench.page.labels import number

if TYPE_CHECKING:
    from testbench.questions.importing.ask import Imported

_AT_ONCE = 100  # samples that a finished log gives at a time
_PARTS = {
    "de": "the elevator", "da": "the aileron", "dr": "the rudder", "thr": "the throttle", "right": "the right elevon",
    "left": "the left elevon",
}  # fmt: skip


def watch_log(imported: Imported, nominal: Sequence[Imported] = (), nominal_s: float = NOMINAL_S) -> Watch:
    """Return the flight of a log, watched for changes from its beginning on.

    Args:
        imported: the log.
        nominal: logs of flights of the same aircraft in which nothing changed.
        nominal_s: beginning of the flight that is believed nominal, s of flight.

    Raises:
        RecordError: the log does not hold a control with what it moves, comes too slowly, or holds too little flight.

    Example:
        >>> import testbench as tb
        >>> from testbench.questions.importing.changes import watch_log
        >>> watch_log(tb.import_log("flight.bin")).changed  # doctest: +SKIP
        0.02
    """
    first = Watch(imported.record.channels, 1.0 / FASTEST_HZ)
    needed = (*first.states, *first.controls.values())
    rate = min(FASTEST_HZ, imported.rate_hz, *(imported.noise[n].rate_hz for n in needed))
    watch = Watch(imported.record.channels, 1.0 / rate, nominal_s)
    watch.believe([_flown(each, rate, needed) for each in nominal])
    record = _flown(imported, rate, needed)
    for k in range(0, len(record), _AT_ONCE):
        rows = slice(k, k + _AT_ONCE)
        watch.take(FlightRecord(record.t_s[rows], record.channels, record.data[rows], "measured", record.valid[rows]))
    if not watch.t_s:
        raise RecordError(
            f"'{imported.log.file.name}' must hold more flight than the {nominal_s:g} s that are believed nominal, got "
            f"{number(float(record.valid.all(axis=1).sum()) / rate)} s"
        )
    return watch


def _flown(imported: Imported, rate_hz: float, needed: Sequence[str]) -> FlightRecord:
    """Return the record at a rate; samples on the ground are not valid."""
    record = imported.at_rate(rate_hz).record.select(needed)
    parts = flown_parts(imported.stretches) or [(float(record.t_s[0]), float(record.t_s[-1]))]
    flown = np.any([(record.t_s >= a) & (record.t_s <= b) for a, b in parts], axis=0)
    return replace(record, valid=record.valid & flown[:, None])


def change_lines(watch: Watch) -> list[str]:
    """Return what a finished log says of changes, in sentences."""
    found = watch.found()
    if not found:
        return [f"nothing has changed in flight: {_probability(1.0 - watch.changed)}"]
    end_s = watch.t_s[-1]
    return [change_sentence(c, None if c.until_s >= end_s else c.until_s) for c in found]


def change_sentence(c: Change, until_s: float | None = None) -> str:
    """Return a change in one sentence; of one that lasts, or whose end is not known, ``until_s`` is None."""
    when = f"since {c.since_s:.0f} s" if until_s is None else f"from {c.since_s:.0f} to {until_s:.0f} s"
    if c.kind == "unknown":
        what = "the aircraft does not answer as before, and no single part explains it"
    elif c.kind == "stuck":
        what = f"{_PARTS[c.part]} stands still"
    elif c.kind == "reads":
        wrong = "has the wrong sign" if c.factor < 0.0 else f"reads {number(c.factor, 2)} of what it measures"
        what = f"{c.part} {wrong}: check its instrument"
    else:
        what = f"{_PARTS[c.part]} has {number(c.factor, 2)} ± {number(2.0 * c.std, 1)} of its effect"
    part = "" if c.of_part > 0.99 or c.kind == "unknown" else f" ({100.0 * c.of_part:.0f} % likely if so)"
    return f"{when} {what}{part}: {_probability(c.probability)}"


def _probability(p: float) -> str:
    return "p > 0.99" if p > 0.99 else f"p = {p:.2f}"
