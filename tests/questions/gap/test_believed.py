"""What is believed: commands that its trim refuses, and hypotheses that may pass where a control stops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from studies.blind.flights import fly_truth
from studies.blind.run import believe
from studies.blind.truth import Truth

from testbench.core.errors import LimitError
from testbench.core.record import FlightAborted
from testbench.questions.gap.name import Sought, name_effect


@pytest.fixture(scope="module")
def throttled():
    """A record whose throttle moves to a few per cent of idle."""
    return fly_truth("eolo", Truth(), "rich", 3)["throttle"]


def test_a_hypothesis_of_little_drag_flies_with_the_throttle_at_its_stop(throttled):
    believed = believe("eolo")
    believed.check_commands(throttled)
    slippery = believed.with_nuisances({"CD": 0.4})
    with pytest.raises(LimitError, match="0 <= thr <= 100 %"):
        slippery.check_commands(throttled)
    left = [float(np.sum(believed.with_nuisances({"CD": f}).residuals(throttled) ** 2)) for f in (1.0, 0.7, 0.4)]
    assert left[0] < left[1] < left[2] < np.inf  # the way back is downhill


def test_a_hypothesis_that_leaves_the_limits_by_a_little_flies_on(throttled):
    """A stall that comes too early flies through its limit of alpha on the way to the right one."""
    believed = believe("eolo")
    V = believed.flown(throttled, ("V",)).columns(("V",))
    top, least = float(V.max()), float(V.min())

    def within(low: float, high: float):
        return replace(believed, aircraft=replace(believed.aircraft, limits={"V": (low, high)}))

    crossed = within(least - 1.0, top - 0.1 * (top - least)).flown(throttled, ("V",))
    assert crossed.columns(("V",)).tolist() == V.tolist()
    with pytest.raises(FlightAborted, match="V <="):
        within(least, top - 0.5 * (top - least)).flown(throttled, ("V",))


def test_commands_that_the_believed_aircraft_cannot_take_are_refused(throttled):
    data = throttled.data.copy()
    column = throttled.channels.index("thr_cmd")
    data[:, column] = data[0, column] + 5.0 * (data[:, column] - data[0, column])
    with pytest.raises(LimitError, match="reduce the amplitude"):
        name_effect(believe("eolo"), [replace(throttled, data=data)], Sought({}))
