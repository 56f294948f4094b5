"""FlightRecord: its rules, its parts, and what comes back from disk."""

import copy
import json
import pickle

import numpy as np
import pytest

from testbench.core.channels import modal_channels
from testbench.core.errors import ChannelError, RecordError, WriteError
from testbench.core.record import FORMAT, FlightRecord, load_record


def make(n: int = 50, channels: tuple[str, ...] = ("de", "alpha", "q"), **changes: object) -> FlightRecord:
    rng = np.random.default_rng(7)
    content = {
        "t_s": 3.0 + 0.04 * np.arange(n),
        "channels": channels,
        "data": rng.normal(size=(n, len(channels))),
        "kind": "measured",
        "valid": rng.random((n, len(channels))) < 0.8,
        "provenance": {"seed": 7, "aircraft": "eolo", "versions": {"numpy": "2"}, "scale": 0.1, "list": [1, 2.5, None]},
    }
    return FlightRecord(**{**content, **changes})


def assert_same(a: FlightRecord, b: FlightRecord) -> None:
    assert a.channels == b.channels
    for name in ("t_s", "data", "valid"):
        x, y = getattr(a, name), getattr(b, name)
        assert x.shape == y.shape
        assert x.dtype == y.dtype
        assert np.array_equal(x, y), name
        assert not y.flags.writeable
    assert (a.kind, a.outcome, a.reason) == (b.kind, b.outcome, b.reason)
    assert dict(a.provenance) == dict(b.provenance)


EXTREME = np.array([[5e-324], [-0.0], [np.pi], [1.7976931348623157e308], [1.0 / 3.0]])


@pytest.mark.parametrize(
    "record",
    [
        make(),
        make(valid=None),
        make(kind="truth", outcome="aborted", reason="alpha > 0.3 rad\nat t = 4 s, limit of «ATTAS»"),
        make(n=1),
        make(n=0),
        make(channels=()),
        make(n=0, channels=()),
        make(n=3, channels=("V", *modal_channels(40))),
        make(n=5, channels=("h",), data=EXTREME, valid=None),
        make(provenance={}),
        make(provenance={"long": "x" * 100_000, "nested": {"ü": ["å", {"deep": True}]}}),
    ],
    ids=["plain", "all_valid", "aborted", "one", "empty", "no_channels", "nothing", "many", "extreme", "bare", "long"],
)
def test_netcdf_gives_back_every_bit(record, tmp_path):
    path = record.save(tmp_path / "new" / "folder" / "record.nc")
    assert_same(record, load_record(path))
    assert [p.name for p in path.parent.iterdir()] == ["record.nc"]  # no half-written file is left


SAVES = pytest.mark.parametrize("save", ["save", "save_csv", "save_mat", "save_parquet"])


def needs(save):
    """Skip a test of Parquet where the extra is absent."""
    if save == "save_parquet":
        pytest.importorskip("pyarrow", reason="pyarrow is missing: pip install flight-testbench[parquet]")


@SAVES
def test_a_file_is_the_same_bytes_every_time(save, tmp_path):
    needs(save)
    first = getattr(make(), save)(tmp_path / "a").read_bytes()
    assert first == getattr(make(), save)(tmp_path / "b").read_bytes()


def test_netcdf_is_readable_by_xarray_with_units(tmp_path):
    import xarray as xr

    record = make()
    with xr.open_dataset(record.save(tmp_path / "r.nc"), engine="h5netcdf") as stored:
        assert stored["q"].attrs["units"] == "rad/s"
        assert stored["t"].attrs["units"] == "s"
        assert np.array_equal(stored["q"].values, record["q"])
        assert stored.load().identical(record.to_xarray())


def test_a_second_save_replaces_the_first(tmp_path):
    make(n=500).save(tmp_path / "r.nc")
    record = make(n=5)
    assert_same(record, load_record(record.save(tmp_path / "r.nc")))


