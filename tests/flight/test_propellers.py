"""Motors with propellers too quick for JSBSim's own search for steady thrust: their balance is solved, and kept."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from small_propellers import BRUSHLESS, CP, CT, ELECTRIC, with_propeller

from testbench.core.constants import FT_M
from testbench.flight import Manoeuvre, fly, linearise
from testbench.flight.adopt import Adopted, adopt
from testbench.flight.executive import Executive
from testbench.inputs.signal import InputSignal

KINDS = {
    "electric": (ELECTRIC, 1e-4, 1),
    "electric, no inertia": (ELECTRIC, 0.0, 1),
    "brushless": (BRUSHLESS, 1e-4, 1),
    "two": (ELECTRIC, 1e-4, 2),
}
POWER_W, D_M, V_M_S, INERTIA = 600.0, 14.0 * FT_M / 12.0, 15.0, 1e-4


@cache
def adopted(kind: str) -> Adopted:
    return adopt(with_propeller(*KINDS[kind]), V_M_S)


def coefficients(J: float) -> tuple[float, float]:
    """Return the coefficients of thrust and power."""
    return tuple(float(np.interp(J, *np.array(rows).T)) for rows in (CT, CP))


@pytest.mark.parametrize("kind", KINDS)
def test_a_motor_drives_the_aircraft_and_goes_on_as_it_was_trimmed(kind):
    found = adopted(kind)
    trimmed, rate = found.trimmed, found.trimmed.rate_hz
    assert "thr" in found.aircraft.controls
    assert np.max(np.abs(trimmed.residual)) < 1e-7
    n = round(3.0 * rate)
    still = Manoeuvre("still", InputSignal(np.arange(n) / rate, np.zeros((n, 1)), ("de",)), settle_s=0.0)
    record = fly(found.aircraft, trimmed, still, 10.0, ("V", "motor_speed"))
    assert record["V"] == pytest.approx(V_M_S, rel=1e-6)
    assert record["motor_speed"] == pytest.approx(trimmed.state["motor_speed"], rel=1e-6)


def test_power_and_thrust_are_those_of_the_tables():
    """The balance of powers by hand: what the motor gives at its throttle is what the propeller takes at its speed."""
    found = adopted("electric")
    trimmed = found.trimmed
    n = trimmed.state["motor_speed"] / (2.0 * np.pi)
    fdm = Executive(found.aircraft, trimmed.rate_hz, trimmed.condition)
    rho = fdm.get("atmosphere/rho-slugs_ft3") * 515.3788184
    ct, cp = coefficients(V_M_S * np.cos(trimmed.alpha) / (n * D_M))
    assert cp * rho * n**3 * D_M**5 == pytest.approx(POWER_W * trimmed.controls["thr"], rel=1e-4)
    assert ct * rho * n**2 * D_M**4 == pytest.approx(trimmed.state["thrust"], rel=1e-4)


@pytest.mark.parametrize("kind", ["electric", "electric, no inertia", "two"])
def test_without_power_a_propeller_windmills_where_it_takes_none(kind):
    found = adopted(kind)
    fdm = Executive(found.aircraft, found.trimmed.rate_hz, found.trimmed.condition)
    fdm.command({"thr": 0.0})
    fdm.place(found.trimmed.condition.h_m, 0.0, 0.0, (V_M_S, 0.0, 0.0))
    fdm.evaluate()
    J = 0.8 + 0.2 * 0.017 / 0.023  # where the table of the power crosses zero
    assert fdm.propellers.speeds() == pytest.approx(2.0 * np.pi * V_M_S / (J * D_M), rel=1e-6)


def test_a_propeller_too_light_for_frames_is_made_heavier_and_that_is_said():
    found = adopted("electric, no inertia")
    assert any("(0.0 KG*M2 in the file" in words for words in found.assumed)
    as_given = adopted("electric")
    assert not any("inertia" in words for words in as_given.assumed)
    for name, value in as_given.trimmed.controls.items():
        assert found.trimmed.controls[name] == pytest.approx(value, abs=1e-6)


def test_the_speed_of_the_motor_is_a_state_with_its_own_time_constant():
    """I domega/dt = P / omega - Q(omega, V), differentiated by hand."""
    found = adopted("electric")
    model, trimmed = linearise(found.aircraft, found.trimmed), found.trimmed
    omega, u, given = trimmed.state["motor_speed"], V_M_S * np.cos(trimmed.alpha), POWER_W * trimmed.controls["thr"]

    def taken(speed: float) -> float:
        n = speed / (2.0 * np.pi)
        return coefficients(u / (n * D_M))[1] * n**3 * D_M**5

    def rate(speed: float) -> float:  # with the density at which the powers balance
        return given * (1.0 - taken(speed) / taken(omega)) / (speed * INERTIA)

    by_hand = (rate(omega + 0.01) - rate(omega - 0.01)) / 0.02
    k = model.states.index("motor_speed")
    assert model.A[k, k] == pytest.approx(by_hand, rel=1e-2)
