"""Aircraft made from their plans: signs in flight, the form of the packaged models, and what is said of the numbers."""

import math
import shutil
import tomllib
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from testbench.aircraft.geometry.aerodynamics import Aerodynamics, Method
from testbench.aircraft.geometry.build import _chords
from testbench.aircraft.geometry.coefficients import ROWS, coefficients
from testbench.aircraft.geometry.model_xml import engine_files
from testbench.aircraft.geometry.propulsion import LEAST_THROTTLE, equilibrium, fit, thrust_law
from testbench.aircraft.geometry.read import read_plan
from testbench.aircraft.geometry.schema import Motor, Propeller
from testbench.aircraft.outline import Surface
from testbench.core.constants import G0_M_S2
from testbench.core.errors import ScenarioError
from testbench.core.paths import AIRCRAFT_MODELS
from testbench.flight import load_aircraft
from testbench.questions.aircraft.contract import aircraft_laws

pytest.importorskip("aerosandbox", reason="needs the extra geometry: pip install flight-testbench[geometry]")
PLANS = Path(__file__).parent / "plans"
ROOT = Path(__file__).resolve().parents[3]
KINDS = {
    "taurus": AIRCRAFT_MODELS / "taurus" / "geometry.toml",
    "vtail": PLANS / "vtail.toml",
    "flying_wing": PLANS / "flying_wing.toml",
    "twin_fins": PLANS / "twin_fins.toml",
    "trainer": PLANS / "trainer.avl",
}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Every kind of aircraft, made and written, by name: (made, folder)."""
    from testbench.aircraft.geometry.build import model_from_plan

    place = tmp_path_factory.mktemp("aircraft")
    out = {}
    for name, path in KINDS.items():
        found = model_from_plan(read_plan(path, PLANS / "trainer_mass.toml" if path.suffix == ".avl" else None), name)
        found.write(place / name)
        out[name] = (found, place / name)
    return out


@pytest.mark.parametrize("name", KINDS)
def test_every_kind_keeps_the_laws_of_aircraft(made, name):
    broken = [f"{law.words}: {law.why}" for law in aircraft_laws(load_aircraft(made[name][1])) if not law.holds]
    assert not broken


@pytest.mark.parametrize("name", KINDS)
def test_the_folder_holds_what_was_computed(made, name):
    found, folder = made[name]
    aircraft = load_aircraft(folder)
    for c in found.coefficients.values():
        if c.name != "CD":
            assert aircraft.coefficient(c.name) == pytest.approx(c.used, rel=1e-5)
        assert aircraft.uncertainty[c.name] == pytest.approx(c.deviation, rel=5e-3)
    assert aircraft.coefficient("CL_alpha") > 0.0 > aircraft.coefficient("Cm_q")
    for control, servo in found.plan.servos.items():
        assert aircraft.controls[control].full == pytest.approx(math.radians(servo.throw_deg))
    assert aircraft.outline is not None
    assert aircraft.outline.wing.area_m2 == pytest.approx(found.plan.plane.wing.projected_m2, rel=1e-3)
    assert aircraft.outline.wing.mean_chord_m == pytest.approx(found.plan.plane.wing.mean_chord_m, rel=1e-3)
    sources = (folder / "SOURCES.md").read_text(encoding="utf-8")
    assert all(f"| {n} |" in sources for n in found.coefficients)
    assert all((folder / n).is_file() for n in found.copies)


def test_kinds_have_what_their_surfaces_give(made):
    flying_wing, vtail = made["flying_wing"][0], made["vtail"][0]
    assert not {"Cm_alphadot", "CL_alphadot"} & set(flying_wing.coefficients)  # no tail, no lag of the downwash
    assert {"Cm_alphadot", "Cn_dr", "Cm_de"} <= set(vtail.coefficients)
    assert load_aircraft(made["flying_wing"][1]).outline.tail is None
    assert load_aircraft(made["vtail"][1]).outline.fin is None
    assert load_aircraft(made["twin_fins"][1]).outline.fin.y_m == pytest.approx(0.35)


def test_the_tail_lags_by_the_formula_that_is_stated(made):
    """Cm_alphadot = 2 Cm_a,t eps' l / c, and the moment is the lift times the arm."""
    found = made["taurus"][0]
    plane = found.plan.plane
    arm = plane.surfaces[1].quarter_chord_m[0] - plane.wing.quarter_chord_m[0]
    cm, cl = (found.found.lattice.values[f"{c}_alphadot"] for c in ("Cm", "CL"))
    assert -cm / cl == pytest.approx(plane.surfaces[1].quarter_chord_m[0] / plane.cbar_m, rel=0.06)
    a_t = cl / (2.0 * found.found.lattice.downwash * arm / plane.cbar_m) * plane.S_m2 / plane.surfaces[1].area_m2
    A = plane.surfaces[1].span_m ** 2 / plane.surfaces[1].area_m2
    assert a_t / 0.9 == pytest.approx(2.0 * math.pi * A / (2.0 + math.sqrt(A**2 + 4.0)), rel=0.08)  # Helmbold


