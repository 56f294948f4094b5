"""The whole chain: a log or a table in, manoeuvres cut, records and a description out, a model identified from them."""

import io
import json

import numpy as np
import pytest
from recorded import flight_data
from rich.console import Console
from writers import G0, M_ALPHA, M_Q, THROW, Z_ALPHA, dataflash_bin, elevator, short_period, ulog

from testbench.core.constants import DEG_RAD, FT_M, G0_M_S2
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord, load_record
from testbench.logs.manoeuvres import Cutting
from testbench.logs.sidpac import Told
from testbench.questions.identify.ask import identify
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.importing.ask import import_log, parse_cuts, parse_throws, write_import
from testbench.questions.importing.page import import_answer, print_import

T = np.arange(0.0, 35.0, 0.02)


@pytest.mark.usefixtures("plain_and_mended")
def test_a_model_is_identified_from_the_manoeuvres_of_each_kind_of_log(tmp_path):
    """Rounding, filter and the interpolation of held commands (2 of 10 ms): 3 % of frequency, 5 % of damping."""
    wn = np.sqrt(Z_ALPHA * M_Q - M_ALPHA)
    zeta = -(Z_ALPHA + M_Q) / (2.0 * wn)
    for name, content in (
        ("flight.ulg", ulog(motion=short_period)),
        ("flight.bin", dataflash_bin(motion=short_period)),
    ):
        log = tmp_path / name
        log.write_bytes(content)
        folder = tmp_path / f"records_{name}"
        paths = write_import(import_log(log, throw_rad={"de": THROW}), folder)
        assert [p.name for p in paths] == ["whole.nc", "01_de.nc", "02_de.nc", "flight_longitudinal.toml"]
        model = identify(RecordDescription.load(paths[-1])).cases[0].model
        poles = np.concatenate(list(model.poles().values()))
        pair = poles[np.argmin(np.abs(poles - wn * (-zeta + 1j * np.sqrt(1.0 - zeta**2))))]
        assert abs(pair) == pytest.approx(wn, rel=0.03), name
        assert -pair.real / abs(pair) == pytest.approx(zeta, rel=0.05), name


def sidpac(path, noise=0.0):
    """A SIDPAC file: degrees, feet and g in fixed columns, columns not recorded zero; noise of q in SI."""
    from scipy.io import savemat

    q, theta, az = short_period(T)
    rng = np.random.default_rng(1)
    q, az = q + noise * rng.standard_normal(T.size), az + 10.0 * noise * rng.standard_normal(T.size)
    fdata = np.zeros((T.size, 90))
    fdata[:, 0], fdata[:, 1] = T, 59.0
    fdata[:, 5], fdata[:, 8], fdata[:, 12] = q / DEG_RAD, theta / DEG_RAD, az / G0_M_S2
    fdata[:, 13], fdata[:, 14] = -THROW * elevator(T) / DEG_RAD, 0.01 * np.sin(T)
    savemat(path, {"fdata": fdata})
    return path


def test_sidpac_s_columns_are_read_in_their_units_and_identified_from(tmp_path):
    found = import_log(sidpac(tmp_path / "flight.mat"))
    q, theta, az = short_period(T)
    for name, expected in (("q", q), ("theta", theta), ("az", az), ("V", np.full(T.size, 59.0 * FT_M)),
                           ("da", -0.01 * np.sin(T) * DEG_RAD)):  # fmt: skip
        np.testing.assert_allclose(found.record[name], expected, rtol=1e-12, atol=1e-12)
    assert "alpha" not in found.record.channels  # never recorded: zero throughout
    assert found.rate_hz == 50.0
    noisy = import_log(sidpac(tmp_path / "noisy.mat", noise=0.002))
    model = identify(RecordDescription.load(write_import(noisy, tmp_path / "out")[-1])).cases[0].model
    poles = np.concatenate(list(model.poles().values()))
    assert np.min(np.abs(np.abs(poles) - np.sqrt(Z_ALPHA * M_Q - M_ALPHA))) < 0.05


