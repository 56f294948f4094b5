"""The committed table of the advice study holds what is said of the advice, and its command runs and resumes."""

import csv
import re

import pytest

from tests.studies import advice_study
from tests.studies.advice_cases import CASES

LOOP = advice_study.TABLE.with_name("advice_loop.csv")
README = advice_study.TABLE.with_name("README.md")
BIASED = {"transfer_function"}  # noise biases it, and it says so


def table(path=advice_study.TABLE):
    with path.open(encoding="utf-8", newline="") as stream:
        return [{k: v if k in ("case", "method") else int(v) for k, v in r.items()} for r in csv.DictReader(stream)]


def total(rows, name):
    return sum(r[name] for r in rows)


def test_every_method_is_in_the_table():
    assert {(r["case"], r["method"]) for r in table()} == {(c, m) for c in CASES for m in advice_study.methods(c)}


def test_wrong_estimates_are_flagged_and_their_cause_is_named():
    # Named in nine of ten; the loop, whose damper hides in the noise of its sensors, in seven of eight.
    for case in CASES:
        rows = [r for r in table() if r["case"] == case]
        assert total(rows, "wrong_flagged") >= 0.9 * total(rows, "wrong")
        assert total(rows, "wrong_named") >= (0.875 if case == "loop" else 0.9) * total(rows, "wrong")


def test_the_loop_is_named_on_flights_that_chose_nothing():
    rows = table(LOOP)
    wrong, named = (total(rows, name) for name in ("wrong", "wrong_named"))
    assert {r["method"] for r in rows} == set(advice_study.methods("loop"))
    assert all(r["seeds"] == 100 for r in rows)
    assert named / wrong == pytest.approx(0.9, abs=0.005)
    assert f"{named} of {wrong} wrong\nestimates are named" in README.read_text("utf-8")


def test_clean_fits_are_good():
    rows = [r for r in table() if r["case"] == "clean" and r["method"] not in BIASED]
    right = total(rows, "seeds") - total(rows, "refused") - total(rows, "wrong")
    assert total(rows, "flagged") - total(rows, "wrong_flagged") <= 0.02 * right


def test_the_page_quotes_the_table():
    quoted = dict(
        re.findall(r"^\| ([a-z0-9]+): .*?\| (\d+ \| \d+ \| \d+) \|$", README.read_text("utf-8"), re.MULTILINE)
    )
    for case in CASES:
        rows = [r for r in table() if r["case"] == case]
        counts = (total(rows, name) for name in ("wrong", "wrong_flagged", "wrong_named"))
        assert quoted[case] == " | ".join(str(n) for n in counts)


def test_the_study_runs_and_resumes(tmp_path):
    kept, out = tmp_path / "kept.jsonl", tmp_path / "advice.csv"
    given = ["--methods", "moesp", "transfer_function", "--kept", str(kept), "--table", str(out)]
    advice_study.main([*given, "--seeds", "1"])
    first = kept.read_text()
    advice_study.main([*given, "--seeds", "1"])
    assert kept.read_text() == first
    with out.open(encoding="utf-8", newline="") as stream:
        rows = {(r["case"], r["method"]): r for r in csv.DictReader(stream)}
    assert len(rows) == 2 * len(CASES)
    assert all(r["seeds"] == "1" for r in rows.values())
    assert rows["clean", "moesp"]["flagged"] == "0"  # false alarm: 2e-3, and on this seed for good
    assert rows["stall", "moesp"]["wrong_named"] == rows["stall", "moesp"]["wrong"]


@pytest.mark.parametrize("case", [c for c in CASES if c not in ("clean", "order4", "short")])
def test_a_wrong_estimate_is_named_on_a_seed_of_the_study(case):
    for seed in (101, 102):  # chance of a miss: some 2 % each, and on these seeds for good
        wrong, flagged, named = advice_study.judge(case, "dsr_e", seed)
        assert flagged and named if wrong else True
