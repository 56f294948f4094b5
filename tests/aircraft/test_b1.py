"""The B-1-like surrogate: that it has the numbers it claims, and the modes that follow from them by hand."""

from dataclasses import replace

import numpy as np
import pytest
from structure_alone import uncoupled

from testbench.aircraft.amend import Amendment, ScaleCoefficient
from testbench.core.constants import DEG_RAD
from testbench.core.paths import AIRCRAFT_MODELS
from testbench.evaluation.modes import frequency_and_damping, longitudinal_modes
from testbench.flight import FlightCondition, Manoeuvre, fly, linearise, load_aircraft, trim
from testbench.flight.executive import Executive
from testbench.flight.trim import place_at_trim
from testbench.inputs.signal import InputSignal
from testbench.questions.run.ask import run
from testbench.questions.run.scenario import Scenario

CONDITION = FlightCondition(200.6, 1524.0)  # Mach 0.6 at 5000 ft
RATE_HZ = 200.0
OMEGA_RAD_S = (12.57, 14.07, 21.17, 22.05)


@pytest.fixture(scope="module")
def b1():
    return load_aircraft("b1")


@pytest.fixture(scope="module")
def b1_trim(b1):
    return trim(b1, CONDITION)


@pytest.fixture(scope="module")
def rigid(b1):
    return b1.with_rigid_wings()


def modes_of(aircraft):
    elastic = aircraft.elastic.modes if aircraft.elastic else ()
    poles = longitudinal_modes(
        linearise(aircraft, trim(aircraft, CONDITION)), {i: m.name for i, m in enumerate(elastic, 1)}
    )
    return {name: frequency_and_damping(pole) for name, pole in poles.items()}


def step_of(control, amplitude, seconds=4.0):
    n = int(seconds * RATE_HZ)
    return Manoeuvre("step", InputSignal(np.arange(n) / RATE_HZ, np.full((n, 1), amplitude), (control,)), 1.0)


def test_every_place_says_that_the_data_are_recalled(b1):
    words = ("surrogate", "recalled from memory", "unverified")
    texts = [b1.title, b1.xml, (AIRCRAFT_MODELS / "b1" / "SOURCES.md").read_text(encoding="utf-8")]
    assert all(word in text.lower() for text in texts for word in words)


def test_si_values_are_those_of_the_recalled_units(b1):
    """To the three or four figures that the conversion kept."""
    slug_ft2, lb, ft = 1.35581795, 0.45359237, 0.3048
    g, m = b1.geometry, b1.mass
    assert m.mass_kg == pytest.approx(288_017 * lb, rel=5e-4)
    assert [m.Ixx, m.Iyy, m.Izz, m.Ixz] == pytest.approx(
        [x * slug_ft2 for x in (0.95e6, 6.4e6, 7.1e6, -52_700)], rel=1e-3
    )
    assert [g.S_m2, g.b_m, g.cbar_m] == pytest.approx([1946 * ft**2, 70 * ft, 15.3 * ft], rel=5e-4)
    masses = [e.mass_kg_m2 for e in b1.elastic.modes]
    assert masses == pytest.approx([x * slug_ft2 for x in (184, 9587, 1334, 436_000)], rel=5e-4)
    assert [e.omega_rad_s for e in b1.elastic.modes] == pytest.approx(OMEGA_RAD_S, rel=1e-7)
    assert {e.zeta for e in b1.elastic.modes} == {0.02}


def test_rigid_trim_is_that_of_lift_and_moment_by_hand(rigid):
    """CL = W / (qbar S) and Cm = 0 give 0.75 and -6.09 deg; the upward part of the thrust is 0.1 % of the weight."""
    trimmed = trim(rigid, CONDITION)
    qbar_S = CONDITION.qbar_Pa * 180.8
    A = np.array([[2.92, 0.435], [-1.66, -2.578]])
    alpha, de = np.linalg.solve(A, [130_640 * 9.80665 / qbar_S - 0.34, 0.252])
    assert (alpha / DEG_RAD, de / DEG_RAD) == pytest.approx((0.8, -6.1), abs=0.05)  # figures as stated, rounded
    assert trimmed.alpha == pytest.approx(alpha, abs=0.06 * DEG_RAD)  # gravity and the Earth's turning: 0.3 % of CL
    assert trimmed.controls["de"] == pytest.approx(de, abs=0.06 * DEG_RAD)
    assert 0.1 < trimmed.controls["thr"] < 0.6


