"""Every make target, and every script of a study or benchmark, starts; the slow suite runs the smallest unit of each.

The Makefile is read, so that a new target, and a new script, is held to this by being there.
"""

import os
import re
import runpy
import shlex
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from multiprocessing import forkserver
from pathlib import Path
from typing import NamedTuple

import pytest
from browsers import BROWSER
from studies.reaching_tests import in_child

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = (ROOT / "tests" / "benchmarks", ROOT / "tests" / "studies")
FIRST_S = 0.12  # of processor: imports, in a process that has the libraries, and the first lines of work
LONGEST_S = 0.8  # of the clock, of one that waits for others
PYTHON, PROGRAM = ".venv/bin/python", ".venv/bin/testbench"
TOOLS = {"mypy", "pip", "ruff", "sphinx", "venv"}  # started by python -m, and not the project's
SHELL = {"cd", "mkdir", "npm", "rm", "tar", "touch", "done", "exit", "for", "||"}


class Command(NamedTuple):
    """What one line of a recipe starts: the words behind python, with the PYTHONPATH that the line sets."""

    target: str
    words: tuple[str, ...]
    path: tuple[str, ...]


def recipes() -> dict[str, list[str]]:
    """Return target -> lines of its recipe, variables replaced as make does."""
    text = (ROOT / "Makefile").read_text(encoding="utf-8").replace("\\\n", " ")
    given = dict(re.findall(r"^(?:export )?(\w+) \??= *(.*)$", text, re.MULTILINE)) | {"REVISION": "HEAD"}

    def replaced(line: str) -> str:
        while "$(" in line:
            line = re.sub(r"\$\((\w+)\)", lambda m: given[m[1]], line)
        return line.replace("$$", "$")

    found: dict[str, list[str]] = {}
    target = ""
    for line in text.splitlines():
        if line.startswith("\t"):
            found[target].append(replaced(line).strip())
        elif rule := re.match(r"([^\s#:=]+):(?!=)", line):
            target = replaced(rule[1])
            found[target] = [replaced(line.partition(":")[2])] if target == ".PHONY" else []
    return found


def commands() -> list[Command]:
    """Return what the recipes start, in order; a line that starts something unknown is an error."""
    out = []
    for target, lines in recipes().items():
        for line in lines if target != ".PHONY" else ():
            for part in re.split(r"&&|;|\|\|", re.sub(r"\bdo\b", ";", line)):
                words = shlex.split(part)
                settings = [w for w in words if re.match(r"[A-Za-z_]\w*=", w)]
                words = words[len(settings) :]
                path = [p for s in settings if s.startswith("PYTHONPATH=") for p in s.partition("=")[2].split(":")]
                if words[:1] == [PYTHON]:
                    out.append(Command(target, tuple(words[1:]), tuple(path)))
                elif words[:1] == [PROGRAM]:
                    out.append(Command(target, ("-m", "testbench", *words[1:]), ()))
                else:
                    assert not words or words[0] in SHELL or words[:2] == ["python3", "-m"], f"{target}: {line}"
    return out


COMMANDS = commands()
OURS = [c for c in COMMANDS if c.words[0] != "-m" or c.words[1].split(".")[0] in ("testbench", "studies")]


def name(command: Command) -> str:
    return " ".join((command.target, *command.words)).replace("tests/", "")


def imported() -> set[str]:
    """Return the names of all modules that tests, studies and benchmarks import, as below tests/."""
    out: set[str] = set()
    for path in (ROOT / "tests").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for module, names in re.findall(r"^\s*(?:from|import) ([\w.]+)(?: import ([\w, ]+))?", text, re.MULTILINE):
            out |= {module, *(f"{module}.{n.strip()}" for n in names.split(","))}
    return {module.removeprefix("tests.") for module in out}


def test_every_script_is_called_by_a_target_or_imported():
    called = {w for c in COMMANDS for w in c.words[:2]}
    used, left = imported(), []
    scripts = [p for folder in FOLDERS for p in sorted(folder.rglob("*.py")) if not p.name.startswith(("test_", "__"))]
    for script in scripts:
        inside = script.relative_to(ROOT / "tests").with_suffix("").parts
        module, alone = ".".join(inside), inside[-1] if len(inside) == 2 else ""  # as it is imported
        if not {str(script.relative_to(ROOT)), module} & called and not {module, alone} & used:
            left.append(module)
    assert len(scripts) > 50
    assert left == []


