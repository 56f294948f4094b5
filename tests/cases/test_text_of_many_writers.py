"""Tables as text from many writers: separators, decimal commas, encodings, headings; and what must not be guessed."""

import numpy as np
import pytest
from short_flight import DE, Q, T, case

from testbench.core.constants import DEG_RAD, FT_M, PSF_PA
from testbench.core.errors import RecordError, ScenarioError
from testbench.logs.read import read_records
from testbench.logs.tables import read_table
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.importing.ask import import_log
from testbench.questions.importing.page import import_answer
from testbench.questions.importing.template import write_template


def text(head, delimiter=",", decimal=".", end="\n", columns=(T, DE, Q)):
    rows = [delimiter.join(f"{x:.6f}".replace(".", decimal) for x in row) for row in zip(*columns, strict=True)]
    return end.join([head, *rows, ""])


def is_the_flight(path):
    found = import_log(path)
    assert found.rate_hz == 50.0
    np.testing.assert_allclose(found.record["de"], DEG_RAD * DE, atol=1e-7)
    np.testing.assert_allclose(found.record["q"], DEG_RAD * Q, atol=1e-7)  # 6 digits are written
    return found


HEAD = "time [s],de [deg],q [deg/s]"
WRITTEN = {
    "eu.csv": text(HEAD.replace(",", ";"), ";", ","),
    "eu_bom.csv": "\ufeff" + text(HEAD.replace(",", ";"), ";", ",", "\r\n"),
    "eu_points.csv": text(HEAD.replace(",", ";"), ";"),
    "excel_says_sep.csv": "sep=;\n" + text(HEAD.replace(",", ";"), ";", ","),
    "eu_ends_with_separator.csv": text("time [s];de [deg];q [deg/s];", ";", ",").replace("\n", ";\n", 1),
    "tabs.csv": text(HEAD.replace(",", "\t"), "\t"),
    "tabs.tsv": text(HEAD.replace(",", "\t"), "\t", ","),
    "tabs.txt": text("time [s]\tde [deg]\tpitch rate [deg/s]", "\t"),
    "bars.csv": text("time [s] | elevator [deg] | pitch rate [deg/s]", " | "),
    "quoted.csv": '"time [s]","de [deg]","q [deg/s]"\n'
    + "\n".join(",".join(f'"{x:.6f}"'.replace(".", ",") for x in row) for row in zip(T, DE, Q, strict=True)),
    "commas.txt": text(HEAD, ", "),
    "semicolons.txt": text(HEAD.replace(",", ";"), ";", ","),
    "blanks.csv": text("time[s] de[deg] q[deg/s]", "  "),
    "blanks_and_commas.txt": text("t de_deg q_dps", " ", ","),
    "units_apart.txt": text("     time [s]      de [deg]   q [deg/s]", " "),
    "names_apart.txt": text("Time [s]  Elevator position (deg)  Pitch rate (deg/s)", " "),
    "one_blank_between.txt": text("time [s] de [deg] pitch rate [deg/s]", " "),
    "quoted_names.txt": text('"time" "de_deg" "q_dps"', " "),
    "suffixes.csv": text("time_s,de_deg,q_deg_s"),
    "slashes.csv": text("t/s,de/deg,q/(deg/s)"),
    "unit_row.csv": text("time,de,q\ns,deg,deg/s"),
    "unit_row_in_brackets.csv": text("time,de,q\n[s],[deg],[deg/s]"),
    "title_and_unit_row.csv": text("Flight 12\nA. Pilot,D-EABC,\n\ntime,elevator,pitch rate\nsec,degrees,°/s"),
    "title_of_three_cells.csv": text("pilot,aircraft,weather\ntime [s],de [deg],q [deg/s]"),
    "comments.csv": "# made by a logger\n% rate 50\n" + text(HEAD),
    "header_is_a_comment.txt": text("# made by hand, 2024\n# time [s]   de [deg]   q [deg/s]", " "),
    "properties.csv": text("/fdm/jsbsim/simulation/sim-time-sec,/fdm/jsbsim/fcs/elevator-pos-deg,"
                           "/fdm/jsbsim/velocities/q-deg_sec"),
}  # fmt: skip
ENCODED = {
    "utf16.csv": text(HEAD).encode("utf-16"),
    "utf16_be.csv": b"\xfe\xff" + text(HEAD).encode("utf-16-be"),
    "utf16_without_mark.csv": text(HEAD).encode("utf-16-le"),
    "latin1.csv": text("Zeit [s];de [°];q [°/s]", ";", ",").encode("latin-1"),
    "old_mac.csv": text(HEAD, end="\r").encode(),
    "utf8.csv": text("time [s],de [°],q [°/s]").encode(),
}


