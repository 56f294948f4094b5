"""Tidy tables: one row per run, suite, estimator and figure, the same from every folder of results."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from failing_estimators import NEEDS_ALPHA, own, write

import testbench as tb
from testbench.core.errors import RecordError
from testbench.questions.campaign.ask import fly_campaign
from testbench.questions.campaign.load import load_campaign
from testbench.questions.campaign.page import campaign_page
from testbench.questions.campaign.result import read_campaign
from testbench.questions.campaign.store import Store
from testbench.questions.run.page import run_page
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