def test_rigid_modes_are_those_stated(rigid):
    """Stated: short period 1.97 rad/s, 0.32 (without Cm_alphadot); phugoid 0.065 rad/s, 0.07. Half a last figure."""
    got = modes_of(rigid)
    assert got["phugoid"] == pytest.approx((0.065, 0.07), abs=0.005)
    assert got["short period"][0] == pytest.approx(1.97, abs=0.005)
    bare = modes_of(rigid.amended(Amendment("no lag", "no downwash lag", (ScaleCoefficient("Cm_alphadot", 0.0),))))
    assert bare["short period"] == pytest.approx((1.97, 0.32), abs=0.005)
    # -Cm_alphadot adds qbar S cbar^2 / (2 V Iyy) 4.3 to 2 zeta wn
    added = 4.3 * CONDITION.qbar_Pa * 180.8 * 4.663**2 / (2 * 200.6 * 8.677e6) / (2 * 1.968)
    assert got["short period"][1] - bare["short period"][1] == pytest.approx(added, rel=0.03)


def test_flexible_modes_are_those_stated(b1):
    """Stated: short period 1.84 rad/s, 0.34, mode 1 12.59 rad/s, 0.05, by hand with mode 1 alone, no Cm_alphadot."""
    got = modes_of(b1)
    assert got["short period"][0] == pytest.approx(1.84, rel=0.01)
    assert got["short period"][1] == pytest.approx(0.34 + 0.026, abs=0.01)
    assert got["1st symmetric mode"] == pytest.approx((12.59, 0.05), rel=0.03)
    assert got["phugoid"] == pytest.approx((0.065, 0.07), rel=0.10)  # 7 % slower by static deflection with speed
    for name, omega in zip(("2nd", "3rd", "4th"), OMEGA_RAD_S[1:], strict=True):
        assert got[f"{name} symmetric mode"] == pytest.approx((omega, 0.02), rel=0.02)


def test_static_deflection_of_mode_1_takes_away_stability(b1):
    """By hand: eta_1 = -6.8 per rad of alpha, so that Cm_alpha loses 13 % (+0.217) and CL_alpha 0.195."""
    K, _, gain = b1.elastic.matrices(CONDITION.qbar_Pa, 200.6)
    mode = b1.elastic.modes[0]
    per_rad = gain[0] * mode.force["alpha"] / K[0, 0]
    assert per_rad == pytest.approx(-6.8, abs=0.05)
    assert mode.effect_eta["Cm"] * per_rad == pytest.approx(0.217, abs=0.001)
    assert mode.effect_eta["CL"] * per_rad == pytest.approx(-0.195, abs=0.001)


def test_chosen_modal_damping_adds_what_it_should(b1):
    _, D, _ = b1.elastic.matrices(CONDITION.qbar_Pa, 200.6)
    assert D[0, 0] - 2 * 0.02 * 12.57 == pytest.approx(0.75, abs=0.005)
    assert D[1, 1] == pytest.approx(2 * 0.02 * 14.07)


def test_uncoupled_modes_ring_at_frequency_and_damping_of_the_structure(b1):
    """Every mode kicked through JSBSim's own functions; the exact step leaves rounding alone."""
    bare = replace(b1, elastic=uncoupled(b1.elastic))
    fdm = Executive(bare, RATE_HZ, CONDITION)
    place_at_trim(fdm, trim(bare, CONDITION))
    for i in range(1, 5):
        fdm.set(f"modal/eta-{i}", 0.01 * i)
    nodes = [fdm.node(f"modal/{kind}-{i}") for kind in ("eta", "etadot") for i in range(1, 5)]
    states = []
    for _ in range(300):
        fdm.fdm.run()
        states.append([n.get_double_value() for n in nodes])
    x = np.array(states)
    for i, omega in enumerate(OMEGA_RAD_S):
        own = x[:, [i, i + 4]]
        step = np.linalg.lstsq(own[:-1], own[1:], rcond=None)[0]
        s = np.log(np.linalg.eigvals(step).astype(complex)[0]) * RATE_HZ
        assert abs(s) == pytest.approx(omega, rel=1e-6)
        assert -s.real / abs(s) == pytest.approx(0.02, rel=1e-6)


