"""The instruments are compared by kinematics, beyond the errors that are believed of them."""

from __future__ import annotations

from dataclasses import replace

import pytest
from gap_flights import CONDITION, ELEVATOR, believe, measure

from testbench.flight import load_aircraft
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.check import check_instruments
from testbench.questions.identify.instruments import agreement_in_words
from testbench.sensors import load_suite


@pytest.fixture(scope="module")
def believed():
    return believe()


def changed(believed, channel, **errors):
    sensors = [replace(s, **errors) if s.channel == channel else s for s in believed.suite.sensors]
    return replace(believed, suite=replace(believed.suite, sensors=tuple(sensors)))


def test_errors_that_are_believed_already_are_no_news(believed):
    """The suite believes in biases of q and az and a lag of alpha; wrong once in eight, as p_agree says."""
    found = check_instruments(believed.suite, measure(believed, 11))
    assert {"q", "az", "alpha", "theta"} <= set(found.instruments)
    assert found.p_agree > 0.5


def test_a_large_believed_error_is_taken_out_before_instruments_are_compared(believed):
    """A gyro at 0.8 of itself contradicts a suite that does not know it, and agrees with one that does."""
    known = changed(believed, "q", scale=0.8)
    records = measure(known, 11)
    assert check_instruments(known.suite, records).p_agree > 0.5
    assert check_instruments(believed.suite, records).fault.channel == "q"


@pytest.mark.parametrize("channel", ["q", "theta"])
def test_a_late_instrument_is_named_by_kinematics_alone(believed, channel):
    found = check_instruments(believed.suite, measure(changed(believed, channel, delay_s=0.1), 12))
    assert found.fault.name == f"{channel}_late"
    assert abs(found.fault.estimate - 0.1) < 4.0 * found.fault.std
    assert "kinematics show" in agreement_in_words(found)[0]


def test_channels_that_do_not_suffice_are_said_so(believed):
    records = [r.select(["V", "q", "de_cmd"]) for r in measure(believed, 13, inputs=(ELEVATOR,))]
    found = check_instruments(believed.suite, records)
    assert not found.contradicted
    assert "no instrument can be checked" in agreement_in_words(found)[0]


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1.0, 1.15, 1.5])
def test_a_large_suite_with_drift_and_clocks_of_its_own_is_contradicted_by_what_goes_beyond_it(scale):
    """A boom ahead with a clock of its own, an inertial unit that drifts, GPS."""
    aircraft = load_aircraft("eolo", "flexible")
    uncalibrated = Believed(aircraft, load_suite("eolo_full"), CONDITION, aircraft.rate_hz)
    (V,) = (s for s in uncalibrated.suite.sensors if s.channel == "V")
    truth = changed(uncalibrated, "V", scale=scale * V.scale)
    found = check_instruments(uncalibrated.suite, measure(truth, 3, inputs=(ELEVATOR,)))
    assert found.contradicted == (scale > 1.0)
    assert not found.contradicted or found.fault.name == "V_scale"
