"""The committed tables of the estimator study hold what is said of the estimators, and their commands still run."""

import csv
import re

import pytest

from testbench.estimators.parametric import equation_error
from tests.studies import estimator_study, subspace_inputs

RESULTS = estimator_study.RESULTS
AIRCRAFT = list(estimator_study.CONDITIONS)


def table(name):
    with (RESULTS / name).open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def scatter(aircraft):
    return {row["method"]: row for row in table(f"scatter_{aircraft}.csv")}


@pytest.mark.parametrize("aircraft", AIRCRAFT)
def test_every_method_is_in_the_table(aircraft):
    rows = scatter(aircraft)
    assert list(rows) == list(estimator_study.METHODS)
    for method, (share, _) in estimator_study.METHODS.items():
        assert int(rows[method]["seeds"]) == round(400 * share)


@pytest.mark.parametrize("aircraft", AIRCRAFT)
def test_output_error_reaches_the_bound(aircraft):
    row = scatter(aircraft)["output_error"]
    assert float(row["rms_over_bound_derivatives"]) == pytest.approx(1.0, abs=0.05)
    assert float(row["coverage_derivatives"]) == pytest.approx(0.95, abs=0.022)


@pytest.mark.parametrize("aircraft", AIRCRAFT)
def test_intervals_cover_or_the_method_says_that_they_do_not(aircraft):
    for method, row in scatter(aircraft).items():
        if not row["coverage_wn"]:
            continue
        inside = all(
            float(row["binomial_low"]) <= float(row[f"coverage_{what}"]) <= float(row["binomial_high"])
            for what in ("wn", "zeta")
        )
        assert inside or method == "equation_error", method


def test_equation_error_says_how_far_its_intervals_fall_short():
    found = {round(100 * float(scatter(a)["equation_error"]["coverage_derivatives"])) for a in AIRCRAFT}
    assert set(map(int, re.findall(r"(\d+) (?:and|%) ", equation_error._BIASED)[:2])) == found


def test_our_subspace_methods_are_never_wrong_in_silence():
    rows = [r for r in table("subspace_inputs.csv") if r["method"] in subspace_inputs.OURS]
    assert len(rows) == len(subspace_inputs.OURS) * 5 * 2 * 2
    assert all(r["wrong_in_silence"].startswith("0/") for r in rows)
    assert {r["method"] for r in table("subspace_inputs.csv")} > {"nfoursid", "Octave moen4", "SIPPY N4SID"}


def test_the_study_runs_and_resumes(tmp_path):
    arguments = [
        "--aircraft",
        "taurus",
        "--methods",
        "output_error",
        "moesp",
        "--seeds",
        "4",
        "--folder",
        str(tmp_path),
    ]
    estimator_study.main(arguments)
    first = (tmp_path / "scatter_taurus.csv").read_text()
    estimator_study.main([*arguments, "--resume"])
    assert (tmp_path / "scatter_taurus.csv").read_text() == first
    rows = list(csv.DictReader(first.splitlines()))
    assert [r["method"] for r in rows] == ["output_error", "moesp"]
    # 4 seeds: chi-squared with 56 degrees of freedom, its root scatters by 9.4 %; four of them
    assert float(rows[0]["rms_over_bound_derivatives"]) == pytest.approx(1.0, abs=0.38)
