"""Alpha and beta vanes on a boom: local flow, upwash, and the boom's own motion."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from testbench.core.record import FloatArray
from testbench.sensors.sensor import Sensor

_NEEDS = ("u", "v", "w", "p", "q", "r")


@dataclass(frozen=True)
class FlowVane(Sensor):
    """Reads the flow angle where it sits, times the upwash (sidewash) factor.

    At r = ``position_m`` the airframe moves with omega x r beside the centre of gravity, so that the vane's flow is
    (u, v, w) + omega x r and it shows k (alpha + arctan(w_P / u_P) - arctan(w / u)), which for small angles is
    k (alpha - x q / V + y p / V); beta likewise with v, k (beta + x r / V - z p / V). The position error of the
    fuselage's flow field is ``bias``, the vane's and boom's lag ``lag_s``. The boom is rigid.

    Args:
        upwash: k, d(angle at the vane) / d(angle far ahead); 1 for a vane far ahead of everything.
    """

    upwash: float = 1.0

    KIND: ClassVar[str] = "flow_vane"
    READS: ClassVar[str] = "alpha|beta"
    PLACED: ClassVar[tuple[str, ...]] = ("alpha", "beta")

    def _kind_faults(self) -> Iterator[str]:
        yield from super()._kind_faults()
        if not (math.isfinite(self.upwash) and 0.0 < self.upwash < 5.0):
            yield f"upwash: 0 < upwash < 5 must hold, got {self.upwash:g}"

    @property
    def needs(self) -> tuple[str, ...]:
        """The channels of the true record that it is computed from."""
        return (self.channel, *_NEEDS) if any(self.position_m) else (self.channel,)

    def feel(self, x: Mapping[str, FloatArray]) -> FloatArray:
        """Return the angle that the vane shows (n,)."""
        angle = x[self.channel]
        if any(self.position_m):
            u, v, w, p, q, r = (x[name] for name in _NEEDS)
            ahead, right, down = self.position_m
            forward = u + q * down - r * right
            if self.channel == "alpha":
                angle = angle + np.arctan2(w + p * right - q * ahead, forward) - np.arctan2(w, u)
            else:
                angle = angle + np.arctan2(v + r * ahead - p * down, forward) - np.arctan2(v, u)
        return np.asarray(self.upwash * angle)
