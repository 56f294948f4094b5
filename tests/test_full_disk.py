"""A disk that fills while results are written: one sentence, status 3, nothing half-written, and no crash.

The largest file that a process may write stands for the disk: writing beyond it fails in the same calls.
"""

import os
import pickle
import resource
import signal
import sys

import numpy as np
import pytest
from short_flight import DE, Q, T

import testbench as tb
import testbench.cli as cli
from testbench.core.errors import BusyError, DiskError, WriteError
from testbench.core.record import FlightRecord
from testbench.flight.batch.fly import fly_jobs

RECORD = FlightRecord(T, ("de", "q"), np.radians(np.column_stack([DE, Q])), "measured")


def with_room(size, action):
    """Run an action in a process of its own that writes no file above ``size`` bytes; return status and stderr."""
    reading, writing = os.pipe()  # its size is not limited
    child = os.fork()
    if child == 0:
        try:
            os.dup2(writing, 2)
            sys.stderr = os.fdopen(2, "w", encoding="utf-8")
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
            action()
            os._exit(0)
        except DiskError as error:
            os._exit(error.exit_status)
        except SystemExit as end:
            sys.stderr.flush()
            os._exit(int(end.code or 0))
        except BaseException:
            os._exit(99)
    os.close(writing)
    with os.fdopen(reading, encoding="utf-8") as said:
        text = said.read()
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), text


@pytest.mark.sampled(2)
@pytest.mark.parametrize("form", ["nc", "csv", "mat", "parquet"])
def test_records_of_every_format_at_many_sizes(tmp_path, form):
    if form == "parquet":
        pytest.importorskip("pyarrow.parquet", reason="pyarrow is missing: pip install flight-testbench[parquet]")
    save = {"nc": RECORD.save, "csv": RECORD.save_csv, "mat": RECORD.save_mat, "parquet": RECORD.save_parquet}[form]
    whole = save(tmp_path / f"whole.{form}").stat().st_size
    path = tmp_path / f"r.{form}"
    for size in [0, 1, 512, *np.linspace(1000, whole - 1, 8).astype(int).tolist()]:
        assert with_room(size, lambda: save(path))[0] == 3
        assert [p.name for p in tmp_path.iterdir()] == [f"whole.{form}"]
    assert with_room(whole, lambda: save(path))[0] == 0
    assert path.is_file()


@pytest.mark.parametrize("size", [0, 10_000])
def test_a_command_says_so_in_one_line_and_ends_with_3(tmp_path, size, monkeypatch):
    rows = np.column_stack([T, DE, Q]).tolist()
    file = tmp_path / "a.csv"
    file.write_text("t [s],de [deg],q [deg/s]\n" + "\n".join(",".join(map(str, row)) for row in rows))
    monkeypatch.setattr(sys, "argv", ["testbench", "import", str(file), "-o", str(tmp_path / "out")])
    status, said = with_room(size, cli.main)
    assert status == 3
    assert [line for line in said.splitlines() if not line.startswith("... ")] == [
        f"error: the disk must have room for '{tmp_path}/out/.testbench/new/whole.nc', got: File too large; "
        "give another folder or free space"
    ]
    assert not (tmp_path / "out").exists()


def test_a_flight_that_finds_no_room_is_no_flight_that_failed():
    aircraft = tb.load_aircraft("taurus")
    trimmed = tb.trim(aircraft, tb.FlightCondition(12.0, 100.0))
    step = tb.InputSignal([0.0, 1.0 / trimmed.rate_hz], [[0.0], [0.0]], ("de",))
    job = tb.Job(aircraft, trimmed, tb.Manoeuvre("step", step), log_rate_hz=60.0)
    assert with_room(0, lambda: fly_jobs([job], "jsbsim")) == (3, "")


@pytest.mark.parametrize("kind", [WriteError, DiskError, BusyError])
def test_what_a_process_cannot_write_another_can_say(kind):
    error = pickle.loads(pickle.dumps(kind("the disk must have room")))
    assert (str(error), type(error)) == ("the disk must have room", kind)


def test_memory_that_does_not_suffice_is_one_line(monkeypatch, capsys):
    def out_of_memory(*_, **__):
        raise MemoryError("17.9 GiB")

    monkeypatch.setattr(cli, "app", out_of_memory)
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 3
    assert capsys.readouterr().err == "error: the memory of this machine does not suffice: 17.9 GiB\n"


@pytest.mark.parametrize(
    "words",
    [
        ("plan", "show", "taurus_63", "-o"),
        ("studio", "taurus", "--write"),
        ("exercise", "start", "short_period", "--student", "a", "--out"),
    ],
    ids=["plan", "studio", "exercise"],
)
def test_commands_that_find_no_room_at_all_name_the_file(tmp_path, words, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["testbench", *words, str(tmp_path / "out")])
    status, said = with_room(0, cli.main)
    errors = [line for line in said.splitlines() if not line.startswith("... ")]
    assert status == 3
    assert len(errors) == 1
    assert errors[0].startswith("error: the disk must have room for '/")
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == []
