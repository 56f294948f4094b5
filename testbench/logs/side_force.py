"""The lateral specific force held against what turns and banks the path: its unit and its sign.

Level flight shows one g along z, which tells the unit of az by itself. Nothing tells that of ay but the motion:
ay = V (betadot + r cos(alpha) - p sin(alpha)) - g sin(phi) cos(theta), for small sideslip at constant airspeed.
"""

from __future__ import annotations

import numpy as np

from testbench.core.constants import G0_M_S2
from testbench.logs.intervals import about, means, times_of_all
from testbench.logs.question import Criteria, Question, Signals

_STEP_S = 0.5
_NAMES = ("ay", "beta", "alpha", "p", "r", "phi", "theta", "V")


def against_motion(signals: Signals, c: Criteria) -> list[Question]:
    """Question a lateral specific force in g, and one that counts to the left."""
    at = times_of_all(signals, _NAMES, _STEP_S)
    if at is None:
        return []
    mean = {name: means(signals[name], at[:-1], at[1:]) for name in _NAMES}
    slipping = np.diff(about(signals["beta"], at, 0.1)) / _STEP_S
    turning = slipping + mean["r"] * np.cos(mean["alpha"]) - mean["p"] * np.sin(mean["alpha"])
    expected = mean["V"] * turning - G0_M_S2 * np.sin(mean["phi"]) * np.cos(mean["theta"])
    if np.std(expected) < c.felt_m_s2 or not np.std(mean["ay"]) > 0.0:
        return []
    r = float(np.corrcoef(mean["ay"], expected)[0, 1])
    if r**2 < c.follows:
        return []
    times = float(np.std(mean["ay"]) / np.std(expected))
    got = f"{'minus ' if r < 0.0 else ''}{times:.2g} times what sideslip, rates and bank make of it"
    if 1.0 / c.unit_match < times * G0_M_S2 < c.unit_match:
        return [Question("ay", got, "is it in g" + (", and does it count to the left" if r < 0.0 else ""), "g")]
    if r < 0.0:
        return [Question("ay", got, "does it count to the left (scale = -1.0)")]
    return []
