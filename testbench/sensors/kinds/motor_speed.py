"""Motor speed: a tachometer on motor or propeller."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from testbench.sensors.sensor import Sensor


@dataclass(frozen=True)
class MotorSpeed(Sensor):
    """Reads the rotation of the propeller, for aircraft whose propulsion model turns one; others have no such channel.

    A counter of N pulses per turn that counts over the time T resolves 2 pi / (N T), its ``quantum``.
    """

    KIND: ClassVar[str] = "motor_speed"
    READS: ClassVar[str] = "motor_speed"
    PLACED: ClassVar[tuple[str, ...]] = ()
