"""Tidy tables: one row per run, suite, estimator and figure, the same from every folder of results.

Estimators side by side: the pairs, ranks and figures of campaigns and comparisons.
"""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from failing_estimators import NEEDS_ALPHA, own, write

import testbench as tb
from testbench.core.errors import RecordError
from testbench.questions.campaign.ask import fly_campaign
from testbench.questions.campaign.load import load_campaign
from testbench.questions.campaign.page import campaign_page
from testbench.questions.campaign.result import contests, ranked_contests, read_campaign
from testbench.questions.campaign.store import Store
from testbench.questions.compare import page
from testbench.questions.compare.result import CaseKey, Quantity
from testbench.questions.run.page import run_page
from testbench.questions.side_by_side import Contest, calibration_panel, pair_table, rank_plates, rank_table
from testbench.questions.tidy import COLUMNS

CAMPAIGN = """
title = "Own"
base = "cells.toml"
runs = 6
seed = 2
[vary]
"condition.V_m_s" = { kind = "normal", mean = 16.0, std = 0.2 }
"""


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign")
    write(folder, f"{own('raises', 'works')}, {NEEDS_ALPHA}")
    (folder / "own.toml").write_text(CAMPAIGN, encoding="utf-8")
    loaded = load_campaign(folder / "own.toml")
    fly_campaign(loaded, folder / "s", workers=1)
    with Store.read(folder / "s") as store:
        page = campaign_page(read_campaign(loaded, store))
    page.write(folder / "s")
    return folder / "s"


def test_the_store_gives_every_figure_with_truth_and_error(campaign) -> None:
    table = tb.read_results(campaign)
    assert list(table.columns) == [*COLUMNS, "condition.V_m_s"]
    with Store.read(campaign) as store:
        rows = list(store.rows())
    for row in rows:
        found = json.loads(row.results or "")
        of = table[table.run == row.run]
        figures = found["figures"]["eolo_alpha, equation_error"]
        m_q = of[(of.suite == "eolo_alpha") & (of.estimator == "equation_error") & (of.figure == "M_q")].iloc[0]
        assert (m_q.value, m_q.standard_error, m_q.truth) == tuple(figures[f"M_q{e}"] for e in ("", ", std", ", true"))
        wn = of[(of.estimator == "methods.py:works") & (of.figure == "phugoid wn")]
        assert set(wn.truth) == {found["true"]["phugoid wn, rad/s"]}
        assert set(wn.unit) == {"rad/s"}
        assert of["condition.V_m_s"].unique().tolist() == [json.loads(row.inputs)["condition.V_m_s"]]
        assert set(of.seed) == {row.seed}
        plain = [n for f in found["figures"].values() for n in f if not n.endswith((", std", ", true"))]
        assert len(of) == len(plain) + len(found["failed"])
    failed = table[table.figure == ""]
    assert len(failed) == 3 * 6
    assert failed.value.isna().all()
    assert failed[failed.estimator == "methods.py:raises"].reason.str.contains("of my own").all()


def test_the_files_hold_the_same_as_the_store(campaign) -> None:
    table = tb.read_results(campaign)
    text = pd.read_csv(campaign / "tables" / "results.csv")
    packed = pd.read_parquet(campaign / "tables" / "results.parquet")
    for other in (text, packed):
        assert list(other.columns) == list(table.columns)
        for name in ("run", "value", "truth", "standard_error"):
            np.testing.assert_array_equal(other[name].to_numpy(float), table[name].to_numpy(float))
        assert other.figure.fillna("").tolist() == table.figure.tolist()


def test_a_run_gives_the_same_columns(tmp_path) -> None:
    result = tb.run(tb.load_scenario(write(tmp_path, f"{own('works')}, {NEEDS_ALPHA}")), causes=False)
    run_page(result).write(tmp_path / "out")
    table = tb.read_results(tmp_path / "out")
    assert list(table.columns) == list(COLUMNS)
    (case,) = (c for c in result.cases if c.label == "eolo_alpha, equation_error")
    (m_q,) = (p for p in case.evaluation.parameters if p.name == "M_q")
    row = table[(table.estimator == "equation_error") & (table.figure == "M_q")].iloc[0]
    assert (row.value, row.truth, row.standard_error) == (m_q.value, m_q.true, m_q.std)
    assert set(table[table.figure == ""].suite) == {"eolo_no_alpha"}
    assert set(table.aircraft) == {"eolo"}
    (tmp_path / "out" / "tables" / "results.parquet").unlink()
    pd.testing.assert_frame_equal(tb.read_results(tmp_path / "out"), table, check_categorical=False, check_dtype=False)
    model = tmp_path / "out" / "models" / "eolo_alpha_equation_error.json"
    assert "promise" not in json.loads(model.read_text("utf-8"))
    (tmp_path / "promises").mkdir()
    promise = tmp_path / "promises" / "1_x.json"
    promise.write_text("{}", "utf-8")
    design = replace(result, source=result.source.at(tmp_path / "designs" / "1_x.toml"))
    run_page(design).write(tmp_path / "out")
    assert json.loads(model.read_text("utf-8"))["promise"] == promise.as_posix()  # for `testbench design --after`


def test_a_folder_without_results_is_named(tmp_path) -> None:
    with pytest.raises(RecordError, match=r"must hold campaign.sqlite or tables/results.csv, got none"):
        tb.read_results(tmp_path)


TWO = (
    '{ method = "dsr_e", order = 4, past_horizon = 10, future_horizon = 10 }, '
    '{ method = "equation_error", structure = "longitudinal", short = true, V_m_s = 16.0 }'
)


