"""A drawing of a model that nobody has drawn, from the areas and arms in its ``<metrics>``: for orientation only."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

from testbench.aircraft.outline import Outline, Surface
from testbench.core.constants import JSBSIM_AREA_M2, JSBSIM_LENGTH_M

_ASPECT_TAIL, _ASPECT_FIN, _TAPER = 4.0, 1.4, 0.6  # of a usual aircraft
_NOSE_SHARE = 0.6  # of the tail's arm, ahead of the centre of gravity
_SLENDER = 9.0  # length over diameter of the fuselage
_PLAUSIBLE_ARM = 0.15  # of the span, at least


def sketch(tree: ET.Element) -> Outline | None:
    """Return a drawing of a model, or None if its metrics do not say where its tail is and how large.

    Wing, tail and fin are trapezoids of the areas and span that ``<metrics>`` gives, at its arms; the fuselage is a
    spindle.
    """
    S, b = _metric(tree, "wingarea"), _metric(tree, "wingspan")
    area, arm = _metric(tree, "htailarea"), _metric(tree, "htailarm")
    fin_area, fin_arm = _metric(tree, "vtailarea"), _metric(tree, "vtailarm")
    if not (S and b and area and arm and arm > _PLAUSIBLE_ARM * b):
        return None
    root = 2.0 * S / b / (1.0 + _TAPER)
    span = math.sqrt(_ASPECT_TAIL * area)
    tail_root = 2.0 * area / span / (1.0 + _TAPER)
    fin_area = fin_area or 0.6 * area
    height = math.sqrt(_ASPECT_FIN * fin_area)
    fin_root = 2.0 * fin_area / height / (1.0 + _TAPER)
    nose, end = _NOSE_SHARE * arm, -arm - 0.5 * tail_root
    radius = 0.5 * (nose - end) / _SLENDER
    body = [
        (nose, 0.0, -0.05 * radius, 0.05 * radius),
        (nose - 0.8 * radius, 0.6 * radius, -0.6 * radius, 0.6 * radius),
        (nose - 2.5 * radius, radius, -radius, radius),
        (-0.3 * arm, radius, -radius, radius),
        (end, 0.15 * radius, 0.2 * radius, 0.6 * radius),
    ]
    return Outline(
        note=(
            "A sketch from the areas, arms and span in the model's metrics; everything else has usual proportions, and "
            "nothing of it enters a flight."
        ),
        wing=Surface(span_m=b, root_chord_m=root, tip_chord_m=_TAPER * root, x_m=0.0),
        tail=Surface(span_m=span, root_chord_m=tail_root, tip_chord_m=_TAPER * tail_root, x_m=-arm, z_m=0.3 * radius),
        fin=Surface(
            span_m=height,
            root_chord_m=fin_root,
            tip_chord_m=_TAPER * fin_root,
            x_m=-(fin_arm if fin_arm and fin_arm > _PLAUSIBLE_ARM * b else arm) + 0.1 * fin_root,
            z_m=0.5 * radius,
            sweep_deg=20.0,
        ),
        body_m=tuple(body),
        sketched=True,
    )


def _metric(tree: ET.Element, name: str) -> float:
    """Return a metric in SI, 0 if it is not there or no number."""
    element = tree.find(f"metrics/{name}")
    if element is None:
        return 0.0
    units = JSBSIM_AREA_M2 if name.endswith("area") else JSBSIM_LENGTH_M
    try:
        return float(element.text or "nan") * units.get((element.get("unit") or "FT").upper(), math.nan) or 0.0
    except ValueError:
        return 0.0
