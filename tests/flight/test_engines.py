"""Propellers and piston engines as states of the linear model.

Motors with propellers too quick for JSBSim's own search for steady thrust: their balance is solved, and kept.
"""

from functools import cache

import numpy as np
import pytest

from testbench.aircraft.source import Source, read_source
from testbench.core.constants import FT_M
from testbench.core.errors import ChannelError
from testbench.core.paths import AIRCRAFT_MODELS
from testbench.flight import FlightCondition, Manoeuvre, fly, linearise, load_aircraft, trim
from testbench.flight.adopt import Adopted, adopt
from testbench.flight.executive import Executive
from testbench.flight.propellers import Propellers
from testbench.flight.trim import place_at_trim
from testbench.inputs import InputSignal

ELECTRIC = '<electric_engine name="motor"><power unit="WATTS">600</power></electric_engine>'
BRUSHLESS = (
    '<brushless_dc_motor name="motor"><velocityconstant>500</velocityconstant><coilresistance>0.04</coilresistance>'
    "<noloadcurrent>1.2</noloadcurrent><maxvolts>18.5</maxvolts></brushless_dc_motor>"
)
# Coefficients over the advance ratio, of a two-bladed wooden propeller of 14 inches; it drives the motor above 0.95.
CT = ((0.0, 0.095), (0.2, 0.085), (0.4, 0.066), (0.6, 0.042), (0.8, 0.012), (1.0, -0.02), (1.5, -0.09))
CP = ((0.0, 0.048), (0.2, 0.047), (0.4, 0.043), (0.6, 0.033), (0.8, 0.017), (1.0, -0.006), (1.5, -0.08))


def propeller(inertia_kg_m2: float, diameter_in: float = 14.0) -> str:
    """Return a propeller with these coefficients."""
    out = f'<propeller name="propeller"><ixx unit="KG*M2">{inertia_kg_m2}</ixx><numblades>2</numblades>'
    out += f'<diameter unit="IN">{diameter_in}</diameter>'
    for name, rows in (("C_THRUST", CT), ("C_POWER", CP)):
        data = "\n".join(f"{J} {c}" for J, c in rows)
        out += f'<table name="{name}" type="internal"><tableData>{data}</tableData></table>'
    return f"{out}</propeller>"


def with_propeller(motor: str, inertia_kg_m2: float = 1e-4, engines: int = 1) -> Source:
    """Return the Taurus with so many motors, each with a propeller, in place of its law of thrust."""
    plain = read_source(AIRCRAFT_MODELS / "taurus" / "taurus.xml")
    xml = plain.xml.replace('file="direct"', 'file="propeller"')
    xml = xml.replace("<output>fcs/throttle-pos-norm</output>", "<output>fcs/static-thrust</output>")
    start, end = xml.index("<engine "), xml.index("</engine>") + len("</engine>")
    files = {"motor.xml": motor, "propeller.xml": propeller(inertia_kg_m2)}
    return Source("small", plain.path, xml[:start] + engines * xml[start:end] + xml[end:], files, (), ())


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


@pytest.mark.sampled(2)
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
