"""Plans as people write them, and every way in which one may be wrong: one message, with file and key.

Sections against printed ordinates, and files in the orders that people have.
"""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from testbench.aircraft.geometry.read import read_plan
from testbench.aircraft.geometry.shape import airfoil, naca
from testbench.core.errors import RecordError, ScenarioError

PLANS = Path(__file__).parent / "plans"
TWIN = (PLANS / "twin_fins.toml").read_text(encoding="utf-8")


def faults_of(path):
    with pytest.raises(ScenarioError) as found:
        read_plan(path)
    return found.value.faults


def test_a_trapezoid_and_its_sections_are_one_surface(tmp_path):
    trapezoid = read_plan(PLANS / "vtail.toml").plane
    wing = trapezoid.wing
    assert trapezoid.S_m2 == pytest.approx(0.36)
    assert trapezoid.b_m == 2.0
    taper = 0.14 / 0.22
    assert trapezoid.cbar_m == pytest.approx(2 / 3 * 0.22 * (1 + taper + taper**2) / (1 + taper), rel=1e-6)
    root, tip = wing.stations
    assert (root.x_m + 0.25 * root.chord_m) == pytest.approx(tip.x_m + 0.25 * tip.chord_m)
    assert tip.z_m == pytest.approx(math.tan(math.radians(3.0)))
    text = (PLANS / "vtail.toml").read_text(encoding="utf-8")
    start, end = text.index("span_m = 2.0"), text.index("[tail]")
    rows = "\n".join(
        f"[[wing.section]]\nx_m = {s.x_m!r}\ny_m = {s.y_m!r}\nz_m = {s.z_m!r}\nchord_m = {s.chord_m!r}"
        for s in wing.stations
    )
    (tmp_path / "by_sections.toml").write_text(text[:start] + rows + "\n" + text[end:], encoding="utf-8")
    by_sections = read_plan(tmp_path / "by_sections.toml").plane
    assert [(s.x_m, s.y_m, s.z_m, s.chord_m) for s in by_sections.wing.stations] == [
        (s.x_m, s.y_m, s.z_m, s.chord_m) for s in wing.stations
    ]
    assert (by_sections.S_m2, by_sections.cbar_m) == (trapezoid.S_m2, trapezoid.cbar_m)


BROKEN = {
    "misspelt key": ("root_chord_m = 0.30", "root_cord_m = 0.30", r"wing.root_cord_m: unknown key .*'root_chord_m'"),
    "no span": ("span_m = 2.4", "span_m = 0.0", r"wing.span_m: must be 0.001 to 1000 m, got 0"),
    "triangle": (
        "mass_kg = 5.0",
        "mass_kg = 5.0\nIxx_kg_m2 = 0.1\nIyy_kg_m2 = 0.1\nIzz_kg_m2 = 0.5",
        r"mass: the triangle rule Ixx \+ Iyy >= Izz must hold for any body, got 0.1 \+ 0.1 < 0.5 kg m2",
    ),
    "triangle about y": (
        "mass_kg = 5.0",
        "mass_kg = 5.0\nIxx_kg_m2 = 0.5\nIyy_kg_m2 = 0.1\nIzz_kg_m2 = 0.2",
        r"mass: the triangle rule Iyy \+ Izz >= Ixx must hold for any body, got 0.1 \+ 0.2 < 0.5 kg m2",
    ),
    "triangle about z": (
        "mass_kg = 5.0",
        "mass_kg = 5.0\nIxx_kg_m2 = 0.1\nIyy_kg_m2 = 0.5\nIzz_kg_m2 = 0.2",
        r"mass: the triangle rule Izz \+ Ixx >= Iyy must hold for any body, got 0.2 \+ 0.1 < 0.5 kg m2",
    ),
    "two inertias": ("mass_kg = 5.0", "mass_kg = 5.0\nIxx_kg_m2 = 0.1", r"mass: ixx_kg_m2, .* must all be given"),
    "aside": ("[0.09, 0.0, 0.0]", "[0.09, 0.3, 0.0]", r"mass: .*plane of symmetry, got y = 0.3 m"),
    "no such surface": ('surface = "fin"', 'surface = "canard"', r"control.dr.surface: must be one of wing, tail, fin"),
    "rudder on a wing": ('surface = "fin"', 'surface = "wing"', r"control.dr.surface: a rudder must be on a fin"),
    "rudder on a flat tail": ('surface = "fin"', 'surface = "tail"', r"control.dr.surface: .* a tail without dihedral"),
    "no section": ('airfoil = "naca23012"\n', "", r'wing.airfoil: the surface must have coordinates: give airfoil'),
    "no file": ("naca23012", "mine.dat", r"wing.airfoil: .*no such file lies at"),
    "empty flap": ("span_from = 0.55", "span_from = 1.0", r"control.da: span_from < span_to must hold"),
    "no propeller": ("static_thrust_N = 40\n", "", r"motor: a motor must have static_thrust_N and zero_thrust_V_m_s"),
    "fuselage runs back": ("x_m = -0.3, width", "x_m = 0.4, width", r"fuselage: x_m must rise from nose to end"),
    "twins in one place": ("y_m = 0.35\n", "", r"fin\[0\].y_m: twin fins must stand apart"),
    "limits": ("[wing]", "[limits]\nV_m_s = [20.0, 10.0]\n[wing]", r"limits.V_m_s: low < high must hold, got 20"),
}  # fmt: skip


