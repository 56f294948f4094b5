"""Models that come with JSBSim, adopted: they balance, and their propellers are where a governor wants them."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

import testbench.flight.adopt as adopt_module
from testbench.aircraft.model import ASSUMED, source_at
from testbench.aircraft.source import find_model, read_source
from testbench.core.constants import DEG_RAD, G0_M_S2, LBF_N, RPM_RAD_S
from testbench.core.errors import ModelError, TrimError
from testbench.core.paths import stock_root
from testbench.flight import FlightCondition, Manoeuvre, fly, trim
from testbench.flight.adopt import Adopted, adopt
from testbench.flight.executive import Executive
from testbench.flight.limits import _sideslip as sideslip_of_tables
from testbench.flight.limits import steady_sideslip
from testbench.flight.trim import place_at_trim
from testbench.inputs.signal import InputSignal

ROOT = stock_root()
pytestmark = pytest.mark.skipif(ROOT is None, reason="the jsbsim package brings no models")

# Name: speed, m/s. c182 has a propeller of constant speed, pc7 one behind a turboprop.
SPEEDS = {"c172p": 45.0, "f16": 150.0, "SGS": 29.0, "B747": 140.0, "c182": 55.0, "pc7": 80.0}
PC7 = pytest.param("pc7", marks=pytest.mark.slow)  # its propeller takes a quarter of a minute to settle


@cache
def adopted(name: str) -> Adopted:
    path = find_model(ROOT / "aircraft" / name)
    assert path is not None
    return adopt(read_source(path), SPEEDS.get(name))


def held(name: str) -> Executive:
    """Return an executive in the trimmed state."""
    found = adopted(name)
    fdm = Executive(found.aircraft, found.trimmed.rate_hz, found.trimmed.condition)
    place_at_trim(fdm, found.trimmed)
    return fdm


@pytest.mark.parametrize("name", [n for n in SPEEDS if n != "pc7"] + [PC7])
def test_forces_and_moments_balance(name):
    trimmed = adopted(name).trimmed
    assert np.max(np.abs(trimmed.residual)) < 1e-7
    assert trimmed.state["V"] == pytest.approx(SPEEDS[name], rel=1e-9)
    assert abs(trimmed.alpha) < 12.0 * DEG_RAD


@pytest.mark.parametrize("name", ["c172p", "c182", PC7])
def test_a_flight_without_input_stays_at_trim(name):
    """Propellers, governors, manifolds and gas generators go on where the trim left them: three seconds change nothing.

    Without the balance of propellers the airspeed departs by metres per second.
    """
    found = adopted(name)
    rate = found.trimmed.rate_hz
    n = round(3.0 * rate)
    still = Manoeuvre("still", InputSignal(np.arange(n) / rate, np.zeros((n, 1)), ("de",)), settle_s=0.0)
    record = fly(found.aircraft, found.trimmed, still, 10.0, ("V", "theta", "h"))
    assert record["V"] == pytest.approx(SPEEDS[name], rel=1e-5)
    assert record["theta"] == pytest.approx(record["theta"][0], abs=2e-5)


@pytest.mark.parametrize("name", ["c182", PC7])
def test_frames_of_a_flight_change_no_propeller(name):
    """JSBSim's own frames, governor at work, rigid body held: an independent search for the same equilibrium."""
    fdm = held(name)
    before = fdm.propellers.speeds()
    blade = fdm.get("propulsion/engine[0]/blade-angle")
    for _ in range(400):
        fdm.propellers._march(1.0 / fdm.rate_hz)
    assert fdm.propellers.speeds() == pytest.approx(before, rel=1e-8)
    assert fdm.get("propulsion/engine[0]/blade-angle") == pytest.approx(blade, abs=1e-5)


