"""How different flights held out are: figures that follow from the definition."""

from __future__ import annotations

from dataclasses import replace

import pytest
from gap.gap_flights import CONDITION, believe

from testbench.core.record import FlightRecord
from testbench.core.scenario.base import Manoeuvre
from testbench.core.scenario.inputs import Doublet, StandardMultistep, Sweep
from testbench.flight import FlightCondition
from testbench.questions.gap.evidence.check import differences
from testbench.questions.gap.plan import as_record
from testbench.questions.gap.starts import Start, marked


def commanded(spec) -> FlightRecord:
    manoeuvre = Manoeuvre(name="m", use="identification", duration_s=10.0, input=(spec,))
    return as_record(believe(), manoeuvre)


STEP = StandardMultistep(signal="3211", control="de", amplitude_deg=2.0, step_s=0.4)


def test_the_same_command_later_is_no_other_flight_and_another_control_is_all_different():
    later = commanded(STEP.model_copy(update={"start_s": 1.0}))
    throttle = commanded(Doublet(signal="doublet", control="thr", amplitude_percent=15.0, period_s=4.0))
    again, other = differences(believe(), {"step": commanded(STEP)}, {"later": later, "throttle": throttle})
    assert again.difference == pytest.approx(0.0, abs=0.02)
    assert "is a weak test" in again.sentence
    assert other.difference == pytest.approx(1.0)
    assert other.sentence.startswith("held-out throttle differs by 100 % from step")
    assert "is a weak test" not in other.sentence


@pytest.mark.parametrize("size", [0.5, 0.6, 2.0])
def test_amplitude_counts(size):
    scaled = commanded(STEP.model_copy(update={"amplitude_deg": 2.0 * size}))
    (found,) = differences(believe(), {"step": commanded(STEP)}, {"scaled": scaled})
    assert found.difference == pytest.approx(1.0 - 2.0 * size / (1.0 + size**2), abs=1e-6)


def test_speed_and_spectrum_count_and_the_nearest_flight_is_taken():
    sweep = commanded(Sweep(signal="sweep", control="de", amplitude_deg=2.0, f_start_hz=2.0, f_end_hz=8.0, sweep_s=8.0))
    fast = marked(commanded(STEP), Start(FlightCondition(20.0, CONDITION.h_m)))
    swept, faster = differences(believe(), {"step": commanded(STEP)}, {"sweep": sweep, "fast": fast})
    assert swept.difference > 0.3
    assert faster.difference == pytest.approx(1.0 - (16.0 / 20.0) ** 2, abs=1e-9)
    used = {"step": commanded(STEP), "sweep": replace(sweep)}
    assert differences(believe(), used, {"again": sweep})[0].nearest == "sweep"
