"""Controls held against the motion: which way a surface counts whose sign only the writer's custom tells.

In the first moment an aircraft turns as its surface pushes it: trailing edge down pitches down, right wing down rolls
right, trailing edge left yaws left. The angular acceleration is fitted by the rate, the flow angle and the control.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from testbench.core.channels import SURFACES
from testbench.core.constants import DEG_RAD
from testbench.logs.intervals import about, means, times_of_all
from testbench.logs.question import Criteria, Question, Signals

_STEP_S = 0.1
_MOVES = 0.5 * DEG_RAD  # of a control that tells something
_CERTAIN = 8.0  # standard deviations that its effect must be off zero
_ANSWERS = {"de": ("q", "alpha", -1.0, "nose up"), "da": ("p", "beta", 1.0, "left"), "dr": ("r", "beta", -1.0, "right")}
"""Surface -> the rate that answers, the flow angle that acts, the sign of the answer, what the other sign is called."""


def against_answer(signals: Signals, doubtful: Collection[str], c: Criteria) -> list[Question]:
    """Question the ``doubtful`` controls to which the aircraft answers the other way.

    Args:
        signals: the channels.
        doubtful: surfaces and commands whose sign the file does not state.
        c: the criteria.
    """
    out = []
    for name in doubtful:
        surface = name.removesuffix("_cmd")
        if surface not in SURFACES or np.ptp(signals[name][1]) < _MOVES:
            continue
        rate, flow, sign, way = _ANSWERS[surface]
        names = (name, rate, *((flow,) if flow in signals else ()))
        at = times_of_all(signals, names, _STEP_S)
        if at is None or np.ptp(signals[rate][1]) < c.moving_rad_s:
            continue
        turned = np.diff(about(signals[rate], at, 0.2 * _STEP_S)) / _STEP_S
        held = np.column_stack([*(means(signals[other], at[:-1], at[1:]) for other in names), np.ones(at.size - 1)])
        found, *_, scale = np.linalg.lstsq(held, turned, rcond=None)
        if scale[-1] < 1e-9 * scale[0]:
            continue
        spread = float(np.std(turned - held @ found))
        off = spread * float(np.sqrt(np.linalg.inv(held.T @ held)[0, 0]))
        if -sign * found[0] > _CERTAIN * off:
            got = f"{found[0]:.3g} {rate}dot/{name} in 1/s2: positive {name} turns the aircraft {way}"
            means_ = f"does full command move it the other way (--throw {surface}=-25 for 25 deg)"
            out.append(Question(name, got, means_))
    return out
