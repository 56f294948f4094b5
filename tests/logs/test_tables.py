"""Tables of every format, and records made of them: exact round trips, and one clear error for each kind of rubbish."""

import hashlib

import numpy as np
import pytest

from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord
from testbench.logs.read import read_records
from testbench.logs.tables import read_table
from testbench.questions.identify.scenario import RecordDescription

N = 40
HEAD = """
title = "t"
source = "s"
rights = "r"
"""
TAIL = """
[identification]
inputs = ["de"]
[[identification.estimators]]
method = "dsr_e"
past_horizon = 5
future_horizon = 5
"""


def synthetic(gaps: bool = True) -> FlightRecord:
    """A record whose invalid samples hold the last valid value, as they must; the first samples are valid."""
    rng = np.random.default_rng(11)
    data = rng.normal(size=(N, 3)) * [0.1, 1e-7, 1e5]
    valid = np.ones((N, 3), bool)
    if gaps:
        valid[1:, 1:] = rng.random((N - 1, 2)) < 0.7
        for k in range(1, N):
            data[k] = np.where(valid[k], data[k], data[k - 1])
    return FlightRecord(0.1 + np.arange(N) / 30.0, ("de", "q", "h"), data, "measured", valid, {"seed": 11})


def describe(tmp_path, file, *, time='column = "t"', record="", channels=None, use="split", tail=TAIL):
    channels = channels or [
        'name = "de"\ncolumn = "de"\nunit = "rad"',
        'name = "q"\ncolumn = "q"\nunit = "rad/s"\nmissing = "mask"',
        'name = "h"\ncolumn = "h"\nunit = "m"\nmissing = "mask"',
    ]
    text = HEAD + f'[time]\n{time}\n[[record]]\nname = "r"\nfile = "{file}"\nuse = "{use}"\n{record}\n'
    text += "\n".join("[[channel]]\n" + channel for channel in channels) + tail
    path = tmp_path / "d.toml"
    path.write_text(text, encoding="utf-8")
    return RecordDescription.load(path)


def read(tmp_path, file, **options):
    return read_records(describe(tmp_path, file, **options))


def save_text(record: FlightRecord, path):
    rows = np.column_stack([record.t_s, np.where(record.valid, record.data, np.nan)])
    np.savetxt(path, rows, fmt="%.17g", header="t de q h\ns rad rad/s m", comments="")
    return path


def save_plain_netcdf(record: FlightRecord, path, engine="h5netcdf"):
    dataset = record.to_xarray()
    dataset.attrs = {}
    for name in record.channels:
        if f"{name}_valid" in dataset:
            dataset[name] = dataset[name].where(dataset[f"{name}_valid"] == 1).assign_attrs(dataset[name].attrs)
    dataset.assign_coords(station=("station", [1.0, 2.0])).to_netcdf(path, engine=engine)
    return path


SAVERS = {
    "csv": ("r.csv", lambda r, p: r.save_csv(p)),
    "text": ("r.txt", save_text),
    "mat": ("r.mat", lambda r, p: r.save_mat(p)),
    "parquet": ("r.parquet", lambda r, p: r.save_parquet(p)),
    "netcdf": ("r.nc", lambda r, p: r.save(p)),
    "netcdf_plain": ("p.nc", save_plain_netcdf),
    "netcdf_classic": ("c.nc", lambda r, p: save_plain_netcdf(r, p, "scipy")),
}


