"""Plans: order and margins, limits met and kept, repeats from information, times and energy, faults in words.

Power and energy of a flight by hand: of a motor, and of a glider, which pays with height.

The simulated input of a script is the one that the script sends: sampled at its period and held.
"""

import copy
import math
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from test_bounds import scenario_of

from testbench.core.constants import G0_M_S2
from testbench.core.errors import EstimationError, ScenarioError
from testbench.core.paths import SCENARIOS
from testbench.core.scenario.inputs import Multisine, Sweep
from testbench.design.limits import breaches
from testbench.estimators.parametric.response import Sampling, respond
from testbench.evaluation.envelope import fly_envelope
from testbench.information.aircraft_structure import aircraft_structure, parameter_names
from testbench.inputs import build
from testbench.questions.plan.answer import plan_answer
from testbench.questions.plan.ask import first_onset, make_plan
from testbench.questions.plan.card_text import card_text
from testbench.questions.plan.check import check
from testbench.questions.plan.injection.scripts import rows_of
from testbench.questions.plan.page import plan_page, plan_tables
from testbench.questions.plan.repeats import level_power_W, reach, repeats_for, schedule, usable_J
from testbench.questions.plan.response import (
    SHOWN,
    Task,
    Together,
    bands_of,
    expected_band,
    fly_at,
    limits_of,
    roughness,
)
from testbench.questions.plan.scenario import PlanScenario, Tow, commanded
from testbench.sensors import Sensor, SensorSuite, load_suite

DOUBLET = {"signal": "doublet", "control": "de", "amplitude_deg": 2.0, "period_s": 2.0, "start_s": 0.5}
CONTENT = {
    "title": "small",
    "aircraft": "taurus",
    "flown_by": "autopilot",
    "speeds_m_s": [14.0, 12.0],
    "heights_m": [80.0, 120.0],
    "suite": "taurus_8hz",
    "limits": {"speed_change_m_s": 4.0},
    "timing": {"turn_s": 30.0, "overhead_s": 60.0},
    "energy": {
        "kind": "battery",
        "capacity_Wh": 20.0,
        "efficiency_percent": 50.0,
        "avionics_W": 2.0,
        "source": "made up",
    },
    "manoeuvre": [{"name": "doublet", "duration_s": 5.0, "settle_s": 1.0, "repeats": 2, "input": [DOUBLET]}],
}


def scenario(**changes) -> PlanScenario:
    content = copy.deepcopy(CONTENT) | changes
    return PlanScenario.model_validate(content)


def fly_once(aircraft, point, spec, limits, factor):
    (flown,) = fly_at(Together(aircraft), [Task(point, spec, limits)], [factor])
    return flown


def manoeuvre(**changes):
    return {**copy.deepcopy(CONTENT["manoeuvre"][0]), **changes}


@pytest.fixture(scope="module")
def small():
    return make_plan(scenario(), fly_envelope)


@pytest.fixture(scope="module")
def eolo_plan():
    """The packaged build-up of EOLO at three of its nine speeds."""
    base = PlanScenario.load(SCENARIOS / "plan" / "eolo_envelope.toml")
    return make_plan(base.model_copy(update={"speeds_m_s": (13.0, 16.0, 19.0)}), fly_envelope)


def test_points_rise_in_dynamic_pressure(small):
    assert [(p.V_m_s, p.h_m) for p in small.points] == [(12.0, 120.0), (12.0, 80.0), (14.0, 120.0), (14.0, 80.0)]
    assert [p.next_V_m_s for p in small.points] == [14.0, 14.0, None, None]
    assert [p.number for p in small.points] == [1, 2, 3, 4]
    qbar = [p.trimmed.condition.qbar_Pa for p in small.points]
    assert qbar == sorted(qbar)
    assert [c.number for c in small.cards] == [1, 2, 3, 4]


def test_level_power_is_thrust_times_speed_over_efficiency(small):
    for p in small.points:
        assert p.power_W == pytest.approx(p.trimmed.state["thrust"] * p.V_m_s / 0.5 + 2.0)


