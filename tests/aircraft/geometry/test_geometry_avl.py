"""AVL files of several kinds, written after the AVL User Primer: read, noted or refused, never dropped in silence."""

import re
from pathlib import Path

import numpy as np
import pytest

from testbench.aircraft.geometry.avl import read_avl
from testbench.aircraft.geometry.read import read_plan
from testbench.core.errors import ScenarioError

PLANS = Path(__file__).parent / "plans"
ALL = {"de": None, "da": None, "dr": None}
HEAD = "A plane\n0.0\n0 0 0.0\n1.0 0.5 2.0\n0.1 0 0\n"


def section(x, y, z, chord, more="NACA\n0010\n"):
    return f"SECTION\n{x} {y} {z} {chord} 0.0\n{more}"


def surface(name, *parts):
    return f"SURFACE\n{name}\n8 1.0\n" + "".join(parts)


WING = surface("Wing", "YDUPLICATE\n0\n", section(0, 0, 0, 0.5), section(0.1, 1, 0.1, 0.4))


def read(tmp_path, text, controls=None, **more):
    path = tmp_path / "plane.avl"
    path.write_text(text, encoding="utf-8")
    return read_avl(path, {} if controls is None else controls, **more)


def refused(tmp_path, text, controls=None):
    with pytest.raises(ScenarioError) as found:
        read(tmp_path, text, controls)
    return found.value.faults


def test_a_trainer_with_everything():
    plan = read_plan(PLANS / "trainer.avl", PLANS / "trainer_mass.toml")
    plane = plan.plane
    assert (plan.title, plane.S_m2, plane.b_m, plane.cbar_m) == ("Plain trainer", 0.48, 1.6, 0.3)
    wing, tail, fin = plane.surfaces
    assert [s.role for s in plane.surfaces] == ["wing", "tail", "fin"]
    assert [s.twist_deg for s in wing.stations] == [2.0, 2.0, 2.0]  # ANGLE
    assert [s.z_m for s in wing.stations] == pytest.approx([0.05, 0.07, 0.09])  # TRANSLATE
    (aileron,) = wing.flaps
    assert (aileron.moves, aileron.start, aileron.end) == ("da", pytest.approx(0.5), 1.0)
    assert aileron.chord_fraction == pytest.approx(0.25)
    assert aileron.gain == 1.0  # -1 in the file: the sign is that of the testbench
    assert tail.stations[0].airfoil.file is not None
    assert not fin.mirrored
    assert fin.span_m == pytest.approx(0.22)
    said = "; ".join(plane.notes)
    for words in ("CDp = 0.02", "CLAF", "BODY 'Fuselage'", "gain of the CONTROL taken as da is negative"):
        assert words in said


def test_a_body_is_the_fuselage_where_its_file_lies_beside(tmp_path):
    x = np.linspace(0.0, 1.0, 21)
    radius = 0.06 * np.sqrt(np.clip(1.0 - (2.0 * x - 1.0) ** 2, 0.0, None))
    rows = [*zip(x[::-1], radius[::-1], strict=True), *zip(x[1:], -radius[1:], strict=True)]
    (tmp_path / "fuse.dat").write_text("pod\n" + "\n".join(f"{a:.6f} {b:.6f}" for a, b in rows))
    wing = surface("Wing", "YDUPLICATE\n0\n", section(0, 0, 0, 0.5), section(0, 1, 0, 0.5))
    body = "BODY\nPod\n20 1.0\nSCALE\n2.0 1.0 1.5\nTRANSLATE\n-0.4 0 0.1\nBFILE\nfuse.dat\n"
    found = read(tmp_path, HEAD + wing + body, unit_m=0.5)
    assert not [note for note in found.notes if "BODY" in note]
    assert (found.body[0].x_m, found.body[-1].x_m) == (pytest.approx(-0.2), pytest.approx(0.8))
    middle = found.body[10]
    assert (middle.width_m, middle.height_m) == (pytest.approx(0.5 * 1.5 * 0.12), pytest.approx(0.5 * 1.5 * 0.12))
    assert middle.z_m == pytest.approx(0.05)
    assert found.body[0].width_m == pytest.approx(0.0)
    twin = read(tmp_path, HEAD + wing + body.replace("BFILE", "YDUPLICATE\n0\nBFILE"))
    assert not twin.body
    assert "beside the plane of symmetry" in "; ".join(twin.notes)
    (tmp_path / "fuse.dat").write_text("pod\n" + "\n".join(f"{a:.6f} {b:.6f}" for a, b in rows[:12]))
    (law,) = refused(tmp_path, HEAD + wing + body)
    assert "from its tail over the nose and back" in law


