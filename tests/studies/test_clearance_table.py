"""The table of envelope expansions holds what the page on it says, and what was asked of the method."""

import numpy as np
from smallest import ROOT
from studies.hidden_wings import KINDS
from tables import read_rows


def test_the_page_says_what_the_study_found():
    rows = read_rows(ROOT / "results" / "plan" / "clearance.csv")
    reached = {
        rule: np.array([float(r["reached"]) for r in rows if r["rule"] == rule]) for rule in ("posterior", "trend")
    }
    assert {len(x) for x in reached.values()} == {300}
    assert {r["kind"] for r in rows} == set(KINDS)
    assert all((float(r["reached"]) > 1.0) == bool(int(r["overrun"])) for r in rows)
    over = {rule: int((x > 1.0).sum()) for rule, x in reached.items()}
    assert over["posterior"] <= 0.05 * 300
    assert np.median(reached["posterior"]) >= 0.85
    page = " ".join((ROOT / "docs" / "theory" / "elastic.md").read_text("utf-8").split())
    median = 100.0 * np.median(reached["posterior"])
    short = int((reached["posterior"] < 0.7).sum())
    assert f"overran the onset in {over['posterior']} of 300 and reached {median:.0f} % of it in the median" in page
    assert f"below 70 % in {short}" in page
    assert f"fixed steps of 10 % by the damping overran it in {over['trend']}" in page
