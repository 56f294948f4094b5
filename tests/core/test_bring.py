"""What users bring is found beside their scenario, read without being run, and run once.

Work of others in processes of its own: how one ends that gave no answer is said, and no crash is repeated here.
"""

import io
import os
import pickle
import signal
import sys
import time

import pytest

from testbench.core import bring
from testbench.core.errors import EstimationError, ScenarioError
from testbench.core.interrupts import ended_by_signals
from testbench.core.processes import Ahead, apart, processes


def test_what_is_brought_is_found_beside_the_scenario_first_and_then_where_one_works(tmp_path, monkeypatch):
    project, desk = tmp_path / "project", tmp_path / "desk"
    for folder in (project / "estimators", desk / "estimators"):
        folder.mkdir(parents=True)
    monkeypatch.chdir(desk)
    scenario = project / "s.toml"
    wanted = [project / "m.py", project / "estimators" / "m.py", desk / "m.py", desk / "estimators" / "m.py"]
    for path in reversed(wanted):
        path.write_text("")
        assert bring.find("m.py:f", scenario, "estimators") == (path, "f")
    assert bring.find("m.py:f", None, "estimators") == (wanted[2], "f")
    assert bring.find(f"{wanted[3]}:f", scenario, "estimators") == (wanted[3], "f")


def test_a_file_that_is_not_there_is_missed_with_the_nearest_that_is(tmp_path):
    (tmp_path / "my_method.py").write_text("")
    with pytest.raises(ScenarioError, match=r"got no 'my_methud.py' in .*did you mean 'my_method.py'"):
        bring.find("my_methud.py:f", tmp_path / "s.toml", "estimators")
    with pytest.raises(ScenarioError, match=r"must be named as FILE.py:NAME, got 'm.py:'"):
        bring.find("m.py:", tmp_path / "s.toml", "estimators")


def test_a_file_is_read_without_being_run(tmp_path):
    path = tmp_path / "m.py"
    path.write_text(
        "import os as system\nfrom sys import argv\nA = 1\nB: int = 2\nif A:\n    def f(x): ...\n"
        "class C: ...\n1 / 0\nprint('it runs')\n"
    )
    found = bring.declared(path)
    assert found.names == {"system", "argv", "A", "B", "f", "C"}
    assert (list(found.functions), list(found.classes), list(found.values)) == (["f"], ["C"], ["A", "B"])
    with pytest.raises(ScenarioError, match=r"m.py must define 'ff'; did you mean 'f'\?"):
        found.need("ff")
    path.write_text("from os import *\n")
    assert bring.declared(path).need("anything") is None
    path.write_text("x = 1\ndef f(:\n")
    with pytest.raises(ScenarioError, match=r"m.py, line 2: must be Python"):
        bring.declared(path)


def test_a_file_runs_once_until_it_changes_and_what_it_makes_can_be_pickled(tmp_path):
    path = tmp_path / "m.py"
    path.write_text("import neighbour\nclass C:\n    value = neighbour.value\n")
    (tmp_path / "neighbour.py").write_text("value = 3\n")
    before = list(sys.path)
    made = bring.load(path, "C")
    assert (made.value, sys.path) == (3, before)
    assert bring.load(path, "C") is made
    assert isinstance(pickle.loads(pickle.dumps(made())), made)
    with pytest.raises(ScenarioError, match=r"m.py must define 'D'; did you mean 'C'|m.py must define 'D'; valid"):
        bring.load(path, "D")
    path.write_text("value = 1\nraise ValueError('no\\nmore')\n")
    with pytest.raises(ScenarioError, match=r"must run without an error, got ValueError: no more \(m.py, line 2\)"):
        bring.load(path, "C")
    del sys.modules["neighbour"]


ENDS = {
    "sys.exit(0)": "SystemExit: 0",
    "os._exit(0)": r"SystemExit: os._exit\(0\)",
    "raise KeyboardInterrupt": "KeyboardInterrupt",
    "raise GeneratorExit('x')": "GeneratorExit: x",
    "1 / 0": "ZeroDivisionError: division by zero",
}


