"""The seams through which any aircraft can be changed: commands, surfaces, mass and thrust.

A model in the testbench's own form is changed in its XML. A foreign one is changed beside it: its controls have a way
of their own (:mod:`testbench.aircraft.adapter`), its mass and inertia as flown include fuel and point masses and are
changed by what is added to them, its engines keep what they do and more force is added in proportion. Increments of the
coefficients are :class:`testbench.aircraft.amend.Increment`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import replace

from testbench.aircraft.amend import AddInertia, Amendment, Change, Insert, SetProperty, SetText
from testbench.aircraft.model import Aircraft, MassProperties
from testbench.aircraft.paths import ControlPath, path_of
from testbench.core.constants import FT_M, G0_M_S2, JSBSIM_LENGTH_M, LBF_N
from testbench.core.errors import ModelError

INERTIAS = ("Ixx", "Iyy", "Izz", "Ixz")
_IN_M = FT_M / 12.0
_LB_KG = LBF_N / G0_M_S2
_CENTRE = "mass_balance/location[@name='CG']"


# --- command and surface ----------------------------------------------------------------------------------------------


def control_path(aircraft: Aircraft, control: str) -> ControlPath:
    """Return the names on the way of a control as it is.

    Raises:
        ModelError: the aircraft has no such control.
    """
    path = path_of(aircraft.adapter, control) if control in aircraft.controls else None
    if path is None:
        words = {"de": "elevator", "da": "aileron", "dr": "rudder", "thr": "engine with a throttle"}
        raise ModelError(f"{aircraft.name} has no {words[control]} that could be changed")
    return path


def opened(aircraft: Aircraft, control: str) -> tuple[Aircraft, ControlPath]:
    """Return the aircraft with command and surface of a control apart, so that something can be put between, and the
    way of the control.

    A foreign surface without a servo is where its command is; it then follows the command by a component of its own.

    Raises:
        ModelError: the aircraft has no such control.
    """
    path = control_path(aircraft, control)
    adapter = aircraft.adapter
    link = None if adapter is None else adapter.link(control)
    if adapter is not None and link is not None and link.surface == link.command:
        links = tuple(replace(x, apart=True) if x is link else x for x in adapter.links)
        aircraft = replace(aircraft, adapter=replace(adapter, links=links))
        path = control_path(aircraft, control)
    return aircraft, path


def with_servo(aircraft: Aircraft, control: str, lag_rad_s: float) -> tuple[Aircraft, tuple[Change, ...]]:
    """Return the aircraft with a first-order servo of that corner frequency, and the changes that are to be made to it.

    Raises:
        ModelError: the aircraft has no such control.
    """
    path = control_path(aircraft, control)
    if path.lag is not None:
        return aircraft, (SetProperty(path.lag, lag_rad_s),)
    adapter = aircraft.adapter
    if adapter is None or adapter.link(control) is None:
        raise ModelError(f"the {path.word} of {aircraft.name} has no servo")
    links = tuple(replace(x, lag_rad_s=lag_rad_s) if x.control == control else x for x in adapter.links)
    return replace(aircraft, adapter=replace(adapter, links=links)), ()


# --- mass -------------------------------------------------------------------------------------------------------------


def scaled_mass(aircraft: Aircraft, factors: Mapping[str, float]) -> tuple[tuple[Change, ...], MassProperties]:
    """Return the changes that multiply mass and inertia about the centre of gravity, as flown, and the result.

    Args:
        aircraft: foreign or not.
        factors: "mass_kg", "Ixx", "Iyy", "Izz" or "Ixz" -> factor; one does not change the others.

    Raises:
        ModelError: a model in the testbench's own form does not hold the element.
    """
    mass = aircraft.mass
    changes: list[Change] = []
    for name, factor in factors.items():
        value = getattr(mass, name)
        mass = replace(mass, **{name: value * factor})
        if aircraft.adapter is None:
            path = "mass_balance/" + ("emptywt" if name == "mass_kg" else name.lower())
            written = ET.fromstring(aircraft.xml).findtext(path)
            if written is None:
                raise ModelError(f"{aircraft.name} must hold {path} to have it changed, it does not")
            changes.append(SetText(path, float(written) * factor))
        elif name == "mass_kg":
            changes.append(_point("testbench-mass", value * (factor - 1.0), _centre_in(aircraft)))
        else:
            changes.append(AddInertia(name, value * (factor - 1.0)))
    return tuple(changes), mass


def moved_centre(aircraft: Aircraft, shift_m: Sequence[float]) -> tuple[Change, ...]:
    """Return the changes that move the centre of gravity; mass and inertia about it stay.

    Args:
        aircraft: foreign or not. To a foreign one a pair of masses is added, one of them negative, and the inertia that
            it has about the new centre is made up for.
        shift_m: aft, right, up (structural axes).

    Raises:
        ModelError: a model in the testbench's own form does not say where its centre of gravity is.
    """
    if aircraft.adapter is None:
        place = ET.fromstring(aircraft.xml).find(_CENTRE)
        unit = "" if place is None else (place.get("unit") or "").upper()
        if place is None or unit not in JSBSIM_LENGTH_M or any(place.findtext(axis) is None for axis in "xyz"):
            raise ModelError(
                f"{aircraft.name} must say where its centre of gravity is (<location name='CG'> in M, FT or IN), it "
                "does not"
            )
        return tuple(
            SetText(f"{_CENTRE}/{axis}", float(str(place.findtext(axis))) + shift / JSBSIM_LENGTH_M[unit])
            for axis, shift in zip("xyz", shift_m, strict=True)
            if shift
        )
    aft, right, up = shift_m
    M, span = aircraft.mass.mass_kg, aircraft.geometry.b_m
    kg = M / span  # half a span to either side, so that the pair moves the centre by the shift times the span
    ends = [
        tuple(c + sign * 0.5 * span * s / _IN_M for c, s in zip(_centre_in(aircraft), shift_m, strict=True))
        for sign in (1.0, -1.0)
    ]
    pair = (_point("testbench-aft", kg, ends[0]), _point("testbench-fore", -kg, ends[1]))
    square = aft * aft + right * right + up * up
    inertia = (
        AddInertia("Ixx", M * (square - aft * aft)),
        AddInertia("Iyy", M * (square - right * right)),
        AddInertia("Izz", M * (square - up * up)),
        AddInertia("Ixz", -M * aft * up),
        AddInertia("Ixy", -M * aft * right),
        AddInertia("Iyz", -M * right * up),
    )
    return (*pair, *inertia)


def added_load(aircraft: Aircraft, kg: float, aft_m: float, right_m: float = 0.0) -> tuple[Change, ...]:
    """Return the change that adds a point mass behind, and beside, the centre of gravity of the aircraft as loaded."""
    if aircraft.adapter is None:
        point = (
            f'<pointmass name="payload"> <weight unit="KG">{kg!r}</weight> '
            f'<location unit="M"> <x>{aft_m!r}</x> <y>{right_m!r}</y> <z>0</z> </location> </pointmass>'
        )
        return (Insert("mass_balance", point),)
    x, y, z = _centre_in(aircraft)
    return (_point("payload", kg, (x + aft_m / _IN_M, y + right_m / _IN_M, z)),)


def _centre_in(aircraft: Aircraft) -> tuple[float, float, float]:
    if aircraft.adapter is None or aircraft.adapter.cg_in is None:
        raise ModelError(f"{aircraft.name} must be loaded with load_aircraft before its mass is changed")
    return aircraft.adapter.cg_in


def _point(name: str, kg: float, at_in: Sequence[float]) -> Insert:
    """Return the change that adds a point mass, which may be negative: JSBSim sums masses whatever their sign."""
    place = " ".join(f"<{axis}>{float(v)!r}</{axis}>" for axis, v in zip("xyz", at_in, strict=True))
    return Insert(
        "mass_balance",
        f'<pointmass name="{name}"> <weight unit="LBS">{kg / _LB_KG!r}</weight> '
        f'<location unit="IN"> {place} </location> </pointmass>',
    )


def with_setting(aircraft: Aircraft, name: str, value: float) -> tuple[Aircraft, tuple[Change, ...]]:
    """Return the aircraft with another value of a property that the model declares, or that it is told before it flies,
    and the changes that are to be made to it; which of the two is found when the model is written."""
    adapter = aircraft.adapter
    if adapter is not None and name in adapter.settings:
        settings = {**adapter.settings, name: value}
        return replace(aircraft, adapter=replace(adapter, settings=settings)), ()
    return aircraft, (SetProperty(name, value),)


def changed(aircraft: Aircraft, name: str, text: str, *changes: Change) -> Aircraft:
    """Return the aircraft with one amendment of these changes."""
    return aircraft.amended(Amendment(name, text, changes))
