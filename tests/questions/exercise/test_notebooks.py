"""The notebooks run as they are handed out, hold no outputs, and their last cell judges what is answered."""

from pathlib import Path

import pytest

from testbench.questions.exercise.ask import start
from testbench.questions.exercise.seal import CATALOGUE, NAMES, PUBLIC_KEY, VARIABLE, load_exercise
from testbench.questions.exercise.show import notebook

nbformat = pytest.importorskip("nbformat", reason="the notebooks are run with nbformat: install the extra 'teaching'")
nbclient = pytest.importorskip("nbclient", reason="the notebooks are run with nbclient: install the extra 'teaching'")
pytest.importorskip("ipykernel", reason="the notebooks are run with ipykernel: install the extra 'teaching'")

ROOT = Path(__file__).resolve().parents[3]
STEPS = {p.name.removesuffix(".steps.md") for p in CATALOGUE.glob("*.steps.md")}


def printed(cell) -> str:
    return "".join(o.get("text", "") for o in cell.outputs)


@pytest.mark.parametrize("name", NAMES)
def test_every_exercise_has_a_clean_notebook_of_its_own_text(name):
    text = (CATALOGUE / f"{name}.md").read_text(encoding="utf-8")
    steps = (CATALOGUE / f"{name}.steps.md").read_text(encoding="utf-8") if name in STEPS else ""
    made = notebook(text, steps, load_exercise(name).questions)
    book = nbformat.reads(made, as_version=4)
    nbformat.validate(book)
    assert made == notebook(text, steps, load_exercise(name).questions), "the same text gives the same bytes"
    code = [c for c in book.cells if c.cell_type == "code"]
    assert book.cells[0].source == text.strip("\n")
    assert len(code) == 3 + (steps.count("```python\n") if steps else 2)
    assert all(not c.outputs and c.execution_count is None for c in code)
    assert len({c.id for c in book.cells}) == len(book.cells)
    for cell in code:
        compile(cell.source, name, "exec")
    assert "```" not in "".join(c.source for c in code)


def test_steps_belong_to_exercises():
    assert {"doublet_length", "short_period", "dsr_horizon"} <= STEPS <= set(NAMES)


@pytest.mark.parametrize(
    "name", [n if n == "doublet_length" else pytest.param(n, marks=pytest.mark.slow) for n in NAMES]
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
