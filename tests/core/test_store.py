"""A folder of results: one writer, a result that is there whole or not at all, and nothing of a user's is lost."""

from __future__ import annotations

import errno
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from killed import killed_at

from testbench.core.door import checked
from testbench.core.errors import BusyError, DiskError, RecordError, WriteError
from testbench.core.interrupts import ended_by_signals, held_back
from testbench.core.paths import SUITES
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
    manifest_of,
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
    with pytest.raises(RecordError):
        checked(tmp_path / "absent.toml", "scenario")
    write("results/a", a_csv="1")
    inputs = manifest_of("results/a").inputs
    assert inputs["mine.toml"][0] == len("mine.toml")
    assert inputs["changed.toml"] is None
    assert "testbench:suites/taurus_8hz.toml" in inputs
    assert not any("absent" in name for name in inputs)
    monkeypatch.chdir("/")
    folder = tmp_path / "results" / "a"
    assert input_at("mine.toml", folder) == tmp_path / "mine.toml"
    assert input_at("testbench:suites/taurus_8hz.toml", folder) == SUITES / "taurus_8hz.toml"
    assert input_at("no such file", folder) is None


def test_names_that_lead_elsewhere_are_refused(tmp_path):
    assert folder_in(tmp_path, "my flight.v2") == tmp_path / "my flight.v2"
    for name in ("..", ".", "", " ", "a/b", "/etc", "..\\x", "c:", "NUL", "com1.txt", "a\0b"):
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
    with ResultFolder(tmp_path / "a"):
        checked(tmp_path / "own.toml", "scenario")
    found = manifest_of(tmp_path / "a")
    assert found.command == ()
    assert [Path(name).name for name in found.inputs] == ["own.toml"]