@pytest.mark.parametrize("name", [*WRITTEN, *ENCODED])
def test_the_same_flight_from_many_writers(name, tmp_path):
    path = tmp_path / name
    path.write_bytes(WRITTEN[name].encode() if name in WRITTEN else ENCODED[name])
    is_the_flight(path)


def test_what_was_recognised_is_said(tmp_path):
    (tmp_path / "f.csv").write_bytes(text(HEAD.replace(",", ";"), ";", ",").encode("utf-16"))
    said = import_answer(is_the_flight(tmp_path / "f.csv"))[0][1]
    assert "UTF-16, cells separated by ';', decimal comma" in said
    (tmp_path / "g.csv").write_text(text(HEAD))
    assert import_answer(is_the_flight(tmp_path / "g.csv"))[0][1] == "the log g.csv is read as table (csv)"


@pytest.mark.parametrize("key", ["", 'delimiter = ";"', 'decimal = ","', 'delimiter = ";"\ndecimal = ","'])
def test_a_description_takes_the_keys_or_recognises_both(key, tmp_path):
    (tmp_path / "f.csv").write_text(text(HEAD.replace(",", ";"), ";", ","))
    path = write_template(tmp_path / "f.csv", tmp_path / "f.toml")
    proposed = path.read_text(encoding="utf-8")
    assert 'decimal = ","' in proposed
    filled = proposed.replace('decimal = ","', key).replace("# inputs", "inputs").replace("# outputs", "outputs")
    path.write_text(filled.replace('["alpha", "q"]', '["q"]'), encoding="utf-8")
    [(_, _, record)] = read_records(RecordDescription.load(path))
    np.testing.assert_allclose(record["q"], DEG_RAD * Q, atol=1e-7)


def test_wrong_keys_are_refused(tmp_path):
    (tmp_path / "f.csv").write_text(text(HEAD.replace(",", ";"), ";", ","))
    path = write_template(tmp_path / "f.csv", tmp_path / "f.toml")
    good = path.read_text(encoding="utf-8").replace("# inputs", "inputs").replace("# outputs", "outputs")
    good = good.replace('["alpha", "q"]', '["q"]')
    path.write_text(good.replace('decimal = ","', 'decimal = ";"'), encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"record\[0\]\.decimal"):
        RecordDescription.load(path)
    path.write_text(good.replace('decimal = ","', 'decimal = "."'), encoding="utf-8")
    with pytest.raises(RecordError, match=r"only with ';' between cells and decimal = ','; correct or leave"):
        read_records(RecordDescription.load(path))
    path.write_text(good.replace('decimal = ","', 'format = "mat"\ndecimal = ","'), encoding="utf-8")
    with pytest.raises(ScenarioError, match="the key decimal is for format csv or text"):
        RecordDescription.load(path)


@pytest.mark.parametrize(
    ("number", "delimiter", "decimal", "shown"),
    [("1.234,5", ";", ",", "1.234,5"), ("1.234", ";", ",", "1.234"), ('"1,234.5"', ",", ".", "1,234.5"),
     ("1'234.5", ",", ".", "1'234.5"), ("1\u202f234,5", ";", ",", "1\u202f234,5"), ('"12,345"', ",", ".", "12,345"),
     ("1 234.5", ",", ".", "1 234.5")],
)  # fmt: skip
def test_separators_of_thousands_are_refused_by_name(number, delimiter, decimal, shown, tmp_path):
    lines = text("time [s],h [ft],q [deg/s]".replace(",", delimiter), delimiter, decimal).splitlines()
    cells = lines[400].split(delimiter)
    lines[400] = delimiter.join([cells[0], number, cells[2]])
    (tmp_path / "f.csv").write_text("\n".join(lines))
    with pytest.raises(RecordError, match="without separators of thousands") as error:
        import_log(tmp_path / "f.csv")
    assert f"got '{shown}' in column 2 of" in str(error.value)


