"""Files that are added to a folder of results, what is gone on with, and a folder that is given back as it is."""

from __future__ import annotations

import subprocess
import sys

import pytest

from testbench.core import store
from testbench.core.errors import BusyError, WriteError
from testbench.core.store import NEW, OWN, ResultFolder, locked, manifest_of, write_beside


def write(folder, name, text="", **how):
    with ResultFolder(folder, **how) as place:
        (place.new / name).write_text(text)


def test_of_added_files_those_that_match_a_pattern_are_replaced(tmp_path):
    """Rehearsals of two plans share a folder; one with fewer flights leaves no log of the longer one."""
    for name in ("a_flight_1.csv", "a_flight_2.csv", "b_flight_1.csv"):
        write(tmp_path, name, adds=True)
    write(tmp_path, "a_flight_1.csv", "again", adds="a_flight_*.csv")
    assert {p.name for p in tmp_path.iterdir()} == {OWN, "a_flight_1.csv", "b_flight_1.csv"}
    assert {*manifest_of(tmp_path).files} == {"a_flight_1.csv", "b_flight_1.csv"}


def test_what_is_added_does_not_change_what_the_folder_says_it_is(tmp_path, monkeypatch):
    for k, word in enumerate(("run", "export")):
        monkeypatch.setattr("sys.argv", ["testbench", word])
        write(tmp_path, f"{word}.csv", adds=bool(k))
    assert manifest_of(tmp_path).command == ("testbench", "run")


def test_one_file_beside_a_users_own(tmp_path):
    (tmp_path / "report.html").write_text("mine")
    (tmp_path / "mine.csv").write_text("mine")
    for text in ("1", "2"):
        assert write_beside(tmp_path / "r.csv", lambda path, text=text: path.write_text(text)) == tmp_path / "r.csv"
    with pytest.raises(WriteError, match=r"no manifest lists '.*mine\.csv'"):
        write_beside(tmp_path / "mine.csv", lambda path: path.write_text("3"))
    assert {p.name: p.read_text() for p in tmp_path.iterdir() if p.is_file()} == {
        "report.html": "mine", "mine.csv": "mine", "r.csv": "2",
    }  # fmt: skip


HOLD = (
    "import sys, time; from testbench.core.store import ResultFolder; place = ResultFolder(sys.argv[1], adds=True); "
    "print('held', flush=True); time.sleep(float(sys.argv[2]))"
)


@pytest.mark.parametrize(("held_s", "wait_s"), [(0.2, 30.0), (30.0, 0.1)])
def test_who_adds_a_file_waits_for_another_writer(tmp_path, monkeypatch, held_s, wait_s):
    monkeypatch.setattr(store, "WAIT_S", wait_s)
    with subprocess.Popen([sys.executable, "-c", HOLD, tmp_path, str(held_s)], stdout=subprocess.PIPE) as first:
        assert first.stdout.readline() == b"held\n"
        if held_s < wait_s:
            write(tmp_path, "a.csv", adds=True)
        else:
            with pytest.raises(BusyError):
                write(tmp_path, "a.csv", adds=True)
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
    write(tmp_path, "a.csv", "1")
    with ResultFolder(tmp_path) as place:
        place.leave()
    assert (tmp_path / "a.csv").read_text() == "1"
    assert {*manifest_of(tmp_path).files} == {"a.csv"}


def test_a_lock_of_a_part_lets_others_write_into_the_folder(tmp_path):
    write(tmp_path, "a.csv")
    lock = locked(tmp_path, "runs.lock")
    write(tmp_path, "a.csv", "2")
    with pytest.raises(BusyError, match="one writer at a time"):
        locked(tmp_path, "runs.lock")
    lock.release()
    locked(tmp_path, "runs.lock").release()
    assert (tmp_path / "a.csv").read_text() == "2"


def test_a_file_that_a_user_changed_to_what_is_written_anyway_is_not_kept_twice(tmp_path, recwarn):
    write(tmp_path, "a.toml", "1")
    (tmp_path / "a.toml").write_text("2")
    write(tmp_path, "a.toml", "2")
    assert {p.name for p in tmp_path.iterdir()} == {OWN, "a.toml"}
    assert not recwarn