def test_servos_are_those_of_the_packaged_model(made):
    """The plan of Taurus has its throws and servos: every channel of them is the same element."""
    ours = ET.fromstring((made["taurus"][1] / "taurus.xml").read_text(encoding="utf-8"))
    theirs = ET.parse(AIRCRAFT_MODELS / "taurus" / "taurus.xml").getroot()

    def plain(element):
        numbers = [
            f"{float(t):.5g}" if t.replace(".", "").replace("-", "").isdigit() else t for t in element.itertext()
        ]
        return [(e.tag, e.get("name")) for e in element.iter()], [t.strip() for t in numbers if t.strip()]

    for kind in ("property", "function", "channel"):
        both = [
            {
                e.get("name") or e.text: plain(e)
                for e in tree.findall(f"flight_control/{kind}")
                if e.get("name") != "thrust"
            }
            for tree in (ours, theirs)
        ]
        assert both[0] == both[1], kind
    assert [a.get("name") for a in ours.iter("axis")] == [a.get("name") for a in theirs.iter("axis")]


def test_motor_and_propeller_are_those_of_the_packaged_law():
    """With the propeller, motor power and grid of aircraft_models/taurus/derive.py: the terms of taurus.xml."""
    p = Propeller(diameter_m=0.3048, pitch_m=0.1524, power_W=174.46 + 70.135 - 4.39)
    throttle, V = np.linspace(LEAST_THROTTLE, 1.0, 24), np.linspace(6.0, 22.0, 17)
    exact = np.array([[equilibrium(p, 1.2133, t, v) for v in V] for t in throttle])
    found, _ = fit(throttle, V, exact)
    tree = ET.parse(AIRCRAFT_MODELS / "taurus" / "taurus.xml").getroot()
    terms = tree.findall(".//fcs_function[@name='fcs/thrust-fraction']/function/sum/product")
    assert found == pytest.approx([14.0 * float(t.find("value").text) for t in terms], rel=2e-4)
    assert equilibrium(p, 1.2133, 1.0, 0.0) == pytest.approx(14.2, abs=0.05)  # SOURCES.md of taurus


def test_a_straight_line_and_a_propeller_that_pushes_nothing():
    law = thrust_law(Motor(static_thrust_N=45.0, zero_thrust_V_m_s=36.0), 1.2, (8.0, 30.0))
    assert [law.at(1.0, 0.0), law.at(0.5, 18.0), law.at(1.0, 40.0)] == pytest.approx([45.0, 11.25, 0.0])
    watts = float(ET.fromstring(engine_files(law)["motor.xml"]).find("power").text)
    assert watts == pytest.approx(45.0 / 4.4482216 * 745.7 / 550.0, rel=1e-6)
    with pytest.raises(ScenarioError, match="more pitch or more power"):
        thrust_law(Motor(propeller=Propeller(diameter_m=0.1, pitch_m=0.03, power_W=20.0)), 1.2, (30.0, 60.0))


def test_lift_carries_the_weight_at_the_design_speed(made):
    from testbench.flight import FlightCondition, trim

    found, folder = made["twin_fins"]
    trimmed = trim(load_aircraft(folder), FlightCondition(18.0, 100.0))
    assert trimmed.alpha == pytest.approx(found.found.alpha_rad, abs=math.radians(1.0))  # the elevator takes the rest
    weight = 5.0 * G0_M_S2
    assert pytest.approx(weight / (0.5 * 1.2133 * 18.0**2 * 0.72), rel=1e-3) == found.found.CL


