"""A table that says too little of itself: the error names the way out, and the description written for it works."""

import re
import tomllib

import numpy as np
import pytest
from recorded import flight_data

from testbench.core.constants import DEG_RAD
from testbench.core.errors import RecordError, ScenarioError, WriteError
from testbench.logs.catalogue import writers_in
from testbench.logs.sidpac import Told
from testbench.logs.tables import read_table
from testbench.questions.identify.ask import identify
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.importing.ask import import_log, write_import
from testbench.questions.importing.template import description_template, write_template


def fill(path, channels, inputs, outputs, rate_hz=None):
    """Do what the template asks of its reader: the columns by number, their channels and units, inputs and outputs."""
    text = path.read_text(encoding="utf-8")
    for number, (name, unit, *more) in channels.items():
        entry = re.search(rf"^# column {number}\b.*\n((?:# .*\n)+)", text, re.MULTILINE)
        assert entry is not None, number
        filled = "".join(line.removeprefix("# ") for line in entry[1].splitlines(keepends=True))
        filled = filled.replace('name = "?"', f'name = "{name}"').replace('unit = "?"', f'unit = "{unit}"')
        text = text.replace(entry[0], entry[0].splitlines()[0] + "\n" + filled + "\n".join([*more, ""]))
    text = re.sub(r"^# inputs = .*", f"inputs = {inputs}".replace("'", '"'), text, flags=re.MULTILINE)
    text = re.sub(r"^# outputs = .*", f"outputs = {outputs}".replace("'", '"'), text, flags=re.MULTILINE)
    if rate_hz is not None:
        assert "# rate_hz = 100.0" in text
        text = text.replace("# rate_hz = 100.0", f"rate_hz = {rate_hz}")
    path.write_text(text, encoding="utf-8")
    return path


def refused(file):
    """The error without a description names file and command, in one line."""
    with pytest.raises(RecordError) as error:
        import_log(file)
    text = str(error.value)
    assert "\n" not in text
    assert f"`testbench import '{file}' --describe {file.stem}.toml`" in text
    assert f"`testbench import {file.stem}.toml`" in text


def test_attas_is_imported_once_its_columns_are_named(tmp_path):
    file = flight_data() / "attas" / "fAttasElv1.mat"
    refused(file)
    path = write_template(file, tmp_path / "elv1.toml")
    text = path.read_text(encoding="utf-8")
    assert "1502 rows, 45 columns" not in text
    assert "45 columns" in text
    assert text.count('# name = "?"') == 44  # all but time, which the file shows by running on
    assert "column = 1  # runs from 0 to" in text
    fill(path, {22: ("de", "deg"), 13: ("alpha", "deg"), 8: ("q", "deg/s")}, ["de"], ["alpha", "q"])
    found = import_log(path)
    raw = read_table(file, "mat")
    assert found.rate_hz == pytest.approx(25.0)
    for name, column in (("de", 22), ("alpha", 13), ("q", 8)):
        np.testing.assert_allclose(found.record[name], DEG_RAD * raw.numbers(column), rtol=1e-9, atol=1e-12)
    assert found.log.file.resolve() == file.resolve()
    assert found.search.manoeuvres
    written = write_import(found, tmp_path / "out")
    assert any(p.suffix == ".toml" for p in written)
    model = identify(RecordDescription.load(path)).cases[0].model
    assert min(abs(p) for p in np.concatenate(list(model.poles().values()))) == pytest.approx(2.5, rel=0.15)  # printed


def test_pieces_glued_together_become_segments_of_which_one_is_chosen(tmp_path):
    file = flight_data() / "attas" / "fAttasAilRud1.mat"
    path = write_template(file, tmp_path / "ailrud.toml")
    entry = {30: ("dr", "deg"), 29: ("da", "deg", "minus_column = 28", "scale = 0.5"), 7: ("p", "deg/s")}
    fill(path, entry, ["da", "dr"], ["p"])
    with pytest.raises(RecordError, match="--record: fAttasAilRud1_1, fAttasAilRud1_2; got none"):
        import_log(path)
    with pytest.raises(RecordError, match="got fAttasAilRud1_3"):
        import_log(path, told=Told(part="fAttasAilRud1_3"))
    found = import_log(path, told=Told(part="fAttasAilRud1_2"))
    raw = read_table(file, "mat")
    last = raw.numbers(1) >= 110.0
    aileron = 0.5 * DEG_RAD * (raw.numbers(29) - raw.numbers(28))
    np.testing.assert_allclose(found.record["da"], aileron[last], atol=1e-9)


