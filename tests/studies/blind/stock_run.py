"""What is believed and told of one case of a stock aircraft: the answer is not among it."""

from __future__ import annotations

from collections.abc import Mapping

from studies.blind.lateral_flights import suite
from studies.blind.stock_flights import FIGHTER, FLOWN, Flown, manoeuvres

from testbench.core.record import FlightRecord
from testbench.flight import load_aircraft
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.sealed.flights import RATE_HZ
from testbench.questions.gap.starts import Start, marked

_FLOWN = FLOWN | FIGHTER


def believe(aircraft: str) -> Believed:
    """Return what is believed of a stock aircraft: the suite of all axes, the first of its conditions."""
    return Believed(load_aircraft(aircraft), suite(), _FLOWN[aircraft].conditions[0], RATE_HZ)


def told(aircraft: str, which: str, records: Mapping[str, FlightRecord]) -> dict[str, FlightRecord]:
    """Return records that say which condition each was flown from."""
    return told_of(_FLOWN[aircraft], which, records)


def told_of(f: Flown, which: str, records: Mapping[str, FlightRecord]) -> dict[str, FlightRecord]:
    """Return records that say which of three conditions each was flown from."""
    return {n: marked(records[n], Start(f.conditions[i])) for n, (i, _) in manoeuvres(f, which).items()}
