"""A suite and an estimator that give no model fail alone, with their reason; the others go on."""

from __future__ import annotations

import threading
import time

import pytest
from failing_estimators import NEEDS_ALPHA, own, write
from typer.testing import CliRunner

from testbench.cli import app
from testbench.core.errors import EstimationError, ScenarioError
from testbench.core.interrupts import TimeUp, time_limit
from testbench.questions.run.answer import run_answer
from testbench.questions.run.ask import load_scenario, run
from testbench.questions.run.page import run_page


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mixed")
    return run(load_scenario(write(folder, f"{own('raises', 'ends', 'nan', 'works')}, {NEEDS_ALPHA}")), causes=False)


def test_every_way_of_failing_is_a_row_with_its_reason(mixed) -> None:
    assert {c.label for c in mixed.cases} == {
        "eolo_no_alpha, methods.py:works",
        "eolo_alpha, methods.py:works",
        "eolo_alpha, equation_error",
    }
    reasons = {c.label: c.reason for c in mixed.failed}
    assert len(reasons) == 7
    assert "ZeroDivisionError: of my own (methods.py, line" in reasons["eolo_alpha, methods.py:raises"]
    assert "got SystemExit: 3 (methods.py, line" in reasons["eolo_alpha, methods.py:ends"]
    assert reasons["eolo_alpha, methods.py:nan"] == "methods.py:nan must return numbers, got NaN in A"
    assert "alpha" in reasons["eolo_no_alpha, equation_error"]


def test_what_works_is_the_same_as_alone(mixed, tmp_path) -> None:
    alone = run(load_scenario(write(tmp_path, own("works"))), causes=False)
    for case in alone.cases:
        same = next(c for c in mixed.cases if c.label == case.label)
        assert same.evaluation.validation.mrse_percent.tolist() == case.evaluation.validation.mrse_percent.tolist()


def test_page_table_and_terminal_say_so(mixed, tmp_path) -> None:
    page = run_page(mixed)
    table = next(t for t in page.tables if t.name == "failed")
    assert len(table.rows) == 7
    assert table in page.terminal or [t.name for t in page.terminal] == ["validation", "failed"]
    said = [text for kind, text in run_answer(mixed) if kind == "doubt"]
    assert any("gave no model" in text and "of my own" in text for text in said)
    assert "of my own" in page.write(tmp_path)[-1].read_text(encoding="utf-8")


def test_one_that_hangs_ends_with_its_limit(tmp_path) -> None:
    began = time.monotonic()
    file = write(tmp_path, own("hangs", "sleeps", "works"), limit_s=1.5, suites='"eolo_alpha"')
    result = run(load_scenario(file), causes=False)
    assert time.monotonic() - began < 60.0
    assert {c.estimator.method.rpartition(":")[2] for c in result.cases} == {"works"}
    assert len(result.failed) == 2
    assert all("must end within limit_s = 1.5 s" in c.reason for c in result.failed)


def test_only_if_nothing_works_it_is_an_error(tmp_path) -> None:
    with pytest.raises(EstimationError, match=r"no estimator gave a model: .*of my own.*SystemExit"):
        run(load_scenario(write(tmp_path, own("raises", "ends"))))


def test_check_names_the_impossible_pairs(tmp_path) -> None:
    file = write(tmp_path, f"{own('works')}, {NEEDS_ALPHA}")
    (note,) = load_scenario(file).notes()
    assert "goes on without eolo_no_alpha, equation_error gave no model" not in note
    assert "eolo_no_alpha, equation_error" in note
    assert "alpha" in note.partition(":")[2]
    done = CliRunner().invoke(app, ["check", str(file)])
    assert done.exit_code == 0
    assert "note: the scenario goes on without" in " ".join(done.output.split())


def test_a_scenario_in_which_no_pair_is_possible_is_refused(tmp_path) -> None:
    file = write(tmp_path, NEEDS_ALPHA, suites='"eolo_no_alpha"')
    with pytest.raises(ScenarioError, match="some estimator must be able to work with some suite, got none"):
        load_scenario(file)


@pytest.mark.parametrize("in_main", [True, False])
def test_a_limit_ends_work_in_any_thread(in_main) -> None:
    found: list[str] = []

    def work() -> None:
        try:
            with time_limit(0.2):
                while True:
                    pass
        except TimeUp:
            found.append("ended")
        with time_limit(0.2):
            found.append("next")
        time.sleep(0.4)  # no limit reaches beyond its block
        found.append("after")

    if in_main:
        work()
    else:
        thread = threading.Thread(target=work)
        thread.start()
        thread.join(20.0)
    assert found == ["ended", "next", "after"]
