"""Edits of a JSBSim model that hidden truths are made of: terms of the aerodynamics, and states.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from testbench.aircraft import Insert

ALPHA, ELEVATOR, ALPHA_DOT = "aero/alpha-rad", "fcs/elevator-pos-rad", "aero/alphadot-rad_sec"
CHORD_TIME = "aero/ci2vel"  # cbar / (2 V)


def coefficient(axis: str, *terms: str) -> Insert:
    """Return the edit that adds qbar S (cbar for PITCH) times the product of ``terms`` (XML) to an axis."""
    arm = "<property>metrics/cbarw-ft</property>" if axis == "PITCH" else ""
    body = f"<property>aero/qbar-psf</property><property>metrics/Sw-sqft</property>{arm}{''.join(terms)}"
    name = f"hidden/{axis}-{len(body)}"
    return Insert(f"aerodynamics/axis[@name='{axis}']", f'<function name="{name}"><product>{body}</product></function>')


def term(tag: str, *parts: str) -> str:
    """Return the XML of a function term, e.g. ``term("sum", a, b)``."""
    return f"<{tag}>{''.join(parts)}</{tag}>"


def number(x: float) -> str:
    """Return the XML of a number."""
    return f"<value>{float(x)!r}</value>"


def prop(name: str) -> str:
    """Return the XML of a property."""
    return f"<property>{name}</property>"


def state(name: str, target: str, time_s: float) -> tuple[Insert, Insert]:
    """Return the edits of a state that follows ``target`` (XML): x+ = x + (target - x) (1 - exp(-dt / time))."""
    power = term("quotient", term("product", number(-1.0), prop("simulation/dt")), number(time_s))
    gain = term("difference", number(1.0), term("exp", power))
    step = term("sum", prop(name), term("product", gain, term("difference", target, prop(name))))
    rest = term("ifthen", term("gt", prop("simulation/dt"), number(0.0)), step, term("sum", target, number(0.0)))
    return (
        Insert("flight_control", f'<property value="0">{name}</property>', 0),
        Insert(
            "flight_control",
            f'<channel name="{name}-c"><fcs_function name="{name}-f"><function>{rest}</function>'
            f"<output>{name}</output></fcs_function></channel>",
        ),
    )
