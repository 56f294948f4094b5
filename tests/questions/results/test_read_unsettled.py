"""A result whose writer was killed between its commit and its last move is read whole, whoever reads it first."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest
from commands import ends
from killed import killed_at, whole
from short_flight import DE, Q, T

import testbench as tb
from testbench.core import store
from testbench.core.files import write_file
from testbench.core.paths import AIRCRAFT, SCENARIOS, resolve
from testbench.core.record import FlightRecord
from testbench.core.store import COMMIT, OWN, PAGE, ResultFolder, Unsettled
from testbench.questions.gap.new import record_files
from testbench.questions.plan.designs import take
from testbench.questions.results.verify import verify_results
from testbench.questions.tidy import COLUMNS

MODEL = {"structure": "short_period", "covariance": [[0.04]], "parameters": {"M_q": {"value": -2.0, "free": True}}}
HEAD = '<p class="kicker">flight-testbench: run</p><h1>a</h1>'


def write(folder: Path) -> None:
    with ResultFolder(folder) as place:
        FlightRecord(T, ("de", "q"), [[*x] for x in zip(DE, Q, strict=True)], "measured").save(place.new / "a.nc")
        write_file(place.new / "models" / "a.json", json.dumps(MODEL))
        write_file(place.new / "designs" / "1_a.toml", (SCENARIOS / "eolo_alpha.toml").read_bytes())
        write_file(place.new / "tables" / "results.csv", ",".join(COLUMNS) + "\n")
        write_file(place.new / "aircraft.toml", 'schema = "aircraft 1"\n')
        write_file(place.new / PAGE, HEAD)


@pytest.fixture(scope="module")
def unsettled(tmp_path_factory) -> list[Path]:
    """The folder as a kill leaves it at each step from its commit on."""
    out = []
    for step in range(1, 60):
        folder = tmp_path_factory.mktemp("killed") / "out"
        killed = killed_at(step, lambda folder=folder: write(folder))
        if not killed:
            break
        if (folder / OWN / COMMIT).exists():
            out.append(folder)
    assert len(out) > 6
    assert [p.name for p in out[0].iterdir()] == [OWN]
    return out


READERS = {
    "record": lambda folder: tb.load_record(folder / "a.nc"),
    "records": lambda folder: record_files([folder]),
    "design --after": lambda folder: tb.known_after([folder], 16.0),
    "plan": lambda folder: take([folder]),
    "list": lambda folder: tb.list_results(folder.parent),
    "compare": lambda folder: tb.compare_results(folder, folder),
    "table": tb.read_results,
    "verify": verify_results,
    "aircraft": lambda folder: resolve(str(folder), AIRCRAFT),
}


@pytest.mark.parametrize("read", READERS.values(), ids=READERS)
def test_whoever_reads_first(unsettled, tmp_path, read):
    for k, left in enumerate(unsettled):
        folder = shutil.copytree(left, tmp_path / str(k) / "out")
        read(folder)
        assert not (folder / OWN / COMMIT).exists(), left
        assert whole(folder)


@pytest.mark.parametrize("words", [("export", "out/a.nc", "--to=csv"), ("results", "out"), ("plan", "new", "out")])
def test_a_command_that_names_it(unsettled, tmp_path, monkeypatch, capsys, words):
    folder = shutil.copytree(unsettled[0], tmp_path / "out")
    monkeypatch.chdir(tmp_path)
    status, said = ends(monkeypatch, capsys, *words)
    assert (status, said) == (0, []) or words[0] == "plan"
    assert not (folder / OWN / COMMIT).exists()


def test_one_that_cannot_be_written_to_is_read_as_it_is(unsettled, tmp_path, monkeypatch):
    folder = shutil.copytree(unsettled[-1], tmp_path / "out")

    def read_only(*given, **more):
        raise PermissionError(13, os.strerror(13))

    monkeypatch.setattr(store, "locked", read_only)
    with pytest.warns(Unsettled, match="not all in place.*read as it is"):
        record = tb.load_record(folder / "a.nc")
    assert len(record) == len(T)
    assert (folder / OWN / COMMIT).exists()
