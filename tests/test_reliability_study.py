"""The study of reliability sees the faults that it looks for, and takes no time stamp or lost first row for one."""

from __future__ import annotations

import numpy as np
import pytest
from short_flight import DE, Q, T
from studies.reliability.process import Ended
from studies.reliability.records import differing
from studies.reliability.treatments import Wanted, digests, half, unsound

from testbench.core.record import FlightRecord

WHOLE = FlightRecord(T, ("de", "q"), np.radians(np.column_stack([DE, Q])), "measured")


@pytest.mark.parametrize(
    ("file", "one", "timed", "other"),
    [
        ("report.html", "<dt>cost</dt><dd>1 ms</dd> b", "<dt>cost</dt><dd>2 ms</dd> b", "<dt>cost</dt><dd>1 ms</dd> c"),
        ("cases.csv", "a,none,1.3\nb,none,1.4\n", "a,none,1.5\nb,none,1.3\n", "a,wrong,1.3\nb,none,1.4\n"),
        ("rows.jsonl", '{"case": 1, "seconds": 1.5}\n{"case": 2, "seconds": 3}\n',
         '{"case": 2, "seconds": 1.0}\n{"case": 1, "seconds": 2}\n', '{"case": 1, "seconds": 1.5}\n'),
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
        (tmp_path / "rows.jsonl").write_text("".join(lines), encoding="utf-8")
        found.append(digests(tmp_path)["rows.jsonl"])
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
