"""The blind tests of control paths with recorded surfaces, and of what grows with time: what flies, what is sealed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from studies.blind import over_time, paths
from studies.blind.cases import counts_of, opened, seal
from studies.blind.flights import CONTROLS, SMALL, SURFACES, fly_over_time, fly_paths, suite, told
from studies.blind.kinds import OVER_TIME_KINDS, PATH_KINDS
from studies.blind.lateral_truths import LATERAL
from studies.blind.parts import parts_said
from studies.blind.run import believe, searched
from studies.blind.truth import Truth
from studies.blind.truths import OVER_TIME, TRUTHS

RESULTS = Path(__file__).resolve().parents[3] / "results" / "gap"
DRAWS = {"paths": (paths, counts_of("paths")), "over_time": (over_time, counts_of("time"))}
PATH_PARTS = {"elevator path", "aileron path", "rudder path", "autopilot"}
SEEN = 200.0  # least sum of squares, in units of the noise, by which a kind must change the six records


@pytest.mark.parametrize("draw", DRAWS)
def test_the_answers_are_those_that_were_sealed(draw):
    study, counts = DRAWS[draw]
    drawn = opened((RESULTS / draw / "answers.json").read_text(encoding="utf-8").removesuffix("\n"))
    assert {s: sum(c.stratum == s for c in drawn) for s in counts} == counts
    sealed = (RESULTS / draw / "sealed.sha256").read_text(encoding="utf-8")
    assert sealed.startswith(seal(drawn)[1])
    assert sealed.endswith(f"seed {study.SEED}\n")
    assert {c.kinds for c in drawn if not c.row.hides} == {()}
    assert all(c.without for c in drawn if c.row.taken_out)


def test_what_acts_in_a_path_is_drawn_and_every_name_that_check_sizes_is_sought():
    assert set(PATH_KINDS) <= {*TRUTHS, *LATERAL}
    known, further = searched(believe("eolo", draw="paths"))
    for kind in PATH_KINDS.values():
        assert set(kind.names) <= {*known, *further}
        assert parts_said(kind.names) <= PATH_PARTS
    assert set(OVER_TIME) == set(OVER_TIME_KINDS)
    assert {n for k in OVER_TIME_KINDS.values() for n in k.names} <= set(searched(believe("eolo", draw="time"))[0])


@pytest.mark.parametrize("aircraft", SMALL)
def test_what_is_believed_flies_from_three_conditions_with_nothing_left_but_noise(aircraft):
    truth = Truth(factors={"Cm_q": 1.2, "Cl_beta": 0.8})
    tuned = believe(aircraft, draw="paths").with_nuisances(truth.factors)
    for which in ("rich", "held_out"):
        records = told("paths", aircraft, which, fly_paths(aircraft, truth, which, 7))
        energies = [float(np.mean(tuned.residuals(r) ** 2)) for r in records.values()]
        # thirteen channels of 480 samples and more: the mean of so many squares of white noise scatters by 0.018
        assert energies == pytest.approx([1.0] * len(records), abs=5 * 0.018)  # false alarm 5e-6


def test_surfaces_are_recorded_as_they_turn_and_commands_as_they_were_issued():
    made = LATERAL["interconnect"]({"ratio": 0.5}, "eolo")
    plain, records = (fly_paths("eolo", t, "rich", 5) for t in (Truth(), made))
    one, other = plain["aileron 3211"], records["aileron 3211"]
    assert set(SURFACES) <= set(other.channels)
    assert other["dr_cmd"] == pytest.approx(one["dr_cmd"], abs=1e-12)
    drawn = np.ptp(other["dr"] - one["dr"])
    assert drawn == pytest.approx(0.5 * np.ptp(one["da_cmd"]), rel=0.25)  # a servo lies between, and noise


@pytest.mark.parametrize("kind", ["battery that droops", "thirsty climb", "tank ahead that empties"])
def test_what_empties_shows_late_and_not_early(kind):
    draws = [OVER_TIME_KINDS[kind].draw(np.random.default_rng(i)) for i in range(8)]
    sizes = {n: sorted(d[n] for d in draws)[4] for n in draws[0]}
    noise = {n: s for n, s in suite("time").noise_std.items() if s > 0.0}
    plain, records = (fly_over_time("taurus", t, "rich", 5) for t in (Truth(), OVER_TIME[kind](sizes, "taurus")))

    def apart(name: str) -> float:
        d = (records[name].columns(noise) - plain[name].columns(noise)) / np.array([*noise.values()])
        return float(np.sum((d - d.mean(axis=0)) ** 2))

    first, *_, last = plain
    assert apart(last) > SEEN
    assert apart(first) < 0.3 * apart(last)


@pytest.mark.parametrize(("channel", "kind"), [("q", "pitch gyro that warms up"), ("V", "airspeed port that ices")])
def test_a_reading_that_runs_away_is_the_only_one_that_does(channel, kind):
    plain, records = (
        fly_over_time("taurus", t, "held_out", 5) for t in (Truth(), OVER_TIME[kind]({"per_s": 0.01}, ""))
    )
    for name, record in records.items():
        away = record[channel] - plain[name][channel]
        assert away[0] == 0.0
        assert 0.05 < away[-1] < 0.3
        assert np.all(np.diff(away) > 0.0)
        others = [c for c in record.channels if c != channel]
        assert np.array_equal(record.columns(others), plain[name].columns(others))


@pytest.mark.parametrize("draw", DRAWS)
def test_a_page_says_how_many_were_run_and_what_is_not_right(draw):
    study, _ = DRAWS[draw]
    drawn = opened((RESULTS / draw / "answers.json").read_text(encoding="utf-8").removesuffix("\n"))[:4]
    row = {"outcome": "named", "names": ["az_position"], "best": "", "accused": [], "seconds": 40.0}
    text = study.page(drawn, {drawn[0].name: row})
    assert "**1 of 4 planned cases have been run**" in text
    assert f"| {drawn[0].stratum} | wrong part | 1 of 1 |" in text
    assert f"| {drawn[0].name} | {drawn[0].aircraft} |" in text


def test_a_record_of_the_draw_does_not_say_what_was_hidden():
    record = next(iter(fly_paths("eolo", Truth(), "held_out", 5).values()))
    assert set(record.provenance) == {"manoeuvre"}
    assert set(record.channels) == {*suite("paths").outputs, *SURFACES, *(f"{c}_cmd" for c in CONTROLS)}
