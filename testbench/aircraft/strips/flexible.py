"""An aircraft made flexible: the modes of a ground test, coupled to it by strips."""

from __future__ import annotations

import math
import re
import textwrap
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from testbench.aircraft.airframe import WingStation
from testbench.aircraft.elastic import COEFFICIENTS, ElasticModel
from testbench.aircraft.model import Aircraft
from testbench.aircraft.strips.fit import FittedStrips, drawn_of, fit_strips
from testbench.aircraft.strips.ground_test import GroundTest, check_span
from testbench.aircraft.strips.loads import STRIPS, Shape, Tail, Vibration, Wing, coupled_modes, scaled
from testbench.aircraft.strips.ritz import Inertia, asymmetric_inertia, heave_and_pitch, roll, symmetric_inertia
from testbench.core.errors import Faults, ModelError, ScenarioError, located
from testbench.core.escape import one_line, quoted
from testbench.core.record import FloatArray

_AT_TIP = 0.98  # of the half span: a last station beyond this shows how a free tip bends
_WIDTH = 118
STATIONS = 17
"""Stations at which shapes are written, root and tip among them."""
FRAMES = 16.0
"""Frames per period of the fastest mode, at least: eolo flies 16.4 and its flights do not depend on the step."""
_RATE_HZ = (
    200.0  # a faster simulation runs at a multiple of it, which records at 100, 50, 40, 25, 20, 10 and 8 Hz divide
)
ETA_LIMIT = 3.0
"""A flight is aborted beyond this many units of a mode."""
_SENSORS = (0.2, 0.4, 0.6, 0.8, 0.95)  # of the half span
_THICKNESS = 0.10  # of the wing, in chords


@dataclass(frozen=True)
class Origin:
    """Where the numbers of a mode come from: its generalised mass, and what a unit of its coordinate is."""

    mass: str
    unit: str


@dataclass(frozen=True, eq=False)
class Flexible:
    """An aircraft with elastic modes, and how they came about."""

    aircraft: Aircraft  # it can fly
    strips: FittedStrips  # that couple the modes, with the source of every constant
    stations_m: FloatArray  # (n,) of the shapes
    origins: tuple[Origin, ...]  # one per mode
    notes: tuple[str, ...]  # what was assumed or changed beside, as sentences
    new_stations: bool  # its wing stations are new; else they are those that the rigid aircraft had
    raised: bool  # it is simulated at a higher rate than the rigid aircraft


def make_flexible(aircraft: Aircraft, test: GroundTest, own: Mapping[str, float]) -> Flexible:
    """Return a rigid aircraft with the modes of a ground test coupled to it.

    Args:
        aircraft: rigid.
        test: its modes.
        own: the aircraft's own derivatives, as :func:`testbench.aircraft.strips.fit.fit_strips` takes them.

    Raises:
        ModelError: the aircraft is flexible already, its model cannot take the forces, or strips cannot be found.
        ScenarioError: the file does not fit the aircraft: stations beyond the wing, masses that it cannot have.
    """
    content, notes = test.content, []
    if aircraft.elastic is not None:
        raise ModelError(
            f"an aircraft that is made flexible must be rigid, but {aircraft.name} has elastic modes already"
        )
    with located(test.path, "wing"):
        strips = fit_strips(aircraft, content, own)
    if drawn_of(aircraft) is not None:
        drawn = [name for name in ("wing", "tail", "fin") if getattr(content, name) is None]
        if drawn:
            notes.append(f"the plan form of {', '.join(drawn)} is that of the aircraft's drawing")
    wing = strips.symmetric.wing
    half = 0.5 * wing.span_m
    check_span(test, half)
    inertias = _inertias(aircraft, test, strips)
    vibrations, origins = [], []
    for mode, measured in zip(content.mode, test.shapes, strict=True):
        bend, twist, curvature = on_strips(
            wing, measured.y_m, measured.bend_m, measured.twist_rad, measured.curvature_1_m
        )
        shape = Shape(
            bend,
            twist,
            curvature,
            mode.tail_up_m,
            mode.tail_pitch_rad,
            mode.tail_side_m,
            mode.tail_roll_rad,
            mode.tail_yaw_rad,
            symmetric=mode.symmetry == "symmetric",
        )
        mass, said = mode.mass_kg_m2, "given"
        if content.normalisation == "mass":
            mass, said = 1.0, "1 kg m2, as the shapes are mass-normalised"
        if mass is None:
            assert content.mass is not None
            mass = generalised_mass(shape, wing, strips.symmetric.tail, inertias[shape.symmetric])
            said = f"from the distribution of mass, which is {content.mass.evidence}"
        unit = "the shape as it is given"
        if mode.unit == "largest":
            size, unit = largest_motion(shape, wing, aircraft.geometry.cbar_m)
            shape, mass = in_units(shape, mass, size)
        if mode.name in test.untwisted:
            notes.append(f"{mode.name} came without twist: none is assumed")
        if measured.y_m[-1] < half * (1.0 - 1e-9):
            notes.append(
                f"the shape of {mode.name} goes on straight from {measured.y_m[-1]:g} m to the tip, {half:g} m"
            )
        vibrations.append(Vibration(mode.name, mode.f_hz, mode.zeta, mass, shape))
        origins.append(Origin(said, unit))
    stations = np.linspace(0.0, half, STATIONS)
    modes = coupled_modes(vibrations, strips.symmetric, strips.asymmetric, stations)
    moved = {"de", "da", "dr"} - set(aircraft.controls)
    modes = tuple(replace(m, force={k: c for k, c in m.force.items() if k not in moved}) for m in modes)
    _check_axes(aircraft, modes)
    fastest = max(m.f_hz for m in modes)
    rate = aircraft.rate_hz
    if rate < FRAMES * fastest:
        rate = _RATE_HZ * math.ceil(FRAMES * fastest / _RATE_HZ)
        notes.append(
            f"the simulation runs at {rate:g} instead of {aircraft.rate_hz:g} frames per second, "
            f"{FRAMES:g} or more per period of {fastest:g} Hz"
        )
    flown = aircraft.wing_stations or _sensors(strips, content.strips.section_thickness or _THICKNESS)
    if not aircraft.wing_stations and content.strips.section_thickness is None:
        notes.append(f"strain gauges sit on a section {100.0 * _THICKNESS:g} % thick: assumed")
    elastic = ElasticModel(modes, aircraft.geometry.S_m2, aircraft.geometry.cbar_m, tuple(map(float, stations)))
    made = replace(
        aircraft,
        title=content.title or _title(aircraft, len(modes)),
        elastic=elastic,
        wing_stations=flown,
        rate_hz=rate,
        limits={**aircraft.limits, "eta": (-ETA_LIMIT, ETA_LIMIT)},
    )
    return Flexible(
        made, strips, stations, tuple(origins), tuple(notes), not aircraft.wing_stations, rate != aircraft.rate_hz
    )


