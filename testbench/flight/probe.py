"""What a JSBSim model does when its controls move: probed, because nothing about the names in it can be relied on.

Every command of the pilot is stepped over its range while time stands still, and the properties that the aerodynamics
reads are watched. Those that move are what the control drives. Then the command is stepped once more in time, which
shows the lag and the rate limit of what lies between.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.adapter import SURFACES, Adapter, Drive, Law, Link
from testbench.core.constants import DEG_RAD
from testbench.core.errors import ModelError
from testbench.core.record import FloatArray
from testbench.flight.condition import FlightCondition
from testbench.flight.executive import Executive, UndefinedProperties, velocity_at

COMMANDS = {"de": "fcs/elevator-cmd-norm", "da": "fcs/aileron-cmd-norm", "dr": "fcs/rudder-cmd-norm"}
"""Control -> the pilot's command of every JSBSim model."""
_FLIGHTGEAR = {"de": "/controls/flight/elevator", "da": "/controls/flight/aileron", "dr": "/controls/flight/rudder"}
_WORDS = {"de": "elev", "da": "ail", "dr": "rud"}
Command = tuple[tuple[str, float], ...]
"""What is moved by one command: (property, its sign)."""
NO_SURFACES = "an aircraft must have control surfaces"
TURNS = {"de": ("m", -1.0), "da": ("l", 1.0), "dr": ("n", -1.0)}
"""Control -> JSBSim's letter of the moment that a positive deflection makes, and its sign."""
_FULL_ASSUMED = 20.0 * DEG_RAD  # deflection of a surface whose model tells no angle
_GRID = 9
_SERVO_RATE_HZ = 1000.0
_FAST_RAD_S = 200.0  # of a servo that has a rate limit and no lag
_CROSSED = 0.02  # of what its own control moves a property by: less is no mixing
_MOST_FRAMES = 1500  # of a control system until its surfaces stand still: 12 s of it
_STILL_FRAMES = 40
_MOVED = 1e-7
_SMALL = 0.1  # of a throw, at which the sign of a deflection is found
_STRAIGHT = 1e-6  # of the range: a gearing is straight on both sides
_NO_ANGLE = re.compile(
    r"^/?(aero|velocities|attitude|position|atmosphere|accelerations|simulation|inertia|metrics|forces|moments|"
    r"propulsion|gear|buoyant_forces|flight-path|ic)/"
)


@dataclass(frozen=True)
class Moved:
    """A property that a command moves."""

    name: str  # JSBSim property
    commands: FloatArray  # (n,) from -1 to 1
    values: FloatArray  # (n,) of the property


@dataclass(frozen=True)
class Probe:
    """What was found on the controls of a model."""

    links: tuple[Link, ...]  # control surfaces as the adapter drives them
    found: tuple[str, ...]  # sentences on what was found
    assumed: tuple[str, ...]  # sentences on what was assumed
    # controls whose surface moves with the motion of the aircraft although its command stands still
    augmented: tuple[str, ...]


def watched(tree: ET.Element) -> list[str]:
    """Return the properties that the aerodynamics reads and that are no functions of its own."""
    sections = (*tree.findall("aerodynamics"), *tree.findall("external_reactions"))
    own = {str(f.get("name")).strip() for s in sections for f in s.iter("function") if f.get("name")}
    read = {
        (e.text or "").strip().lstrip("-")
        for s in sections
        for e in s.iter()
        if e.tag in {"property", "independentVar", "p", "v"}
    }
    return sorted(n for n in read - own if "/" in n and not _NO_ANGLE.match(n))


