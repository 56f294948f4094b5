"""Read the plan of an aircraft: geometry.toml, or a file of AVL, xflr5 or DATCOM and what is beside it; all faults."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from testbench.aircraft.geometry.avl import read_avl
from testbench.aircraft.geometry.datcom import Derivatives, is_datcom, read_datcom
from testbench.aircraft.geometry.masses import Balance, balance
from testbench.aircraft.geometry.schema import BesideAvl, Common, Fin, GeometryFile, Servo, Trapezoid
from testbench.aircraft.geometry.shape import Airfoil, Flap, LiftingSurface, Moved, Plane, Role, Station, airfoil
from testbench.core.door import read_toml, read_xml
from testbench.core.errors import Faults, ScenarioError
from testbench.core.schema import parse

_KINDS = {"MAINWING": "wing", "ELEVATOR": "tail", "FIN": "fin"}


@dataclass(frozen=True)
class Plan:
    """All that is known of an aircraft before anything is computed.

    Attributes:
        title: one line for people.
        file: what all but the lifting surfaces came from.
        said: that file, read.
        plane: the outside.
        balance: mass, centre of gravity, inertias.
        servos: control -> what moves it.
        sources: files to keep beside the model, by the path that the first of them names them by.
        stated: derivatives that the file itself tables, those of DATCOM's output.
    """

    title: str
    file: Path
    said: Common
    plane: Plane
    balance: Balance
    servos: Mapping[Moved, Servo]
    sources: Mapping[str, Path] = field(default_factory=dict)
    stated: Derivatives | None = None


def read_plan(path: Path, mass: Path | None = None) -> Plan:
    """Read a plan.

    Args:
        path: geometry.toml, a file of AVL (.avl), a plane that xflr5 exported (.xml), or the input or output of
            Digital DATCOM (for005, for006, .dcm, .dat, .inp, .out).
        mass: beside one of the latter, a TOML file with what it lacks.

    Raises:
        RecordError: a file cannot be read.
        ScenarioError: it breaks its schema, or does not make an aircraft; names every fault.
    """
    kind = {".avl": "an AVL file", ".xml": "a plane of xflr5"}.get(path.suffix.lower())
    kind = "a file of DATCOM" if is_datcom(path) else kind
    if kind is not None and mass is None:
        raise ScenarioError(
            f"{path}: {kind} lacks mass, design speed, throws and motor: give them with --mass FILE.toml"
        )
    if kind == "an AVL file":
        return _from_avl(path, Path(str(mass)))
    if kind is None and mass is not None:
        raise ScenarioError(f"--mass goes with a file of AVL, xflr5 or DATCOM, got '{path}': write [mass] into it")
    given = read_toml(path if mass is None else mass, "geometry")
    stated, notes = None, tuple[str, ...]()
    if kind == "a file of DATCOM":
        drawn, stated, notes = read_datcom(path)
        given = _over(drawn, given)
        bare: list[str] = [k for k in ("wing", "tail") if k in given and "airfoil" not in given[k]]
        bare += ["[fin]" for fin in given.get("fin", ()) if "airfoil" not in fin]
        if bare:
            raise ScenarioError(
                f"{path} must say the airfoils of {', '.join(bare)} by NACA cards of four or five digits, got none: "
                f'give [{bare[0]}] airfoil = "naca2412", or a file of coordinates, in {mass}'
            )
    elif mass is not None:
        given = read_xflr5(path) | given
    said, problems = parse(GeometryFile, given, path)
    faults = Faults(path)
    faults.extend(problems)
    plane = _plane(said, faults) if said is not None else None
    if faults or plane is None or said is None:
        raise ScenarioError(faults)
    sources = {s.airfoil.name: s.airfoil.file for x in plane.surfaces for s in x.stations if s.airfoil.file is not None}
    files = {p.name: p for p in (path, mass) if p is not None}
    made = _plan(said, replace(plane, notes=notes), said.control, path, files | sources, said.title or path.stem)
    return replace(made, stated=stated)


def _over(drawn: Mapping[str, Any], beside: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a file draws with what the TOML file beside it says of the same, which counts; fins one by one."""
    out = dict(drawn)
    for key, value in beside.items():
        before = drawn.get(key)
        if isinstance(before, Mapping) and isinstance(value, Mapping):
            value = _over(before, value)
        elif key == "fin" and isinstance(before, list) and isinstance(value, list) and len(before) == len(value):
            value = [_over(a, b) for a, b in zip(before, value, strict=True)]
        out[key] = value
    return out


