"""Satellite navigation: position, altitude, and velocity over ground, a few times a second and delayed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from testbench.sensors.sensor import Sensor


@dataclass(frozen=True)
class Gps(Sensor):
    """Reads north, east, h, v_north, v_east, hdot or the ground speed Vg.

    It reads at its own rate (5 to 10 Hz), and 0.1 to 0.3 s late. Position errors wander (``drift_std``,
    ``drift_time_s``) rather than jump; velocities come from Doppler and are nearly white. Rate and delay have no
    default, because every receiver has them.
    """

    KIND: ClassVar[str] = "gps"
    READS: ClassVar[str] = "north|east|h|v_north|v_east|hdot|Vg"
    PLACED: ClassVar[tuple[str, ...]] = ()

    def _kind_faults(self) -> Iterator[str]:
        yield from super()._kind_faults()
        if self.rate_hz is None:
            yield "rate_hz: a receiver has a rate of its own, 5 to 10 Hz as a rule; give it"
        if not self.delay_s > 0.0:
            yield f"delay_s: 0 < delay_s must hold for a receiver, got {self.delay_s:g}; 0.1 to 0.3 s is usual"