def probe(aircraft: Aircraft, condition: FlightCondition, alpha: float) -> Probe:
    """Find what the controls of a model move.

    Args:
        aircraft: the model without links; its adapter holds settings and neutral properties.
        condition: at which it is held.
        alpha: rad.

    Raises:
        ModelError: JSBSim refuses the model, or no command moves anything that the aerodynamics reads.
    """
    tree = aircraft.model_tree(aircraft.rate_hz, condition.qbar_Pa, condition.V_m_s)
    names, own_commands = watched(tree), _declared_commands(tree)
    links, found, assumed, augmented = [], [], [], []
    for control, usual in COMMANDS.items():
        bench = _Bench(aircraft, condition, alpha, names, aircraft.rate_hz)
        tries: list[Command] = [((n, 1.0),) for n in (usual, _FLIGHTGEAR[control])]
        tries.append(bench.together(control, [n for n in own_commands if _WORDS[control] in n.lower()]))
        moved, put = next(((m, c) for c in tries if c and (m := bench.sweep(c))), ([], tries[0]))
        command = " and ".join(n for n, _ in put)
        direct = bench.readable(control)
        if not moved and direct is not None:
            links.append(
                Link(control, (Drive(direct, ((-_FULL_ASSUMED, -_FULL_ASSUMED), (_FULL_ASSUMED, _FULL_ASSUMED))),))
            )
            augmented.append(control)
            assumed.append(
                f"{SURFACES[control]}: the aerodynamics reads {direct}, which {command} does not move: it is commanded "
                f"directly, and its throw is assumed to be {_FULL_ASSUMED / DEG_RAD:g} deg to both sides"
            )
            continue
        if not moved:
            found.append(f"{command} moves nothing that the aerodynamics reads: there is no {SURFACES[control]}")
            continue
        reference, factor, said = _reference(control, moved, bench, put)
        if said:
            assumed.append(said)
        sign = bench.sign(control, put)
        deflection = sign * factor * reference.values
        if not np.all(np.diff(deflection * np.sign(deflection[-1] - deflection[0] or 1.0)) >= -1e-9):
            raise ModelError(
                f"the {SURFACES[control]} must follow {command} without turning back, got {reference.name} = "
                f"{', '.join(f'{v:.4g}' for v in reference.values)}"
            )
        drives = tuple(Drive(m.name, _points(deflection, m.values)) for m in moved)
        fast = _Bench(aircraft, condition, alpha, [reference.name], _SERVO_RATE_HZ)
        lag, limit = fast.servo(put, reference.name, factor)
        ends = float(min(deflection[0], deflection[-1])), float(max(deflection[0], deflection[-1]))
        way = 1.0 if deflection[-1] >= deflection[0] else -1.0
        law = Law(command, way, reference.name, float(sign * factor), ends, lag, limit)
        links.append(Link(control, drives, lag, limit, law=law if put == tries[0] else None))
        low, high = (end / DEG_RAD for end in ends)
        turned = " with the opposite sign" if sign * (reference.values[-1] - reference.values[0]) < 0 else ""
        sides = {side for side in ("left", "right") if any(f"{side}-{SURFACES[control]}" in m.name for m in moved)}
        unread = {"left", "right"} - sides if sides else set()
        for side in unread:
            name = next((n for n in names if f"{side}-{SURFACES[control]}" in n), None)
            if name is not None:
                found.append(
                    f"{SURFACES[control]}: the aerodynamics reads {name}, which {command} does not move: one side is "
                    "still, and rolling pitches and yaws the aircraft"
                )
        found.append(
            f"{SURFACES[control]}: {command} moves {', '.join(m.name for m in moved)}; {control} is {reference.name}"
            f"{turned}, {low:.4g} to {high:.4g} deg"
        )
        if lag is not None:
            rate = "" if limit is None else f" and a rate limit of {limit / DEG_RAD:.4g} deg/s"
            found.append(f"{SURFACES[control]}: the model moves it with a lag of {lag:.4g} rad/s{rate}")
        feedback = bench.feedback(reference)
        if feedback:
            augmented.append(control)
            found.append(
                f"{SURFACES[control]}: it moves with {', '.join(feedback)} while its command is constant: a control "
                "law of the model"
            )
    links = _uncrossed(links)
    if not augmented:  # nothing feels the motion: what lies between is a gearing and a servo
        links = [replace(link, law=None) for link in links]
    if not links:
        raise ModelError(
            f"{NO_SURFACES}, but none of {', '.join(COMMANDS.values())} moves anything that "
            f"the aerodynamics of {aircraft.name} reads"
        )
    links, turned_round = _turned_right(aircraft, condition, alpha, links)
    return Probe(tuple(links), (*found, *turned_round), tuple(assumed), tuple(augmented))