def _plan(
    said: Common, plane: Plane, servos: Mapping[Moved, Servo], file: Path, sources: Mapping[str, Path], title: str
) -> Plan:
    faults = Faults(file)
    found = faults.attempt("mass", balance, said.mass, plane.b_m, plane.length_m)
    if found is None:
        raise ScenarioError(faults)
    return Plan(title, file, said, _nose_down(plane, found.cg_m[0]), found, servos, sources)


def _nose_down(plane: Plane, cg_x_m: float) -> Plane:
    """Return the aircraft with an elevator that pitches the nose down: ahead of the centre of gravity it moves up."""
    moved = [s for s in plane.surfaces if s.role == "tail" and any(f.moves == "de" for f in s.flaps)]
    if not moved or max(moved, key=lambda s: s.area_m2).quarter_chord_m[0] >= cg_x_m:
        return plane
    turned = (
        replace(s, flaps=tuple(replace(f, gain=-f.gain) if f.moves == "de" else f for f in s.flaps))
        for s in plane.surfaces
    )
    return replace(plane, surfaces=tuple(turned))


def _from_avl(path: Path, beside: Path) -> Plan:
    said, faults = parse(BesideAvl, read_toml(beside, "masses beside AVL"), beside)
    if said is None or faults:
        raise ScenarioError(faults)
    avl = read_avl(path, {n: c.avl for n, c in said.control.items()}, said.spare_airfoil, said.length_unit_m)
    notes = list(avl.notes)
    cg = said.mass.cg_m
    if cg is not None and abs(cg[0] - avl.reference_m[0]) > 1e-3 * avl.cbar_m:
        notes.append(
            f"moments are about the centre of gravity, x = {cg[0]:g} m, not about Xref = {avl.reference_m[0]:g} m"
        )
    r = said.reference
    if said.body and avl.body:
        notes.append("the BODY of the AVL file is left out: [fuselage] of the other file is used")
    body = said.body or avl.body
    plane = Plane(avl.surfaces, body, r.S_m2 or avl.S_m2, r.b_m or avl.b_m, r.cbar_m or avl.cbar_m, tuple(notes))
    files = {s.airfoil.name: s.airfoil.file for x in plane.surfaces for s in x.stations if s.airfoil.file is not None}
    files |= {avl.body_file.name: avl.body_file} if avl.body_file is not None and body is avl.body else {}
    sources = {path.name: path, beside.name: beside, **files}
    return _plan(said, plane, said.control, beside, sources, said.title or avl.title)


