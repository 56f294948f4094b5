"""Engines of the batch: JSBSim's own flights, the moments of a spinning propeller by hand, and what is refused."""

import re
from dataclasses import replace

import numpy as np
import pytest
from side_by_side import by_itself

import testbench as tb
from testbench.core.constants import G0_M_S2, LBF_N
from testbench.flight.batch import registers as r
from testbench.flight.batch.check import TOLERANCE, compared, difference
from testbench.flight.batch.fly import fly_many
from testbench.flight.batch.forces import thruster
from testbench.flight.batch.model import batch_model, put, registers, states_at
from testbench.flight.batch.program import Untranslated
from testbench.flight.batch.translate import translate
from testbench.flight.batch.vector import LANES
from testbench.flight.condition import TrimmedFlight
from testbench.flight.executive import Executive, velocity_at
from testbench.flight.start import Beginning
from testbench.flight.trim import place_at_trim

MOTOR = '<electric_engine name="motor"><power unit="WATTS">60000</power></electric_engine>'
TURBOPROP = """
<turboprop_engine name="small">
  <idlen1>60</idlen1> <maxn1>100</maxn1> <maxpower>90</maxpower> <psfc>0.6</psfc>
  <n1idle_max_delay>0.8</n1idle_max_delay>
  <table name="EnginePowerVC">
    <independentVar lookup="row">atmosphere/P-psf</independentVar>
    <independentVar lookup="column">velocities/ve-kts</independentVar>
    <tableData>
               0    200
      1000   0.6    0.7
      2200   1.0    1.1
    </tableData>
  </table>
  <table name="EnginePowerRPM_N1" type="internal">
    <tableData>
               50    100
      0         0     30
      4000      1     50
    </tableData>
  </table>
  <table name="ITT_N1" type="internal">
    <tableData>
               0     1
      15     100   700
      100    100   900
    </tableData>
  </table>
</turboprop_engine>
"""


def cub(engine: str = "", p_factor: float = 0.0, sense: float = 1.0) -> tb.Aircraft:
    """Return the J3Cub with another engine and a heavier propeller, so that JSBSim's own search brings it to rest."""
    aircraft = tb.load_aircraft("jsbsim:J3Cub")
    files = dict(aircraft.engine_files)
    for name, text in files.items():
        if engine and "<piston_engine" in text:
            files[name] = engine
        if engine and "<propeller" in text:
            files[name] = re.sub(r"(<ixx[^>]*>)[^<]*", lambda m: f"{m.group(1)} 8.0 ", text)
    assert aircraft.adapter is not None
    settings = {n: v for n, v in aircraft.adapter.settings.items() if not (engine and n.endswith("magneto_cmd"))}
    xml = aircraft.xml
    if p_factor:
        xml = re.sub(r"<(p_factor|sense)>[^<]*</\1>", "", xml)
        xml = xml.replace("</thruster>", f"<sense>{sense}</sense><p_factor>{p_factor}</p_factor></thruster>")
    return replace(aircraft, xml=xml, engine_files=files, adapter=replace(aircraft.adapter, settings=settings))


FLOWN = {
    "electric": lambda: cub(MOTOR),
    "electric, P-factor, turning left": lambda: cub(MOTOR, 8.0, -1.0),
    "piston": lambda: tb.load_aircraft("jsbsim:J3Cub"),
    "two geared propellers": lambda: tb.load_aircraft("jsbsim:wrightFlyer1903"),
    "turboprop": lambda: cub(TURBOPROP),
    "turbine": lambda: tb.load_aircraft("jsbsim:f15"),
    "rocket": lambda: tb.load_aircraft("jsbsim:x24b"),
}


def trimmed(aircraft: tb.Aircraft) -> TrimmedFlight:
    return tb.trim(aircraft, tb.FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))


def beside_jsbsim(aircraft: tb.Aircraft, at: TrimmedFlight, manoeuvre: tb.Manoeuvre) -> tuple[float, tb.FlightRecord]:
    """Return by how much a flight of the batch differs from JSBSim's, and that one."""
    truth = tb.fly(aircraft, at, manoeuvre, log_rate_hz=50.0)
    (record,) = fly_many([tb.Job(aircraft, at, manoeuvre, 50.0)], "batch")
    return difference(record, truth)[0], truth


def throttled(at: TrimmedFlight, seconds: float, begin_s: float, to: float) -> tb.Manoeuvre:
    """Return a step of the throttle from trim to ``to``."""
    t = np.arange(round(seconds * at.rate_hz)) / at.rate_hz
    thr = np.where(t < begin_s, 0.0, to - at.controls["thr"])
    return tb.Manoeuvre("step", tb.InputSignal(t, thr[:, None], ("thr",)), settle_s=0.0)


@pytest.mark.parametrize("name", FLOWN)
def test_engines_fly_as_jsbsim_flies_them(name):
    """20 s in which every control moves, the throttle by 2 % of its range or less; floors of ranges are the judge's."""
    aircraft = FLOWN[name]()
    at = trimmed(aircraft)
    worst, channel = compared(batch_model(aircraft, at.rate_hz, at.condition), at)
    assert worst <= TOLERANCE, channel


