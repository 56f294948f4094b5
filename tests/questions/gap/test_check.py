"""The data check before any aerodynamics: what kinematics find is set against what is believed of the sensors.

It finds an error where there is none with probability 0.01 (check.FALSE_ALARM); seeds are fixed.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
from gap_flights import CONDITION, ELEVATOR, believe, measure

from testbench.flight import load_aircraft
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.check import check_data
from testbench.sensors import load_suite


@pytest.fixture(scope="module")
def believed():
    return believe()


def test_errors_that_are_believed_already_are_no_news(believed):
    """The suite believes in biases of q and az and a lag of alpha, and kinematics find them; that is no news."""
    check = check_data(believed, measure(believed, 11))
    assert check.result is not None
    assert "q_bias" not in check.result.values  # 0.2 deg/s are believed, and were taken off first
    assert check.news == ()
    assert "agree" in check.sentences[0]


def test_a_late_vane_is_named_by_kinematics_alone(believed):
    late = [replace(s, delay_s=0.15) if s.channel == "alpha" else s for s in believed.suite.sensors]
    truth = replace(believed, suite=replace(believed.suite, sensors=tuple(late)))
    check = check_data(believed, measure(truth, 12))
    found = {e.name: (e.estimate, e.standard_error) for e, _ in check.news}
    assert set(found) & {"alpha_delay", "alpha_lag"}
    estimate, error = found.get("alpha_delay") or found["alpha_lag"]
    assert abs(estimate - 0.17) < 5.0 * error + 0.02  # the believed lag of 0.02 s is found together with the delay
    assert any("kinematics alone" in s and "vane" in s for s in check.sentences)
    assert check.says("alpha")
    assert not check.says("theta")


def test_channels_that_do_not_suffice_are_said_so(believed):
    records = [r.select(["V", "q", "de_cmd"]) for r in measure(believed, 13, inputs=(ELEVATOR,))]
    check = check_data(believed, records)
    assert check.result is None
    assert "could not be checked" in check.sentences[0]
    assert "needs the channels" in check.sentences[0]


@pytest.fixture(scope="module")
def uncalibrated():
    """The large suite: a boom ahead with a clock of its own, an inertial unit that drifts, GPS."""
    aircraft = load_aircraft("eolo", "flexible")
    return Believed(aircraft, load_suite("eolo_full"), CONDITION, aircraft.rate_hz)


@pytest.mark.slow
def test_what_believed_sensors_do_beyond_bias_and_lag_is_no_news(uncalibrated):
    """Kinematics alone call the vane on the boom a quarter too small, and the wind 2 m/s upwards."""
    check = check_data(uncalibrated, measure(uncalibrated, 3, inputs=(ELEVATOR,)))
    assert check.result is not None
    assert check.result.errors
    assert check.news == ()


@pytest.mark.slow
def test_what_goes_far_beyond_it_is_news(uncalibrated):
    loud = [replace(s, scale=1.5 * s.scale) if s.channel == "V" else s for s in uncalibrated.suite.sensors]
    truth = replace(uncalibrated, suite=replace(uncalibrated.suite, sensors=tuple(loud)))
    check = check_data(uncalibrated, measure(truth, 3, inputs=(ELEVATOR,)))
    assert any(e.name.startswith("V_") for e, _ in check.news)
