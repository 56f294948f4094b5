"""What the guide says of global models is in the table that the study wrote."""

from pathlib import Path

import pytest
from tables import read_rows

TABLE = Path(__file__).parents[2] / "results" / "estimators" / "global.csv"


def rows(aircraft: str, instruments: str) -> dict[str, dict[str, str]]:
    table = read_rows(TABLE)
    return {r["coefficient"]: r for r in table if (r["aircraft"], r["instruments"]) == (aircraft, instruments)}


@pytest.mark.parametrize("instruments", ["as sold", "drawn"])
@pytest.mark.parametrize("aircraft", ["f16", "T38"])
def test_functions_of_the_jets_are_within_five_percent_over_nine_tenths(aircraft, instruments):
    found = rows(aircraft, instruments)
    assert len(found) == 6
    assert all(float(r["near_percent"]) >= 90.0 for r in found.values())


def test_the_pitching_moment_behind_a_propeller_is_not():
    assert all(float(rows("c172p", how)["Cm"]["near_percent"]) < 90.0 for how in ("as sold", "drawn"))


def test_errors_that_are_stated_are_of_the_size_of_those_that_are_made():
    drawn = [r for a in ("f16", "T38", "c172p") for r in rows(a, "drawn").values()]
    assert all(0.3 < float(r["z_rms"]) < 1.4 for r in drawn)
    assert all(float(r["within_2"]) >= 88.0 for r in drawn)
