"""Where a flight begins: at its trim, or so far from it as it is told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from testbench.core.errors import LimitError
from testbench.core.record import FloatArray
from testbench.flight.condition import Start, TrimmedFlight
from testbench.flight.executive import Executive, velocity_at
from testbench.flight.trim import horizon_rates, place_at_trim, steady_wind


@dataclass(frozen=True, eq=False)
class Beginning:
    """Where a flight begins."""

    trimmed: TrimmedFlight  # its trim
    start: Start | None  # how far from it; None for the trim itself
    controls: Mapping[str, float]  # control -> absolute command, SI

    @classmethod
    def at(cls, trimmed: TrimmedFlight) -> Beginning:
        """Return the beginning at a trim."""
        return cls(trimmed, None, trimmed.controls)

    @property
    def key(self) -> object:
        """What tells it from others, as long as its trim lives."""
        return id(self.trimmed), self.start, () if self.start is None else tuple(self.controls.items())

    @cached_property
    def placed(self) -> Placed:
        """Height, attitude, airspeed and rates.

        Raises:
            LimitError: it has no airspeed.
        """
        at, c, off = self.trimmed, self.trimmed.condition, self.start or Start()
        V, h, theta, phi = c.V_m_s + off.V_m_s, c.h_m + off.h_m, at.theta + off.theta, at.phi + off.phi
        if not V > 0.0:
            raise LimitError(f"a flight must start with an airspeed above 0 m/s, got {V:g} m/s")
        uvw = velocity_at(V, at.alpha + off.alpha, at.beta + off.beta)
        pqr = horizon_rates(h, theta, phi, uvw, steady_wind(at))
        return Placed(h, theta, phi, uvw, pqr if self.start is None else pqr + np.array([off.p, off.q, off.r]))

    def put(self, fdm: Executive) -> None:
        """Put a fresh executive there, steady wind included, at rest in time.

        Raises:
            LimitError: there is no airspeed.
        """
        if self.start is None:
            place_at_trim(fdm, self.trimmed)
            return
        fdm.set_wind(steady_wind(self.trimmed))
        fdm.command(dict(self.controls))
        at = self.placed
        fdm.place(at.h_m, at.theta, at.phi, at.uvw_m_s, at.pqr)
        fdm.evaluate(to_rest=True)


@dataclass(frozen=True, eq=False)
class Placed:
    """Height in m, attitude in rad, airspeed (3,) in body axes in m/s, rates (3,) in rad/s."""

    h_m: float
    theta: float
    phi: float
    uvw_m_s: FloatArray
    pqr: FloatArray
