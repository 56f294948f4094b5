"""Forces and moments added to a model of any form, as functions of its state.

A model in the testbench's own form has the axes LIFT, DRAG, SIDE, ROLL, PITCH and YAW, and takes a function in them. In
any other model names and axes are its author's. What every JSBSim model takes is an external reaction: a force in wind
axes, or a moment in body axes, whose size is a function. It acts in the frame in which it is computed, after the
aerodynamics and the engines. A force acts at a point of the airframe; taken at the centre of gravity that the model
was loaded with, it has no moment, and it has one about a centre of gravity that moves from there.

Accelerometers and the equations of motion see it (``forces/f*-total``); JSBSim's aerodynamic forces
(``forces/f*-aero``) do not contain it.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

COEFFICIENTS: dict[str, tuple[str, str | None]] = {
    "CL": ("LIFT", None),
    "CD": ("DRAG", None),
    "CY": ("SIDE", None),
    "Cl": ("ROLL", "metrics/bw-ft"),
    "Cm": ("PITCH", "metrics/cbarw-ft"),
    "Cn": ("YAW", "metrics/bw-ft"),
}
"""Coefficient -> JSBSim axis and the reference length that its moment takes."""
MOTIONS: dict[str, tuple[str, ...]] = {
    "zero": (),
    "alpha": ("aero/alpha-rad",),
    "q": ("velocities/q-aero-rad_sec", "aero/ci2vel"),
    "de": ("fcs/elevator-pos-rad",),
    "beta": ("aero/beta-rad",),
    "p": ("velocities/p-aero-rad_sec", "aero/bi2vel"),
    "r": ("velocities/r-aero-rad_sec", "aero/bi2vel"),
    "da": ("fcs/left-aileron-pos-rad",),
    "dr": ("fcs/rudder-pos-rad",),
    "alphadot": ("aero/alphadot-rad_sec", "aero/ci2vel"),
}
"""Motion variable -> properties whose product is the variable without unit; deflections as in the testbench's form."""
WHOLE: dict[str, str] = {
    "CL": "forces/fwz-aero-lbs",  # lift and drag as such: JSBSim turns their signs
    "CD": "forces/fwx-aero-lbs",
    "CY": "forces/fwy-aero-lbs",
    "Cl": "moments/l-aero-lbsft",
    "Cm": "moments/m-aero-lbsft",
    "Cn": "moments/n-aero-lbsft",
}
"""Coefficient -> property of the whole aerodynamic force or moment, lbf or lbf ft."""


@dataclass(frozen=True)
class _Reaction:
    """Where a reaction points, and what its terms are multiplied by."""

    tag: str
    frame: str
    direction: tuple[int, int, int]
    factors: tuple[str, ...]


_PRESSURE = ("aero/qbar-psf", "metrics/Sw-sqft")
_REACTIONS: Mapping[str, _Reaction] = {
    "CL": _Reaction("force", "WIND", (0, 0, -1), _PRESSURE),
    "CD": _Reaction("force", "WIND", (-1, 0, 0), _PRESSURE),
    "CY": _Reaction("force", "WIND", (0, 1, 0), _PRESSURE),
    "Cl": _Reaction("moment", "BODY", (1, 0, 0), (*_PRESSURE, "metrics/bw-ft")),
    "Cm": _Reaction("moment", "BODY", (0, 1, 0), (*_PRESSURE, "metrics/cbarw-ft")),
    "Cn": _Reaction("moment", "BODY", (0, 0, 1), (*_PRESSURE, "metrics/bw-ft")),
    "thrust-x": _Reaction("force", "BODY", (1, 0, 0), ("forces/fbx-prop-lbs",)),
    "thrust-y": _Reaction("force", "BODY", (0, 1, 0), ("forces/fby-prop-lbs",)),
    "thrust-z": _Reaction("force", "BODY", (0, 0, 1), ("forces/fbz-prop-lbs",)),
    "thrust-l": _Reaction("moment", "BODY", (1, 0, 0), ("moments/l-prop-lbsft",)),
    "thrust-m": _Reaction("moment", "BODY", (0, 1, 0), ("moments/m-prop-lbsft",)),
    "thrust-n": _Reaction("moment", "BODY", (0, 0, 1), ("moments/n-prop-lbsft",)),
    "thrust-line": _Reaction("moment", "BODY", (0, 1, 0), ("forces/fbx-prop-lbs",)),
}
THRUST = tuple(n for n in _REACTIONS if n.startswith("thrust-") and n != "thrust-line")
"""Reactions in proportion to all forces and moments of the engines."""


_LABEL = "testbench-"


def reacts(xml: str) -> bool:
    """Return whether reactions of coefficients are written in a model itself."""
    return any(f'name="{_LABEL}{name}"' in xml for name in COEFFICIENTS)


def react(tree: ET.Element, name: str, terms: Sequence[ET.Element], at_in: tuple[float, float, float]) -> None:
    """Add terms to a reaction of a model in place: a coefficient, ``THRUST`` or "thrust-line".

    All terms of one reaction are summed in one function, so that a further term costs little.

    Args:
        tree: the model.
        name: of the reaction.
        terms: factors, whose product is the term: a coefficient without unit, a share of the thrust, or an arm in ft.
        at_in: where a force acts, inches in the structural frame.
    """
    reaction = _REACTIONS[name]
    reactions = tree.find("external_reactions")
    if reactions is None:
        reactions = ET.Element("external_reactions")
        tree.insert(before_aerodynamics(tree), reactions)
    label = f"{_LABEL}{name}"
    found = next((e for e in reactions if e.get("name") == label), None)
    if found is None:
        total = element("product", *reaction.factors, element("sum", 0.0))  # a sum has two terms
        place = [_vector("location", at_in, unit="IN")] if reaction.tag == "force" else []
        parts = (element("function", total), *place, _vector("direction", reaction.direction))
        found = element(reaction.tag, *parts, name=label, frame=reaction.frame)
        reactions.append(found)
    sums = found.find("function/product/sum")
    assert sums is not None
    sums.append(element("product", *terms, *([1.0] if len(terms) < 2 else [])))


def before_aerodynamics(tree: ET.Element) -> int:
    """Return where an element goes that must stand before the aerodynamics."""
    tags = [e.tag for e in tree]
    return tags.index("aerodynamics") if "aerodynamics" in tags else len(tags)


def _vector(tag: str, values: Sequence[float], **attributes: str) -> ET.Element:
    parts = (element(axis, text=repr(float(value))) for axis, value in zip("xyz", values, strict=True))
    return element(tag, *parts, **attributes)


def element(tag: str, *inside: ET.Element | float | str, text: str | None = None, **attributes: str) -> ET.Element:
    """Return an element and what stands in it: elements, numbers, and properties by their names."""
    out = ET.Element(tag, attributes)
    out.text = text
    out.extend(x if isinstance(x, ET.Element) else quantity(x) if isinstance(x, str) else number(x) for x in inside)
    return out


def number(x: float) -> ET.Element:
    """Return the element of a number."""
    return element("value", text=repr(float(x)))


def quantity(name: str) -> ET.Element:
    """Return the element of a property."""
    return element("property", text=name)


def whole(coefficient: str) -> ET.Element:
    """Return the element of a whole aerodynamic coefficient as it is in flight."""
    _, length = COEFFICIENTS[coefficient]
    pressure = element("max", "aero/qbar-psf", 1e-6)
    below = element("product", pressure, "metrics/Sw-sqft", *([length] if length else []))
    return element("quotient", WHOLE[coefficient], below)
