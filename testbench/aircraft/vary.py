"""Change the numbers of an aircraft by key: what campaigns vary and what flights are differentiated by.

aircraft.mass_percent, .Ixx_percent, .Iyy_percent, .Izz_percent, .Ixz_percent, .inertia_percent
                              change of the mass, of one moment of inertia, of all of them, percent
aircraft.cg_x_m, .cg_y_m, .cg_z_m
                              shift of the centre of gravity forward, right, down
coefficient.NAME              factor on an aerodynamic coefficient
property.NAME                 value of a property, in its own unit
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from testbench.aircraft.amend import Amendment, Change, ScaleCoefficient
from testbench.aircraft.believed import coefficient_names
from testbench.aircraft.model import Aircraft
from testbench.aircraft.seams import INERTIAS, moved_centre, scaled_mass, with_setting
from testbench.core.constants import PERCENT
from testbench.core.errors import ModelError, nearest

_CENTRE = {"cg_x_m": (0, -1.0), "cg_y_m": (1, 1.0), "cg_z_m": (2, -1.0)}
AIRCRAFT_KEYS = ("mass_percent", "inertia_percent", *(f"{i}_percent" for i in INERTIAS), "cg_x_m", "cg_y_m", "cg_z_m")


def varied(aircraft: Aircraft, values: Mapping[str, Any], amendment: str, words: str) -> Aircraft:
    """Return the aircraft with other numbers; keys that say nothing of an aircraft are left alone.

    Args:
        aircraft: as it is.
        values: key -> value.
        amendment: name of the amendment that holds the changes.
        words: what it is.

    Raises:
        ModelError: the aircraft has no such coefficient or property, or a change that it cannot take.
    """
    changes: list[Change] = []
    shift = [0.0, 0.0, 0.0]  # aft, right, up, as JSBSim's structural axes run
    as_loaded = aircraft
    for key, value in values.items():
        head, _, name = key.partition(".")
        if head == "coefficient" and name:
            _check_coefficient(as_loaded, name)
            changes.append(ScaleCoefficient(name, float(value)))
        elif head == "property" and name:
            aircraft, edits = with_setting(aircraft, name, float(value))
            changes += edits
        elif head == "aircraft" and name:
            if name in _CENTRE:
                axis, sign = _CENTRE[name]
                shift[axis] = sign * float(value)
                continue
            if name not in AIRCRAFT_KEYS:
                raise ModelError(f"unknown key 'aircraft.{name}'{nearest(name, AIRCRAFT_KEYS)}")
            factor = 1.0 + float(value) * PERCENT
            if factor <= 0.0 and name != "Ixz_percent":
                raise ModelError(f"aircraft.{name} > -100 must hold, got {value:g}")
            kinds = {"mass_percent": ("mass_kg",), "inertia_percent": INERTIAS}.get(name, (name.split("_")[0],))
            edits, mass = scaled_mass(aircraft, dict.fromkeys(kinds, factor))
            aircraft = replace(aircraft, mass=mass)
            changes += edits
    if any(shift):
        changes += moved_centre(aircraft, shift)  # of the mass that it has by now
    if not changes:
        return aircraft
    return aircraft.amended(Amendment(amendment, words, tuple(changes)))


def _check_coefficient(aircraft: Aircraft, name: str) -> None:
    """Refuse a coefficient that an aircraft does not have.

    Raises:
        ModelError: the model in the testbench's own form has no function for it; that of a foreign one is zero.
    """
    known = coefficient_names(aircraft)
    if name not in known:
        raise ModelError(
            f"{aircraft.name} must have the coefficient that is varied, got '{name}'{nearest(name, known)}"
        )