def test_a_file_cut_short_anywhere_is_one_line_that_names_it(tmp_path, capfd):
    whole = make().save(tmp_path / "r.nc").read_bytes()
    cut = tmp_path / "cut.nc"
    for length in [*range(0, len(whole) - 1, len(whole) // 40), len(whole) - 1]:
        cut.write_bytes(whole[:length])
        with pytest.raises(RecordError) as error:
            load_record(cut)
        assert "cut.nc" in str(error.value)
        assert "\n" not in str(error.value)
    assert capfd.readouterr().err == ""  # no traceback of a destructor either


def test_a_damaged_file_never_gives_another_exception(tmp_path):
    whole = make().save(tmp_path / "r.nc").read_bytes()
    rng = np.random.default_rng(3)
    messages = []
    for _ in range(60):
        bytes_ = bytearray(whole)
        for place in rng.integers(0, len(whole), 20):
            bytes_[place] = rng.integers(256)
        (tmp_path / "bad.nc").write_bytes(bytes_)
        try:
            load_record(tmp_path / "bad.nc")
        except RecordError as error:
            messages.append(str(error))
    assert len(messages) > 30
    assert all("bad.nc" in message and "\n" not in message for message in messages)


def test_load_refuses_what_is_no_record(tmp_path):
    with pytest.raises(RecordError, match=r"must lie at '.*none\.nc', got: No such file"):
        load_record(tmp_path / "none.nc")
    dataset = make().to_xarray()
    dataset.attrs["format"] = "other-2"
    dataset.to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    with pytest.raises(RecordError, match=rf"format = '{FORMAT}', got 'other-2'"):
        load_record(tmp_path / "other.nc")
    dataset = make().to_xarray().drop_vars("q")
    dataset.to_netcdf(tmp_path / "lacks.nc", engine="h5netcdf")
    with pytest.raises(RecordError, match=r"lacks\.nc.*'q'"):
        load_record(tmp_path / "lacks.nc")
    dataset = make().to_xarray().copy(deep=True)
    dataset["q"][4] = np.nan
    dataset.to_netcdf(tmp_path / "nan.nc", engine="h5netcdf")
    with pytest.raises(RecordError, match=r"finite, got nan in channel 'q'.*nan\.nc"):
        load_record(tmp_path / "nan.nc")


def test_csv_is_lossless_in_samples_and_marks_the_missing(tmp_path):
    record = make()
    path = record.save_csv(tmp_path / "a" / "r.csv")
    assert path.read_text().splitlines()[0] == "t [s],de [rad],alpha [rad],q [rad/s]"
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    assert np.array_equal(table[:, 0], record.t_s)
    assert np.array_equal(np.isfinite(table[:, 1:]), record.valid)
    assert np.array_equal(table[:, 1:][record.valid], record.data[record.valid])


def test_mat_holds_columns_units_and_provenance(tmp_path):
    import json

    from scipy.io import loadmat

    record = make()
    stored = loadmat(record.save_mat(tmp_path / "r.mat"), squeeze_me=True)
    assert np.array_equal(stored["t"], record.t_s)
    assert np.array_equal(stored["q"], np.where(record.valid[:, 2], record["q"], np.nan), equal_nan=True)
    assert stored["units"]["q"].item() == "rad/s"
    assert json.loads(json.loads(str(stored["testbench"]))["provenance"]) == dict(record.provenance)


def test_parquet_holds_columns_units_and_nulls(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is missing: pip install flight-testbench[parquet]")
    record = make()
    table = parquet.read_table(record.save_parquet(tmp_path / "r.parquet"))
    assert table.column_names == ["t", "de", "alpha", "q"]
    assert table.schema.field("q").metadata[b"unit"] == b"rad/s"
    assert table["q"].null_count == np.sum(~record.valid[:, 2]) > 0
    taken = table["q"].to_numpy()[record.valid[:, 2]]
    assert np.array_equal(taken, record["q"][record.valid[:, 2]])


@SAVES
def test_a_path_that_cannot_be_written_is_one_clear_error(save, tmp_path):
    needs(save)
    (tmp_path / "file").write_text("")
    with pytest.raises(WriteError, match="folder that can be written to"):
        getattr(make(), save)(tmp_path / "file" / "record")


def test_pickle_and_copies_keep_everything_and_stay_read_only():
    record = make(outcome="aborted", reason="stall")
    for other in (pickle.loads(pickle.dumps(record)), copy.copy(record), copy.deepcopy(record)):
        assert_same(record, other)
        with pytest.raises(TypeError):
            other.provenance["seed"] = 1


def test_a_record_is_apart_from_the_arrays_it_was_made_of():
    t, data, provenance = np.arange(3.0), np.zeros((3, 1)), {"a": [1]}
    record = FlightRecord(t, ("q",), data, "measured", provenance=provenance)
    data[0], t[0] = 9.0, -9.0
    provenance["a"].append(2)
    assert record["q"][0] == 0.0
    assert record.t_s[0] == 0.0
    assert record.provenance["a"] == [1]
    with pytest.raises(ValueError, match="read-only"):
        record["q"][0] = 1.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"data": np.zeros((49, 3))}, r"shape \(samples, channels\) = \(50, 3\), got \(49, 3\)"),
        ({"data": np.zeros(50)}, "shape"),
        ({"valid": np.ones((50, 2), bool)}, r"\(50, 2\)"),
        ({"t_s": np.zeros((50, 1))}, "shape"),
        ({"t_s": np.zeros(50)}, r"increase strictly, got t = 0 s at sample 1"),
        ({"t_s": np.r_[np.arange(49.0), np.nan]}, "got t = nan s at sample 49"),
        ({"t_s": np.r_[np.arange(49.0), np.inf]}, "got t = inf s at sample 49"),
        (
            {"data": np.where(np.arange(150).reshape(50, 3) == 10, np.nan, 0.0)},
            r"got nan in channel 'alpha' at t = 3\.12",
        ),
        ({"data": np.full((50, 3), np.inf)}, "finite, got inf"),
        ({"data": np.full((50, 3), 1j)}, "data must be real numbers"),
        ({"data": [["a"] * 3] * 50}, "data must be an array of numbers"),
        ({"channels": ("de", "q", "q")}, "names must differ"),
        ({"kind": "guessed"}, "kind must be truth or measured, got 'guessed'"),
        ({"outcome": "crashed"}, "outcome must be completed or aborted, got 'crashed'"),
        ({"outcome": "aborted"}, "must give its reason"),
        ({"provenance": {"x": object()}}, "JSON"),
        ({"provenance": {"x": float("nan")}}, "JSON"),
    ],
)
def test_every_rule_that_is_broken_says_so(changes, message):
    with pytest.raises(RecordError, match=message):
        make(**changes)