def test_times_and_energy_add_up(small, taurus):
    assert len(small.runs) == 8
    spec = small.scenario.energy
    assert spec.usable_J == pytest.approx(20.0 * 3600.0 * 0.8)
    (leg,) = small.flights
    # overhead at the first point's power, climb from the field, each run at its point's power, and the climb of 40 m
    # from one height to the other between the points at 12 and at 14 m/s
    climb = taurus.mass.mass_kg * 9.80665 * (120.0 + 40.0) / 0.5
    by_hand = small.points[0].power_W * 60.0 + climb + sum(2 * 36.0 * p.power_W for p in small.points)
    assert leg.energy_J == pytest.approx(by_hand)
    assert leg.time_s == pytest.approx(60.0 + 8 * 36.0)
    starts = [r.start_s for r in small.runs]
    np.testing.assert_allclose(np.diff(starts), 36.0)


def test_no_flight_takes_more_than_is_usable_and_none_could_be_longer(small, taurus):
    tight = small.scenario.model_copy(update={"energy": small.scenario.energy.model_copy(update={"capacity_Wh": 5.0})})
    runs, flights = schedule(tight, small.cards, taurus.mass.mass_kg)
    assert len(flights) > 1
    assert [f.first_run for f in flights] == [1, *(f.last_run + 1 for f in flights[:-1])]
    assert flights[-1].last_run == len(runs) == 8
    for f in flights:
        assert f.energy_J <= f.usable_J
    for f, following in pairwise(flights):
        last, first = runs[f.last_run - 1].card.point, runs[following.first_run - 1].card.point
        climb = taurus.mass.mass_kg * 9.80665 * max(first.h_m - last.h_m, 0.0) / 0.5
        assert f.energy_J + first.power_W * 36.0 + climb > f.usable_J * (1.0 - 1e-12)


def test_a_battery_too_small_for_one_run_is_said(small, taurus):
    tiny = small.scenario.model_copy(update={"energy": small.scenario.energy.model_copy(update={"capacity_Wh": 1.0})})
    with pytest.raises(ScenarioError, match=r"usable energy >= .* Wh must hold for one flight with one run"):
        schedule(tiny, small.cards, taurus.mass.mass_kg)


def test_fuel_is_counted_by_its_heating_value():
    fuel = {"kind": "fuel", "capacity_kg": 0.1, "efficiency_percent": 15.0, "source": "made up", "usable_percent": 50.0}
    assert scenario(energy=fuel).energy.usable_J == pytest.approx(0.1 * 43e6 * 0.5)


def test_expected_response_is_the_flight_and_limits_are_kept(small, taurus):
    card = small.cards[0]
    limits = limits_of(small.scenario.limits, taurus, None)
    again = fly_once(taurus, card.point, card.spec, limits, 1.0)
    np.testing.assert_array_equal(card.expected.data, again.record.data)
    assert card.status == "fly"
    assert not breaches(card.expected, bands_of(limits, card.point, ("de",)))
    assert card.t_s[0] == -1.0
    moved = card.t_s[np.argmax(np.abs(card.expected["q"]) > 1e-3)]
    assert 0.5 < moved < 0.6  # the input starts at 0.5 s


def test_many_cards_are_flown_at_once_and_the_page_says_the_same_as_by_jsbsim():
    big = manoeuvre(input=[{**DOUBLET, "amplitude_deg": 3.5}])
    asked = {"scale": True, "limits": {"speed_change_m_s": 1.2}, "turbulence_rms_m_s": 0.3}
    asked |= {"manoeuvre": [manoeuvre(), {**big, "name": "large"}]}
    together, alone = (make_plan(scenario(**asked), fly_envelope, simulator=s) for s in ("auto", "jsbsim"))
    assert {c.status for c in together.cards} == {"fly", "scaled"}
    assert together.tally.batch == alone.tally.jsbsim > 16  # eight cards, eight in turbulence, those that are scaled
    assert not together.tally.jsbsim
    assert alone.tally.reasons == {"it is wanted": alone.tally.jsbsim}
    assert plan_page(together).flown is together.tally
    assert [*plan_answer(together)] == [*plan_answer(alone)]
    for mine, other in zip(plan_tables(together), plan_tables(alone), strict=True):
        shown = [[[c.text(v) for c, v in zip(t.columns, r, strict=True)] for r in t.rows] for t in (mine, other)]
        assert shown[0] == shown[1]
    for mine, other in zip(together.cards, alone.cards, strict=True):
        assert (mine.factor, mine.met) == (other.factor, other.met)
        np.testing.assert_allclose(mine.expected.data, other.expected.data, rtol=0.0, atol=1e-7)


