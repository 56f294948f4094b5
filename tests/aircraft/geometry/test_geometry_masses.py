"""Mass, centre of gravity and inertias from items: solved cases, and JSBSim's own sum of point masses."""

from types import SimpleNamespace

import jsbsim
import pytest

from testbench.aircraft.geometry.masses import balance, of_items
from testbench.aircraft.geometry.model_xml import Polar, model_xml
from testbench.aircraft.geometry.schema import Item, Mass
from testbench.core.constants import FT_M, SLUG_KG
from testbench.core.errors import ScenarioError


def item(m, at, **more):
    return Item(name="x", mass_kg=m, at_m=at, **more)


def test_a_box_about_its_own_middle():
    found = of_items([item(12.0, (1.0, 0.0, 2.0), size_m=(3.0, 2.0, 1.0))])
    assert (found.mass_kg, found.cg_m) == (12.0, (1.0, 0.0, 2.0))
    assert (found.Ixx, found.Iyy, found.Izz, found.Ixz) == pytest.approx((5.0, 10.0, 13.0, 0.0))


def test_two_masses_on_a_slanted_line_and_one_aside():
    """Tail up: x forward is negative there, z down is negative, so that their product and Ixz are positive."""
    found = of_items(
        [item(1.0, (-1.0, 0.0, -0.5)), item(1.0, (1.0, 0.0, 0.5)), item(0.5, (0.0, 2.0, 0.0), mirrored=True)]
    )
    assert found.cg_m == pytest.approx((0.0, 0.0, 0.0))
    assert (found.Ixx, found.Iyy, found.Izz, found.Ixz) == pytest.approx((4.5, 2.5, 6.0, 1.0))


def test_jsbsim_sums_the_same_point_masses_to_the_same_inertias(tmp_path):
    items = [
        item(1.0, (-0.8, 0.0, -0.3)), item(0.7, (1.1, 0.0, 0.5)), item(0.5, (0.2, 1.5, 0.1), mirrored=True)
    ]  # fmt: skip
    b = of_items(items)
    reference = SimpleNamespace(S_m2=1.0, b_m=1.0, cbar_m=1.0)
    plan = SimpleNamespace(title="t", plane=reference, balance=b, servos={}, said=SimpleNamespace(motor=None))
    ours = model_xml("ours", "n", plan, {}, Polar(0.0, 0.0, 0.0), None)
    points = "".join(
        f'<pointmass name="p{i}{s}"><weight unit="KG">{x.mass_kg}</weight><location name="POINTMASS" unit="M">'
        f"<x>{x.at_m[0]}</x><y>{s * x.at_m[1]}</y><z>{x.at_m[2]}</z></location></pointmass>"
        for i, x in enumerate(items)
        for s in ((1, -1) if x.mirrored else (1,))
    )
    head, rest = ours.split("<mass_balance>")
    theirs = (
        head + '<mass_balance><ixx unit="KG*M2">1e-9</ixx><iyy unit="KG*M2">1e-9</iyy><izz unit="KG*M2">1e-9</izz>'
        '<emptywt unit="KG">1e-9</emptywt><location name="CG" unit="M"><x>0</x><y>0</y><z>0</z></location>'
        + points + "</mass_balance>" + rest.split("</mass_balance>")[1]
    )  # fmt: skip
    found = []
    for name, text in (("ours", ours), ("theirs", theirs)):
        (tmp_path / "aircraft" / name).mkdir(parents=True)
        (tmp_path / "aircraft" / name / f"{name}.xml").write_text(text)
        jsbsim.set_logger(jsbsim.FGLogger())
        fdm = jsbsim.FGFDMExec(str(tmp_path))
        assert fdm.load_model(name)
        fdm.run_ic()
        assert fdm.get_mass_balance().get_J()[0, 2] == pytest.approx(-b.Ixz / SLUG_KG / FT_M**2, rel=1e-4), name
        inertia = [fdm[f"inertia/i{axis}-slugs_ft2"] * SLUG_KG * FT_M**2 for axis in ("xx", "yy", "zz", "xz")]
        found.append([fdm["inertia/mass-slugs"] * SLUG_KG, *inertia])
    assert found[0] == pytest.approx(found[1], rel=1e-4)
    assert found[0] == pytest.approx([b.mass_kg, b.Ixx, b.Iyy, b.Izz, -b.Ixz], rel=1e-4)


def test_radii_of_gyration_and_what_makes_no_body():
    found = balance(Mass(mass_kg=2.0, cg_m=(0.1, 0.0, 0.0)), 2.0, 1.0)
    assert found.Ixx == pytest.approx(2.0 * 0.25**2)
    assert found.Iyy == pytest.approx(2.0 * (0.38 * 0.5) ** 2)
    assert "estimated" in found.source
    with pytest.raises(ScenarioError, match="plane of symmetry"):
        balance(Mass(mass_kg=2.0, cg_m=(0.1, 0.3, 0.0)), 2.0, 1.0)
    with pytest.raises(ScenarioError, match="inertia about every axis"):
        of_items([item(1.0, (0.0, 0.0, 0.0)), item(1.0, (1.0, 0.0, 0.0))])
