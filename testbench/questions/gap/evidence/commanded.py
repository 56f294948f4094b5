"""What was commanded in a measured record, and the quiet flight before it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import CONTROLS
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord, FloatArray

LATERAL_COMMANDS = ("da_cmd", "dr_cmd")
FREE = "free_start"  # in the provenance of a record that does not begin at trim
LEAST_QUIET_S = 0.5
MOVED = 1e-3  # rad, or share of the throttle, by which a command must change to count as moved


def moves_laterally(records: Sequence[FlightRecord]) -> bool:
    """Return whether an aileron or rudder command moves in any of the records."""
    return any(_moved(r.columns([n for n in LATERAL_COMMANDS if n in r])).any() for r in records)


def commands(record: FlightRecord) -> tuple[tuple[str, ...], FloatArray]:
    """Return the controls whose commands the record holds, and their deviations (n, m) from the quiet flight.

    Of a record that starts freely they are the deviations from what it says it is measured from.

    Raises:
        RecordError: no command, or less than half a second of quiet flight.
    """
    names = tuple(n for n in CONTROLS if f"{n}_cmd" in record)
    if not names:
        raise RecordError("a record of the gap workflow must hold a command such as de_cmd, got none")
    u = record.columns(f"{n}_cmd" for n in names)
    if starts_freely(record):
        level = record.provenance[FREE]["commands"]
        return names, u - np.array([level[n] for n in names])
    return names, u - u[: quiet_samples(record)].mean(axis=0)


def starts_freely(record: FlightRecord) -> bool:
    """Return whether a record is said not to begin at trim, see :func:`freed`."""
    return FREE in record.provenance


def freed(record: FlightRecord, key: str, level: Mapping[str, float]) -> FlightRecord:
    """Return the record, said not to begin at trim.

    Args:
        record: measured.
        key: tells its start from those of others.
        level: control -> command that its commands are deviations from, about that of trim.
    """
    return replace(record, provenance={**record.provenance, FREE: {"key": key, "commands": dict(level)}})


def key_of_start(record: FlightRecord) -> str:
    """Return what tells the start of a record that starts freely from others."""
    return str(record.provenance[FREE]["key"])


def quiet_samples(record: FlightRecord) -> int:
    """Return how many samples pass before the first command moves.

    Raises:
        RecordError: less than half a second.
    """
    count = _still(record)
    if not begins_quietly(record):
        raise RecordError(
            f"a record must begin with at least {LEAST_QUIET_S:g} s of quiet flight, got {count * record.dt_s:.2f} s; "
            'cut it earlier, or let it be cut into windows that start freely (windows = "auto", --windows auto)'
        )
    return count


def begins_quietly(record: FlightRecord) -> bool:
    """Return whether a record begins with half a second in which no command moves."""
    return not starts_freely(record) and _still(record) * record.dt_s >= LEAST_QUIET_S


def _still(record: FlightRecord) -> int:
    moved = _moved(record.columns([n for n in record.channels if n.endswith("_cmd")]))
    return int(np.argmax(moved)) if moved.any() else len(record)


def _moved(commands: FloatArray) -> NDArray[np.bool_]:
    """Return at which samples (n,) any of the commands (n, m) is not where it began."""
    return np.asarray(np.any(np.abs(commands - commands[0]) > MOVED, axis=1))