@pytest.mark.parametrize("gaps", [False, True], ids=["whole", "gaps"])
@pytest.mark.parametrize("kind", SAVERS)
def test_every_format_gives_back_every_bit(kind, gaps, tmp_path):
    file, save = SAVERS[kind]
    record = synthetic(gaps)
    path = save(record, tmp_path / file)
    [(name, use, found)] = read(tmp_path, file)
    assert (name, use, found.kind, found.channels) == ("r", "split", "measured", record.channels)
    assert np.array_equal(found.t_s, record.t_s)
    assert np.array_equal(found.data, record.data)
    assert np.array_equal(found.valid, record.valid)
    assert found.provenance["file"] == file
    assert found.provenance["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert found.provenance["segment_s"] == [record.t_s[0], record.t_s[-1]]
    if kind in {"netcdf", "mat", "parquet"}:
        assert found.provenance["recorded"] == {"seed": 11}


@pytest.mark.parametrize("kind", ["netcdf", "mat", "parquet"])
def test_a_simulated_truth_is_not_a_recorded_flight(kind, tmp_path):
    file, save = SAVERS[kind]
    record = synthetic()
    save(FlightRecord(record.t_s, record.channels, record.data, "truth"), tmp_path / file)
    with pytest.raises(RecordError, match="must be measured"):
        read(tmp_path, file)


@pytest.mark.parametrize("kind", SAVERS)
def test_rubbish_in_every_format_is_one_line_that_names_the_file(kind, tmp_path, capfd):
    file, save = SAVERS[kind]
    whole = save(synthetic(), tmp_path / file).read_bytes()
    rng = np.random.default_rng(5)
    cases = {"missing": None, "empty": b"", "random": rng.bytes(3000), "begins well": whole[:100] + rng.bytes(3000)}
    if kind not in {"csv", "text"}:  # half a text file is a shorter text file, unless a row is cut
        cases |= {f"cut at {k}": whole[:k] for k in range(1, len(whole), len(whole) // 15)}
    for case, content in cases.items():
        (tmp_path / file).unlink(missing_ok=True)
        if content is not None:
            (tmp_path / file).write_bytes(content)
        with pytest.raises(RecordError) as error:
            read_table(tmp_path / file, kind.partition("_")[0])
        assert file in str(error.value), case
        assert "\n" not in str(error.value), case
    assert capfd.readouterr().err == ""


def test_parquet_without_pyarrow_names_the_extra(tmp_path, monkeypatch):
    import sys

    (tmp_path / "p.parquet").write_bytes(b"PAR1")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(RecordError, match=r"p\.parquet.*pip install '.*\[parquet\]'"):
        read_table(tmp_path / "p.parquet", "parquet")
    with pytest.raises(RecordError, match=r"pip install '.*\[parquet\]'"):
        synthetic().save_parquet(tmp_path / "q.parquet")


def test_parquet_with_timestamps_and_whole_numbers(tmp_path):
    pa = pytest.importorskip("pyarrow", reason="pyarrow is missing: pip install flight-testbench[parquet]")
    parquet = pytest.importorskip("pyarrow.parquet")
    stamps = pa.array(np.arange(5) * 20_000, pa.timestamp("us"))
    content = pa.table({"time": stamps, "de": pa.array([1, 2, None, 4, 5]), "note": ["a", "b", "c", None, "e"]})
    parquet.write_table(content, tmp_path / "p.parquet")
    channels = ['name = "de"\ncolumn = "de"\nunit = "deg"\nmissing = "mask"', 'name = "q"\ncolumn = 2\nunit = "deg/s"']
    with pytest.raises(
        RecordError,
        match=r"unit of time must be the one that .* states for column 'time', 'us since 1970-01-01 .*', got 's'",
    ):
        read(tmp_path, "p.parquet", time='column = "time"', channels=channels)
    channels[1] += '\nmissing = "mask"'
    [(_, _, record)] = read(tmp_path, "p.parquet", time='column = "time"\nunit = "us"', channels=channels)
    assert record.dt_s == pytest.approx(0.02, rel=1e-12)  # rounding only
    assert np.allclose(record["de"], np.radians([1, 2, 2, 4, 5]), rtol=1e-15)
    assert record.valid[:, 0].tolist() == [True, True, False, True, True]


CHANNELS = ['name = "de"\ncolumn = 2\nunit = "deg"', 'name = "q"\ncolumn = 3\nunit = "deg/s"']


def write_rows(tmp_path, rows, header="t,de,q"):
    lines = [header, *(",".join(str(cell) for cell in row) for row in rows)]
    (tmp_path / "r.csv").write_text("\n".join(lines) + "\n")


def rows(n=10, dt=0.1):
    return [[f"{k * dt:.3f}", k, -2.0 * k] for k in range(n)]


def test_units_scales_offsets_and_differences(tmp_path):
    write_rows(tmp_path, rows())
    channels = [
        'name = "de"\ncolumn = "de"\nunit = "deg"\nscale = -1.0',
        'name = "da"\ncolumn = 2\nminus_column = 3\nscale = 0.5\noffset = 1.0\nunit = "deg"',
        'name = "h"\ncolumn = 2\nunit = "ft"',
        'name = "az"\ncolumn = 3\nunit = "g"',
    ]
    [(_, _, record)] = read(tmp_path, "r.csv", channels=channels)
    k = np.arange(10.0)
    # 1e-15: one rounding each of the factor and of the product
    assert np.allclose(record["de"], -np.radians(k), rtol=1e-15)
    assert np.allclose(record["da"], np.radians(0.5 * (k + 2.0 * k) + 1.0), rtol=1e-15)
    assert np.allclose(record["h"], 0.3048 * k, rtol=1e-15)
    assert np.allclose(record["az"], -2.0 * k * 9.80665, rtol=1e-15)


@pytest.mark.parametrize(
    ("cell", "shown"), [("nan", "nan"), ("", ""), ("NaN", "NaN"), ("inf", "inf"), ("abc", "abc"), ("1.2.3", r"1\.2\.3")]
)
def test_a_sample_that_is_no_number_names_file_column_line_and_time(cell, shown, tmp_path):
    content = rows()
    content[4][2] = cell
    write_rows(tmp_path, content)
    message = rf"finite numbers, got '{shown}' in column 3 \(channel 'q'\) of '.*r\.csv', line 6, t = 0\.4 s"
    with pytest.raises(RecordError, match=message):
        read(tmp_path, "r.csv", channels=CHANNELS)
    before = "segments = [[0, 0.3]]"
    assert len(read(tmp_path, "r.csv", channels=CHANNELS, record=before)[0][2]) == 4
    masked = [CHANNELS[0], CHANNELS[1] + '\nmissing = "mask"']
    if cell in {"abc", "1.2.3"}:  # a mask is for samples that were not taken, not for rubbish
        with pytest.raises(RecordError, match=message):
            read(tmp_path, "r.csv", channels=masked)
        return
    [(_, _, record)] = read(tmp_path, "r.csv", channels=masked)
    assert np.flatnonzero(~record.valid[:, 1]).tolist() == [4]
    assert record["q"][4] == record["q"][3] == pytest.approx(np.radians(-6.0), rel=1e-15)


def test_a_mask_at_the_beginning_takes_the_first_sample_and_a_channel_without_any_is_refused(tmp_path):
    content = rows()
    for k in (0, 1):
        content[k][2] = ""
    write_rows(tmp_path, content)
    masked = [CHANNELS[0], CHANNELS[1] + '\nmissing = "mask"']
    [(_, _, record)] = read(tmp_path, "r.csv", channels=masked)
    assert record["q"][0] == record["q"][1] == record["q"][2]
    assert record.valid[:3, 1].tolist() == [False, False, True]
    with pytest.raises(RecordError, match="channel 'q' must hold samples"):
        read(tmp_path, "r.csv", channels=masked, record="segments = [[0, 0.1]]")


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0, 1, 2, 3, 7, 8, 9], r"gap from t = 3 to 7 s in '.*r\.csv', line 6.*segments = \[\[0, 3\], \[7, 9\]\]"),
        ([0, 1, 2, 3, 2, 3, 4], r"jumps back from t = 3 to 2 s in '.*r\.csv', line 6.*cut it into segments"),
        ([0, 1, 2, 2, 3, 4, 5], r"stands still from t = 2 to 2 s.*give rate_hz"),
        ([0, 1, 2, "x", 4, 5, 6], r"times must be finite numbers, got 'x' in column 't' of '.*r\.csv', line 5"),
        ([0, 1, 2, "", 4, 5, 6], "times must be finite numbers, got ''"),
    ],
)
def test_time_that_does_not_run_on_says_where(times, message, tmp_path):
    write_rows(tmp_path, [[t, k, k] for k, t in enumerate(times)])
    with pytest.raises(RecordError, match=message):
        read(tmp_path, "r.csv", channels=CHANNELS)


