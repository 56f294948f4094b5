"""Why there are no worker processes on this machine: one is started for a try."""

from __future__ import annotations

import signal
import subprocess
import sys

FLYING = "testbench.questions.campaign.flying"
"""What workers load."""

_TRY_S = 60.0


def why_none() -> str:
    """Start one process that loads what workers load, and return what became of it and what to do, in words."""
    try:
        tried = subprocess.run(
            [sys.executable, "-c", f"import {FLYING}"],
            check=False,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_TRY_S,
        )
    except OSError as error:
        return (
            f"this machine starts no process ({error.strerror or error}); end other programs, or raise the limits of "
            "processes and memory (ulimit -u, ulimit -v)"
        )
    except subprocess.TimeoutExpired:
        return f"a process does not load the testbench within {_TRY_S:g} s; end other programs, or give fewer --workers"
    if tried.returncode < 0:
        name = signal.Signals(-tried.returncode).name
        return (
            f"a process that loads the testbench is ended by {name}; the memory may be too small: end other programs, "
            "or give fewer --workers"
        )
    if tried.returncode:
        last = (tried.stderr.strip().splitlines() or ["it says nothing"])[-1]
        return f"a process cannot load the testbench ({last}); mend the installation"
    return (
        "a process that loads the testbench lives, so that something ends the workers: memory that runs out (give "
        "fewer --workers), a limit of time, or a program that ends processes"
    )