def test_f16_ground_vibration_test_is_imported(tmp_path):
    """A force is no channel: it stands in for the elevator here, as accelerations do for wing stations."""
    file = flight_data() / "f16_gvt" / "F16Data_FullMSine_Level1.csv"
    refused(file)
    path = write_template(file, tmp_path / "f16.toml")
    assert "rate_hz = 400.0  # no column counts time; column 'Fs' says this" in path.read_text(encoding="utf-8")
    columns = {1: ("de", "rad", "scale = 0.001"), **{i: (f"az_wing_{i - 2}", "m/s2") for i in (3, 4, 5)}}
    fill(path, columns, ["de"], ["az_wing_1", "az_wing_2", "az_wing_3"])
    found = import_log(path)
    raw = read_table(file, "csv")
    assert len(found.record) == len(raw) == 9 * 8192
    np.testing.assert_allclose(found.record["az_wing_2"], raw.numbers("Acceleration2"), atol=1e-9)


@pytest.mark.parametrize("name", ["CD_player_arm_dat", "robot_arm_dat", "flexible_structure_dat"])
def test_daisy_sets_are_imported_once_their_rate_is_given(tmp_path, name):
    file = flight_data() / "daisy" / f"{name}.mat"
    refused(file)
    path = write_template(file, tmp_path / "daisy.toml")
    raw = read_table(file, "mat")
    outputs = len(raw.names) - 1 if name == "robot_arm_dat" else 2
    columns = {1: ("de", "rad"), **{1 + i: (f"az_wing_{i}", "m/s2") for i in range(1, outputs + 1)}}
    fill(path, columns, ["de"], [f"az_wing_{i}" for i in range(1, outputs + 1)])
    with pytest.raises(ScenarioError, match=r"rate_hz"):
        import_log(path)
    fill(path, {}, [], [], rate_hz=50.0)
    found = import_log(path)
    assert found.rate_hz == 50.0
    np.testing.assert_allclose(found.record["az_wing_1"], raw.numbers(2), atol=1e-9)


def table(path, names=None, rows=400):
    t = 0.02 * np.arange(rows)
    de = 10.0 * ((t >= 3.0) & (t < 4.0)) - 10.0 * ((t >= 4.0) & (t < 5.0))
    columns = np.column_stack([np.sin(t), t, de])
    lines = [",".join(f"{x:.6g}" for x in row) for row in columns]
    path.write_text("\n".join([*([names] if names else []), *lines]) + "\n", encoding="utf-8")
    return path, columns


def test_what_the_template_cannot_know_is_said_as_faults(tmp_path):
    file, columns = table(tmp_path / "plain.csv")
    refused(file)
    path = write_template(file, tmp_path / "deep" / "plain.toml")
    assert 'folder = ".."' in path.read_text(encoding="utf-8")
    assert "column = 2  # runs from 0 to 7.98 in steps of 0.02" in path.read_text(encoding="utf-8")
    with pytest.raises(ScenarioError) as error:
        import_log(path)
    assert {"channel", "identification.inputs"} <= {f.split(", ")[1].split(":")[0] for f in error.value.faults}
    fill(path, {1: ("q", "deg/s"), 3: ("de_cmd", "deg")}, ["de_cmd"], ["q"])
    found = import_log(path)
    np.testing.assert_allclose(found.record["de_cmd"], DEG_RAD * columns[:, 2], atol=1e-9)
    assert [m.controls for m in found.search.manoeuvres] == [("de_cmd",)]


def test_names_and_units_that_a_header_gives_are_proposed(tmp_path):
    file, _ = table(tmp_path / "named.csv", 'pitch rate [deg/s],clock [s],"de_cmd [""x"" \\ y]"')
    text = description_template(file)
    assert '[[channel]]\nname = "q"\ncolumn = "pitch rate"\nunit = "deg/s"' in text
    assert "# [[channel]]" in text  # the unit of the command is none
    path = write_template(file, tmp_path / "named.toml")
    path.write_text(text.replace("# inputs", "inputs").replace("# outputs", "outputs"), encoding="utf-8")
    with pytest.raises(ScenarioError, match="must be among the channels described, got 'de_cmd'"):
        RecordDescription.load(path)


def test_a_matrix_among_several_is_proposed(tmp_path):
    from scipy.io import savemat

    t = 0.1 * np.arange(50)
    savemat(tmp_path / "two.mat", {"big": np.column_stack([t, np.sin(t)]), "small": np.eye(3)})
    path = write_template(tmp_path / "two.mat", tmp_path / "two.toml")
    assert 'variable = "big"  # or small' in path.read_text(encoding="utf-8")
    fill(path, {2: ("q", "rad/s")}, ["q"], [])
    with pytest.raises(ScenarioError, match="every channel described is an input"):
        RecordDescription.load(path)


def test_a_command_in_degrees_is_not_taken_for_a_share_of_full_throw(tmp_path):
    file, columns = table(tmp_path / "c.csv", "q [deg/s],t [s],de_cmd [deg]")
    found = import_log(file, throw_rad={"de": 0.3})
    np.testing.assert_allclose(found.record["de_cmd"], DEG_RAD * columns[:, 2], atol=1e-9)
    assert not next(c for c in found.channels if c.name == "de_cmd").assumed