def _title(aircraft: Aircraft, count: int) -> str:
    return f"{aircraft.title.removesuffix(', rigid')}, with {count} elastic mode{'s' if count > 1 else ''}"


def _inertias(aircraft: Aircraft, test: GroundTest, strips: FittedStrips) -> dict[bool, Inertia]:
    """Return the kinetic coupling of either symmetry; empty if no generalised mass follows from it."""
    mass, faults = test.content.mass, Faults(test.path)
    if mass is None:
        return {}
    wing, tail, whole = strips.symmetric.wing, strips.symmetric.tail, aircraft.mass
    if wing.mass_kg + tail.mass_kg >= whole.mass_kg:
        faults.note(
            "mass.wing_kg",
            f"wing and tail must be lighter than the aircraft, {whole.mass_kg:g} kg, got "
            f"{wing.mass_kg + tail.mass_kg:.4g} kg",
        )
        raise ScenarioError(faults)
    found = {
        True: symmetric_inertia(wing, tail, whole.mass_kg, whole.Iyy),
        False: asymmetric_inertia(wing, tail, whole.Ixx),
    }
    zero = np.zeros(STRIPS)
    up, pitch = Shape(zero, zero, body_up=1.0), Shape(zero, zero, body_pitch=1.0)
    turn = Shape(zero, zero, body_roll=1.0, symmetric=False)
    of_body = found[True](up, up) * found[True](pitch, pitch) - found[True](up, pitch) ** 2
    used = {m.symmetry for m in test.content.mode if m.mass_kg_m2 is None}
    for symmetry, left, name in (
        ("symmetric", of_body, f"Iyy = {whole.Iyy:g}"),
        ("asymmetric", found[False](turn, turn), f"Ixx = {whole.Ixx:g}"),
    ):
        if symmetry in used and left <= 0.0:
            faults.note(
                "mass.wing_kg",
                f"wing and tail must have less inertia than the aircraft, {name} kg m2, which leaves none for the "
                "fuselage; make them lighter",
            )
    if faults:
        raise ScenarioError(faults)
    return found


def _check_axes(aircraft: Aircraft, modes: tuple[object, ...]) -> None:
    """Check that the model has every axis on which the modes act; JSBSim would leave their forces out."""
    axes = {a.get("name") for a in ET.fromstring(aircraft.xml).findall("aerodynamics/axis")}
    acting = {c for m in modes for table in ("effect_eta", "effect_etadot") for c in getattr(m, table)}
    missing = sorted({COEFFICIENTS[c][0] for c in acting} - axes)
    if missing:
        raise ModelError(
            f"the modes act on the axes LIFT, SIDE, ROLL, PITCH and YAW, but the model of {aircraft.name} has no "
            f"{', '.join(missing)}; it must have its forces along the wind"
        )


