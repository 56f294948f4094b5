"""Command log: the number that is sent to a servo or speed controller."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from testbench.sensors.sensor import Sensor


@dataclass(frozen=True)
class CommandLog(Sensor):
    """Reads de_cmd, da_cmd, dr_cmd or thr_cmd; exact but for the resolution of the pulses (``quantum``) and the clock
    of the recorder.
    """

    KIND: ClassVar[str] = "command_log"
    READS: ClassVar[str] = "de_cmd|da_cmd|dr_cmd|thr_cmd"
    PLACED: ClassVar[tuple[str, ...]] = ()
