"""The seams that every JSBSim model has, properties given other readers, and a stabiliser that is stated.

A model in the testbench's own form is changed in its XML. A foreign one is changed beside it: its controls have a way
of their own (:mod:`testbench.aircraft.adapter`), its mass and inertia as flown include fuel and point masses and are
changed by what is added to them, its engines keep what they do and more force is added in proportion. Increments of the
coefficients are :class:`testbench.aircraft.amend.Increment`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from testbench.aircraft.adapter import declare
from testbench.aircraft.amend import AddInertia, Amendment, Change, Insert, Memory, SetProperty, SetText
from testbench.aircraft.model import Aircraft, MassProperties
from testbench.aircraft.paths import ControlPath, path_of
from testbench.core.constants import FT_M, G0_M_S2, JSBSIM_LENGTH_M, LBF_N
from testbench.core.errors import ModelError

FED_BACK = {
    "alpha": "aero/alpha-rad",
    "beta": "aero/beta-rad",
    "p": "velocities/p-rad_sec",
    "q": "velocities/q-rad_sec",
    "r": "velocities/r-rad_sec",
    "phi": "attitude/phi-rad",
    "theta": "attitude/theta-rad",
}
"""What can be fed back -> its JSBSim property, rad or rad/s."""
SERVO_RAD_S = 100.0
"""Corner frequency of the servo that a stabiliser works through in an aircraft that has none."""
_UPSTREAM = 4  # between the recorded command and the servo
SHORTEST_S = 0.005
"""Lag that a linear model still distinguishes from none."""
_STANDS_STILL = "<gt> <property>simulation/dt</property> <value>0</value> </gt>"
INERTIAS = ("Ixx", "Iyy", "Izz", "Ixz")
_IN_M = FT_M / 12.0
_LB_KG = LBF_N / G0_M_S2
_CENTRE = "mass_balance/location[@name='CG']"


# --- command and surface ----------------------------------------------------------------------------------------------


def control_path(aircraft: Aircraft, control: str) -> ControlPath:
    """Return the names on the way of a control as it is.

    Raises:
        ModelError: the aircraft has no such control.
    """
    path = path_of(aircraft.adapter, control) if control in aircraft.controls else None
    if path is None:
        words = {"de": "elevator", "da": "aileron", "dr": "rudder", "thr": "engine with a throttle"}
        raise ModelError(f"{aircraft.name} has no {words[control]} that could be changed")
    return path


def opened(aircraft: Aircraft, control: str) -> tuple[Aircraft, ControlPath]:
    """Return the aircraft with command and surface of a control apart, so that something can be put between, and the
    way of the control.

    A foreign surface without a servo is where its command is, or where a control law demands it; it then follows that
    by a component of its own.

    Raises:
        ModelError: the aircraft has no such control.
    """
    path = control_path(aircraft, control)
    adapter = aircraft.adapter
    link = None if adapter is None else adapter.link(control)
    if adapter is not None and link is not None and link.surface == link.demand:
        links = tuple(replace(x, apart=True) if x is link else x for x in adapter.links)
        aircraft = replace(aircraft, adapter=replace(adapter, links=links))
        path = control_path(aircraft, control)
    return aircraft, path


def with_servo(aircraft: Aircraft, control: str, lag_rad_s: float) -> tuple[Aircraft, tuple[Change, ...]]:
    """Return the aircraft with a first-order servo of that corner frequency, and the changes that are to be made to it.

    Raises:
        ModelError: the aircraft has no such control.
    """
    path = control_path(aircraft, control)
    if path.lag is not None:
        return aircraft, (SetProperty(path.lag, lag_rad_s),)
    adapter = aircraft.adapter
    if adapter is None or adapter.link(control) is None:
        raise ModelError(f"the {path.word} of {aircraft.name} has no servo")
    links = tuple(replace(x, lag_rad_s=lag_rad_s) if x.control == control else x for x in adapter.links)
    return replace(aircraft, adapter=replace(adapter, links=links)), ()


# --- mass -------------------------------------------------------------------------------------------------------------


def scaled_mass(aircraft: Aircraft, factors: Mapping[str, float]) -> tuple[tuple[Change, ...], MassProperties]:
    """Return the changes that multiply mass and inertia about the centre of gravity, as flown, and the result.

    Args:
        aircraft: foreign or not.
        factors: "mass_kg", "Ixx", "Iyy", "Izz" or "Ixz" -> factor; one does not change the others.

    Raises:
        ModelError: a model in the testbench's own form does not hold the element.
    """
    mass = aircraft.mass
    changes: list[Change] = []
    for name, factor in factors.items():
        value = getattr(mass, name)
        mass = replace(mass, **{name: value * factor})
        if aircraft.adapter is None:
            path = "mass_balance/" + ("emptywt" if name == "mass_kg" else name.lower())
            written = ET.fromstring(aircraft.xml).findtext(path)
            if written is None:
                raise ModelError(f"{aircraft.name} must hold {path} to have it changed, it does not")
            changes.append(SetText(path, float(written) * factor))
        elif name == "mass_kg":
            changes.append(_point("testbench-mass", value * (factor - 1.0), _centre_in(aircraft)))
        else:
            changes.append(AddInertia(name, value * (factor - 1.0)))
    return tuple(changes), mass


def moved_centre(aircraft: Aircraft, shift_m: Sequence[float]) -> tuple[Change, ...]:
    """Return the changes that move the centre of gravity; mass and inertia about it stay.

    Args:
        aircraft: foreign or not. To a foreign one a pair of masses is added, one of them negative, and the inertia that
            it has about the new centre is made up for.
        shift_m: aft, right, up (structural axes).

    Raises:
        ModelError: a model in the testbench's own form does not say where its centre of gravity is.
    """
    if aircraft.adapter is None:
        place = ET.fromstring(aircraft.xml).find(_CENTRE)
        unit = "" if place is None else (place.get("unit") or "").upper()
        if place is None or unit not in JSBSIM_LENGTH_M or any(place.findtext(axis) is None for axis in "xyz"):
            raise ModelError(
                f"{aircraft.name} must say where its centre of gravity is (<location name='CG'> in M, FT or IN), it "
                "does not"
            )
        return tuple(
            SetText(f"{_CENTRE}/{axis}", float(str(place.findtext(axis))) + shift / JSBSIM_LENGTH_M[unit])
            for axis, shift in zip("xyz", shift_m, strict=True)
            if shift
        )
    aft, right, up = shift_m
    M, span = aircraft.mass.mass_kg, aircraft.geometry.b_m
    kg = M / span  # half a span to either side, so that the pair moves the centre by the shift times the span
    ends = [
        tuple(c + sign * 0.5 * span * s / _IN_M for c, s in zip(_centre_in(aircraft), shift_m, strict=True))
        for sign in (1.0, -1.0)
    ]
    pair = (_point("testbench-aft", kg, ends[0]), _point("testbench-fore", -kg, ends[1]))
    square = aft * aft + right * right + up * up
    inertia = (
        AddInertia("Ixx", M * (square - aft * aft)),
        AddInertia("Iyy", M * (square - right * right)),
        AddInertia("Izz", M * (square - up * up)),
        AddInertia("Ixz", -M * aft * up),
        AddInertia("Ixy", -M * aft * right),
        AddInertia("Iyz", -M * right * up),
    )
    return (*pair, *inertia)


def added_load(aircraft: Aircraft, kg: float, aft_m: float, right_m: float = 0.0) -> tuple[Change, ...]:
    """Return the change that adds a point mass behind, and beside, the centre of gravity of the aircraft as loaded."""
    if aircraft.adapter is None:
        point = (
            f'<pointmass name="payload"> <weight unit="KG">{kg!r}</weight> '
            f'<location unit="M"> <x>{aft_m!r}</x> <y>{right_m!r}</y> <z>0</z> </location> </pointmass>'
        )
        return (Insert("mass_balance", point),)
    x, y, z = _centre_in(aircraft)
    return (_point("payload", kg, (x + aft_m / _IN_M, y + right_m / _IN_M, z)),)


def _centre_in(aircraft: Aircraft) -> tuple[float, float, float]:
    if aircraft.adapter is None or aircraft.adapter.cg_in is None:
        raise ModelError(f"{aircraft.name} must be loaded with load_aircraft before its mass is changed")
    return aircraft.adapter.cg_in


def _point(name: str, kg: float, at_in: Sequence[float]) -> Insert:
    """Return the change that adds a point mass, which may be negative: JSBSim sums masses whatever their sign."""
    place = " ".join(f"<{axis}>{float(v)!r}</{axis}>" for axis, v in zip("xyz", at_in, strict=True))
    return Insert(
        "mass_balance",
        f'<pointmass name="{name}"> <weight unit="LBS">{kg / _LB_KG!r}</weight> '
        f'<location unit="IN"> {place} </location> </pointmass>',
    )


def with_setting(aircraft: Aircraft, name: str, value: float) -> tuple[Aircraft, tuple[Change, ...]]:
    """Return the aircraft with another value of a property that the model declares, or that it is told before it flies,
    and the changes that are to be made to it; which of the two is found when the model is written."""
    adapter = aircraft.adapter
    if adapter is not None and name in adapter.settings:
        settings = {**adapter.settings, name: value}
        return replace(aircraft, adapter=replace(adapter, settings=settings)), ()
    return aircraft, (SetProperty(name, value),)


def changed(aircraft: Aircraft, name: str, text: str, *changes: Change) -> Aircraft:
    """Return the aircraft with one amendment of these changes."""
    return aircraft.amended(Amendment(name, text, changes))


# --- properties given other readers -----------------------------------------------------------------------------------


def remember(tree: ET.Element, aircraft: Aircraft, values: Mapping[str, float]) -> None:
    """Declare properties and their first values before the control system that reads them, in place."""
    if aircraft.adapter is not None:  # the throttle of a foreign model is read before its control system
        declare(tree, values)
        return
    for name, first in values.items():
        declared = ET.Element("property", {"value": repr(float(first)) if first else "0"})
        declared.text = name
        next(tree.iter("flight_control")).insert(0, declared)


@dataclass(frozen=True)
class Reroute(Insert):
    """Put the components of ``xml`` (children of its root) before the first component that reads ``command``.

    All that read ``command`` read ``target`` from then on, except the channel of the simulator, which stays the
    command itself. ``parent`` is not used.
    """

    command: str = ""  # JSBSim property
    target: str = ""  # property that the components end in
    memory: tuple[str, ...] = ()  # properties to declare, with value 0

    def apply(self, tree: ET.Element, aircraft: Aircraft) -> None:
        """Change ``tree`` in place; ModelError if no component reads the command."""
        channels = [c for part in ("flight_control", "system") for c in tree.findall(f"{part}/channel")]
        for channel in channels:
            readers = [c for c in channel if any(_reads(p, self.command) for p in _read(c))]
            if not readers:
                continue
            for reader in readers:
                for p in _read(reader):
                    if _reads(p, self.command):
                        p.text = self.target
            place = list(channel).index(readers[0])
            for i, component in enumerate(ET.fromstring(self.xml)):
                channel.insert(place + i, component)
            remember(tree, aircraft, dict.fromkeys((*self.memory, self.target), 0.0))
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
    return 1.0 / max(time_s, SHORTEST_S)


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


# --- a stabiliser that is stated --------------------------------------------------------------------------------------


def stabilised(aircraft: Aircraft) -> Aircraft:
    """Return the aircraft with its stabiliser, one amendment per control: command + sum of gain times motion.

    It acts behind the recorded command and through the servo, so that a record of the surface shows it and the linear
    model has it in the states of its servos; derivatives stay those of the aircraft alone.

    Raises:
        ModelError: it moves a control that the aircraft does not have.
    """
    for control, gains in aircraft.stabiliser.items():
        if control_path(aircraft, control).lag is None or not aircraft.has_servo(control):
            aircraft, _ = with_servo(aircraft, control, SERVO_RAD_S)
        aircraft, path = opened(aircraft, control)
        terms = " ".join(product(value(gain), prop(FED_BACK[motion])) for motion, gain in gains.items())
        edit = reroute(path.command, f"stabiliser-{control}", f"<sum> {prop(path.command)} {terms} </sum>")
        said = ", ".join(f"{gain:+.3g} {motion}" for motion, gain in gains.items())
        amendment = Amendment(f"stabiliser_{control}", f"{control} is fed back {said}", (edit,), upstream=_UPSTREAM)
        aircraft = aircraft.amended(amendment)
    return aircraft