@pytest.mark.parametrize("case", BROKEN, ids=list(BROKEN))
def test_one_fault_is_one_message(tmp_path, case):
    old, new, words = BROKEN[case]
    assert TWIN.count(old) >= 1
    path = tmp_path / "plan.toml"
    path.write_text(TWIN.replace(old, new, 1), encoding="utf-8")
    (fault,) = faults_of(path)
    assert fault.startswith(f"{path}, ")
    assert re.search(words, fault), fault


def test_all_faults_are_told_at_once(tmp_path):
    path = tmp_path / "plan.toml"
    text = TWIN.replace("naca23012", "mine.dat").replace('surface = "fin"', 'surface = "wing"')
    path.write_text(text.replace('airfoil = "naca0009"', 'airfoil = "naca99999"', 1), encoding="utf-8")
    assert [f.split(": ")[0].split(", ")[1] for f in faults_of(path)] == [
        "control.dr.surface",
        "wing.airfoil",
        "tail.airfoil",
    ]


def test_a_control_named_twice_and_files_that_are_none(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(TWIN + '\n[control.de]\nsurface = "tail"\n', encoding="utf-8")
    (fault,) = faults_of(path)
    assert re.search(r"must be TOML: Cannot declare \('control', 'de'\) twice \(at line \d+", fault)
    with pytest.raises(RecordError, match="a readable TOML file must lie at"):
        read_plan(tmp_path / "none.toml")
    (fault,) = faults_of(tmp_path / "plane.avl")
    assert "give them with --mass" in fault


def test_an_elevator_ahead_of_the_centre_moves_up(tmp_path):
    path = tmp_path / "canard.toml"
    path.write_text(
        TWIN.replace("x_m = 1.1\nz_m = 0.05\nincidence", "x_m = -1.1\nz_m = 0.05\nincidence"), encoding="utf-8"
    )
    assert [f.gain for f in read_plan(path).plane.of("tail")[0].flaps] == [-1.0]
    assert [f.gain for f in read_plan(PLANS / "twin_fins.toml").plane.of("tail")[0].flaps] == [1.0]


# Abbott and von Doenhoff, Theory of Wing Sections, appendix III, in per cent of the chord: x -> y of the upper side.
NACA_0012 = {1.25: 1.894, 5.0: 3.555, 10.0: 4.683, 30.0: 6.002, 60.0: 4.563, 90.0: 1.448}
NACA_2412_UPPER = {5.0: 4.13, 10.0: 5.63, 20.0: 7.26, 30.0: 7.88, 40.0: 7.80, 60.0: 6.36, 80.0: 3.75}


def test_symmetric_ordinates_are_those_printed():
    points = naca("0012")
    upper = points[: np.argmin(points[:, 0]) + 1][::-1]
    for x, y in NACA_0012.items():
        assert np.interp(x / 100.0, upper[:, 0], upper[:, 1]) == pytest.approx(y / 100.0, abs=1e-4)


def test_cambered_ordinates_are_those_printed():
    points = naca("2412")
    upper = points[: np.argmin(points[:, 0]) + 1][::-1]
    for x, y in NACA_2412_UPPER.items():
        assert np.interp(x / 100.0, upper[:, 0], upper[:, 1]) == pytest.approx(y / 100.0, abs=1e-4)


def test_mean_lines():
    x, z = airfoil("naca4408").camber
    assert np.interp(0.4, x, z) == pytest.approx(0.04, abs=2e-4)
    x, z = airfoil("NACA 23012").camber
    assert z.max() == pytest.approx(0.0184, abs=2e-4)
    assert x[np.argmax(z)] == pytest.approx(0.15, abs=0.02)


def test_files_in_three_orders_give_one_section(tmp_path):
    selig = naca("2412")
    nose = int(np.argmin(selig[:, 0]))
    upper, lower = selig[: nose + 1][::-1], selig[nose:]

    def text(rows):
        return "\n".join(f"{x:.6f} {y:.6f}" for x, y in rows)

    (tmp_path / "selig.dat").write_text("NACA 2412\n" + text(selig))
    (tmp_path / "below.dat").write_text("from below\n" + text(3.0 * selig[::-1] + [1.0, 2.0]))
    (tmp_path / "lednicer.dat").write_text(f"x\n{len(upper)}. {len(lower)}.\n\n{text(upper)}\n\n{text(lower)}\n")
    _, known = airfoil("naca2412").camber
    for name in ("selig.dat", "below.dat", "lednicer.dat"):
        _, z = airfoil(name, tmp_path).camber
        assert np.abs(z - known).max() < 3e-4, name


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("naca99999", "the middle two must be 10, 20"),
        ("naca2400", "thickness"),
        ("naca4008", "camber behind the nose"),
        ("e205", "no such file lies at"),
        ("empty.dat", "at least ten rows"),
        ("line.dat", "round the nose and back"),
    ],
)
def test_what_is_no_section_is_refused(tmp_path, name, words):
    (tmp_path / "empty.dat").write_text("E 205\n")
    (tmp_path / "line.dat").write_text("\n".join(f"{i / 20} 0.0" for i in range(20)))
    with pytest.raises(ScenarioError, match=words):
        airfoil(name, tmp_path)


def test_digits_that_are_none_are_refused():
    """An AVL file's NACA line may say anything."""
    with pytest.raises(ScenarioError, match="digits must be digits"):
        naca("24q2")