def test_few_cards_are_flown_by_jsbsim(small):
    assert small.tally.reasons == {"fewer than 8 flights at once are not worth a batch": 4}


def test_what_breaks_a_limit_is_refused_with_limit_and_moment():
    big = manoeuvre(input=[{**DOUBLET, "amplitude_deg": 3.5}])
    tight = {"limits": {"speed_change_m_s": 0.8}, "speeds_m_s": [12.0], "heights_m": [100.0]}
    plan = make_plan(scenario(manoeuvre=[big], **tight), fly_envelope)
    (card,) = plan.cards
    record, limits = card.expected, limits_of(plan.scenario.limits, plan.aircraft, None)
    V0 = card.point.trimmed.state["V"]
    at = record.t_s[np.argmax(np.abs(record["V"] - V0) > 0.8)] - 1.0
    assert card.status == "refused"
    assert (card.repeats, plan.runs, plan.flights) == (0, (), ())
    assert card.met[0].startswith("V passes ")
    assert f"at t = {at:.2f} s" in card.met[0]
    assert limits.speed_change_m_s == 0.8


def test_scaling_finds_the_largest_amplitude_that_keeps_the_limits():
    big = manoeuvre(input=[{**DOUBLET, "amplitude_deg": 3.5}])
    tight = {"limits": {"speed_change_m_s": 0.8}, "speeds_m_s": [12.0], "heights_m": [100.0], "scale": True}
    plan = make_plan(scenario(manoeuvre=[big], **tight), fly_envelope)
    (card,) = plan.cards
    assert card.status == "scaled"
    assert card.met
    limits = limits_of(plan.scenario.limits, plan.aircraft, None)
    assert not fly_once(plan.aircraft, card.point, card.spec, limits, card.factor).met
    assert fly_once(plan.aircraft, card.point, card.spec, limits, card.factor + 1.0 / 64.0).met
    assert np.abs(card.signal.u).max() == pytest.approx(card.factor * np.deg2rad(3.5), rel=1e-5)


def test_a_deflection_beyond_the_stop_is_scaled_to_fit_and_said():
    big = manoeuvre(input=[{**DOUBLET, "amplitude_deg": 5.0}])  # 8.4 deg at trim of 12.5
    one = {"speeds_m_s": [12.0], "heights_m": [100.0]}
    (card,) = make_plan(scenario(manoeuvre=[big], scale=True, limits={}, **one), fly_envelope).cards
    room = (np.deg2rad(12.5) + card.point.trimmed.controls["de"]) / np.deg2rad(5.0)
    assert "reduce the amplitude" in card.met[0]
    assert room - 1.0 / 64.0 <= card.factor <= room
    (card,) = make_plan(scenario(manoeuvre=[big], limits={}, **one), fly_envelope).cards
    assert card.status == "refused"


def test_trim_outside_the_limits_is_a_refusal_in_words():
    plan = make_plan(scenario(limits={"alpha_deg": [-5.0, 3.0]}, speeds_m_s=[12.0], heights_m=[100.0]), fly_envelope)
    (card,) = plan.cards
    assert card.status == "refused"
    assert "trim must lie inside the limits on alpha" in card.met[0]


def test_a_rate_limit_is_looked_at():
    plan = make_plan(scenario(limits={"rate_deg_s": {"de": 5.0}}, speeds_m_s=[12.0], heights_m=[100.0]), fly_envelope)
    assert "the rate of de passes 5 deg/s at t = 0.5" in plan.cards[0].met[0]


