"""The guide on a new question is right: its files and its row, taken from the page, make a question that answers."""

import re
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import testbench.questions as questions
import testbench.questions.files as files
from testbench.cli import application
from testbench.questions import QUESTIONS, Question

GUIDE = Path(__file__).resolve().parents[2] / "docs" / "guides" / "add_a_question.md"
BLOCK = re.compile(r"```\{code-block\} python\n:caption: (\S+)\n\n(.*?)^```", re.MULTILINE | re.DOTALL)
ROW = "testbench/questions/__init__.py"


@pytest.fixture
def authority(tmp_path, monkeypatch):
    """Write the guide's files into a folder of their own, add the guide's row; return the command line."""
    blocks = dict(BLOCK.findall(GUIDE.read_text(encoding="utf-8")))
    row = eval(blocks.pop(ROW), {"Question": Question})
    for name, text in blocks.items():
        file = tmp_path / Path(name).relative_to("testbench/questions")
        file.parent.mkdir(exist_ok=True)
        file.write_text(text, encoding="utf-8")
    monkeypatch.setattr(questions, "__path__", [*questions.__path__, str(tmp_path)])
    table = (*QUESTIONS, row)
    monkeypatch.setattr(files, "BY_COMMAND", {q.command: q for q in table})
    monkeypatch.setattr(files, "WITH_FILES", tuple(q for q in table if q.kind))
    yield application(table)
    for name in [n for n in sys.modules if n.startswith("testbench.questions.authority")]:
        del sys.modules[name]


def test_the_guides_question_has_a_command_a_kind_of_file_and_an_answer(authority, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = re.search(r"^```toml\n(.*?)^```", GUIDE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL).group(1)
    Path("my_speeds.toml").write_text(text, encoding="utf-8")
    run = CliRunner()
    shown = run.invoke(authority, ["--help"], env={"COLUMNS": "120"})
    assert "how much elevator is left" in shown.output
    checked = run.invoke(authority, ["check", "my_speeds.toml"])
    assert "my_speeds.toml: a valid scenario of control authority" in checked.output
    done = run.invoke(authority, ["authority", "my_speeds.toml"])
    assert done.exit_code == 0, done.output
    assert re.search(r"Least is left at 10 m/s: \d+\s% of full elevator\.", done.output)
    assert Path("results/authority_my_speeds/tables/authority.csv").is_file()
    assert Path("results/authority_my_speeds/report.html").is_file()


def test_a_fault_of_its_file_is_told_as_of_any_other(authority, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("wrong.toml").write_text('title = "x"\naircraft = "taurus"\nlevel_speed_m_s = [10.0]\n', encoding="utf-8")
    checked = CliRunner().invoke(authority, ["check", "wrong.toml"])
    assert checked.exit_code
    assert "did you mean" in str(checked.exception)
