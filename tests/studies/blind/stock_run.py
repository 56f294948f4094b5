"""Name what one case of a stock aircraft hides: records, their conditions and the suite go in, the answer does not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from studies.blind.found_row import found_row
from studies.blind.lateral_run import searched

from testbench.core.record import FlightRecord
from testbench.flight import load_aircraft
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.sealed.flights import RATE_HZ
from testbench.questions.gap.sealed.lateral_flights import suite
from testbench.questions.gap.sealed.stock_flights import FLOWN, manoeuvres
from testbench.questions.gap.starts import Start, marked
from testbench.questions.gap.workflow import find_gap


def believe(aircraft: str) -> Believed:
    """Return what is believed of a stock aircraft: the suite of all axes, the first of its conditions."""
    return Believed(load_aircraft(aircraft), suite(), FLOWN[aircraft].conditions[0], RATE_HZ)


def told(aircraft: str, which: str, records: Mapping[str, FlightRecord]) -> dict[str, FlightRecord]:
    """Return records that say which condition each was flown from."""
    at = FLOWN[aircraft].conditions
    return {n: marked(records[n], Start(at[i])) for n, (i, _) in manoeuvres(aircraft, which).items()}


def name_stock(
    aircraft: str,
    records: Mapping[str, FlightRecord],
    held_out: Mapping[str, FlightRecord],
    without: Sequence[str] = (),
) -> dict[str, Any]:
    """Return what the workflow says of the records of one case, as JSON values."""
    believed = believe(aircraft)
    known, further = searched(believed, without)
    records, held_out = told(aircraft, "rich", records), told(aircraft, "held_out", held_out)
    return found_row(lambda: find_gap(believed, records, held_out, effects=known, further=further))
