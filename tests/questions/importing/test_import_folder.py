"""What import writes: one result in one folder, whole or not there, beside whatever a user has in it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from commands import command
from killed import shown
from writers import dataflash_bin, short_period

from testbench.core.errors import BusyError, RecordError
from testbench.core.files import write_new
from testbench.core.store import KEPT, OWN, ResultFolder
from testbench.questions.importing.ask import import_log, write_import

MINE = {"figures/mine.pdf": "thesis", "models/plane.xml": "model", "tables/mine.csv": "t", "cards/mine.txt": "c"}


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "flight.bin"
    path.write_bytes(dataflash_bin(motion=short_period))
    return path


@pytest.fixture
def found(log, monkeypatch):
    monkeypatch.setattr("testbench.page.page.write_plates", lambda plates, folder: ([], []))
    return import_log(log)


def put_mine(folder):
    for name, text in MINE.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def test_an_import_into_the_users_own_folder_leaves_all_that_lies_there(log, tmp_path):
    put_mine(tmp_path)
    done = command("import", log, "-o", ".", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert shown(tmp_path) >= {*MINE, "whole.nc", "01_de.nc", "flight_longitudinal.toml", "report.html"}
    assert {name: (tmp_path / name).read_text() for name in MINE} == MINE


def test_a_second_import_leaves_no_record_of_the_first_and_keeps_an_edited_description(found, tmp_path):
    write_import(found, tmp_path)
    first = shown(tmp_path)
    description = tmp_path / "flight_longitudinal.toml"
    description.write_text("edited")
    with ResultFolder(tmp_path) as place:  # as an import of another log, with other names, writes it
        (place.new / "whole.nc").write_text("another flight")
    assert shown(tmp_path) == {"whole.nc", "flight_longitudinal.toml"}
    assert description.read_text() == "edited"
    (tmp_path / "whole.nc").unlink()
    description.rename(tmp_path / "mine.toml")
    write_import(found, tmp_path)
    description.write_text("edited")
    with pytest.warns(UserWarning, match="changed by hand"):
        write_import(found, tmp_path)
    assert shown(tmp_path) == first | {"mine.toml", f"flight_longitudinal.toml{KEPT}"}
    assert (tmp_path / f"flight_longitudinal.toml{KEPT}").read_text() == "edited"


def test_of_two_imports_at_once_the_second_is_refused_before_it_wrote_anything(log, tmp_path):
    with ResultFolder(tmp_path / "out"):
        for words in (("import", log, "-o", "out"), ("identify", log, "-o", tmp_path)):
            (tmp_path / "flight").unlink(missing_ok=True)
            os.symlink(tmp_path / "out", tmp_path / "flight")  # identify writes what import would to OUT/LOG
            done = command(*words, cwd=tmp_path)
            assert done.returncode == BusyError.exit_status, done.stderr
            assert "one writer at a time" in done.stderr
            assert shown(tmp_path / "out") == set()
    assert not (tmp_path / "out" / OWN / "new").exists()


TWICE = "import sys; from pathlib import Path; from testbench.core.files import write_new; "
TWICE += "input(); write_new(Path(sys.argv[1]), 'x' * 10, 'a plan')"


def test_a_new_file_never_takes_the_place_of_one_that_is_there(tmp_path):
    file = tmp_path / "new.toml"
    assert write_new(file, "first", "a plan") == file
    with pytest.raises(RecordError, match=r"a plan must be a new file, got '.*new\.toml', which exists"):
        write_new(file, "second", "a plan")
    assert [p.read_text() for p in tmp_path.iterdir()] == ["first"]
    other = tmp_path / "at_once.toml"
    racers = [
        subprocess.Popen([sys.executable, "-c", TWICE, other], stdin=subprocess.PIPE, stderr=subprocess.DEVNULL)
        for _ in range(2)
    ]
    for racer in racers:
        racer.stdin.write(b"\n")
        racer.stdin.close()
    assert sorted(racer.wait() for racer in racers) == [0, 1]
    assert {p.name for p in Path(tmp_path).iterdir()} == {"new.toml", "at_once.toml"}