def test_an_unknown_channel_names_the_nearest():
    with pytest.raises(ChannelError, match="did you mean 'alpha'"):
        make(channels=("de", "alpa", "q"))
    with pytest.raises(ChannelError, match="holds only de, alpha, q"):
        make()["beta"]


def test_readings_and_selections():
    record = make()
    assert len(record) == 50
    assert "q" in record
    assert "beta" not in record
    assert record.dt_s == pytest.approx(0.04, rel=1e-12)  # rounding of 49 additions
    assert record.duration_s == pytest.approx(49 * 0.04, rel=1e-12)
    assert np.array_equal(record.columns(["q", "de"]), record.data[:, [2, 0]])
    chosen = record.select(["q", "de"])
    assert chosen.channels == ("q", "de")
    assert np.array_equal(chosen.valid, record.valid[:, [2, 0]])
    assert make(n=0).duration_s == 0.0


def test_sample_time_refuses_gaps_and_single_samples():
    with pytest.raises(RecordError, match="at least 2 samples, got 1"):
        _ = make(n=1).dt_s
    t = np.r_[np.arange(25), np.arange(26, 51)] * 0.04
    with pytest.raises(RecordError, match=r"of 0\.08 s at t = 0\.96 s"):
        _ = make(t_s=t).dt_s


def test_between_is_half_open_and_its_parts_join_to_the_whole():
    record = make()
    first, second = record.between(3.0, 4.0), record.between(4.0, 9.0)
    assert first.t_s[-1] < 4.0 <= second.t_s[0] + 1e-9
    assert np.array_equal(np.vstack([first.data, second.data]), record.data)
    assert np.array_equal(np.vstack([first.valid, second.valid]), record.valid)
    with pytest.raises(RecordError, match=r"none in 9 <= t < 10 s of 3 to 4\.96 s"):
        record.between(9.0, 10.0)
    with pytest.raises(RecordError, match="an empty record"):
        make(n=0).between(0.0, 1.0)


def test_split_and_decimate():
    record = make()
    first, second = record.split(0.7)
    assert (len(first), len(second)) == (35, 15)
    assert np.array_equal(np.r_[first.t_s, second.t_s], record.t_s)
    for fraction in (0.0, 1.0, -1.0, float("nan")):
        with pytest.raises(RecordError, match="0 < fraction < 1"):
            record.split(fraction)
    with pytest.raises(RecordError, match="first part"):
        make(n=2).split(0.1)
    every_third = record.decimate(3)
    assert np.array_equal(every_third.t_s, record.t_s[::3])
    assert np.array_equal(every_third.valid, record.valid[::3])
    assert_same(record, record.decimate(1))
    for stride in (0, -1, 1.5):
        with pytest.raises(RecordError, match="whole number of at least 1"):
            record.decimate(stride)


def test_with_columns_replaces_and_adds():
    record = make()
    new = record.with_columns({"q": np.zeros(50), "V": np.full(50, 30.0)})
    assert new.channels == ("de", "alpha", "q", "V")
    assert np.array_equal(new["q"], np.zeros(50))
    assert np.array_equal(new.valid[:, :3], record.valid)
    assert new.valid[:, 3].all()
    assert_same(make(channels=()), make(channels=()).with_columns({}))
    with pytest.raises(RecordError, match=r"'V' must have shape \(50,\), got \(49,\)"):
        record.with_columns({"V": np.zeros(49)})
    with pytest.raises(ChannelError, match="alpha"):
        record.with_columns({"alpa": np.zeros(50)})


def test_mcap_holds_every_sample_that_was_taken_with_its_time_and_unit(tmp_path):
    reader = pytest.importorskip("mcap.reader")
    t = 2.5 + 0.1 * np.arange(20)
    data = np.random.default_rng(1).standard_normal((20, 2))
    valid = np.ones((20, 2), bool)
    valid[5:9, 1] = False
    record = FlightRecord(t, ("q", "V"), data, "measured", valid, provenance={"log": "a"})
    with record.save_mcap(tmp_path / "flight.mcap").open("rb") as file:
        found = reader.make_reader(file)
        read = {"/q": [], "/V": []}
        for schema, topic, message in found.iter_messages():
            assert json.loads(schema.data)["properties"]["value"]["unit"] == {"q": "rad/s", "V": "m/s"}[schema.name]
            read[topic.topic].append((message.log_time, json.loads(message.data)["value"]))
        (told,) = found.iter_metadata()
    for i, name in enumerate(("/q", "/V")):
        taken = valid[:, i]
        assert [v for _, v in read[name]] == data[taken, i].tolist()
        np.testing.assert_allclose([ns * 1e-9 for ns, _ in read[name]], t[taken], atol=1e-9)
    assert "measured" in told.metadata["record"]
