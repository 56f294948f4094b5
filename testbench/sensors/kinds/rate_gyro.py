"""Rate gyro: the angular velocity about one body axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from testbench.sensors.triad import Triad


@dataclass(frozen=True)
class RateGyro(Triad):
    """Reads p, q or r, with the other two through misalignment (``cross_axis``).

    A rate is the same everywhere on a rigid body: it has no position. Data sheets give noise density
    (``noise_density``, deg/s per square root of Hz), in-run bias stability (``drift_std``, ``drift_time_s``) and rate
    random walk (``bias_walk``).
    """

    KIND: ClassVar[str] = "rate_gyro"
    READS: ClassVar[str] = "p|q|r"
    PLACED: ClassVar[tuple[str, ...]] = ()
