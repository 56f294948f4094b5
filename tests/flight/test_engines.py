"""Propellers and piston engines as states of the linear model."""

from __future__ import annotations

import numpy as np
import pytest

from testbench.core.errors import ChannelError
from testbench.flight import FlightCondition, Manoeuvre, fly, linearise, load_aircraft, trim
from testbench.flight.executive import Executive
from testbench.flight.propellers import Propellers
from testbench.flight.trim import place_at_trim
from testbench.inputs import InputSignal


@pytest.fixture(scope="module")
def c172p():
    aircraft = load_aircraft("jsbsim:c172p")
    trimmed = trim(aircraft, FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))
    return aircraft, trimmed, linearise(aircraft, trimmed)


def test_a_propeller_is_trimmed_where_it_keeps_its_speed(c172p):
    aircraft, trimmed, _ = c172p
    fdm = Executive(aircraft, trimmed.rate_hz, trimmed.condition)
    place_at_trim(fdm, trimmed)
    assert np.abs(fdm.propellers.accelerations()).max() < 1e-3  # rad/s2
    assert np.abs(trimmed.residual).max() < 1e-6
    assert trimmed.state["motor_speed"] > 100.0


def test_a_placed_aircraft_is_at_rest_after_its_propeller_was_settled(c172p):
    """Its lift depends on alphadot: a loop over evaluations, into which the propeller's new speed comes last."""
    aircraft, trimmed, _ = c172p
    fdm = Executive(aircraft, trimmed.rate_hz, trimmed.condition)
    place_at_trim(fdm, trimmed)
    before = fdm.get("accelerations/qdot-rad_sec2")
    fdm.fdm.run_ic()
    assert abs(fdm.get("accelerations/qdot-rad_sec2") - before) < 1e-12
    assert abs(before) < 1e-6


def test_speed_and_manifold_pressure_are_states(c172p):
    _, _, model = c172p
    assert model.states[-2:] == ("motor_speed", "manifold_pressure")
    k = model.states.index("manifold_pressure")
    assert model.A[k, k] == pytest.approx(-1.0, rel=1e-5)  # JSBSim's own lag of one second
    assert not {"motor_speed", "manifold_pressure"} & set(model.with_quick_engines().states)


def test_the_linear_model_answers_a_throttle_step_as_the_flight_does(c172p):
    aircraft, trimmed, model = c172p
    rate, step = trimmed.rate_hz, 0.02
    t = np.arange(round(4.0 * rate)) / rate
    signal = InputSignal(t, np.full((t.size, 1), step), ("thr",))
    flown = fly(aircraft, trimmed, Manoeuvre("step", signal, 0.0), rate, ("motor_speed", "thrust", "u"))
    from scipy.linalg import expm

    n = len(model.states)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = model.A / rate, model.B[:, model.inputs.index("thr")] / rate
    step_matrix = expm(block)
    x, rows = np.zeros(n + 1), []
    x[n] = step
    for _ in range(len(flown)):
        rows.append(model.C[[model.outputs.index(c) for c in flown.channels]] @ x[:n])
        x = step_matrix @ x
    linear = np.array(rows)
    change = flown.data - flown.data[0]
    for i, channel in enumerate(flown.channels):
        assert np.abs(change[:, i] - linear[:, i]).max() < 0.05 * np.abs(change[:, i]).max(), channel


def test_quick_engines_keep_the_answer_to_slow_changes(c172p):
    _, _, model = c172p
    quick, slow = model.with_quick_engines(), np.array([1e-3])
    whole = model.frequency_response(slow, ["V", "thrust"], ["de", "thr"])
    assert quick.frequency_response(slow, ["V", "thrust"], ["de", "thr"]) == pytest.approx(whole, rel=1e-2)


def test_a_surface_without_servo_is_where_its_command_is(c172p):
    aircraft, _, model = c172p
    assert not any(s.startswith("servo") for s in model.states)
    for control in ("de", "da", "dr"):
        one, two = (model.inputs.index(n) for n in (control, f"{control}_cmd"))
        assert np.array_equal(model.B[:, one], model.B[:, two])
    k = model.outputs.index("de")
    assert model.D[k, model.inputs.index("de_cmd")] == pytest.approx(1.0)
    assert aircraft.servo_of("de") is None


