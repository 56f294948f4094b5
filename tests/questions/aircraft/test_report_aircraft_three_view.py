"""The three-view drawing: its dimensions are those of the aircraft, and nothing of it leaves the paper."""

import importlib.util
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from testbench.core.errors import ScenarioError
from testbench.core.paths import AIRCRAFT_MODELS, aircraft_names
from testbench.flight import load_aircraft
from testbench.page.figure import INK, Area, Words
from testbench.questions.aircraft.three_view_figures import three_view_plates

pytestmark = pytest.mark.drawn


def plate(aircraft):
    (found,) = three_view_plates(SimpleNamespace(envelope=SimpleNamespace(aircraft=aircraft)))
    return found


@pytest.mark.parametrize("name", aircraft_names())
def test_the_drawing_has_the_span_and_area_of_the_model(name):
    aircraft = load_aircraft(name)
    wing = aircraft.outline.wing
    assert wing.span_m == pytest.approx(aircraft.geometry.b_m, rel=1e-9)
    assert wing.area_m2 == pytest.approx(aircraft.geometry.S_m2, rel=5e-3)
    assert aircraft.outline.fin.x_m < 0.0 < aircraft.outline.ends_m[0]
    assert "estimated" in aircraft.outline.note  # what is only there for the drawing is said to be


@pytest.mark.parametrize("name", aircraft_names())
@pytest.mark.parametrize("wide", [True, False])
def test_views_share_one_scale_and_say_the_main_dimensions(name, wide):
    aircraft = load_aircraft(name)
    (panel,) = plate(aircraft).chart_of(wide).panels
    width, tall = panel.box_in[2:]
    assert (panel.x_range, panel.y_range) == ((0.0, width), (0.0, tall))  # inches of paper
    nose, end = aircraft.outline.ends_m
    across = [float(np.ptp(x)) for d in panel.draws if isinstance(d, Area) for x, _ in d.outlines]
    twice = sorted({x for k, x in enumerate(across) for y in across[:k] if abs(x / y - 1.0) < 1e-9})
    wing, tail = twice[-1], twice[-2]  # from above and from ahead
    assert wing / tail == pytest.approx(aircraft.geometry.b_m / aircraft.outline.tail.span_m)
    said = [d.text for d in panel.draws if isinstance(d, Words)]
    for word, value in (("span", aircraft.geometry.b_m), ("length", nose - end)):
        (text,) = (
            t for t in said if t.startswith(f"{word} ") and float(t.split()[1]) == pytest.approx(value, rel=5e-3)
        )
        assert text.endswith(" m")
    assert any("arm" in t for t in said)
    assert any("mass" in t for t in said)


@pytest.mark.parametrize("name", aircraft_names())
@pytest.mark.parametrize("wide", [True, False])
def test_no_text_leaves_the_paper_or_covers_another(name, wide):
    figure = plate(load_aircraft(name)).make(wide)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    shown = [t for axes in figure.axes for t in axes.texts if t.get_text()] + list(figure.texts)
    boxes = [t.get_window_extent(renderer) for t in shown]
    for text, box in zip(shown, boxes, strict=True):
        assert figure.bbox.x0 <= box.x0, text.get_text()
        assert box.x1 <= figure.bbox.x1, text.get_text()
        assert figure.bbox.y0 <= box.y0, text.get_text()
        assert box.y1 <= figure.bbox.y1, text.get_text()
    for i, box in enumerate(boxes):
        for j in range(i):
            assert not box.overlaps(boxes[j]), (shown[i].get_text(), shown[j].get_text())


def test_the_centre_of_gravity_is_marked_in_all_three_views():
    (panel,) = plate(load_aircraft("eolo")).chart_of(True).panels
    discs = [d for d in panel.draws if isinstance(d, Area) and d.colour == "white"]
    quarters = [d for d in panel.draws if isinstance(d, Area) and d.colour == INK]
    assert (len(discs), len(quarters)) == (3, 6)
    for k, quarter in enumerate(quarters):
        (x, y), disc = quarter.outlines[0], discs[k // 2].outlines[0]
        centre = [0.5 * (c.min() + c.max()) for c in disc]
        assert [x[0], y[0]] == pytest.approx(centre, abs=1e-3)


def test_the_same_aircraft_gives_the_same_bytes_and_has_a_narrow_form():
    drawing = plate(load_aircraft("taurus")).draw()
    assert drawing == plate(load_aircraft("taurus")).draw()
    assert plate(load_aircraft("taurus")).draw(wide=False, png=False).svg != drawing.svg


def test_stations_of_the_mode_shapes_are_drawn_where_they_are_known():
    aircraft = load_aircraft("eolo")
    (panel,) = plate(aircraft).chart_of(True).panels
    dots = next(c for c in panel.curves if c.marker == "o")
    stations = np.array(aircraft.elastic.stations_m)
    assert len(dots.x) == len(stations)
    np.testing.assert_allclose(
        np.diff(dots.x) / np.diff(dots.x)[0], np.diff(stations) / np.diff(stations)[0], rtol=1e-9
    )
    assert "stations" in plate(aircraft).caption
    assert "stations" not in plate(aircraft.with_rigid_wings()).caption


def test_a_mean_chord_that_is_not_that_of_the_drawing_is_said():
    assert "9.29 m" in plate(load_aircraft("b1")).caption
    assert "mean aerodynamic chord" not in plate(load_aircraft("eolo")).caption


def test_an_aircraft_without_outline_has_no_drawing():
    bare = replace(load_aircraft("eolo"), outline=None)
    assert three_view_plates(SimpleNamespace(envelope=SimpleNamespace(aircraft=bare))) == []


def test_a_fault_in_the_outline_is_told_with_its_place(tmp_path):
    folder = AIRCRAFT_MODELS / "taurus"
    text = (folder / "aircraft.toml").read_text(encoding="utf-8").replace("span_m = 1.27", "span_m = -1.27")
    (tmp_path / "aircraft.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"drawing.*wing.*span_m"):
        load_aircraft("taurus", folder=tmp_path)


def test_the_drawn_eolo_is_the_one_that_its_coefficients_are_derived_from():
    spec = importlib.util.spec_from_file_location("derive", AIRCRAFT_MODELS / "eolo" / "derive.py")
    derive = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(derive)
    drawn, said = load_aircraft("eolo").outline, "bring [drawing] of aircraft.toml in line with derive.py"
    wing, tail = derive.WING, derive.TAIL
    assert drawn.wing.root_chord_m == pytest.approx(wing.root_chord_m, rel=2e-3), said
    assert drawn.wing.tip_chord_m == pytest.approx(wing.root_chord_m * wing.taper, rel=2e-3), said
    assert drawn.wing.x_m == pytest.approx(wing.quarter_chord_m, abs=1e-3), said
    assert drawn.elastic_axis == wing.elastic_axis, said
    assert drawn.tail.span_m == pytest.approx(tail.span_m, rel=2e-3), said
    assert drawn.tail.area_m2 == pytest.approx(tail.area_m2, rel=5e-3), said
    assert -drawn.tail.x_m == pytest.approx(tail.arm_m, rel=2e-3), said
    assert drawn.fin.area_m2 == pytest.approx(tail.fin_area_m2, rel=5e-3), said
