"""What an aircraft's model said before the flight: its derivatives at the trim of the records, and its servos."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.adapter import SURFACES
from testbench.core.atmosphere import air_density
from testbench.core.constants import DEG_RAD
from testbench.core.errors import TestbenchError
from testbench.core.record import FlightRecord
from testbench.estimators.structured import Servo
from testbench.evaluation.derivatives import Derivative, dimensional_derivatives
from testbench.flight import FlightCondition, linearise, trim


@dataclass(frozen=True, eq=False)
class Before:
    """An aircraft at the condition that the records were flown at.

    Attributes:
        aircraft: the model.
        V_m_s, qbar_Pa: true airspeed and dynamic pressure of the records.
        derivatives: of the model there; empty if it cannot be trimmed there.
        notes: what was assumed, in sentences.
    """

    aircraft: Aircraft
    V_m_s: float
    qbar_Pa: float
    derivatives: tuple[Derivative, ...] = ()
    notes: tuple[str, ...] = ()


def before(aircraft: Aircraft, records: Sequence[FlightRecord]) -> Before:
    """Return what the model said of the condition of the records.

    Airspeed, height and dynamic pressure are the means that were removed as trim or, where nothing was removed, those
    of the records; without a height it is that of the aircraft's design condition.
    """
    V, h, qbar = (_mean(name, records) for name in ("V", "h", "qbar"))
    notes = []
    if V is None:
        V = aircraft.design_V_m_s
        notes.append(f"the records hold no airspeed: {aircraft.name} is taken at its design speed of {V:g} m/s")
    if h is None:
        h = aircraft.design_h_m
        notes.append(f"the records hold no height: {aircraft.name} is taken at {h:g} m")
    qbar = 0.5 * air_density(h) * V**2 if qbar is None else qbar
    try:
        trimmed = trim(aircraft, FlightCondition(V, h))
        found = tuple(dimensional_derivatives(linearise(aircraft, trimmed), trimmed))
    except TestbenchError as error:
        found = ()
        notes.append(
            f"what {aircraft.name} said before is not known: it does not trim at {V:.3g} m/s, {h:.4g} m ({error})"
        )
    return Before(aircraft, V, qbar, found, tuple(notes))


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


def _mean(name: str, records: Sequence[FlightRecord]) -> float | None:
    """Return the mean of a channel as flown: what was removed, and what was left."""
    values = [
        r.provenance.get("prepared", {}).get("removed", {}).get(name, 0.0) + float(np.mean(r[name]))
        for r in records
        if name in r
    ]
    return float(np.mean(values)) if values else None