def test_repeats_are_the_square_of_the_ratio():
    names = ("M_q", "M_de", "Z_alpha")
    relative = np.array([0.10, 0.02, np.inf])
    assert repeats_for(names, relative, {"M_q": 0.05}, 20)[0] == 4
    assert repeats_for(names, relative, {"M_q": 0.03}, 20)[0] == math.ceil((0.10 / 0.03) ** 2)
    repeats, (q, de) = repeats_for(names, relative, {"M_q": 0.05, "M_de": 0.05}, 20)
    assert (repeats, q.reached, de.needed) == (4, pytest.approx(0.05), 1)
    repeats, (q,) = repeats_for(names, relative, {"M_q": 0.01}, 20)
    assert (repeats, q.needed) == (20, 100)
    assert "that takes 100 runs" in q.sentence
    repeats, (z,) = repeats_for(names, relative, {"Z_alpha": 0.01}, 20)
    assert (repeats, z.needed) == (1, None)
    assert "cannot be reached" in z.sentence


def test_information_of_the_repeats_reaches_what_is_wanted(eolo_plan):
    asked = [c for c in eolo_plan.cards if c.reached]
    assert len(asked) == 3
    for card in asked:
        for r in card.reached:
            assert r.reached == pytest.approx(r.one / math.sqrt(card.repeats))
            assert r.reached <= r.wanted
        # one run less would not do
        assert card.repeats == 1 or any(r.one / math.sqrt(card.repeats - 1) > r.wanted for r in card.reached)
    # half the amplitude doubles the error: four times the repeats
    card = asked[1]
    hard = card.spec.model_copy(update={"accuracy_percent": {"M_alpha": 1.0}, "most_repeats": 1000})
    flown = eolo_plan.aircraft, card.point, hard
    half = [i.model_copy(update={"amplitude_deg": 0.5 * i.amplitude_deg}) for i in hard.input]
    (_, (full_r,)), (_, (half_r,)) = (reach(*flown, i, eolo_plan.suite) for i in (hard.input, half))
    assert half_r.one == pytest.approx(2.0 * full_r.one, rel=1e-3)


def test_a_suite_that_sees_nothing_of_the_motion_says_so(small):
    aileron = {"signal": "doublet", "control": "da", "amplitude_deg": 2.0, "period_s": 2.0}
    spec = scenario(manoeuvre=[manoeuvre(repeats=None, accuracy_percent={"L_p": 5.0}, input=[aileron])]).manoeuvre[0]
    with pytest.raises(EstimationError, match="no sensor of the lateral motion"):
        reach(small.aircraft, small.points[0], spec, spec.input, load_suite("taurus_8hz"))


def test_band_is_the_scatter_of_responses_with_uncertain_derivatives(small, taurus):
    """Against 300 draws of all derivatives: the sample standard deviation errs by 4 % (one sigma); 20 % is five."""
    card = small.cards[0]
    quiet = SensorSuite("quiet", "no noise", 8.0, (Sensor("h", noise_std=0.1),))
    point, shown = card.point, SHOWN["longitudinal"]
    narrow = small.scenario.model_copy(update={"uncertainty_percent": 2.0})
    flown = fly_once(taurus, point, card.spec, limits_of(small.scenario.limits, taurus, None), 1.0)
    band = expected_band(narrow, taurus, quiet, point, card.spec, flown, {})
    names = parameter_names(("de",), "longitudinal", ())
    s = aircraft_structure(point.model, point.trimmed, "longitudinal", (), ("de_cmd",), shown, names)
    rate = 1.0 / flown.record.dt_s
    u = np.zeros((len(flown.record.t_s), 1))
    stride = round(1.0 / (flown.signal.dt_s * rate))
    part = flown.signal.u[::stride]
    begin = round(rate)  # settling lasts 1 s
    u[begin : begin + len(part)] = part[: len(u) - begin]
    rng, sampling, rest = np.random.default_rng(5), Sampling(1.0 / rate, np.ones(1, bool)), np.zeros(len(s.states))
    draws = np.stack(
        [
            respond(s, s.true * (1.0 + 0.02 * rng.standard_normal(len(names))), (), u, sampling, rest).y
            for _ in range(300)
        ]
    )  # fmt: skip
    scatter = draws.std(axis=0)
    for i, name in enumerate(shown):
        at = int(np.argmax(scatter[:, i]))
        assert band[name][at] == pytest.approx(1.96 * scatter[at, i], rel=0.2)
    wide = expected_band(
        narrow.model_copy(update={"uncertainty_percent": 4.0}), taurus, quiet, point, card.spec, flown, {}
    )
    np.testing.assert_allclose(wide["q"], 2.0 * band["q"], rtol=1e-9, atol=1e-15)
    with_noise = expected_band(narrow, taurus, load_suite("taurus_8hz"), point, card.spec, flown, {})
    noise = load_suite("taurus_8hz").noise_std["q"]
    np.testing.assert_allclose(with_noise["q"] ** 2, band["q"] ** 2 + (1.96 * noise) ** 2, rtol=1e-9)
    windy = narrow.model_copy(update={"turbulence_rms_m_s": 0.5})
    (air,) = roughness(Together(taurus), windy, [Task(point, card.spec, limits_of(windy.limits, taurus, None))])
    rough = expected_band(windy, taurus, quiet, point, card.spec, flown, air)
    assert np.all(rough["alpha"] > band["alpha"])
    assert rough["alpha"][0] == pytest.approx(1.96 * 0.5 / 12.0, rel=0.9)  # about the gust over the speed