def column(table, key: str) -> list:
    k = [c.key for c in table.columns].index(key)
    return [row[k] for row in table.rows]


def test_a_pair_is_told_apart_where_it_differs_and_only_there() -> None:
    rng = np.random.default_rng(1)
    noise = 1.0 + rng.random((30, 1))
    same = Contest("s", "q", "%", ("a", "b"), noise + 0.1 * rng.random((30, 2)))
    worse = Contest("s", "p", "", ("a", "b"), np.hstack([noise, noise + 0.2 + 0.1 * rng.random((30, 1))]))
    many = Contest("s", "r", "", ("a", "b"), rng.random((500, 2)))
    table = pair_table([same, worse, many])
    p = column(table, "p_holm")
    assert p[1] < 1e-6 < 0.05 < min(p[0], p[2])
    assert column(table, "high")[1] < 0.0
    assert column(table, "test") == ["wilcoxon", "wilcoxon", "t"]
    assert all(
        low <= d <= high
        for low, d, high in zip(*(column(table, k) for k in ("low", "difference", "high")), strict=True)
    )


@pytest.mark.usefixtures("rendered")
def test_a_method_that_gave_nothing_is_no_pair_and_ranks_last() -> None:
    errors = np.column_stack([np.arange(1.0, 7.0), np.full(6, np.nan), np.arange(6.0)])
    contest = Contest("s", "q", "%", ("a", "none", "c"), errors)
    table = pair_table([contest])
    assert column(table, "pairs") == [0, 6, 0]
    ranked = rank_table([contest], "runs")
    assert column(ranked, "estimator") == ["c", "a", "none"]
    assert column(ranked, "rank") == [1.0, 2.0, 3.0]
    (plate,) = rank_plates([contest], "runs")
    assert len(plate.draw().png) > 1000


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign")
    write(folder, TWO)
    (folder / "own.toml").write_text(
        'title = "t"\nbase = "cells.toml"\nrepeats = 2\nseed = 2\n[grid]\n'
        '"condition.V_m_s" = [15.5, 15.8, 16.0, 16.2, 16.4]\n'
    )
    loaded = load_campaign(folder / "own.toml")
    fly_campaign(loaded, folder / "s", workers=1)
    with Store.read(folder / "s") as store:
        return read_campaign(loaded, store)


def test_a_campaign_compares_what_two_estimators_give(flown) -> None:
    found = {(c.where, c.figure): c for c in contests(flown)}
    assert {where for where, _ in found} == {"eolo_alpha"}  # without alpha, one of the two gives nothing
    q = found["eolo_alpha", "validation MRSE of q"]
    assert q.methods == ("dsr_e", "equation_error")
    expected = flown.summary.columns["eolo_alpha, dsr_e: validation MRSE of q, %"]
    np.testing.assert_array_equal(q.errors[:, 0], expected)


@pytest.mark.parametrize("blocks", [3, 200])
@pytest.mark.parametrize("wide", [True, False])
def test_all_that_a_diagram_of_ranks_says_lies_within_it(blocks, wide) -> None:
    """With two estimators the words of the critical difference ran over the edge."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    errors = np.random.default_rng(1).normal(size=(blocks, 2)) ** 2
    (plate,) = rank_plates([Contest("a suite", "prediction", "%", ("moesp", "output_error"), errors)], "runs")
    figure = plate.make(wide)
    FigureCanvasAgg(figure).draw()
    box = figure.bbox
    for text in figure.axes[0].texts:
        words = text.get_window_extent()
        assert box.x0 <= words.x0 < words.x1 <= box.x1, text.get_text()


def test_a_grid_is_ranked_over_its_points(flown) -> None:
    found, over = ranked_contests(flown)
    (contest,) = found
    assert over == "points of the grid"
    assert contest.errors.shape == (5, 2)
    values = flown.summary.columns["eolo_alpha, dsr_e: validation MRSE, %"]
    np.testing.assert_allclose(contest.errors[:, 0], 0.5 * (values[:5] + values[5:]))


def test_the_page_shows_them(flown) -> None:
    page = campaign_page(flown)
    assert {"pairs", "ranks"} <= {t.name for t in page.tables}
    assert {"ranks", "calibration"} <= {p.name for p in page.plates}


def test_a_comparison_ranks_over_repetitions_of_every_input() -> None:
    rng = np.random.default_rng(1)
    quantity = Quantity("prediction", "q")
    errors = {
        CaseKey(m, "s", label): {quantity: base + rng.random(4)}
        for m in ("one", "two")
        for label, base in (("a", 1.0), ("b", 5.0))
    }
    labels = SimpleNamespace(labels=("a", "b"))
    result = SimpleNamespace(
        errors=errors,
        manoeuvres=("one", "two"),
        suites=[SimpleNamespace(name="s")],
        scenario=SimpleNamespace(identification=labels),
    )
    assert [c.where for c in page.contests(result)] == ["s, one", "s, two"]
    (ranked,) = page.ranked_contests(result)
    assert ranked.errors.shape == (8, 2)
    assert ranked.ranked is not None
    assert ranked.ranked.mean.tolist() == [1.0, 2.0]


def test_a_stated_error_of_nothing_does_not_hide_the_others():
    panel = calibration_panel("a", np.array([1.0, -1.0, 0.5]), np.array([1.0, 1.0, 1e-16]))
    assert max(float(np.max(c.y)) for c in panel.curves) == 1000.0
