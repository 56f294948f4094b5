"""The command line run within the test's own process, for what many tests try."""

from __future__ import annotations

import sys

import testbench.cli as cli


def ends(monkeypatch, capsys, *words):
    """Run a command; return its exit status and the lines of what it says on stderr, without the stages."""
    monkeypatch.setattr(sys, "argv", ["testbench", *map(str, words)])
    status = 0
    try:
        cli.main()
    except SystemExit as end:
        status = end.code or 0
    said = capsys.readouterr().err
    return status, [line for line in said.splitlines() if not line.startswith("... ")]
