"""Terms that effects add to the aerodynamics of a JSBSim model."""

from __future__ import annotations

import math

from testbench.aircraft import Aircraft, Increment, Insert, Memory
from testbench.aircraft.reroute import component, corner, moving, product, prop, value
from testbench.aircraft.seams import control_path

ALPHA = "aero/alpha-rad"


def force(coefficient: str, label: str, *terms: str) -> Increment:
    """Return the edit that adds the product of ``terms`` (XML) to a coefficient (CL, CD, ...)."""
    return Increment(coefficient, f"gap/{label}", terms)


def pitching_moment(label: str, *terms: str) -> Increment:
    """Return the edit that adds the product of ``terms`` (XML) to the pitching moment coefficient."""
    return force("Cm", label, *terms)


def need_engine(aircraft: Aircraft) -> None:
    """Refuse an aircraft without an engine.

    Raises:
        ModelError: nothing drives it.
    """
    control_path(aircraft, "thr")


def excess(term: str, least: float) -> str:
    """Return the XML of ``term`` minus ``least``."""
    return f"<difference> {term} {value(least)} </difference>"


def thrust_coefficient(aircraft: Aircraft) -> str:
    """Return the XML of T / (qbar S).

    Raises:
        ModelError: nothing drives the aircraft.
    """
    need_engine(aircraft)
    below = product(f"<max> {prop('aero/qbar-psf')} {value(1e-6)} </max>", prop("metrics/Sw-sqft"))
    return f"<quotient> {prop(str(aircraft.source_of('thrust')[0]))} {below} </quotient>"


def followed(label: str, term: str, time_s: float, rate_hz: float) -> tuple[tuple[Insert, ...], Memory]:
    """Return the edits that make ``gap/LABEL`` follow ``term`` with a first-order lag, and the state that it is.

    It takes the value of the frame before, one frame later than the aerodynamics do. While time stands still it is
    ``term`` plus ``gap/LABEL-ic``, with which a flight may begin away from rest.
    """
    a = math.exp(-1.0 / (rate_hz * time_s)) if time_s > 0.0 else 0.0
    name, start = f"gap/{label}", f"gap/{label}-ic"
    follow = f"<sum> {product(value(a), prop(name))} {product(value(1.0 - a), term)} </sum>"
    body = moving(follow, f"<sum> {term} {prop(start)} </sum>")
    declarations = (Insert("flight_control", f'<property value="0">{p}</property>', 0) for p in (name, start))
    channel = Insert("flight_control", f'<channel name="{name}-channel"> {component(name, body)} </channel>')
    return (*declarations, channel), Memory(label, name, start, corner(time_s), settles=True)