def _turned_right(
    aircraft: Aircraft, condition: FlightCondition, alpha: float, links: Sequence[Link]
) -> tuple[list[Link], list[str]]:
    """Return the links with the sign by which a small deflection turns the aircraft, and which of them were turned.

    The sign of a command over half of its range is not that of a small one where tables bend, and a surface that is
    commanded directly was not moved before.
    """
    out, said = [], []
    for link in links:
        fdm = Executive(
            replace(aircraft, adapter=replace(aircraft.adapter or Adapter(), links=(link,))),
            aircraft.rate_hz,
            condition,
        )
        axis, wanted = TURNS[link.control]
        size, moments = _SMALL * min(abs(d) for d in (_ends(link))), []
        for way in (-1.0, 1.0):
            fdm.set(link.command, way * size)
            fdm.place_at(condition, alpha)
            fdm.evaluate(held=True)
            moments.append(fdm.get(f"moments/{axis}-aero-lbsft"))
        if wanted * (moments[1] - moments[0]) < 0.0:
            said.append(f"{link.word}: its sign is that of a small deflection, which turns the aircraft the other way")
            drives = tuple(Drive(d.name, tuple((-a, v) for a, v in reversed(d.points))) for d in link.drives)
            link = replace(link, drives=drives, law=None)
        out.append(link)
    return out, said


def _ends(link: Link) -> tuple[float, float]:
    deflections = [d for drive in link.drives for d, _ in drive.points]
    return min(deflections), max(deflections)


def _declared_commands(tree: ET.Element) -> list[str]:
    """Return the properties that a model declares for commands from outside, which none of its components write."""
    written = {(e.text or "").strip() for e in tree.iter("output")}
    declared = {
        (e.text or "").strip()
        for part in ("flight_control", "system", "autopilot")
        for e in tree.iterfind(f"{part}/property")
    }
    return sorted(n for n in declared - written if "cmd" in n.lower())


def _uncrossed(links: Sequence[Link]) -> list[Link]:
    """Return the links without what a control moves by the feedback of the model's own control system alone."""
    most: dict[str, float] = {}
    for link in links:
        for d in link.drives:
            most[d.name] = max(most.get(d.name, 0.0), _reach(d))
    return [replace(x, drives=tuple(d for d in x.drives if _reach(d) > _CROSSED * most[d.name])) for x in links]


def _reach(drive: Drive) -> float:
    values = [v for _, v in drive.points]
    return max(values) - min(values)


