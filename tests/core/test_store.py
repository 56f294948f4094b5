"""A folder of results: one writer, a result that is there whole or not at all, and nothing of a user's is lost.

Files that are added to a folder of results, what is gone on with, and a folder that is given back as it is.

A file is there whole or not at all; a MAT file has the same bytes at every time of day.

What a process writes for itself goes with it; what a killed one left goes when the next one begins.
"""

import errno
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from killed import killed_at
from scipy.io import loadmat

from testbench.core import store
from testbench.core.door import checked
from testbench.core.errors import BusyError, DiskError, RecordError, WriteError
from testbench.core.files import mat_bytes, write_file
from testbench.core.interrupts import ended_by_signals, held_back
from testbench.core.paths import PACKAGE, SUITES
from testbench.core.store import (
    COMMIT,
    KEPT,
    LOCK,
    MANIFEST,
    NEW,
    OWN,
    PAGE,
    KeptAside,
    ResultFolder,
    folder_in,
    input_at,
    is_fresh,
    locked,
    manifest_of,
    one_writer,
    write_beside,
)


def write(folder, **contents):
    """Write a result of some files, named with "__" for "/" and "_" for "."."""
    with ResultFolder(folder) as place:
        for name, text in contents.items():
            file = place.new / name.replace("__", "/").replace("_", ".")
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)
    return place


def files(folder):
    return {
        p.relative_to(folder).as_posix(): p.read_text()
        for p in Path(folder).rglob("*")
        if p.is_file() and OWN not in p.parts
    }


def test_a_result_replaces_what_its_manifest_lists_and_nothing_else(tmp_path):
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "mine.csv").write_text("mine")
    write(tmp_path, report_html="1", tables__a_csv="1", models__m_json="1")
    write(tmp_path, report_html="2", tables__b_csv="2")
    assert files(tmp_path) == {"report.html": "2", "tables/b.csv": "2", "tables/mine.csv": "mine"}
    assert not (tmp_path / "models").exists()
    assert set(manifest_of(tmp_path).files) == {"report.html", "tables/b.csv"}


def test_a_file_that_no_manifest_lists_is_not_replaced_and_the_new_result_is_kept(tmp_path):
    (tmp_path / "whole.nc").write_text("mine")
    with pytest.raises(WriteError, match=r"no manifest lists '.*whole.nc'; the new result is in '.*result'"):
        write(tmp_path, whole_nc="theirs", a_toml="1")
    assert files(tmp_path) == {"whole.nc": "mine", "result/whole.nc": "theirs", "result/a.toml": "1"}
    assert set(manifest_of(tmp_path / "result").files) == {"whole.nc", "a.toml"}


