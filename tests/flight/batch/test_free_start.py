"""A flight that begins off its trim: JSBSim and the batch agree, and it is where it was told to be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import testbench as tb
from testbench.core.errors import LimitError
from testbench.flight.batch.check import TOLERANCE, difference
from testbench.flight.trim import horizon_rates

START = tb.Start(V_m_s=0.8, alpha=0.02, beta=0.03, p=0.1, q=-0.05, r=0.03, phi=0.3, theta=0.05, h_m=20.0)


def trimmed_and_moved(name: str, duration_s: float = 3.0):
    aircraft = tb.load_aircraft(name)
    trimmed = tb.trim(aircraft, tb.FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))
    t = np.arange(round(duration_s * trimmed.rate_hz)) / trimmed.rate_hz
    names = tuple(aircraft.controls)
    u = np.column_stack([0.01 + 0.01 * np.sin((3.0 + i) * t) for i in range(len(names))])
    return aircraft, trimmed, tb.Manoeuvre("by hand", tb.InputSignal(t, u, names), 0.0)


@pytest.mark.parametrize("name", ["eolo", "c172p", "f16"])
def test_both_simulators_agree_from_a_start(name: str) -> None:
    aircraft, trimmed, manoeuvre = trimmed_and_moved(name)
    rate = trimmed.rate_hz / round(trimmed.rate_hz / 50.0)
    truth = tb.fly(aircraft, trimmed, manoeuvre, rate, start=START)
    flown = tb.fly_many(aircraft, trimmed, manoeuvre, rate, start=[START, None], simulator="batch")
    assert difference(flown[0], truth)[0] <= TOLERANCE
    assert difference(flown[1], tb.fly(aircraft, trimmed, manoeuvre, rate))[0] <= TOLERANCE
    assert flown[0].provenance["start"]["phi"] == 0.3
    assert "start" not in flown[1].provenance


def test_moments_about_stability_axes_are_jsbsim_s_in_a_sideslip() -> None:
    """Those axes turn with the angle of attack alone; wind axes, from which lift and drag come, turn with both."""
    aircraft, trimmed, manoeuvre = trimmed_and_moved("taurus")
    xml = aircraft.xml
    for axis in ("ROLL", "PITCH", "YAW"):
        xml = xml.replace(f'<axis name="{axis}">', f'<axis name="{axis}" frame="STABILITY">')
    turned = replace(aircraft, xml=xml)
    rate = trimmed.rate_hz / round(trimmed.rate_hz / 50.0)
    truth = tb.fly(turned, trimmed, manoeuvre, rate, start=START)
    (flown,) = tb.fly_many(turned, trimmed, [manoeuvre], rate, start=START, simulator="batch")
    assert difference(flown, truth)[0] <= TOLERANCE
    assert difference(tb.fly(aircraft, trimmed, manoeuvre, rate, start=START), truth)[0] > 1e-3


def test_a_flight_begins_where_it_is_told() -> None:
    aircraft, trimmed, manoeuvre = trimmed_and_moved("eolo", 0.5)
    record = tb.fly(aircraft, trimmed, manoeuvre, trimmed.rate_hz, start=START)
    condition, still = trimmed.condition, horizon_rates(trimmed.condition.h_m, 0.0, 0.0, np.array([16.0, 0.0, 0.0]))
    wanted = {
        "V": condition.V_m_s + START.V_m_s,
        "h": condition.h_m + START.h_m,
        "alpha": trimmed.alpha + START.alpha,
        "beta": trimmed.beta + START.beta,
        "theta": trimmed.theta + START.theta,
        "phi": trimmed.phi + START.phi,
        "p": START.p,
        "q": START.q,
        "r": START.r,
        "de": trimmed.controls["de"] + 0.01,  # the servo stands where the first command holds it
    }
    assert np.max(np.abs(still)) < 1e-5
    assert {n: float(record[n][0]) for n in wanted} == pytest.approx(wanted, abs=1e-5)


def test_a_start_at_rest_is_the_trim_with_the_first_commands() -> None:
    aircraft, trimmed, manoeuvre = trimmed_and_moved("eolo", 1.0)
    still = tb.Manoeuvre(
        "still", tb.InputSignal(manoeuvre.signal.t_s, 0.0 * manoeuvre.signal.u, ("de", "da", "dr", "thr"))
    )
    free, trim = (tb.fly(aircraft, trimmed, still, trimmed.rate_hz, start=s) for s in (tb.Start(), None))
    assert difference(free, trim)[0] <= TOLERANCE


def test_a_start_without_airspeed_is_refused_by_both() -> None:
    aircraft, trimmed, manoeuvre = trimmed_and_moved("eolo", 0.1)
    start = tb.Start(V_m_s=-20.0)
    with pytest.raises(LimitError, match="airspeed above 0 m/s, got -4 m/s"):
        tb.fly(aircraft, trimmed, manoeuvre, trimmed.rate_hz, start=start)
    with pytest.raises(LimitError, match="airspeed above 0 m/s, got -4 m/s"):
        tb.fly_many(aircraft, trimmed, manoeuvre, trimmed.rate_hz, start=start, simulator="batch")