def _plane(said: GeometryFile, faults: Faults) -> Plane | None:
    """Return the outside of an aircraft of geometry.toml, or None with its faults noted."""
    flaps: dict[str, list[Flap]] = {"wing": [], "tail": [], "fin": []}
    have = {"wing": True, "tail": said.tail is not None, "fin": bool(said.fin)}
    for moved, c in said.control.items():
        if not have[c.surface]:
            there = " or ".join(k for k, v in have.items() if v)
            faults.note(
                f"control.{moved}.surface",
                f"the aircraft must have the surface that moves, got '{c.surface}'; it has {there}",
            )
        flaps[c.surface].append(Flap(moved, c.span_from, c.span_to, c.chord_fraction))
        if moved == "da" and c.surface == "fin":
            faults.note("control.da.surface", "ailerons must be on the wing or the tail, got 'fin'")
        if moved == "de" and c.surface == "fin":
            faults.note("control.de.surface", "an elevator must be on the wing or the tail, got 'fin'")
        if moved == "dr" and c.surface == "wing":
            faults.note("control.dr.surface", "a rudder must be on a fin or a V-tail, got 'wing'")
        if moved == "dr" and c.surface == "tail" and said.tail is not None and said.tail.flat:
            faults.note("control.dr.surface", "a rudder must be on a fin or a V-tail, got a tail without dihedral")
    surfaces: list[LiftingSurface | None] = [_surface(said.wing, "wing", "wing", flaps["wing"], faults)]
    if said.tail is not None:
        surfaces.append(_surface(said.tail, "tail", "tail", flaps["tail"], faults))
    for i, fin in enumerate(said.fin):
        name = "fin" if len(said.fin) == 1 else f"fin[{i}]"
        surfaces.append(_surface(fin, "fin", name, flaps["fin"], faults))
    built = [s for s in surfaces if s is not None]
    if len(built) < len(surfaces) or faults:
        return None
    wing = built[0]
    r = said.reference
    b = r.b_m or wing.span_m
    S = r.S_m2 or wing.projected_m2
    return Plane(tuple(built), said.body, S, b, r.cbar_m or wing.mean_chord_m)


def _surface(given: Trapezoid, role: Role, name: str, flaps: list[Flap], faults: Faults) -> LiftingSurface | None:
    folder = Path(str(faults.file)).parent
    key = "fin[0]" if name == "fin" else name
    shapes: dict[str, Airfoil | None] = {}
    for i, s in enumerate(given.sections):
        what, at = ("section", f"{key}.section[{i}].airfoil") if given.section else ("surface", f"{key}.airfoil")
        wanted = s.airfoil or given.airfoil
        if wanted is None and at not in shapes:
            faults.note(at, f'the {what} must have coordinates: give airfoil = "naca2412" or a file of coordinates')
        if (wanted or at) not in shapes:
            shapes[wanted or at] = None if wanted is None else faults.attempt(at, airfoil, wanted, folder)
    stations = [
        Station(s.x_m, s.y_m, s.z_m, s.chord_m, s.twist_deg + given.incidence_deg, shape)
        for s in given.sections
        if (shape := shapes.get(s.airfoil or given.airfoil or "")) is not None
    ]
    if len(stations) < len(given.sections):
        return None
    mirrored = given.twin if isinstance(given, Fin) else True
    surface = LiftingSurface(name, role, mirrored, tuple(stations), tuple(flaps))
    for at, fault in _misplaced_sections(surface) if given.section else _misplaced_root(given.y_m, role, mirrored):
        faults.note(f"{key}.{at}", fault)
    return surface


def _misplaced_root(y_m: float, role: Role, mirrored: bool) -> Iterator[tuple[str, str]]:
    """Yield key and fault of a trapezoid that does not stand where it may."""
    if role != "fin" and y_m:
        yield "y_m", "a wing or tail must begin in the plane of symmetry; give sections for a gap"
    if y_m and not mirrored:
        yield "y_m", f"a single fin must stand in the plane of symmetry, got {y_m:g}: set twin = true"
    if role == "fin" and mirrored and not y_m:
        yield "y_m", "twin fins must stand apart, got 0"


def _misplaced_sections(surface: LiftingSurface) -> Iterator[tuple[str, str]]:
    """Yield key and fault of sections that do not stand where they may."""
    across = [s.y_m for s in surface.stations]
    if not surface.shortest_m > 0.0:
        yield "section", "sections must lie apart in y or z, got two at one place"
        return
    if surface.mirrored and min(across) < 0.0:
        yield "section", "sections must be those of the right side (y_m >= 0); the left one is its mirror image"
    if surface.role != "fin" and not surface.projected_m2 > 0.0:
        yield "section", "a wing or tail must have span along y"
    if surface.role == "fin" and not surface.mirrored and any(across):
        yield "section", "a single fin must stand in the plane of symmetry: set twin = true"


# --- planes that xflr5 exported ---------------------------------------------------------------------------------------


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
