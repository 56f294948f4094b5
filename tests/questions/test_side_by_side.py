"""Estimators side by side: the pairs, ranks and figures of campaigns and comparisons."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from failing_estimators import write

from testbench.questions.campaign.ask import fly_campaign
from testbench.questions.campaign.load import load_campaign
from testbench.questions.campaign.methods import contests, ranked_contests
from testbench.questions.campaign.page import campaign_page
from testbench.questions.campaign.result import read_campaign
from testbench.questions.campaign.store import Store
from testbench.questions.compare import methods as compared
from testbench.questions.compare.result import CaseKey, Quantity
from testbench.questions.side_by_side import Contest, calibration_panel, pair_table, rank_plates, rank_table

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
    assert [c.where for c in compared.contests(result)] == ["s, one", "s, two"]
    (ranked,) = compared.ranked_contests(result)
    assert ranked.errors.shape == (8, 2)
    assert ranked.ranked is not None
    assert ranked.ranked.mean.tolist() == [1.0, 2.0]


def test_a_stated_error_of_nothing_does_not_hide_the_others():
    panel = calibration_panel("a", np.array([1.0, -1.0, 0.5]), np.array([1.0, 1.0, 1e-16]))
    assert max(float(np.max(c.y)) for c in panel.curves) == 1000.0
