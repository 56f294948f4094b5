"""The outline of an aircraft for its three-view drawing, from its geometry."""

from __future__ import annotations

import math
from dataclasses import replace

from testbench.aircraft.geometry.shape import LiftingSurface, Plane
from testbench.aircraft.outline import Outline, Surface

_STEEPEST_DEG = 79.0  # dihedral of a drawing


def outline(plane: Plane) -> Outline:
    """Return the drawing of an aircraft whose places count from its centre of gravity.

    A surface of several panels is drawn as the trapezoid with its span, area and mean chord.
    """
    tails, fins = plane.of("tail"), plane.of("fin")
    notes = ["Drawn from the geometry that the coefficients were computed from."]
    several = [s.name for s in (plane.wing, *tails[:1], *fins[:1]) if len(s.stations) > 2]
    if several:
        notes.append(f"Drawn as the trapezoid of the same span, area and mean chord: {', '.join(several)}.")
    left_out = [s.name for s in plane.surfaces if s is not plane.wing and s not in (*tails[:1], *fins[:1])]
    if left_out:
        notes.append(f"Not drawn: {', '.join(left_out)}.")
    if plane.body:
        body = tuple((-h.x_m, 0.5 * h.width_m, h.z_m - 0.5 * h.height_m, h.z_m + 0.5 * h.height_m) for h in plane.body)
    else:
        notes.append("No fuselage was given; the line along the middle is none.")
        roots = [s.stations[0] for s in plane.surfaces]
        middle = [s for s in roots if abs(s.y_m) < 1e-6 * plane.b_m] or roots
        xs = [s.x_m + f * s.chord_m for s in middle for f in (0.0, 1.0)]
        thin = 2e-3 * plane.b_m
        body = tuple((-x, thin, -thin, thin) for x in (min(xs), max(xs)))
    return Outline(
        note=" ".join(notes),
        wing=_trapezoid(plane.wing),
        tail=_trapezoid(tails[0]) if tails else None,
        fin=_trapezoid(fins[0]) if fins else None,
        body_m=body,
    )


def _trapezoid(surface: LiftingSurface) -> Surface:
    if surface.role == "fin" and not surface.rises:  # a drawing's fin stands on its lower end
        surface = replace(surface, stations=surface.stations[::-1])
    fin = surface.role == "fin"
    root, tip = surface.stations[0], surface.stations[-1]
    across, up = abs(tip.y_m - root.y_m), tip.z_m - root.z_m
    side = abs(up) if fin else across
    span = side if fin else 2.0 * max(abs(s.y_m) for s in surface.stations)
    area = surface.area_m2 / (2.0 if fin and surface.mirrored else 1.0) if fin else surface.projected_m2
    chords = (root.chord_m, tip.chord_m)
    if len(surface.stations) > 2:
        chords = _chords(area / span, surface.mean_chord_m, root.chord_m < tip.chord_m)
    aft = tip.x_m + 0.25 * tip.chord_m - root.x_m - 0.25 * root.chord_m
    sweep = math.atan2(aft, side)
    # The mean chord's quarter chord of the drawing lies where that of the surface does.
    taper = chords[1] / chords[0]
    share = (1.0 + 2.0 * taper) / (3.0 * (1.0 + taper))
    x = surface.quarter_chord_m[0] - share * side * math.tan(sweep)
    dihedral = 0.0 if fin else math.degrees(math.atan2(up, across))
    return Surface(
        span_m=_r(span),
        root_chord_m=_r(chords[0]),
        tip_chord_m=_r(chords[1]),
        x_m=_r(-x),
        z_m=_r(root.z_m),
        sweep_deg=_r(math.degrees(sweep)),
        dihedral_deg=_r(max(-_STEEPEST_DEG, min(_STEEPEST_DEG, dihedral))),
        y_m=_r(abs(root.y_m)) if fin else 0.0,
    )


def _chords(mean_m: float, aerodynamic_m: float, widens: bool) -> tuple[float, float]:
    """Return root and tip chord of the trapezoid with this mean and mean aerodynamic chord.

    Their ratio is (4/3) (1 + t + t^2) / (1 + t)^2 = 1 + u^2/3 with u = (1 - t) / (1 + t).
    """
    u = min(math.sqrt(max(3.0 * (aerodynamic_m / mean_m - 1.0), 0.0)), 0.95)
    return (mean_m * (1.0 - u), mean_m * (1.0 + u)) if widens else (mean_m * (1.0 + u), mean_m * (1.0 - u))


def _r(value: float) -> float:
    return round(float(value), 5) + 0.0
