"""The doubt that a short period takes up what the airspeed did: raised where it bends the path, silent where not."""

import numpy as np
import pytest

from testbench.core.record import FlightRecord
from testbench.estimators.parametric.structures.written import speed_doubts

V0, DT = 16.0, 0.02


def flight(speed: float) -> FlightRecord:
    """alphadot = q + Z/V0 with Z of alpha at 2 rad/s, and of a slow airspeed of that amplitude, m/s."""
    t = DT * np.arange(500)
    V, alpha = speed * np.sin(0.5 * t), 0.03 * np.sin(2.0 * t)
    q = np.gradient(alpha, DT) + 5.0 * alpha + 2.0 * 9.81 * V / V0**2
    return FlightRecord(t, ("V", "alpha", "q"), np.column_stack([V, alpha, q]), "measured")


@pytest.mark.parametrize(("speed", "said"), [(1.5, True), (0.05, False), (0.0, False)])
def test_speed_is_doubted_where_it_bends_the_path(speed, said):
    assert [a.code for a in speed_doubts([flight(speed)], V0)] == ["speed_left_out"] * said


def test_without_airspeed_in_the_record_nothing_is_said():
    record = flight(1.5)
    assert speed_doubts([record.select(("alpha", "q"))], V0) == []
