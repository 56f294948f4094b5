"""The door: what is no file is refused at once, size comes before content, and nothing nests or unfolds without end.

What takes too much memory is refused before it is taken, with the limit, its setting and the size.

A path where a file is wanted and none is: the refusal names why there is none, and what may have been meant.
"""

import os
import socket
import struct
import time
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest
from commands import ends

from testbench.aircraft.geometry.read import read_plan
from testbench.core import door
from testbench.core.door import (
    KINDS,
    VARIABLE,
    Kind,
    checked,
    read_bytes,
    read_json,
    read_text,
    read_toml,
    read_xml,
    require_room,
    sha256,
)
from testbench.core.errors import RecordError, ScenarioError, SizeError
from testbench.core.paths import find_scenario, not_found
from testbench.core.record import FlightRecord, load_record
from testbench.core.scenario.inputs import Doublet, Multisine, Prbs
from testbench.inputs import build
from testbench.logs.tables import read_table
from testbench.pooling.prior import prior_of_file
from testbench.questions.exercise.roster import students_of
from testbench.questions.export.ask import load_matrices
from testbench.questions.files import find
from testbench.questions.importing.ask import import_log


@pytest.fixture
def strange(tmp_path):
    """Things of the file system that are no files, by what they are."""
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "zero.toml").symlink_to("/dev/zero")
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "loop.toml").symlink_to(tmp_path / "loop.toml")
    return tmp_path


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes as files are of POSIX")
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("pipe.toml", "a pipe, not a file"),
        ("zero.toml", "a device, not a file"),
        ("folder.toml", "Is a directory"),
        ("none.toml", "No such file"),
        ("loop.toml", "Too many levels of symbolic links"),
        ("a\0b.toml", "null byte"),
    ],
)
def test_what_is_no_file_is_refused_in_one_line_at_once(strange, name, words):
    began = time.monotonic()
    for read in (
        read_toml,
        *(lambda p, f=f: f(p, "model") for f in (read_bytes, read_text, read_json, read_xml, sha256)),
    ):
        with pytest.raises(RecordError, match=words) as caught:
            read(strange / name)
        assert "\n" not in str(caught.value)
    assert time.monotonic() - began < 1.0


def test_a_socket_is_none(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the name of a socket is short
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("s")
        with pytest.raises(RecordError, match="a socket, not a file"):
            checked(tmp_path / "s", "key")


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_larger_than_its_kind_may_be_is_not_read(tmp_path, monkeypatch, kind):
    path = tmp_path / "f"
    path.write_bytes(b"0" * 2000)
    monkeypatch.setitem(door.KINDS, kind, Kind(KINDS[kind].words, min(KINDS[kind].most, 1000.0)))
    monkeypatch.setenv(VARIABLE, "1e-6")
    with pytest.raises(RecordError, match=r"0\.001 MB|of memory"):
        read_bytes(path, kind)


def test_a_log_that_memory_has_no_room_for_is_not_read(tmp_path):
    path = tmp_path / "flight.ulg"
    path.touch()
    os.truncate(path, 2 * 10**9)
    with pytest.raises(SizeError, match=VARIABLE):
        read_bytes(path, "log")


def test_what_says_no_size_is_read_to_its_limit_only(monkeypatch):
    monkeypatch.setitem(door.KINDS, "key", Kind("file", 10.0))
    with pytest.raises(RecordError, match="more than"):
        read_bytes(door.Path("/proc/self/maps"), "key")


@pytest.mark.parametrize(
    ("read", "text"),
    [
        (lambda p: read_json(p, "model"), "[" * 200_000),
        (lambda p: read_json(p, "model"), "{"),
        (lambda p: read_xml(p, "JSBSim model"), "<a>" * 100_000 + "</a>" * 100_000),
        (lambda p: read_xml(p, "JSBSim model"), "<a>"),
        (lambda p: read_xml(p, "definitions"), '<!DOCTYPE a [<!ENTITY x "y"><!ENTITY z "&x;&x;">]><a>&z;</a>'),
        (read_toml, "a = " + "[" * 5000),
        (read_toml, "a = " + "9" * 5000),
        (read_toml, "a ="),
        (load_matrices, "[" * 100_000),
    ],
)
def test_what_nests_unfolds_or_ends_early_is_one_line(tmp_path, read, text):
    path = tmp_path / "f"
    path.write_text(text, encoding="utf-8")
    with pytest.raises((RecordError, ScenarioError)) as caught:
        read(path)
    assert "f" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["pipe.toml", "zero.toml"])
@pytest.mark.parametrize("ask", [load_matrices, import_log, read_plan, prior_of_file, students_of])
def test_what_asks_for_a_file_refuses_devices_and_pipes(strange, ask, name):
    with pytest.raises((RecordError, ScenarioError)):
        ask(strange / name if ask is not students_of else str(strange / name))


