"""Limits of an aircraft that are found in its model: by trims, by its lift, and where its tables end."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Collection

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.model import ASSUMED
from testbench.core.constants import DEG_RAD
from testbench.core.errors import TrimError
from testbench.core.record import FloatArray
from testbench.flight.condition import TrimmedFlight
from testbench.flight.executive import Executive
from testbench.flight.trim import sideslip_held_by

_BEYOND = 0.15  # of a speed of level flight, by which a manoeuvre may leave it
_ALPHA_DEG, _ALPHA_STEP = (-10.0, 20.0), 0.25 * DEG_RAD
_BETA_DEG, _WIDE_DEG = 25.0, 45.0  # assumed; beyond the second a table's end is no limit
_SIDESLIP = ("aero/beta-rad", "aero/mag-beta-rad")
_IN_DEG = ("aero/beta-deg", "aero/mag-beta-deg")

Limits = dict[str, tuple[float, float]]


def limits_of(
    aircraft: Aircraft, at: TrimmedFlight, level: tuple[float, float], ends: tuple[str, str]
) -> tuple[Limits, dict[str, str]]:
    """Return the limits of flights, SI, and of each where it comes from.

    Args:
        aircraft: adopted.
        at: its first trim.
        level: slowest and fastest speed of steady flight, m/s.
        ends: why none is slower and none faster.
    """
    (slowest, fastest), h_m = level, at.condition.h_m
    low, high = (float(f"{(1.0 + way * _BEYOND) * V:.3g}") for way, V in ((-1.0, slowest), (1.0, fastest)))
    (down, said_down), (up, said_up) = (_lifting(aircraft, at, way) for way in (-1.0, 1.0))
    beta, said_beta = _sideslip(aircraft)
    limits = {
        "V": (low, high),
        "alpha": (down, up),
        "beta": (-beta, beta),
        "theta": (-60.0 * DEG_RAD, 60.0 * DEG_RAD),
        "phi": (-80.0 * DEG_RAD, 80.0 * DEG_RAD),
        "h": (10.0, max(2.0 * h_m, h_m + 3000.0)),
    }
    share = f"{100.0 * _BEYOND:g} %"
    sources = dict.fromkeys(limits, ASSUMED) | {
        "V": f"lowest: {share} below the slowest steady flight found by trimming, {slowest:g} m/s; highest: {share} "
        f"above the fastest, {fastest:g} m/s",
        "alpha": said_up if said_up == said_down else f"lowest: {said_down}; highest: {said_up}",
        "beta": said_beta,
    }
    return limits, sources


def _lifting(aircraft: Aircraft, at: TrimmedFlight, way: float) -> tuple[float, str]:
    """Return the angle of attack up to which lift rises (way 1), or falls (-1), rad, at most the one assumed, and where
    it comes from."""
    fdm = Executive(aircraft, at.rate_hz, at.condition)
    fdm.command(dict(at.controls))
    most, last = -math.inf, _ALPHA_DEG[way > 0.0] * DEG_RAD
    for alpha in np.arange(at.alpha, last, way * _ALPHA_STEP):
        fdm.place_at(at.condition, alpha)
        fdm.evaluate(held=True)
        lift = way * fdm.get("forces/fwz-aero-lbs")
        if lift < most:
            most_or_least = "greatest" if way > 0.0 else "least"
            return float(alpha - way * _ALPHA_STEP), f"lift is {most_or_least} there at {at.condition.V_m_s:g} m/s"
        most = lift
    return last, ASSUMED


def _sideslip(aircraft: Aircraft) -> tuple[float, str]:
    """Return the sideslip at which the widest table of the model ends, rad, if any does; and where it comes from."""
    tree = ET.fromstring(aircraft.xml)
    ends = [
        min(-x.min(), x.max()) if name in _SIDESLIP and x.min() < 0.0 else x.max()
        for name, x in (*_tables(tree, _SIDESLIP, 1.0), *_tables(tree, _IN_DEG, DEG_RAD))
    ]
    beta = max(ends, default=math.inf)
    if not 0.0 < beta <= _WIDE_DEG * DEG_RAD:
        return _BETA_DEG * DEG_RAD, ASSUMED
    return float(beta), "the tables of the model end there"


def _tables(tree: ET.Element, names: Collection[str], unit: float) -> list[tuple[str, FloatArray]]:
    """Return variable and points of every table of the aerodynamics over one of these variables."""
    out = []
    for table in (t for part in tree.findall("aerodynamics") for t in part.iter("table")):
        variables = {v.get("lookup", "row"): (v.text or "").strip() for v in table.findall("independentVar")}
        for lookup, name in variables.items():
            if name not in names or lookup == "table":
                continue
            points: list[str] = []
            for data in table.findall("tableData"):  # of three dimensions: one for each value of the third
                rows = [line.split() for line in (data.text or "").splitlines() if line.strip()]
                points += rows[0] if lookup == "column" else [row[0] for row in rows[len(variables) > 1 :]]
            out.append((name, unit * np.array(points, float)))
    return out


def steady_sideslip(aircraft: Aircraft, trimmed: TrimmedFlight) -> float | None:
    """Return the sideslip that full rudder holds in steady straight flight, rad; None if the rest cannot balance it."""
    if not {"da", "dr"} <= {*aircraft.controls}:
        return None
    try:
        return abs(sideslip_held_by(aircraft, trimmed, aircraft.controls["dr"].full))
    except TrimError:
        return None
