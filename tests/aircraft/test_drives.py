"""Components that move properties with the controls, evaluated as JSBSim would; amended properties; sketches."""

import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from testbench.aircraft.adapter import Drive, Link, _drive
from testbench.aircraft.amend import SetProperty
from testbench.aircraft.outline import sketch
from testbench.core.errors import ModelError


def value(component: ET.Element, u: dict[str, float]) -> float:
    """Return what the component writes for deflections by property: JSBSim's gain, surface scale, or sum of tables."""
    if component.tag == "pure_gain":
        return float(component.findtext("gain")) * u[component.findtext("input")]
    if component.tag == "aerosurface_scale":
        x = u[component.findtext("input")]
        end = "max" if x > 0.0 else "min"
        return x / float(component.findtext(f"domain/{end}")) * float(component.findtext(f"range/{end}"))
    total = 0.0
    for part in component.find("function/sum"):
        if part.tag == "value":
            total += float(part.text)
        else:
            rows = np.array(
                [[float(w) for w in line.split()] for line in part.findtext("tableData").strip().split("\n")]
            )
            total += float(np.interp(u[part.findtext("independentVar")], *rows.T))
    return total


CURVES = {
    "a gain": ((-0.4, -0.8), (0.4, 0.8)),
    "a line that misses zero": ((-0.4, -0.7), (0.4, 0.9)),
    "another slope on either side": ((-0.4, -1.0), (0.0, 0.0), (0.3, 0.5)),
    "a kink elsewhere": ((-0.4, -1.0), (0.1, 0.2), (0.3, 0.5)),
    "a curve": ((-0.4, -1.0), (-0.1, -0.1), (0.0, 0.0), (0.2, 0.1), (0.4, 0.6)),
}


@pytest.mark.parametrize("name", CURVES)
def test_a_drive_follows_its_points(name):
    link = Link("de", (Drive("fcs/x", CURVES[name]),))
    component = _drive("fcs/x", [(link.surface, link.drives[0])])
    for x in np.linspace(-0.4, CURVES[name][-1][0], 17):
        expected = np.interp(x, *np.array(CURVES[name]).T)
        assert value(component, {link.surface: x}) == pytest.approx(expected, abs=1e-12)
    assert component.findtext("output") == "fcs/x"


def test_two_controls_of_one_property_add_up_and_its_value_at_rest_counts_once():
    de, da = (
        Link(c, (Drive("fcs/x", CURVES[n]),))
        for c, n in (("de", "a line that misses zero"), ("da", "a kink elsewhere"))
    )
    component = _drive("fcs/x", [(link.surface, link.drives[0]) for link in (de, da)])
    rest = np.interp(0.0, *np.array(CURVES["a kink elsewhere"]).T)
    for x, y in ((0.0, 0.0), (0.3, 0.0), (0.0, -0.2), (-0.3, 0.25)):
        expected = sum(np.interp(u, *np.array(link.drives[0].points).T) for u, link in ((x, de), (y, da))) - rest
        assert value(component, {de.surface: x, da.surface: y}) == pytest.approx(expected, abs=1e-12)


def test_an_amended_property_is_the_one_that_is_declared_with_a_value():
    tree = ET.fromstring(
        '<fdm_config><output><property>a/b</property></output><property value="1.0"> a/b </property>'
        '<property value="2.0">a/c</property></fdm_config>'
    )
    SetProperty("a/b", 3.5).apply(tree, None)
    assert [e.get("value") for e in tree.iter("property")] == [None, "3.5", "2.0"]
    with pytest.raises(ModelError, match="must be declared in the model, got 'a/d'"):
        SetProperty("a/d", 1.0).apply(tree, None)


def test_a_sketch_has_the_areas_spans_and_arms_of_the_metrics():
    said = {"wingarea": 20.0, "wingspan": 12.0, "htailarea": 4.0, "htailarm": 6.0, "vtailarea": 2.5, "vtailarm": 5.5}
    units = {n: "M2" if n.endswith("area") else "M" for n in said}
    metrics = "".join(f'<{n} unit="{units[n]}">{v}</{n}>' for n, v in said.items())
    drawn = sketch(ET.fromstring(f"<fdm_config><metrics>{metrics}</metrics></fdm_config>"))
    for part, area, span in ((drawn.wing, 20.0, 12.0), (drawn.tail, 4.0, math.sqrt(4.0 * 4.0)), (drawn.fin, 2.5, None)):
        assert 0.5 * (part.root_chord_m + part.tip_chord_m) * part.span_m == pytest.approx(area)
        assert part.tip_chord_m / part.root_chord_m == pytest.approx(0.6)
        assert span is None or part.span_m == pytest.approx(span)
    assert drawn.fin.span_m**2 / 2.5 == pytest.approx(1.4)
    assert drawn.tail.x_m == -6.0
    nose, end = drawn.body_m[0][0], drawn.body_m[-1][0]
    assert nose == pytest.approx(0.6 * 6.0)
    assert end == pytest.approx(-6.0 - 0.5 * drawn.tail.root_chord_m)  # where the tail's root ends
    assert max(row[1] for row in drawn.body_m) == pytest.approx(0.5 * (nose - end) / 9.0)