def test_a_page_that_no_manifest_lists_is_refused_before_anything_is_computed(tmp_path):
    (tmp_path / PAGE).write_text("mine")
    with pytest.raises(WriteError, match="no manifest lists"):
        ResultFolder(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == [PAGE]


def test_what_a_user_changed_is_kept_under_another_name(tmp_path):
    write(tmp_path, a_toml="1", b_csv="1")
    for text in ("edited", "edited again"):
        (tmp_path / "a.toml").write_text(text)
        with pytest.warns(KeptAside, match="changed by hand; that one is kept as 'a.toml.kept"):
            write(tmp_path, a_toml="2")
    (tmp_path / "a.toml").write_text("my last")
    write(tmp_path, c_csv="3")
    assert files(tmp_path) == {
        "a.toml": "my last", f"a.toml{KEPT}": "edited", f"a.toml{KEPT}_2": "edited again", "c.csv": "3",
    }  # fmt: skip


def test_a_block_that_fails_leaves_the_folder_as_it_was(tmp_path):
    def fail(folder):
        with ResultFolder(folder) as place:
            (place.new / "b.csv").write_text("2")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail(tmp_path / "never" / "made")
    assert list(tmp_path.iterdir()) == []
    write(tmp_path / "made", a_csv="1")
    with pytest.raises(KeyboardInterrupt):
        fail(tmp_path / "made")
    assert files(tmp_path / "made") == {"a.csv": "1"}
    assert not (tmp_path / "made" / OWN / NEW).exists()


def test_unfinished_files_are_taken_away_or_gone_on_with(tmp_path):
    def leave(text):
        place = ResultFolder(tmp_path)
        (place.new / "half.csv").write_text(text)
        place.leave(resume=True)

    leave("half")
    assert manifest_of(tmp_path) is None
    with ResultFolder(tmp_path, resume=True) as place:
        assert (place.new / "half.csv").read_text() == "half"
        (place.new / "half.csv").write_text("whole")
    assert files(tmp_path) == {"half.csv": "whole"}
    leave("half")
    write(tmp_path, other_csv="1")
    assert files(tmp_path) == {"other.csv": "1"}


def test_what_is_added_stays_beside_what_was_there(tmp_path):
    write(tmp_path, a_csv="1")
    with ResultFolder(tmp_path, adds=True) as place:
        (place.new / "b.csv").write_text("2")
    assert files(tmp_path) == {"a.csv": "1", "b.csv": "2"}
    assert set(manifest_of(tmp_path).files) == {"a.csv", "b.csv"}


def test_a_live_file_is_listed_and_survives_the_next_result(tmp_path):
    with ResultFolder(tmp_path) as place:
        place.live("runs.sqlite").write_text("run 1")
        (place.new / PAGE).write_text("page")
    (tmp_path / "runs.sqlite").write_text("run 2")
    with ResultFolder(tmp_path) as place:
        assert place.live("runs.sqlite").read_text() == "run 2"
    assert files(tmp_path) == {"runs.sqlite": "run 2"}
    (tmp_path / "mine.sqlite").write_text("mine")
    with ResultFolder(tmp_path) as place, pytest.raises(WriteError, match="no manifest lists"):
        place.live("mine.sqlite")


def test_a_process_killed_at_any_step_leaves_one_result_or_the_other(tmp_path):
    old = {"report.html": "1", "tables/old.csv": "1", "tables/same.csv": "1", "mine.txt": "mine"}
    new = {"report.html": "2", "tables/new.csv": "2", "tables/same.csv": "2", "mine.txt": "mine"}
    found = []
    for step in range(1, 40):
        folder = tmp_path / str(step)
        write(folder, report_html="1", tables__old_csv="1", tables__same_csv="1")
        (folder / "mine.txt").write_text("mine")
        again = {"report_html": "2", "tables__new_csv": "2", "tables__same_csv": "2"}
        if not killed_at(step, lambda folder=folder, again=again: write(folder, **again)):
            assert files(folder) == new
            break
        there = files(folder)
        page = there.get(PAGE)
        assert page is None or there == (old if page == "1" else new)
        manifest_of(folder)
        found.append(files(folder) == new)
        assert files(folder) == (new if found[-1] else old)
        write(folder, report_html="3")
        assert files(folder) == {"report.html": "3", "mine.txt": "mine"}
    assert found == sorted(found)
    assert 5 < sum(found) < len(found)


HOLD = (
    "import sys; from testbench.core.store import ResultFolder; place = ResultFolder(sys.argv[1]); "
    "print('held', flush=True); input()"
)


def test_the_second_writer_is_refused_until_the_first_ends(tmp_path):
    words = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as first:
        assert first.stdout.readline() == "held\n"
        busy = rf"process {first.pid} is writing to '{re.escape(str(tmp_path))}'"
        with pytest.raises(BusyError, match=busy) as error:
            ResultFolder(tmp_path)
        assert error.value.exit_status == 3
        first.kill()
    with ResultFolder(tmp_path), pytest.raises(BusyError):
        ResultFolder(tmp_path)


def test_a_disk_without_room_for_a_folder_is_a_full_disk(tmp_path, monkeypatch):
    def full(self, *given, **more):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "mkdir", full)
    with pytest.raises(DiskError) as error:
        ResultFolder(tmp_path / "a")
    assert error.value.exit_status == 3


def test_sigterm_acts_once_the_new_result_is_in_place(tmp_path):
    def late():
        with held_back():
            os.kill(os.getpid(), signal.SIGTERM)
            write(tmp_path, a_csv="1")

    def within():
        with ResultFolder(tmp_path) as place:
            (place.new / "a.csv").write_text("2")
            os.kill(os.getpid(), signal.SIGTERM)

    for act in (late, within):
        with ended_by_signals() as came, pytest.raises(KeyboardInterrupt):
            act()
        assert came == [signal.SIGTERM]
        assert files(tmp_path) == {"a.csv": "1"}


