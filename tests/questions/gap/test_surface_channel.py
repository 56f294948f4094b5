"""A recorded surface is a channel as all others are: it tells the servo from the aircraft, and its sensor from both.

Truths share no code with the library. Estimates lie four standard errors off once in 16 000 cases; seeds are fixed.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from gap.hidden_truths import (
    NOTHING,
    command_gain,
    interconnect,
    late_command,
    measure_truth,
    rate_feedback,
    roughness,
    scaled_sensor,
    slewed_command,
    slow_servo,
    yaw_damper,
)
from studies.blind.truth import Truth
from studies.blind.truths import load

from testbench.core.channels import SURFACES
from testbench.core.record import FlightRecord
from testbench.core.scenario.base import Manoeuvre
from testbench.core.scenario.inputs import Doublet, StandardMultistep
from testbench.effects import EFFECTS, Effect, library
from testbench.effects.servo import WORDS
from testbench.estimators.trajectories import driven
from testbench.flight import FlightCondition, load_aircraft
from testbench.inference.unknown import PATH_S, pulses
from testbench.questions.gap.again import Reflown
from testbench.questions.gap.ask import GapResult
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.drive import SurfacePath, comparing
from testbench.questions.gap.evidence.air import AirFound
from testbench.questions.gap.explain import Naming
from testbench.questions.gap.name import Sought, name_effect
from testbench.questions.gap.page import gap_tables
from testbench.questions.gap.parts import parts_of
from testbench.questions.gap.result import GapFinding
from testbench.questions.gap.workflow import GapSearch, find_gap
from testbench.questions.hidden import fly_hidden, issued
from testbench.sensors import load_suite
from testbench.sensors.sensor import Sensor

NOISE_RAD = 0.002
STEP = StandardMultistep(signal="3211", control="de", amplitude_deg=2.0, step_s=0.4, start_s=0.5)
TURN = Doublet(signal="doublet", control="de", amplitude_deg=2.0, period_s=1.6, start_s=0.5)
RUDDER = Doublet(signal="doublet", control="dr", amplitude_deg=4.0, period_s=1.6)
ELEVATOR = Manoeuvre(name="elevator", use="identification", duration_s=6.0, input=(STEP,))
DOUBLET = Manoeuvre(name="doublet", use="identification", duration_s=6.0, input=(TURN,))
YAW = Manoeuvre(name="rudder", use="identification", duration_s=8.0, input=(RUDDER,))
CONDITIONS = {"eolo": FlightCondition(16.0, 547.0), "taurus": FlightCondition(15.0, 100.0)}
AIRCRAFT = (pytest.param("eolo"), pytest.param("taurus", marks=pytest.mark.slow))
OF_SERVO = ("actuator_lag", "transport_delay", "rate_limit", "pitch_damper", "surface_scale")
OF_AIR = ("alpha_dot", "wake_lag", "speed_effectiveness", "curved_moment")
TRUTHS = {
    "feedback": (rate_feedback(0.1), "de", "pitch_damper", {"gain_s": 0.1}),
    "washed feedback": (yaw_damper(0.3, 2.0), "dr", "yaw_damper", {"gain_s": 0.3}),
    "slow servo": (slow_servo(12.0), "de", "actuator_lag", {"lag_rad_s": 12.0}),
    "late command": (late_command(0.06), "de", "transport_delay", {"delay_s": 0.06}),
    "gain": (command_gain(0.6), "de", "surface_scale", {"scale": 0.6}),
}


def believe(noise_rad: float, control: str = "de", aircraft: str = "eolo") -> Believed:
    suite = load_suite("eolo_gap_lateral" if control == "dr" else "eolo_gap")
    suite = replace(suite, rate_hz=50.0, sensors=(*suite.sensors, Sensor(control, noise_std=noise_rad)))
    return Believed(load_aircraft(aircraft, "rigid"), suite, CONDITIONS[aircraft], 100.0)


def measure(
    b: Believed, hidden: Truth, *specs: Manoeuvre, aircraft: str = "eolo", louder: float = 1.0
) -> dict[str, FlightRecord]:
    """Return what sensors that have so many times the stated noise read of a truth."""
    suite = replace(b.suite, sensors=tuple(replace(s, noise_std=louder * s.noise_std) for s in b.suite.sensors))
    return measure_truth(aircraft, hidden, suite, b.condition, specs or (ELEVATOR, DOUBLET), 3, b.rate_hz)


def few(b: Believed, *names: str) -> dict[str, Effect]:
    known = library(b.suite)
    return {n: known[n] for n in names}


def servo_of(finding: GapFinding) -> float:
    """Return how probable it is that anything acts between command and surface."""
    (path,) = finding.paths
    return path.probability


@cache
def found(case: str, noise_rad: float) -> GapFinding:
    hidden, control, *_ = TRUTHS[case]
    b = believe(noise_rad, control)
    names = (*OF_SERVO, "de_scale") if control == "de" else ("yaw_damper", "rudder_rate_limit", "dr_scale")
    records = measure(b, hidden, YAW) if control == "dr" else measure(b, hidden)
    return find_gap(b, records, {}, GapSearch(effects=few(b, *names)))


def assert_named(naming: Naming, effect: str, true: dict[str, float]) -> None:
    assert naming.names[0] == effect, naming.sentence
    for name, value in true.items():
        assert abs(naming.best.values[name] - value) < 4.0 * naming.best.errors[name], naming.sentence


@pytest.mark.parametrize("noise_rad", [NOISE_RAD, pytest.param(0.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "case",
    [
        pytest.param(n, marks=pytest.mark.slow) if n in ("late command", "gain", "washed feedback") else n
        for n in TRUTHS
    ],
)
def test_what_a_surface_does_beside_its_command_is_named_with_its_size(case, noise_rad):
    _, control, effect, true = TRUTHS[case]
    finding = found(case, noise_rad)
    assert_named(finding.naming, effect, true)
    (path,) = finding.paths
    assert path.control == control
    assert path.probability > 0.8
    assert path.believed > 1.4  # times the noise that the believed path leaves
    assert path.nearest < 1.05


@pytest.mark.parametrize("noise_rad", [NOISE_RAD, pytest.param(0.0, marks=pytest.mark.slow)])
def test_nothing_is_said_to_act_in_a_path_as_believed_whatever_else_is_wrong(noise_rad):
    """The aircraft is a sixth heavier than believed, which its surfaces do not know."""
    b = believe(noise_rad)
    finding = find_gap(
        b, measure(b, load(0.5, 0.0)), {}, GapSearch(effects=few(b, *OF_SERVO, "mass_error", "de_scale"))
    )
    assert servo_of(finding) < 0.1, finding.paths[0].sentence  # 0.2 before the flight
    assert finding.paths[0].believed == pytest.approx(1.0 if noise_rad else 0.0, abs=0.05)
    assert not {*OF_SERVO, "de_scale"} & set(finding.naming.names)


def test_a_surface_off_by_a_constant_names_nothing():
    b = believe(NOISE_RAD)
    off = {n: r.with_columns({"de": r["de"] + 0.02}) for n, r in measure(b, NOTHING).items()}
    assert find_gap(b, off, {}, GapSearch(effects=few(b, *OF_SERVO, "de_bias"))).naming.outcome == "no gap"


def test_a_surface_that_the_believed_model_turns_itself_is_predicted():
    damped = believe(NOISE_RAD).with_effect(EFFECTS["pitch_damper"], {"gain_s": 0.1})
    finding = find_gap(damped, measure(damped, rate_feedback(0.1)), {}, GapSearch(effects=few(damped, *OF_SERVO)))
    assert finding.naming.outcome == "no gap"
    assert finding.paths[0].believed == pytest.approx(1.0, abs=0.1)


def test_surfaces_are_compared_where_all_records_hold_them_and_their_commands():
    b = believe(NOISE_RAD)
    both = list(measure(b, NOTHING).values())
    assert comparing(b, both).surfaces == ("de",)
    assert comparing(b, [both[0], both[1].select([n for n in both[1].channels if n != "de"])]) is b
    clean = comparing(believe(0.0), both)
    assert clean.noise_std[clean.outputs.index("de")] == CRITERIA.faintest_rad
    by_command = find_gap(b, {"one": both[0]}, {}, GapSearch(effects={}, drive="command"))
    assert by_command.paths == ()
    assert "de" not in by_command.believed.outputs


def test_the_surface_tells_apart_what_the_motion_cannot():
    """A command 0.02 s late moves the aircraft as a servo of second order would, but not the surface."""
    b = believe(NOISE_RAD)
    records = list(measure(b, late_command(0.02), ELEVATOR).values())
    lags = few(b, "transport_delay", "second_order_actuator", "wake_lag")

    def asked(model: Believed) -> Naming:
        return name_effect(model, records, Sought(lags, pairs=False))

    assert {"transport_delay", "second_order_actuator"} <= set(asked(b).names)
    both = asked(comparing(b, records))
    assert (both.outcome, both.names) == ("named", ("transport_delay",))
    assert both.weighed["wake_lag"] < 1e-6


def test_a_feedback_too_small_for_the_motion_is_named_by_the_surface():
    b = believe(NOISE_RAD)
    records = list(measure(b, rate_feedback(0.04), ELEVATOR).values())
    dampers = few(b, "pitch_damper", "alpha_dot")
    assert name_effect(b, records, Sought(dampers, pairs=False)).weighed["pitch_damper"] < 0.9
    both = name_effect(comparing(b, records), records, Sought(dampers, pairs=False))
    assert (both.outcome, both.names) == ("named", ("pitch_damper",))
    assert abs(both.best.values["gain_s"] - 0.04) < 3.0 * both.best.errors["gain_s"]


@pytest.mark.parametrize(
    "hidden", [pytest.param(slow_servo(10.0), marks=pytest.mark.slow), slewed_command(0.25)], ids=["slow", "slew"]
)
def test_a_fault_of_the_servo_that_is_not_held_is_no_effect_of_the_air(hidden):
    """What remains of the surface needs an unknown deflection, and no moment of the air explains that.

    All of them are flown to rest, as none is hopeless: four seconds.
    """
    b = believe(NOISE_RAD)
    records = list(measure(b, hidden).values())
    naming = name_effect(comparing(b, records), records, Sought(few(b, *OF_AIR), pairs=False))
    assert naming.outcome in ("unexplained", "partial"), naming.sentence
    assert max(naming.weighed[n] for n in naming.weighed.effects) < 1e-3
    assert naming.weighed.table["nothing"].posterior.kappa > 1e-2


@pytest.mark.sampled(2)
@pytest.mark.parametrize("aircraft", AIRCRAFT)
@pytest.mark.parametrize("wrong", ["servo", "elevator", "sensor"])
def test_a_wrong_servo_a_wrong_elevator_and_a_wrong_sensor_of_it_are_told_apart(aircraft, wrong):
    """By what turns the surface, what the surface does, and what reads it."""
    b = believe(0.001, aircraft=aircraft)
    hidden = {"servo": slow_servo(12.0), "elevator": Truth(factors={"Cm_de": 1.8}), "sensor": scaled_sensor("de", 0.9)}
    records = list(measure(b, hidden[wrong], aircraft=aircraft).values())
    names = (*OF_SERVO, "alpha_dot", "wake_lag", "de_scale", "de_lag")
    naming = name_effect(comparing(b, records), records, Sought(few(b, *names), pairs=False))
    acts = naming.weighed.holds(SurfacePath("de").effects)
    if wrong == "servo":
        assert_named(naming, "actuator_lag", {"lag_rad_s": 12.0})
        assert acts > 0.9
    elif wrong == "elevator":
        assert naming.names == ("Cm_de",), naming.sentence
        assert naming.best.nuisances["Cm_de"] == pytest.approx(1.8, abs=0.06)
        assert acts < 1e-3
    else:
        assert_named(naming, "de_scale", {"scale": 0.9})
        # a linkage of 0.9 beside an elevator that works as much better, which its prior allows
        assert naming.weighed["surface_scale"] < 0.25 * naming.weighed["de_scale"]


@pytest.mark.parametrize("aircraft", AIRCRAFT)
def test_noise_that_is_louder_than_stated_is_no_gap_and_found_in_the_surface_too(aircraft):
    b = believe(0.001, aircraft=aircraft)
    records = measure(b, NOTHING, aircraft=aircraft, louder=1.2)
    finding = find_gap(b, records, {}, GapSearch(effects=few(b, *OF_SERVO, "alpha_dot", "de_scale"), noise="stated"))
    assert finding.naming.outcome == "no gap", finding.naming.sentence
    value, error = finding.noise.scales["de"]
    assert abs(value - 1.2) < 4.0 * error
    assert error < 0.05


def test_an_unknown_deflection_moves_surface_and_aircraft_as_the_linear_model_says():
    """Hats side by side are one everywhere but before the first knot, where they rise."""
    b = believe(NOISE_RAD)
    (record,) = measure(b, NOTHING, ELEVATOR).values()
    linear, channels = b.linear, ("q", "alpha", "de")
    unknown = pulses(linear, channels, 16.0, record)
    forced = unknown.shape[2] - pulses(linear, channels[:2], 16.0, record).shape[2]
    assert forced == -(-len(record) // round(PATH_S / record.dt_s))
    ramp = np.minimum(record.t_s - record.t_s[0], PATH_S) / PATH_S * np.std(record["de"])
    whole = unknown[:, :, -forced:].sum(axis=2)
    assert whole[:, 2] == pytest.approx(ramp)
    (x,) = driven(linear.A, linear.B[:, [linear.inputs.index("de")]], [ramp[:, None]], record.dt_s)
    rows = [linear.outputs.index(c) for c in channels[:2]]
    assert whole[:, :2] == pytest.approx(x @ linear.C[rows].T, abs=1e-9)


def test_a_flight_again_reads_the_surface_again():
    b = believe(NOISE_RAD)
    records = list(measure(b, NOTHING, ELEVATOR).values())
    still = AirFound(False, 0.0, 547.0, 0.0, 10.0, 1.0)
    _, (again,) = Reflown(comparing(b, records), records, still).drawn(np.random.default_rng(1))
    assert np.std(again["de"] - records[0]["de"]) == pytest.approx(np.sqrt(2.0) * NOISE_RAD, rel=0.2)
    np.testing.assert_array_equal(again["de_cmd"], records[0]["de_cmd"])


def test_windows_compare_surfaces_too():
    """A record cut where it moves begins with a servo on its way; what is sought in it is named.

    Starts are fitted twice, and searched beside: five seconds.
    """
    b = believe(NOISE_RAD)
    pieces = {}
    for name, given in measure(b, rate_feedback(0.1)).items():
        moved = int(np.flatnonzero(np.abs(np.diff(given["de_cmd"])) > 0.01)[0])
        pieces[name] = given.between(float(given.t_s[moved]) + 0.2, float(given.t_s[-1]))
    finding = find_gap(b, pieces, {}, GapSearch(effects=few(b, "pitch_damper", "alpha_dot")))
    assert len(finding.windows) == len(pieces)
    assert_named(finding.naming, "pitch_damper", {"gain_s": 0.1})


def test_what_is_known_of_a_path_stands_in_sentences_and_in_a_table():
    finding = found("feedback", NOISE_RAD)
    (sentence,) = (s for s in finding.sentences if s.startswith("the path of the elevator"))
    assert "probability that something is missing between its command and surface" in sentence
    (table,) = (t for t in gap_tables(GapResult("some", "", "", "eolo", {}, finding)) if t.name == "control_paths")
    ((control, sure, believed, nearest, why),) = table.rows
    assert (control, why) == ("de", "")
    assert 100.0 * servo_of(finding) == sure
    assert believed > nearest


@pytest.mark.parametrize(
    "effect", [e for e in library(load_suite("eolo_gap_lateral")).values() if e.part == "autopilot"]
)
def test_what_an_autopilot_feeds_into_a_path_acts_in_that_path(effect):
    (control,) = (c for c in ("de", "da", "dr") if effect.name in SurfacePath(c).effects)
    assert effect.place in (WORDS[control], "pitching moment")


@pytest.mark.slow
@pytest.mark.parametrize("aircraft", AIRCRAFT)
@pytest.mark.parametrize(
    ("hidden", "named", "in_path"),
    [
        (NOTHING, (), (0.0, 1e-3)),
        (slow_servo(12.0), ("actuator_lag",), (0.9, 1.0)),
        (Truth(factors={"Cm_de": 1.8}), ("Cm_de",), (0.0, 1e-3)),
        (scaled_sensor("de", 0.9), ("de_scale",), (0.0, 0.2)),
        (roughness(0.06), ("drag_increment",), (0.0, 0.01)),
    ],
    ids=["nothing", "slow servo", "elevator", "sensor", "drag"],
)
def test_the_whole_library_tells_servo_aircraft_and_sensor_apart(aircraft, hidden, named, in_path):
    b = believe(0.001, aircraft=aircraft)
    records = measure(b, hidden, aircraft=aircraft, louder=1.2)
    finding = find_gap(b, records, {}, GapSearch(noise="stated"))
    assert finding.naming.names[:1] == named, finding.naming.sentence
    assert in_path[0] <= servo_of(finding) <= in_path[1]


@pytest.mark.slow
def test_an_interconnect_that_the_library_lacks_accuses_no_coefficient():
    """By the motion alone Cn_da is -1.0 times what is believed, with 88 %."""
    suite = load_suite("eolo_gap_lateral")
    surfaces = tuple(Sensor(c, noise_std=0.001) for c in SURFACES)
    b = replace(believe(0.001), suite=replace(suite, rate_hz=50.0, sensors=(*suite.sensors, *surfaces)))
    turns = [
        Manoeuvre(
            name=c,
            use="identification",
            duration_s=7.0,
            input=(TURN.model_copy(update={"control": c, "amplitude_deg": a}),),
        )
        for c, a in (("da", 4.0), ("dr", 4.0), ("de", 2.0))
    ]
    real = Truth(changes=(interconnect(-0.38),)).real("eolo")
    records = list(fly_hidden(real, b.suite, issued(b.suite, b.condition, turns, 3), b.rate_hz).values())
    known = few(b, "yaw_damper", "rudder_lag", "beta_scale", "r_cross", "r_scale", "rudder_surface_scale", "dr_scale")
    naming = name_effect(comparing(b, records), records, Sought(known, pairs=False))
    assert naming.outcome in ("partial", "unexplained"), naming.sentence
    assert naming.weighed["Cn_da"] < 1e-6
    assert {p.name for f in naming.ranking[:1] for p in parts_of([f.effect])} <= {"autopilot", "rudder path"}
