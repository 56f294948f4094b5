"""Strain gauge: bending strain of the wing's skin at a station."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from testbench.sensors.sensor import Sensor


@dataclass(frozen=True)
class StrainGauge(Sensor):
    """Reads the bending strain strain_wing_i of a flexible wing (``aircraft.airframe.wing_strain``).

    The gauge factor's error is the ``scale``; a bridge that warms up drifts (``drift_std``, ``bias_walk``).
    """

    KIND: ClassVar[str] = "strain_gauge"
    READS: ClassVar[str] = r"strain_wing_\d+"
    PLACED: ClassVar[tuple[str, ...]] = ()
