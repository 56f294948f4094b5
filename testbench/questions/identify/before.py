"""What an aircraft's model said before the flight: its derivatives at the trim of the records, and its servos."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from testbench.aircraft import Aircraft
from testbench.aircraft.adapter import SURFACES
from testbench.core.constants import DEG_RAD
from testbench.core.errors import Refusal
from testbench.estimators.structured import Servo
from testbench.evaluation.derivatives import Derivative, dimensional_derivatives
from testbench.flight import FlightCondition, linearise, trim
from testbench.questions.identify.flown import FlownCondition


@dataclass(frozen=True, eq=False)
class Before:
    """An aircraft at the condition that the records were flown at.

    Attributes:
        aircraft: the model.
        condition: airspeed and height of the records, which the model was trimmed at.
        qbar_Pa: dynamic pressure of the records.
        derivatives: of the model there; empty if it cannot be trimmed there.
        notes: what was assumed, in sentences.
    """

    aircraft: Aircraft
    condition: FlightCondition
    qbar_Pa: float
    derivatives: tuple[Derivative, ...] = ()
    notes: tuple[str, ...] = ()


def before(aircraft: Aircraft, flown: FlownCondition) -> Before:
    """Return what the model said of the condition of the records.

    Where airspeed or height are not known they are those of the aircraft's design condition.
    """
    V, h, qbar, notes = flown.V_m_s, flown.h_m, flown.qbar_Pa, []
    if V is None:
        V = aircraft.design_V_m_s
        notes.append(f"the records hold no airspeed: {aircraft.name} is taken at its design speed of {V:g} m/s")
    if h is None:
        h = aircraft.design_h_m
        notes.append(f"the records hold no height: {aircraft.name} is taken at {h:g} m")
    condition = FlightCondition(V, h)
    qbar = condition.qbar_Pa if qbar is None else qbar
    try:
        trimmed = trim(aircraft, condition)
        found = tuple(dimensional_derivatives(linearise(aircraft, trimmed), trimmed))
    except Refusal as error:
        found = ()
        notes.append(
            f"what {aircraft.name} said before is not known: it does not trim at {V:.3g} m/s, {h:.4g} m ({error})"
        )
    return Before(aircraft, condition, qbar, found, tuple(notes))


def servos_of(aircraft: Aircraft, inputs: Sequence[str]) -> dict[str, Servo]:
    """Return the servos of an aircraft before the surfaces whose commands are inputs."""
    out = {}
    for name in inputs:
        control = name.removesuffix("_cmd")
        if not name.endswith("_cmd") or control not in SURFACES:
            continue
        if aircraft.adapter is None:
            lag, limit = (
                _declared(aircraft.xml, f"fcs/{SURFACES[control]}-{what}-rad_sec") for what in ("lag", "rate-limit")
            )
        else:
            link = aircraft.adapter.link(control)
            lag, limit = (link.lag_rad_s, link.rate_limit_rad_s) if link is not None else (None, None)
        if lag:
            out[name] = Servo(lag_s=1.0 / lag, rate_limit_deg_s=limit / DEG_RAD if limit else None)
    return out


def _declared(xml: str, name: str) -> float | None:
    found = re.search(rf'<property\s+value="([^"]+)"\s*>\s*{re.escape(name)}\s*</property>', xml)
    return float(found.group(1)) if found else None
