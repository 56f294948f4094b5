"""A page and its tables belong to one run, whatever ends the process, and stay in their folder."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from testbench.core.errors import DiskError, RecordError
from testbench.core.record import FlightRecord
from testbench.page.beside import OF_ONE_PAGE, PAGE, UNFINISHED
from testbench.page.page import Page
from testbench.page.tables import Column, Table
from testbench.page.write import record_keeper

pytestmark = pytest.mark.drawn


def page(name, **more):
    table = Table(name, name, "", (Column("x", "x"),), ((1.0,),))
    return Page(kicker="test", title=name, answer=[f"this is {name}"], tables=[table], packages=(), **more)


def files(folder):
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if not p.is_dir())


def test_what_an_older_run_wrote_does_not_stand_beside_the_newer_one(tmp_path):
    page("first", files={"models/a.json": "{}", "mine.txt": "kept"}).write(tmp_path)
    (tmp_path / "notes.md").write_text("my own")
    paths = page("second").write(tmp_path)
    assert files(tmp_path) == ["mine.txt", "notes.md", PAGE, "tables/second.csv", "tables/second.json"]
    assert [str(p.relative_to(tmp_path)) for p in paths] == ["tables/second.csv", "tables/second.json", PAGE]
    assert "this is second" in (tmp_path / PAGE).read_text(encoding="utf-8").lower()


def test_a_page_that_fails_leaves_the_old_one_whole(tmp_path):
    page("first").write(tmp_path)
    before = {name: (tmp_path / name).read_bytes() for name in files(tmp_path)}

    def fails(folder):
        raise RecordError("a record must be written, got a full disk")

    with pytest.raises(RecordError, match="full disk"):
        page("second", more_files=fails).write(tmp_path)
    assert {name: (tmp_path / name).read_bytes() for name in files(tmp_path)} == before
    assert not (tmp_path / UNFINISHED).exists()


def test_a_disk_without_room_for_a_folder_is_a_full_disk(tmp_path, monkeypatch):
    def full(self, *given, **more):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "mkdir", full)
    with pytest.raises(DiskError) as error:
        page("first").write(tmp_path)
    assert error.value.exit_status == 3


KILLED = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[3])
from page.test_written_beside import page
import os, signal
count, limit = 0, int(sys.argv[2])
for name in ("replace", "unlink", "mkdir"):
    def counting(self, *rest, _old=getattr(Path, name), **more):
        global count
        count += 1
        if count == limit:
            os.kill(os.getpid(), signal.SIGKILL)
        return _old(self, *rest, **more)
    setattr(Path, name, counting)
page("second").write(Path(sys.argv[1]))
print(count)
"""


def test_a_process_killed_at_any_step_never_leaves_a_page_with_tables_of_another_run(tmp_path):
    tests = str(Path(__file__).parents[1])
    ended = []
    for step in range(1, 40, 3):
        folder = tmp_path / str(step)
        page("first")._write_into(folder)  # not written by this process, which would hold the folder
        done = subprocess.run(
            [sys.executable, "-c", KILLED, str(folder), str(step), tests], check=False, capture_output=True, text=True
        )
        ended.append(done.returncode)
        assert done.returncode in (0, -signal.SIGKILL), done.stderr
        if (folder / PAGE).exists():
            says = "first" if "this is first" in (folder / PAGE).read_text(encoding="utf-8").lower() else "second"
            assert {p.stem for p in (folder / "tables").iterdir()} == {says}
        page("third").write(folder)
        assert files(folder) == [PAGE, "tables/third.csv", "tables/third.json"]
    assert 0 in ended
    assert ended.count(-signal.SIGKILL) >= 3


def test_links_do_not_lead_results_out_of_their_folder(tmp_path):
    outside, folder = tmp_path / "outside", tmp_path / "results"
    for name in (*OF_ONE_PAGE, "records", UNFINISHED):
        (outside / name).mkdir(parents=True)
        (outside / name / "mine.txt").write_text("mine")
        folder.mkdir(exist_ok=True)
        os.symlink(outside / name, folder / name)
    os.symlink(outside / "page.html", folder / PAGE)
    page("first", files={"models/a.json": "{}"}).write(folder)
    record = FlightRecord(np.arange(3.0), ("q",), np.zeros((3, 1)), "truth")
    with pytest.raises(RecordError, match=r"stay in their folder .*records', a symbolic link to .*outside"):
        record_keeper(folder)("a", record)
    with pytest.raises(RecordError, match="a symbolic link"):
        page("second", files={"records/a.nc": "a"}).write(folder)
    assert files(outside) == sorted(f"{name}/mine.txt" for name in (*OF_ONE_PAGE, "records", UNFINISHED))
    assert files(folder / "tables") == ["first.csv", "first.json"]
    assert not (folder / "tables").is_symlink()
