"""Power and energy of a flight by hand: of a motor, and of a glider, which pays with height."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from testbench.core.constants import G0_M_S2
from testbench.questions.plan.resources import level_power_W, usable_J
from testbench.questions.plan.scenario import Tow

GLIDER = SimpleNamespace(energy=Tow(kind="tow", release_m=900.0, lowest_m=200.0))


def test_a_motor_pays_with_thrust_over_its_efficiency_and_a_glider_with_height():
    level = SimpleNamespace(condition=SimpleNamespace(V_m_s=20.0, gamma_rad=-0.05), state={"thrust": 3.0})
    motor = SimpleNamespace(energy=SimpleNamespace(efficiency_percent=50.0, avionics_W=7.0))
    assert level_power_W(motor, level, 2.0) == pytest.approx(3.0 * 20.0 / 0.5 + 7.0)
    assert level_power_W(GLIDER, level, 2.0) == pytest.approx(2.0 * G0_M_S2 * 20.0 * math.sin(0.05))
    level.condition.gamma_rad, level.state["thrust"] = 0.05, -1.0
    assert (level_power_W(GLIDER, level, 2.0), level_power_W(motor, level, 2.0)) == (0.0, 7.0)


def test_a_glider_may_use_the_height_from_its_release_to_the_lowest():
    assert usable_J(GLIDER, 2.0) == pytest.approx(2.0 * G0_M_S2 * 700.0)
