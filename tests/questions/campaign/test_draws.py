"""Draws: functions of the campaign's seed, the run's number and the key, and of nothing else."""

import numpy as np

from testbench.questions.campaign.draws import nominal_inputs, run_inputs, run_seed
from testbench.questions.campaign.scenario import CampaignSpec


def spec(**changes) -> CampaignSpec:
    content = {
        "title": "draws",
        "base": "taurus_doublet",
        "runs": 10,
        "seed": 3,
        "vary": {
            "n": {"kind": "normal", "mean": 2.0, "std": 0.5},
            "u": {"kind": "uniform", "low": -1.0, "high": 3.0},
            "l": {"kind": "lognormal", "median": 2.0, "sigma": 0.3},
            "c": {"kind": "choice", "among": ["a", "b"], "weights": [3.0, 1.0]},
            "v": {"kind": "values", "values": [1, 2, 3]},
        },
    }
    return CampaignSpec.model_validate(content | changes)


def test_distributions_have_their_moments():
    """4000 runs of one seed; five standard errors each: a false alarm has a probability below 1e-5."""
    n, rows = 4000, [run_inputs(spec(), i) for i in range(4000)]
    x = {k: np.array([r[k] for r in rows]) for k in rows[0]}
    assert abs(x["n"].mean() - 2.0) < 5 * 0.5 / np.sqrt(n)
    assert abs(x["n"].std() / 0.5 - 1.0) < 5 / np.sqrt(2 * n)
    assert abs(x["u"].mean() - 1.0) < 5 * 4.0 / np.sqrt(12 * n)
    assert x["u"].min() >= -1.0
    assert x["u"].max() <= 3.0
    assert abs(np.log(x["l"] / 2.0).mean()) < 5 * 0.3 / np.sqrt(n)
    assert abs(np.mean(x["c"] == "a") - 0.75) < 5 * np.sqrt(0.75 * 0.25 / n)
    assert x["v"][:6].tolist() == [1, 2, 3, 1, 2, 3]
    assert abs(np.corrcoef(x["n"], x["u"])[0, 1]) < 5 / np.sqrt(n)


def test_a_run_does_not_depend_on_the_others_nor_on_further_keys():
    whole = spec()
    alone = spec(runs=1000, vary={"u": whole.vary["u"].model_dump(), "n": whole.vary["n"].model_dump()})
    for i in (0, 7, 999):
        assert run_inputs(alone, i)["n"] == run_inputs(whole, i)["n"]
        assert run_seed(alone, i) == run_seed(whole, i)
    assert run_inputs(whole, 0) != run_inputs(whole, 1)
    assert run_inputs(whole, 0)["n"] != run_inputs(spec(seed=4), 0)["n"]
    assert len({run_seed(whole, i) for i in range(1000)}) == 1000  # two equal ones: probability 1e-4


def test_a_grid_takes_every_combination_in_turn_and_grows_at_its_end():
    grid = spec(runs=None, repeats=2, vary={}, grid={"a": [1, 2], "b": [5, 6, 7]})
    rows = [tuple(run_inputs(grid, i).values()) for i in range(grid.total)]
    assert grid.total == 12
    assert rows[:6] == [(1, 5), (1, 6), (1, 7), (2, 5), (2, 6), (2, 7)]
    assert rows[6:] == rows[:6]
    assert nominal_inputs(grid) == {"a": 1, "b": 5}


def test_the_middle_of_each_distribution():
    assert nominal_inputs(spec()) == {"n": 2.0, "u": 1.0, "l": 2.0, "c": "a", "v": 1}
