"""What an aircraft looks like, for drawings only: lifting surfaces as trapezoids, the fuselage as a row of sections.

Places count from the centre of gravity: x forward, y along the right wing, z up, m. Nothing here enters a flight.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from testbench.core.schema import NonNegative, Positive, Strict


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