def _sensors(strips: FittedStrips, thickness: float) -> tuple[WingStation, ...]:
    wing = strips.symmetric.wing
    half = 0.5 * wing.span_m
    right = [
        WingStation(
            round(s * half, 4),
            0.0,
            float(f"{0.5 * thickness * wing.root_chord_m * (1.0 - (1.0 - wing.taper) * s):.3g}"),
        )
        for s in (0.0, *_SENSORS)
    ]
    return (*(replace(s, y_m=-s.y_m) for s in reversed(right[1:])), *right)


# --- aircraft.toml ----------------------------------------------------------------------------------------------------


def flexible_toml(rigid: str, made: Flexible, test: GroundTest, name: str) -> str:
    """Return the text of aircraft.toml.

    Args:
        rigid: text of the rigid aircraft's file; what is not changed keeps its comments.
        made: the flexible aircraft.
        test: its modes.
        name: of the rigid aircraft.

    Raises:
        ModelError: the rigid aircraft's file does not have its keys where they can be changed.
    """
    text = rigid if rigid.endswith("\n") else rigid + "\n"
    text = _replaced(text, r"^title\s*=.*$", f"title = {quoted(made.aircraft.title)}", "title")
    if made.raised:
        rate = (
            f"rate_hz = {made.aircraft.rate_hz!r}           # {FRAMES:g} frames or more per period of the fastest mode"
        )
        text = _replaced(text, r"^rate_hz\s*=.*$", rate, "simulation.rate_hz")
    if not re.search(r"^eta\s*=", text, flags=re.MULTILINE):
        limit = f"eta = [{-ETA_LIMIT!r}, {ETA_LIMIT!r}]         # of every mode, in its own unit; see below"
        text = _replaced(text, r"^\[limits\][^\n]*$", f"[limits]\n{limit}", "limits")
    if made.new_stations:
        rows = "".join(
            f"    {{ y_m = {s.y_m!r}, x_m = {s.x_m!r}, height_m = {s.height_m!r} }},\n"
            for s in made.aircraft.wing_stations
        )
        said = _comment(
            "Where instruments may sit on the wing, on its elastic axis: station, and height of the upper skin above "
            "the neutral axis."
        )
        table = re.search(r"^\[", text, flags=re.MULTILINE)
        place = table.start() if table else len(text)
        attached = not text[:place].endswith("\n\n")  # a comment right above the first table belongs to it
        before = text[:place].rstrip("\n")
        *head, last = before.split("\n\n") if "\n\n" in before else ("", before)
        comments = last if attached and head and all(line.startswith("#") for line in last.splitlines()) else ""
        before = "\n\n".join(head) if comments else before
        text = f"{before}\n\n{said}wing_station = [\n{rows}]\n\n{comments}{chr(10) if comments else ''}{text[place:]}"
    of = one_line(f"{name} and {test.path.name}")
    first = f"# Made by `testbench aircraft flexible` from {of}; made anew each time.\n"
    return f"{first}{text.rstrip()}\n\n{_sources(made, test)}\n{_elastic(made, test)}"


def _elastic(made: Flexible, test: GroundTest) -> str:
    elastic = made.aircraft.elastic
    assert elastic is not None
    comments = [
        _comment(
            f"Frequency, damping and shape {test.content.evidence}; generalised mass {origin.mass}. One unit of eta: "
            f"{origin.unit}. All coefficients derived."
        )
        for origin in made.origins
    ]
    return elastic.toml(lambda value: f"{value:.5g}", comments)


def _sources(made: Flexible, test: GroundTest) -> str:
    """Return what is measured, derived and assumed, as comments."""
    out = _comment(f"Elastic modes of {test.path.name}: {test.content.source}")
    out += _comment(
        "Derived: the coefficients below, by quasi-steady strips over the shapes (testbench/aircraft/strips), with"
    )
    out += _comment(f"  plan forms: {made.strips.plan_forms}")
    for c in made.strips.constants:
        out += _comment(f"  {c.name}: {c.value:.5g}{f' {c.unit}' if c.unit else ''} ({c.source})")
    out += _comment("Rigid derivatives, the aircraft's own and those of the strips:")
    for d in made.strips.compared:
        out += _comment(f"  {d.name}: {'not known' if d.own is None else f'{d.own:.4g}'} and {d.strips:.4g}")
    for note in made.notes:
        out += _comment(f"Note: {note}.")
    return out


def _comment(text: str) -> str:
    indent = "#   " if text.startswith("  ") else "# "
    lines = textwrap.wrap(one_line(text), _WIDTH, initial_indent=indent, subsequent_indent=indent)
    return "".join(f"{line}\n" for line in lines)