def table(path, names="time [s],Q [deg/s],theta [deg],elevator [deg],AZ [g]", lines=None):
    q, theta, az = short_period(T)
    columns = [T, q / DEG_RAD, theta / DEG_RAD, -THROW * elevator(T) / DEG_RAD, az / G0]
    rows = [",".join(f"{x:.9g}" for x in row) for row in np.column_stack(columns)]
    path.write_text("\n".join([names, *(lines or (lambda r: r))(rows)]) + "\n")
    return path


def test_a_table_is_read_by_the_names_and_units_of_its_columns(tmp_path):
    found = import_log(table(tmp_path / "flight.csv"))
    q, theta, az = short_period(T)
    for name, expected in (("q", q), ("theta", theta), ("de", -THROW * elevator(T)), ("az", az)):
        np.testing.assert_allclose(found.record[name], expected, rtol=1e-7, atol=1e-8)
    assert [m.controls for m in found.search.manoeuvres] == [("de",), ("de",)]
    assert len(import_answer(found)) == 4  # with a surface that jumps


def test_cuts_that_somebody_chose_are_cut_and_said_again_by_the_log_s_file(tmp_path):
    log = table(tmp_path / "flight.csv")
    first = import_log(log).search.manoeuvres[0]
    low, high = round(first.start_s - 1.0, 2), round(first.end_s + 2.0, 2)
    found = import_log(log, cutting=Cutting(at=parse_cuts([f"{low}:{high}"])))
    write_import(found, tmp_path / "flown")
    whole, part = (load_record(tmp_path / "flown" / f"{name}.nc") for name in ("whole", "01_de"))
    np.testing.assert_array_equal(part["q"], whole.between(low, high + 0.01)["q"])
    said = json.loads((tmp_path / "flown" / "log.json").read_text("utf-8"))
    assert [m["cut_s"] for m in said["manoeuvres"]] == [[low, high]]
    assert said["stretches"][-1]["end_s"] == pytest.approx(whole.t_s[-1], abs=0.1)
    with pytest.raises(RecordError, match=r"a cut must be START:END in s of the record, as 12.5:20, got '12-20'"):
        parse_cuts(["12-20"])


def test_a_question_has_its_answers_as_options_and_each_is_taken(tmp_path):
    q, theta, _ = short_period(T)
    rows = np.column_stack([T, 3.0 * q / DEG_RAD, theta / DEG_RAD, elevator(T)])
    log = tmp_path / "flight.csv"
    np.savetxt(log, rows, delimiter=",", header="t,q,theta,elevator", comments="")
    asked = json.loads(import_log(log).to_json())["questions"]
    answers = [tuple(words) for question in asked for words in question["answers"]]
    assert answers == [("--axes", "flu"), ("--throw", "de=25"), ("--unit", "de=deg")]
    answered = import_log(log, told=Told("flu"), throw_rad=parse_throws(["de=25"]))
    assert answered.record["de"].max() == pytest.approx(25.0 * DEG_RAD * import_log(log).record["de"].max(), rel=1e-6)
    assert not [text for text in answered.asked if "--throw de=25" in text or "--axes" in text]


def test_an_import_says_how_to_name_unknown_columns_and_what_a_model_of_the_aircraft_answers(tmp_path):
    log = table(tmp_path / "flight.csv", "time [s],Q [deg/s],theta [deg],elevator [deg],Nz [g]")
    found = import_log(log)
    out = io.StringIO()
    print_import(found, Console(file=out, width=400), write_import(found, tmp_path / "flown"))
    assert "testbench import flight.csv --describe FILE.toml lets you name their channels" in out.getvalue()
    assert f"testbench gap new case.toml --aircraft MODEL {tmp_path / 'flown'}" in out.getvalue()
    known = io.StringIO()
    print_import(import_log(table(tmp_path / "known.csv")), Console(file=known, width=400))
    assert "--describe" not in known.getvalue()
    assert "gap new" not in known.getvalue()