def test_every_target_is_phony_or_a_file_and_what_it_names_exists():
    found = recipes()
    assert set(found.pop(".PHONY")[0].split()) == {t for t in found if not t.startswith(".venv/")}
    modules = {c.words[1] for c in COMMANDS if c.words[0] == "-m" and c not in OURS}
    assert modules <= TOOLS | {"pytest"}
    named = [w for c in COMMANDS for w in c.words if re.match(r"(tests|docs)(/|$)", w)]
    assert [w for w in named if not (ROOT / w).exists()] == []


@pytest.fixture
def place(tmp_path):
    """Give a folder with what `make pages-held` brings: axe-core, here one that finds nothing, and a page."""
    made = tmp_path / "build"
    (made / "package").mkdir(parents=True)
    (made / "package" / "axe.min.js").write_text("window.axe = { run: async () => ({ violations: [] }) }")
    (made / "pages").mkdir()
    (made / "pages" / "report.html").write_text("<!doctype html><html lang='en'><title>t</title><p>one</p></html>")
    return tmp_path


def placed(command: Command) -> list[str]:
    """Return the words of a command, started anywhere; help of what is no script of tests/ and not the demo."""
    words = [str(ROOT / w) if w == "results" or w.startswith(("docs/", "tests/")) else w for w in command.words]
    ours = command.words[0].startswith("tests/") or command.words[:3] == ("-m", "testbench", "run")
    return words if ours else [*(words[:2] if words[0] == "-m" else words[:1]), "--help"]


def surroundings(command: Command, folder: Path) -> dict[str, str]:
    path = os.pathsep.join([str(folder), str(ROOT), *(str(ROOT / p) for p in command.path)])
    return {"TESTBENCH_SMALLEST": str(folder), "PYTHONPATH": path, "TMPDIR": str(folder)}


def left_out(command: Command) -> None:
    if any(name in w for w in command.words for name in ("pages_held", "new_users")) and BROWSER is None:
        pytest.skip("pages are tried in Chromium, which is not here")


def first_second(command: Command, folder: Path) -> int:
    """Run a command in this process, a forked one, as python would: with its paths, and none of the tests' modules."""
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    time.process_time = lambda: 0.0  # the clocks of some machines see no time pass in so short a work
    sys.stdout, sys.stderr = (open(fd, "w", encoding="utf-8", closefd=False) for fd in (1, 2))  # noqa: SIM115
    warnings.resetwarnings()
    os.environ |= surroundings(command, folder)
    tempfile.tempdir = None
    forkserver._forkserver = forkserver.ForkServer()  # the parent's is no child of this process
    forkserver.ensure_running = forkserver._forkserver.ensure_running
    forkserver.connect_to_new_process = forkserver._forkserver.connect_to_new_process
    words = placed(command)
    module = words[1] if words[0] == "-m" else ""
    there = [Path(p or ".").resolve() for p in sys.path]
    foreign = [str(p) for p in there if p != ROOT and not p.is_relative_to(ROOT / "tests")]  # .venv lies in ROOT
    sys.path[:] = [*([] if module else [str(Path(words[0]).parent)]), *os.environ["PYTHONPATH"].split(":"), *foreign]
    for key, loaded in list(sys.modules.items()):
        file = getattr(loaded, "__file__", None) or ""
        if key.split(".")[0] in ("studies", "tests") or file.startswith(str(ROOT / "tests")):
            del sys.modules[key]
    sys.argv = words[1:] if module else words
    signal.setitimer(signal.ITIMER_PROF, FIRST_S)
    try:
        if module:
            runpy.run_module(module, run_name="__main__", alter_sys=True)
        else:
            runpy.run_path(words[0], run_name="__main__")
    except SystemExit as end:
        print(end.code or "")
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()  # the child ends without
        return 1
    return 0


@pytest.mark.sampled(2)
@pytest.mark.parametrize("command", OURS, ids=name)
def test_it_starts(command, place):
    left_out(command)
    log = place / "said"
    ended = in_child(place, lambda: first_second(command, place), log, LONGEST_S)
    assert ended in (0, None, -signal.SIGPROF), log.read_text(encoding="utf-8")[-2000:]


@pytest.mark.slow
@pytest.mark.parametrize("command", [c for c in OURS if c.words[0].startswith("tests/")], ids=name)
def test_its_smallest_unit_of_work_is_done(command, place):
    left_out(command)
    (place / "sitecustomize.py").write_text("import time; time.process_time = lambda: 0.0")  # as coarse clocks have it
    done = subprocess.run(
        [sys.executable, *placed(command)], cwd=place, env=os.environ | surroundings(command, place),
        capture_output=True, text=True, check=False, timeout=1200.0,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-1000:] + done.stderr[-2000:]