def test_scale_unit_and_image_plane(tmp_path):
    text = HEAD.replace("0 0 0.0", "1 0 0.0") + surface(
        "Wing", "SCALE\n2.0 1.0 1.0\nTRANSLATE\n0.5 0 0\n", section(0.1, 0, 0, 0.5), section(0.1, 1, 0, 0.5)
    )
    found = read(tmp_path, text, unit_m=0.3048)
    (wing,) = found.surfaces
    assert wing.mirrored  # iYsym = 1
    assert wing.stations[0].x_m == pytest.approx(0.3048 * (0.1 * 2.0 + 0.5))
    assert wing.stations[0].chord_m == pytest.approx(0.3048)
    assert found.S_m2 == pytest.approx(0.3048**2)


def test_a_wing_in_two_surfaces_is_one(tmp_path):
    control = "CONTROL\naileron 1.0 0.75 0 0 0 -1\n"
    inner = surface("Inner", "COMPONENT\n1\nYDUPLICATE\n0\n", section(0, 0, 0, 0.5), section(0, 0.5, 0, 0.5))
    outer = surface(
        "Outer", "COMPONENT\n1\nYDUPLICATE\n0\n", section(0, 0.5, 0, 0.5, "NACA\n0010\n" + control),
        section(0.1, 1, 0.2, 0.3, "NACA\n0010\n" + control),
    )  # fmt: skip
    (wing,) = read(tmp_path, HEAD + inner + outer, {"da": None}).surfaces
    assert [s.y_m for s in wing.stations] == [0.0, 0.5, 1.0]
    (flap,) = wing.flaps
    assert flap.start == pytest.approx(0.5 / wing.length_m)
    assert flap.end == pytest.approx(1.0)


def test_v_tail_and_elevons_and_coordinates_in_the_file(tmp_path):
    both = "CONTROL\npitch 1.0 0.7 0 0 0 1\nCONTROL\nyaw 0.5 0.7 0 0 0 -1\n"
    points = "AIRFOIL\n" + "\n".join(f"{x} {y}" for x, y in [
        (1, 0), (0.8, 0.03), (0.5, 0.06), (0.3, 0.06), (0.1, 0.045), (0.0, 0), (0.1, -0.045), (0.3, -0.06),
        (0.5, -0.06),
        (0.8, -0.03), (1, 0)
    ]) + "\n"  # fmt: skip
    tail = surface(
        "V", "YDUPLICATE\n0\n", section(3, 0, 0, 0.3, points + both), section(3.1, 0.4, 0.3, 0.2, points + both)
    )
    plan = read(tmp_path, HEAD + WING + tail, {"de": "pitch", "dr": "yaw"})
    assert [(f.moves, f.gain) for f in plan.surfaces[1].flaps] == [("de", 1.0), ("dr", 1.0)]
    assert plan.surfaces[1].role == "tail"


def test_twin_fins_and_controls_that_nobody_named(tmp_path):
    fins = surface("Fins", "YDUPLICATE\n0\n", section(3, 0.5, 0, 0.3), section(3.1, 0.5, 0.4, 0.2))
    flap = WING.replace("NACA\n0010\n", "NACA\n0010\nCONTROL\nflap 1 0.8 0 0 0 1\nDESIGN\ntwist 1.0\n")
    found = read(tmp_path, HEAD + flap + fins)
    assert [s.role for s in found.surfaces] == ["wing", "fin"]
    assert found.surfaces[1].mirrored
    assert any("CONTROL 'flap' left out" in n for n in found.notes)
    assert sum("DESIGN" in n for n in found.notes) == 2


def test_a_second_wing_is_told(tmp_path):
    upper = surface("Upper", "YDUPLICATE\n0\n", section(0.1, 0, 0.5, 0.4), section(0.1, 1, 0.5, 0.4))
    found = read(tmp_path, HEAD + WING + upper)
    assert [s.role for s in found.surfaces] == ["wing", "wing"]
    assert any("treats each by itself: Upper" in n for n in found.notes)