@pytest.mark.parametrize(("statement", "kind"), ENDS.items(), ids=ENDS)
def test_code_that_ends_the_program_is_an_error_in_one_line(tmp_path, statement, kind):
    """At its import and in a call: never the end of this program, which would pass for success."""
    path = tmp_path / "m.py"
    path.write_text(f"import os\nimport sys\n{statement}\n")
    with pytest.raises(ScenarioError, match=rf"m.py must run without an error, got {kind} \(m.py, line 3\)$"):
        bring.load(path, "f")
    path.write_text(f"import os\nimport sys\ndef f():\n    {statement}\n")
    f = bring.load(path, "f")
    says = rf"^f must work, got {kind} \(m.py, line 4\)$"
    with pytest.raises(bring.BroughtCodeError, match=says) as error, bring.running(path, "f must work"):
        f()
    assert error.value.exit_status == 3
    if "exit(" in statement and "_exit" not in statement:
        with pytest.raises(SystemExit) as ends:
            f()
        assert bring.ends_in_brought(ends.value)


def test_streams_that_the_code_closes_or_replaces_are_as_they_were(capsys):
    with bring.running(None, "f must work"):
        print("seen")
        sys.stdout.close()
        sys.stderr = io.StringIO()
    print("still", file=sys.stderr)
    print("heard")
    assert capsys.readouterr() == ("seen\nheard\n", "still\n")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_by_user_or_system_acts_also_where_the_code_takes_it(tmp_path, number):
    path = tmp_path / "m.py"
    path.write_text(
        f"import os\ndef f():\n    try:\n        os.kill(os.getpid(), {int(number)})\n"
        "    except BaseException:\n        raise ValueError\n"
    )
    with ended_by_signals():
        f, before, leave = bring.load(path, "f"), signal.getsignal(number), os._exit
        with pytest.raises(KeyboardInterrupt), bring.running(path, "f must work"):
            f()
        assert (signal.getsignal(number), os._exit) == (before, leave)


def test_processes_that_the_code_starts_end_as_they_will(tmp_path):
    path = tmp_path / "m.py"
    path.write_text(
        "import os\ndef f():\n    child = os.fork()\n    if not child:\n        os._exit(7)\n"
        "    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])\n"
    )
    with bring.running(path, "f must work"):
        assert bring.load(path, "f")() == 7


def test_the_result_and_the_errors_of_a_task_come_back():
    assert apart(os.getpid, "it", 10.0) != os.getpid()

    def refuses() -> None:
        raise ScenarioError(["one", "two"])

    with pytest.raises(ScenarioError) as error:
        apart(refuses, "it", 10.0)
    assert error.value.faults == ("one", "two")


@pytest.mark.parametrize(
    ("task", "how"),
    [
        (lambda: os._exit(0), "m.py:f must end with a result, but its process ended with status 0"),
        (lambda: os.kill(os.getpid(), signal.SIGSEGV), "m.py:f must .* its process was ended by SIGSEGV: compiled"),
        (lambda: time.sleep(60.0), "m.py:f must end within 0.2 s"),
    ],
    ids=["exit", "crash", "no end"],
)
def test_a_task_that_gives_no_answer_is_said(task, how):
    with pytest.raises(EstimationError, match=how):
        apart(task, "m.py:f", 10.0 if "within" not in how else 0.2)


def test_a_task_that_crashed_its_process_is_not_done_here(tmp_path):
    """One that was killed, for want of memory, is."""
    here = os.getpid()

    def crashes() -> str:
        os.kill(os.getpid(), signal.SIGSEGV)
        return "here"

    def killed() -> str:
        if os.getpid() != here:
            os.kill(os.getpid(), signal.SIGKILL)
        return "here"

    with processes(2), Ahead() as ahead:
        ahead.begin("effect", crashes)
        with pytest.raises(EstimationError, match=r"'effect' must end .* ended by SIGSEGV"):
            ahead.take("effect", crashes)
        ahead.begin("effect", killed)
        assert ahead.take("effect", killed) == "here"
