"""Surfaces cut into strips, for either method: where strips meet, and what moves them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from testbench.aircraft.geometry.airfoils import Airfoil
from testbench.aircraft.geometry.shape import ALONG, LiftingSurface, Moved, Station

_STRIPS = {"wing": 12, "tail": 6, "fin": 6}  # on one side
_TOUCH = 0.02  # of a surface's length within which another one touches it


@dataclass(frozen=True)
class Cut:
    """A place along a surface where strips meet: the station there, and its place from 0 to 1."""

    s: float
    station: Station
    blend: tuple[Airfoil, Airfoil, float]


def cuts(surface: LiftingSurface, others: Sequence[LiftingSurface] = ()) -> list[Cut]:
    """Return the ends of the strips of a surface: its stations, ends of flaps, junctions, and even parts between them.

    Where another surface begins or ends on this one, vortices of both must run along one line: one that passed beside a
    panel's middle by chance would drive it without bound.
    """
    along = surface.along
    fixed = {*along, *(e for f in surface.flaps for e in (f.start, f.end)), *_junctions(surface, others)}
    ends: list[float] = []
    for s in sorted(fixed):
        if not ends or s - ends[-1] > 10.0 * ALONG:
            ends.append(s)
    out: list[float] = []
    for a, b in pairwise(ends):
        n = max(1, round((b - a) * _STRIPS[surface.role]))
        out += [a + (b - a) * i / n for i in range(n)]
    return [_at(surface, along, s) for s in (*out, ends[-1])]


def _junctions(surface: LiftingSurface, others: Sequence[LiftingSurface]) -> set[float]:
    """Return where along a surface others begin or end on it, as seen from the front."""
    out = set()
    for other in others:
        for end in (other.stations[0], other.stations[-1]) if other is not surface else ():
            for (a, b), (start, stop) in zip(pairwise(surface.stations), pairwise(surface.along), strict=True):
                way, to = np.array([b.y_m - a.y_m, b.z_m - a.z_m]), np.array([end.y_m - a.y_m, end.z_m - a.z_m])
                t = float(to @ way / (way @ way))
                s = start + t * (stop - start)
                near = float(np.hypot(*(to - t * way))) < _TOUCH * surface.length_m
                if near and 0.0 <= t <= 1.0 and _TOUCH < s < 1.0 - _TOUCH:
                    out.add(s)
    return out


def _at(surface: LiftingSurface, along: tuple[float, ...], s: float) -> Cut:
    i = min(max(int(np.searchsorted(along, s, side="right")) - 1, 0), len(along) - 2)
    a, b = surface.stations[i], surface.stations[i + 1]
    t = min(max((s - along[i]) / (along[i + 1] - along[i]), 0.0), 1.0)

    def mix(name: str) -> float:
        return float((1.0 - t) * getattr(a, name) + t * getattr(b, name))

    station = Station(mix("x_m"), mix("y_m"), mix("z_m"), mix("chord_m"), mix("twist_deg"), a.airfoil)
    return Cut(s, station, (a.airfoil, b.airfoil, t))


def moved_by(surface: LiftingSurface, s: float) -> list[tuple[Moved, float, float]]:
    """Return (control, chord fraction, deflection in rad per rad of the control) of the flaps at a place.

    The deflection is that of the right side, positive towards the surface's lower side; the left side turns the same
    way for the elevator and the other way for aileron and rudder. See the signs in core/channels.py.
    """
    out: list[tuple[Moved, float, float]] = []
    for f in surface.flaps:
        if f.start - ALONG < s < f.end + ALONG:
            sign = 1.0 if f.moves == "de" or (f.moves == "dr" and not surface.rises) else -1.0
            out.append((f.moves, f.chord_fraction, sign * f.gain))
    return out
