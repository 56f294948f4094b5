"""What an aircraft looks like, for drawings only: lifting surfaces as trapezoids, the fuselage as a row of sections.

Places count from the centre of gravity: x forward, y along the right wing, z up, m. Nothing here enters a flight.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from functools import partial
from itertools import pairwise
from typing import Annotated

from pydantic import Field

from testbench.core.constants import JSBSIM_AREA_M2, JSBSIM_LENGTH_M
from testbench.core.escape import real, toml_value
from testbench.core.schema import NonNegative, Positive, Strict

_ASPECT_TAIL, _ASPECT_FIN, _TAPER = 4.0, 1.4, 0.6  # of a usual aircraft
_NOSE_SHARE = 0.6  # of the tail's arm, ahead of the centre of gravity
_SLENDER = 9.0  # length over diameter of the fuselage
_PLAUSIBLE_ARM = 0.15  # of the span, at least


def centroid(taper: float) -> float:
    """Return how far from its root the centre of the area of a trapezoid lies, as a share of its length."""
    return (1.0 + 2.0 * taper) / (3.0 * (1.0 + taper))


class Surface(Strict):
    """A trapezoidal wing or tail over both sides, or a fin that stands on its root.

    Attributes:
        span_m: from tip to tip; of a fin, its height.
        root_chord_m: in the plane of symmetry; of a fin, at its foot.
        tip_chord_m: at the tips.
        x_m: quarter chord of the root, ahead of the centre of gravity.
        z_m: root above the centre of gravity.
        sweep_deg: of the quarter-chord line, backwards.
        dihedral_deg: tips up.
        y_m: of a pair of fins, how far each stands from the plane of symmetry; 0 for a single fin and for all else.
    """

    span_m: Positive
    root_chord_m: Positive
    tip_chord_m: Positive
    x_m: float
    z_m: float = 0.0
    sweep_deg: Annotated[float, Field(gt=-80.0, lt=80.0)] = 0.0
    dihedral_deg: Annotated[float, Field(gt=-80.0, lt=80.0)] = 0.0
    y_m: NonNegative = 0.0

    @property
    def area_m2(self) -> float:
        """Area of the trapezoid."""
        return 0.5 * (self.root_chord_m + self.tip_chord_m) * self.span_m

    @property
    def mean_chord_m(self) -> float:
        """Mean aerodynamic chord of the trapezoid, (2/3) c (1 + t + t^2) / (1 + t) with taper t."""
        taper = self.tip_chord_m / self.root_chord_m
        return 2.0 / 3.0 * self.root_chord_m * (1.0 + taper + taper**2) / (1.0 + taper)

    @property
    def aspect_ratio(self) -> float:
        """Square of the span over the area."""
        return self.span_m**2 / self.area_m2

    @property
    def centroid(self) -> float:
        """How far out the centre of the area of one side lies, as a share of the side."""
        return centroid(self.tip_chord_m / self.root_chord_m)

    def mean_quarter_m(self, side_m: float) -> float:
        """Return x of the quarter chord of the mean aerodynamic chord of a side of this length."""
        return self.point(self.centroid * side_m, side_m, 0.25)[0]

    def chord_m(self, s_m: float, half_m: float) -> float:
        """Return the chord ``s_m`` from the root of a side of length ``half_m``."""
        return self.root_chord_m + (self.tip_chord_m - self.root_chord_m) * s_m / half_m

    def point(self, s_m: float, half_m: float, fraction: float) -> tuple[float, float]:
        """Return (x, height above the root) at ``fraction`` of the chord, ``s_m`` from the root."""
        x = self.x_m - s_m * math.tan(math.radians(self.sweep_deg))
        return x - (fraction - 0.25) * self.chord_m(s_m, half_m), s_m * math.tan(math.radians(self.dihedral_deg))


Section = Annotated[tuple[float, float, float, float], Field(strict=False)]


class Outline(Strict):
    """The drawing of an aircraft.

    Attributes:
        note: what the numbers are (published, derived, estimated), as sentences for the caption.
        wing, tail, fin: surfaces; a flying wing has no tail, a V-tail no fin.
        body_m: cross-sections of the fuselage from nose to end: x, half width, lowest and highest point.
        sketched: areas and span are the model's own and the rest is a guess: good to look at, and for nothing else.
        elastic_axis: its place behind the leading edge of the wing, in chords, if known.
    """

    note: str
    wing: Surface
    tail: Surface | None = None
    fin: Surface | None = None
    body_m: Annotated[tuple[Section, ...], Field(strict=False, min_length=2)]
    sketched: bool = False
    elastic_axis: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None

    def toml(self, digits: int = 10) -> list[str]:
        """Return the table ``[drawing]`` of aircraft.toml as lines, numbers with as many digits at most."""
        keys = ("note", "wing", "tail", "fin", "sketched", "body_m")
        said = self.model_dump(exclude_defaults=True)
        return ["[drawing]", *(f"{k} = {toml_value(said[k], partial(real, digits=digits))}" for k in keys if k in said)]

    @property
    def ends_m(self) -> tuple[float, float]:
        """Foremost and rearmost x of anything drawn, from which the overall length follows."""
        xs = [x for x, _, _, _ in self.body_m]
        for surface, half in ((self.wing, 0.5), (self.tail, 0.5), (self.fin, 1.0)):
            if surface is None:
                continue
            reach = half * surface.span_m
            xs += [surface.point(s, reach, f)[0] for s in (0.0, reach) for f in (0.0, 1.0)]
        return max(xs), min(xs)


# --- in three dimensions ----------------------------------------------------------------------------------------------

_ROUND, _PANELS = 8, 3  # corners of a section of the fuselage, and pieces of half a wing
Face = list[tuple[float, float, float]]


def faces(outline: Outline) -> list[Face]:
    """Return an aircraft as flat faces, each its corners in body axes: x forward, y right, z down, m.

    The fuselage has eight sides between its sections; wing, tail and fin are plates, wings in pieces so that they can
    be sorted by their distance.
    """
    out: list[Face] = []

    def plate(surface: Surface, half: float, side: float, pieces: int) -> None:
        for k in range(pieces):
            ends = (half * k / pieces, half * (k + 1) / pieces)
            corners = ((ends[0], 0.0), (ends[1], 0.0), (ends[1], 1.0), (ends[0], 1.0))
            places = [(s, *surface.point(s, half, f)) for s, f in corners]
            out.append([(x, side * s, -(surface.z_m + up)) for s, x, up in places])

    for side in (-1.0, 1.0):
        plate(outline.wing, 0.5 * outline.wing.span_m, side, _PANELS)
        if outline.tail is not None:
            plate(outline.tail, 0.5 * outline.tail.span_m, side, 1)
    if (fin := outline.fin) is not None:
        corners = ((0.0, 0.0), (fin.span_m, 0.0), (fin.span_m, 1.0), (0.0, 1.0))
        for y in sorted({fin.y_m, -fin.y_m}):
            out.append([(fin.point(s, fin.span_m, f)[0], y, -(fin.z_m + s)) for s, f in corners])
    angles = [2.0 * math.pi * k / _ROUND for k in range(_ROUND)]
    rings = [
        [(x, w * math.sin(a), -(0.5 * (low + high) + 0.5 * (high - low) * math.cos(a))) for a in angles]
        for x, w, low, high in outline.body_m
    ]
    for ahead, behind in pairwise(rings):
        out += [[ahead[k], ahead[k - 1], behind[k - 1], behind[k]] for k in range(_ROUND)]
    return out


# --- drawn from a model that states none ------------------------------------------------------------------------------


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
    return usual(S, b, area, arm, fin_area or 0.6 * area, fin_arm if fin_arm > _PLAUSIBLE_ARM * b else arm)


def usual(S: float, b: float, area: float, arm: float, fin_area: float, fin_arm: float) -> Outline:
    """Return a drawing of usual proportions from areas, m2, span and arms, m, of wing, tail and fin."""
    root = 2.0 * S / b / (1.0 + _TAPER)
    span = math.sqrt(_ASPECT_TAIL * area)
    tail_root = 2.0 * area / span / (1.0 + _TAPER)
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
            x_m=-fin_arm + 0.1 * fin_root,
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
