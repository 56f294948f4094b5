"""The prediction checked by estimation, and designs against the pilots' rules; both studies, small and in full."""

import csv
from pathlib import Path

import numpy as np
import pytest
from design_problems import CASES, against_rules, check_predictions, misordered, write_tables


@pytest.mark.slow
def test_predicted_errors_are_found_small():
    """Two designs, 40 estimates each.

    The pooled ratio of four standard errors scatters by at most 1 / sqrt(80) = 11 %; 35 % is three of it and
    more. False alarm below 1 in 500; seed fixed.
    """
    found = check_predictions("taurus", 40, designs=2)
    for c in found:
        assert c.pooled == pytest.approx(1.0, abs=0.35)
    assert misordered(found, 40) == []


@pytest.mark.parametrize(
    ("name", "by_modes"),
    [
        pytest.param(name, by_modes, marks=[] if (name, by_modes) == ("eolo", True) else [pytest.mark.slow])
        for name in CASES
        for by_modes in (False, True)
    ],
)
def test_designs_beat_the_papers_doublet_and_3211(name, by_modes):
    """At the same record and the same peak: at least 2 and 1.3 times in the worst relative standard error."""
    for rule in against_rules(name, by_modes):
        assert rule.gain >= (2.0 if rule.rule == "doublet" else 1.3)
        assert rule.short_gain >= 0.99  # best of all signs, moving no longer than the rule does


def test_the_guide_says_what_the_studies_found():
    """Promise, robustness and 3-2-1-1 of the guide on plans are those of the tables."""
    root = Path(__file__).resolve().parents[2]
    guide = " ".join((root / "docs" / "guides" / "plan_a_flight.md").read_text("utf-8").split())

    def rows(name):
        with (root / "results" / "design" / f"{name}.csv").open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))

    promise = rows("promise")
    assert len({r["design"] for r in promise}) == 6
    assert all(abs(float(r["fresh_over_headline"]) - 1.0) <= 0.25 for r in promise)
    flights = sorted({int(r["fresh_flights"]) for r in promise})
    assert min(flights) >= 100
    words = " or ".join(str(n) for n in flights)
    assert f"All {len(promise)} headline errors of six designs lie within 25 % of what {words} fresh flights" in guide
    taurus, b1, eolo = rows("robust")
    assert f"{taurus['worst_ratio']} (Taurus), {eolo['worst_ratio']} (EOLO) and {b1['worst_ratio']} (B-1)" in guide
    assert f"{taurus['fresh_worst_ratio']}, {eolo['fresh_worst_ratio']} and {b1['fresh_worst_ratio']}" in guide
    worst = {(r["design"], r["way"], r["flights"]): float(r["worst_target_rms_percent"]) for r in rows("sequential")}
    for label, design in (("EOLO", "eolo longitudinal"), ("B-1", "b1 longitudinal")):
        for n in "123":
            cells = " | ".join(f"{worst[design, way, n]:.1f} %" for way in ("one-shot", "sequential", "3-2-1-1"))
            assert f"| {label}, {n} flight{'s' if n != '1' else ''} | {cells} |" in guide.replace("**", "")


@pytest.mark.slow
def test_both_studies_in_full(tmp_path):
    """Ten designs over both aircraft, 200 estimates each: every error within 15 % of the predicted one.

    An error from 200 estimates scatters by 5 %, so that 40 of them stay within 15 % with probability 0.9 if the
    prediction is exact; seed fixed.
    """
    for name in CASES:
        found = check_predictions(name, 200)
        for c in found:
            assert np.abs(c.found / c.predicted - 1.0).max() < 0.15
            assert c.pooled == pytest.approx(1.0, abs=0.10)
        assert misordered(found, 200) == []
    prediction, rules = write_tables(tmp_path, 5)
    with rules.open(encoding="utf-8") as file:
        assert len(list(csv.reader(file))) == 9
    assert prediction.stat().st_size > 500
