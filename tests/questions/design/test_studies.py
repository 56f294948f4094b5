"""The prediction checked by estimation, and designs against the pilots' rules; both studies, small and in full."""

import csv

import numpy as np
import pytest
from design_problems import CASES, against_rules, check_predictions, misordered, write_tables


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
