"""Planes that xflr5 exported as XML: read as geometry.toml would say them, or refused with the surface."""

import math

import pytest

from testbench.aircraft.geometry.read import read_plan
from testbench.core.errors import ScenarioError

REST = """
design_V_m_s = 14.0
[mass]
mass_kg = 2.2
cg_m = [0.09, 0.0, 0.0]
[control.de]
surface = "tail"
throw_deg = 25
chord_fraction = 1.0
[control.dr]
surface = "fin"
throw_deg = 25
chord_fraction = 0.4
"""


def _wing(kind, position, *sections, more=""):
    rows = "".join(
        f"<Section><y_position>{y}</y_position><Chord>{c}</Chord><xOffset>{x}</xOffset><Dihedral>{d}</Dihedral>"
        f"<Twist>{t}</Twist><Left_Side_FoilName>NACA 2412</Left_Side_FoilName>"
        "<Right_Side_FoilName>NACA 2412</Right_Side_FoilName></Section>"
        for y, c, x, d, t in sections
    )
    head = f"<Name>{kind}</Name><Type>{kind}</Type><Position>{position}</Position>{more}"
    return f"<wing>{head}<Sections>{rows}</Sections></wing>"


WINGS = (
    _wing(
        "MAINWING",
        "0, 0, 0",
        (0, 300, 0, 0, 0),
        (500, 300, 0, 10, 0),
        (800, 200, 50, 0, -2),
        more="<Tilt_angle>2</Tilt_angle>",
    )
    + _wing("ELEVATOR", "800, 0, 50", (0, 150, 0, 0, 0), (250, 120, 15, 0, 0))
    + _wing("FIN", "800, 0, 50", (0, 200, 0, 0, 0), (220, 120, 60, 0, 0))
)


def _plan(tmp_path, wings=WINGS):
    (tmp_path / "rest.toml").write_text(REST)
    path = tmp_path / "plane.xml"
    units = "<Units><length_unit_to_meter>0.001</length_unit_to_meter></Units>"
    path.write_text(f"<explane version='1.0'>{units}<Plane><Name>Mine</Name>{wings}</Plane></explane>")
    return read_plan(path, tmp_path / "rest.toml")


def test_a_plane_is_read_in_its_unit_with_dihedral_twist_and_a_fin_that_stands(tmp_path):
    plan = _plan(tmp_path)
    wing, tail, fin = plan.plane.surfaces
    assert (plan.title, plan.plane.controls) == ("Mine", ("de", "dr"))
    tip = wing.stations[-1]
    assert tip.y_m == pytest.approx(0.5 + 0.3 * math.cos(math.radians(10.0)))
    assert tip.z_m == pytest.approx(0.3 * math.sin(math.radians(10.0)))
    assert (tip.x_m, tip.chord_m, tip.twist_deg) == pytest.approx((0.05, 0.2, 0.0))
    assert tail.stations[0].x_m == pytest.approx(0.8)
    assert tail.flaps[0].chord_fraction == 1.0
    assert [s.z_m for s in fin.stations] == pytest.approx([0.05, 0.27])
    assert {s.y_m for s in fin.stations} == {0.0}


def test_what_cannot_be_carried_over_is_refused(tmp_path):
    with pytest.raises(ScenarioError, match="must be one of MAINWING, ELEVATOR, FIN, got SECONDWING"):
        _plan(tmp_path, WINGS + _wing("SECONDWING", "0, 0, 100", (0, 200, 0, 0, 0), (400, 200, 0, 0, 0)))
    with pytest.raises(ScenarioError, match="<Chord> must be a number, got 'wide'"):
        _plan(tmp_path, WINGS.replace("<Chord>150</Chord>", "<Chord>wide</Chord>"))
    (tmp_path / "other.xml").write_text("<plane/>")
    with pytest.raises(ScenarioError, match="must be a plane that xflr5 exported"):
        read_plan(tmp_path / "other.xml", tmp_path / "rest.toml")
    with pytest.raises(ScenarioError, match="a plane of xflr5 lacks mass"):
        read_plan(tmp_path / "plane.xml")