@pytest.mark.parametrize(
    ("model", "V_m_s", "steps", "most"),
    [
        ("c182", 55.0, (1e-3, -1e-3, 0.03, -0.03), 4 * 75),  # it took 894 frames
        pytest.param("p51d", 105.0, (1e-3, -1e-3, 0.03, -0.03, -0.3, 0.3, 0.0), 7 * 120, marks=pytest.mark.slow),
    ],
)
def test_the_manifold_of_a_governed_engine_fills_in_few_frames(monkeypatch, model, V_m_s, steps, most):
    """A frame as long as its lag fills it; far from rest that stalls the P-51's engine, whose throttle shows late."""
    aircraft = load_aircraft(f"jsbsim:{model}")
    trimmed = trim(aircraft, FlightCondition(V_m_s, 1000.0))
    fdm = Executive(aircraft, trimmed.rate_hz, trimmed.condition)
    place_at_trim(fdm, trimmed)
    frames = []
    march = Propellers._march
    monkeypatch.setattr(Propellers, "_march", lambda self, dt_s: frames.append(dt_s) or march(self, dt_s))
    wanted = fdm.propellers.speeds()
    for step in steps:
        fdm.command({"thr": trimmed.controls["thr"] + step})
        fdm.evaluate()
        assert np.allclose(fdm.propellers.speeds(), wanted, rtol=1e-9)
    assert len(frames) < most
    fdm.command(dict(trimmed.controls))
    fdm.evaluate(to_rest=True)
    left = [fdm.get(f"accelerations/{name}") for name in ("udot-ft_sec2", "qdot-rad_sec2")]
    assert np.max(np.abs(left)) < 1e-6  # the manifold is as full as the throttle wants, too


@pytest.mark.parametrize(
    ("model", "V_m_s", "throttles"),
    [
        ("c182", 60.0, (0.10, 0.20, 0.30, 0.45, 0.55, 0.65, 0.70)),
        pytest.param("p51d", 83.0, (0.64, 0.65, 0.66, 0.67, 0.68, 0.70), marks=pytest.mark.slow),
    ],
)
def test_a_governed_propeller_rests_at_one_speed_on_both_sides_of_the_stop_of_its_blades(model, V_m_s, throttles):
    """Little throttle leaves the blades at their fine stop; whatever was flown before, the speed is the same.

    Long frames that fill the manifold took the P-51's blades off the stop and back, so that it did not come to rest
    there: it trimmed at no speed beyond 77 m/s, and its limits ended at 88 m/s.
    """
    aircraft = load_aircraft(f"jsbsim:{model}")
    fdm = Executive(aircraft, aircraft.rate_hz, FlightCondition(V_m_s, 1500.0))
    speeds = []
    for throttle in (*throttles, *throttles[::-1]):
        fdm.command({"thr": throttle})
        fdm.place(1500.0, 0.0, 0.0, (V_m_s, 0.0, 0.0))
        fdm.evaluate()
        speeds.append(float(fdm.propellers.speeds()[0]))
    up, down = np.array(speeds[: len(throttles)]), np.array(speeds[len(throttles) :])[::-1]
    assert up == pytest.approx(down, rel=1e-9)
    assert np.all(np.diff(up) > -1e-6 * up[0])
    assert up[0] < 0.99 * up[-1] == pytest.approx(0.99 * up[-2])  # from the stop to the governor's speed


def test_a_channel_that_a_glider_does_not_have_is_said():
    glider = load_aircraft("jsbsim:SGS")
    trimmed = trim(glider, FlightCondition(glider.design_V_m_s, glider.design_h_m))
    assert trimmed.condition.gamma_rad < -0.01
    signal = InputSignal(np.arange(100) / trimmed.rate_hz, np.zeros((100, 1)), ("de",))
    with pytest.raises(ChannelError, match="SGS has no channel 'thr' in flight"):
        fly(glider, trimmed, Manoeuvre("still", signal, 0.0), trimmed.rate_hz, ("V", "thr"))