@pytest.mark.parametrize("name", ["c182", PC7])
def test_the_governor_gets_the_speed_it_asks_for(name):
    found = adopted(name)
    texts = " ".join(t for t in found.aircraft.engine_files.values() if "<propeller" in t)
    wanted = re.search(r"<maxrpm>\s*([\d.]+)", texts)
    assert wanted is not None
    assert held(name).propellers.speeds()[0] == pytest.approx(float(wanted[1]) * RPM_RAD_S, rel=1e-9)


def test_another_throttle_reaches_the_equilibrium_that_marching_reaches():
    """From the trim to 90 % throttle: the search and eighty seconds of JSBSim's frames end at the same blade angle."""
    found = adopted("c182")
    state = found.trimmed
    searched, marched = held("c182"), held("c182")
    for fdm in (searched, marched):
        fdm.command({"thr": 0.9})
        V, a = state.condition.V_m_s, state.alpha
        fdm.place(state.condition.h_m, state.theta, state.phi, (V * np.cos(a), 0.0, V * np.sin(a)))
    searched.evaluate()
    marched.fdm.run_ic()
    for _ in range(16000):
        marched.propellers._march(1.0 / marched.rate_hz)
    for name in ("blade-angle", "power-hp", "propeller-rpm"):
        prop = f"propulsion/engine[0]/{name}"
        assert searched.get(prop) == pytest.approx(marched.get(prop), rel=1e-6)


def test_a_glider_descends():
    found = adopted("SGS")
    assert "thr" not in found.aircraft.controls
    assert -0.1 < found.trimmed.condition.gamma_rad < -0.01
    # At small angles the glide ratio is that of lift to drag: weight along and across the path.
    fdm = held("SGS")
    lift, drag = fdm.get("forces/fwz-aero-lbs"), fdm.get("forces/fwx-aero-lbs")
    assert abs(drag / lift) == pytest.approx(abs(np.tan(found.trimmed.condition.gamma_rad)), rel=5e-3)


def test_without_a_rudder_sideslip_is_sought_in_its_place():
    """The aircraft without its rudder, and with an asymmetry that a rudder balanced before."""
    found = adopted("c172p")
    aircraft = found.aircraft
    assert aircraft.adapter is not None
    links = tuple(x for x in aircraft.adapter.links if x.control != "dr")
    controls = {n: c for n, c in aircraft.controls.items() if n != "dr"}
    bare = replace(aircraft, adapter=replace(aircraft.adapter, links=links), controls=controls)
    trimmed = trim(bare, found.trimmed.condition)
    assert np.max(np.abs(trimmed.residual)) < 1e-7
    assert "dr" not in trimmed.controls
    assert 1e-4 < abs(trimmed.beta) < 5.0 * DEG_RAD


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("ah1s", "rotor"),
        ("blank", "<fdm_config>"),
        ("ball", "control surfaces"),
        ("F450", "multirotor: 4 propellers"),
        ("L410", "smaller than the span"),
    ],
)
def test_what_is_no_aircraft_is_refused_with_the_reason(name, why):
    with pytest.raises(ModelError, match=why):
        adopted(name)


def test_limits_are_found_and_say_where_they_come_from():
    """The Cessna stalls at 25.3 m/s, where its lift is greatest, and not at 15 % below some speed that trims."""
    aircraft = adopted("c172p").aircraft
    slowest, _ = aircraft.level_V_m_s
    assert slowest == pytest.approx(25.3, abs=0.1)
    h_m = aircraft.design_h_m
    trim(aircraft, FlightCondition(slowest, h_m))
    fast = trim(aircraft, FlightCondition(70.0, h_m))  # its engine, once stalled in the search, is started again
    assert fast.controls["thr"] == pytest.approx(0.93, abs=0.02)
    with pytest.raises(TrimError):
        trim(aircraft, FlightCondition(0.985 * slowest, h_m))
    assert "lift is greatest there" in source_at(aircraft.limit_source("alpha"), "highest")
    assert "lift is least there" in source_at(aircraft.limit_source("alpha"), "lowest")
    assert aircraft.limits["alpha"][1] == pytest.approx(16.0 * DEG_RAD, abs=0.3 * DEG_RAD)
    assert aircraft.limits["beta"][1] == pytest.approx(20.0 * DEG_RAD, rel=1e-2)
    assert aircraft.limit_source("beta") == "the tables of the model end there"
    assert source_at(aircraft.limit_source("V"), "highest").startswith("15 % above the fastest")
    assert aircraft.limit_source("phi") == ASSUMED