@pytest.mark.parametrize("lever", [0.7, 1.0])
def test_a_turbine_goes_from_idle_into_its_afterburner_as_jsbsim_s(lever):
    """Beyond half the lever the engine stays at full dry thrust, and the afterburner gives a share of the rest."""
    aircraft = tb.load_aircraft("jsbsim:f16")  # the lever of the F-15 goes to dry power only
    at = trimmed(aircraft)
    t = np.arange(round(8.0 * at.rate_hz)) / at.rate_hz
    thr = np.where(t < 3.0, -at.controls["thr"], lever - at.controls["thr"])
    manoeuvre = tb.Manoeuvre("slam", tb.InputSignal(t, thr[:, None], ("thr",)), settle_s=0.0)
    off, truth = beside_jsbsim(aircraft, at, manoeuvre)
    assert off <= TOLERANCE
    assert truth["thrust"].max() > (1.05 + 0.5 * (lever - 0.7)) * 17800.0 * LBF_N  # of its dry thrust at rest


def test_forces_that_follow_the_first_spool_fly_as_jsbsim_s():
    """Thrust hangs on the second spool alone; here a drag follows the speed of the first, %, as air spilt at an inlet.

    At full speed it is 5 % of the weight: the flight shows how quickly that spool runs up.
    """
    aircraft = FLOWN["turbine"]()
    spilt = "<product><property>propulsion/engine/n1</property><value>{:.6g}</value></product>"
    spilt = spilt.format(0.05 / 100.0 * aircraft.mass.mass_kg * G0_M_S2 / LBF_N)
    function = f'<function name="aero/spilt">{spilt}</function>'
    aircraft = replace(aircraft, xml=aircraft.xml.replace('<axis name="DRAG">', f'<axis name="DRAG">{function}'))
    at = trimmed(aircraft)
    manoeuvre = throttled(at, 4.0, 1.0, 0.5)
    assert beside_jsbsim(aircraft, at, manoeuvre)[0] <= TOLERANCE


def test_a_control_system_reads_what_an_engine_s_function_gave_in_the_last_frame():
    """JSBSim runs control systems before engines: one that reads a function of the engine's file is a frame late.

    Here it makes a gust of what it reads, so that the whole flight hangs on it.
    """
    share = "<product><property>fcs/throttle-pos-norm</property><value>0.3</value></product>"
    load = f'<function name="propulsion/engine[#]/load">{share}</function>'
    aircraft = cub(MOTOR.replace("</electric", f"{load}</electric"))
    held = '<pure_gain name="fcs/held"><input>propulsion/engine/load</input><gain>4</gain>'
    section = f'<system name="test"><channel name="c">{held}<output>atmosphere/gust-down-fps</output></pure_gain>'
    at = aircraft.xml.index("<flight_control")
    aircraft = replace(aircraft, xml=f"{aircraft.xml[:at]}{section}</channel></system>{aircraft.xml[at:]}")
    start = trimmed(aircraft)
    manoeuvre = throttled(start, 2.0, 0.5, 0.9)
    assert beside_jsbsim(aircraft, start, manoeuvre)[0] <= TOLERANCE


BOOST = """
  <numboostspeeds>2</numboostspeeds> <boost-loss-factor>0.6</boost-loss-factor>
  <takeoffboost unit="PSI">3</takeoffboost>
  <ratedboost1 unit="PSI">1</ratedboost1> <ratedboost2 unit="INHG">4</ratedboost2>
  <ratedpower1>60</ratedpower1> <ratedpower2>60</ratedpower2> <ratedrpm1>2800</ratedrpm1> <ratedrpm2>2800</ratedrpm2>
  <ratedaltitude1 unit="FT">1980</ratedaltitude1> <ratedaltitude2 unit="FT">9000</ratedaltitude2>
"""


def test_a_supercharger_changes_gear_and_takes_its_power_as_jsbsim_s():
    """It compresses air by work that the shaft gives, and turns faster once the pressure outside has fallen far enough.

    The next gear takes over 1000 ft and 1000 Pa above the rated altitude of the first: a few metres above the trim.
    """
    aircraft = FLOWN["piston"]()
    files = {n: t.replace("</piston_engine>", f"{BOOST}</piston_engine>") for n, t in aircraft.engine_files.items()}
    aircraft = replace(aircraft, engine_files=files)
    at = trimmed(aircraft)
    manoeuvre = throttled(at, 6.0, 0.5, 0.9)
    assert beside_jsbsim(aircraft, at, manoeuvre)[0] <= TOLERANCE


