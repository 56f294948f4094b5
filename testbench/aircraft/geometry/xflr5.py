"""The surfaces of a plane that xflr5 exported as XML, as the tables of geometry.toml.

A wing of xflr5 is a list of sections along its developed span: each panel goes out and up by its dihedral, from the
leading edge's offset at its inner section. A fin is such a wing stood on edge. Sections are named after their airfoil,
whose coordinates are not in the file: a NACA name, or NAME.dat beside it.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

from testbench.core.door import read_xml
from testbench.core.errors import ScenarioError

_KINDS = {"MAINWING": "wing", "ELEVATOR": "tail", "FIN": "fin"}


def read_xflr5(path: Path) -> dict[str, Any]:
    """Return title, wing, tail and fins of an XML plane of xflr5, as geometry.toml has them, m and deg.

    Raises:
        RecordError: the file cannot be read, or is no XML.
        ScenarioError: it is no plane of xflr5, or holds what cannot be carried over; names file and surface.
    """
    root = read_xml(path, "geometry")
    plane = root.find("Plane")
    if root.tag != "explane" or plane is None:
        raise ScenarioError(f"{path} must be a plane that xflr5 exported (<explane>, <Plane>), got <{root.tag}>")
    unit = _number(path, root, "Units/length_unit_to_meter", 1.0)
    out: dict[str, Any] = {"title": _text(plane, "Name") or path.stem, "fin": []}
    for wing in plane.findall("wing"):
        name, kind = _text(wing, "Name") or "?", _text(wing, "Type")
        if kind not in _KINDS:
            raise ScenarioError(
                f"{path}: a wing must be one of {', '.join(_KINDS)}, got {kind or 'none'} ('{name}'); leave it out"
            )
        surface: dict[str, Any] = {"section": _sections(path, wing, unit, kind == "FIN")}
        if kind == "FIN":
            out["fin"].append(surface | ({"twin": True} if _text(wing, "isDoubleFin") == "true" else {}))
        else:
            surface["incidence_deg"] = _number(path, wing, "Tilt_angle", 0.0)
            out[_KINDS[kind]] = surface
    return out


def _sections(path: Path, wing: ET.Element, unit: float, fin: bool) -> list[dict[str, Any]]:
    """Return the sections of a surface from root to tip; of a fin, which stands up, its span counts along z."""
    x0, y0, z0 = (unit * float(v) for v in (_text(wing, "Position") or "0, 0, 0").split(","))
    across, up, last, tilt = 0.0, 0.0, 0.0, 0.0
    out = []
    for section in wing.findall("Sections/Section"):
        at = unit * _number(path, section, "y_position")
        across += (at - last) * math.cos(tilt)
        up += (at - last) * math.sin(tilt)
        last, tilt = at, math.radians(_number(path, section, "Dihedral", 0.0))
        name = _text(section, "Right_Side_FoilName") or _text(section, "Left_Side_FoilName")
        out.append(
            {
                "x_m": x0 + unit * _number(path, section, "xOffset", 0.0),
                "y_m": y0 + (up if fin else across),
                "z_m": z0 + (across if fin else up),
                "chord_m": unit * _number(path, section, "Chord"),
                "twist_deg": 0.0 if fin else _number(path, section, "Twist", 0.0),
                "airfoil": _foil(path, name),
            }
        )
    return out


def _foil(path: Path, name: str) -> str:
    """Return the airfoil of a section as geometry.toml names it."""
    naca = re.fullmatch(r"naca[\s-]*(\d{4,5})", name.strip(), re.IGNORECASE)
    return f"naca{naca[1]}" if naca else f"{name}.dat"


def _text(element: ET.Element, tag: str) -> str:
    return (element.findtext(tag) or "").strip()


def _number(path: Path, element: ET.Element, tag: str, otherwise: float | None = None) -> float:
    text = _text(element, tag)
    try:
        return float(text) if text or otherwise is None else otherwise
    except ValueError as error:
        raise ScenarioError(f"{path}: <{tag}> must be a number, got '{text}'") from error