# --- the build-up of EOLO ---------------------------------------------------------------------------------------------


def test_margin_to_the_onset_and_damping_at_this_and_the_next_point(eolo_plan):
    (envelope,) = eolo_plan.envelopes
    onset = first_onset(envelope)
    assert onset.V_m_s == pytest.approx(20.3, abs=0.1)
    assert [p.V_m_s for p in eolo_plan.points] == [13.0, 16.0, 19.0]
    torsion = "1st symmetric wing torsion and tail-boom bending"
    modes = [next(m for m in p.modes if m.name == torsion) for p in eolo_plan.points]
    for point, mode, following in zip(eolo_plan.points, modes, [*modes[1:], None], strict=True):
        assert point.margin == pytest.approx(1.0 - point.V_m_s / onset.V_m_s)
        assert mode.zeta_next == (following.zeta if following else None)
    assert [m.zeta for m in modes] == sorted((m.zeta for m in modes), reverse=True)


def test_speed_stays_below_the_onset_on_every_card(eolo_plan):
    onset = first_onset(eolo_plan.envelopes[0]).V_m_s
    assert {c.status for c in eolo_plan.cards} == {"fly", "scaled"}
    for card in eolo_plan.cards:
        assert card.expected["V"].max() <= onset
    fast = [c for c in eolo_plan.cards if c.point.V_m_s == 19.0 and "3-2-1-1" in c.spec.name]
    assert fast[0].status == "scaled"
    assert f"V passes {onset:.4g} m/s" in " ".join(fast[0].met)


def test_points_above_the_onset_less_the_margin_are_refused_unless_asked_for():
    base = PlanScenario.load(SCENARIOS / "plan" / "eolo_envelope.toml")
    multisine = base.manoeuvre[1]
    fast = base.model_copy(update={"speeds_m_s": (16.0, 19.5, 21.0), "manoeuvre": (multisine,), "scale": False})
    with pytest.raises(ScenarioError) as error:
        make_plan(fast, fly_envelope)
    assert len(error.value.faults) == 2
    for k, (V, fault) in enumerate(zip((19.5, 21.0), error.value.faults, strict=True), 1):
        assert f"speeds_m_s[{k}]: V <= 19.2" in fault
        assert f"got {V:g}" in fault
        assert "allow_above_onset = true" in fault
    near = fast.model_copy(update={"allow_above_onset": True, "speeds_m_s": (19.5,)})
    plan = make_plan(near, fly_envelope)
    assert plan.cards[0].status == "fly"


