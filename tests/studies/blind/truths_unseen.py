"""Hidden truths of the blind test that the library does not hold, near and far.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from studies.blind import forms, servos
from studies.blind.flights import Plan
from studies.blind.kinds import Kind, between, kind, link

UNSEEN: Mapping[str, Kind] = {
    "sticky vane": kind("unseen", "", between(width_rad=(0.015, 0.04)), forms.sticky_vane, near=True),
    "coarse command": kind(
        "unseen", "", between(step_rad=(0.015, 0.03)), link(lambda s: servos.coarse(s["step_rad"])), near=True
    ),
    "lift of the thrust": kind(
        "unseen",
        "",
        between(lift=(0.3, 0.8)),
        lambda s, a: Plan(
            changes=(forms.coefficient("LIFT", forms.number(s["lift"]), forms.prop("fcs/throttle-cmd-norm")),)
        ),
        near=True,
    ),
    "motor with a bent curve": kind(
        "unseen", "", between(bend_=(0.3, 0.6)), lambda s, a: Plan(throttle=servos.bent(s["bend"])), near=True
    ),
    "elevator that fades": kind("unseen", "", between(loss=(0.05, 0.15)), forms.fading_elevator, near=True),
    "damping curved in alpha": kind("unseen", "", between(k_=(0.5, 1.2)), forms.curved_damping, near=True),
    "gyro that saturates on one side": kind(
        "unseen",
        "",
        between(most_rad_s=(0.05, 0.09)),
        lambda s, a: Plan(spoil=lambda n, y, t: np.minimum(y, s["most_rad_s"]) if n == "q" else y),
        near=True,
    ),
    "stuck link": kind("unseen", "", between(length_s=(0.3, 0.8)), link(lambda s: servos.stuck(0.9, s["length_s"]))),
    "vibration": kind("unseen", "", between(amplitude=(0.3, 1.0), f_hz=(6.0, 20.0)), forms.vibration),
    "frozen attitude": kind("unseen", "", between(length_s=(0.5, 1.5)), forms.freezing),
    "wandering attitude": kind("unseen", "", between(amplitude_rad=(0.01, 0.04)), forms.wandering),
}
