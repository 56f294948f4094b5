"""What an input may do: deflection, rate, load factor, alpha, speed, height and bank; predicted linearly or flown.

The linear prediction scales an input to the largest admissible amplitude at once. The flight in the simulator that
follows decides.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import NamedTuple

import numpy as np

from testbench.core.channels import channel
from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.errors import LimitError
from testbench.core.record import FlightRecord


@dataclass(frozen=True)
class Limits:
    """The envelope of a manoeuvre; None sets no limit. Changes count from trim.

    Attributes:
        deflection: control -> largest deflection either side, rad (1 for the throttle); trim included.
        rate: control -> largest rate, rad/s.
        load_factor: lowest and highest -az / g.
        alpha: lowest and highest angle of attack, rad.
        beta: largest sideslip either side, rad.
        speed_change_m_s: largest change of airspeed either side.
        height_change_m: largest change of height either side.
        pitch_change: largest change of pitch angle either side, rad.
        bank: largest bank either side, rad.
        V_max_m_s: airspeed that is never exceeded, e.g. the onset of flutter less a margin.
        V_min_m_s: airspeed that is always kept, e.g. 1.2 times the stall speed.
        throw: control -> lowest and highest value that the aircraft allows, rad.
    """

    deflection: dict[str, float]
    rate: dict[str, float]
    load_factor: tuple[float, float] | None = None
    alpha: tuple[float, float] | None = None
    beta: float | None = None
    speed_change_m_s: float | None = None
    height_change_m: float | None = None
    pitch_change: float | None = None
    bank: float | None = None
    V_max_m_s: float | None = None
    V_min_m_s: float | None = None
    throw: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def control_band(self, control: str) -> tuple[float, float]:
        """Return the lowest and highest value of a control that the limits and its own stops allow."""
        most = self.deflection[control]
        low, high = self.throw.get(control, (-most, most))
        return (0.0 if control == "thr" else max(low, -most)), min(high, most)

    def bands(self, trim: dict[str, float]) -> dict[str, tuple[float, float]]:
        """Return channel -> (lowest, highest) absolute value, from the trimmed values of V, h, theta and alpha.

        Raises:
            LimitError: trim itself lies outside a limit.
        """
        out: dict[str, tuple[float, float]] = {}
        if self.load_factor:
            out["az"] = (-G0_M_S2 * self.load_factor[1], -G0_M_S2 * self.load_factor[0])
        if self.alpha:
            out["alpha"] = self.alpha
        for name, half in (("beta", self.beta), ("phi", self.bank)):
            if half is not None:
                out[name] = (-half, half)
        for name, half in (
            ("V", self.speed_change_m_s),
            ("h", self.height_change_m),
            ("theta", self.pitch_change),
        ):
            if half is not None:
                out[name] = (trim[name] - half, trim[name] + half)
        if self.V_max_m_s is not None:
            low, high = out.get("V", (0.0, np.inf))
            out["V"] = (low, min(high, self.V_max_m_s))
        if self.V_min_m_s is not None:
            low, high = out.get("V", (0.0, np.inf))
            out["V"] = (max(low, self.V_min_m_s), high)
        for name, (low, high) in out.items():
            if name in trim and not low < trim[name] < high:
                unit = channel(name).unit
                raise LimitError(
                    f"trim must lie inside the limits on {name}, {low:.4g} to {high:.4g} {unit}, got "
                    f"{trim[name]:.4g} {unit}; widen the limit or choose another condition"
                )
        return out

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, float) and not value > 0.0:
                raise LimitError(f"{item.name} > 0 must hold, got {value:g}")
            if isinstance(value, tuple) and not value[0] < value[1]:
                raise LimitError(f"{item.name}: low < high must hold, got {value[0]:g} and {value[1]:g}")


class Breach(NamedTuple):
    """The first moment at which a limit is broken."""

    channel: str
    t_s: float
    value: float
    limit: float

    @property
    def sentence(self) -> str:
        """The breach in words."""
        unit = channel(self.channel).unit
        if unit == "rad":
            return (
                f"{self.channel} passes {self.limit / DEG_RAD:.4g} deg at t = {self.t_s:.2f} s "
                f"(extreme {self.value / DEG_RAD:.4g} deg)"
            )
        return (
            f"{self.channel} passes {self.limit:.4g} {unit} at t = {self.t_s:.2f} s (extreme {self.value:.4g} {unit})"
        )


def breaches(record: FlightRecord, bands: dict[str, tuple[float, float]]) -> list[Breach]:
    """Return every limit that a flown record breaks, each with its first moment and its extreme value.

    Raises:
        ChannelError: the record lacks a limited channel.
    """
    out = []
    for name, (low, high) in bands.items():
        x = record[name]
        for limit, over in ((low, x < low), (high, x > high)):
            if over.any():
                extreme = float(x.min() if limit == low else x.max())
                out.append(Breach(name, float(record.t_s[np.argmax(over)]), extreme, limit))
    return sorted(out, key=lambda b: b.t_s)