def test_segments_are_records_of_their_own_with_both_ends(tmp_path):
    write_rows(tmp_path, [[t, k, k] for k, t in enumerate([0, 1, 2, 3, 7, 8, 9])])
    found = read(tmp_path, "r.csv", channels=CHANNELS, record="segments = [[0, 3], [7, 9]]")
    assert [(name, record.t_s.tolist()) for name, _, record in found] == [("r_1", [0, 1, 2, 3]), ("r_2", [7, 8, 9])]
    assert found[1][2].provenance["segment_s"] == [7.0, 9.0]
    with pytest.raises(RecordError, match=r"gap from t = 3 to 7 s"):
        read(tmp_path, "r.csv", channels=CHANNELS, record="segments = [[1, 8]]")
    with pytest.raises(RecordError, match=r"at least 2 samples, got 0 in \[4, 6\] s; .* runs from 0 to 9 s"):
        read(tmp_path, "r.csv", channels=CHANNELS, record="segments = [[4, 6]]")


def test_a_rate_in_place_of_times_and_a_clock_that_does_not_begin_at_zero(tmp_path):
    write_rows(tmp_path, [[50_000 + 20 * k, k, k] for k in range(10)])
    [(_, _, record)] = read(tmp_path, "r.csv", channels=CHANNELS, time="rate_hz = 25.0\nzero_s = 1.0")
    assert np.array_equal(record.t_s, np.arange(10) / 25.0 - 1.0)
    clock = 'column = 1\nunit = "ms"\nzero_s = 50.0'
    [(_, _, record)] = read(tmp_path, "r.csv", channels=CHANNELS, time=clock, record="segments = [[0.1, 0.18]]")
    assert np.allclose(record.t_s, [0.1, 0.12, 0.14, 0.16, 0.18], atol=1e-12)  # rounding of 50 s