def test_text_is_read_with_line_ends_of_any_system(tmp_path):
    (tmp_path / "f").write_bytes(b"\xef\xbb\xbfa\r\nb\rc\n")
    assert read_text(tmp_path / "f", "roster", "utf-8-sig") == "a\nb\nc\n"
    (tmp_path / "f").write_bytes(b"\xff\xfe")
    with pytest.raises(RecordError, match="not UTF-8"):
        read_text(tmp_path / "f", "roster")


DE = {"control": "de", "amplitude_deg": 1.0}


def test_the_limit_is_a_setting(monkeypatch):
    require_room("a table", 1e9, "cut it")
    with pytest.raises(SizeError, match=rf"a table must take at most 1 GB of memory \({VARIABLE}\), got 1\.5 GB"):
        require_room("a table", 1.5e9, "cut it")
    monkeypatch.setenv(VARIABLE, "2")
    require_room("a table", 1.5e9, "cut it")
    for wrong in ("x", "0", "-1", "nan"):
        monkeypatch.setenv(VARIABLE, wrong)
        with pytest.raises(SizeError, match="must be a number of gigabytes above 0"):
            require_room("a table", 1.0, "cut it")


@pytest.mark.parametrize("size", [float("inf"), float("nan")])
def test_what_has_no_size_is_refused(size):
    with pytest.raises(SizeError):
        require_room("a table", size, "cut it")


def _hdf5(path, **how):
    with h5py.File(path, "w") as file:
        for name in ("t", "q"):
            file.create_dataset(name, dtype="f8", **how)
        file["t"].make_scale("t")
        file["q"].dims[0].attach_scale(file["t"])


def _unwritten(path):
    _hdf5(path, shape=(300_000_000,), chunks=(1_000_000,))


def _one_huge_chunk(path):
    _hdf5(path, shape=(10,), maxshape=(None,), chunks=(200_000_000,))


