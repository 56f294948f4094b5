"""Pitot-static airspeed, with the error of the static port's position."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from testbench.core.errors import RecordError
from testbench.core.record import FloatArray
from testbench.sensors.sensor import Sensor


@dataclass(frozen=True)
class Pitot(Sensor):
    """Reads V, or the dynamic pressure qbar, from total minus static pressure.

    The static port is off by (cp + cp_alpha alpha) qbar, so that the tube shows qbar (1 - cp - cp_alpha alpha) and the
    speed V sqrt(1 - cp - cp_alpha alpha). V is true airspeed: density is taken as known.

    Args:
        static_cp: cp at alpha = 0.
        static_cp_alpha: cp_alpha, per rad.
    """

    static_cp: float = 0.0
    static_cp_alpha: float = 0.0

    KIND: ClassVar[str] = "pitot"
    READS: ClassVar[str] = "V|qbar"
    PLACED: ClassVar[tuple[str, ...]] = ()

    def _kind_faults(self) -> Iterator[str]:
        yield from super()._kind_faults()
        if not (math.isfinite(self.static_cp) and abs(self.static_cp) < 1.0):
            yield f"static_cp: -1 < static_cp < 1 must hold, got {self.static_cp:g}"
        if not math.isfinite(self.static_cp_alpha):
            yield f"static_cp_alpha: a finite number is needed, got {self.static_cp_alpha:g}"

    @property
    def needs(self) -> tuple[str, ...]:
        """The channels of the true record that it is computed from."""
        return (self.channel, "alpha") if self.static_cp_alpha else (self.channel,)

    def feel(self, x: Mapping[str, FloatArray]) -> FloatArray:
        """Return the speed or pressure that the tube shows (n,).

        Raises:
            RecordError: the static pressure rises above the total one.
        """
        out = x[self.channel]
        if not (self.static_cp or self.static_cp_alpha):
            return out
        share = 1.0 - self.static_cp - (self.static_cp_alpha * x["alpha"] if self.static_cp_alpha else 0.0)
        if np.any(np.asarray(share) <= 0.0):
            raise RecordError(
                f"static_cp + static_cp_alpha alpha < 1 must hold all through a flight, got {1.0 - np.min(share):.3g}"
            )
        return np.asarray(out * (np.sqrt(share) if self.channel == "V" else share))
