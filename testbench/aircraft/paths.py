"""The way of a control from its command to the aerodynamics: the names of its seams in a model of either form.

command -> servo (lag, rate limit) -> where the servo stands -> (linkage) -> what the aerodynamics reads
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

from testbench.aircraft.adapter import PREFIX, SURFACES, THROTTLE, Adapter


@dataclass(frozen=True)
class ControlPath:
    """Properties on the way of a control."""

    control: str  # "de", "da", "dr" or "thr"
    word: str  # what it is called
    command: str  # rad, or 0 to 1; whoever reads it can be given something else, see ``Reroute`` of the gap's effects
    servo: str  # where the servo stands, rad; the command, if nothing lies between; the throttle has none
    surface: str  # what the aerodynamics reads once something is put behind the servo, rad
    actuator: str  # component that is the servo
    lag: str | None  # corner frequency of the servo, rad/s; None without a lag
    rate_limit: str | None  # of the servo, rad/s; None if command and surface are one


def path_of(adapter: Adapter | None, control: str) -> ControlPath | None:
    """Return the way of a control; None if a foreign model has no such control.

    Args:
        adapter: of a foreign model; None for one in the testbench's own form, whose names are fixed.
        control: "de", "da", "dr" or "thr".
    """
    if control == "thr":
        command = "fcs/throttle-cmd-norm" if adapter is None else THROTTLE
        absent = adapter is not None and not adapter.throttles
        return None if absent else ControlPath("thr", "throttle", command, command, command, "", None, None)
    word = SURFACES[control]
    if adapter is None:
        servo = "fcs/left-aileron-pos-rad" if control == "da" else f"fcs/{word}-pos-rad"
        lag, limit = f"fcs/{word}-lag-rad_sec", f"fcs/{word}-rate-limit-rad_sec"
        surface, actuator = f"fcs/{word}-surface-rad", f"fcs/{word}-actuator"
        return ControlPath(control, word, f"fcs/{word}-command-rad", servo, surface, actuator, lag, limit)
    link = adapter.link(control)
    if link is None:
        return None
    return ControlPath(
        control,
        word,
        link.command,
        link.surface,
        f"{PREFIX}{word}-surface-rad",
        f"{PREFIX}{word}-actuator",
        None if link.lag_rad_s is None else link.lag,
        link.rate_limit if link.surface != link.command else None,
    )


def read_by_aerodynamics(tree: ET.Element, path: ControlPath) -> str:
    """Return what the aerodynamics of a model, as amended, reads for a deflection."""
    declared = (e for part in ("flight_control", "system") for e in tree.findall(f"{part}/property"))
    return path.surface if any((p.text or "").strip() == path.surface for p in declared) else path.servo
