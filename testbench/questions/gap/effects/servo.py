"""What lies between the elevator command and the surface, shared by the effects that change it."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.aircraft import Aircraft, Insert
from testbench.aircraft.elastic import ELEVATOR_SURFACE
from testbench.core.errors import ModelError
from testbench.core.record import FloatArray
from testbench.questions.gap.effects.reroute import component

POSITION = "fcs/elevator-pos-rad"
LAG = "fcs/elevator-lag-rad_sec"
LIMIT = "fcs/elevator-rate-limit-rad_sec"


def declared(aircraft: Aircraft, name: str) -> float:
    """Return the value of a declared property of the model, amendments included.

    Raises:
        ModelError: it is not declared.
    """
    tree = aircraft.model_tree(aircraft.rate_hz, 100.0, aircraft.design_V_m_s)
    found = [e for e in tree.iter("property") if (e.text or "").strip() == name and "value" in e.attrib]
    if not found:
        raise ModelError(f"{aircraft.name} must declare {name}, it does not")
    return float(found[0].get("value", "nan"))


def through_servo(
    u: FloatArray, column: int, dt_s: float, lag: float, move: Callable[[float, float, float], float]
) -> FloatArray:
    """Return commands that take a first-order servo of corner ``lag`` where ``u`` (n, m) takes another device.

    ``move(position, command, time)`` is the device's position ``time`` s later under a command that is held. A command
    held over one sample moves the servo by d+ = a d + (1 - a) c with a = exp(-lag dt), hence c = (d+ - a d) / (1 - a).
    """
    d = [float(u[0, column])]
    for c in u[:, column].tolist():
        d.append(move(d[-1], c, dt_s))
    position, whole, out = np.array(d), math.exp(-lag * dt_s), u.copy()
    out[:, column] = (position[1:] - whole * position[:-1]) / (1.0 - whole)
    return out


@dataclass(frozen=True)
class BehindServo(Insert):
    """Let the aerodynamics, and elastic modes, read a component's output instead of the elevator's position.

    The component ends in ELEVATOR_SURFACE, which is declared with value 0.
    """

    def apply(self, tree: ET.Element) -> None:
        """Change ``tree`` in place; ModelError if no channel moves the elevator."""
        control = tree.find("flight_control")
        for channel in [] if control is None else control.findall("channel"):
            if control is not None and any((e.text or "").strip() == POSITION for e in channel.iter("output")):
                for p in (e for part in tree.findall("aerodynamics") for e in part.iter("property")):
                    if (p.text or "").strip() == POSITION:
                        p.text = ELEVATOR_SURFACE
                channel.append(ET.fromstring(self.xml))
                memory = ET.Element("property", {"value": "0"})
                memory.text = ELEVATOR_SURFACE
                control.insert(0, memory)
                return
        raise ModelError(f"a component behind the servo needs a channel that ends in {POSITION}, the model has none")


def behind_servo(body: str) -> BehindServo:
    """Return the edit that lets the aerodynamics read the function ``body`` (XML) for the elevator's position."""
    return BehindServo(".", component(ELEVATOR_SURFACE, body))


@dataclass(frozen=True)
class OneSidedLimit(Insert):
    """Give the elevator servo another rate limit in the negative direction (trailing edge up).

    Attributes:
        limit: rad/s.
    """

    limit: float = 0.0

    def apply(self, tree: ET.Element) -> None:
        """Change ``tree`` in place; ModelError if the servo has no limit to change."""
        control = tree.find("flight_control")
        servo = tree.find("flight_control/channel/fcs_function[@name='fcs/elevator-actuator']")
        for bound in [] if servo is None else servo.iter("max"):
            for p in bound.findall("product/property"):
                if control is not None and (p.text or "").strip() == LIMIT:
                    p.text = "gap/rate-limit-up"
                    memory = ET.Element("property", {"value": repr(float(self.limit))})
                    memory.text = p.text
                    control.insert(0, memory)
                    return
        raise ModelError("an asymmetric rate limit needs an elevator servo with a limit, the model has none")


def column_of(names: Sequence[str], name: str = "de") -> int | None:
    """Return the column of a control among ``names``, or None."""
    return list(names).index(name) if name in names else None
