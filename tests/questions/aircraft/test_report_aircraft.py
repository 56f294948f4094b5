"""The report on an aircraft: every part there, self-contained, and an export that needs nothing of this project."""

import csv
import json
import re

import numpy as np
import pytest
from commands import command
from rich.console import Console

from testbench.aircraft import Insert
from testbench.aircraft.amend import Amendment
from testbench.core.constants import DEG_RAD, FT_M
from testbench.core.errors import LimitError
from testbench.core.paths import aircraft_names
from testbench.evaluation.envelope import fly_envelope
from testbench.flight import FlightCondition, Manoeuvre, fly, load_aircraft, trim
from testbench.inputs import InputSignal
from testbench.questions.aircraft.answer import _intervals, aircraft_answer, shapes_missing
from testbench.questions.aircraft.ask import SpeedRange, Survey, survey
from testbench.questions.aircraft.page import (
    aircraft_page,
    aircraft_plates,
    aircraft_tables,
    coefficient_table,
    folder_name,
    trim_table,
)
from testbench.questions.export.aircraft import export_aircraft


@pytest.fixture(scope="module")
def flexible():
    return survey(load_aircraft("eolo"), "eolo")


@pytest.fixture(scope="module")
def rigid():
    return survey(load_aircraft("taurus"), "taurus")


@pytest.fixture(scope="module")
def rigid_page(rigid, tmp_path_factory):
    return aircraft_page(rigid).write(tmp_path_factory.mktemp("rigid"))[-1].read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def written(flexible, tmp_path_factory):
    folder = tmp_path_factory.mktemp("out") / "aircraft_eolo"
    return folder, aircraft_page(flexible).write(folder)


def test_every_file_is_there_and_the_page_comes_last(written):
    folder, paths = written
    assert paths[-1] == folder / "report.html"
    names = {str(p.relative_to(folder)) for p in paths}
    for stem in ("trim", "modes", "elastic_modes", "derivatives", "coefficients", "modes_over_speed"):
        assert {f"tables/{stem}.csv", f"tables/{stem}.json"} <= names
    for stem in ("three_view", "trim", "modes_longitudinal", "modes_lateral_directional", "mode_shapes", "bode_de"):
        assert (folder / "figures" / f"{stem}.png").read_bytes().startswith(b"\x89PNG")
    assert all(p.stat().st_size > 100 for p in paths if p.suffix != ".png")  # figures are drawn below
    assert not list(folder.rglob("*.part"))


def test_the_page_says_all_and_fetches_nothing(written, flexible):
    folder, _ = written
    page = (folder / "report.html").read_text(encoding="utf-8")
    for text in ("short period", "phugoid", "Dutch roll", "spiral", "M_alpha", "Z_alpha/V", "CL_alpha", "jsbsim"):
        assert text in page
    assert 'id="table-elastic_modes"' in page
    for mode in flexible.envelope.elastic:
        assert mode in page
    assert not re.findall(r'(?:src|href|srcset)="(?!data:|#)', page)
    assert page.count("<figure class=") == len(aircraft_plates(flexible)) + len(aircraft_tables(flexible))


def test_the_trim_table_holds_what_was_trimmed(written, flexible):
    folder, _ = written
    rows = list(csv.reader((folder / "tables" / "trim.csv").open(encoding="utf-8")))
    assert [float(r[0]) for r in rows[1:]] == list(flexible.tabled)
    symmetric = [m for m in flexible.envelope.aircraft.elastic.modes if m.symmetry == "symmetric"]
    assert sum(head.startswith("eta_") for head in rows[0]) == len(symmetric)
    content = json.loads((folder / "tables" / "modes_over_speed.json").read_text(encoding="utf-8"))["rows"]
    assert len(content) >= len(flexible.envelope.speeds) * len(flexible.envelope.motion)


def test_the_answer_gives_the_range_and_the_onset(flexible, rigid):
    told = aircraft_answer(flexible)
    assert "static margin at 12 m/s is" in aircraft_answer(rigid)[1]
    assert re.search("unstable|no elastic mode becomes", told[2]), "instability stands among the first"
    assert f"{flexible.range.slowest:g} to {flexible.range.fastest:g} m/s" in told[0]
    assert any(re.search(r"the elastic mode .* is unstable (from|already)|no elastic mode becomes", s) for s in told)
    assert not any("elastic" in s for s in aircraft_answer(rigid))
    for refused in rigid.range.beyond:
        assert any(refused.reason in s for s in aircraft_answer(rigid))


