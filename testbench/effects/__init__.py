"""The library of physical effects: what a simulation may lack, a table of rows per part of the aircraft.

A row added to ``EFFECTS`` of a table is searched in every record; one of ``ON_REQUEST`` only where it is asked for.
"""

from __future__ import annotations

from collections.abc import Mapping

from testbench.aircraft import Aircraft
from testbench.core.errors import ModelError
from testbench.effects import aerodynamics, air, feedback, linkage, mass, sensor, servo, structure, thrust
from testbench.effects.base import Effect, Parameter
from testbench.sensors import SensorSuite

_TABLES = (structure, servo, linkage, thrust, mass, aerodynamics, feedback, air, sensor)
_OF_AIRCRAFT: dict[str, Effect] = {e.name: e for table in _TABLES for e in table.EFFECTS}

SERVOS: Mapping[tuple[str, str], Effect] = servo.SERVOS | linkage.SERVOS
"""(kind, control) -> effect between command and surface, of every control."""

OTHER_SERVOS: dict[str, Effect] = {e.name: e for e in (*servo.ON_REQUEST, *linkage.ON_REQUEST)}
"""Those that are searched only where the search points to the path of their control, or by name.

Those of the elevator come by name alone (``more_effects``).
"""

ON_REQUEST: dict[str, Effect] = OTHER_SERVOS | {e.name: e for e in (*structure.ON_REQUEST, *aerodynamics.ON_REQUEST)}
"""All that a scenario may ask for by name (``more_effects``) and the library does not hold."""

# The sensor errors listed here are those of the longitudinal channels; `library` makes those of any suite.
EFFECTS: dict[str, Effect] = _OF_AIRCRAFT | sensor.sensor_effects(("V", "alpha", "q", "theta", "az"), pitot=True)


def library(suite: SensorSuite, aircraft: Aircraft | None = None) -> dict[str, Effect]:
    """Return every effect that a belief with this suite may lack, by name.

    Those that ``aircraft`` cannot have, if it is given, are left out: a glider has no thrust that may lag. Lengths may
    be as large as its size allows.
    """
    known = _OF_AIRCRAFT | sensor.sensor_effects((*suite.outputs, *suite.surfaces), sensor.has_pitot(suite))
    if aircraft is None:
        return known
    without = left_out(known, aircraft, suite)
    return {n: e.sized(aircraft) for n, e in known.items() if n not in without}


def catalogue(suite: SensorSuite) -> dict[str, Effect]:
    """Return every effect that can be asked for by name."""
    return library(suite) | ON_REQUEST


def left_out(effects: Mapping[str, Effect], aircraft: Aircraft, suite: SensorSuite) -> dict[str, str]:
    """Return the effects that an aircraft cannot have -> why, in one sentence."""
    out = {}
    for name, effect in effects.items():
        try:
            start = {p.name: p.starts[0] for p in effect.parameters}
            effect.amend(aircraft, suite, start)
        except ModelError as error:
            out[name] = error.message
            continue
        if effect.own_form and aircraft.adapter is None:
            out[name] = f"in {aircraft.name} it is what {effect.own_form} is"
    return out


__all__ = ["EFFECTS", "ON_REQUEST", "OTHER_SERVOS", "SERVOS", "Effect", "Parameter", "catalogue", "left_out", "library"]