def test_flights_of_a_block_begin_with_their_own_engines():
    aircraft = FLOWN["piston"]()
    trims = [tb.trim(aircraft, tb.FlightCondition(V, 1000.0)) for V in (28.0, 34.0)]
    t = np.arange(round(4.0 * trims[0].rate_hz)) / trims[0].rate_hz
    manoeuvre = tb.Manoeuvre("step", tb.InputSignal(t, 0.05 * (t > 1.0)[:, None], ("thr",)), settle_s=0.0)
    flown = fly_many([tb.Job(aircraft, at, manoeuvre, 50.0) for at in trims], "batch")
    for record, at in zip(flown, trims, strict=True):
        assert difference(record, tb.fly(aircraft, at, manoeuvre, log_rate_hz=50.0))[0] <= TOLERANCE
        assert record["motor_speed"][0] == pytest.approx(at.state["motor_speed"], rel=1e-6)


def test_a_propeller_s_gyroscopic_moment_and_torque_are_those_of_a_spinning_body():
    """M = r x F + omega x h + Q about the thrust line."""
    rng = np.random.default_rng(5)
    R = np.zeros((r.COUNT + 9, LANES))
    axis, at, omega = (rng.normal(size=(3, LANES)) for _ in range(3))
    thrust, torque, h = (rng.normal(size=LANES) for _ in range(3))
    R[r.RATE : r.RATE + 3] = omega
    R[r.CG] = 10.0
    R[r.COUNT :] = np.vstack([thrust, axis, at, torque, h])
    by_itself(lambda rows: thruster(rows, r.COUNT))(R)
    arm = np.stack([10.0 - at[0], at[1], -at[2]]) / 12.0  # structural axes: aft, right, up
    moment = np.cross(arm.T, (thrust * axis).T) + np.cross(omega.T, (h * axis).T) + (torque * axis).T
    np.testing.assert_allclose(R[r.ENGINE_MOMENT : r.ENGINE_MOMENT + 3].T, moment, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(R[r.ENGINE_FORCE : r.ENGINE_FORCE + 3], thrust * axis, rtol=1e-12)


def test_air_that_comes_in_aslant_moves_the_thrust_sideways():
    """The shift is the P-factor times the angle of the wind that the propeller makes for itself (FGPropeller)."""
    aircraft = cub(MOTOR, 8.0)
    at = trimmed(aircraft)
    model = batch_model(aircraft, at.rate_hz, at.condition)
    R, one, V = registers([model]), np.ones(1), at.condition.V_m_s
    uvw = velocity_at(V, at.alpha, 0.1)
    place = np.array([at.condition.h_m, at.theta, at.phi, *uvw, 0.0, 0.0, 0.0])[:, None]
    controls = {n: v * one for n, v in at.controls.items()}
    states = states_at(model, Beginning.at(at))
    put(model, R, place, controls, [states])
    u, v, w = R[r.U_AERO : r.U_AERO + 3, 0]
    place = model.program.properties["propulsion/engine/y-position"]
    before = states["propulsion/engine/y-position"]
    fdm = Executive(aircraft, at.rate_hz, at.condition)
    place_at_trim(fdm, at)
    fdm.place(at.condition.h_m, at.theta, at.phi, uvw)
    fdm.evaluate(to_rest=True, held=True)
    induced = fdm.get("propulsion/engine/prop-induced-velocity_fps")
    angle = np.arctan2(np.hypot(v, w), u + induced)
    hub = fdm.get("propulsion/engine/y-reference-position")
    assert R[place, 0] - hub == pytest.approx(8.0 * angle * w / np.hypot(v, w), rel=1e-9)
    assert R[place, 0] != pytest.approx(before, rel=1e-3)
    assert R[r.ENGINE_MOMENT + 2, 0] == pytest.approx(fdm.get("moments/n-prop-lbsft"), rel=1e-9)


def test_an_engine_that_burns_its_fuel_is_left_to_jsbsim():
    aircraft = FLOWN["piston"]()
    assert aircraft.adapter is not None
    settings = {n: v for n, v in aircraft.adapter.settings.items() if n != "propulsion/fuel_freeze"}
    burning = replace(aircraft, adapter=replace(aircraft.adapter, settings=settings))
    with pytest.raises(Untranslated, match="burns its fuel"):
        batch_model(burning, burning.rate_hz, tb.FlightCondition(31.0, 1000.0))


@pytest.mark.parametrize(
    ("inside", "reason"),
    [
        ("<numboostspeeds>2</numboostspeeds><ratedboost1>5</ratedboost1>", "not given in full"),
        ('<displacement unit="GAL">2</displacement>', "GAL"),
    ],
)
def test_a_piston_engine_that_is_not_understood_is_left_to_jsbsim(inside, reason):
    aircraft = FLOWN["piston"]()
    files = {n: t.replace("</piston_engine>", f"{inside}</piston_engine>") for n, t in aircraft.engine_files.items()}
    if "displacement" in inside:
        files = {n: re.sub(r"<displacement[^>]*>[^<]*</displacement>", "", t, count=1) for n, t in files.items()}
    tree = aircraft.model_tree(aircraft.rate_hz, 500.0, 30.0)
    with pytest.raises(Untranslated, match=reason):
        translate(tree, files, 0.005, [], ["propulsion/engine/thrust-lbs"], frozen=True)
