"""Contract of every effect of the library: words, bounds, no effect at zero, flight, and recovery from its own data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_fits import fits
from scipy.signal import lsim

from testbench.core.contract import LawError
from testbench.core.record import FlightRecord
from testbench.effects import EFFECTS
from testbench.flight import FlightCondition, linearise, load_aircraft, trim
from testbench.questions.gap import effect_contract as contract
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.effect_contract import CONDITION, RATE_HZ
from testbench.questions.gap.search.point import Point
from testbench.sensors import load_suite

# Effects that show in no record of a few manoeuvres at one height whose channels are compared about their means.
UNSEEN = {n for n in EFFECTS if n.endswith("_bias")} | {"surface_offset", "steady_wind", "ground_effect"}
UNSEEN |= {n for n, e in EFFECTS.items() if e.lateral}  # nor without aileron and rudder: test_lateral_gap.py
OF_ONE_RECORD = {n for n, e in EFFECTS.items() if e.met is not None}  # not of the aircraft: test_gusts.py
UNSEEN |= OF_ONE_RECORD
# What is put into the data, where the first start of an effect would not do.
TRUE = {
    "actuator_lag": {"lag_rad_s": 15.0},
    "rate_limit": {"limit_rad_s": 0.25},
    "asymmetric_rate_limit": {"down_rad_s": 0.15, "up_rad_s": 0.4},
    "second_order_actuator": {"omega_rad_s": 20.0, "zeta": 0.6},
    "creeping_free_play": {"width_rad": 0.02, "creep_1_s": 6.0, "power": 3.0},
    "wing_bending": {"f_hz": 5.0, "mass_ratio": 0.083, "twist_rad": 0.05, "lever": 0.04},
    "wing_torsion": {"f_hz": 9.0, "share": 0.4, "lever": 0.06},
    "elevator_mode": {"f_hz": 5.2, "Cm_eta": 0.15},
    "stall": {"alpha_rad": 0.13, "sharpness": 18.0, "CD": 0.05},
    "stall_hysteresis": {"alpha_rad": 0.13, "sharpness": 18.0, "CD": 0.05, "time_s": 0.2},
    "wake_lag": {"time_s": 0.25, "Cm_wake": 0.5},
    "payload": {"ratio": 0.15, "aft_chords": 0.3},
    "slipstream": {"k": 5.0},
    "speed_effectiveness": {"k": 1.0, "curve": -0.5},
    "nonlinear_lift": {"CL_alpha2": -6.0},
    "thrust_lag": {"lag_s": 0.6},
    "thrust_lapse": {"scale": 0.9, "k": 0.6},
    "cg_shift": {"aft_chords": -0.015},
}
SHOWN = [n for n in EFFECTS if n not in UNSEEN and EFFECTS[n].over_time is None]
# The errors of one sensor stand for those of the others, which take the same code; those are slow tests.
LONG = {
    "wing_torsion",
    "wing_bending",
    "stall",
    "stall_hysteresis",
    "payload",
    "cg_shift",
    "elevator_mode",
}  # up to half a minute each
# More general forms take the code of what they generalise, which stays.
GENERAL = {
    "asymmetric_rate_limit",
    "creeping_free_play",
    "delayed_servo",
    "filtered_pitch_damper",
    "washed_pitch_damper",
}
OF_OTHER_SENSORS = {n for n in SHOWN if n.partition("_")[0] in ("V", "q", "theta", "az")} - {"V_cross", "az_position"}
# Effects of which these records tell some combinations of parameters only, or a size that the priors of the
# coefficients take up (a shift of the centre of gravity is one of Cm_alpha): the gap must close all the same.
LOOSE = {"wing_bending", "wing_torsion", "payload", "stall", "stall_hysteresis", "wake_lag", "cg_shift"}


@pytest.fixture(scope="module")
def believed() -> Believed:
    return contract.believed()


@pytest.fixture(scope="module")
def commands() -> tuple[FlightRecord, ...]:
    return contract.commands()


def trial(name: str, believed: Believed) -> contract.Trial:
    """Return an effect under trial on an aircraft that the other trials use, too."""
    parameters = [p.name for p in EFFECTS[name].parameters]
    # all their parameters vanish, not only those that say so
    zero = dict.fromkeys(parameters, 0.0) if name in ("free_play", "thrust_lag", "transport_delay") else None
    out = contract.Trial(EFFECTS[name], zero)
    out.__dict__["believed"] = believed
    return out


@pytest.mark.parametrize("law", contract.OF_WORDS, ids=lambda law: law.__name__)
@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_keeps_the_laws_of_words(name, law, believed):
    assert law(trial(name, believed)) is None


@pytest.mark.sampled(len(contract.OF_AIRCRAFT))
@pytest.mark.parametrize("law", contract.OF_AIRCRAFT, ids=lambda law: law.__name__)
@pytest.mark.parametrize("name", [n for n in EFFECTS if n not in OF_ONE_RECORD])
def test_every_effect_keeps_the_laws_of_aircraft(name, law, believed):
    assert law(trial(name, believed)) is None


def test_effects_that_break_a_law_are_told_which(believed):
    """One law each: words, a place on the path, a start beyond its bounds, no change, a size that never vanishes."""
    good = EFFECTS["drag_increment"]
    size = good.parameters[0]
    for broken, law, words in (
        (replace(good, physics="Drag."), contract.it_says_in_words_what_it_is, "two sentences"),
        (replace(good, upstream=9), contract.it_names_where_it_acts, "FORCES"),
        (
            replace(good, parameters=(replace(size, starts=(0.9,)),)),
            contract.its_parameters_have_units_and_start_within_their_bounds,
            "between",
        ),
        (
            replace(good, amend=lambda a, s, v: (a, s)),
            contract.it_changes_aircraft_or_sensors_and_leaves_what_it_was_given,
            "must change",
        ),
        (
            replace(good, parameters=(replace(size, none=0.01),)),
            contract.without_size_it_changes_nothing,
            "nothing must change",
        ),
    ):
        case = contract.Trial(broken)
        case.__dict__["believed"] = believed
        with pytest.raises(LawError, match=words):
            law(case)
    with pytest.raises(Exception, match="pickle"):
        contract.it_goes_from_process_to_process(contract.Trial(replace(good, amend=lambda a, s, v: (a, s))))


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in OF_OTHER_SENSORS | LONG | GENERAL else n for n in SHOWN]
)
def test_an_effect_is_recovered_from_data_without_noise_that_it_made(name, believed, commands):
    effect = EFFECTS[name]
    true = TRUE.get(name, {p.name: 0.7 * p.starts[0] + 0.3 * (p.none or 0.0) for p in effect.parameters})
    records = contract.recorded(believed.with_effect(effect, true), commands)
    start = Point.at(believed, believed, tuple(records))
    (found,) = fits(believed, records, effect)
    assert found is not None
    assert found.chi2 < max(0.02 * start.chi2, 1.0), f"{start.chi2:.4g} to {found.chi2:.4g}: {found.values}"
    if name not in LOOSE:
        for p in effect.parameters:
            span = abs(true[p.name] - (p.none or 0.0))
            # what these records hardly tell is drawn to its prior, by no more than its error
            assert abs(found.values[p.name] - true[p.name]) < max(0.05 * span, found.errors[p.name]), found.values


def test_a_servo_of_second_order_takes_commands_as_the_believed_one_does(believed, commands):
    """As ramps from frame to frame: held, it would hear every command half a frame too soon, 5e-3 rad here.

    Against scipy's integration of the same equation; the believed servo, which flies what comes of it, adds 3e-4 rad.
    """
    w, zeta = 20.0, 0.6
    servo = believed.with_effect(EFFECTS["second_order_actuator"], {"omega_rad_s": w, "zeta": zeta})
    turned = servo.flown(commands[0], ("de",)).columns(("de",))[:, 0]
    u = np.repeat(commands[0].columns(("de_cmd",))[:, 0], 2)
    expected = lsim(([w * w], [1.0, 2.0 * zeta * w, w * w]), u, np.arange(len(u)) / RATE_HZ)[1][::2]
    assert np.max(np.abs(turned - turned[0] - expected)) < 5e-4


def test_ground_effect_lifts_near_the_ground_and_not_aloft(believed):
    effect = EFFECTS["ground_effect"]
    aircraft = effect.amend(believed.aircraft, believed.suite, {"k": 0.2})[0]
    high, low = FlightCondition(16.0, 547.0), FlightCondition(16.0, 1.0)
    near = replace(aircraft, limits={k: v for k, v in aircraft.limits.items() if k != "h"})
    free = replace(believed.aircraft, limits=near.limits)
    assert trim(near, high).alpha == pytest.approx(trim(free, high).alpha, abs=1e-9)
    assert trim(near, low).alpha < trim(free, low).alpha - 1e-3


def test_a_steady_wind_shows_in_ground_speed_alone(believed):
    suite = load_suite("eolo_full")
    effect = EFFECTS["steady_wind"]
    aircraft, amended = effect.amend(believed.aircraft, suite, {"along_m_s": 5.0, "up_m_s": 0.5})
    assert aircraft is believed.aircraft
    changed = {a.channel for a, b in zip(amended.sensors, suite.sensors, strict=True) if a != b}
    assert changed == {"Vg", "hdot"} & set(suite.channels)
    assert changed


def test_a_bending_mode_appears_among_the_poles(believed):
    values = {"f_hz": 9.0, "mass_ratio": 0.3, "twist_rad": 0.0, "lever": 0.0}
    plane = believed.aircraft
    amended, _ = EFFECTS["wing_bending"].amend(plane, believed.suite, values)
    assert amended.amendments[-1].modes[0].mass_kg_m2 == pytest.approx(
        0.3 * plane.mass.mass_kg * plane.geometry.cbar_m**2
    )
    poles = linearise(amended, trim(amended, CONDITION)).poles()
    assert np.min(np.abs(np.abs(poles) - 2 * np.pi * 9.0)) < 0.05 * 2 * np.pi * 9.0


def test_a_thrust_line_above_the_cg_pitches_down_with_throttle(believed):
    aircraft = believed.aircraft
    amended, _ = EFFECTS["thrust_line"].amend(aircraft, believed.suite, {"z_m": 0.05})
    models = [linearise(a, trim(a, CONDITION)) for a in (aircraft, amended)]
    q, thr = models[0].states.index("q"), models[0].inputs.index("thr")
    change = models[1].B[q, thr] - models[0].B[q, thr]
    thrust_per_throttle = 45.0 * (1.0 - 16.0 / 36.0)
    assert change == pytest.approx(-0.05 * thrust_per_throttle / aircraft.mass.Iyy, rel=1e-3)


@pytest.mark.parametrize(
    "pair",
    [
        ("dead_band", "pitch_damper"),
        ("dead_band", "surface_scale"),
        ("dead_band", "transport_delay"),
        ("free_play", "slipstream"),
        ("free_play", "speed_effectiveness"),
        ("pitch_damper", "surface_scale"),
        ("pitch_damper", "transport_delay"),
    ],
    ids=" + ".join,
)
def test_effects_found_together_act_in_the_order_of_the_control_path(pair, believed, commands):
    """Whichever was found first: play moves all that the surface does, a dead band is the servo's, a link delays the
    pilot alone.
    """
    values = {"dead_band": {"half_width_rad": 0.01}, "free_play": {"width_rad": 0.02}, "pitch_damper": {"gain_s": 0.1}}
    values |= {"surface_scale": {"scale": 0.8}, "transport_delay": {"delay_s": 0.05}, **TRUE}
    models = []
    for names in (pair, pair[::-1]):
        model = believed
        for name in names:
            model = model.with_effect(EFFECTS[name], values[name])
        models.append(model)
    one, other = (m.predict(commands[2]) for m in models)
    assert np.abs(one - believed.predict(commands[2])).max() > 0.0
    assert one == pytest.approx(other, abs=1e-9)


def test_play_holds_back_what_the_elevator_does_to_elastic_modes_too():
    flexible = load_aircraft("eolo")
    amended, _ = EFFECTS["free_play"].amend(flexible, load_suite("eolo_gap"), {"width_rad": 0.02})
    for aircraft, read in ((flexible, "fcs/elevator-pos-rad"), (amended, "fcs/elevator-surface-rad")):
        tree = aircraft.model_tree(500.0, 150.0, 16.0)
        forces = [f for f in tree.iter("function") if (f.get("name") or "").startswith("modal/force-")]
        told = {p.text for f in forces for p in f.iter("property")} & {
            "fcs/elevator-pos-rad",
            "fcs/elevator-surface-rad",
        }
        assert told == {read}
