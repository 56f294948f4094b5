"""The notebooks run as they are handed out, hold no outputs, and their last cell judges what is answered."""

from __future__ import annotations

from pathlib import Path

import pytest

from testbench.questions.exercise.ask import start
from testbench.questions.exercise.names import NAMES, NOTEBOOKS, load_exercise
from testbench.questions.exercise.seal import PUBLIC_KEY, VARIABLE

nbformat = pytest.importorskip("nbformat", reason="the notebooks are run with nbformat: install the extra 'teaching'")
nbclient = pytest.importorskip("nbclient", reason="the notebooks are run with nbclient: install the extra 'teaching'")
pytest.importorskip("ipykernel", reason="the notebooks are run with ipykernel: install the extra 'teaching'")

ROOT = Path(__file__).resolve().parents[3]
WITH_NOTEBOOK = [name for name in NAMES if load_exercise(name).notebook]


def printed(cell) -> str:
    return "".join(o.get("text", "") for o in cell.outputs)


def test_every_notebook_belongs_to_an_exercise_and_is_clean():
    assert len(WITH_NOTEBOOK) >= 3
    assert {p.name for p in NOTEBOOKS.glob("*.ipynb")} == {load_exercise(n).notebook for n in WITH_NOTEBOOK}
    for name in WITH_NOTEBOOK:
        book = nbformat.read(NOTEBOOKS / load_exercise(name).notebook, as_version=4)
        nbformat.validate(book)
        code = [c for c in book.cells if c.cell_type == "code"]
        assert all(not c.outputs and c.execution_count is None for c in code)
        assert (NOTEBOOKS / load_exercise(name).notebook).stat().st_size < 20_000


@pytest.mark.parametrize(
    "name", [WITH_NOTEBOOK[0], *(pytest.param(name, marks=pytest.mark.slow) for name in WITH_NOTEBOOK[1:])]
)
def test_a_notebook_runs_unanswered_and_answered(name, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    begun = start(name, "anna", PUBLIC_KEY, tmp_path / name)
    book = nbformat.read(begun.folder / "notebook.ipynb", as_version=4)
    count = len(begun.exercise.questions)
    answers = begun.exercise.solve(begun.folder)
    write = nbformat.v4.new_code_cell(f"write_answers(FOLDER, {answers!r})")
    again = nbformat.v4.new_code_cell(book.cells[-1].source)
    book.cells += [write, again]
    nbclient.NotebookClient(book, timeout=60, resources={"metadata": {"path": str(begun.folder)}}).execute()
    first, second = printed(book.cells[-3]), printed(book.cells[-1])
    assert first.count("not answered yet") == count
    assert f"0 of {count} right" in first
    assert f"{count} of {count} right" in second
