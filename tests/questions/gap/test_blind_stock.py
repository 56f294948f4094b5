"""The blind test of stock aircraft at three conditions: what flies, and what is sealed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from studies.blind import fighter, stock_again
from studies.blind.cases import Case, counts_of, opened, seal
from studies.blind.flights import CONTROLS, FIGHTER, RATE_HZ, SETTLE_S, fly_stock, suite, told
from studies.blind.flights import STOCK as AIRCRAFT
from studies.blind.kinds import STOCK_KINDS
from studies.blind.lateral_truths import STOCK
from studies.blind.run import believe
from studies.blind.stock import SEED, page
from studies.blind.truth import Truth

from testbench.questions.gap.starts import Start, marked, start_of
from testbench.questions.hidden import Commands, fly_hidden

RESULTS = Path(__file__).resolve().parents[3] / "results" / "gap"
STRATA = counts_of("stock")
SEEN = 200.0  # least sum of squares, in units of the noise, by which a kind must change the six records


@pytest.fixture(scope="module")
def as_believed():
    return fly_stock("jsbsim:737", Truth(), "rich", 5)


def test_every_kind_is_made_and_drawn():
    assert set(STOCK) == set(STOCK_KINDS)
    assert {k.form for k in STOCK_KINDS.values()} == {"library", "other"}


@pytest.mark.parametrize("kind", STOCK)
def test_every_kind_of_hidden_truth_shows_in_some_record_and_nothing_shows_none(kind, as_believed):
    sizes = STOCK_KINDS[kind].draw(np.random.default_rng(3))
    found = fly_stock("jsbsim:737", STOCK[kind](sizes, "jsbsim:737"), "rich", 5)
    noise = {n: s for n, s in suite("stock").noise_std.items() if s > 0.0}
    apart = [(found[n].columns(noise) - r.columns(noise)) / np.array([*noise.values()]) for n, r in as_believed.items()]
    assert sum(float(np.sum((d - d.mean(axis=0)) ** 2)) for d in apart) > SEEN


@pytest.mark.parametrize("aircraft", [*AIRCRAFT, *FIGHTER])
def test_what_is_believed_flies_from_three_conditions_with_nothing_left_but_noise(aircraft):
    believed, truth = believe(aircraft, draw="stock"), Truth(factors={"Cm_q": 1.2, "Cl_beta": 0.8})
    tuned = believed.with_nuisances(truth.factors)
    for which in ("rich", "held_out"):
        records = told("stock", aircraft, which, fly_stock(aircraft, truth, which, 7))
        energies = [float(np.mean(tuned.residuals(r) ** 2)) for r in records.values()]
        # ten channels of 700 samples and more: the mean of so many squares of white noise scatters by 0.017 about 1
        assert energies == pytest.approx([1.0] * len(records), abs=5 * 0.017)  # false alarm 3e-6
    starts = [start_of(r) for r in told("stock", aircraft, "rich", fly_stock(aircraft, truth, "rich", 7)).values()]
    assert len({s.condition for s in starts}) == 3


def test_a_load_that_is_known_is_carried_where_it_is_said_to_be_in_a_stock_aircraft():
    """It was put that far behind the origin of the model's axes, which is at the nose of an airliner."""
    b, kg, aft_m = believe("jsbsim:B747", draw="stock"), 4e4, 1.5
    u = np.zeros((500, 4))
    u[50:100, :3], u[100:150, :3] = 0.03, -0.03
    flight = Commands("all surfaces", CONTROLS, u, SETTLE_S, 3, Start(b.condition, kg, aft_m))
    (record,) = fly_hidden(Truth().real("jsbsim:B747"), suite("stock"), [flight], RATE_HZ).values()
    energy = float(np.mean(b.residuals(marked(record, Start(b.condition, kg, aft_m))) ** 2))
    assert energy == pytest.approx(1.0, abs=5 * 0.018)  # 10 channels of 600 samples: false alarm 6e-7


@pytest.mark.parametrize(
    ("draw", "seed", "counts", "aircraft"),
    [
        ("stock", SEED, dict(STRATA), AIRCRAFT),
        ("stock_again", stock_again.SEED, dict(STRATA), AIRCRAFT),
        ("fighter", fighter.SEED, fighter.COUNTS, FIGHTER),
    ],
)
def test_the_answers_are_those_that_were_sealed(draw, seed, counts, aircraft):
    folder = RESULTS / draw
    cases = opened((folder / "answers.json").read_text(encoding="utf-8").removesuffix("\n"))
    assert {s: sum(c.stratum == s for c in cases) for s in STRATA} == counts
    assert (folder / "sealed.sha256").read_text(encoding="utf-8").startswith(seal(cases)[1])
    assert (folder / "sealed.sha256").read_text(encoding="utf-8").endswith(f"seed {seed}\n")
    assert {c.aircraft for c in cases} == set(aircraft)
    assert {c.kinds for c in cases if c.stratum == "stock nothing"} == {()}
    assert all(c.without for c in cases if c.row.taken_out)


def test_a_page_says_how_many_were_run_and_what_is_not_right():
    ratio = ("rudder linkage ratio",), ({"gain": 1.5},), {"Cn_dr": 0.9}, (("rudder_surface_scale",),)
    case = Case("stock library form 1", "stock library form", "jsbsim:737", *ratio)
    row = {"outcome": "no gap", "names": [], "best": "", "accused": [["Cn_dr", 1.35, 0.01, ["rudder_surface_scale"]]]}
    text = page([case, replace(case, name="stock library form 2")], {case.name: row | {"seconds": 40.0}})
    assert "**1 of 2 planned cases have been run**" in text
    assert "| stock library form | right or in the set | 1 of 1 |" in text
    assert "| stock library form | a coefficient accused by a wrong size | 0 of 1 |" in text
