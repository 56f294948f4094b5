"""What a process writes for itself goes with it; what a killed one left goes when the next one begins."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

MAKE = "from testbench.core.files import Scratch; s = Scratch(); print(s.name, flush=True); "
KILLED = "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"
OLD_S = 3600.0
pytestmark = pytest.mark.skipif(os.name != "posix", reason="folders are locked on POSIX systems only")


def begun(folder, then: str = "") -> subprocess.Popen[str]:
    environment = {**os.environ, "TMPDIR": str(folder)}
    return subprocess.Popen(
        [sys.executable, "-c", MAKE + then],
        env=environment,
        stdout=subprocess.PIPE,
        stdin=subprocess.PIPE,
        text=True,
    )


def aged(folder) -> list[str]:
    """Return the folders that processes have left there, made to look old."""
    for path in folder.iterdir():
        os.utime(path, (path.stat().st_mtime - OLD_S,) * 2)
    return [p.name for p in folder.iterdir()]


def test_a_process_that_ends_in_peace_leaves_nothing(tmp_path):
    name = begun(tmp_path).communicate(timeout=60)[0].strip()
    assert name.startswith(str(tmp_path))
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_process_left_is_removed_by_the_next_and_what_a_living_one_has_is_not(tmp_path):
    begun(tmp_path, KILLED).communicate(timeout=60)
    (left,) = aged(tmp_path)
    living = begun(tmp_path, "input()")
    assert living.stdout is not None
    its = living.stdout.readline().strip()
    assert left not in aged(tmp_path)
    begun(tmp_path).communicate(timeout=60)
    assert os.path.isdir(its)
    living.communicate("\n", timeout=60)
    assert list(tmp_path.iterdir()) == []


def test_the_folder_of_a_process_that_has_just_begun_is_left_alone(tmp_path):
    begun(tmp_path, KILLED).communicate(timeout=60)
    begun(tmp_path).communicate(timeout=60)
    assert len(list(tmp_path.iterdir())) == 1  # it is not a minute old