def test_a_heading_that_does_not_fit_is_named_as_the_cause(tmp_path):
    (tmp_path / "f.csv").write_text("time,de,q\n" + text("", ",", ",").lstrip())
    with pytest.raises(
        RecordError, match=r"has 3 names and 6 cells in each row: its numbers seem to have decimal commas"
    ):
        import_log(tmp_path / "f.csv")
    (tmp_path / "g.csv").write_text(text("time,de", columns=(T, DE, Q)))
    with pytest.raises(
        RecordError, match=r"its heading has 2 names and its rows 3 cells, so that it names none; `testb"
    ):
        import_log(tmp_path / "g.csv")


def test_a_column_that_is_not_used_may_hold_anything(tmp_path):
    lines = [f"{line},1.234.567" if i else f"{line},serial" for i, line in enumerate(text(HEAD).splitlines())]
    (tmp_path / "f.csv").write_text("\n".join(lines))
    is_the_flight(tmp_path / "f.csv")


def test_whole_numbers_between_commas_are_no_decimals(tmp_path):
    (tmp_path / "f.csv").write_text("a,b\n1,2\n3,4\n")
    assert read_table(tmp_path / "f.csv", "csv").numbers(2).tolist() == [2.0, 4.0]
    (tmp_path / "f.txt").write_text("a, b\n1, 2\n3, 4\n")
    assert read_table(tmp_path / "f.txt", "text").numbers(2).tolist() == [2.0, 4.0]


def test_jsbsim_s_own_output_has_its_channels(tmp_path):
    head = "Time,Elevator Position (deg),Q (deg/s),Q dot (deg/s^2),V_{Total} (ft/s),q bar (psf),Q(1)_{LOCAL}"
    columns = (T, DE, Q, 2.0 * np.cos(T), 130.0 + T, 20.0 + T, 0.5 + 0.0 * T)
    (tmp_path / "f.csv").write_text(text(head, columns=columns))
    record = is_the_flight(tmp_path / "f.csv").record
    assert set(record.channels) == {"de", "q", "qdot", "V", "qbar"}
    np.testing.assert_allclose(record["V"], FT_M * (130.0 + T), rtol=1e-7)
    np.testing.assert_allclose(record["qbar"], PSF_PA * (20.0 + T), rtol=1e-7)
    np.testing.assert_allclose(record["qdot"], 2.0 * DEG_RAD * np.cos(T), atol=1e-7)


def test_what_jsbsim_writes_is_what_its_properties_say(tmp_path):
    """Stock c172p with all groups of JSBSim's own output, 2 s at 60 Hz, the elevator moved after 1 s."""
    import jsbsim

    (tmp_path / "out.xml").write_text(
        f'<?xml version="1.0"?><output name="{tmp_path}/f.csv" type="CSV" rate="60"><rates>ON</rates>'
        "<position>ON</position><velocities>ON</velocities><aerosurfaces>ON</aerosurfaces><forces>ON</forces><fcs>ON</fcs></output>"
    )
    executive = jsbsim.FGFDMExec(jsbsim.get_default_root_dir())
    executive.set_debug_level(0)
    executive.load_model("c172p")
    executive.set_output_directive(str(tmp_path / "out.xml"))
    executive["ic/h-sl-ft"], executive["ic/vc-kts"] = 3000.0, 90.0
    executive.run_ic()
    names = {"q": "velocities/q-rad_sec", "alpha": "aero/alpha-rad", "de": "fcs/elevator-pos-rad",
             "theta": "attitude/theta-rad", "qdot": "accelerations/qdot-rad_sec2"}  # fmt: skip
    said = []
    for step in range(240):
        executive["fcs/elevator-cmd-norm"] = -0.2 if 120 <= step < 180 else 0.0
        executive.run()
        said.append([executive[name] for name in names.values()])
    del executive  # closes the file
    found = import_log(tmp_path / "f.csv")
    record = found.record
    assert {*names, "V", "qbar", "u", "v", "w", "h", "phi", "psi", "beta", "v_north"} <= set(record.channels)
    assert found.rate_hz == 60.0
    for k, name in enumerate(names):
        of_properties = np.array(said)[:, k]
        nearest = np.abs(record[name][:, None] - of_properties).min(axis=1)[2:]  # the first stand before the first step
        assert nearest.max() < 1e-6 * np.ptp(of_properties), name
        assert np.ptp(record[name]) > 0.9 * np.ptp(of_properties[2:]), name


