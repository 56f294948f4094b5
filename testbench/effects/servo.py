"""What lies between the command of a control and its surface, shared by the effects that change it.

Each of these effects is made for a control by a function ``effect``. Those of the elevator have plain names, those of
others have the control before it: rate_limit, aileron_rate_limit.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from testbench.aircraft import Aircraft, Insert
from testbench.aircraft.adapter import PREFIX, declare
from testbench.aircraft.paths import ControlPath
from testbench.aircraft.reroute import Reroute, component, moving, prop, reroute
from testbench.aircraft.seams import control_path
from testbench.core.errors import ModelError
from testbench.core.record import FloatArray

_READING = ("property", "input", "independentVar")
WORDS = {"de": "elevator", "da": "aileron", "dr": "rudder", "thr": "throttle"}
PLACES = {**WORDS, "thr": "thrust"}
"""Control -> the place of effects between its command and its surface."""
COEFFICIENTS = {"de": ("Cm_de", "CL_de"), "da": ("Cl_da", "Cn_da"), "dr": ("Cn_dr", "CY_dr")}
"""Control -> the coefficients that its effectiveness consists of, the first of them the moment that it is there for."""


def named(control: str, name: str) -> str:
    """Return the name of an effect for a control."""
    return name if control == "de" else f"{WORDS[control]}_{name}"


def labelled(control: str, label: str) -> str:
    """Return the label of an effect's properties for a control."""
    return label if control == "de" else f"{WORDS[control]}-{label}"


def corner_of(aircraft: Aircraft, control: str) -> float:
    """Return the corner frequency of a servo, rad/s, amendments included; infinite where there is none.

    Raises:
        ModelError: the aircraft has no such control.
    """
    path = control_path(aircraft, control)
    return math.inf if path.lag is None else declared(aircraft, path.lag)


def declared(aircraft: Aircraft, name: str) -> float:
    """Return the value of a declared property of the model, amendments included.

    Raises:
        ModelError: it is not declared.
    """
    known = _declared(_Model.of(aircraft))
    if name not in known:
        raise ModelError(f"{aircraft.name} must declare {name}, it does not")
    return float(known[name])


@dataclass(frozen=True)
class _Model:
    """A model as it is written."""

    aircraft: Aircraft = field(compare=False)
    contents: tuple[str, ...]

    @classmethod
    def of(cls, aircraft: Aircraft) -> _Model:
        return cls(aircraft, (aircraft.xml, repr(aircraft.adapter), repr(aircraft.elastic), repr(aircraft.amendments)))


@lru_cache(maxsize=64)
def _declared(model: _Model) -> dict[str, str]:
    """Return the properties that a model declares, and their values."""
    aircraft, known = model.aircraft, dict[str, str]()
    for e in aircraft.model_tree(aircraft.rate_hz, 100.0, aircraft.design_V_m_s).iter("property"):
        if "value" in e.attrib:
            known.setdefault((e.text or "").strip(), e.attrib["value"])
    return known


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
    """Let the aerodynamics, and elastic modes, read a component's output instead of the servo's position.

    The component ends in the surface of the path, which is declared with value 0.
    """

    path: ControlPath | None = None

    def apply(self, tree: ET.Element, aircraft: Aircraft) -> None:
        """Change ``tree`` in place; ModelError if no channel moves the surface."""
        assert self.path is not None
        position, surface = self.path.servo, self.path.surface
        control = tree.find("flight_control")
        for channel in [] if control is None else control.findall("channel"):
            if control is not None and any((e.text or "").strip() == position for e in channel.iter("output")):
                parts = [*tree.findall("aerodynamics"), *tree.findall("external_reactions")]
                driven = [c for c in channel if c.get("name", "").startswith(f"{PREFIX}drive-")]
                for p in (e for part in (*parts, *driven) for e in part.iter() if e.tag in _READING):
                    if (p.text or "").strip() == position:
                        p.text = surface
                place = list(channel).index(driven[0]) if driven else len(channel)
                channel.insert(place, ET.fromstring(self.xml))
                if aircraft.adapter is not None:
                    declare(tree, {surface: 0.0})
                    return
                memory = ET.Element("property", {"value": "0"})
                memory.text = surface
                control.insert(0, memory)
                return
        raise ModelError(f"a component behind the servo needs a channel that ends in {position}, the model has none")


def behind_servo(path: ControlPath, body: str) -> BehindServo:
    """Return the edit that lets the aerodynamics read the function ``body`` (XML) for the servo's position."""
    return BehindServo(".", component(path.surface, body), None, path)


@dataclass(frozen=True)
class OneSidedLimit(Insert):
    """Give a servo another rate limit in the negative direction.

    Attributes:
        limit: rad/s.
    """

    limit: float = 0.0
    path: ControlPath | None = None

    def apply(self, tree: ET.Element, aircraft: Aircraft) -> None:
        """Change ``tree`` in place; ModelError if the servo has no limit to change."""
        assert self.path is not None
        control = tree.find("flight_control")
        servo = tree.find(f"flight_control/channel/fcs_function[@name='{self.path.actuator}']")
        name = f"gap/{labelled(self.path.control, 'rate-limit-up')}"
        for bound in [] if servo is None else servo.iter("max"):
            for p in bound.findall("product/property"):
                if control is not None and (p.text or "").strip() == self.path.rate_limit:
                    p.text = name
                    if aircraft.adapter is not None:
                        declare(tree, {name: self.limit})
                        return
                    memory = ET.Element("property", {"value": repr(float(self.limit))})
                    memory.text = p.text
                    control.insert(0, memory)
                    return
        raise ModelError(f"an asymmetric rate limit needs a servo of the {self.path.word} with a limit, there is none")


def about_trim(path: ControlPath, label: str, law: Callable[[str], str]) -> Reroute:
    """Return the edit that hands on the trim of a command and the ``law`` of its deviation from it, XML of XML.

    The trim is kept from where time stands still.
    """
    kept, c = prop(f"gap/{label}-trim"), prop(path.command)
    body = f"<sum> {kept} {law(f'<difference> {c} {kept} </difference>')} </sum>"
    return reroute(path.command, label, body, (("trim", moving(kept, c)),))


def handed_on(control: str, names: Sequence[str], u: FloatArray, law: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Return commands ``u`` (n, m) of controls ``names``, that of one control as a ``law`` hands it on."""
    column = column_of(names, control)
    if column is None:
        return u
    out = u.copy()
    out[:, column] = law(u[:, column])
    return out


def column_of(names: Sequence[str], name: str = "de") -> int | None:
    """Return the column of a control among ``names``, or None."""
    return list(names).index(name) if name in names else None