def test_bad_requests_are_one_line_each(tmp_path):
    file, _ = table(tmp_path / "plain.csv")
    (tmp_path / "there.toml").write_text("")
    (tmp_path / "log.ulg").write_bytes(b"ULog")
    (tmp_path / "empty.csv").write_text("")
    for source, out, law in (
        (file, tmp_path / "there.toml", "must be a new file"),
        (file, tmp_path / "there.txt", r"must be a \.toml file"),
        (tmp_path / "log.ulg", tmp_path / "x.toml", "which needs no description"),
        (tmp_path / "none.csv", tmp_path / "x.toml", "must be a file that exists"),
        (tmp_path, tmp_path / "x.toml", "must be a file that exists"),
        (tmp_path / "empty.csv", tmp_path / "x.toml", "empty file"),
        (file, file / "x.toml", "must go to a folder that can be written to"),
    ):
        with pytest.raises((RecordError, WriteError), match=law):
            write_template(source, out)
        assert not (tmp_path / "x.toml").exists()
    with pytest.raises(RecordError, match="--record chooses among those of a description"):
        import_log(file, told=Told(part="x"))


@pytest.mark.parametrize(
    ("names", "structure", "inputs", "outputs"),
    [
        (("de", "alpha", "q"), "short_period", ["de"], ["alpha", "q"]),
        (("da", "dr", "beta", "p", "r", "phi"), "lateral_per_speed", ["da", "dr"], ["beta", "p", "r", "phi"]),
        (("da", "p"), None, ["da"], ["p"]),
    ],
)
@pytest.mark.parametrize("stated", [True, False])
def test_what_is_proposed_depends_on_the_channels(names, structure, inputs, outputs, stated, tmp_path):
    t = 0.02 * np.arange(400)
    held = [0.1 * np.sin(t + i) for i in range(len(names))]
    heads = [f"{n} [{'rad/s' if n in 'pqr' else 'rad'}]" if stated else n for n in names]
    table = np.column_stack([t, *held])
    np.savetxt(tmp_path / "log.csv", table, "%.6g", ",", header=",".join(["t [s]", *heads]), comments="")
    text = write_template(tmp_path / "log.csv", tmp_path / "log.toml").read_text(encoding="utf-8")
    assert ("\n# inputs" in text) == (not stated)
    if not stated:
        text = re.sub(r"# (inputs|outputs) = ", r"\1 = ", text)
    found = tomllib.loads(text)["identification"]
    assert (found["inputs"], found["outputs"]) == (inputs, outputs)
    entry = found["estimators"][0]
    assert entry.get("structure") == structure
    if structure is None:
        assert (entry["method"], entry["order"]) == ("dsr_e", 4)  # roll, spiral and Dutch roll


def test_in_a_folder_of_writers_the_form_of_a_writer_is_begun(tmp_path, monkeypatch):
    """What two columns mean is said once; every table of these columns is then read so."""
    t = np.arange(0.0, 20.0, 0.02)
    rows = np.column_stack([1e3 * t, 5.0 * np.sin(t), np.full(t.size, 4.0), 0.3 * np.cos(t)])
    for name in ("first.csv", "second.csv"):
        np.savetxt(tmp_path / name, rows, "%.6f", ",", header="tick_ms,G1,A0,q [rad/s]", comments="")
    (tmp_path / "writers").mkdir()
    out = write_template(tmp_path / "first.csv", tmp_path / "writers" / "mine.toml")
    text = out.read_text(encoding="utf-8")
    assert 'columns = ["tick_ms", "G1", "A0", "q"]' in text
    writers_in.cache_clear()
    assert import_log(tmp_path / "second.csv").log.kind == "table (csv), as first writes it"
    form = text.split("# column 2, G1")[1].split("# column 3")[0]
    filled = form.replace("# [[", "[[").replace("# name", "name").replace("# column =", "column =")
    filled = filled.replace("# unit", "unit").replace('"?"', '"theta"', 1).replace('"?"', '"deg"', 1)
    out.write_text(text.replace(form, filled), encoding="utf-8")
    writers_in.cache_clear()
    found = import_log(tmp_path / "second.csv")
    writers_in.cache_clear()
    assert set(found.record.channels) == {"theta", "q"}
    theta = next(c for c in found.channels if c.name == "theta")
    np.testing.assert_allclose(theta.values, np.radians(rows[:, 1]), atol=1e-6)
    np.testing.assert_allclose(np.diff(theta.t_s), 0.02, atol=1e-9)
    np.savetxt(tmp_path / "bare.csv", rows, "%.6f", ",")
    with pytest.raises(RecordError, match="known by the names of its columns"):
        write_template(tmp_path / "bare.csv", tmp_path / "writers" / "bare.toml")
