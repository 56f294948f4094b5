"""Magnetic heading: a compass in an airframe with iron in it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from testbench.core.constants import DEG_RAD
from testbench.core.record import FloatArray
from testbench.sensors.sensor import Sensor


@dataclass(frozen=True)
class MagneticHeading(Sensor):
    """Reads psi + B sin psi + C cos psi + D sin 2 psi + E cos 2 psi, the deviation of the compass.

    B and C are hard iron (magnetised parts, currents), D and E soft iron; the constant A and the error of the magnetic
    declination are the ``bias``. Heading is felt as if levelled by a perfect attitude.

    Args:
        deviation: B, C, D, E, rad; in files ``deviation_deg``.
    """

    deviation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    KIND: ClassVar[str] = "magnetic_heading"
    READS: ClassVar[str] = "psi"
    PLACED: ClassVar[tuple[str, ...]] = ()
    IN_FILES: ClassVar[Mapping[str, tuple[str, float]]] = {"deviation_deg": ("deviation", DEG_RAD)}

    def _kind_faults(self) -> Iterator[str]:
        yield from super()._kind_faults()
        if len(self.deviation) != 4 or not all(math.isfinite(x) for x in self.deviation):
            yield f"deviation_deg: four finite numbers B, C, D, E are needed, got {self.deviation}"
        elif sum(abs(x) for x in self.deviation) >= 0.5:
            yield "deviation_deg: the four must add up to less than 0.5 rad, or a heading is not unique; calibrate"

    def feel(self, x: Mapping[str, FloatArray]) -> FloatArray:
        """Return the heading that the compass shows (n,)."""
        psi, (B, C, D, E) = x["psi"], self.deviation
        if not any(self.deviation):
            return psi
        error = B * np.sin(psi) + C * np.cos(psi) + D * np.sin(2.0 * psi) + E * np.cos(2.0 * psi)
        return np.asarray(psi + error)