def test_an_engine_without_thrust_counts_as_none():
    """The propellers of the C-130 are driven by engines that JSBSim takes for jets: pounds of thrust for power."""
    found = adopted("C130")
    assert "thr" not in found.aircraft.controls
    assert any("counted as none" in words for words in found.found)


def test_a_trim_beside_another_is_the_same():
    found = adopted("B747")
    other = trim(found.aircraft, FlightCondition(150.0, found.trimmed.condition.h_m))
    beside = trim(found.aircraft, other.condition, near=found.trimmed)
    assert beside.alpha == pytest.approx(other.alpha, abs=1e-9)
    assert beside.controls == pytest.approx(other.controls, abs=1e-8)


def test_no_wheel_feels_the_ground_in_flight():
    """The F-16 raises its gear, and its leading-edge flaps ask whether there is weight on the wheels."""
    fdm = held("f16")
    for name in ("fcs/gear-wow", *(f"gear/unit[{i}]/WOW" for i in range(3))):
        assert fdm.get(name) == 0.0, name


@pytest.mark.parametrize(
    ("thrusts", "lever"),
    [({1.0: 0.3, 0.75: 0.4}, 1.0), ({1.0: 0.05, 0.75: 0.2, 0.5: 0.3}, 0.5), ({1.0: 0.05, 0.75: 0.04}, 1.0)],
)
def test_propellers_are_taken_back_from_full_speed_only_where_thrust_is_short(monkeypatch, thrusts, lever):
    """Thrusts of the weight by the position of the lever: enough at full speed is left, though less gives more."""
    mass = SimpleNamespace(mass_kg=1000.0)

    class Propelled:
        """An executive of one governed propeller."""

        propellers, at = SimpleNamespace(governed=True), 1.0

        def __init__(self, *_):
            self.command = self.place_at = self.evaluate = self.has = lambda *_: True

        def set(self, name, value):
            self.at = value

        def get(self, name):
            return thrusts.get(self.at, 0.0) * mass.mass_kg * G0_M_S2 / LBF_N

    monkeypatch.setattr(adopt_module, "Executive", Propelled)
    aircraft = SimpleNamespace(controls={"thr": None}, mass=mass)
    assert adopt_module._lever(aircraft, 1, FlightCondition(50.0, 1000.0)) == lever


@pytest.mark.parametrize(("lost", "slowest"), [((), 50.0), ((3,), 50.0), ((3, 4), 100.0 / 1.08**2.5)])
def test_one_speed_at_which_the_search_for_a_trim_fails_ends_no_range(monkeypatch, lost, slowest):
    """Steps of 8 % below 100 m/s: where one fails, the next says whether there is a trim; JSBSim's PC-7 loses one.

    Where two fail, the end lies between the last that trims and the first that does not: here at half a step.
    """
    first = SimpleNamespace(condition=FlightCondition(100.0, 1000.0))

    def trimmed(aircraft, condition, near, thorough):
        step = round(-np.log(condition.V_m_s / 100.0) / np.log(1.08))
        if step in lost:
            raise TrimError(f"step {step} must trim")
        return first

    monkeypatch.setattr(adopt_module, "trim", trimmed)
    found, _, (why, _) = adopt_module._sought(SimpleNamespace(), first)
    assert found == pytest.approx(slowest, rel=0.005)
    passed = f" (between these, none was found at {100.0 / 1.08**3:.3g} m/s)" if len(lost) == 1 else ""
    assert why == ("step 3 must trim" if len(lost) == 2 else f"no trim was sought beyond{passed}")


