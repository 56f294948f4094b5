"""The study of reliability sees the faults that it looks for, and takes no time stamp or lost first row for one."""

import signal
import sys
import time
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest
from short_flight import DE, Q, T
from studies.reliability import process
from studies.reliability.process import Ended, Running
from studies.reliability.records import differing
from studies.reliability.treatments import Wanted, digests, half, unsound, whole

from testbench.core.record import FlightRecord
from testbench.core.store import COMMIT, OWN, ResultFolder

WHOLE = FlightRecord(T, ("de", "q"), np.radians(np.column_stack([DE, Q])), "measured")


@pytest.mark.parametrize(
    ("file", "one", "timed", "other"),
    [
        ("report.html", "<dt>cost</dt><dd>1 ms</dd> b", "<dt>cost</dt><dd>2 ms</dd> b", "<dt>cost</dt><dd>1 ms</dd> c"),
        ("cases.csv", "a,none,1.3\nb,none,1.4\n", "a,none,1.5\nb,none,1.3\n", "a,wrong,1.3\nb,none,1.4\n"),
        ("plan.csv", "1.5\n", "1.5\n", "1.6\n"),
    ],
)  # fmt: skip
def test_results_are_compared_without_times(tmp_path, file, one, timed, other):
    found = []
    for text in (one, timed, other):
        (tmp_path / file).write_text(text, encoding="utf-8")
        found.append(digests(tmp_path))
    assert found[0] == found[1]
    assert found[0] != found[2]


def test_a_row_that_is_lost_or_doubled_is_seen(tmp_path):
    rows = ['{"case": 1, "seconds": 1}\n', '{"case": 2, "seconds": 1}\n']
    found = []
    for lines in (rows, rows[:1], [*rows, rows[1]]):
        (tmp_path / "cells.jsonl").write_text("".join(lines), encoding="utf-8")
        found.append(digests(tmp_path)["cells.jsonl"])
    assert len(set(found)) == 3


def changed(at: int, factor: float) -> FlightRecord:
    """Return the record from one sample on, with one channel in another unit."""
    return FlightRecord(T[at:] - T[at], ("de", "q"), WHOLE.data[at:] * [1.0, factor], "measured")


def test_lost_first_rows_are_no_other_flight():
    assert differing(WHOLE, changed(0, 1.0)) == []
    assert differing(WHOLE, changed(25, 1.0)) == []


@pytest.mark.parametrize("at", [0, 25])
def test_a_channel_in_another_unit_is_seen(at):
    assert [line.split(":")[0] for line in differing(WHOLE, changed(at, 57.3))] == ["q"]


@pytest.mark.parametrize(
    ("err", "status", "fault"),
    [
        ("... trim\nerror: a law; do this\n", 3, ""),
        ("Traceback (most recent call last):\n", 1, "traceback"),
        ("error: one\nerror: two\n", 3, "more than a line"),
        ("something else\n", 3, "more than a line"),
        ("", 1, "wrong status"),
        ("", None, "hung"),
    ],
)
def test_an_end_that_is_not_sound_is_seen(err, status, fault):
    assert unsound(Ended(status, "", err, 1.0, 1.0, False), {0, 3}) == fault


def test_a_file_that_is_half_and_a_page_without_its_tables_are_seen(tmp_path):
    (tmp_path / "out").mkdir()
    for name in ("report.html", "a.csv"):
        (tmp_path / "out" / name).write_text("whole", encoding="utf-8")
    wanted = Wanted(Ended(0, "", "", 1.0, 1.0, False), {}, digests(tmp_path), 5)
    assert half(tmp_path, wanted) == ""
    (tmp_path / "out" / "a.csv").write_text("who", encoding="utf-8")
    assert half(tmp_path, wanted) == "half-written"
    (tmp_path / "out" / "a.csv").unlink()
    assert half(tmp_path, wanted) == "looked finished"


@pytest.fixture
def written(tmp_path):
    """Return a place with two folders of results, and what an undisturbed run is wanted to leave."""
    for out in ("logs", "out"):
        with ResultFolder(tmp_path / out) as folder:
            for name in ("report.html", "a.csv"):
                (folder.new / name).write_text("whole", encoding="utf-8")
    return tmp_path, Wanted(Ended(0, "", "", 1.0, 1.0, False), {}, digests(tmp_path), 5)


def test_a_result_that_is_whole_is_no_fault(written):
    assert whole(*written) == ("", "the new result")


def test_moves_that_were_left_are_made_before_one_looks(written):
    place, wanted = written
    out, new = place / "out", place / "out" / OWN / "new"
    with ResultFolder(out) as folder:
        for name in ("report.html", "a.csv"):
            (folder.new / name).write_text("whole", encoding="utf-8")
    new.mkdir()
    (out / "report.html").rename(new / "report.html")
    manifest = (out / OWN / "manifest.json").read_text(encoding="utf-8")
    (out / OWN / COMMIT).write_text(manifest.replace("{", '{"aside": [], "stale": [],', 1), encoding="utf-8")
    assert whole(place, wanted) == ("", "the new result")


def test_bytes_that_the_manifest_does_not_tell_are_seen(written):
    place, wanted = written
    (place / "out" / "a.csv").write_text("other", encoding="utf-8")
    assert whole(place, wanted)[0] == "half-written"


def test_a_file_of_another_result_is_seen(written):
    place, wanted = written
    (place / "out" / "b.csv").write_text("whole", encoding="utf-8")
    more = {**wanted.after, "out/b.csv": digests(place)["out/b.csv"]}
    assert whole(place, Wanted(wanted.ended, {}, more, 5)) == (
        "mixed",
        "out/b.csv lies there, and no manifest lists it",
    )


@pytest.mark.parametrize(
    ("each_s", "lasts_s", "status"),
    [(0.0, 60.0, None), (15.0, 60.0, None), (0.3, 0.7, 0)],
    ids=["waits for ever", "works without end", "works for long"],
)
def test_a_hang_is_told_from_a_machine_that_others_have(tmp_path, monkeypatch, each_s, lasts_s, status):
    for name, value in (("IDLE_S", 0.3), ("WORK_S", 0.2), ("LONGEST_S", 20.0)):
        monkeypatch.setattr(process, name, value)
    used = (k * each_s for k in count(1))
    monkeypatch.setattr(process, "_processor_s", lambda group: next(used))
    monkeypatch.setitem(sys.modules, "stand_in.__main__", SimpleNamespace(main=lambda: time.sleep(lasts_s)))
    assert Running([], tmp_path, module="stand_in").ended().status == status


def test_the_processor_time_of_a_group_is_read(tmp_path, monkeypatch):
    def work():
        while True:
            pass

    monkeypatch.setitem(sys.modules, "stand_in.__main__", SimpleNamespace(main=work))
    running = Running([], tmp_path, module="stand_in")
    due = time.monotonic() + 60.0
    while process._processor_s(running.pid) < 0.05 and time.monotonic() < due:
        time.sleep(0.02)
    used = process._processor_s(running.pid)
    running.send(signal.SIGKILL)
    assert running.ended().status == 137
    assert 0.05 <= used < 10.0