def _replaced(text: str, pattern: str, by: str, key: str) -> str:
    found, count = re.subn(pattern, lambda _: by, text, count=1, flags=re.MULTILINE)
    if count != 1:
        raise ModelError(f"aircraft.toml must have {key} at the beginning of a line of its own, got none")
    return found


# --- measured shapes --------------------------------------------------------------------------------------------------


def on_strips(
    wing: Wing, y_m: FloatArray, bend_m: FloatArray, twist_rad: FloatArray, curvature_1_m: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return displacement, twist and curvature (n,) at the strips of what was measured at stations (k,).

    Cubic splines run through the values. The displacement has no curvature at a free tip, if a station lies there.
    Before the first and beyond the last station the curves go on straight. The curvature is the spline's second
    derivative where it was not given.
    """
    tip = y_m[-1] >= _AT_TIP * 0.5 * wing.span_m
    bend, bent = _curve(y_m, bend_m, free=bool(tip))
    twist, _ = _curve(y_m, twist_rad)
    if curvature_1_m is not None:
        bent, _ = _curve(y_m, curvature_1_m)
    return bend(wing.y), twist(wing.y), bent(wing.y)


_Curve = Callable[[FloatArray], FloatArray]


def _curve(y: FloatArray, values: FloatArray, free: bool = False) -> tuple[_Curve, _Curve]:
    """Return a spline through the values, straight beyond its ends, and its second derivative."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(y, values, bc_type=("not-a-knot", "natural") if free else "not-a-knot")
    first, last = y[0], y[-1]

    def value(at: FloatArray) -> FloatArray:
        inside = np.clip(at, first, last)
        return np.asarray(spline(inside) + spline(inside, 1) * (at - inside))

    def second(at: FloatArray) -> FloatArray:
        return np.asarray(np.where((at >= first) & (at <= last), spline(np.clip(at, first, last), 2), 0.0))

    return value, second


def with_body(shape: Shape, wing: Wing, tail: Tail, inertia: Inertia) -> Shape:
    """Return the shape with the motion of the fuselage that keeps the momentum of the whole aircraft at zero.

    An elastic mode of a free aircraft moves neither its centre of gravity nor its mean axes (M. R. Waszak, D. K.
    Schmidt, J. Aircraft 25(6), 1988, eqs. 3 and 4), so its kinetic coupling with the rigid motions is nothing.
    """
    zero = np.zeros(STRIPS)
    if shape.symmetric:
        rigid = list(heave_and_pitch(wing, tail))
        parts = [Shape(zero, zero, body_up=1.0), Shape(zero, zero, body_pitch=1.0)]
    else:
        rigid, parts = [roll(wing)], [Shape(zero, zero, body_roll=1.0, symmetric=False)]
    still = replace(shape, body_up=0.0, body_pitch=0.0, body_roll=0.0)
    M = np.array([[inertia(r, part) for part in parts] for r in rigid])
    found = np.linalg.solve(M, [-inertia(r, still) for r in rigid])
    if shape.symmetric:
        return replace(still, body_up=float(found[0]), body_pitch=float(found[1]))
    return replace(still, body_roll=float(found[0]))


def generalised_mass(shape: Shape, wing: Wing, tail: Tail, inertia: Inertia) -> float:
    """Return the generalised mass of a shape, kg m2, the fuselage moving so that no momentum is left."""
    moving = with_body(shape, wing, tail, inertia)
    return inertia(moving, moving)


def largest_motion(shape: Shape, wing: Wing, cbar_m: float) -> tuple[float, str]:
    """Return the largest of a shape's motions at tip and tail, and what it is in words.

    Deflections count in chords cbar, rotations in rad; a mode divided by it moves that place by one chord or one rad.
    """
    at_tip = [float(values[-1] + 0.5 * (values[-1] - values[-2])) for values in (shape.bend, shape.twist)]
    chord = f"of one chord ({cbar_m:g} m)"
    found = [
        (at_tip[0] / cbar_m, f"wing-tip deflection {chord}"),
        (at_tip[1], "wing-tip twist of 1 rad"),
        (shape.tail_up / cbar_m, f"tail deflection {chord}"),
        (shape.tail_pitch, "tail rotation of 1 rad nose up"),
        (shape.tail_side / cbar_m, f"tail deflection to the right {chord}"),
        (shape.tail_roll, "tail roll of 1 rad"),
        (shape.tail_yaw, "tail rotation of 1 rad nose right"),
    ]
    return max(found, key=lambda pair: abs(pair[0]))


def in_units(shape: Shape, mass_kg_m2: float, size: float) -> tuple[Shape, float]:
    """Return shape and generalised mass per unit of a coordinate that is ``size`` times as large."""
    return scaled(shape, 1.0 / size), mass_kg_m2 / size**2
