"""Times as writers of logs write them: dates, times of the day, whole numbers of a small unit; in every format."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from short_flight import DE, Q, T, case

from testbench.core.constants import DEG_RAD
from testbench.core.errors import RecordError
from testbench.logs.read import read_records
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.importing.ask import import_log
from testbench.questions.importing.template import write_template

START = datetime(2024, 5, 1, 23, 59, 53, tzinfo=UTC)  # midnight after 7 s


def is_the_flight(found, rate_hz=50.0):
    assert found.rate_hz == pytest.approx(rate_hz, rel=1e-6)
    assert found.record.duration_s == pytest.approx(T[-1], abs=1e-6)
    np.testing.assert_allclose(found.record["de"], DEG_RAD * DE, atol=1e-6)
    np.testing.assert_allclose(found.record["q"], DEG_RAD * Q, atol=1e-6)  # 6 digits are written
    assert [m.controls for m in found.search.manoeuvres] == [("de",)]


def iso(sep="T", zone="Z", digits=3):
    stamps = [(START + timedelta(seconds=float(t))) for t in T]
    return [s.strftime(f"%Y-%m-%d{sep}%H:%M:%S") + f".{s.microsecond:06d}"[: digits + 1] + zone for s in stamps]


def of_the_day(form="%H:%M:%S"):
    stamps = [(START + timedelta(seconds=float(t))) for t in T]
    return [s.strftime(form).replace("FRACTION", f"{s.microsecond // 10000:02d}") for s in stamps]


def csv(path, times, head="time,de [deg],q [deg/s]", delimiter=","):
    rows = [delimiter.join((str(t), f"{a:g}", f"{b:.8g}")) for t, a, b in zip(times, DE, Q, strict=True)]
    path.write_text("\n".join([head.replace(",", delimiter), *rows]) + "\n", encoding="utf-8")
    return path


WRITTEN = {
    "iso_zulu": iso(),
    "iso_blank": iso(" ", ""),
    "iso_offset": iso(" ", "+02:00", 6),
    "iso_comma": [s.replace(".", ",") for s in iso(" ", "")],
    "clock": of_the_day("%H:%M:%S.FRACTION"),
    "clock_half_days": of_the_day("%I:%M:%S.FRACTION %p"),
    "clock_comma": of_the_day("%H:%M:%S,FRACTION"),
    "german_date": of_the_day("%d.%m.%Y %H:%M:%S.FRACTION"),
    "american_date": of_the_day("%m/%d/%Y %I:%M:%S.FRACTION %p"),
    "minutes": of_the_day("%M:%S.FRACTION"),
    "japanese_date": of_the_day("%Y/%m/%d %H:%M:%S.FRACTION"),
}


@pytest.mark.parametrize("name", WRITTEN)
def test_dates_and_clock_times_over_midnight_are_read(name, tmp_path):
    delimiter = ";" if "comma" in name else ","
    is_the_flight(import_log(csv(tmp_path / "f.csv", WRITTEN[name], delimiter=delimiter)))


@pytest.mark.parametrize("name", ["iso_blank", "clock"])
def test_dates_in_text_between_blanks_are_read(name, tmp_path):
    path = csv(tmp_path / "f.txt", WRITTEN[name], "time,de[deg],q[deg/s]", " ")
    is_the_flight(import_log(path))


def test_a_column_of_dates_needs_no_name(tmp_path):
    """As pandas writes the index of a frame."""
    is_the_flight(import_log(csv(tmp_path / "f.csv", WRITTEN["iso_offset"], ",de [deg],q [deg/s]")))


def test_dates_and_times_in_columns_of_their_own(tmp_path):
    both = [s.replace(" ", ",") for s in WRITTEN["iso_blank"]]
    is_the_flight(import_log(csv(tmp_path / "f.csv", both, "Date,Time,de [deg],q [deg/s]")))


def test_dates_are_read_through_a_description_and_proposed_in_one(tmp_path):
    path = write_template(csv(tmp_path / "f.csv", WRITTEN["iso_zulu"]), tmp_path / "f.toml")
    text = path.read_text(encoding="utf-8")
    assert 'column = "time"  # dates, 2024-05-01T23:59:53.000Z is 0 s; runs from 0 to 15.98 in steps of 0.02' in text
    text = text.replace("# inputs", "inputs").replace("# outputs", "outputs").replace('["alpha", "q"]', '["q"]')
    path.write_text(text, encoding="utf-8")
    is_the_flight(import_log(path))
    [(_, _, record)] = read_records(RecordDescription.load(path))
    np.testing.assert_allclose(record.t_s, T, atol=1e-9)


def test_times_written_to_the_second_name_the_cause(tmp_path):
    path = csv(tmp_path / "f.csv", of_the_day())
    with pytest.raises(RecordError, match=r"repeats '23:59:53'.* for 5\d?\.?\d* rows a second; .* rate_hz"):
        import_log(path)


def test_a_time_that_is_missing_is_left_out_and_a_day_that_does_not_exist_too(tmp_path):
    times = list(WRITTEN["iso_zulu"])
    times[100], times[200] = "", times[200].replace("05-01", "05-41")
    found = import_log(csv(tmp_path / "f.csv", times))
    assert any("2 of 800 samples left out" in text for text in found.log.warnings)
    assert found.record.duration_s == pytest.approx(T[-1], abs=1e-6)


@pytest.mark.parametrize(
    ("name", "factor", "head", "assumed"),
    [
        ("TimeUS", 1e6, "", False), ("time_us", 1e6, "", False), ("t_ms", 1e3, "", False), ("timestamp", 1e6, "", True),
        ("timestamp_ns", 1e9, "", False), ("time", 1e3, "", True), ("time [ms]", 1e3, "", False),
        ("Timestamp (us)", 1e6, "", False), ("time/ms", 1e3, "", False), ("timestamp", 1e9, "", True),
    ],
)  # fmt: skip
def test_the_unit_of_whole_numbers_is_that_of_the_name_else_assumed_and_said(name, factor, head, assumed, tmp_path):
    times = np.rint(factor * (310.0 + T)).astype(np.int64)
    found = import_log(csv(tmp_path / "f.csv", times, f"{name},de [deg],q [deg/s]"))
    is_the_flight(found)
    said = [text for text in found.log.assumed if "states no unit" in text and "50 Hz" in text]
    assert bool(said) == assumed


def test_a_description_in_s_of_a_column_in_us_is_refused(tmp_path):
    path = write_template(csv(tmp_path / "f.csv", np.rint(1e6 * T).astype(int), "TimeUS,de [deg],q [deg/s]"),
                          tmp_path / "f.toml")  # fmt: skip
    text = path.read_text(encoding="utf-8").replace("# inputs", "inputs").replace('unit = "us"', 'unit = "s"')
    path.write_text(text.replace("# outputs", "outputs").replace('["alpha", "q"]', '["q"]'), encoding="utf-8")
    with pytest.raises(RecordError, match=r"unit of time must be .* 'TimeUS', got 's'.*record\[0\]"):
        import_log(path)


@pytest.mark.parametrize("unit", ["ns", "us", "ms"])
@pytest.mark.parametrize("zone", [None, "UTC", "Europe/Berlin"])
def test_parquet_with_dates_of_pandas(unit, zone, tmp_path):
    pytest.importorskip("pyarrow")
    import pandas as pd

    index = pd.date_range("2024-05-01 23:59:53", periods=T.size, freq="20ms", tz=zone).as_unit(unit)
    frame = pd.DataFrame({"de_deg": DE, "q_dps": Q}, index=index)
    frame.to_parquet(tmp_path / "index.parquet")
    frame.reset_index(names="when").to_parquet(tmp_path / "column.parquet")
    frame.assign(time=[s.time() for s in index]).to_parquet(tmp_path / "clock.parquet", index=False)
    for name in ("index", "column", "clock"):
        is_the_flight(import_log(tmp_path / f"{name}.parquet"))


@pytest.mark.parametrize(
    ("units", "factor"),
    [("seconds since 2024-05-01 12:00:00", 1.0), ("milliseconds since 2024-05-01", 1e3), ("s", 1.0),
     ("nanoseconds since 1970-01-01", 1e9), ("minutes since 2024-05-01 12:00:00", 1.0 / 60.0),
     ("hours since 1950-01-01T00:00:00Z", 1.0 / 3600.0)],
)  # fmt: skip
@pytest.mark.parametrize("engine", ["h5netcdf", "scipy"])
def test_netcdf_with_the_times_of_climate_and_forecast(units, factor, engine, tmp_path):
    import xarray as xr

    data = xr.Dataset(
        {"de": ("time", DE, {"units": "degrees"}), "q": ("time", Q, {"units": "deg s-1"})},
        {"time": ("time", factor * T, {"units": units})},
    )
    data.to_netcdf(tmp_path / "f.nc", engine=engine)
    is_the_flight(import_log(tmp_path / "f.nc"))


def test_netcdf_with_dates_as_xarray_writes_them(tmp_path):
    import pandas as pd
    import xarray as xr

    when = pd.date_range("2024-05-01 23:59:53", periods=T.size, freq="20ms")
    data = xr.Dataset({"de": ("when", DE, {"units": "deg"}), "q": ("when", Q, {"units": "deg/s"})}, {"when": when})
    data.to_netcdf(tmp_path / "f.nc", engine="h5netcdf")
    is_the_flight(import_log(tmp_path / "f.nc"))


@pytest.mark.parametrize("name", ["netcdf_datetime/dt.nc", "csv_timestamp_in_us/us.csv"])
def test_the_inputs_that_failed(name):
    found = import_log(case(name))
    assert found.rate_hz == 50.0
    assert found.record.duration_s == pytest.approx(15.98)
    assert found.record["de"].max() == pytest.approx(3.0 * DEG_RAD, rel=1e-4)


@pytest.mark.parametrize("first", [45413.0, 739373.0])
def test_day_numbers_of_spreadsheets_and_of_matlab_are_days_and_that_is_said(first, tmp_path):
    csv(tmp_path / "log.csv", [f"{first + t / 86400.0:.11f}" for t in T])
    found = import_log(tmp_path / "log.csv")
    assert found.rate_hz == pytest.approx(50.0, rel=1e-3)
    assert found.record.duration_s == pytest.approx(T[-1], abs=1e-3)
    assert "taken as days" in found.log.assumed[0]


def test_milliseconds_after_a_colon_are_a_fraction(tmp_path):
    stamps = [(START + timedelta(seconds=float(t))) for t in T]
    csv(tmp_path / "log.csv", [f"{s:%H:%M:%S}:{s.microsecond // 1000:03d}" for s in stamps])
    is_the_flight(import_log(tmp_path / "log.csv"))


def test_times_that_cannot_be_read_are_the_cause_that_is_named(tmp_path):
    csv(tmp_path / "log.csv", of_the_day("%Hh%Mm%S.FRACTION"))
    with pytest.raises(RecordError, match=r"times must be numbers, dates or times of the day, got '23h59m53.00'"):
        import_log(tmp_path / "log.csv")


@pytest.mark.parametrize("later_s", [0.0, 2.5])
def test_netcdf_variables_along_another_dimension_have_times_of_their_own(later_s, tmp_path):
    xr = pytest.importorskip("xarray")
    slow = T[::10]
    start = np.datetime64("2024-05-01T12:00:00", "ns")
    times, other = (start + (1e9 * x).round().astype("timedelta64[ns]") for x in (T, slow + later_s))
    de = ("time", DE, {"units": "deg"})
    V = ("air", 40.0 + np.sin(slow), {"units": "kt"})
    dataset = xr.Dataset({"de": de, "q": ("time", Q, {"units": "deg/s"}), "V": V}, {"time": times, "air": other})
    dataset.to_netcdf(tmp_path / "log.nc")
    found = import_log(tmp_path / "log.nc")
    V = next(c for c in found.channels if c.name == "V")
    assert found.record.channels == ("de", "q", "V")
    np.testing.assert_allclose(V.t_s - V.t_s[0], slow, atol=1e-6)
    assert V.t_s[0] - found.channels[0].t_s[0] == pytest.approx(later_s, abs=1e-6)
    np.testing.assert_allclose(V.values, (40.0 + np.sin(slow)) * 1852.0 / 3600.0)


def test_netcdf_variables_without_times_are_listed_with_the_reason(tmp_path):
    xr = pytest.importorskip("xarray")
    held = {"de": ("time", DE, {"units": "deg"}), "q": ("time", Q, {"units": "deg/s"}), "V": ("air", T[::10] + 20.0)}
    xr.Dataset(held, {"time": ("time", T, {"units": "s"})}).to_netcdf(tmp_path / "log.nc")
    (lost,) = import_log(tmp_path / "log.nc").balance.lost
    assert (lost.channel, lost.samples) == ("V", T[::10].size)
