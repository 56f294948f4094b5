"""Terminals that lack signs, are narrow or go away: no traceback, no number broken in two, a status that says so."""

import io
import signal
import subprocess
import sys
import time

import pytest
from rich.console import Console
from studies.reliability.process import Around, Running

from testbench import cli
from testbench.__main__ import main
from testbench.core import interrupts
from testbench.page import terminal
from testbench.page.terminal import TimeLeft, clock, open_streams, print_rows

pytestmark = pytest.mark.drawn

PYTHON = [sys.executable, "-m", "testbench"]


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("12 m/s²", "12 m/s^2"),
        ("±3 °", "+/-3  deg"),
        ("ζ = 0.5, ω", "zeta = 0.5, omega"),
        ("Zürich…", "Zurich..."),
        ("飛", "?"),
    ],
)
def test_signs_that_an_encoding_lacks_are_written_in_ascii(monkeypatch, text, shown):
    raw = io.BytesIO()
    monkeypatch.setattr(terminal.sys, "stdout", io.TextIOWrapper(raw, encoding="ascii"))
    monkeypatch.setattr(terminal.sys, "stderr", io.StringIO())
    open_streams()
    terminal.sys.stdout.write(text)
    terminal.sys.stdout.flush()
    assert raw.getvalue().decode() == shown


ROWS = [("short period", "-6.89", "6.542", "0.1012", "1234.5678"), ("spiral", "0.0479", "0", "-14.5", "0.1")]
HEADS = ("mode", "real part, rad/s", "imaginary part, rad/s", "halved in, s", "x")
RIGHT = (False, True, True, True, True)


@pytest.mark.parametrize("width", [12, 20, 30, 40, 50, 80, 200])
def test_no_number_is_broken_however_narrow_a_terminal_is(width):
    out = io.StringIO()
    print_rows(Console(file=out, width=width), HEADS, ROWS, RIGHT, "the modes")
    words = out.getvalue().split()
    assert all(number in words for row in ROWS for number in row[1:])
    if width >= 30:
        assert max(map(len, out.getvalue().splitlines())) <= width


def test_a_title_is_as_wide_as_the_terminal_and_not_as_its_table():
    out = io.StringIO()
    title = "MRSE on the validation records, %"
    print_rows(Console(file=out, width=60), ["model", "q"], [["srivc", "6.22"]], (False, True), title)
    assert out.getvalue().splitlines()[0].rstrip() == title


def test_a_pipe_that_is_closed_ends_a_command_quietly():
    with subprocess.Popen([*PYTHON, "list", "estimators"], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 141


@pytest.mark.parametrize(
    ("streams", "status", "said"),
    [
        (("<&-",), 0, ""),
        ((">&-",), 0, ""),
        (("2>&-",), 0, ""),
        (("<&-", ">&-", "2>&-"), 0, ""),
        ((">/dev/full",), 3, "error: cannot read or write a file or standard output: No space left on device\n"),
        (("2>/dev/full",), 0, ""),
    ],
)
def test_streams_that_are_closed_or_full(tmp_path, streams, status, said):
    ended = Running(["list", "aircraft"], tmp_path, Around(streams, fresh=True)).ended()
    assert (ended.status, ended.err) == (status, said)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("after_s", [0.0, *(pytest.param(0.002 * k, marks=pytest.mark.slow) for k in range(1, 40))])
def test_an_interrupt_of_a_stage_is_one_line_and_leaves_the_folder_as_it_was(tmp_path, after_s, number):
    heed = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"  # whoever runs the tests may not
    script = f"{heed}; from testbench.__main__ import main; main()"
    words = [sys.executable, "-c", script, "run", "eolo_methods", "-o", str(tmp_path)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr.readline().startswith("... ")
        time.sleep(after_s)
        process.send_signal(number)
        said = [line for line in process.stderr.read().splitlines() if not line.startswith("... ")]
    ended, by = (130, "interrupted") if number == signal.SIGINT else (143, "ended by signal 15")
    assert process.returncode == ended
    assert said == [f"{by}; what was finished is kept, and no result is left half written"]
    assert list(tmp_path.iterdir()) == []


class _Interrupted:
    def __getattr__(self, name):
        raise KeyboardInterrupt


def _interrupt(*_):
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("where", "what"),
    [((sys.modules, "testbench.cli"), _Interrupted()), ((vars(cli), "open_streams"), _interrupt)],
    ids=["imports", "before it listens"],
)
def test_an_interrupt_of_what_does_not_listen_for_one_is_one_line_and_130(monkeypatch, capsys, where, what):
    monkeypatch.setattr(interrupts, "leave_to_the_system", lambda: None)  # the tests' own process goes on
    monkeypatch.setitem(*where, what)
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 130
    assert capsys.readouterr().err == "interrupted; no result is left half written\n"


def test_a_stage_that_counts_says_how_long_the_rest_will_take():
    left = TimeLeft()
    assert left.added("fit explanations, 2 of 11 converged", 100.0) == "fit explanations, 2 of 11 converged"
    too_early = left.added("fit explanations, 3 of 11 converged", 101.0)
    assert too_early == "fit explanations, 3 of 11 converged"
    three_in_30_s = left.added("fit explanations, 5 of 11 converged", 130.0)
    assert three_in_30_s.endswith("converged, 1:00 left")
    assert left.added("fit explanations, 11 of 11 converged", 150.0).endswith("converged")
    assert left.added("fit explanations, 1 of 11 converged", 151.0).endswith("converged")  # another round begins
    assert left.added("fit explanations, 2 of 11 converged", 161.0).endswith("converged, 1:30 left")
    assert left.added("write report", 170.0) == "write report"
    assert clock(3723.0) == "1:02:03"


def test_where_lines_stay_a_stage_that_counts_has_one_every_five_seconds():
    left, said = TimeLeft(), []
    for k in range(40):
        text, now_s = f"repeat with {k} of 40 more seeds", 100.0 + 0.5 * k
        if left.due(text, now_s):
            said.append(left.added(text, now_s))
    assert len(said) == 4
    assert said[1] == "repeat with 10 of 40 more seeds, 0:15 left"
    assert left.due("write report", 120.0)
    assert left.due("write report", 120.1)  # a stage that does not count has its line
    assert not left.due("repeat with 1 of 40 more seeds", 121.0)
