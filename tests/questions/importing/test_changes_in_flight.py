"""A user with one flight of an autopilot asks what changed in it, of the finished log and while it flies."""

import json
import re

import pytest
from commands import command
from inference.closed_loop import fly

import testbench as tb
from testbench.core.errors import RecordError
from testbench.inference.changes import Change
from testbench.questions.importing.ask import import_log
from testbench.questions.importing.changes import change_lines, change_sentence, watch_log
from testbench.questions.live.answer import called
from testbench.questions.live.ask import Session, fly_along
from testbench.questions.live.stream import open_source


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return fly(101, length_s=160.0, at_s=100.0, factors={"da": 0.5}).save_csv(
        tmp_path_factory.mktemp("log") / "one.csv"
    )


def test_import_says_what_changed(log, tmp_path):
    sound = fly(102, length_s=100.0).save_csv(tmp_path / "sound.csv")
    done = command("import", log, "--changes", "--nominal", sound, "--beginning", 40)
    assert done.returncode == 0, done.stderr
    said = " ".join(done.stdout.replace("\xa0", " ").split())
    assert re.search(r"Since (99|100|101) s the aileron has 0\.5\d ± 0\.1 of its effect: p > 0\.99\.", said)


def test_nominal_without_changes_is_refused(log):
    done = command("import", log, "--nominal", log)
    assert done.returncode == 2
    assert "--nominal tells --changes what to compare with: give both" in done.stderr


def test_a_flight_shorter_than_its_beginning_is_refused(log):
    with pytest.raises(RecordError, match=r"more flight than the 500 s that are believed nominal, got 1[56]"):
        watch_log(import_log(log), (), 500.0)


def test_a_sound_flight_says_so(tmp_path):
    path = fly(102, length_s=100.0).save_csv(tmp_path / "sound.csv")
    assert change_lines(watch_log(import_log(path))) == ["nothing has changed in flight: p > 0.99"]


def test_live_calls_it_once_and_soon(log):
    source = open_source(str(log), {}, {}, None, True, 0.0)
    session = Session(source.name, tb.load_aircraft("taurus"), beginning_s=60.0)
    updates = list(fly_along(source, session.aircraft, session=session, draws=0))
    calls = [c for c in session.calls if c.kind == "change"]
    assert [c.channel for c in calls] == ["da"]
    assert 100.0 < calls[0].t_s < 106.0
    assert called(calls[0]).startswith("stop: since 10")
    assert updates[100].changed == 0.0
    assert updates[-1].changed > 0.99
    assert json.loads(updates[-1].line())["changed"] == updates[-1].changed


@pytest.mark.parametrize(
    ("what", "words"),
    [
        (("right", "factor", 0.31, 0.02), "the right elevon has 0.31 ± 0.04 of its effect: p = 0.97"),
        (("dr", "stuck", 0.0, 0.0), "the rudder stands still: p = 0.97"),
        (("q", "reads", -1.0, 0.0), "q has the wrong sign: check its instrument: p = 0.97"),
        (("V", "reads", 0.5, 0.0), "V reads 0.50 of what it measures: check its instrument: p = 0.97"),
        (("", "unknown", 1.0, 0.0), "the aircraft does not answer as before, and no single part explains it: p = 0.97"),
    ],
)
def test_every_kind_of_change_has_its_sentence(what, words):
    change = Change(*what, 312.0, 400.0, 0.97, 1.0)
    assert change_sentence(change) == f"since 312 s {words}"
    assert change_sentence(change, 400.0) == f"from 312 to 400 s {words}"
    doubtful = change_sentence(Change("da", "factor", 0.5, 0.02, 312.0, 400.0, 0.999, 0.8))
    assert doubtful == "since 312 s the aileron has 0.50 ± 0.04 of its effect (80 % likely if so): p > 0.99"
