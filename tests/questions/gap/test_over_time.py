"""What empties during a flight: one parameter over records whose times after take-off are known."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from gap_fits import fits
from gap_flights import CONDITION, believe, measure

from testbench.core.errors import ModelError, ScenarioError
from testbench.core.paths import SCENARIOS
from testbench.effects import EFFECTS
from testbench.effects.base import left
from testbench.questions.gap.ask import run_gap
from testbench.questions.gap.effect_contract import CONDITION as AT
from testbench.questions.gap.effect_contract import believed, commands, recorded
from testbench.questions.gap.export import amended_files
from testbench.questions.gap.name import not_sought
from testbench.questions.gap.new import new_case
from testbench.questions.gap.scenario import GapScenario
from testbench.questions.gap.search.point import Point
from testbench.questions.gap.starts import CUT, Start, marked, start_of, timed
from testbench.questions.gap.windows import cut

TIMES_S = (60.0, 900.0, 1800.0)


def flown(at=TIMES_S, records=None):
    """Records, or the commands of the effects' laws (throttle, doublets and a pull-up), each at its time."""
    records = commands()[2:] * 3 if records is None else records
    return tuple(marked(c, Start(AT, at_s=t)) for c, t in zip(records, at, strict=True))


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("name", "values", "others"),
    [
        ("thrust_fade", {"per_min": 0.012}, ("thrust_scale",)),
        ("fuel_burn", {"per_min": 0.006}, ("mass_error",)),
        pytest.param("tank_burn", {"per_min": 0.006, "aft_chords": -0.2}, ("fuel_burn",), marks=pytest.mark.slow),
        ("uneven_thrust_fade", {"per_min": 0.006, "power": 1.6}, ("thrust_scale",)),
        pytest.param("uneven_fuel_burn", {"per_min": 0.006, "power": 0.6}, ("mass_error",), marks=pytest.mark.slow),
    ],
)
def test_what_empties_is_found_at_its_rate_and_one_scale_for_all_records_is_not_it(name, values, others):
    b = believed()
    effect = EFFECTS[name]
    records = flown(records=recorded(b.with_effect(effect, values), flown()))
    start = Point.at(b, b, tuple(records))
    (found,) = fits(b, records, effect)
    assert found.values == pytest.approx(values, rel=0.05)
    assert found.chi2 < 0.02 * start.chi2
    for other in others:
        assert fits(b, records, EFFECTS[other])[0].chi2 > 3.0 * found.chi2


def test_what_is_left_falls_as_the_power_says_from_all_of_it_at_take_off():
    steady, early = {"per_min": 0.01}, {"per_min": 0.01, "power": 0.5}
    assert [left(steady, t) for t in (0.0, 600.0, 2400.0)] == pytest.approx([1.0, 0.9, 0.6])
    assert [left(early, t) for t in (0.0, 600.0, 2400.0)] == pytest.approx([1.0, 0.9, 0.8])
    assert left(steady, 1e6) == 0.05
    b, tank = believed(), EFFECTS["tank_burn"]
    assert tank.over_time(b.aircraft, b.suite, {**steady, "aft_chords": 0.1}, 0.0) == (b.aircraft, b.suite)


def test_half_an_hour_after_take_off_the_aircraft_is_as_much_lighter_as_the_rate_says():
    b = believed()
    late = b.with_effect(EFFECTS["fuel_burn"], {"per_min": 0.01}).at(flown()[2])
    assert late.aircraft.mass.mass_kg == pytest.approx(0.7 * b.aircraft.mass.mass_kg)
    assert late.trimmed.alpha < b.trimmed.alpha


@pytest.mark.parametrize("at", [(None, None, None), (60.0, 60.0, 60.0), (60.0, None, None), (60.0, 75.0, 100.0)])
def test_it_is_not_sought_where_records_do_not_differ_in_time(at):
    b = believed()
    records = flown(at, recorded(b, flown(at)))
    assert "flown_at_s" in not_sought(Point.at(b, b, records), EFFECTS["thrust_fade"])