def test_a_deviation_has_a_part_that_goes_with_the_value_and_one_that_does_not():
    a = {"CL_alpha": 5.0, "Cm_alpha": -0.1, "Cm_q": -20.0, "Cn_r": -0.005, "CL0": 0.0}
    b = {"CL_alpha": 5.01, "Cm_alpha": -0.1, "Cm_q": -10.0, "Cn_r": -0.005, "CL0": 0.0}
    found = coefficients(
        Aerodynamics(Method(a, 0.05, 0.3), Method(b, 0.05, 0.3), 0.05, 0.5, 0.02, 0.1, 0.0, (-0.2, 0.2)), 0.01
    )
    assert set(found) == {"CL_alpha", "Cm_alpha", "Cm_q", "Cn_r", "CD"}  # CL0 is zero by both
    assert found["CL_alpha"].deviation == ROWS["CL_alpha"].spread
    assert found["Cm_q"].used == pytest.approx(-10.0 * ROWS["Cm_q"].bias)
    assert (found["CL_alpha"].apart, found["Cm_q"].apart) == (False, True)
    absolute = math.sqrt(found["Cm_alpha"].deviation ** 2 - ROWS["Cm_alpha"].spread ** 2) * 0.1
    assert absolute == pytest.approx(ROWS["Cm_alpha"].floor * 5.01)  # a small static margin is known badly
    assert found["Cn_r"].deviation > 1.9  # that of a flying wing is not known but for its size
    assert found["CD"].used == pytest.approx(0.03 + 0.05 * 0.4**2)


def test_no_spread_is_below_what_the_gap_workflow_takes_for_any_method():
    from testbench.questions.gap.priors import LATERAL_PRIORS, PRIORS

    for name, general in {**PRIORS, **LATERAL_PRIORS}.items():
        assert ROWS[name].spread >= general, name


def test_a_drawn_trapezoid_keeps_area_and_mean_chord():
    root, tip = _chords(0.2, 0.21, False)
    drawn = Surface(span_m=2.0, root_chord_m=root, tip_chord_m=tip, x_m=0.0)
    assert (drawn.area_m2, drawn.mean_chord_m) == (pytest.approx(0.4), pytest.approx(0.21))


def test_a_coefficient_that_the_model_lacks_is_refused(made, tmp_path):
    folder = made["vtail"][1]
    text = (folder / "aircraft.toml").read_text(encoding="utf-8")
    assert tomllib.loads(text)["uncertainty"]["Cm_q"] >= 0.15
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    (tmp_path / "aircraft.toml").write_text(text.replace("\nCm_q = ", "\nCm_qq = "), encoding="utf-8")
    with pytest.raises(
        ScenarioError, match=r"uncertainty.Cm_qq: the model must have this coefficient; did you mean 'Cm_q'"
    ):
        load_aircraft(tmp_path)


def test_a_glider_loads_without_engine_and_throttle(made, tmp_path):
    from testbench.aircraft.geometry.model_xml import model_xml
    from testbench.flight import FlightCondition
    from testbench.flight.executive import Executive

    found, folder = made["vtail"]
    plan = replace(found.plan, title="A glider", said=found.plan.said.model_copy(update={"motor": None}))
    xml = model_xml("vtail", "", plan, found.coefficients, found.polar, None)
    (tmp_path / "vtail.xml").write_text(xml, encoding="utf-8")
    text = (folder / "aircraft.toml").read_text(encoding="utf-8")
    throttle = '[controls.thr]\ncommand = "fcs/throttle-cmd-norm"\n'
    assert throttle in text
    (tmp_path / "aircraft.toml").write_text(text.replace(throttle, ""), encoding="utf-8")
    flown = Executive(load_aircraft(tmp_path), 240.0, FlightCondition(12.0, 100.0))
    assert set(flown.command_nodes) == {"de", "da", "dr"}
    assert not {"thr", "thrust"} & set(flown.channels)
