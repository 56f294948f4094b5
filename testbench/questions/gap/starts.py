"""What a record was flown from where that is not what the others were: its condition and load, told by the record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace

from testbench.aircraft import Aircraft
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord
from testbench.flight import FlightCondition
from testbench.questions.gap.effects.payload import with_load
from testbench.sensors import SensorSuite

KEY = "flown_from"
"""Of a record's provenance, under which its start stands: what is cut out of a record or made of it keeps it."""


@dataclass(frozen=True)
class Start:
    """The condition that a record starts from, and what the aircraft carried beyond what is believed of it.

    Attributes:
        condition: that is trimmed.
        load_kg: more than the believed mass; negative if less was carried, fuel that was burnt for one.
        load_aft_m: place of the load behind the believed centre of gravity, on the centre line.
    """

    condition: FlightCondition
    load_kg: float = 0.0
    load_aft_m: float = 0.0

    def loaded(self, aircraft: Aircraft, suite: SensorSuite) -> tuple[Aircraft, SensorSuite]:
        """Return an aircraft that carries the load, and the sensors, whose places are told from the centre of gravity.

        Raises:
            RecordError: nothing would be left of the mass.
        """
        if self.load_kg == 0.0:
            return aircraft, suite
        if self.load_kg <= -aircraft.mass.mass_kg:
            raise RecordError(
                f"load_kg > {-aircraft.mass.mass_kg:.4g} must hold, as the aircraft weighs no more, "
                f"got {self.load_kg:g}"
            )
        return with_load(aircraft, suite, "load", self.load_kg, self.load_aft_m)

    def __str__(self) -> str:
        return str(self.condition) + (f", {self.load_kg:+.3g} kg" if self.load_kg else "")


def marked(record: FlightRecord, start: Start) -> FlightRecord:
    """Return a record that says what it was flown from."""
    told = {**asdict(start.condition), "load_kg": start.load_kg, "load_aft_m": start.load_aft_m}
    return replace(record, provenance={**record.provenance, KEY: told})


def start_of(record: FlightRecord) -> Start | None:
    """Return what a record says that it was flown from; None if it says nothing, as the condition of all is its own.

    Raises:
        RecordError: what it says is no start.
    """
    told = record.provenance.get(KEY)
    if told is None:
        return None
    try:
        if not isinstance(told, Mapping):
            raise TypeError("no table")
        values = {str(n): float(v) for n, v in told.items()}
        load = {n: values.pop(n) for n in ("load_kg", "load_aft_m") if n in values}
        return Start(FlightCondition(**values), **load)
    except (TypeError, ValueError):
        raise RecordError(
            f"provenance '{KEY}' of a record must hold V_m_s and h_m, and may hold gamma_rad, load_kg and load_aft_m, "
            f"as numbers, got {told!r}"
        ) from None