REFUSED = {
    "cut": (WING[: WING.rindex("NACA") + 5], None, r"line \d+: the file ends where the digits of a NACA section"),
    "cut earlier": (WING[: WING.rindex("SECTION")], None, r"'Wing' must have at least two sections, got 1; .* cut"),
    "no surface": ("", None, r"must hold a SURFACE"),
    "keyword": (WING.replace("YDUPLICATE", "XDUPLICATE"), None, r"a keyword must stand here, got 'XDUP.*; did you"),
    "flat plate": (WING.replace("NACA\n0010\n", ""), None, r"section 1 of surface 'Wing' must have coordinates"),
    "no numbers": (WING.replace("0.1 1 0.1 0.4", "0.1 one"), None, r"Xle Yle Zle Chord Ainc must be 5 numbers, got"),
    "no load": (WING.replace("YDUP", "NOLOAD\nYDUP"), None, r"NOLOAD cannot be carried over"),
    "mirror": (WING.replace("YDUPLICATE\n0", "YDUPLICATE\n0.5"), None, r"mirrored in y = 0"),
    "file": (WING.replace("NACA\n0010", "AFILE\nnone.dat", 1), None, r"line \d+: .*no such file lies at"),
    "throw": (WING.replace("NACA\n0010\n", "NACA\n0010\nCONTROL\naileron 1 .8 0 0 0 -1\n"), None, r"needs its throw"),
    "name": (WING, {"da": "ailerons"}, r"\[control.da\] names 'ailerons', which no CONTROL line has"),
    "sign": (
        WING.replace("NACA\n0010\n", "NACA\n0010\nCONTROL\naileron 1 .8 0 0 0 1\n"), {"da": None},
        r"must move the sides against each other \(SgnDup -1\), got 1",
    ),
    "slat": (WING.replace("NACA\n0010\n", "NACA\n0010\nCONTROL\nail 1 -.2 0 0 0 -1\n"), {"da": None}, r"trailing edge"),
    "both sides": (surface("W", section(0, -1, 0, 1), section(0, 1, 0, 1)), None, r"one side with YDUPLICATE"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED, ids=list(REFUSED))
def test_what_cannot_be_carried_over_is_refused_with_its_line(tmp_path, case):
    text, controls, words = REFUSED[case]
    (fault,) = refused(tmp_path, HEAD + text, controls)
    assert re.search(words, fault), fault
    assert "plane.avl" in fault


def test_a_trainer_cut_anywhere_ends_in_words(tmp_path):
    lines = (PLANS / "trainer.avl").read_text(encoding="utf-8").splitlines(keepends=True)
    (tmp_path / "tail.dat").write_bytes((PLANS / "tail.dat").read_bytes())
    whole, said = 0, []
    for n in range(len(lines)):
        try:
            read(tmp_path, "".join(lines[:n]), ALL)
            whole += 1
        except ScenarioError as error:
            said.append(str(error))
    assert all("plane.avl" in words for words in said)
    assert whole <= 8  # from the rudder's last line on, the file is an aircraft: its body may be missing or cut


def test_an_all_moving_tail_and_a_section_over_its_whole_chord_are_read(tmp_path):
    control = "CONTROL\nelevator 1.0 0.0 0 1 0 1\n"
    tail = surface(
        "Tail", "YDUPLICATE\n0\n", section(1.0, 0, 0, 0.2, "NACA 0.0 1.0\n0010\n" + control),
        section(1.0, 0.3, 0, 0.2, "NACA\n0010\n" + control),
    )  # fmt: skip
    _, found = read(tmp_path, HEAD + WING + tail, {"de": None}).surfaces
    (flap,) = found.flaps
    assert flap.chord_fraction == 1.0
    (fault,) = refused(tmp_path, HEAD + WING + tail.replace("0.0 1.0", "0.2 1.0"), {"de": None})
    assert "must take the whole chord, X1 X2 = 0 1, got 0.2 1.0" in fault
    (fault,) = refused(tmp_path, HEAD + WING + tail.replace("1.0 0.0 0 1 0 1", "1.0 -0.3 0 1 0 1"), {"de": None})
    assert "or move the whole surface (0)" in fault
