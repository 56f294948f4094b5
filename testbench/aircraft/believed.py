"""The believed aircraft as one of many that it may be: coefficients drawn by the deviations that it states.

    C_i = C (1 + s_i e_i),    e_i independent and standard normal

with C the coefficient of the model and s_i its relative standard deviation (``[uncertainty]`` of aircraft.toml). This
is the prior that ``gap`` takes. The mean is the believed value. Where s_i is large the sign is not known, and some
draws have the other one.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

from testbench.aircraft.amend import Amendment, Change, ScaleCoefficient
from testbench.aircraft.geometry.coefficients import ROWS, relative_deviation
from testbench.aircraft.model import Aircraft
from testbench.aircraft.seams import INERTIAS, moved_centre, scaled_mass, with_setting
from testbench.core.constants import PERCENT
from testbench.core.errors import ModelError, nearest
from testbench.core.generators import keyed_generator

_CENTRE = {"cg_x_m": (0, -1.0), "cg_y_m": (1, 1.0), "cg_z_m": (2, -1.0)}
AIRCRAFT_KEYS = ("mass_percent", "inertia_percent", *(f"{i}_percent" for i in INERTIAS), "cg_x_m", "cg_y_m", "cg_z_m")
KEY = "coefficient."
"""What the name of a coefficient stands behind where it is varied; with it, it names the generator of its draws."""

_PREFIX = "aero/coefficient/"
_NOTHING = 1e-9  # a coefficient that is found by differences and is smaller is zero


def coefficient_names(aircraft: Aircraft) -> tuple[str, ...]:
    """Return the coefficients that can be scaled.

    A model in the testbench's own form has a function ``aero/coefficient/NAME`` for each. A foreign model has those
    that perturbing it finds to differ from zero.
    """
    if aircraft.adapter is not None:
        return tuple(n for n, v in aircraft.perturbed.items() if abs(v) > _NOTHING)
    return _functions(aircraft.xml)


@lru_cache(maxsize=32)
def _functions(xml: str) -> tuple[str, ...]:
    """Return the coefficients that a model in the testbench's own form has a function for; parsed once."""
    names = (str(f.get("name")) for f in ET.fromstring(xml).iter("function"))
    return tuple(n.removeprefix(_PREFIX) for n in names if n.startswith(_PREFIX))


def stated_deviations(aircraft: Aircraft) -> Mapping[str, float]:
    """Return coefficient -> relative standard deviation, of an aircraft that states them.

    Raises:
        ModelError: it states none; one of a coefficient that it does not have; or one of a coefficient that is zero,
            of which a relative deviation says nothing.
    """
    if not aircraft.uncertainty:
        raise ModelError(
            f"{aircraft.name} must state how well its coefficients are known, but it has no [uncertainty]; write that "
            "into aircraft.toml of a folder of your own, e.g. Cm_alpha = 0.2 for a relative standard deviation of 20 %"
        )
    names = coefficient_names(aircraft)
    for name in aircraft.uncertainty:
        if name not in names:
            raise ModelError(
                f"[uncertainty] of {aircraft.name} must name coefficients of the model, got '{name}'"
                f"{nearest(name, names)}"
            )
        if f"{_PREFIX}{name}" in _zeros(aircraft.xml):
            raise ModelError(
                f"[uncertainty] of {aircraft.name} must be relative to values that are not zero, got '{name}', "
                "which is zero in the model; give it a value, or leave it out"
            )
    return aircraft.uncertainty


def drawn(aircraft: Aircraft, seed: int, index: int) -> Aircraft:
    """Return the aircraft with every coefficient of a stated deviation drawn, all independent.

    Draw ``index`` is that of run ``index`` of a campaign with the same seed that draws all of them.

    Raises:
        ModelError: see :func:`stated_deviations`.
    """
    changes = tuple(
        ScaleCoefficient(name, 1.0 + std * float(keyed_generator(seed, index, f"{KEY}{name}").standard_normal()))
        for name, std in stated_deviations(aircraft).items()
    )
    return aircraft.amended(Amendment(f"draw {index}", "coefficients within their stated uncertainty", changes))


def with_priors(aircraft: Aircraft) -> Aircraft:
    """Return the aircraft with deviations of its coefficients: those that it states, else what handbooks reach."""
    if aircraft.uncertainty:
        return aircraft
    values = {n: aircraft.coefficient(n) for n in coefficient_names(aircraft) if n in ROWS}
    slope = values.get("CL_alpha", 0.0)
    handbook = {
        n: min(1.0, relative_deviation(n, abs(v), abs(slope))) for n, v in values.items() if abs(v) > _NOTHING and slope
    }
    return replace(aircraft, uncertainty=handbook)


@lru_cache(maxsize=16)
def _zeros(xml: str) -> frozenset[str]:
    """Return the functions of a JSBSim model whose factor is zero; kept, as a study draws thousands of aircraft."""
    return frozenset(
        f.get("name", "")
        for f in ET.fromstring(xml).iter("function")
        if any(float(value.text or "nan") == 0.0 for value in f.findall("product/value"))
    )


# --- numbers changed by key -------------------------------------------------------------------------------------------


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