def test_a_manifest_lists_the_files_that_were_read_by_names_that_hold_elsewhere(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["testbench", "run"])
    monkeypatch.chdir(tmp_path)
    for name in ("mine.toml", "changed.toml"):
        Path(name).write_text(name)
        checked(Path(name), "scenario")
    Path("changed.toml").write_text("changed")
    checked(SUITES / "taurus_8hz.toml", "scenario")
    checked(PACKAGE / "logs" / "writers" / "garmin.toml", "writer")
    with pytest.raises(RecordError):
        checked(tmp_path / "absent.toml", "scenario")
    with ResultFolder("results/a") as place:
        checked(write_file(place.new / "a.csv", "1"), "scenario")  # of its own: no input
    inputs = manifest_of("results/a").inputs
    assert inputs["mine.toml"][0] == len("mine.toml")
    assert inputs["changed.toml"] is None
    assert "testbench:suites/taurus_8hz.toml" in inputs
    assert "testbench:logs/writers/garmin.toml" in inputs
    assert not any("absent" in name or OWN in name for name in inputs)
    monkeypatch.chdir("/")
    folder = tmp_path / "results" / "a"
    assert input_at("mine.toml", folder) == tmp_path / "mine.toml"
    assert input_at("testbench:suites/taurus_8hz.toml", folder) == SUITES / "taurus_8hz.toml"
    assert input_at("no such file", folder) is None


def test_names_that_lead_elsewhere_are_refused(tmp_path):
    assert folder_in(tmp_path, "my flight.v2") == tmp_path / "my flight.v2"
    for name in ("..", ".", "", " ", "a/b", "/etc", "..\\x", "c:", "NUL", "com1.txt", "a\0b", "a\nb", "a."):
        with pytest.raises(RecordError, match="plain name"):
            folder_in(tmp_path, name)


def test_links_do_not_lead_results_out_of_their_folder(tmp_path):
    outside, folder = tmp_path / "outside", tmp_path / "results"
    (outside / NEW).mkdir(parents=True)
    (outside / NEW / "mine.txt").write_text("mine")
    folder.mkdir()
    os.symlink(outside, folder / "tables")
    with pytest.raises(WriteError, match="a symbolic link to"):
        write(folder, tables__a_csv="1")
    os.symlink(outside, folder / OWN)
    with pytest.raises(WriteError, match="a symbolic link to"):
        ResultFolder(folder)
    assert files(outside) == {f"{NEW}/mine.txt": "mine"}


@pytest.mark.parametrize("text", ["", "[]", '{"format": "other"}', '{"files": 3}', "[" * 100_000])
def test_a_damaged_manifest_is_one_sentence(tmp_path, text):
    write(tmp_path, a_csv="1")
    (tmp_path / OWN / MANIFEST).write_text(text)
    with pytest.raises(RecordError, match="must be the manifest"):
        ResultFolder(tmp_path)
    assert {p.name for p in (tmp_path / OWN).iterdir()} == {LOCK, MANIFEST}
    assert not (tmp_path / OWN / COMMIT).exists()


def test_a_program_that_writes_many_results_lists_what_it_read_for_each(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["notebook.py"])
    for name in ("earlier.toml", "own.toml"):
        (tmp_path / name).write_text(name)
    checked(tmp_path / "earlier.toml", "scenario")
    for result in ("a", "b"):  # a file that is read again for the second is an input of the second, too
        with ResultFolder(tmp_path / result):
            checked(tmp_path / "own.toml", "scenario")
        found = manifest_of(tmp_path / result)
        assert found.command == ()
        assert [Path(name).name for name in found.inputs] == ["own.toml"]


def add(folder, name, text="", **how):
    with ResultFolder(folder, **how) as place:
        (place.new / name).write_text(text)


