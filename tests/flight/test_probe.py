"""Controls of models that are written in another way: mixed surfaces, other axes, one side that is still."""

import numpy as np
import pytest

from testbench.core.constants import DEG_RAD
from testbench.core.errors import ModelError
from testbench.core.paths import AIRCRAFT_MODELS
from testbench.flight import FlightCondition, linearise, load_aircraft, trim

TAURUS = (AIRCRAFT_MODELS / "taurus" / "taurus.xml").read_text(encoding="utf-8")
CONDITION = FlightCondition(12.0, 100.0)

# A control system that mixes stick and aileron into two elevons, in degrees, the left one counted the other way round.
ELEVONS = """
<channel name="elevons">
  <fcs_function name="fcs/left-elevon"> <function> <sum>
    <product> <value>12.5</value> <property>fcs/elevator-cmd-norm</property> </product>
    <product> <value>10.0</value> <property>fcs/aileron-cmd-norm</property> </product>
  </sum> </function> <output>fcs/left-elevon-pos-deg</output> </fcs_function>
  <fcs_function name="fcs/right-elevon"> <function> <sum>
    <product> <value>12.5</value> <property>fcs/elevator-cmd-norm</property> </product>
    <product> <value>-10.0</value> <property>fcs/aileron-cmd-norm</property> </product>
  </sum> </function> <output>fcs/right-elevon-pos-deg</output> </fcs_function>
</channel>
"""
_BOTH = "<sum> <property>fcs/left-elevon-pos-deg</property> <property>fcs/right-elevon-pos-deg</property> </sum>"
_SIDES = (
    "<difference> <property>fcs/left-elevon-pos-deg</property> <property>fcs/right-elevon-pos-deg</property> "
    "</difference>"
)


def half_of(term):
    return f"<product> <value>{0.5 * DEG_RAD!r}</value> {term} </product>"


@pytest.fixture
def models(tmp_path):
    """Write a model into a folder and load it as somebody else's, without an aircraft.toml."""

    def made(name, xml):
        folder = tmp_path / name
        (folder / "Engines").mkdir(parents=True)
        for file in (AIRCRAFT_MODELS / "taurus" / "Engines").glob("*.xml"):
            (folder / "Engines" / file.name).write_bytes(file.read_bytes())
        (folder / f"{name}.xml").write_text(xml, encoding="utf-8")
        return load_aircraft(folder)

    return made


def elevons():
    head, aerodynamics = TAURUS.split("<aerodynamics>")
    aerodynamics = aerodynamics.replace("<property>fcs/elevator-pos-rad</property>", half_of(_BOTH))
    aerodynamics = aerodynamics.replace("<property>fcs/left-aileron-pos-rad</property>", half_of(_SIDES))
    head = head.replace('<channel name="thrust">', f'{ELEVONS}<channel name="thrust">')
    return f"{head}<aerodynamics>{aerodynamics}"


def test_a_model_in_our_own_form_is_probed_to_what_its_file_says(models):
    ours, probed = load_aircraft("taurus"), models("plain", TAURUS)
    assert probed.controls.keys() == ours.controls.keys()
    for name in ("de", "da", "dr"):
        assert probed.controls[name].full == pytest.approx(ours.controls[name].full, rel=1e-6)
        assert probed.controls[name].low == pytest.approx(ours.controls[name].low, rel=1e-6)
        assert probed.adapter.link(name).lag_rad_s == pytest.approx(33.0, rel=0.1)
        assert probed.adapter.link(name).rate_limit_rad_s == pytest.approx(2.618, rel=0.05)
    one, two = trim(ours, CONDITION), trim(probed, CONDITION)
    assert two.alpha == pytest.approx(one.alpha, abs=1e-7)
    assert two.controls["de"] == pytest.approx(one.controls["de"], abs=1e-7)
    rigid = [sorted(linearise(a, t).longitudinal().poles(), key=abs) for a, t in ((ours, one), (probed, two))]
    assert rigid[1] == pytest.approx(rigid[0], rel=1e-5, abs=1e-6)


def test_elevons_follow_two_controls_that_remain_the_users(models):
    mixed, plain = models("wing", elevons()), load_aircraft("taurus")
    moved = {control: {d.name for d in mixed.adapter.link(control).drives} for control in ("de", "da")}
    assert moved["de"] == moved["da"] == {"fcs/left-elevon-pos-deg", "fcs/right-elevon-pos-deg"}
    assert mixed.controls["de"].full == pytest.approx(12.5 * DEG_RAD, rel=1e-6)
    assert mixed.controls["da"].full == pytest.approx(10.0 * DEG_RAD, rel=1e-6)
    one, two = trim(plain, CONDITION), trim(mixed, CONDITION)
    assert two.controls["de"] == pytest.approx(one.controls["de"], abs=1e-7)
    for name in ("Cm_de", "Cl_da", "Cn_da", "CL_de"):
        assert mixed.coefficient(name) == pytest.approx(plain.coefficient(name), rel=1e-6), name
    assert abs(mixed.coefficient("Cl_de")) < 1e-9
    assert abs(mixed.coefficient("Cm_da")) < 1e-9


def test_normal_and_axial_axes_trim_and_have_coefficients(models):
    xml = TAURUS.replace('<axis name="LIFT">', '<axis name="NORMAL">').replace(
        '<axis name="DRAG">', '<axis name="AXIAL">'
    )
    body = models("axes", xml)
    trimmed = trim(body, FlightCondition(body.design_V_m_s, body.design_h_m))
    assert np.abs(trimmed.residual).max() < 1e-6
    a = trimmed.alpha
    normal = 4.58 * np.cos(a)  # CL = N cos(alpha) - A sin(alpha), with N the lift of the file
    assert body.coefficient("CL_alpha") == pytest.approx(normal, rel=0.1)
    assert body.coefficient("Cm_alpha") == pytest.approx(-0.723, rel=1e-6)
    assert np.isfinite(linearise(body, trimmed).A).all()


def test_an_aileron_of_which_one_side_is_still_is_noted(tmp_path):
    from testbench.flight.load import adopted_at

    folder = tmp_path / "half"
    (folder / "Engines").mkdir(parents=True)
    for file in (AIRCRAFT_MODELS / "taurus" / "Engines").glob("*.xml"):
        (folder / "Engines" / file.name).write_bytes(file.read_bytes())
    half = "<sum> <property>fcs/left-aileron-pos-rad</property> <property>fcs/right-aileron-pos-rad</property> </sum>"
    head, aerodynamics = TAURUS.split("<aerodynamics>")
    (folder / "half.xml").write_text(
        f"{head}<aerodynamics>{aerodynamics.replace('<property>fcs/left-aileron-pos-rad</property>', half)}",
        encoding="utf-8",
    )
    found = adopted_at(folder).found
    assert any("reads fcs/right-aileron-pos-rad, which fcs/aileron-cmd-norm does not move" in s for s in found)


def test_an_aircraft_that_never_leaves_the_ground_is_refused(models):
    head, _ = TAURUS.split("<aerodynamics>")
    with pytest.raises(ModelError, match="control surfaces"):
        models("taxi", f"{head}<aerodynamics> <axis name='LIFT'/> </aerodynamics> </fdm_config>")
