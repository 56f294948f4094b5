"""An aircraft made flexible: the modes of a ground test, coupled to it by strips."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from testbench.aircraft.airframe import WingStation
from testbench.aircraft.elastic import COEFFICIENTS, ElasticModel
from testbench.aircraft.model import Aircraft
from testbench.aircraft.strips.coupling import Vibration, coupled_modes
from testbench.aircraft.strips.fit import FittedStrips, drawn_of, fit_strips
from testbench.aircraft.strips.measured import generalised_mass, in_units, largest_motion, on_strips
from testbench.aircraft.strips.reading import GroundTest, check_span
from testbench.aircraft.strips.ritz import Inertia, asymmetric_inertia, symmetric_inertia
from testbench.aircraft.strips.shapes import STRIPS, Shape
from testbench.core.errors import Faults, ModelError, ScenarioError, located
from testbench.core.record import FloatArray

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
    """An aircraft with elastic modes, and how they came about.

    Attributes:
        aircraft: it can fly.
        strips: that couple the modes, with the source of every constant.
        stations_m: (n,) of the shapes.
        origins: one per mode.
        notes: what was assumed or changed beside, as sentences.
        new_stations: its wing stations are new; else they are those that the rigid aircraft had.
        raised: it is simulated at a higher rate than the rigid aircraft.
    """

    aircraft: Aircraft
    strips: FittedStrips
    stations_m: FloatArray
    origins: tuple[Origin, ...]
    notes: tuple[str, ...]
    new_stations: bool
    raised: bool


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
