"""Units of JSBSim's files (FGXMLElement's own factors, to the last digit)."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

from testbench.flight.batch.program import Untranslated

_M_FT = 3.2808399
_FACTORS: dict[tuple[str, str], float] = {
    ("M", "FT"): _M_FT,
    ("FT", "IN"): 12.0,
    ("M", "IN"): _M_FT * 12.0,
    ("SLUG*FT2", "KG*M2"): 1.35594,
    ("RAD", "DEG"): 180.0 / math.pi,
    ("WATTS", "HP"): 0.001341022,
    ("LBS", "KG"): 0.45359237,
    ("N", "LBS"): 0.22482,
    ("INHG", "PSF"): 70.7180803,
    ("PSI", "INHG"): 2.03625437,
    ("ATM", "INHG"): 29.9246899,
    ("INHG", "PA"): 3386.0,
    ("LBS/HP*HR", "KG/KW*HR"): 0.6083,
    ("IN3", "CC"): 16.387064,
    ("LTR", "IN3"): 61.0237441,
}


def factor(unit: str, to: str) -> float:
    """Return the factor from one unit to another.

    Raises:
        Untranslated: it is not known.
    """
    if unit == to:
        return 1.0
    if (unit, to) in _FACTORS:
        return _FACTORS[unit, to]
    if (to, unit) in _FACTORS:
        return 1.0 / _FACTORS[to, unit]
    raise Untranslated(f"it gives a number in {unit} where {to} is wanted")


def convert(e: ET.Element | None, to: str, default: float, unit: str | None = None) -> float:
    """Return the number of an element in the unit ``to``; in that unit already if it has none of its own."""
    if e is None or not (e.text or "").strip():
        return default
    return float(e.text or "") * factor(e.get("unit") or unit or to, to)


def triplet(e: ET.Element | None, to: str) -> list[float]:
    """Return x, y, z of an element in the unit ``to``."""
    if e is None:
        return [0.0, 0.0, 0.0]
    return [convert(e.find(axis), to, 0.0, e.get("unit")) for axis in "xyz"]
