import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from testbench.aircraft import ScaleCoefficient
from testbench.aircraft.amend import Amendment
from testbench.aircraft.strips.loads import STRIPS, Shape, StripModel, Tail, Wing
from testbench.aircraft.strips.ritz import (
    Stiffness,
    asymmetric_modes,
    cantilever_bending,
    cantilever_torsion,
    symmetric_modes,
)
from testbench.core.errors import TrimError
from testbench.evaluation.modes import longitudinal_modes
from testbench.flight import FlightCondition, Manoeuvre, fly, linearise, load_aircraft, trim
from testbench.flight.air import Air
from testbench.inputs import InputSignal

ROOT = Path(__file__).resolve().parents[2]
SMALL = 1e-9
LIGHT_TAIL = Tail(1.0, SMALL, 0.1, 4.0, 0.3, 0.5, 0.05, 3.0, 0.1, 0.5, 0.6, SMALL, 0.0)
RIGID_BOOM = {"boom_up_N_m": 1e6, "boom_side_N_m": 1e6, "boom_roll_N_m": 1e6}


@pytest.fixture(scope="module")
def derive():
    spec = importlib.util.spec_from_file_location("derive", ROOT / "aircraft_models" / "eolo" / "derive.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def uniform_wing(**changes: float) -> Wing:
    settings = {
        "span_m": 4.0,
        "root_chord_m": 0.2,
        "taper": 1.0,
        "mass_kg": 2.0,
        "elastic_axis": 0.4,
        "centre_of_mass": 0.4,
        "gyration": 0.25,
        "lift_slope": 5.0,
        "quarter_chord_m": 0.0,
    }
    return Wing(**{**settings, **changes})


def test_a_uniform_wing_on_a_heavy_body_has_the_frequencies_of_the_textbook():
    """Cantilever: w = k^2 sqrt(EI / m' L^4) with k L = 1.8751, 4.6941; shaft: w = (pi/2) sqrt(GJ / I' L^2)."""
    wing = uniform_wing()
    EI, GJ = 200.0, 40.0
    modes = symmetric_modes(wing, LIGHT_TAIL, Stiffness(EI, GJ, 0.0, **RIGID_BOOM), mass_kg=1e5, Iyy=1e5)
    per_length, L = 0.5, 2.0
    expected = [k**2 * np.sqrt(EI / (per_length * L**4)) / (2 * np.pi) for k in (1.8751041, 4.6940911)]
    expected.append(0.5 * np.pi * np.sqrt(GJ / (per_length * (0.25 * 0.2) ** 2)) / L / (2 * np.pi))
    for f in expected:
        assert np.min(np.abs(modes.f_hz - f)) < 2e-3 * f


def test_elastic_modes_carry_neither_momentum_nor_angular_momentum(derive):
    """Mean axes: the wing, the fuselage and the tail move so that the centre of gravity and the pitch axis rest."""
    modes = symmetric_modes(derive.WING, derive.TAIL, derive.stiffness(), derive.mass, derive.Iyy)
    wing, tail = derive.WING, derive.TAIL
    m = wing.mass_per_length
    offset = (wing.centre_of_mass - wing.elastic_axis) * wing.chord
    body = derive.mass - wing.mass_kg - tail.mass_kg
    X_mass = wing.quarter_chord_m - (wing.elastic_axis - 0.25) * wing.chord - offset
    X_body = -(wing.both_sides(m * X_mass) - tail.mass_kg * tail.arm_m) / body
    for s, generalised in zip(modes.shapes[:3], modes.masses[:3], strict=True):
        wings = wing.both_sides(m * (s.bend - s.twist * offset))
        momentum = wings + body * (s.body_up + s.body_pitch * X_body) + tail.mass_kg * s.tail_up
        assert abs(momentum) < 1e-9 * np.sqrt(generalised * derive.mass)


def test_an_antisymmetric_wing_rolls_its_body_the_other_way(derive):
    modes = asymmetric_modes(derive.WING, derive.TAIL, derive.stiffness(), derive.Ixx)
    for s in modes.shapes[:4]:
        wing = derive.WING
        offset = (wing.centre_of_mass - wing.elastic_axis) * wing.chord
        rolling = wing.both_sides(wing.mass_per_length * -wing.y * (s.bend - s.twist * offset))
        body = derive.Ixx - wing.both_sides(wing.mass_per_length * wing.y**2) - derive.TAIL.roll_inertia_kg_m2
        tail = (
            derive.TAIL.roll_inertia_kg_m2 * s.tail_roll + derive.TAIL.mass_kg * derive.TAIL.mass_height_m * s.tail_side
        )
        assert abs(rolling + body * s.body_roll + tail) < 1e-8 * body


def test_assumed_shapes_meet_their_boundary_conditions():
    x = np.array([0.0, 1.0])
    for i in (1, 2, 3):
        shape, curvature = cantilever_bending(i, x)
        assert shape == pytest.approx([0.0, 1.0], abs=1e-9)
        assert abs(curvature[1]) < 1e-6 * abs(curvature[0])
    for i in (1, 2):
        twist, slope = cantilever_torsion(i, x)
        assert abs(twist[0]) < 1e-12
        assert abs(slope[1]) < 1e-9 * abs(slope[0])


@pytest.fixture
def strips():
    wing = uniform_wing()
    tail = replace(LIGHT_TAIL, area_m2=0.0, fin_area_m2=0.0)
    return StripModel(wing, tail, 0.8, 0.2, np.radians(3.0), 0.5, 0.05, (1.0, 2.0, 0.4))


def test_rigid_derivatives_of_a_rectangular_wing_in_closed_form(strips):
    """CL_alpha = a; Cl_p = -a/6 (rectangular wing, p b / 2V); Cl_beta = -a Gamma / 4; Cl_r = CL / 3."""
    a = 5.0
    assert strips.effect(strips.flow("alpha"))["CL"] == pytest.approx(a)
    assert strips.effect(strips.flow("p"))["Cl"] == pytest.approx(-a / 6.0, rel=1e-3)
    assert strips.effect(strips.flow("beta"))["Cl"] == pytest.approx(-a * np.radians(3.0) / 4.0, rel=1e-3)
    assert strips.effect(strips.flow("r"))["Cl"] == pytest.approx(0.5 / 3.0, rel=1e-3)


def test_a_mode_shape_that_is_a_rigid_motion_has_the_derivatives_of_that_motion(strips):
    """Heave at speed hdot is alpha = -hdot / V; rolling as a mode is p; their work and effects must be the same."""
    heave = Shape(np.ones(STRIPS), np.zeros(STRIPS), tail_up=1.0)
    rate = strips.flow_of_rate(heave)
    for name, value in strips.effect(strips.flow("alpha")).items():
        assert strips.effect(rate)[name] == pytest.approx(-2.0 / strips.cbar_m * value)
    roll = Shape(-strips.wing.y, np.zeros(STRIPS), tail_roll=1.0, symmetric=False)
    as_mode = strips.effect(strips.flow_of_rate(roll))["Cl"] * strips.cbar_m / strips.wing.span_m
    assert as_mode == pytest.approx(strips.effect(strips.flow("p"))["Cl"])
    pitch = Shape(-(0.4 - 0.25) * strips.wing.chord, np.ones(STRIPS), tail_up=-1.0, tail_pitch=1.0)
    turning, pitching = strips.effect(strips.flow_of_rate(pitch)), strips.effect(strips.flow("q"))
    assert turning["CL"] == pytest.approx(pitching["CL"])
    assert turning["Cm"] == pytest.approx(pitching["Cm"])


def test_forces_across_symmetries_are_nothing(strips):
    bend = Shape(strips.wing.y, np.zeros(STRIPS))
    assert strips.force(strips.flow("p"), bend) == 0.0


def test_an_elliptic_wing_on_a_lifting_line_has_glauerts_moments(derive):
    """A_1 = CL / pi AR, A_2 of the motion: Cl = -pi AR A_2 / 4, Cn = 3 pi AR A_1 A_2 / 4, and -CL / 8 of the tilt."""
    b, AR, CL = 4.0, 18.9, 0.7
    y = derive.sections(b)
    line = derive.LiftingLine(b, 4.0 * b / (np.pi * AR) * np.sqrt(1.0 - (2.0 * y / b) ** 2), CL, profile_drag=0.02)
    assert line.area_m2 == pytest.approx(b**2 / AR)
    assert line.lift_slope() == pytest.approx(2.0 * np.pi * AR / (AR + 2.0))
    assert line.moments("p")["Cl"] == pytest.approx(-np.pi / 4.0 * AR / (AR + 4.0))
    assert line.moments("p")["Cn"] == pytest.approx(-CL / 8.0 * (AR - 2.0) / (AR + 4.0))
    induced = -0.75 * CL**2 * (AR + 2.0) / (2.0 * np.pi * AR * (AR + 4.0))
    assert line.moments("r")["Cn"] == pytest.approx(induced - 0.02 / 4.0)  # 4 cd / S b^2 times the integral of c y^2


def test_lifting_line_and_strips_agree_on_what_both_give(derive):
    """Roll damping, roll due to yaw, aileron: strips have no induced antisymmetric downwash, some 2 / AR too much."""
    for motion in ("p", "r", "da"):
        line = derive.LINE.moments(motion, derive.MODEL.aileron)["Cl"]
        strips = derive.MODEL.effect(derive.MODEL.flow(motion))["Cl"]
        tail = derive.MODEL.effect(replace(derive.MODEL.flow(motion), wing=np.zeros(STRIPS)))["Cl"]
        assert 0.85 < line / (strips - tail) < 1.0, motion
    assert derive.LINE.lift_slope() == pytest.approx(derive.WING.lift_slope, rel=2e-3)  # Helmbold's formula


def test_yaw_damping_of_eolo_is_that_of_its_fin_and_wing(derive):
    """By hand: -2 Sv a / S (l / b)^2 of the fin; -cd times 8 / S b^2 times the integral of c y^2 of the right wing."""
    fin = -2.0 * derive.TAIL.fin_area_m2 * derive.TAIL.fin_slope / derive.S * (derive.TAIL.arm_m / derive.b) ** 2
    root, half = derive.WING.root_chord_m, 0.5 * derive.b
    profile = -8.0 * 0.015 / (derive.S * derive.b**2) * root * half**3 * (1.0 / 3.0 - (1.0 - derive.TAPER) / 4.0)
    assert fin == pytest.approx(-0.0274, abs=5e-5)
    induced = derive.rigid()["Cn_r"] - fin - profile
    assert -0.003 < induced < -0.0025  # an elliptic wing of that CL and AR: -0.0027
    assert load_aircraft("eolo").coefficient("Cn_r") == derive.rigid()["Cn_r"]


def test_the_files_of_eolo_hold_what_the_script_derives(derive):
    for path, text in derive.amended_files().items():
        assert path.read_text(encoding="utf-8") == text, f"run aircraft_models/eolo/derive.py --write ({path.name})"


@pytest.mark.parametrize(("rms_m_s", "share"), [(0.0, 1e-6), (0.5, 0.05)])
def test_longitudinal_flight_does_not_hang_on_the_yawing_moments(rms_m_s, share):
    """The elevator 3-2-1-1 of the blind test, by the estimates of Cn_p, Cn_r and Cn_da that stood in eolo.xml before.

    Largest difference over the standard deviation of the channel; gusts from the side reach it by way of the bank.
    """
    now = load_aircraft("eolo", "rigid")
    before = {"Cn_r": -0.1, "Cn_p": -0.06, "Cn_da": -0.01}
    scaled = tuple(ScaleCoefficient(name, value / now.coefficient(name)) for name, value in before.items())
    air = Air(turbulence_rms_m_s=(rms_m_s,) * 3, seed=3) if rms_m_s else None
    u = np.zeros((4000, 1))
    for start, stop, sign in ((0, 3, 1), (3, 5, -1), (5, 6, 1), (6, 7, -1)):
        u[150 * start : 150 * stop] = 0.045 * sign
    signal = InputSignal(np.arange(4000) / 500.0, u, ("de",))
    flown = []
    for aircraft in (now, replace(now, amendments=(Amendment("before", "", scaled),))):
        trimmed = trim(aircraft, FlightCondition(16.0, 547.0))
        flown.append(fly(aircraft, trimmed, Manoeuvre("3-2-1-1", signal, 2.0), 50.0, air=air))
    for channel in ("V", "alpha", "q", "theta", "az"):
        assert np.max(np.abs(flown[1][channel] - flown[0][channel])) < share * np.std(flown[0][channel]), channel
    assert np.max(np.abs(flown[1]["r"] - flown[0]["r"])) > 1e-6  # the yaw itself moves


def test_eolo_begins_to_vibrate_near_20_m_s():
    """As seen in flight (EOLO paper, section 3.2): an elastic mode loses its damping from 19.5 to 21.5 m/s."""
    eolo = load_aircraft("eolo")

    def least_damping(V: float) -> float:
        poles = linearise(eolo, trim(eolo, FlightCondition(V, 547.0))).poles()
        elastic = poles[poles.imag > 40.0]
        return float(np.min(-elastic.real / np.abs(elastic)))

    assert all(least_damping(V) > 0.0 for V in (12.0, 14.0, 16.0, 18.0, 19.5))
    assert least_damping(21.5) < 0.0


def test_eolo_has_the_poles_of_the_identified_model():
    """Printed A of the EOLO paper at 100 Hz: 0.004 +- 0.465j and -4.34 1/s; its speed is not stated (SOURCES.md)."""
    eolo = load_aircraft("eolo")
    condition = FlightCondition(18.0, 547.0)
    named = {i: m.name for i, m in enumerate(eolo.elastic.modes, 1) if m.symmetry == "symmetric"}
    flexible = longitudinal_modes(linearise(eolo, trim(eolo, condition)), named)
    assert abs(flexible["phugoid"]) == pytest.approx(0.465, rel=0.03)
    assert abs(flexible["phugoid"].real) < 0.02
    stiff = eolo.with_rigid_wings()
    rigid = longitudinal_modes(linearise(stiff, trim(stiff, condition)), {})
    assert rigid["short period, fast root"] == pytest.approx(-4.34, rel=0.1)
    assert abs(rigid["phugoid"]) == pytest.approx(0.465, rel=0.2)


def test_eolo_trims_from_11_to_25_m_s():
    eolo = load_aircraft("eolo")
    for V in (11.0, 13.0, 16.0, 19.0, 22.0, 25.0):
        assert np.max(np.abs(trim(eolo, FlightCondition(V, 547.0)).residual)) < 1e-9
    with pytest.raises(TrimError):
        trim(eolo, FlightCondition(9.0, 547.0))
