"""What a recorded surface says counts in the likelihood: an effect of its path leads what moves the aircraft alike."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
from gap.hidden_truths import command_gain, late_command, rate_feedback, roughness
from gap.test_control_path import ELEVATOR, NOISE_RAD, believe, measure

from testbench.effects import EFFECTS
from testbench.effects.base import together
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.by_surface import borne_out, named_beside
from testbench.questions.gap.coefficients import gain_of, led_by_surfaces
from testbench.questions.gap.decide import Naming
from testbench.questions.gap.evidence.air import AirFound
from testbench.questions.gap.evidence.control_path import JudgedPath, PathTerm, judge_paths
from testbench.questions.gap.parameters import wrong_parameters
from testbench.questions.gap.part_figure import part_plate
from testbench.questions.gap.search.fit import EffectFit
from testbench.questions.gap.search.name import name_effect
from testbench.questions.gap.surface_evidence import with_surfaces
from testbench.questions.gap.verdict import verdict_of
from testbench.questions.gap.workflow import find_gap

LAGS = ("transport_delay", "second_order_actuator", "wake_lag")
STILL_AIR = AirFound(False, 0.0, 547.0, 0.0, 10.0, 1.0)
DAMPERS = ("pitch_damper", "alpha_dot")


@cache
def searched(hidden: str) -> tuple[Believed, tuple, Naming, tuple[JudgedPath, ...]]:
    """Return belief, records, what the motion alone names, and the judged path."""
    truths = {
        "late": (late_command(0.02), LAGS),
        "fed back": (rate_feedback(0.04), DAMPERS),
    }
    truth, names = truths[hidden]
    b = believe(NOISE_RAD)
    records = tuple(measure(b, truth, ELEVATOR).values())
    naming = name_effect(b, records, effects={n: EFFECTS[n] for n in names}, pairs=False)
    return b, records, naming, judge_paths(b, records)


def fit_of(name: str, gain: float, chi2_tuned: float = 6000.0, samples: int = 4000) -> EffectFit:
    effect = EFFECTS[name]
    sizes = {p.name: p.starts[0] for p in effect.parameters}
    errors, beside = dict.fromkeys(sizes, 0.01), {"Cm_q": 1.0}
    return EffectFit(effect, sizes, errors, chi2_tuned - gain, gain, 14.0, gain / 2000.0, beside)


def naming_of(*fits: EffectFit, outcome: str = "unexplained", names: tuple[str, ...] = (), chi2=6000.0) -> Naming:
    ranking = tuple(sorted(fits, key=lambda f: -f.gain))
    return Naming(outcome, names, ranking, 5.0 * chi2, chi2, {}, 4000, "", measured={"Cm_q": (1.9, 0.05)})


def path_of(gain: float, **falls: float) -> JudgedPath:
    term = PathTerm("fed q", (0.1,), (0.01,), ("s",))
    return JudgedPath("de", "differs", (term,), gain=gain, samples=400, falls={"fed q": gain, **falls})


def test_motion_and_surface_are_added_for_the_effect_that_explains_both():
    b, records, naming, paths = searched("late")
    both = with_surfaces(naming, paths, b, records)
    (path,) = paths
    before, after = ({f.effect.name: f for f in n.ranking} for n in (naming, both))
    best = after["transport_delay"]
    assert best.told == pytest.approx(path.gain)
    assert best.in_motion == pytest.approx(before["transport_delay"].gain)
    assert best.chi2 == pytest.approx(before["transport_delay"].chi2), "it leaves nothing of the surface"
    assert after["wake_lag"].told == 0.0
    assert after["wake_lag"].chi2 == pytest.approx(before["wake_lag"].chi2 + path.gain), "it leaves all of it"
    assert both.chi2_tuned == pytest.approx(naming.chi2_tuned + path.gain)


def test_the_surface_tells_apart_what_the_motion_cannot():
    """A command 0.02 s late moves the aircraft as a servo of second order would, but not the surface."""
    b, records, naming, paths = searched("late")
    assert set(naming.names) == {"transport_delay", "second_order_actuator"}
    both = with_surfaces(naming, paths, b, records)
    assert (both.outcome, both.names) == ("named", ("transport_delay",))


def test_a_feedback_too_small_for_the_motion_is_named_by_the_surface():
    b, records, naming, paths = searched("fed back")
    assert (naming.outcome, naming.names) == ("no gap", ())
    both = with_surfaces(naming, paths, b, records)
    assert (both.outcome, both.names) == ("named", ("pitch_damper",))
    best = both.best
    assert best is not None
    assert abs(best.values["gain_s"] - 0.04) < 3.0 * best.errors["gain_s"]


def test_a_path_as_believed_changes_nothing():
    b, records, naming, _ = searched("late")
    assert with_surfaces(naming, (JudgedPath("de", "as believed"),), b, records) is naming
    assert with_surfaces(naming, (), b, records) is naming


def test_what_the_surface_shows_does_not_hide_an_effect_that_moves_the_aircraft():
    b, records, *_ = searched("late")
    naming = naming_of(fit_of("drag_increment", 2000.0), fit_of("pitch_damper", 8.0), names=("drag_increment",))
    assert with_surfaces(naming, (path_of(900.0),), b, records) is naming
    quiet = naming_of(fit_of("pitch_damper", 3.0, 4000.0), outcome="no gap", chi2=4000.0)
    assert with_surfaces(quiet, (path_of(900.0),), b, records) is quiet, "the motion must agree"


def test_what_moves_the_aircraft_as_a_feedback_does_but_not_the_surface_is_no_name():
    """alpha_dot leads in the motion by 100; the surface shows 400 that it does not explain."""
    b, records, *_ = searched("late")
    naming = naming_of(
        fit_of("alpha_dot", 2000.0), fit_of("pitch_damper", 1900.0), outcome="named", names=("alpha_dot",)
    )
    both = with_surfaces(naming, (path_of(400.0),), b, records)
    assert both.names == ("pitch_damper",)
    assert both.ranking[0].told == 400.0


def test_parts_of_a_joint_effect_are_told_together():
    lag = PathTerm("lag", (12.0,), (0.1,), ("rad/s",))
    path = replace(path_of(900.0, lag=500.0, delay=450.0), terms=(*path_of(900.0).terms, lag))
    assert path.told(together(EFFECTS["pitch_damper"], EFFECTS["actuator_lag"])) == 900.0
    assert path.told(EFFECTS["transport_delay"]) == 450.0
    assert path.told(together(EFFECTS["transport_delay"], EFFECTS["drag_increment"])) == 450.0
    assert path.told(EFFECTS["drag_increment"]) == 0.0


def test_a_coefficient_is_not_accused_of_what_a_surface_shows():
    b, *_ = searched("late")
    naming = naming_of(replace(fit_of("pitch_damper", 30.0), told=0.0))
    assert gain_of("Cm_q", naming) == pytest.approx(0.9**2 / (0.15**2 + 0.05**2))
    assert not led_by_surfaces("Cm_q", naming)
    assert [p.name for p in wrong_parameters(naming, b)] == ["Cm_q"]
    told = naming_of(replace(fit_of("pitch_damper", 430.0), told=400.0))
    assert led_by_surfaces("Cm_q", told)
    assert wrong_parameters(told, b) == ()


@pytest.mark.parametrize("recorded", [True, False])
def test_a_coefficient_is_accused_only_if_it_is_wrong_where_the_surface_drives_too(recorded):
    """The linkage turns the elevator 0.65 of its command, and Cm_alpha is 1.5 times the believed one."""
    b = believe(NOISE_RAD).with_nuisances({"Cm_alpha": 1.0 / 1.5})
    records = measure(b, command_gain(0.65), ELEVATOR)
    naming = name_effect(b, tuple(records.values()), effects={"drag_increment": EFFECTS["drag_increment"]}, pairs=False)
    assert (naming.outcome, naming.names) == ("no gap", ()), naming.sentence
    wrong = wrong_parameters(naming, b)
    paths = judge_paths(b, tuple(records.values()))
    assert {p.name for p in wrong} == {"Cm_de", "Cm_alpha"}
    if not recorded:  # then nothing but the command can drive
        records = {n: r.select(c for c in r.channels if c != "de") for n, r in records.items()}
    left = borne_out(wrong, paths, b, records, STILL_AIR)
    assert {p.name for p in left} == ({"Cm_alpha"} if recorded else {"Cm_de", "Cm_alpha"})
    assert borne_out(wrong, (JudgedPath("de", "as believed"),), b, records, STILL_AIR) == wrong


def test_what_imitates_a_path_that_differs_explains_nothing_where_the_surface_drives():
    """The command comes 0.1 s late, and no delay is in the library: a lag of the wake stands in for it."""
    b = believe(NOISE_RAD)
    records = measure(b, late_command(0.1), ELEVATOR)
    flown = tuple(records.values())
    imitating = name_effect(b, flown, effects={"wake_lag": EFFECTS["wake_lag"]}, pairs=False)
    best = next(f for f in imitating.ranking if f.significant)
    naming = replace(imitating, outcome="named", names=(best.effect.name,))
    paths = judge_paths(b, flown)
    left = named_beside(naming, paths, b, records, STILL_AIR)
    assert (left.outcome, left.names) == ("unexplained", ())
    assert "the elevator's recorded surface shows a delay of" in left.sentence
    verdict = verdict_of(left, paths)
    assert verdict is not None
    assert [p.name for p in verdict.parts] == ["elevator path"]
    assert verdict.sentences[0] == (
        "where to look first: elevator path, as the recorded surface shows; whether that is all is not known"
    )
    plate = part_plate(verdict)
    assert plate is not None
    assert plate.caption.endswith("The recorded surface shows that its path differs from what is believed.")
    assert named_beside(naming, (JudgedPath("de", "as believed"),), b, records, STILL_AIR) is naming


def test_a_name_that_holds_where_surfaces_drive_stays_beside_a_path_that_differs():
    b = believe(NOISE_RAD)
    records = measure(b, roughness(0.05), ELEVATOR)
    flown = tuple(records.values())
    naming = name_effect(b, flown, effects={"drag_increment": EFFECTS["drag_increment"]}, pairs=False)
    assert naming.names == ("drag_increment",)
    assert named_beside(naming, (path_of(900.0),), b, records, STILL_AIR) is naming


def test_a_path_that_coefficients_imitate_is_what_is_not_explained():
    """The linkage turns the elevator 0.65 of its command, which is a Cm_de; no linkage is in the library."""
    b = believe(NOISE_RAD)
    records = measure(b, command_gain(0.65), ELEVATOR)
    flown = tuple(records.values())
    naming = name_effect(b, flown, effects={"drag_increment": EFFECTS["drag_increment"]}, pairs=False)
    assert naming.outcome == "no gap"
    left = named_beside(naming, judge_paths(b, flown), b, records, STILL_AIR)
    assert (left.outcome, left.names) == ("unexplained", ())
    assert "the elevator's recorded surface shows a gain of 0.65" in left.sentence
    known = replace(naming, ranking=(replace(fit_of("surface_scale", 3.0), told=900.0),))
    gain = PathTerm("gain", (0.65,), (0.01,), ("1",))
    paths = (replace(path_of(900.0), terms=(gain,), falls={"gain": 900.0}),)
    assert named_beside(known, paths, b, records, STILL_AIR) is known, (
        "it was searched, and the motion shows too little"
    )


@pytest.mark.slow
def test_the_whole_library_names_a_small_feedback_by_its_surface_and_drag_beside_a_right_path():
    b = believe(NOISE_RAD)
    fed = find_gap(b, measure(b, rate_feedback(0.04), ELEVATOR), {})
    assert (fed.naming.outcome, fed.naming.names) == ("named", ("pitch_damper",))
    assert any("of that is in the recorded surface" in s for s in fed.sentences)
    rough = find_gap(b, measure(b, roughness(0.06), ELEVATOR), {})
    assert rough.naming.best is None or "drag_increment" in rough.naming.names
    assert not any("is in the recorded surface" in s for s in rough.sentences)