def test_speeds_that_cannot_be_trimmed_are_all_named():
    base = PlanScenario.load(SCENARIOS / "plan" / "eolo_envelope.toml")
    slow = base.model_copy(update={"speeds_m_s": (9.0, 9.5, 16.0), "manoeuvre": (base.manoeuvre[1],)})
    with pytest.raises(ScenarioError) as error:
        make_plan(slow, fly_envelope)
    assert [f.split(":")[0].endswith(f"speeds_m_s[{i}]") for i, f in enumerate(error.value.faults)] == [True, True]
    assert all("fly faster" in f for f in error.value.faults)


# --- faults -----------------------------------------------------------------------------------------------------------


def test_every_packaged_plan_is_valid():
    files = sorted((SCENARIOS / "plan").glob("*.toml"))
    assert {f.stem for f in files} == {"eolo_envelope", "taurus_63"}
    for file in files:
        assert check(PlanScenario.load(file)) == []


def test_all_faults_of_a_file_at_once(tmp_path):
    text = (SCENARIOS / "plan" / "taurus_63.toml").read_text(encoding="utf-8")
    for old, new in (
        ("speeds_m_s = [12.0, 14.0]", "speeds_m_s = [12.0, 40.0]\nsped_m_s = 3"),
        ("amplitude_deg = 3.0", "amplitude_deg = 30.0"),
        ("repeats = 14\n", "accuracy_percent = { M_alfa = 5.0 }\n"),
        ('suite = "taurus_8hz"', 'suite = "taurus_8hz"\nonset_margin_percent = 8.0'),
        ("heights_m = [100.0]", "heights_m = [100.0, 1.0]"),
    ):
        assert old in text
        text = text.replace(old, new, 1)
    file = tmp_path / "plan.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError) as error:
        PlanScenario.load(file)
    said = str(error.value)
    for part in (
        "sped_m_s: unknown key 'sped_m_s'; did you mean 'speeds_m_s'?",
        "amplitude_deg <= 12.5 must hold for control 'de' of taurus, got 30",
        "got 'M_alfa'; did you mean 'M_alpha'?",
        "speeds_m_s[1]: 7 <= V <= 28 must hold for taurus, got 40",
        "heights_m[1]: 10 <= h <= 1500 must hold for taurus, got 1",
        "heights_m[1]: a height must lie above timing.field_m",
    ):
        assert part in said
    assert all(str(file) in fault for fault in error.value.faults)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"manoeuvre": [manoeuvre(repeats=None)]}, "takes repeats, accuracy_percent or both"),
        ({"manoeuvre": [manoeuvre(), manoeuvre()]}, "names must differ"),
        ({"manoeuvre": [manoeuvre(speeds_m_s=[13.0])]}, "must be among those of the plan"),
        ({"speeds_m_s": [12.0, 12.0]}, "every value must stand there once"),
        ({"limits": {"alpha_deg": [5.0, 3.0]}}, "low < high must hold"),
        ({"manoeuvre": [manoeuvre(input=[DOUBLET, {**DOUBLET, "control": "da"}])]}, "must belong to one motion"),
        (
            {
                "flown_by": "pilot",
                "manoeuvre": [
                    manoeuvre(
                        input=[{"signal": "prbs", "control": "de", "amplitude_deg": 1.0, "step_s": 0.5, "prbs_s": 4.0}]
                    )
                ],
            },
            "a pilot flies steps",
        ),
    ],
)
def test_laws_of_the_schema(changes, message):
    with pytest.raises(ValueError, match=message):
        scenario(**changes)


def test_an_input_too_fast_for_the_autopilot_is_a_fault():
    fast = {
        "signal": "multisine", "control": "de", "amplitude_deg": 1.0, "f_min_hz": 1.0, "f_max_hz": 8.0, "period_s": 2.0,
    }  # fmt: skip
    (fault,) = check(scenario(manoeuvre=[manoeuvre(input=[fast])]))
    assert "manoeuvre[0] at autopilot.period_ms" in fault
    assert "f_max_hz <= rate / 10 = 5 Hz" in fault


GLIDER = SimpleNamespace(energy=Tow(kind="tow", release_m=900.0, lowest_m=200.0))