def test_damaged_lines_of_a_table_are_left_out_and_said(tmp_path):
    def damage(rows):
        return [*rows[:100], "1.2,3", *rows[103:1000], "4,5,6,7,8,9,10,11", *rows[1000:1500], rows[1500][:9]]

    found = import_log(table(tmp_path / "flight.csv", lines=damage))
    assert any("3 lines are damaged and were left out" in text for text in found.log.warnings)
    assert found.record.duration_s == pytest.approx(29.98)
    taken = found.record.valid[:, found.record.channels.index("q")]
    assert 0 < np.count_nonzero(~taken) < 10


@pytest.mark.parametrize("at", [0, 2])
def test_a_first_row_with_an_open_quote_is_counted_as_damaged_and_is_no_heading(tmp_path, at):
    def damage(rows):
        return [rows[0][:at] + '"' + rows[0][at:], *rows[1:]]

    found = import_log(table(tmp_path / "flight.csv", lines=damage))
    (said,) = found.log.warnings
    assert said.startswith("1 line is damaged and was left out")
    assert "in line 2 of" in said
    assert "a quote is not closed" in said


@pytest.mark.parametrize(
    ("name", "content", "law"),
    [
        ("a.csv", b"", "is empty"),
        ("a.csv", b"time,foo\n0,1\n1,2\n", "must carry names of channels"),
        ("a.csv", b"clock,q\n0,1\n1,2\n", "must be called t or time"),
        ("a.csv", b"time [fortnights],q\n0,1\n1,2\n", "the unit of time"),
        ("a.csv", b"time,q [furlongs]\n0,1\n1,2\n", "the unit of column 'q'"),
        ("a.csv", b"\x00\x01\x02", "a.csv"),
        ("a.mat", b"MATLAB 5.0 MAT-file", "a.mat"),
        ("a.txt", b"only words\n", "a.txt"),
        ("a.xyz", b"12345", "begins as none of them"),
    ],
)
def test_what_is_no_log_is_said_in_one_line(tmp_path, name, content, law):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(RecordError, match=law) as error:
        import_log(path)
    assert "\n" not in str(error.value)


def test_a_simulated_truth_is_no_log(tmp_path):
    record = FlightRecord(T, ("q", "de"), np.column_stack([T, T]), "truth")
    for path in (record.save(tmp_path / "a.nc"), record.save_mat(tmp_path / "a.mat")):
        with pytest.raises(RecordError, match="simulated truth"):
            import_log(path)


def test_every_format_that_records_are_exported_to_comes_back(tmp_path):
    pytest.importorskip("pyarrow")
    q, _, az = short_period(T)
    record = FlightRecord(T, ("q", "az", "de"), np.column_stack([q, az, -THROW * elevator(T)]), "measured")
    for path in (record.save(tmp_path / "a.nc"), record.save_csv(tmp_path / "a.csv"),
                 record.save_mat(tmp_path / "a.mat"), record.save_parquet(tmp_path / "a.parquet")):  # fmt: skip
        back = import_log(path).record
        for name in record.channels:
            np.testing.assert_allclose(back[name], record[name], rtol=0.0, atol=1e-12)


def test_real_records_of_two_institutes_are_read_by_their_own_names():
    folder = flight_data()
    otter = import_log(folder / "twin_otter" / "totter_lon_020213f1_018.mat")
    assert [m.controls for m in otter.search.manoeuvres] == [("de",)]
    assert -12.5 < otter.record["az"].min() < otter.record["az"].max() < -7.0
    hfb = import_log(folder / "hfb320" / "hfb320_1_10_withHeader.asc")
    assert {"de", "alpha", "q", "theta", "V", "az"} <= set(hfb.record.channels)
    assert hfb.record["V"].mean() == pytest.approx(109.2, abs=0.1)  # m/s, as the source says
    assert hfb.record["az"].mean() == pytest.approx(-9.9, abs=0.1)


def test_throws_are_read():
    assert parse_throws(["de=20", "da=15"]) == {
        "de": pytest.approx(20.0 * DEG_RAD),
        "da": pytest.approx(15.0 * DEG_RAD),
    }
    for bad in ("de", "de=x", "thr=5", "de=0", "de=91", "=3"):
        with pytest.raises(RecordError, match="a throw must be"):
            parse_throws([bad])
