"""Reader of AVL's geometry files (M. Drela, H. Youngren, AVL 3.40 User Primer): surfaces, sections, controls.

What the testbench has no use for is noted; what it cannot carry over is refused with its line.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from testbench.aircraft.geometry.schema import Cross
from testbench.aircraft.geometry.shape import (
    Airfoil,
    Flap,
    LiftingSurface,
    Moved,
    Role,
    Station,
    airfoil,
    naca,
    normalised,
    read_points,
)
from testbench.core.door import read_text
from testbench.core.errors import Refusal, ScenarioError, nearest

_KEYWORDS = {
    "SURF": "SURFACE", "COMP": "COMPONENT", "INDE": "COMPONENT", "YDUP": "YDUPLICATE", "SCAL": "SCALE",
    "TRAN": "TRANSLATE", "ANGL": "ANGLE", "NOWA": "NOWAKE", "NOAL": "NOALBE", "NOLO": "NOLOAD", "CDCL": "CDCL",
    "SECT": "SECTION", "NACA": "NACA", "AIRF": "AIRFOIL", "AFIL": "AFILE", "DESI": "DESIGN", "CONT": "CONTROL",
    "CLAF": "CLAF", "BODY": "BODY", "BFIL": "BFILE",
}  # fmt: skip
_GUESSED: dict[str, Moved] = {"elev": "de", "ail": "da", "rud": "dr"}  # beginnings of names that tell by themselves
_UPRIGHT_DEG = 60.0  # dihedral beyond which a mirrored surface counts as twin fins
_BESIDE = 1.0  # chords by which a second flat surface may lie before or behind the wing and still be part of it


@dataclass
class _Control:
    name: str
    gain: float
    hinge: float
    axis: tuple[float, float, float]
    sign: float
    line: int


@dataclass
class _Section:
    line: int
    xyz: tuple[float, float, float]
    chord: float
    incidence: float
    airfoil: Airfoil | None = None
    controls: list[_Control] = field(default_factory=list)


@dataclass
class _Surface:
    name: str
    line: int
    mirrored: bool = False
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    angle: float = 0.0
    sections: list[_Section] = field(default_factory=list)
    file: str = ""  # of a body


@dataclass(frozen=True)
class AvlPlane:
    """An AVL file: title, references (m), lifting surfaces, cross-sections of the body and the file that lists them,
    notes on what was left out.
    """

    title: str
    S_m2: float
    cbar_m: float
    b_m: float
    reference_m: tuple[float, float, float]
    surfaces: tuple[LiftingSurface, ...]
    body: tuple[Cross, ...]
    body_file: Path | None
    notes: tuple[str, ...]


class _Lines:
    """The lines of a file that are not comments, with their numbers."""

    def __init__(self, path: Path) -> None:
        self.path = path
        text = read_text(path, "AVL", errors="replace")
        self.rows = [
            (i, line.split("!")[0].split("#")[0].strip())
            for i, line in enumerate(text.splitlines(), 1)
            if line.split("!")[0].split("#")[0].strip()
        ]
        self.at = 0

    def fault(self, words: str, line: int | None = None) -> ScenarioError:
        """Return an error with file and line."""
        if line is None:
            line = self.rows[min(self.at, len(self.rows)) - 1][0] if self.rows else 1
        return ScenarioError(f"{self.path}, line {line}: {words}")

    def text(self, what: str) -> str:
        """Return the next line, which must hold ``what``."""
        if self.at >= len(self.rows):
            raise self.fault(f"the file ends where {what} must follow; it is cut or unfinished")
        self.at += 1
        return self.rows[self.at - 1][1]

    def numbers(self, what: str, least: int) -> list[float]:
        """Return the numbers that the next line begins with: ``least`` of them at least."""
        words = self.text(what).replace(",", " ").replace("D", "E").replace("d", "e").split()
        out: list[float] = []
        for word in words:
            try:
                out.append(float(word))
            except ValueError:
                break
        if len(out) < least or not all(map(math.isfinite, out)):
            raise self.fault(f"{what} must be {least} numbers, got '{' '.join(words)}'")
        return out

    def keyword(self) -> str | None:
        """Return the keyword of the next line without taking it, "" if it is none, None at the end."""
        if self.at >= len(self.rows):
            return None
        return _KEYWORDS.get(self.rows[self.at][1].split()[0][:4].upper(), "")


def read_avl(path: Path, controls: dict[Moved, str | None], spare: str | None = None, unit_m: float = 1.0) -> AvlPlane:
    """Read an AVL file.

    Args:
        path: of the file.
        controls: control channel -> name of its CONTROL lines, or None to go by the names elev..., ail..., rud....
        spare: airfoil of sections that have none; without it they are refused, as AVL's flat plate has no drag.
        unit_m: length of the file's unit.

    Raises:
        ScenarioError: the file is cut, or holds what cannot be carried over; names file and line.
    """
    lines = _Lines(path)
    title = lines.text("a title")
    lines.numbers("Mach number", 1)
    iy, iz, _ = lines.numbers("iYsym iZsym Zsym", 3)[:3]
    if iz != 0.0 or iy not in (0.0, 1.0):
        raise lines.fault("iYsym must be 0 or 1 and iZsym 0 (no ground, no antisymmetric image)")
    S, c, b = lines.numbers("Sref Cref Bref", 3)[:3]
    if min(S, c, b) <= 0.0:
        raise lines.fault(f"Sref, Cref and Bref must be > 0, got {S:g}, {c:g}, {b:g}")
    x, y, z = lines.numbers("Xref Yref Zref", 3)[:3]
    notes: list[str] = []
    if lines.keyword() == "":
        profile = lines.numbers("CDp", 1)[0]
        if profile:
            notes.append(f"profile drag CDp = {profile:g} left out: drag is computed from the sections")
    found, bodies = _surfaces(lines, iy == 1.0, notes)
    if not found:
        raise lines.fault("the file must hold a SURFACE with sections, got none")
    names = {k.name for s in found for section in s.sections for k in section.controls}
    meaning = _meanings(lines, controls, names, notes)
    surfaces = [_lifting(lines, s, meaning, spare, unit_m) for s in found]
    surfaces = _geared(_roles(_joined(surfaces)), notes)
    beside = [s.name for s in surfaces[1:] if s.role == "wing"]
    if beside:
        notes.append(f"taken as parts of the wing that the build-up treats each by itself: {', '.join(beside)}")
    return AvlPlane(
        title,
        S * unit_m**2,
        c * unit_m,
        b * unit_m,
        (x * unit_m, y * unit_m, z * unit_m),
        tuple(surfaces),
        *_body(lines, bodies, unit_m, notes),
        tuple(notes),
    )


def _surfaces(lines: _Lines, mirror_all: bool, notes: list[str]) -> tuple[list[_Surface], list[_Surface]]:
    """Return the surfaces as the file has them, and the bodies."""
    out: list[_Surface] = []
    bodies: list[_Surface] = []
    body = False
    while (key := lines.keyword()) is not None:
        word = lines.text("a keyword")
        line = lines.rows[lines.at - 1][0]
        if key == "SURFACE":
            out.append(_Surface(lines.text("the name of the surface"), line, mirrored=False))
            lines.numbers("Nchordwise Cspace", 2)
            body = False
        elif key == "BODY":
            bodies.append(_Surface(lines.text("the name of the body"), line))
            lines.numbers("Nbody Bspace", 2)
            body = True
        elif key == "":
            raise lines.fault(
                f"a keyword must stand here, got '{word}'{nearest(word.upper(), set(_KEYWORDS.values()))}"
            )
        elif not out and not body:
            raise lines.fault(f"{key} must follow a SURFACE")
        else:
            _keyword(lines, key, bodies[-1] if body else out[-1], notes, body)
    for surface in out:
        if len(surface.sections) < 2:
            raise lines.fault(
                f"surface '{surface.name}' must have at least two sections, got {len(surface.sections)}; the "
                "file may be cut",
                surface.line,
            )
        off = max(abs(s.xyz[1] * surface.scale[1] + surface.shift[1]) for s in surface.sections)
        if mirror_all and off > 0.0:
            surface.mirrored = True
    return out, bodies


def _body(
    lines: _Lines, bodies: Sequence[_Surface], unit_m: float, notes: list[str]
) -> tuple[tuple[Cross, ...], Path | None]:
    """Return the cross-sections of the longest body in the plane of symmetry, m, and its file; notes on the others.

    BFILE lists the outline in the plane of symmetry as coordinates of a section do, in units of the file: AVL takes the
    circle between its upper and its lower side at each x.
    """
    found: list[tuple[tuple[Cross, ...], Path, str]] = []
    for body in bodies:
        path = lines.path.parent / body.file.strip("\"'")
        if body.mirrored or body.shift[1] != 0.0:
            notes.append(f"BODY '{body.name}' left out: it lies beside the plane of symmetry")
        elif not body.file or not path.is_file():
            notes.append(
                f"BODY '{body.name}' left out: no file {body.file or 'of it (BFILE)'} lies there; give [fuselage] "
                "beside the AVL file"
            )
        else:
            found.append((_crosses(path, body, unit_m), path, body.name))
    found.sort(key=lambda b: b[0][0].x_m - b[0][-1].x_m)  # the longest first
    notes += [f"BODY '{name}' left out: the fuselage is '{found[0][2]}', the longest" for _, _, name in found[1:]]
    return found[0][:2] if found else ((), None)


def _crosses(path: Path, body: _Surface, unit_m: float) -> tuple[Cross, ...]:
    points = read_points(path)
    nose = int(np.argmin(points[:, 0]))
    sides = [part[np.argsort(part[:, 0], kind="stable")] for part in (points[: nose + 1], points[nose:])]
    x = np.unique(points[:, 0])
    upper, lower = (np.interp(x, part[:, 0], part[:, 1]) for part in sides)
    if min(part.shape[0] for part in sides) < 2 or not np.any(np.abs(upper - lower) > 0.0):
        raise ScenarioError(f"{path}: a body must be listed from its tail over the nose and back, got one side only")
    x, upper, lower = (
        unit_m * (body.scale[k] * values + body.shift[k]) for k, values in ((0, x), (2, upper), (2, lower))
    )
    size = np.abs(upper - lower)
    return tuple(
        Cross(x_m=float(a), z_m=float(z), width_m=float(d), height_m=float(d))
        for a, z, d in zip(x, 0.5 * (upper + lower), size, strict=True)
    )


def _keyword(lines: _Lines, key: str, surface: _Surface, notes: list[str], body: bool) -> None:
    """Take one keyword with its data into a surface."""
    words = lines.rows[lines.at - 1][1].split()
    line = lines.rows[lines.at - 1][0]
    if key == "YDUPLICATE":
        if lines.numbers("Ydupl", 1)[0] != 0.0:
            raise lines.fault("surfaces must be mirrored in y = 0, got another plane")
        surface.mirrored = True
    elif key == "COMPONENT":
        lines.numbers("the number of the component", 1)
    elif key == "SCALE":
        surface.scale = _three(lines.numbers("Xscale Yscale Zscale", 3))
    elif key == "TRANSLATE":
        surface.shift = _three(lines.numbers("dX dY dZ", 3))
    elif key == "ANGLE":
        surface.angle = lines.numbers("dAinc", 1)[0]
    elif key in ("NOALBE", "NOLOAD"):
        raise lines.fault(
            f"{key} cannot be carried over: a surface must feel the wind and carry load; leave '{surface.name}' out"
        )
    elif key == "NOWAKE":
        notes.append(f"NOWAKE of '{surface.name}' left out: it is taken as a surface with a wake")
    elif key == "CDCL":
        lines.numbers("CL1 CD1 CL2 CD2 CL3 CD3", 6)
        notes.append(f"CDCL (line {line}) left out: drag is computed from the sections")
    elif key == "SECTION":
        x, y, z, chord, *rest = lines.numbers("Xle Yle Zle Chord Ainc", 5)
        if chord <= 0.0:
            raise lines.fault(f"the chord of a section must be > 0, got {chord:g}")
        surface.sections.append(_Section(line, (x, y, z), chord, rest[0]))
    elif key == "BFILE":
        surface.file = lines.text("the name of a file")
    elif body or not surface.sections:
        raise lines.fault(f"{key} must follow a SECTION")
    else:
        _of_section(lines, key, words[1:], surface, notes, line)


def _three(values: Sequence[float]) -> tuple[float, float, float]:
    return values[0], values[1], values[2]


def _of_section(lines: _Lines, key: str, words: list[str], surface: _Surface, notes: list[str], line: int) -> None:
    section = surface.sections[-1]
    if key in ("NACA", "AFILE", "AIRFOIL") and len(words) >= 2 and not _whole(words):
        raise lines.fault(f"{key} must take the whole chord, X1 X2 = 0 1, got {' '.join(words)}", line)
    if key == "CLAF":
        lines.numbers("CLaf", 1)
        notes.append(f"CLAF (line {line}) left out: lift slopes are computed from the sections")
    elif key == "DESIGN":
        lines.text("a design variable")
        notes.append(f"DESIGN (line {line}) left out: it is taken at zero")
    elif key == "CONTROL":
        text = lines.text("name, gain, Xhinge, XYZhvec, SgnDup")
        name, *rest = text.split()
        try:
            numbers = [float(w) for w in rest]
            gain, hinge, axis, sign = numbers[0], numbers[1], _three(numbers[2:5]), numbers[5]
        except (ValueError, IndexError) as error:
            raise lines.fault(f"CONTROL must be name, gain, Xhinge, XYZhvec (3), SgnDup, got '{text}'") from error
        section.controls.append(_Control(name, gain, hinge, axis, sign, lines.rows[lines.at - 1][0]))
    else:
        try:
            section.airfoil = _coordinates(lines, key)
        except Refusal as error:
            if lines.path.name in error.message:
                raise
            raise lines.fault(error.message) from error


def _whole(words: Sequence[str]) -> bool:
    """Return whether a range X1 X2 of the chord is all of it."""
    try:
        return [float(x) for x in words] == [0.0, 1.0]
    except ValueError:
        return False


def _coordinates(lines: _Lines, key: str) -> Airfoil:
    if key == "NACA":
        digits = lines.text("the digits of a NACA section").split()[0]
        return Airfoil(f"naca{digits}", naca(digits))
    if key == "AFILE":
        return airfoil(lines.text("the name of a file").strip("\"'"), lines.path.parent)
    rows = []
    while lines.keyword() == "" and re.match(r"[-+.\d]", lines.rows[lines.at][1]):
        rows.append(lines.numbers("x/c y/c", 2)[:2])
    return Airfoil("as listed", normalised(rows, str(lines.path)))


def _meanings(lines: _Lines, controls: dict[Moved, str | None], names: set[str], notes: list[str]) -> dict[str, Moved]:
    """Return name of CONTROL lines -> control channel."""
    out: dict[str, Moved] = {}
    faults = []
    said = {n for n in controls.values() if n}
    for moved, named in controls.items():
        if named and named not in names:
            faults.append(
                f"{lines.path}: [control.{moved}] names '{named}', which no CONTROL line has{nearest(named, names)}"
            )
        elif named:
            out[named] = moved
    for name in sorted(names - said):
        guess = next((m for start, m in _GUESSED.items() if name.lower().startswith(start)), None)
        if guess is not None and name.lower().startswith("elevon"):
            guess = None
        if guess is None or controls.get(guess):
            notes.append(f"CONTROL '{name}' left out and held at zero: no [control.de], da or dr names it")
        elif guess not in controls:
            faults.append(
                f"{lines.path}: CONTROL '{name}' needs its throw: give [control.{guess}] throw_deg beside the AVL file"
            )
        else:
            out[name] = guess
    for moved in controls:
        if moved not in out.values() and not controls[moved]:
            faults.append(
                f"{lines.path}: [control.{moved}] needs a CONTROL line that it moves, got "
                f"{', '.join(sorted(names)) or 'none'}"
            )
    if faults:
        raise ScenarioError(faults)
    return out


def _lifting(
    lines: _Lines, surface: _Surface, meaning: dict[str, Moved], spare: str | None, unit_m: float
) -> LiftingSurface:
    """Return a surface in metres, with its flaps; refuse what has no coordinates."""
    stations = []
    for number, s in enumerate(surface.sections, 1):
        section = s.airfoil or (airfoil(spare, lines.path.parent) if spare else None)
        if section is None:
            raise lines.fault(
                f"section {number} of surface '{surface.name}' must have coordinates (NACA, AFILE or AIRFOIL), "
                "got none: AVL "
                "takes a flat plate, which has no drag; give one, or spare_airfoil beside the AVL file",
                s.line,
            )
        x, y, z = (unit_m * (v * k + d) for v, k, d in zip(s.xyz, surface.scale, surface.shift, strict=True))
        stations.append(Station(x, y, z, unit_m * s.chord * surface.scale[0], s.incidence + surface.angle, section))
    ys = [s.y_m for s in stations]
    if min(ys) < -1e-9 < 1e-9 < max(ys):
        raise lines.fault(
            f"surface '{surface.name}' must be one side with YDUPLICATE 0, got both sides in one", surface.line
        )
    whole = LiftingSurface(surface.name, "wing", surface.mirrored, tuple(stations))
    if not whole.length_m > 0.0:
        raise lines.fault(f"surface '{surface.name}' must have span, got none", surface.line)
    if min(ys) < -1e-9:
        if not surface.mirrored:
            raise lines.fault(f"surface '{surface.name}' must lie right of y = 0 or in it", surface.line)
        whole = replace(whole, stations=tuple(replace(s, y_m=-s.y_m) for s in stations))
    flaps = []
    along = whole.along
    for i, (a, b) in enumerate(zip(surface.sections[:-1], surface.sections[1:], strict=True)):
        ends = {k.name: k for k in b.controls}
        for k in a.controls:
            if k.name not in ends or k.name not in meaning:
                continue
            moved, other = meaning[k.name], ends[k.name]
            if min(k.hinge, other.hinge) < 0.0:
                raise lines.fault(
                    f"CONTROL '{k.name}' must lie at the trailing edge (Xhinge > 0), or move the whole surface (0)",
                    k.line,
                )
            _check_sign(lines, k, moved, surface.mirrored)
            fraction = 1.0 - 0.5 * (k.hinge + other.hinge)
            if not 0.0 < fraction <= 1.0:
                raise lines.fault(
                    f"Xhinge must be 0 or more, and less than 1, got {k.hinge:g} and {other.hinge:g}", k.line
                )
            if along[i + 1] > along[i]:
                way = [b.xyz[j] - a.xyz[j] for j in range(3)]
                turned = -1.0 if sum(v * w for v, w in zip(k.axis, way, strict=True)) < 0.0 else 1.0
                flaps.append(Flap(moved, along[i], along[i + 1], fraction, turned * 0.5 * (k.gain + other.gain)))
    return replace(whole, flaps=tuple(flaps))


def _check_sign(lines: _Lines, k: _Control, moved: Moved, mirrored: bool) -> None:
    wanted = 1.0 if moved == "de" else -1.0
    if mirrored and k.sign * wanted <= 0.0:
        words = "both sides together (SgnDup 1)" if moved == "de" else "the sides against each other (SgnDup -1)"
        raise lines.fault(f"CONTROL '{k.name}', taken as {moved}, must move {words}, got {k.sign:g}", k.line)


def _geared(surfaces: list[LiftingSurface], notes: list[str]) -> list[LiftingSurface]:
    """Return the surfaces with gains over that of the first part of the largest surface that the control moves.

    The sign of AVL's variable and its size are lost: positive deflections are those of core/channels.py, in degrees.
    """
    first: dict[Moved, float] = {}
    for s in sorted(surfaces, key=lambda s: -s.area_m2):
        for f in s.flaps:
            first.setdefault(f.moves, f.gain)
    for moved, gain in first.items():
        if gain == 0.0:
            raise ScenarioError(f"the CONTROL taken as {moved} must have a gain, got 0")
        if gain < 0.0:
            notes.append(
                f"the gain of the CONTROL taken as {moved} is negative: {moved} is positive as the testbench has it"
            )
    return [replace(s, flaps=tuple(replace(f, gain=f.gain / first[f.moves]) for f in s.flaps)) for s in surfaces]


def _joined(surfaces: list[LiftingSurface]) -> list[LiftingSurface]:
    """Return the surfaces with those joined that begin where another one ends."""
    out: list[LiftingSurface] = []
    for s in surfaces:
        before = next((o for o in out if o.mirrored == s.mirrored and _meet(o, s)), None)
        if before is None:
            out.append(s)
            continue
        stations = (*before.stations, *s.stations[1:])
        whole = replace(before, name=f"{before.name} and {s.name}", stations=stations, flaps=())
        at = before.length_m / whole.length_m
        flaps = [replace(f, start=f.start * at, end=f.end * at) for f in before.flaps]
        flaps += [replace(f, start=at + f.start * (1 - at), end=at + f.end * (1 - at)) for f in s.flaps]
        out[out.index(before)] = replace(whole, flaps=tuple(flaps))
    return out


def _meet(a: LiftingSurface, b: LiftingSurface) -> bool:
    """Say whether ``b`` begins where ``a`` ends, in line with it."""
    end, start = a.stations[-1], b.stations[0]
    gap = math.dist((end.x_m, end.y_m, end.z_m), (start.x_m, start.y_m, start.z_m))
    flat = [abs(s.stations[-1].y_m - s.stations[0].y_m) > abs(s.stations[-1].z_m - s.stations[0].z_m) for s in (a, b)]
    return gap < 1e-3 * a.length_m and abs(end.chord_m - start.chord_m) < 1e-2 * end.chord_m and flat[0] == flat[1]


def _roles(surfaces: list[LiftingSurface]) -> list[LiftingSurface]:
    """Return the surfaces with their roles, the wing first: upright ones are fins, the largest flat one is the wing."""
    upright = []
    for s in surfaces:
        a, b = s.stations[0], s.stations[-1]
        slope = math.degrees(math.atan2(abs(b.z_m - a.z_m), abs(b.y_m - a.y_m)))
        upright.append(slope > _UPRIGHT_DEG or not s.mirrored)
    flat = [s for s, up in zip(surfaces, upright, strict=True) if not up]
    if not flat:
        raise ScenarioError("an AVL file must hold a wing: a SURFACE along y with YDUPLICATE 0")
    wing = max(flat, key=lambda s: s.projected_m2)
    out = []
    for s, up in zip(surfaces, upright, strict=True):
        near = abs(s.quarter_chord_m[0] - wing.quarter_chord_m[0]) < _BESIDE * wing.mean_chord_m
        role: Role = "fin" if up else "wing" if s is wing or near else "tail"
        out.append(replace(s, role=role))
    return sorted(out, key=lambda s: s.stations != wing.stations)
