"""Name what one lateral case hides: records, believed model and suite go in, the answer does not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from studies.blind.found_row import found_row
from studies.blind.lateral_flights import suite

from testbench.core.record import FlightRecord
from testbench.effects import OTHER_SERVOS, Effect, library
from testbench.flight import load_aircraft
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.sealed.flights import RATE_HZ, condition
from testbench.questions.gap.workflow import find_gap


def believe(aircraft: str) -> Believed:
    """Return what is believed of an aircraft of the lateral draw: rigid wings, the suite, the condition."""
    return Believed(load_aircraft(aircraft, "rigid"), suite(), condition(aircraft), RATE_HZ)


def searched(believed: Believed, without: Sequence[str] = ()) -> tuple[dict[str, Effect], dict[str, Effect]]:
    """Return the library, and what is sought beside it where a path is pointed to, less some effects.

    Those of which these are special cases are left out, too.
    """
    gone = set(without)

    def left(known: Mapping[str, Effect]) -> dict[str, Effect]:
        return {n: e for n, e in known.items() if n not in gone and gone.isdisjoint(e.contains)}

    return left(library(believed.suite, believed.aircraft)), left(OTHER_SERVOS)


def named(
    believed: Believed,
    records: Mapping[str, FlightRecord],
    held_out: Mapping[str, FlightRecord],
    without: Sequence[str] = (),
) -> dict[str, Any]:
    """Return what the workflow says of the records of one case, as JSON values."""
    known, further = searched(believed, without)
    return found_row(lambda: find_gap(believed, records, held_out, effects=known, further=further))