def test_the_range_of_a_model_is_sought_once_and_again_where_what_was_kept_is_damaged(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    sought = []

    def locked(*given, **more):
        raise PermissionError(13, "a folder of somebody else")

    def found(aircraft, first):
        sought.append(aircraft.name)
        return 20.0 / 3.0, 60.0, ("stall of à model", "no trim was sought beyond")

    monkeypatch.setattr(adopt_module, "_sought", found)
    first = SimpleNamespace(condition=FlightCondition(30.0, 1000.0))
    ranges = [adopt_module._range(SimpleNamespace(name=name), first) for name in ("one", "one", "two")]
    assert (sought, len(set(ranges))) == (["one", "two"], 1)
    for file in tmp_path.rglob("*.json"):
        file.write_text('{"slowest": 1.0}', encoding="utf-8")
    assert adopt_module._range(SimpleNamespace(name="one"), first) == ranges[0]
    assert sought == ["one", "two", "one"]
    with monkeypatch.context() as patch:
        patch.setattr(adopt_module, "read_json", locked)
        assert adopt_module._range(SimpleNamespace(name="one"), first) == ranges[0]
    assert len(sought) == 4


def test_the_angles_above_a_table_are_no_sideslips_in_any_of_its_planes():
    plane = '<tableData breakPoint="{}"> 40 50\n0 1 1\n0.2 1 1\n</tableData>'
    axes = (("row", "aero/mag-beta-rad"), ("column", "aero/alpha-deg"), ("table", "velocities/mach"))
    variables = "".join(f'<independentVar lookup="{lookup}">{name}</independentVar>' for lookup, name in axes)
    table = f"<table>{variables}{plane.format(0.1)}{plane.format(0.5)}</table>"
    xml = f"<fdm_config><aerodynamics><function>{table}</function></aerodynamics></fdm_config>"
    assert sideslip_of_tables(SimpleNamespace(xml=xml)) == (0.2, "the tables of the model end there")


def test_full_rudder_holds_a_sideslip_and_no_more_than_the_tables_hold():
    found = adopted("c172p")
    held = steady_sideslip(found.aircraft, found.trimmed)
    assert held is not None
    assert 10.0 * DEG_RAD < held < found.aircraft.limits["beta"][1]
    assert steady_sideslip(replace(found.aircraft, controls={}), found.trimmed) is None


def test_a_governor_in_a_system_of_the_models_own_is_jsbsims_at_rest():
    """A c182 whose propeller is governed as FlightGear's SenecaII is flies as the c182 that JSBSim governs."""
    source = read_source(find_model(ROOT / "aircraft" / "c182"))
    ((name, text),) = ((n, t) for n, t in source.engine_files.items() if "<propeller" in t)
    fixed = text.replace("</propeller>", "<constspeed>0</constspeed></propeller>")
    tree = ET.fromstring(source.xml)
    system = ET.fromstring(
        """<system name="governor"> <channel name="one"> <fcs_function name="own/away"> <function> <difference>
        <value>2400</value> <property>propulsion/engine[0]/propeller-rpm</property> </difference> </function>
        </fcs_function> <pid name="own/target"> <input>-own/away</input> <ki>0.5</ki>
        <output>propulsion/engine[0]/blade-angle</output> </pid> </channel> </system>"""
    )
    tree.insert([e.tag for e in tree].index("flight_control"), system)
    other = replace(
        source, xml=ET.tostring(tree, encoding="unicode"), engine_files={**source.engine_files, name: fixed}
    )
    found, wanted = adopt(other, SPEEDS["c182"]), adopted("c182")
    assert any("JSBSim's governor" in text for text in found.found)
    assert not any("JSBSim's governor" in text for text in wanted.found)
    assert dict(found.trimmed.controls) == pytest.approx(dict(wanted.trimmed.controls), abs=1e-6)
    assert found.trimmed.alpha == pytest.approx(wanted.trimmed.alpha, abs=1e-8)