def test_of_added_files_those_that_match_a_pattern_are_replaced(tmp_path):
    """Rehearsals of two plans share a folder; one with fewer flights leaves no log of the longer one."""
    for name in ("a_flight_1.csv", "a_flight_2.csv", "b_flight_1.csv"):
        add(tmp_path, name, adds=True)
    add(tmp_path, "a_flight_1.csv", "again", adds="a_flight_*.csv")
    assert {p.name for p in tmp_path.iterdir()} == {OWN, "a_flight_1.csv", "b_flight_1.csv"}
    assert {*manifest_of(tmp_path).files} == {"a_flight_1.csv", "b_flight_1.csv"}


def test_what_was_added_stays_beside_another_result(tmp_path):
    """A table that was exported into the folder is none of what the next import takes the place of."""
    write(tmp_path, report_html="1", a_csv="1")
    write_beside(tmp_path / "mine.csv", "exported")
    write(tmp_path, report_html="2")
    write(tmp_path, report_html="3", b_csv="3")
    found = {p.name: p.read_text() for p in tmp_path.iterdir() if p.is_file()}
    assert found == {"report.html": "3", "b.csv": "3", "mine.csv": "exported"}
    assert {*manifest_of(tmp_path).files} == found.keys()
    assert manifest_of(tmp_path).added == ("mine.csv",)


def test_what_is_added_does_not_change_what_the_folder_says_it_is(tmp_path, monkeypatch):
    for k, word in enumerate(("run", "export")):
        monkeypatch.setattr("sys.argv", ["testbench", word])
        add(tmp_path, f"{word}.csv", adds=bool(k))
    assert manifest_of(tmp_path).command == ("testbench", "run")


def test_one_file_beside_a_users_own(tmp_path):
    (tmp_path / "report.html").write_text("mine")
    (tmp_path / "mine.csv").write_text("mine")
    for text in ("1", "2"):
        assert write_beside(tmp_path / "r.csv", lambda path, text=text: path.write_text(text)) == tmp_path / "r.csv"
    with pytest.raises(WriteError, match=r"no manifest lists '.*mine\.csv'"):
        write_beside(tmp_path / "mine.csv", "3")
    with pytest.raises(RecordError, match=r"plain name, got 'con\.csv'"):
        write_beside(tmp_path / "con.csv", "3")
    with pytest.raises(WriteError, match="must write a file, but it wrote none"):
        write_beside(tmp_path / "none.csv", lambda path: None)
    assert {p.name: p.read_text() for p in tmp_path.iterdir() if p.is_file()} == {
        "report.html": "mine", "mine.csv": "mine", "r.csv": "2",
    }  # fmt: skip


def test_a_folder_is_fresh_until_it_holds_something_of_a_user_or_a_result(tmp_path):
    folder = tmp_path / "new"
    assert is_fresh(folder)
    (folder / OWN / NEW).mkdir(parents=True)
    (folder / OWN / NEW / "half.toml").write_text("half")  # of a command that was killed
    assert is_fresh(folder)
    write(folder)
    assert not is_fresh(folder)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("mine")
    assert not is_fresh(tmp_path / "mine")
    assert not is_fresh(tmp_path / "mine" / "thesis.txt")


def test_one_writer_of_a_users_own_file_at_a_time(tmp_path, monkeypatch):
    monkeypatch.setattr(store, "WAIT_S", 0.0)
    file = tmp_path / "project.toml"
    with one_writer(file), ResultFolder(tmp_path), pytest.raises(BusyError), one_writer(file):
        pass  # a result may be written beside it; another writer of it may not come


HOLD_ADDING = (
    "import sys, time; from testbench.core.store import ResultFolder; place = ResultFolder(sys.argv[1], adds=True); "
    "print('held', flush=True); time.sleep(float(sys.argv[2]))"
)


@pytest.mark.parametrize(("held_s", "wait_s"), [(0.2, 30.0), (30.0, 0.1)])
def test_who_adds_a_file_waits_for_another_writer(tmp_path, monkeypatch, held_s, wait_s):
    monkeypatch.setattr(store, "WAIT_S", wait_s)
    with subprocess.Popen([sys.executable, "-c", HOLD_ADDING, tmp_path, str(held_s)], stdout=subprocess.PIPE) as first:
        assert first.stdout.readline() == b"held\n"
        if held_s < wait_s:
            add(tmp_path, "a.csv", adds=True)
        else:
            with pytest.raises(BusyError):
                add(tmp_path, "a.csv", adds=True)
        first.kill()
    assert (tmp_path / "a.csv").exists() == (held_s < wait_s)


