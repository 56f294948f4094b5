"""Summaries: bias, scatter and coverage of cases whose answer is known, failures by cause, and the same bytes."""

import json
import math

import numpy as np
import pytest

from testbench.questions.campaign.page import runs_csv
from testbench.questions.campaign.store import Row
from testbench.questions.campaign.summary import summarise

CASE = "suite, method"


def rows(n: int, bias: float, stated: float) -> list[Row]:
    """Runs with true value 2 + i / n, unit scatter, a mode read off two outputs, and every tenth failed."""
    rng = np.random.default_rng(1)
    out = []
    for i in range(n):
        inputs = json.dumps({"condition.V_m_s": 10.0 + i})
        if i % 10 == 9:
            out.append(Row(i, "failed", i, inputs, None, f"TrimError: alpha = {i}.5 deg at {i / 7:.3e} m"))
            continue
        true = 2.0 + i / n
        figures = {"a": true + bias + float(rng.standard_normal()), "a, std": stated, "a, true": true}
        figures |= {"short period (q) zeta": None if i % 4 == 0 else 0.6, "short period (u) zeta": 0.5}
        found = {"figures": {CASE: figures}, "true": {"short period zeta": 0.5}, "poles": {CASE: {"q": [[-1.0, 2.0]]}}}
        out.append(Row(i, "done", i, inputs, json.dumps(found), None))
    return out


def test_bias_scatter_and_coverage_of_honest_errors():
    """3600 done runs; five standard errors each: a false alarm has a probability below 1e-6."""
    found = summarise(rows(4000, 0.0, 1.0))
    (a,) = [x for x in found.accuracies if x.name == f"{CASE}: a"]
    n = 3600
    assert (a.n, a.missing) == (n, 0)
    assert abs(a.bias) < 5 / math.sqrt(n)
    assert a.bias_half == pytest.approx(1.96 * a.scatter / math.sqrt(n), rel=1e-4)
    assert abs(a.scatter - 1.0) < 5 / math.sqrt(2 * n)
    assert abs(a.coverage - 0.95) < 5 * math.sqrt(0.95 * 0.05 / n)
    assert a.coverage_low < a.coverage < a.coverage_high
    assert a.stated == pytest.approx(1.0)
    assert found.failed == 400


def test_bias_and_errors_stated_too_small_are_seen():
    """Stated errors of half the scatter cover 1.96 / 2 standard deviations: 67.3 % of a Gaussian."""
    (a, *_) = summarise(rows(4000, 0.5, 0.5)).accuracies
    assert a.biased
    assert a.bias == pytest.approx(0.5, abs=5 / 60)
    assert a.rms == pytest.approx(math.hypot(a.bias, a.scatter), rel=1e-3)
    (honest, *_) = summarise(rows(4000, 0.0, 0.5)).accuracies
    assert abs(honest.coverage - 0.673) < 5 * math.sqrt(0.673 * 0.327 / 3600)


def test_modes_of_every_output_are_compared_with_the_one_truth_and_missing_ones_counted():
    found = {a.name.removeprefix(f"{CASE}: "): a for a in summarise(rows(40, 0.0, 1.0)).accuracies}
    assert set(found) == {"a", "short period (q) zeta", "short period (u) zeta"}
    assert found["short period (u) zeta"].bias == 0.0
    q = found["short period (q) zeta"]
    assert q.bias == pytest.approx(0.1)
    assert (q.n, q.missing) == (26, 10)
    assert math.isnan(q.coverage)


def test_causes_that_differ_in_numbers_only_are_one():
    (cause,) = summarise(rows(40, 0.0, 1.0)).causes
    assert cause.reason == "TrimError: alpha = # deg at # m"
    assert (cause.count, cause.first) == (4, 9)
    assert cause.example == "TrimError: alpha = 9.5 deg at 1.286e+00 m"


def test_figures_without_truth_beside_them_and_quantiles():
    found = {f.name: f for f in summarise(rows(40, 0.0, 1.0)).figures}
    assert f"{CASE}: a, true" not in found
    assert f"{CASE}: a, std" not in found
    q = found[f"{CASE}: short period (u) zeta"]
    assert q.quantiles == (0.5,) * 5
    assert q.std == 0.0


def test_the_table_of_runs_has_every_digit_and_no_clock():
    text = runs_csv(summarise(rows(30, 0.0, 1.0)))
    assert text == runs_csv(summarise(iter(rows(30, 0.0, 1.0))))
    head, first, *rest = text.splitlines()
    assert head.startswith("run,state,condition.V_m_s,")
    assert "second" not in head
    assert len(rest) == 29
    assert rest[8].startswith("9,failed,19.0,,")
    assert repr(summarise(rows(30, 0.0, 1.0)).columns[f"{CASE}: a"][0].item()) in first


def test_nothing_finished_is_no_error():
    found = summarise([])
    assert found.figures == found.accuracies == found.causes == ()
    assert found.failed == 0
