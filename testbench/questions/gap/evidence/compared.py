"""Which channels of a believed suite are compared with measurements, and which are left out, and why."""

from __future__ import annotations

import re

from testbench.sensors import SensorSuite

# The believed flight begins northwards in still air, and its linear predictions hold neither heading nor place.
_OF_PLACE = ("psi", "north", "east", "v_north", "v_east")
_OF_STATION = re.compile(r"(az|strain)_wing_\d+")
DRIFT = 0.2  # a bias that wanders by more than this share of the noise within DRIFT_OVER_S colours the residual
DRIFT_OVER_S = 20.0  # length of a manoeuvre


def left_out(suite: SensorSuite) -> dict[str, str]:
    """Return channel of a suite that is not compared -> why, in words; commands and deflections aside."""
    out = {}
    for s in suite.sensors:
        if s.channel in _OF_PLACE:
            out[s.channel] = "heading and wind are not known"
        elif _OF_STATION.fullmatch(s.channel):
            out[s.channel] = "effects that bend the wing do not say how it moves there"
        elif s.drift_over(DRIFT_OVER_S) > DRIFT * suite.noise_std[s.channel]:
            out[s.channel] = f"the bias wanders by more than {DRIFT:g} times the noise within {DRIFT_OVER_S:g} s"
    return out


def not_compared(suite: SensorSuite) -> list[str]:
    """Return what of a suite is not compared, and why, a sentence for each reason."""
    by_reason: dict[str, list[str]] = {}
    for name, why in left_out(suite).items():
        by_reason.setdefault(why, []).append(name)
    return [f"not compared: {', '.join(names)} ({why})" for why, names in by_reason.items()]