def test_a_row_without_any_sample_still_takes_its_time(tmp_path):
    (tmp_path / "r.csv").write_text("t,de,q\n0,1,1\n,,\n2,3,3\n,,\n")
    masked = [channel + '\nmissing = "mask"' for channel in CHANNELS]
    [(_, _, record)] = read(tmp_path, "r.csv", channels=masked, time="rate_hz = 10.0")
    assert np.array_equal(record.t_s, [0.0, 0.1, 0.2])
    assert record.valid[:, 0].tolist() == [True, False, True]
    with pytest.raises(RecordError, match="line 3"):
        read(tmp_path, "r.csv", channels=CHANNELS, time="rate_hz = 10.0")


def test_a_unit_that_the_file_contradicts_is_refused(tmp_path):
    write_rows(tmp_path, rows(), header="t [ms],de [DEG],q [rad/sec]")
    with pytest.raises(RecordError, match=r"unit of time must be the one .* 'ms', got 's'"):
        read(tmp_path, "r.csv", channels=CHANNELS)
    with pytest.raises(RecordError, match=r"unit of channel 'q' must be the one .* 'rad/sec', got 'deg/s'"):
        read(tmp_path, "r.csv", channels=CHANNELS, time='column = "t"\nunit = "ms"')


def test_errors_name_the_description_and_its_record(tmp_path):
    with pytest.raises(RecordError, match=r"data folder '.*' must hold r\.csv, but it does not"):
        read(tmp_path, "r.csv")
    write_rows(tmp_path, rows())
    with pytest.raises(RecordError, match=r"d\.toml, record\[0\]\)$"):
        read(tmp_path, "r.csv")  # the file has no column h
