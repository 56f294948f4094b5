"""An edit of the control system: what reads a command reads it after further components."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

from testbench.aircraft.adapter import declare
from testbench.aircraft.amend import Insert, Memory
from testbench.aircraft.model import Aircraft
from testbench.core.errors import ModelError

_SHORTEST_S = 0.005  # lag that a linear model still tells from none
_STANDS_STILL = "<gt> <property>simulation/dt</property> <value>0</value> </gt>"


@dataclass(frozen=True)
class Reroute(Insert):
    """Put the components of ``xml`` (children of its root) before the first component that reads ``command``.

    All that read ``command`` read ``target`` from then on, except the channel of the simulator, which stays the
    command itself. ``parent`` is not used.

    Attributes:
        command: JSBSim property.
        target: property that the components end in.
        memory: properties to declare, with value 0.
    """

    command: str = ""
    target: str = ""
    memory: tuple[str, ...] = ()

    def apply(self, tree: ET.Element, aircraft: Aircraft) -> None:
        """Change ``tree`` in place; ModelError if no component reads the command."""
        control = tree.find("flight_control")
        channels = [c for part in ("flight_control", "system") for c in tree.findall(f"{part}/channel")]
        for channel in channels:
            readers = [c for c in channel if any(_reads(p, self.command) for p in _read(c))]
            if not readers or control is None:
                continue
            for reader in readers:
                for p in _read(reader):
                    if _reads(p, self.command):
                        p.text = self.target
            place = list(channel).index(readers[0])
            for i, component in enumerate(ET.fromstring(self.xml)):
                channel.insert(place + i, component)
            if aircraft.adapter is not None:  # the throttle of a foreign model is read before its control system
                declare(tree, dict.fromkeys((*self.memory, self.target), 0.0))
                return
            for name in (*self.memory, self.target):
                declared = ET.Element("property", {"value": "0"})
                declared.text = name
                control.insert(0, declared)
            return
        raise ModelError(f"a rerouted command must be read by a component of <flight_control>, got '{self.command}'")


def _read(component: ET.Element) -> list[ET.Element]:
    """Return the elements of a component that name what it reads."""
    return [e for tag in ("property", "input", "independentVar") for e in component.iter(tag)]


def _reads(element: ET.Element, name: str) -> bool:
    return (element.text or "").strip() == name


def reroute(command: str, label: str, body: str, before: Sequence[tuple[str, str]] = ()) -> Reroute:
    """Return the edit that lets everything behind ``command`` read the JSBSim function ``body`` of it.

    Args:
        command: property.
        label: name of the effect; properties are called gap/LABEL and gap/LABEL-NAME.
        body: XML of one function term.
        before: (name, body) of memories computed first, in this order; each keeps its value to the next frame.
    """
    components = [component(f"gap/{label}-{name}", term) for name, term in before]
    components.append(component(f"gap/{label}", body))
    memory = tuple(f"gap/{label}-{name}" for name, _ in before)
    return Reroute(".", f"<c>{''.join(components)}</c>", None, command, f"gap/{label}", memory)


def washed_feedback(command: str, label: str, rate: str, gain_s: float, washout_rad_s: float) -> tuple[Reroute, Memory]:
    """Return the edit that adds gain times washed-out ``rate``, s / (s + washout) of it, to ``command``, and its state.

    The slow part that is washed out is a first-order lag, exact for a rate held from frame to frame; while time stands
    still it keeps its value, zero in straight flight.
    """
    slow, state, fast = _washed(label, rate, washout_rad_s)
    return _fed(command, label, gain_s, fast, slow), state


def filtered_feedback(command: str, label: str, rate: str, gain_s: float, lag_s: float) -> tuple[Reroute, Memory]:
    """Return the edit that adds gain times ``rate`` behind a first-order lag, rate / (1 + lag s), to ``command``, and
    its state.

    The lag is exact for a rate held from frame to frame; while time stands still it keeps its value, zero in straight
    flight. With a lag of 0 the rate itself is fed back.
    """
    filtered, state = _filtered(label, rate, lag_s)
    return _fed(command, label, gain_s, prop(state.name), filtered), state


def band_feedback(
    command: str, label: str, rate: str, gain_s: float, washout_rad_s: float, lag_s: float
) -> tuple[Reroute, tuple[Memory, Memory]]:
    """Return the edit that adds gain times ``rate`` behind a first-order lag and a washout to ``command``, and its
    states: what :func:`washed_feedback` makes of what :func:`filtered_feedback` lets pass.
    """
    filtered, late = _filtered(label, rate, lag_s)
    slow, washed, fast = _washed(label, late.name, washout_rad_s)
    return _fed(command, label, gain_s, fast, filtered, slow), (late, washed)


def _fed(command: str, label: str, gain_s: float, what: str, *memories: tuple[str, str]) -> Reroute:
    """Return the edit that adds gain times ``what`` to ``command``."""
    return reroute(command, label, f"<sum> {prop(command)} {product(value(gain_s), what)} </sum>", memories)


def _washed(label: str, rate: str, washout_rad_s: float) -> tuple[tuple[str, str], Memory, str]:
    """Return the slow part of ``rate`` as a memory of :func:`reroute` and as a state, and the XML of what is left."""
    name = f"gap/{label}-slow"
    past = f"<exp> {product(value(-washout_rad_s), prop('simulation/dt'))} </exp>"
    fast = f"<difference> {prop(rate)} {prop(name)} </difference>"
    return ("slow", _towards(name, past, fast)), Memory(name, rate, name, washout_rad_s), fast


def _filtered(label: str, rate: str, lag_s: float) -> tuple[tuple[str, str], Memory]:
    """Return ``rate`` behind a first-order lag as a memory of :func:`reroute` and as a state."""
    name = f"gap/{label}-filtered"
    past = f"<exp> {product(value(-1.0 / lag_s), prop('simulation/dt'))} </exp>" if lag_s > 0.0 else value(0.0)
    rise = f"<difference> {prop(rate)} {prop(name)} </difference>"
    return ("filtered", _towards(name, past, rise)), Memory(name, rate, name, corner(lag_s))


def _towards(name: str, past: str, rise: str) -> str:
    """Return the XML of a state after a frame: ``past`` is the share of ``rise`` that is still to come then."""
    share = f"<difference> <value>1</value> {past} </difference>"
    return f"<sum> {prop(name)} {product(share, rise)} </sum>"


def corner(time_s: float) -> float:
    """Return the corner frequency of a lag, rad/s; lags of no more than a few frames have one that is far off."""
    return 1.0 / max(time_s, _SHORTEST_S)


def component(output: str, term: str) -> str:
    """Return the XML of a component that computes ``term`` into the property ``output`` every frame."""
    return (
        f'<fcs_function name="{output}-component"> <function> <sum> {term} <value>0</value> </sum> </function> '
        f"<output>{output}</output> </fcs_function>"
    )


def prop(name: str) -> str:
    """Return the XML of a property."""
    return f"<property>{name}</property>"


def value(x: float) -> str:
    """Return the XML of a number."""
    return f"<value>{float(x)!r}</value>"


def product(*terms: str) -> str:
    """Return the XML of a product."""
    return f"<product> {' '.join(terms)} </product>"


def moving(term: str, still: str) -> str:
    """Return the XML of ``term`` while time runs, and of ``still`` while it stands (trim, initial conditions)."""
    return f"<ifthen> {_STANDS_STILL} {term} {still} </ifthen>"
