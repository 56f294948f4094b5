"""What takes too much memory is refused before it is taken, with the limit, its setting and the size."""

from __future__ import annotations

import struct
import zlib

import h5py
import numpy as np
import pytest

from testbench.core.door import VARIABLE, require_room
from testbench.core.errors import RecordError, ScenarioError, SizeError
from testbench.core.record import FlightRecord, load_record
from testbench.core.scenario.inputs import Doublet, Multisine, Prbs
from testbench.inputs import build
from testbench.logs.tables import read_table

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