def test_a_motor_pays_with_thrust_over_its_efficiency_and_a_glider_with_height():
    level = SimpleNamespace(condition=SimpleNamespace(V_m_s=20.0, gamma_rad=-0.05), state={"thrust": 3.0})
    motor = SimpleNamespace(energy=SimpleNamespace(efficiency_percent=50.0, avionics_W=7.0))
    assert level_power_W(motor, level, 2.0) == pytest.approx(3.0 * 20.0 / 0.5 + 7.0)
    assert level_power_W(GLIDER, level, 2.0) == pytest.approx(2.0 * G0_M_S2 * 20.0 * math.sin(0.05))
    level.condition.gamma_rad, level.state["thrust"] = 0.05, -1.0
    assert (level_power_W(GLIDER, level, 2.0), level_power_W(motor, level, 2.0)) == (0.0, 7.0)


def test_a_glider_may_use_the_height_from_its_release_to_the_lowest():
    assert usable_J(GLIDER, 2.0) == pytest.approx(2.0 * G0_M_S2 * 700.0)


SINES = {
    "signal": "multisine",
    "control": "de",
    "amplitude_deg": 2.0,
    "f_min_hz": 0.5,
    "f_max_hz": 3.0,
    "period_s": 4.0,
}


def planned(entry, **changes):
    scenario = scenario_of(2.0)
    content = scenario.model_dump(exclude_unset=True, mode="json")
    content["manoeuvre"] = [{"name": "m", "duration_s": 6.0, "repeats": 1, "input": [entry]}]
    return PlanScenario.model_validate({**content, **changes})


@pytest.mark.parametrize("period_ms", [20, 32, 25])
def test_every_value_holds_until_the_next_one_is_sent(period_ms):
    entry = (Multisine.model_validate(SINES),)
    fast = commanded(entry, 6.0, 1000.0, period_ms)
    sent = build(entry, 6.0, 1e3 / period_ms)
    assert len(fast.u) == 6000
    for k in (0, 1, 7, 100, len(sent.u) - 1):
        first = int(np.ceil(k * period_ms - 1e-6))
        np.testing.assert_array_equal(fast.u[first : first + period_ms - 1, 0], sent.u[k, 0])
    drawn = commanded(entry, 6.0, 1000.0)
    np.testing.assert_array_equal(drawn.u, build(entry, 6.0, 1000.0).u)
    assert np.abs(drawn.u - fast.u).max() > 0.05 * np.abs(drawn.u).max()
    with pytest.raises(ScenarioError, match="f_max_hz"):
        commanded(entry, 6.0, 1000.0, 50)


def test_a_card_flies_what_its_script_sends():
    (card,) = make_plan(planned(SINES)).cards
    times_ms, rows = rows_of(card, 20)
    sampled = np.repeat(rows[:, 0], np.diff([*times_ms, 6000]) // 20)
    flown = np.degrees(card.signal.u[:, 0])
    t_ms = 1e3 * card.signal.t_s
    np.testing.assert_allclose(flown, sampled[np.floor(t_ms / 20.0 + 1e-6).astype(int)], atol=1e-5)
    (by_hand,) = make_plan(scenario_of(2.0, flown_by="pilot")).cards
    assert by_hand.spec.input == scenario_of(2.0).manoeuvre[0].input


def test_the_card_of_a_sweep_says_the_settings_of_the_autopilot_s_own(tmp_path):
    sweep = {
        "signal": "sweep",
        "control": "da",
        "amplitude_deg": 2.5,
        "f_start_hz": 0.3,
        "f_end_hz": 2.0,
        "sweep_s": 5.0,
    }
    assert Sweep.model_validate(sweep)
    plan = make_plan(planned(sweep))
    (note,) = [n for n in card_text(plan.cards[0], plan).notes if "SID_AXIS" in n]
    part = 2.5 / np.degrees(plan.aircraft.controls["da"].full)
    assert f"SID_AXIS 22, SID_MAGNITUDE {part:.3g}, SID_F_START_HZ 0.3, SID_F_STOP_HZ 2, SID_T_REC 5" in note
    other = make_plan(planned(sweep, autopilot={"system": "px4"}))
    assert not [n for n in card_text(other.cards[0], other).notes if "SID_AXIS" in n]