def _packed_zeros(path):
    """140 million bytes, packed, which become as many numbers of eight bytes each."""
    count = 140_000_000
    head = struct.pack("<IIIIIIiiIHH", 6, 8, 6, 0, 5, 8, count, 1, 0x00010001, 0, 0)
    head = head[:32] + struct.pack("<HH4s", 1, 1, b"q")
    packer = zlib.compressobj(1)
    packed = packer.compress(struct.pack("<II", 14, len(head) + 8 + count) + head + struct.pack("<II", 2, count))
    packed += b"".join(packer.compress(bytes(1_000_000)) for _ in range(count // 1_000_000)) + packer.flush()
    start = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    path.write_bytes(start + struct.pack("<II", 15, len(packed)) + packed)


def _packed_parquet(path):
    pa = pytest.importorskip("pyarrow", reason="pyarrow is missing: pip install flight-testbench[parquet]")
    parquet = pytest.importorskip("pyarrow.parquet")
    block = pa.table({name: pa.array(np.zeros(2_000_000)) for name in ("t", "q", "de")})
    with parquet.ParquetWriter(path, block.schema) as file:
        for _ in range(22):
            file.write_table(block)


@pytest.mark.parametrize(
    ("name", "kind", "write"),
    [
        ("a.nc", "netcdf", _unwritten),
        ("b.nc", "netcdf", _one_huge_chunk),
        ("c.mat", "mat", _packed_zeros),
        ("d.parquet", "parquet", _packed_parquet),
    ],
)
def test_files_of_kilobytes_that_unpack_to_gigabytes(tmp_path, name, kind, write):
    path = tmp_path / name
    write(path)
    assert path.stat().st_size < 2e6
    with pytest.raises(SizeError, match=rf"{name}.*{VARIABLE}"):
        read_table(path, kind)


def test_a_record_says_its_size_before_it_is_read(tmp_path, monkeypatch):
    path = FlightRecord(np.arange(1000.0), ("q",), np.zeros((1000, 1)), "measured").save(tmp_path / "r.nc")
    (tmp_path / "r.csv").write_text("t,q\n" + "0,0\n" * 3000)
    monkeypatch.setenv(VARIABLE, "1e-5")
    with pytest.raises(SizeError, match=r"r\.nc"):
        load_record(path)
    with pytest.raises(SizeError, match="table"):
        read_table(tmp_path / "r.csv", "csv")


@pytest.mark.parametrize("duration_s", [1e7, 1e300, 1.7e308])
def test_a_flight_of_months_is_refused(duration_s):
    spec = Doublet(signal="doublet", period_s=1.0, **DE)
    with pytest.raises(SizeError, match="duration_s"):
        build([spec], duration_s, 240.0)


@pytest.mark.parametrize(
    "spec",
    [
        Doublet(signal="doublet", period_s=1.0, repeats=10**5, **DE),
        Doublet(signal="doublet", period_s=1.0, start_s=36000.0, **DE),
        Prbs(signal="prbs", step_s=1e-5, prbs_s=36000.0, **DE),
        Prbs(signal="prbs", step_s=0.5, prbs_s=36000.0, **DE),
        Multisine(signal="multisine", f_min_hz=1.0, f_max_hz=20000.0, period_s=36000.0, **DE),
        Multisine(signal="multisine", f_min_hz=1e-5, f_max_hz=1.0, period_s=9.0, periods=10**5, **DE),
    ],
)
def test_inputs_without_end_are_refused_at_once(spec):
    with pytest.raises((ScenarioError, SizeError)):
        build([spec], 10.0, 100.0)


def test_a_heap_that_hdf5_never_leaves_is_refused(tmp_path):
    path = FlightRecord(np.arange(5.0), ("q",), np.zeros((5, 1)), "measured").save(tmp_path / "r.nc")
    content = bytearray(path.read_bytes())
    at = content.index(b"GCOL")
    content[at + 16 : at + 32] = bytes(16)  # the first object: free, of no size
    path.write_bytes(content)
    with pytest.raises(RecordError, match=rf"the heap at byte {at} holds an object of 0 bytes"):
        load_record(path)


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working folder with a log, a scenario, a folder of import, and folders that hold no description."""
    monkeypatch.chdir(tmp_path)
    for name in ("log1", "eolo_alpha", "attas_short_period", "records_mine", "empty"):
        Path(name).mkdir()
    Path("flight.csv").touch()
    Path("my_scenario.toml").write_text('title = "Mine"\naircraft = "taurus"\n', encoding="utf-8")
    Path("records_mine/flight_longitudinal.toml").touch()
    return tmp_path


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("nofolder", "'nofolder', but there is no file or folder of that name"),
        ("log2/", "'log2', but there is no file or folder of that name; did you mean 'log1'?"),
        ("log2/flight.toml", "'log2/flight.toml', but there is no folder 'log2'; did you mean 'log1'?"),
        ("lgo1/a/b.toml", "'lgo1/a/b.toml', but there is no folder 'lgo1'; did you mean 'log1'?"),
        ("log1/flight.toml", "'log1/flight.toml', but there is no file or folder of that name"),
        ("flght.csv", "'flght.csv', but there is no file or folder of that name; did you mean 'flight.csv'?"),
        ("flight.csv/whole.nc", "'flight.csv/whole.nc', but 'flight.csv' is a file"),
        ("log1", "'log1', which is a folder"),
        ("/dev/null", "'/dev/null', which is neither a file nor a folder"),
    ],
)
def test_the_cause_is_named_and_the_nearest_name_beside(here, path, said):
    assert not_found(Path(path)) == said


def test_packaged_names_and_descriptions_in_a_folder_are_offered(here):
    assert not_found(Path("eolo_alpah"), ["eolo_alpha"], lambda path: False).endswith("; did you mean 'eolo_alpha'?")
    assert not_found(Path("nothing"), ["eolo_alpha"]).endswith("of that name; packaged: eolo_alpha")
    mine = not_found(Path("records_mine"), ["eolo_alpha"])
    assert mine == "'records_mine', which is a folder; did you mean 'records_mine/flight_longitudinal.toml'?"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("identify nofolder", "what is identified must be a log, a folder that testbench import wrote, or a desc"),
        ("identify nofolder", "got 'nofolder', but there is no file or folder of that name"),
        ("identify flght.csv", "did you mean 'flight.csv'?"),
        ("identify empty", "a folder to identify must hold a description of records (.toml), got 'empty' without one"),
        ("run my_scenari", "did you mean 'my_scenario.toml'?"),
        ("run flight.toml", "a scenario must be a file or a packaged one, got 'flight.toml', but there is no file"),
        ("design nofolder", "a design scenario must be a file or a packaged one, got 'nofolder', but there is no"),
        ("compatibility records_mine", "did you mean 'records_mine/flight_longitudinal.toml'?"),
        ("check log2", "did you mean 'log1'?"),
        ("import flgt.csv", "a log must be a file that exists, got 'flgt.csv', but there is no file or folder of that"),
        ("import log1", "a log must be a file that exists, got 'log1', which is a folder"),
        ("export modl.json --to mat", "a model must be a file that exists, got 'modl.json', but there is no file or"),
        ("results log2", "a folder of results must be a folder that exists, got 'log2', but there is no file or fol"),
    ],
)
def test_a_command_names_the_cause(here, monkeypatch, capsys, words, said):
    status, lines = ends(monkeypatch, capsys, *words.split())
    assert status == 2
    assert said in " ".join(lines)


def test_a_folder_does_not_hide_a_packaged_scenario_of_its_name(here):
    assert find_scenario("eolo_alpha").is_file()
    assert find(Path("eolo_alpha"), "run").stem == "eolo_alpha"
    from testbench.questions.identify.logs import _in_folder

    assert [p.parent.name for p in _in_folder(Path("attas_short_period"))] == ["records"]