def test_lateral_modes_are_stable_and_of_a_large_aircraft(rigid):
    poles = linearise(rigid, trim(rigid, CONDITION)).subsystem(["v", "p", "r", "phi"]).poles()
    wn, zeta = frequency_and_damping(next(p for p in poles if p.imag > 0))
    spiral, roll = sorted((p.real for p in poles if abs(p.imag) < 1e-9), key=abs)
    assert 0.7 < wn < 1.5
    assert 0.02 < zeta < 0.2
    assert -1 / 20.0 < spiral < 0.0
    assert 0.3 < -1 / roll < 1.4


def test_signs_of_the_controls(b1, b1_trim):
    """Elevator down pitches down, aileron rolls right, rudder yaws left, throttle speeds up; 0.5 s after the step."""
    for control, channel, sign in (("de", "q", -1), ("da", "p", 1), ("dr", "r", -1)):
        record = fly(b1, b1_trim, step_of(control, 0.5 * DEG_RAD), 50.0)
        assert np.sign(record[channel][75] - record[channel][0]) == sign
    faster = fly(b1, b1_trim, step_of("thr", 0.05), 50.0)
    assert faster["V"][-1] > 200.6 + 0.1


def test_undisturbed_flight_stays_in_trim(b1, b1_trim):
    """For 5 s. Trim is without pitch rate, so that the round Earth sinks away below it by V / R = 3.1e-5 rad/s."""
    record = fly(b1, b1_trim, step_of("de", 0.0), 50.0)
    horizon = 200.6 / 6.37e6 * record.duration_s
    assert np.ptp(record["theta"]) < 1.2 * horizon
    assert np.ptp(record["alpha"]) < 0.1 * horizon
    assert np.ptp(record["q"]) < 0.1 * horizon
    assert np.ptp(record["V"]) < 0.5 * 9.81 * horizon * record.duration_s
    assert np.ptp(record["eta_1"]) < 1e-4


def test_loads_and_runs_in_stock_jsbsim(capfd):
    """The folder as it is, by JSBSim alone: the thrust is four times 136 kN times throttle times (1 - V / 1000 m/s)."""
    import jsbsim

    fdm = jsbsim.FGFDMExec(None)
    fdm.set_debug_level(0)
    fdm.set_aircraft_path(str(AIRCRAFT_MODELS))
    assert fdm.load_model("b1")
    fdm["ic/h-sl-ft"], fdm["ic/vt-fps"], fdm["ic/alpha-deg"] = 5000.0, 200.6 / 0.3048, 0.75
    fdm["fcs/throttle-cmd-norm"] = 0.5
    fdm.run_ic()
    fdm.get_propulsion().init_running(-1)
    fdm.run_ic()
    for _ in range(5):
        assert fdm.run()
    speed = fdm["velocities/vt-fps"] * 0.3048
    thrust = fdm["forces/fbx-prop-lbs"] * 4.4482216152605
    assert thrust == pytest.approx(4 * 136e3 * 0.5 * (1 - speed / 1000.0), rel=1e-4)
    capfd.readouterr()


@pytest.fixture(scope="module")
def study():
    return run(Scenario.load("b1_alpha"), causes=False)


def test_alpha_repairs_the_model_of_the_papers_horizons_and_a_long_future_needs_no_repair(study):
    """Seed 1. Mean MRSE of V, q, theta, ten seeds: 28 +- 11 % without alpha, 12 +- 2 % with it, 10 +- 0.5 % long."""
    mean = {}
    for case in study.cases:
        scores = case.evaluation.identification.mrse_percent
        mean[case.label] = np.mean([m for o, m in zip(case.model.outputs, scores, strict=True) if o != "alpha"])
    assert mean["b1_no_alpha, paper's horizons"] > 2.0 * mean["b1_alpha, paper's horizons"]
    assert mean["b1_alpha, paper's horizons"] < 16.0
    assert mean["b1_no_alpha, long future"] == pytest.approx(mean["b1_alpha, long future"], rel=0.1)
    assert mean["b1_no_alpha, long future"] < 12.0


def test_the_study_stays_near_trim_and_excites_the_rigid_modes_alone(study):
    for flight in study.flights:
        record = flight.truth
        assert np.max(np.abs(record["alpha"] - record["alpha"][0])) < 3.0 * DEG_RAD
        assert np.max(np.abs(record["V"] - 200.6)) < 2.5
        assert np.max(np.abs(record["h"] - 1524.0)) < 60.0
    verdicts = {e.mode: e.excited for e in study.truth.excitation}
    assert verdicts == {m: m in ("phugoid", "short period") for m in verdicts}
    assert len(verdicts) == 6