def test_a_block_that_fails_keeps_what_the_next_goes_on_with(tmp_path):
    def interrupted(place):
        (place.new / "half.csv").write_text("half")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), ResultFolder(tmp_path / "made", resume=True) as made:
        interrupted(made)
    assert (tmp_path / "made" / OWN / NEW / "half.csv").read_text() == "half"
    with pytest.raises(KeyboardInterrupt), ResultFolder(tmp_path / "never", resume=True):
        raise KeyboardInterrupt
    assert not (tmp_path / "never").exists()


def test_a_folder_that_is_given_back_within_the_block_stays_as_it_is(tmp_path):
    add(tmp_path, "a.csv", "1")
    with ResultFolder(tmp_path) as place:
        place.leave()
    assert (tmp_path / "a.csv").read_text() == "1"
    assert {*manifest_of(tmp_path).files} == {"a.csv"}


def test_a_lock_of_a_part_lets_others_write_into_the_folder(tmp_path):
    add(tmp_path, "a.csv")
    lock = locked(tmp_path, "runs.lock")
    add(tmp_path, "a.csv", "2")
    with pytest.raises(BusyError, match="one writer at a time"):
        locked(tmp_path, "runs.lock")
    lock.release()
    locked(tmp_path, "runs.lock").release()
    assert (tmp_path / "a.csv").read_text() == "2"


def test_a_file_that_a_user_changed_to_what_is_written_anyway_is_not_kept_twice(tmp_path, recwarn):
    add(tmp_path, "a.toml", "1")
    (tmp_path / "a.toml").write_text("2")
    add(tmp_path, "a.toml", "2")
    assert {p.name for p in tmp_path.iterdir()} == {OWN, "a.toml"}
    assert not recwarn


def test_text_bytes_and_what_a_function_writes_arrive_and_leave_nothing_else(tmp_path):
    folder = tmp_path / "new" / "folder"
    assert write_file(folder / "a", "α\n").read_bytes() == "α\n".encode()
    assert write_file(folder / "b", b"\x00\n").read_bytes() == b"\x00\n"
    assert write_file(folder / "c", lambda part: part.write_text("x")).read_text() == "x"
    assert sorted(p.name for p in folder.iterdir()) == ["a", "b", "c"]


def test_what_fails_half_way_leaves_the_file_as_it_was(tmp_path):
    file = write_file(tmp_path / "a", "before")

    def half(part):
        part.write_text("half")
        raise OSError(28, "No space left on device")

    law = f"the disk must have room for '{file}', got: No space left on device; free space"
    with pytest.raises(DiskError, match=re.escape(law)) as error:
        write_file(file, half, "law", "free space")
    assert error.value.exit_status == 3
    assert file.read_text() == "before"
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_a_file_where_a_folder_should_be_is_said(tmp_path):
    write_file(tmp_path / "a", "")
    with pytest.raises(WriteError, match=r"results must go to a folder .*a/b': .*; give another folder"):
        write_file(tmp_path / "a" / "b", "")


def test_a_mat_file_holds_no_time_of_day(tmp_path, monkeypatch):
    content = {"x": np.arange(3.0), "words": "a"}
    first = mat_bytes(content, "numbers", oned_as="column")
    monkeypatch.setattr(time, "asctime", lambda *_: "Thu Jan  1 00:00:00 1970")
    assert mat_bytes(content, "numbers", oned_as="column") == first
    assert first[:116].decode().rstrip() == "MATLAB 5.0 MAT-file, written by flight-testbench, numbers"
    file = write_file(tmp_path / "x.mat", first)
    np.testing.assert_array_equal(loadmat(file)["x"], np.arange(3.0)[:, None])


MAKE = "from testbench.core.files import Scratch; s = Scratch(); print(s.name, flush=True); "
KILLED = "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"
OLD_S = 3600.0
pytestmark = pytest.mark.skipif(os.name != "posix", reason="folders are locked on POSIX systems only")


def begun(folder, then: str = "") -> subprocess.Popen[str]:
    environment = {**os.environ, "TMPDIR": str(folder)}
    return subprocess.Popen(
        [sys.executable, "-c", MAKE + then], env=environment, stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True
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
