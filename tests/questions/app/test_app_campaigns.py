"""Campaigns and data sets in the app: what is told of a set while it is drawn and afterwards, and its watching."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from drawn_sets import SMALL

import testbench as tb
from testbench.core.errors import CampaignError, RecordError
from testbench.questions.app.campaigns import campaign_told, list_campaigns
from testbench.questions.app.records import record_told, shown
from testbench.questions.dataset import ask
from testbench.questions.dataset.scenario import DatasetScenario

HARD = SMALL.replace("speed_ratio = [1.0, 1.2]", "speed_ratio = [0.6, 1.2]")  # some attempts are below the stall


def file_of(folder: Path) -> Path:
    path = folder / "hard.toml"
    path.write_text(HARD, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def looks(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[dict]]:
    """Draw a set into the results of a folder, and look at it whenever a part has come, and once it is there."""
    folder = tmp_path_factory.mktemp("bench")
    told: list[dict] = []

    def look(_: object) -> None:
        told.append(campaign_told(folder, folder / "results", {"campaign": "results/set", "first": 0}))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ask, "_MOST_PER_PART", 8)
        tb.draw_dataset(file_of(folder), folder / "results" / "set", workers=1, progress=look)
    look(None)
    return folder, told


def test_a_set_is_told_while_it_is_drawn_as_when_it_is_there(looks):
    """Each look has the draws of the parts so far; their values are those of the complete set, labels withheld."""
    folder, told = looks
    assert [t["finished"] for t in told] == [16, 32, 48, 60, 60]
    assert {(t["total"], t["unit"], t["per_run"]) for t in told} == {(60, "flight", 2)}
    assert [t["next"] for t in told] == [8, 16, 24, None, None]
    drawn = [{row["run"]: row for row in t["rows"] if not row["failed"]} for t in told]
    for before, after in pairwise(drawn):
        assert before == {run: row for run, row in after.items() if run in before}
    flights = tb.open_dataset(folder / "results" / "set")
    assert len(drawn[-1]) == 30
    for run, row in drawn[-1].items():
        one = flights.isel(flight=2 * run)
        test = row["names"]["split"] == "test"
        assert row["inputs"]["V_m_s"] == float(one.V_m_s)
        assert row["names"]["aircraft"] == one.aircraft.attrs["names"][int(one.aircraft)]
        assert (row["names"]["effect"] == "withheld", row["figures"] == {}) == (test, test)
        if not test:
            np.testing.assert_equal(row["figures"]["M_alpha"], float(one.truth.sel(figure="M_alpha")))
    assert {row["names"]["split"] for row in drawn[-1].values()} == {"train", "validation", "test"}


def test_what_failed_is_told_with_what_was_drawn_for_it(looks):
    """The attempts that could not fly are those that the datasheet counts; their airspeeds lie below the others'."""
    folder, told = looks
    failed = [row for row in told[3]["rows"] if row["failed"]]
    sheet = (folder / "results" / "set" / "README.md").read_text("utf-8")
    assert f"Attempts that could not fly: {len(failed)}." in sheet
    assert told[3]["failed"] == len(failed) > 0
    assert (told[4]["failed"], told[4]["sheet"]) == (None, "results/set/README.html")
    slow = [row["inputs"]["V_m_s"] for row in failed if row["names"]["aircraft"] == "taurus"]
    flown = [row["inputs"]["V_m_s"] for row in told[4]["rows"] if row["names"]["aircraft"] == "taurus"]
    assert np.mean(slow) < np.min(flown) + 1.0
    assert all(row["reason"] and row["names"]["state"] == "failed" for row in failed)
    kinds = {row["because"] for row in failed}
    assert len(kinds) < len(failed)
    assert all(why in sheet for why in kinds)


def test_what_was_drawn_stands_in_the_store(looks):
    """The factor of the inputs and the values of each key are those of the draws of the seed, NaN where none varies."""
    folder, _ = looks
    flights = tb.open_dataset(folder / "results" / "set", truth="")
    assert [str(k) for k in flights.key.values] == ["coefficient.Cm_alpha"]
    drawn = flights.drawn.sel(key="coefficient.Cm_alpha").values
    assert np.isnan(drawn[flights.level == 0]).all()
    varied = np.unique(drawn[flights.level == 1])
    assert varied.size == np.unique(flights.draw.values[flights.level == 1]).size
    assert np.abs(varied - 1.0).max() < 5 * 0.05
    scenario = DatasetScenario.load(folder / "hard.toml")
    first = int(flights.draw.values[flights.level == 1][0])
    from testbench.questions.dataset.draws import draw

    attempts = [draw(scenario, first, k).values["coefficient.Cm_alpha"] for k in range(5)]
    assert drawn[2 * first] in attempts
    public = tb.open_dataset(folder / "results" / "set")
    assert np.isnan(public.drawn.values[public.split.values == 2]).all()


def test_flights_of_a_set_are_looked_at_as_records_are(looks):
    folder, told = looks
    run = next(row["run"] for row in told[-1]["rows"] if row["names"]["level"] == "clean")
    path = told[-1]["records"][run][1]
    assert path == f"results/set/flights.h5#{2 * run + 1}"
    one = tb.open_dataset(folder / "results" / "set").isel(flight=2 * run + 1)
    record = shown(folder, path).record
    np.testing.assert_array_equal(record.data, one.readings.values[: int(one.samples)])
    assert record_told(folder, {"record": path})["end_s"] == pytest.approx((int(one.samples) - 1) / 50.0)
    for wrong in (
        "results/set/flights.h5#60",
        "../set/flights.h5#1",
        "results/flights.h5#1",
        "results/set/flights.h5#x",
    ):
        with pytest.raises(RecordError):
            shown(folder, wrong)


def test_sets_are_listed_wherever_they_lie_and_no_other_folder_is_told(looks):
    folder, _ = looks
    tb.draw_dataset(file_of(folder), folder / "beside", runs=2, workers=1)
    assert list_campaigns(folder, folder / "results") == ["beside", "results/set"]
    for name in ("results", "../x", "", None):
        with pytest.raises(CampaignError, match="must be one of the list"):
            campaign_told(folder, folder / "results", {"campaign": name})
    json.dumps(campaign_told(folder, folder / "results", {"campaign": "beside"}))