def test_the_elevator_that_trim_leaves_is_what_an_input_can_take(rigid):
    """Taurus at 12 m/s: -8.4 of 12.5 deg; a step of more than the smaller side is refused, one of less is flown."""
    keys = [column.key for column in trim_table(rigid).columns]
    table = {row[0]: dict(zip(keys, row, strict=True)) for row in trim_table(rigid).rows}
    for row in table.values():
        assert row["de_up"] + row["de_down"] == pytest.approx(25.0)
        assert 12.5 + row["de"] == pytest.approx(row["de_up"])
    assert (round(table[12.0]["de_up"], 1), round(table[12.0]["de_down"], 1)) == (4.1, 20.9)
    (said,) = (s for s in aircraft_answer(rigid) if "elevator" in s)
    assert "at 12 m/s takes 8.4 of the elevator's 12.5 deg and leaves 4.1 deg up and 20.9 deg down" in said
    aircraft = load_aircraft("taurus")
    trimmed = trim(aircraft, FlightCondition(12.0, 100.0))

    def least(amplitude_deg):
        u = np.zeros((240, 1))
        u[24:96] = -amplitude_deg * DEG_RAD
        signal = InputSignal(np.arange(240) / 240.0, u, ("de",))
        return float(np.min(fly(aircraft, trimmed, Manoeuvre("up", signal, 0.0), 120.0)["de"])) / DEG_RAD

    assert least(4.0) == pytest.approx(-12.44, abs=0.02)
    with pytest.raises(LimitError, match=r"-8[.]44 at trim and -4[.]20 from the input"):
        least(4.2)


@pytest.mark.usefixtures("rendered")
def test_figures_are_the_same_bytes_each_time_and_have_a_narrow_form(rigid):
    plates = {plate.name: plate for plate in aircraft_plates(rigid)}
    for name in ("trim", "modes_longitudinal", "bode_de"):  # panels over speed, roots, frequency responses
        plate = plates[name]
        drawing = plate.draw()
        assert drawing == plate.draw()
        assert len(drawing.png) > 100
        assert plate.draw(wide=False, png=False).svg != drawing.svg


def _shape_plates(found):
    return [plate for plate in aircraft_plates(found) if plate.name == "mode_shapes"]


@pytest.mark.usefixtures("rendered")
def test_mode_shapes_are_drawn_over_both_wings_the_same_each_time(flexible):
    (plate,) = _shape_plates(flexible)
    drawing = plate.draw()
    assert drawing == plate.draw()
    assert plate.draw(wide=False, png=False).svg != drawing.svg
    assert shapes_missing(flexible) == ""
    elastic = flexible.envelope.aircraft.elastic
    axes = plate.make(True).axes
    left, right = axes[::2], axes[1::2]
    assert len(left) == len(right) == len(elastic)
    count = len(elastic.stations_m)
    for bending, twisting, mode in zip(left, right, elastic.modes, strict=True):
        sign = 1.0 if mode.symmetry == "symmetric" else -1.0
        assert f"{mode.f_hz:g} Hz" in bending.get_title(loc="left")
        for panel, wanted in ((bending, mode.shape.bend_m), (twisting, np.degrees(mode.shape.twist_rad))):
            y, drawn = panel.lines[0].get_data()
            np.testing.assert_allclose(y[count:], elastic.stations_m)
            np.testing.assert_allclose(drawn[count:], wanted)
            np.testing.assert_allclose(y, -y[::-1])
            np.testing.assert_allclose(drawn, sign * drawn[::-1])


def test_without_mode_shapes_the_page_says_so_and_draws_none(rigid, rigid_page):
    aircraft = load_aircraft("b1")
    V = aircraft.design_V_m_s
    b1 = Survey("b1", fly_envelope(aircraft, [V]), SpeedRange(V, V, 0.1), (V,), (V,), ())
    assert not _shape_plates(rigid)
    assert not _shape_plates(b1)
    assert "without shapes" in shapes_missing(b1)
    assert "no elastic modes" in shapes_missing(rigid)
    assert shapes_missing(rigid) in rigid_page


def test_a_rigid_aircraft_has_no_elastic_table(rigid, rigid_page):
    assert "elastic_modes" not in {t.name for t in aircraft_tables(rigid)}
    assert 'id="table-elastic_modes"' not in rigid_page
    assert 'id="table-modes"' in rigid_page
    assert len(rigid_page) > 10_000
    assert folder_name(load_aircraft("eolo", "rigid"), "eolo") == "aircraft_eolo_rigid"
    assert folder_name(load_aircraft("taurus", "rigid"), "taurus") == "aircraft_taurus"