def test_a_time_costs_nothing_where_nothing_grows_and_cannot_be_asked_of_another_condition():
    b, record = believed(), flown()[0]
    assert b.at(record) is b
    grown = b.with_effect(EFFECTS["thrust_fade"], {"per_min": 0.01})
    there = grown.at(record)
    assert there is not grown
    assert there is grown.at(record)
    assert there.at(record) is there
    light, loaded = (marked(record, Start(AT, load_kg=kg, at_s=60.0)) for kg in (0.0, 0.5))
    with pytest.raises(ModelError, match="cannot be asked about one"):
        b.at(loaded).at(light)
    elsewhere = marked(record, Start(replace(AT, V_m_s=17.0), at_s=60.0))
    assert b.at(elsewhere) is b.at(marked(record, Start(replace(AT, V_m_s=17.0), at_s=900.0)))


def test_a_start_keeps_its_time_and_windows_have_their_own():
    record = recorded(believed(), commands()[:1])[0]
    at = marked(record, Start(AT, load_kg=0.5, at_s=100.0))
    assert start_of(at) == Start(AT, load_kg=0.5, at_s=100.0)
    assert str(start_of(at)).endswith("+0.5 kg, 100 s after take-off")
    parts = list(cut(believed(), {"one": at}, 2.5).records.values())
    told = [start_of(p).at_s for p in parts]
    middles = [float(np.mean(p.t_s[[0, -1]])) for p in parts]
    assert np.diff(told) == pytest.approx(np.diff(middles))
    assert told[0] == pytest.approx(100.0 + middles[0] - np.mean(record.t_s[[0, -1]]))


def test_records_of_one_log_say_when_they_were_flown():
    def part(span, log):
        return replace(commands()[0], provenance={"sha256": log, CUT: span})

    records = {"a": part([10.0, 20.0], "x"), "b": part([400.0, 420.0], "x"), "c": part([5.0, 9.0], "y")}
    records |= {"d": part([2.0, 12.0], "z"), "e": part([12.0, 22.0], "z")}  # a log too short to show what grows
    told = {n: start_of(r) for n, r in timed(records, CONDITION).items()}
    assert told == {"a": Start(CONDITION, at_s=15.0), "b": Start(CONDITION, at_s=410.0), **dict.fromkeys("cde")}


def test_a_new_case_says_when_records_of_one_log_were_flown(tmp_path):
    files = []
    for i, (record, begins_s) in enumerate(zip(measure(believe(), 3), (30.0, 900.0), strict=True)):
        span = [begins_s, begins_s + record.duration_s]
        files.append(tmp_path / f"{i}.nc")
        replace(record, provenance={"suite": "eolo_gap", "sha256": "x", CUT: span}).save(files[-1])
    text = new_case(tmp_path / "mine.toml", "eolo", files, wings="rigid").text
    assert [line for line in text.splitlines() if line.startswith("flown_at_s")] == [
        f"flown_at_s = {at}  # in its log, whose beginning is taken for take-off" for at in ("30.0", "900.0")
    ]
    assert "condition = " not in text.partition("[[measured]]")[2]  # one condition, at two times


def test_a_time_before_take_off_is_refused(tmp_path):
    text = (SCENARIOS / "gap" / "battery.toml").read_text().replace("flown_at_s = 60.0", "flown_at_s = -60.0")
    (tmp_path / "early.toml").write_text(text)
    with pytest.raises(ScenarioError, match="flown_at_s"):
        GapScenario.load(tmp_path / "early.toml")


@pytest.mark.slow
@pytest.mark.parametrize("named", ["thrust_fade", "fuel_burn"])
def test_a_battery_and_a_tank_that_empty_are_named_with_their_rates(named, tmp_path):
    text = (SCENARIOS / "gap" / "battery.toml").read_text()
    assert "thrust_fade, per_min = 0.012" in text.replace('"', "")
    (tmp_path / "case.toml").write_text(text.replace("thrust_fade", named))
    result = run_gap(tmp_path / "case.toml")
    naming = result.finding.naming
    # Its form with a power of time holds it, as a power of 1: a set of both is right, too.
    assert naming.names[0] == named, naming.sentence
    assert set(naming.names) <= {named, f"uneven_{named}"}
    assert naming.best.values["per_min"] == pytest.approx(0.012, abs=4.0 * naming.best.errors["per_min"])
    if named == "fuel_burn":  # the amended model is as light as the aircraft was in the latest record
        before, after = (
            float(
                re.search(rf"^{sign} *<emptywt unit=.KG.>(.*)</emptywt>", amended_files(result)["model.diff"], re.M)[1]
            )
            for sign in (r"\-", r"\+")
        )
        assert after / before == pytest.approx(1.0 - naming.best.values["per_min"] * 1508.0 / 60.0, rel=1e-3)
