"""Structures of MATLAB in versions 5 and 7.3: read where they hold one flight, else refused with the path to give."""

import struct
from io import BytesIO

import h5py
import numpy as np
import pytest
from scipy.io import savemat
from scipy.io.matlab import MatlabObject
from short_flight import DE, Q, T, case
from writers import write_73

from testbench.core.constants import DEG_RAD
from testbench.core.errors import RecordError
from testbench.logs.read import read_records
from testbench.logs.tables import read_table
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.importing.ask import import_log
from testbench.questions.importing.template import write_template

FLIGHT = {"time": T, "de": DE, "q": Q}
UNITS = {"time": "s", "de": "deg", "q": "deg/s"}


def signal(name, **more):
    return {"data": FLIGHT[name], "units": UNITS[name], **more}


def array(rows):
    """Rows, each a dict, as a structure array 1 x n."""
    out = np.empty((1, len(rows)), dtype=[(name, "O") for name in rows[0]])
    for i, row in enumerate(rows):
        for name, value in row.items():
            out[0, i][name] = value
    return out


def cells(*items):
    out = np.empty((1, len(items)), dtype=object)
    out[0, :] = items
    return out


ONE_FLIGHT = {
    "structure": {"data": {"flight": {**FLIGHT, "units": UNITS, "pilot": "A"}, "mass": 5.0}},
    "values and units": {"flight": {name: signal(name) for name in FLIGHT}},
    "array of scalars": {"log": array([dict(zip(UNITS, row, strict=True)) for row in zip(T, DE, Q, strict=True)]),
                         "units": UNITS},
    "deep": {"a": {"b": {"c": {name: signal(name, description="x") for name in FLIGHT}}}},
    "rows": {"data": {name: values[None, :] for name, values in FLIGHT.items()}, "units": UNITS},
    "clock in each": {"run": {"de": signal("de", Time=T), "q": signal("q", Time=T)}},
    "groups of one clock": {"imu": {"t": T, "q": signal("q")}, "servo": {"t": T, "de": signal("de")}},
    "cell": {"flights": cells({name: signal(name) for name in FLIGHT})},
    "signals of simulink": {"yout": {"time": T, "signals": array([
        {"values": DE[:, None], "label": "de_deg"}, {"values": Q[:, None], "label": "q_dps"}])}},
    "old object": {"d": {"InputData": DE[:, None], "OutputData": Q[:, None], "Ts": 0.02, "InputName": cells("de_deg"),
                         "OutputName": cells("q_dps"), "Tstart": 0.0}},
    "short vectors beside": {"data": {**FLIGHT, "units": UNITS, "cal": np.arange(5.0)}},
}  # fmt: skip


def is_the_flight(path):
    found = import_log(path)
    assert found.rate_hz == 50.0
    np.testing.assert_allclose(found.record["q"], DEG_RAD * Q, atol=1e-12)
    np.testing.assert_allclose(found.record["de"], DEG_RAD * DE, atol=1e-12)


@pytest.mark.parametrize("name", ONE_FLIGHT)
@pytest.mark.parametrize("version", ["5", "7.3"])
def test_one_flight_in_many_structures(name, version, tmp_path):
    if version == "5":
        savemat(tmp_path / "f.mat", ONE_FLIGHT[name])
    else:
        write_73(tmp_path / "f.mat", ONE_FLIGHT[name])
    is_the_flight(tmp_path / "f.mat")


def test_an_object_that_keeps_its_fields_is_a_structure(tmp_path):
    fields = ONE_FLIGHT["old object"]["d"]
    made = MatlabObject(np.zeros((1, 1), dtype=[(name, "O") for name in fields]), "iddata")
    for name, value in fields.items():
        made[name][0, 0] = value
    savemat(tmp_path / "f.mat", {"d": made})
    is_the_flight(tmp_path / "f.mat")


def fill(path, channels):
    text = path.read_text(encoding="utf-8")
    text = text.replace("# inputs", "inputs").replace("# outputs", "outputs").replace('["alpha", "q"]', '["q"]')
    head = text.split("[preparation]")[0]
    head = "\n".join(line for line in head.splitlines() if not line.startswith(("[[channel]]", "# ")))
    entries = [f'[[channel]]\nname = "{n}"\ncolumn = {c}\nunit = "{u}"' for n, c, u in channels]
    path.write_text("\n".join([head, *entries, "[preparation]" + text.split("[preparation]")[1]]), encoding="utf-8")
    [(_, _, record)] = read_records(RecordDescription.load(path))
    np.testing.assert_allclose(record["q"], DEG_RAD * Q, atol=1e-12)
    np.testing.assert_allclose(record["de"], DEG_RAD * DE, atol=1e-12)


