"""The kinds of hidden truth that grow with time, as their draw knows them: names that are right, how sizes are drawn.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Mapping

from testbench.questions.gap.sealed.kinds import Kind, between, kind

_GYROS = {"p": "roll", "q": "pitch", "r": "yaw"}
OVER_TIME_KINDS: Mapping[str, Kind] = {
    "battery that empties": kind("library", "thrust_fade", between(per_min=(0.006, 0.02)), "per_min"),
    "fuel that burns": kind("library", "fuel_burn", between(per_min=(0.003, 0.01)), "per_min"),
    **{
        f"{word} gyro that drifts": kind(
            "library", f"{c}_drift", between(per_s_=(0.0006, 0.003)), "per_s -> drift_per_s"
        )
        for c, word in _GYROS.items()
    },
    "airspeed that drifts": kind("library", "V_drift", between(per_s_=(0.03, 0.12)), "per_s -> drift_per_s"),
    "tank ahead that empties": kind(
        "library", "tank_burn fuel_burn", between(ratio=(0.1, 0.25), ahead_chords_=(0.05, 0.3))
    ),
    "battery that droops": kind("other", "thrust_fade uneven_thrust_fade", between(lost=(0.2, 0.5))),
    "thirsty climb": kind("other", "fuel_burn uneven_fuel_burn", between(ratio=(0.1, 0.25))),
    **{
        f"{word} gyro that warms up": kind("other", f"{c}_drift", between(per_s_=(0.0008, 0.004)))
        for c, word in _GYROS.items()
    },
    "airspeed port that ices": kind("other", "V_drift", between(per_s_=(0.03, 0.12))),
}
