"""Terms that effects add to the aerodynamics of a JSBSim model."""

from __future__ import annotations

from testbench.aircraft import Insert
from testbench.gap.effects.reroute import component, moving, product, prop, value

ALPHA = "aero/alpha-rad"


def force(axis: str, label: str, *terms: str) -> Insert:
    """Return the edit that adds qbar S times the product of ``terms`` (XML) to an axis (LIFT, DRAG)."""
    body = product(prop("aero/qbar-psf"), prop("metrics/Sw-sqft"), *terms)
    return Insert(f"aerodynamics/axis[@name='{axis}']", f'<function name="gap/{label}"> {body} </function>')


def pitching_moment(label: str, *terms: str) -> Insert:
    """Return the edit that adds qbar S cbar times the product of ``terms`` (XML) to the pitching moment."""
    return force("PITCH", label, prop("metrics/cbarw-ft"), *terms)


def excess(term: str, least: float) -> str:
    """Return the XML of ``term`` minus ``least``."""
    return f"<difference> {term} {value(least)} </difference>"


def thrust_coefficient() -> str:
    """Return the XML of T / (qbar S)."""
    below = product(f"<max> {prop('aero/qbar-psf')} {value(1e-6)} </max>", prop("metrics/Sw-sqft"))
    return f"<quotient> {prop('propulsion/engine/thrust-lbs')} {below} </quotient>"


def followed(label: str, term: str, time_s: float, rate_hz: float) -> tuple[Insert, Insert]:
    """Return the edits that make ``gap/LABEL`` follow ``term`` with a first-order lag: its declaration and itself.

    The value of the frame before is taken, one frame later than the aerodynamics of the same frame see it.
    """
    import math

    a = math.exp(-1.0 / (rate_hz * time_s)) if time_s > 0.0 else 0.0
    name = f"gap/{label}"
    body = moving(f"<sum> {product(value(a), prop(name))} {product(value(1.0 - a), term)} </sum>", term)
    declaration = Insert("flight_control", f'<property value="0">{name}</property>', 0)
    channel = Insert("flight_control", f'<channel name="{name}-channel"> {component(name, body)} </channel>')
    return declaration, channel
