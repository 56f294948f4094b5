"""What counts frames is made for one frame rate: at another it says by what factor its times are off."""

from __future__ import annotations

import warnings
from dataclasses import replace

import pytest

import testbench as tb
from testbench.effects import SERVOS
from testbench.flight.trim import FrameRateWarning
from testbench.sensors import load_suite

CONDITION = tb.FlightCondition(V_m_s=14.0, h_m=100.0)


def late(aircraft, delay_s=0.1):
    return SERVOS["delay", "de"].amend(aircraft, load_suite("eolo_gap"), {"delay_s": delay_s})[0]


def test_a_delay_flown_at_another_rate_is_warned_of():
    aircraft = tb.load_aircraft("taurus")
    rate = aircraft.rate_hz
    with pytest.warns(
        FrameRateWarning, match=rf"counts frames of {rate:g} Hz and is flown at {2 * rate:g} Hz.* 0.5 times"
    ):
        tb.trim(late(aircraft), CONDITION, 2.0 * rate)


def test_at_its_own_rate_nothing_is_said():
    aircraft = tb.load_aircraft("taurus")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tb.trim(late(aircraft), CONDITION)
        tb.trim(aircraft, CONDITION, 2.0 * aircraft.rate_hz)
        fast = replace(aircraft, rate_hz=2.0 * aircraft.rate_hz)
        assert tb.trim(late(fast), CONDITION, fast.rate_hz).rate_hz == 2.0 * aircraft.rate_hz