def test_coefficients_of_one_number_many_numbers_and_tables_are_listed():
    aircraft = load_aircraft("taurus")
    xml = (
        '<function name="aero/coefficient/CL_odd"><description>made up</description><product><value>2</value>'
        '<table><independentVar lookup="row">aero/alpha-rad</independentVar><tableData>0 0\n1 1</tableData></table>'
        "</product></function>"
    )
    changed = aircraft.amended(Amendment("odd", "odd", (Insert("aerodynamics/axis[@name='LIFT']", xml),)))
    rows = {row[0]: row for row in coefficient_table(changed).rows}
    assert rows["CL_alpha"][2] == aircraft.coefficient("CL_alpha")
    assert rows["CL_odd"][2:] == (None, "numbers 2; 1 table", "made up")
    assert rows.keys() - {row[0] for row in coefficient_table(aircraft).rows} == {"CL_odd"}


def test_the_terminal_gets_the_answer_and_both_tables(rigid):
    console = Console(record=True, width=160, file=None, quiet=False, force_terminal=False)
    with console.capture() as captured:
        aircraft_page(rigid).show(console, "somewhere")
    text = captured.get()
    for word in ("The aircraft trims from", "Trim over speed", "Dutch roll", "somewhere/report.html"):
        assert word in text


@pytest.mark.parametrize("name", aircraft_names())
def test_the_export_loads_trims_and_flies_in_stock_jsbsim(name, tmp_path):
    import jsbsim

    aircraft = load_aircraft(name)
    V = aircraft.design_V_m_s
    h = aircraft.design_h_m
    paths = export_aircraft(aircraft, "jsbsim", tmp_path / "aircraft", FlightCondition(V, h))
    note = paths[-1].read_text(encoding="utf-8")
    assert f"{aircraft.rate_hz:g}" in note
    elastic = aircraft.flown_modes() is not None
    assert ("elastic equations are made for" in note) == elastic
    jsbsim.set_logger(jsbsim.FGLogger())
    fdm = jsbsim.FGFDMExec(str(tmp_path))
    fdm.set_debug_level(0)
    fdm.set_dt(1.0 / aircraft.rate_hz)
    assert fdm.load_model(name)
    fdm["ic/h-sl-ft"], fdm["ic/vt-fps"] = h / FT_M, V / FT_M
    fdm.run_ic()
    fdm["propulsion/set-running"] = -1
    fdm.do_trim(1)
    for _ in range(int(2.0 * aircraft.rate_hz)):
        fdm.run()
    # JSBSim's own trim leaves 1e-5 m/s2 and more; an unstable spiral or phugoid grows little in two seconds.
    assert fdm["velocities/vt-fps"] * FT_M == pytest.approx(V, rel=5e-3)
    assert fdm["position/h-sl-ft"] * FT_M == pytest.approx(h, abs=1.0)
    if elastic:
        state = trim(aircraft, FlightCondition(V, h)).state
        assert fdm["modal/eta-1"] == pytest.approx(state["eta_1"], rel=0.05)


@pytest.mark.parametrize(
    ("name", "margin", "lag"),
    [
        ("eolo", "2.6 % of the mean chord with the elastic modes held, and 0.3 % in flight", None),
        (
            "taurus",
            "15.9 % of the mean chord",
            "the lift of the model has a term in the rate of alpha and its pitching",
        ),
    ],
)
def test_what_a_professor_would_remark_of_its_pitching_is_said(name, margin, lag):
    aircraft = load_aircraft(name)
    said = aircraft_answer(
        Survey(
            name,
            fly_envelope(aircraft, [aircraft.design_V_m_s]),
            SpeedRange(aircraft.design_V_m_s, aircraft.design_V_m_s, 0.1),
            (),
            (),
            (),
        )
    )
    assert any(margin in text for text in said)
    assert any("rate of alpha" in text for text in said) == bool(lag)
    assert lag is None or any(lag in text for text in said)


def test_a_speed_to_show_must_be_one_that_flies(tmp_path):
    done = command("aircraft", "show", "taurus", "--speed", "5", "-o", tmp_path)
    assert done.returncode != 0
    assert "trim of taurus at 5 m/s" in done.stderr
    assert "Traceback" not in done.stderr


def test_ranges_of_speed_are_lists_of_intervals():
    """The short period of the F-16 is unstable at both ends of its speeds and stable between."""
    speeds, unstable = (74.5, 80.0, 90.0, 236.0, 250.0, 273.0), (True, True, False, False, True, True)
    assert _intervals(speeds, unstable) == ["between 74.5 and 80 m/s", "between 250 and 273 m/s"]
    assert _intervals((20.0, 21.0, 22.0), (False, True, False)) == ["at 21 m/s"]
