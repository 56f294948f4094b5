"""What was commanded in a measured record, and the quiet flight before it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import CONTROLS
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord, FloatArray

LATERAL_COMMANDS = ("da_cmd", "dr_cmd")
MOVED = 1e-3  # rad, or share of the throttle, by which a command must change to count as moved


def moves_laterally(records: Sequence[FlightRecord]) -> bool:
    """Return whether an aileron or rudder command moves in any of the records."""
    return any(_moved(r.columns([n for n in LATERAL_COMMANDS if n in r])).any() for r in records)


def commands(record: FlightRecord) -> tuple[tuple[str, ...], FloatArray]:
    """Return the controls whose commands the record holds, and their deviations (n, m) from the quiet flight.

    Raises:
        RecordError: no command, or less than half a second of quiet flight.
    """
    names = tuple(n for n in CONTROLS if f"{n}_cmd" in record)
    if not names:
        raise RecordError("a record of the gap workflow must hold a command such as de_cmd, got none")
    u = record.columns(f"{n}_cmd" for n in names)
    return names, u - u[: quiet_samples(record)].mean(axis=0)


def quiet_samples(record: FlightRecord) -> int:
    """Return how many samples pass before the first command moves.

    Raises:
        RecordError: less than half a second.
    """
    commands = record.columns([n for n in record.channels if n.endswith("_cmd")])
    moved = _moved(commands)
    count = int(np.argmax(moved)) if moved.any() else len(record)
    if count * record.dt_s < 0.5:
        raise RecordError(
            f"a record must begin with at least 0.5 s of quiet flight, got {count * record.dt_s:.2f} s; cut it earlier"
        )
    return count


def _moved(commands: FloatArray) -> NDArray[np.bool_]:
    """Return at which samples (n,) any of the commands (n, m) is not where it began."""
    return np.asarray(np.any(np.abs(commands - commands[0]) > MOVED, axis=1))
