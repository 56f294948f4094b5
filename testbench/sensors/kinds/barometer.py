"""Barometer: altitude and climb rate from static pressure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from testbench.core.constants import G0_M_S2
from testbench.core.record import FloatArray
from testbench.sensors.sensor import Sensor


@dataclass(frozen=True)
class Barometer(Sensor):
    """Reads h, or hdot of a variometer, through a static port that is not quite free of the flow.

    A port whose pressure is off by cp qbar shows h - cp qbar / (rho g) = h - cp V^2 / (2 g). The weather is the
    ``bias`` and its drift; tubing is the ``lag_s``.

    Args:
        static_cp: cp, pressure coefficient at the static port; for h only.
    """

    static_cp: float = 0.0

    KIND: ClassVar[str] = "barometer"
    READS: ClassVar[str] = "h|hdot"
    PLACED: ClassVar[tuple[str, ...]] = ()

    def _kind_faults(self) -> Iterator[str]:
        yield from super()._kind_faults()
        if not (math.isfinite(self.static_cp) and abs(self.static_cp) < 1.0):
            yield f"static_cp: -1 < static_cp < 1 must hold, got {self.static_cp:g}"
        if self.static_cp and self.channel != "h":
            yield f"static_cp: it is modelled for h only, got it for '{self.channel}'; leave it out"

    @property
    def needs(self) -> tuple[str, ...]:
        """The channels of the true record that it is computed from."""
        return (self.channel, "V") if self.static_cp else (self.channel,)

    def feel(self, x: Mapping[str, FloatArray]) -> FloatArray:
        """Return the altitude that belongs to the pressure at the port (n,)."""
        out = x[self.channel]
        return np.asarray(out - self.static_cp * x["V"] ** 2 / (2.0 * G0_M_S2)) if self.static_cp else out
