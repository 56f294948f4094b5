"""Hidden truths of gap scenarios: each flies, and changes what it says and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from testbench.core.scenario.base import Manoeuvre
from testbench.flight import FlightCondition
from testbench.questions.gap.hidden import kinds as h
from testbench.sensors import load_suite

CONDITION = FlightCondition(16.0, 547.0)
TRUTHS = (
    h.FlexibleWings(kind="flexible_wings"),
    h.SlowServo(kind="slow_servo", corner_rad_s=12.0),
    h.HighThrust(kind="high_thrust", offset_m=0.05),
    h.VaneGain(kind="vane_gain", gain=1.1),
    h.LateCommand(kind="late_command", delay_s=0.05),
    h.SlewedCommand(kind="slewed_command", rate_rad_s=0.2),
    h.CommandGain(kind="command_gain", gain=0.7),
    h.SluggishMotor(kind="sluggish_motor", time_s=0.5),
    h.ShiftedWing(kind="shifted_wing", ahead_m=0.002),
    h.Ballast(kind="ballast", mass_kg=0.5),
    h.Roughness(kind="roughness", CD0=0.02),
    h.RateFeedback(kind="rate_feedback", gain_s=0.1),
    h.SensorError(kind="sensor_error", channel="q", gain=1.1),
    h.Nothing(kind="nothing"),
)


def flown(truth):
    manoeuvre = Manoeuvre.model_validate(
        {
            "name": "both",
            "use": "identification",
            "duration_s": 6.0,
            "input": (
                {"signal": "doublet", "control": "de", "amplitude_deg": 2.0, "period_s": 1.0},
                {"signal": "doublet", "control": "thr", "amplitude_percent": 15.0, "period_s": 2.0, "start_s": 2.0},
            ),
        }
    )
    suite = load_suite("eolo_gap")
    return h.measure_hidden("eolo", "rigid", truth, suite, CONDITION, [manoeuvre], 3, 200.0)["both"]


@pytest.fixture(scope="module")
def plain():
    return flown(h.Nothing(kind="nothing"))


@pytest.mark.parametrize("truth", TRUTHS, ids=lambda t: t.kind)
def test_a_truth_flies_and_shows_in_the_readings_but_not_in_the_commands(truth, plain):
    record = flown(truth)
    assert record.kind == "measured"
    assert set(record.provenance) == {"manoeuvre"}, "what was hidden is not told"
    for name in ("de_cmd", "thr_cmd"):
        assert record[name] - record[name][0] == pytest.approx(
            plain[name] - plain[name][0], abs=1e-8
        )  # rounding of degrees
    same = {c for c in ("V", "alpha", "q", "theta", "az") if np.array_equal(record[c], plain[c])}
    if truth.kind == "nothing":
        assert len(same) == 5
    elif truth.kind == "vane_gain":
        assert same == {"V", "q", "theta", "az"}
    elif truth.kind == "sensor_error":
        assert same == {"V", "alpha", "theta", "az"}
    else:
        assert len(same) <= 3
