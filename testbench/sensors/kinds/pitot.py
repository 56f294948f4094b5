"""Pitot-static airspeed, with the error of the static port's position and the motion of the tube's own place."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from testbench.core.errors import RecordError
from testbench.core.record import FloatArray
from testbench.sensors.sensor import UNSAID, Sensor

_MOTION = ("u", "v", "w", "p", "q", "r")


@dataclass(frozen=True)
class Pitot(Sensor):
    """Reads V, or the dynamic pressure qbar, from total minus static pressure.

    The static port is off by c qbar, c = cp + cp_alpha alpha + cp_beta2 beta^2, so that the tube shows qbar (1 - c) and
    the speed V sqrt(1 - c). V is true airspeed: density is taken as known.

    At ``position_m`` the airframe moves with omega x r beside the centre of gravity. The tube there shows the speed
    V + |(u, v, w) + omega x r| - |(u, v, w)|, which for small angles is V - r y + q z: less on the right wing tip in a
    turn to the right, more far below in a pull-up. A tube does not mind where the flow comes from, within some 15 deg.

    Args:
        static_cp: cp at alpha = beta = 0.
        static_cp_alpha: cp_alpha, per rad.
        static_cp_beta2: cp_beta2, per rad^2: ports on both sides are joined, so that the error is even in sideslip.
    """

    static_cp: float = 0.0
    static_cp_alpha: float = 0.0
    static_cp_beta2: float = field(default=0.0, metadata=UNSAID)

    KIND: ClassVar[str] = "pitot"
    READS: ClassVar[str] = "V|qbar"
    PLACED: ClassVar[tuple[str, ...]] = ("V", "qbar")

    def _kind_faults(self) -> Iterator[str]:
        yield from super()._kind_faults()
        if not (math.isfinite(self.static_cp) and abs(self.static_cp) < 1.0):
            yield f"static_cp: -1 < static_cp < 1 must hold, got {self.static_cp:g}"
        for key in ("static_cp_alpha", "static_cp_beta2"):
            if not math.isfinite(getattr(self, key)):
                yield f"{key}: a finite number is needed, got {getattr(self, key):g}"

    @property
    def needs(self) -> tuple[str, ...]:
        """The channels of the true record that it is computed from."""
        flow = (("alpha", self.static_cp_alpha), ("beta", self.static_cp_beta2))
        needs = (self.channel, *(name for name, c in flow if c))
        return (*needs, *_MOTION) if any(self.position_m) else needs

    def feel(self, x: Mapping[str, FloatArray]) -> FloatArray:
        """Return the speed or pressure that the tube shows (n,).

        Raises:
            RecordError: the static pressure rises above the total one.
        """
        out = x[self.channel]
        if any(self.position_m):
            out = self._at_its_place(out, x)
        if not (self.static_cp or self.static_cp_alpha or self.static_cp_beta2):
            return out
        share = 1.0 - self.static_cp - (self.static_cp_alpha * x["alpha"] if self.static_cp_alpha else 0.0)
        if self.static_cp_beta2:
            share = share - self.static_cp_beta2 * x["beta"] ** 2
        if np.any(np.asarray(share) <= 0.0):
            words = "static_cp + static_cp_alpha alpha" + (" + static_cp_beta2 beta^2" if self.static_cp_beta2 else "")
            raise RecordError(f"{words} < 1 must hold all through a flight, got {1.0 - np.min(share):.3g}")
        return np.asarray(out * (np.sqrt(share) if self.channel == "V" else share))

    def _at_its_place(self, out: FloatArray, x: Mapping[str, FloatArray]) -> FloatArray:
        """Return the speed or pressure (n,) where the tube is, of that at the centre of gravity."""
        u, v, w, p, q, r = (x[name] for name in _MOTION)
        ahead, right, down = self.position_m
        there = np.sqrt(
            (u + q * down - r * right) ** 2 + (v + r * ahead - p * down) ** 2 + (w + p * right - q * ahead) ** 2
        )
        here = np.sqrt(u * u + v * v + w * w)
        return np.asarray(out + there - here if self.channel == "V" else out * (there / here) ** 2)
