"""Instruments that come in threes, one per body axis, and lean towards each other's axes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from testbench.core.record import FloatArray
from testbench.sensors.sensor import Sensor


@dataclass(frozen=True)
class Triad(Sensor):
    """One of three instruments along body x, y, z, not quite aligned: x + sum_j c_j x_j.

    Args:
        cross_axis: c, shares of the quantity along body x, y, z that it feels too; for small misalignment the angles
            in rad by which its axis leans towards the others. Its own entry is zero: that is the scale.
    """

    cross_axis: tuple[float, float, float] = (0.0, 0.0, 0.0)

    AXES: ClassVar[tuple[str, str, str]] = ("p", "q", "r")

    def _kind_faults(self) -> Iterator[str]:
        yield from super()._kind_faults()
        c = self.cross_axis
        if len(c) != 3 or not all(math.isfinite(x) and abs(x) < 1.0 for x in c):
            yield f"cross_axis: three shares between -1 and 1 (of x, y, z) are needed, got {c}"
        elif c[self.axis] != 0.0:
            yield f"cross_axis: the share of its own axis must be 0 (that is its scale), got {c[self.axis]:g}"

    @property
    def axis(self) -> int:
        """The axis that it measures along: 0, 1 or 2; wing stations measure along z."""
        return self.AXES.index(self.channel) if self.channel in self.AXES else 2

    @property
    def needs(self) -> tuple[str, ...]:
        """The channels of the true record that it is computed from."""
        others = (name for name, c in zip(self.AXES, self.cross_axis, strict=True) if c)
        return tuple(dict.fromkeys([*super().needs, *others]))

    def feel(self, x: Mapping[str, FloatArray]) -> FloatArray:
        """Return what it feels along its leaning axis (n,)."""
        out = super().feel(x)
        for name, c in zip(self.AXES, self.cross_axis, strict=True):
            if c:
                out = out + c * self.along(name, x)
        return np.asarray(out)

    def along(self, name: str, x: Mapping[str, FloatArray]) -> FloatArray:
        """Return the quantity along another axis (n,), where the instrument sits."""
        return x[name]
