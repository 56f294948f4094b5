"""The command line for tests: as a process of its own, and within the test's own process."""

import multiprocessing
import os
import sys
import tempfile
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

from quick_drawing import Quick, quick_drawing
from studies.reliability.warm import modules

import testbench.cli as cli

# Imported once, by the process that those of the commands are forked from: importing takes longer than most commands.
_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(["quick_drawing", *modules(), "one_tree"])


def in_warm_process(function: Callable[..., object], *args: object) -> int | None:
    """Call a function in a process of its own that need import nothing; return its exit status."""
    process = _SERVER.Process(target=function, args=args)
    process.start()
    process.join()
    return process.exitcode


@dataclass(frozen=True)
class Done:
    """How a command ended: exit status, and what it wrote."""

    returncode: int
    stdout: str
    stderr: str


def command(*words: object, cwd: Path | None = None) -> Done:
    """Run a command in a process of its own with an output 200 columns wide."""
    with tempfile.TemporaryDirectory() as folder:
        out, err = Path(folder, "out"), Path(folder, "err")
        status = in_warm_process(_run, [*map(str, words)], cwd or Path.cwd(), out, err, Quick.on)
        assert status is not None
        return Done(status, out.read_text(encoding="utf-8"), err.read_text(encoding="utf-8"))


def _run(words: list[str], cwd: Path, out: Path, err: Path, quick: bool) -> None:
    for path, number in ((out, 1), (err, 2)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND), number)
    os.chdir(cwd)
    os.environ["COLUMNS"] = "200"
    sys.argv = ["testbench", *words]
    with quick_drawing() if quick else nullcontext():
        cli.main()


def ends(monkeypatch, capsys, *words):
    """Run a command within the test's process; return its exit status and lines of stderr, without the stages."""
    monkeypatch.setattr(sys, "argv", ["testbench", *map(str, words)])
    status = 0
    try:
        cli.main()
    except SystemExit as end:
        status = end.code or 0
    said = capsys.readouterr().err
    return status, [line for line in said.splitlines() if not line.startswith("... ")]