def test_columns_of_a_matrix_are_numbered_and_the_description_proposes_them(tmp_path):
    savemat(tmp_path / "f.mat", {"data": {"t": T, "u": DE, "y": np.column_stack([0.1 * Q, Q])}, "notes": "x"})
    with pytest.raises(RecordError, match=r"must carry names of channels .* got t, u, y\[1\], y\[2\]; `testbench"):
        import_log(tmp_path / "f.mat")
    path = write_template(tmp_path / "f.mat", tmp_path / "f.toml")
    text = path.read_text(encoding="utf-8")
    assert 'variable = "data"' in text
    assert '# column = "y[2]"' in text
    fill(path, [("de", '"u"', "deg"), ("q", '"y[2]"', "deg/s")])


def test_columns_and_variables_are_given_by_path(tmp_path):
    runs = {"run1": {"t": T, "de": DE, "q": 0.0 * Q}, "run2": {"t": T + 1.0, "de": DE, "q": Q}}
    savemat(tmp_path / "f.mat", {"data": runs})
    with pytest.raises(RecordError, match=r"times of their own; .* give variable = one of data\.run1, data\.run2"):
        import_log(tmp_path / "f.mat")
    path = write_template(tmp_path / "f.mat", tmp_path / "f.toml")
    text = path.read_text(encoding="utf-8")
    assert 'variable = "data.run1"  # or ' in text
    path.write_text(text.replace('variable = "data.run1"', 'variable = "data.run2"'), encoding="utf-8")
    fill(path, [("de", '"data.run2.de"', "deg"), ("q", '"q"', "deg/s")])
    assert np.array_equal(read_table(tmp_path / "f.mat", "mat", "data.run2.q").numbers("q"), Q)
    with pytest.raises(RecordError, match=r"variable 'data\.run3', got none; did you mean 'data\.run"):
        read_table(tmp_path / "f.mat", "mat", "data.run3")


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_arrays_of_flights_are_chosen_from(version, tmp_path):
    content = {"runs": array([{"t": T, "q": 0.0 * Q, "de": DE}, {"t": T, "q": Q, "de": DE}])}
    content["cell"] = cells({"t": T, "q": Q, "de": DE}, {"t": T, "q": Q, "de": DE})
    for name, law in (
        (
            "runs",
            r"is a structure array of 2, with .*runs\(1\)\.q \(800 x 1\).* variable = \"runs\(1\)\" to \"runs\(2\)\"",
        ),
        ("cell", r"is a cell array of 2; .* variable = one of cell\{1\}, cell\{2\}"),
    ):
        if version == "5":
            savemat(tmp_path / "f.mat", {name: content[name]}, oned_as="column")
        else:
            write_73(tmp_path / "f.mat", {name: content[name]})
        with pytest.raises(RecordError, match=law):
            import_log(tmp_path / "f.mat")
        path = name + ("(2)" if name == "runs" else "{2}")
        assert np.array_equal(read_table(tmp_path / "f.mat", "mat", path).numbers("q"), Q)
        write_template(tmp_path / "f.mat", tmp_path / f"{name}.toml")
        assert f'variable = "{name}' in (tmp_path / f"{name}.toml").read_text(encoding="utf-8")


def opaque(name, kind):
    """A variable of a class in version 5: name, system of classes, class and a number in that system."""

    def element(number, content):
        return struct.pack("<II", number, len(content)) + content + bytes(-len(content) % 8)

    reference = element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 1, 1)) + element(1, b"")
    reference += element(6, struct.pack("<I", 0xDD000000))
    text = [element(1, part.encode()) for part in (name, "MCOS", kind)]
    whole = element(6, struct.pack("<II", 17, 0)) + b"".join(text) + element(14, reference)
    return element(14, whole)


