"""Surface position: a potentiometer or encoder on a control surface's hinge or linkage."""

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
class SurfacePosition(Sensor):
    """Reads de, da or dr (or thr, the position of a throttle lever), with the play of its linkage.

    Play is a band of width w within which the surface moves and the pick-off does not:
    y_k = min(max(y_(k-1), x_k - w/2), x_k + w/2), from y_0 = x_0.

    Args:
        play: w, in the channel's unit; in files ``play_deg``.
    """

    play: float = 0.0

    KIND: ClassVar[str] = "surface_position"
    READS: ClassVar[str] = "de|da|dr|thr"
    PLACED: ClassVar[tuple[str, ...]] = ()
    IN_FILES: ClassVar[Mapping[str, tuple[str, float]]] = {"play_deg": ("play", DEG_RAD)}

    def _kind_faults(self) -> Iterator[str]:
        yield from super()._kind_faults()
        if not (math.isfinite(self.play) and self.play >= 0.0):
            yield f"play_deg: 0 <= play_deg must hold, got {self.play / DEG_RAD:g}"
        if self.play and self.channel == "thr":
            yield "play_deg: a throttle has no play in degrees; leave it out"

    def feel(self, x: Mapping[str, FloatArray]) -> FloatArray:
        """Return the position of the pick-off (n,)."""
        position = x[self.channel]
        if not self.play:
            return position
        half, y = 0.5 * self.play, float(position[0])
        out = []
        for value in position.tolist():
            y = min(max(y, value - half), value + half)
            out.append(y)
        return np.array(out)

    def weights(self, trim: Mapping[str, float]) -> dict[str, float]:
        """Return 1 for its own channel: play is no matter of small motion."""
        return {self.channel: 1.0}