class _Bench:
    """A model held in the air, whose control system runs while the aircraft does not move."""

    def __init__(
        self, aircraft: Aircraft, condition: FlightCondition, alpha: float, names: Sequence[str], rate_hz: float
    ) -> None:
        self._fdm = Executive(aircraft, rate_hz, condition)
        self._condition, self._alpha = condition, alpha
        self.names = [n for n in names if self._fdm.has(n)]
        self._nodes = [self._fdm.node(n) for n in self.names]
        self._hold()

    def readable(self, control: str) -> str | None:
        """Return the property in rad that the aerodynamics reads of a control by its usual name, or None."""
        word = SURFACES[control]
        usual = (f"fcs/{word}-pos-rad", f"fcs/left-{word}-pos-rad")
        return next((n for n in usual if n in self.names), None)

    def _hold(self, alpha: float = 0.0, beta: float = 0.0, pqr: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        """Hold it in its attitude, with angle of attack, sideslip and rates changed."""
        at = self._condition
        self._fdm.place(at.h_m, self._alpha, 0.0, velocity_at(at.V_m_s, self._alpha + alpha, beta), pqr)
        self._fdm.evaluate(held=True)

    def _read(self) -> FloatArray:
        return np.array([n.get_double_value() for n in self._nodes])

    def _rest(self) -> FloatArray:
        """Run the control system until nothing moves any more and return what is watched."""
        last, still = self._read(), 0
        for _ in range(_MOST_FRAMES):
            self._fdm.fdm.run_ic()
            now = self._read()
            still = still + 1 if np.array_equal(now, last) else 0
            last = now
            if still >= _STILL_FRAMES:
                break
        return last

    def _put(self, command: Command, value: float) -> None:
        for name, sign in command:
            self._fdm.set(name, sign * value)

    def together(self, control: str, names: Sequence[str]) -> Command:
        """Return the command that moves several properties, each with the sign by which it turns the aircraft alike."""
        found = [(n, self.sign(control, ((n, 1.0),))) for n in names if self._fdm.has(n)]
        return tuple((n, sign * found[0][1]) for n, sign in found)

    def sweep(self, command: Command) -> list[Moved]:
        """Return the properties that a command moves over its range.

        The commands at which one of them goes through zero are added: there a gearing may have its corner.
        """
        if not all(self._fdm.has(name) for name, _ in command):
            return []
        commands = np.linspace(-1.0, 1.0, _GRID)
        table = self._over(command, commands, self._read)
        crossings = set()
        for column in table.T:
            for i in np.flatnonzero(column[:-1] * column[1:] < 0.0):
                share = column[i] / (column[i] - column[i + 1])
                crossings.add(round(float(commands[i] + share * (commands[i + 1] - commands[i])), 9))
        if crossings:
            commands = np.union1d(commands, sorted(crossings))
            table = self._over(command, commands, self._read)
        moved = np.ptp(table, axis=0) > _MOVED
        return [Moved(n, commands, table[:, i]) for i, n in enumerate(self.names) if moved[i]]

    def _over(self, command: Command, commands: Iterable[float], read: Callable[[], Any]) -> FloatArray:
        """Return what is read where everything rests at each command; it is left at zero."""
        rows = []
        for value in commands:
            self._put(command, value)
            self._rest()
            rows.append(read())
        self._put(command, 0.0)
        self._rest()
        return np.array(rows)

    def angle(self, name: str, command: Command, commands: FloatArray) -> FloatArray | None:
        """Return the values of a property over commands (n,), or None if the model has none of that name."""
        if not self._fdm.has(name):
            return None
        return self._over(command, commands, self._fdm.node(name).get_double_value)

    def sign(self, control: str, command: Command) -> float:
        """Return 1 if a positive command gives the moment of a positive deflection, else -1: see the signal table."""
        axis, wanted = TURNS[control]
        moments = self._over(command, (-0.5, 0.5), self._fdm.node(f"moments/{axis}-aero-lbsft").get_double_value)
        return 1.0 if wanted * (moments[1] - moments[0]) >= 0.0 else -1.0

    def feedback(self, reference: Moved) -> list[str]:
        """Return the motions of the aircraft that move a surface although its command stands still."""
        node = self._fdm.node(reference.name)
        least = 1e-4 * float(np.ptp(reference.values))
        self._hold()
        self._rest()
        rest = node.get_double_value()
        tried: dict[str, dict[str, Any]] = {
            "angle of attack": {"alpha": 0.03},
            "sideslip": {"beta": 0.03},
            "roll rate": {"pqr": (0.1, 0.0, 0.0)},
            "pitch rate": {"pqr": (0.0, 0.1, 0.0)},
            "yaw rate": {"pqr": (0.0, 0.0, 0.1)},
        }
        out = []
        for words, state in tried.items():
            self._hold(**state)
            for _ in range(30):
                self._fdm.fdm.run_ic()
            if abs(node.get_double_value() - rest) > least:
                out.append(words)
            self._hold()
            self._rest()
        return out

    def servo(self, command: Command, name: str, factor: float) -> tuple[float | None, float | None]:
        """Return lag (rad/s) and rate limit (rad/s) between a command and its surface; None where there is none.

        A small step shows the lag: the surface has covered 63 % of it after one time constant. A full step shows the
        limit, if the surface moves by the same amount in many frames in a row.
        """
        node, rate = self._fdm.node(name), self._fdm.rate_hz
        small, large = self._step(node, command, 0.02), self._step(node, command, 1.0)
        if small is None or large is None or len(small) < 2:
            return None, None
        first = int(np.argmax(np.abs(small - small[0]) >= (1.0 - np.exp(-1.0)) * abs(small[-1] - small[0])))
        steps = np.abs(np.diff(large)) * abs(factor)
        most = float(steps.max())
        limit = most * rate if np.count_nonzero(steps > 0.999 * most) >= 5 else None
        if first > 3:
            return rate / first, limit
        return (None, None) if limit is None else (_FAST_RAD_S, limit)

    def _step(self, node: Any, command: Command, size: float) -> FloatArray | None:
        """Return the value of a property from the step of its command until it rests, one value per frame.

        Time runs, as some servos stand still without it, but nothing of the aircraft moves.
        """
        self._put(command, 0.0)
        self._rest()
        values = [node.get_double_value()]
        self._put(command, size)
        with self._fdm.still():
            for _ in range(_MOST_FRAMES):
                self._fdm.fdm.run()
                values.append(node.get_double_value())
                if len(values) > 5 and values[-1] == values[-5]:
                    break
        self._put(command, 0.0)
        self._rest()
        found = np.array(values)
        return found if abs(found[-1] - found[0]) > 0.0 else None


def _reference(control: str, moved: Sequence[Moved], bench: _Bench, command: Command) -> tuple[Moved, float, str]:
    """Return the property that tells the deflection of a control, its factor to rad, and what was assumed, if anything.

    An angle in rad or degrees, of the surface that the control is named by if there are several.
    """
    word = SURFACES[control]
    units = {"-rad": 1.0, "_rad": 1.0, "-deg": DEG_RAD, "_deg": DEG_RAD}

    def rank(m: Moved) -> tuple[int, int, float]:
        own = _WORDS[control] in m.name.lower() or (
            control == "de" and re.search(r"stabil|elevon|tail", m.name) is not None
        )
        angle = any(u in m.name for u in units)
        return (0 if angle else 1, 0 if own else 1, -float(np.ptp(m.values)))

    best = min(moved, key=rank)
    for unit, factor in units.items():
        if unit in best.name:
            return best, factor, ""
    for unit, factor in units.items():
        for name in (f"fcs/{word}-pos{unit}", f"fcs/left-{word}-pos{unit}"):
            values = bench.angle(name, command, best.commands)
            if values is not None and np.ptp(values) > 1e-3:
                return Moved(name, best.commands, values), factor, ""
    most = float(np.max(np.abs(best.values)))
    return best, _FULL_ASSUMED / most, (
        f"{word}: the model states no angle of it, only {best.name}; its full deflection is assumed to be "
        f"{_FULL_ASSUMED / DEG_RAD:g} deg, and derivatives by {control} count in it"
    )  # fmt: skip


def _points(deflection: FloatArray, values: FloatArray) -> tuple[tuple[float, float], ...]:
    """Return (deflection, value) from the lowest to the highest deflection, at the corners of the gearing."""
    order = np.argsort(deflection, kind="stable")
    d, v = deflection[order], values[order]
    keep = np.concatenate([[True], np.diff(d) > 1e-12])
    d, v = d[keep], v[keep]
    d, v = np.where(np.abs(d) < 1e-12, 0.0, d), np.where(np.abs(v) < 1e-12, 0.0, v)
    corners = [0]
    for i in range(1, len(d) - 1):  # what lies on the line between its neighbours is no corner
        between = np.interp(d[i], [d[corners[-1]], d[i + 1]], [v[corners[-1]], v[i + 1]])
        if abs(between - v[i]) > _STRAIGHT * max(float(np.ptp(v)), 1e-12):
            corners.append(i)
    corners.append(len(d) - 1)
    return tuple((float(d[i]), float(v[i])) for i in corners)


def undefined(aircraft: Aircraft, condition: FlightCondition) -> Mapping[str, float]:
    """Return the properties that a model reads and nothing defines, with a neutral value: those of FlightGear, mostly.

    Raises:
        ModelError: JSBSim refuses the model for another reason; its own words are quoted.
    """
    neutral: dict[str, float] = {}
    for _ in range(60):
        tried = replace(aircraft, adapter=replace(aircraft.adapter or Adapter(), neutral=neutral))
        try:
            Executive(tried, aircraft.rate_hz, condition)
            return neutral
        except UndefinedProperties as error:
            new = [n for n in error.missing if n not in neutral]
            if not new:
                raise
            neutral |= dict.fromkeys(new, 0.0)
    raise ModelError(f"a model must read properties that exist, but {aircraft.name} lacks {', '.join(neutral)}")