@pytest.mark.parametrize(
    ("kind", "how"),
    [("table", r"s = table2struct\(T, 'ToScalar', true\); save"), ("timetable", r"timetable2table\(T"),
     ("timeseries", r"struct\('t', T\.Time, 'q', squeeze\(T\.Data\)\)"), ("iddata", r"T\.InputData"),
     ("Simulink.SimulationData.Dataset", "getElement"), ("MyLog", r"s = struct\(T\)")],
)  # fmt: skip
def test_objects_that_only_matlab_reads_come_with_the_line_that_converts_them(kind, how, tmp_path):
    header = BytesIO()
    savemat(header, {})
    (tmp_path / "f.mat").write_bytes(header.getvalue()[:128] + opaque("T", kind))
    with pytest.raises(RecordError, match=rf"'T' in .* is an object of class {kind}, which only MATLAB .*{how}"):
        import_log(tmp_path / "f.mat")
    with h5py.File(tmp_path / "g.mat", "w") as file:
        made = file.create_dataset("T", data=np.zeros((1, 6), np.uint32))
        made.attrs["MATLAB_class"], made.attrs["MATLAB_object_decode"] = np.bytes_(kind), np.int32(3)
    with pytest.raises(RecordError, match=rf"object of class {kind}, which only MATLAB .*{how}"):
        import_log(tmp_path / "g.mat")


def test_what_lies_beside_a_flight_is_said(tmp_path):
    savemat(tmp_path / "f.mat", {"data": {**FLIGHT, "units": UNITS, "alpha": np.arange(160.0), "t_alpha": T[::5]}})
    found = import_log(tmp_path / "f.mat")
    assert {s.channel for s in found.balance.kept} == {"alpha", "de", "q"}  # alpha with its own times


def test_a_structure_without_samples_lists_its_paths(tmp_path):
    savemat(tmp_path / "f.mat", {"meta": {"mass": 5.0, "who": {"pilot": "A", "age": 40.0}}, "k": {"x": 1.0}})
    with pytest.raises(RecordError, match=r"must be said; .* it holds meta\.mass \(1 x 1\), meta\.who\.age \(1 x 1\)"):
        import_log(tmp_path / "f.mat")
    savemat(tmp_path / "f.mat", {"meta": {"pilot": "A"}})
    with pytest.raises(RecordError, match="holds the samples must be said"):
        import_log(tmp_path / "f.mat")


@pytest.mark.parametrize(("name", "channels"), [("a", {"q"}), ("b", {"de", "q"})])
def test_the_inputs_that_failed(name, channels):
    found = import_log(case(f"mat_structures/{name}.mat"))
    assert found.rate_hz == 50.0
    assert set(found.record.channels) - {"de"} == channels - {"de"}


def test_the_input_that_failed_with_inputs_and_outputs():
    table = read_table(case("mat_structures/c.mat"), "mat")
    assert table.names == ("t", "u", "y[1]", "y[2]")
    assert len(table) == 800


@pytest.mark.parametrize("nested", [False, True])
def test_signals_with_times_of_their_own_are_read_together(nested, tmp_path):
    facts = {"DataInfo": {"Units": "deg"}, "TimeInfo": {"Units": "seconds"}}
    signals = {
        "de": {"Time": T, "Data": DE, **facts},
        "q": {"Time": T, "Data": Q, "DataInfo": {"Units": "deg/s"}},
        "theta": {"Time": T[::5], "Data": 2.0 + np.sin(T[::5]), **facts},
    }
    savemat(tmp_path / "flight.mat", {"log": signals} if nested else signals)
    found = import_log(tmp_path / "flight.mat")
    assert set(found.record.channels) == {"de", "q", "theta"}
    np.testing.assert_allclose(found.record["q"], DEG_RAD * Q, atol=1e-12)
    slow = next(c for c in found.channels if c.name == "theta")
    np.testing.assert_allclose(slow.t_s, T[::5])
    np.testing.assert_allclose(slow.values, DEG_RAD * (2.0 + np.sin(T[::5])))


def test_units_of_an_iddata_object_are_its_own(tmp_path):
    names = {"InputName": np.array(["de"], object), "OutputName": np.array(["q"], object)}
    units = {"InputUnit": np.array(["deg"], object), "OutputUnit": np.array(["deg/s"], object)}
    z = {"InputData": DE[:, None], "OutputData": Q[:, None], "Ts": 0.02, **names, **units}
    savemat(tmp_path / "flight.mat", {"z": z})
    record = import_log(tmp_path / "flight.mat").record
    np.testing.assert_allclose(record["q"], DEG_RAD * Q, atol=1e-12)
    np.testing.assert_allclose(record["de"], DEG_RAD * DE, atol=1e-12)