def test_inputs_are_not_taken_for_velocities(tmp_path):
    """u beside y is the input of a system; u alone in m/s is a velocity."""
    (tmp_path / "f.csv").write_text(text("t,u,y1"))
    with pytest.raises(RecordError, match=r"must carry names of channels .* got t, u, y1"):
        import_log(tmp_path / "f.csv")
    (tmp_path / "g.csv").write_text(text("t,u [m/s],w [m/s]"))
    assert set(import_log(tmp_path / "g.csv").record.channels) == {"u", "w"}


@pytest.mark.parametrize(
    ("name", "channels"),
    [("csv_semicolon_decimal_comma/eu.csv", {"de", "alpha", "q"}),
     ("text_header_with_units/u.txt", {"de", "alpha", "q"}),
     ("csv_of_jsbsim/out.csv", {"de", "q", "qdot", "V", "qbar", "alpha"})],
)  # fmt: skip
def test_the_inputs_that_failed(name, channels):
    found = import_log(case(name))
    assert set(found.record.channels) == channels
    assert found.record["de"].max() == pytest.approx(3.0 * DEG_RAD, rel=1e-4)
    assert found.search.manoeuvres[0].start_s == pytest.approx(5.0, abs=0.05)


TITLED = {
    "comma_and_number.csv": ("Flight 12, 2024", ",", "."),
    "date_and_clock.csv": ("2024-05-01, 12:30", ",", "."),
    "quoted.csv": ('"Short period, 3-2-1-1",3', ",", "."),
    "as_wide_as_the_table.csv": ("elevator,1,2", ",", "."),
    "keys_and_values.csv": ("mass,5.2\nspan,3\n\nrate,50", ",", "."),
    "decimal_comma.csv": ("Flug 12; 2024", ";", ","),
    "blanks.txt": ("Flight 12 2024", " ", "."),
    "sixty.csv": ("\n".join(f"key{i},{i}" for i in range(60)), ",", "."),
}


@pytest.mark.parametrize("name", TITLED)
def test_titles_with_numbers_above_the_heading_are_found_and_said(tmp_path, name):
    title, delimiter, decimal = TITLED[name]
    path = tmp_path / name
    head = HEAD.replace(",", delimiter) if delimiter != " " else "time[s] de[deg] q[deg/s]"
    path.write_text(f"{title}\n{text(head, delimiter, decimal)}", encoding="utf-8")
    found = is_the_flight(path)
    lines = [line for line in title.splitlines() if line]
    said = "1 line above the heading is a title" if len(lines) == 1 else f"{len(lines)} lines above the heading are tit"
    assert len(found.log.notes) == 1
    assert found.log.notes[0].startswith(said)
    assert f"'{lines[0]}'" in found.log.notes[0]
    assert not found.log.warnings


def test_rows_of_numbers_above_names_are_no_titles(tmp_path):
    whole = text("").strip().splitlines()
    path = tmp_path / "names_in_the_middle.csv"
    path.write_text("\n".join([*whole[:50], HEAD, *whole[50:]]), encoding="utf-8")
    with pytest.raises(RecordError, match="got columns without names"):
        import_log(path)


def test_a_title_over_numbers_without_names_is_not_blamed_for_their_cells(tmp_path):
    path = tmp_path / "no_names.csv"
    path.write_text(text("Flight 12, 2024"), encoding="utf-8")
    with pytest.raises(RecordError, match="must be called t or time, or hold dates, got columns without names"):
        import_log(path)
    assert read_table(path, "csv").above == ("Flight 12, 2024",)


def test_a_damaged_first_row_is_the_one_that_is_left_out(tmp_path):
    lines = text(HEAD).splitlines()
    lines[1] = "0.0,1"
    path = tmp_path / "damaged_first.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    (said,) = import_log(path).log.warnings
    assert "1 line is damaged" in said
    assert "every row must have 3 cells, got 2 in line 2 of" in said
    assert "cut short" not in said
