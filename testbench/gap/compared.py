"""Which channels of a believed suite are compared with measurements, and which are left out, and why."""

from __future__ import annotations

import re

from testbench.sensors import SensorSuite

# The believed flight begins northwards in still air, and no state of its linear predictions is a heading or a place.
_OF_PLACE = ("psi", "north", "east", "v_north", "v_east")
_OF_STATION = re.compile(r"(az|strain)_wing_\d+")
DRIFT = 0.2  # a bias that wanders by more than this share of the noise within a manoeuvre
DRIFT_OVER_S = 20.0  # of such a length is no noise that a residual is white beside


def left_out(suite: SensorSuite) -> dict[str, str]:
    """Return channel of a suite that is not compared -> why, in words; commands and deflections aside."""
    out = {}
    for s in suite.sensors:
        drift, noise = s.drift_over(DRIFT_OVER_S), suite.noise_std[s.channel]
        if s.channel in _OF_PLACE:
            out[s.channel] = f"{s.channel} depends on heading or wind, which are not known"
        elif _OF_STATION.fullmatch(s.channel):
            out[s.channel] = f"effects that bend the wing do not say how {s.channel} moves"
        elif drift > DRIFT * noise:
            times = f"{drift / noise:.2g} times its noise" if noise else "more than its noise, which is none,"
            out[s.channel] = f"the bias of {s.channel} wanders by {times} in {DRIFT_OVER_S:g} s"
    return out
