"""How a JSBSim model that somebody else wrote is flown: its controls, and what it is told before it flies.

Names and units in such models are anybody's. What they have in common is that some properties are read by the
aerodynamics and moved by a command of the pilot. The adapter drives these properties itself: for every control it
writes a channel behind the model's own control system,

    command (rad) -> servo -> deflection (rad) -> each property that the aerodynamics reads

so that command and surface are seams of their own with one meaning in every model, and gearing, trim tabs, autopilot
and stability augmentation of the model's own control system have no part in them. A control may be commanded by the
stick instead: then the model's own control law stays,

    command (rad) -> stick -> the model's law, which feels the motion -> demand (rad) -> servo -> deflection (rad)

A trim is the same by either way: while time stands still the demand is the command. What the law makes of the stick in
its middle and of the motion at trim is taken away from then on, as a trim wheel does, so that it acts about the trim.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from testbench.aircraft.reactions import before_aerodynamics, element, number

SURFACES = {"de": "elevator", "da": "aileron", "dr": "rudder"}
"""Control -> the word that its properties are named by."""
PREFIX = "testbench/"
THROTTLE = f"{PREFIX}throttle-command"
CommandedAt = Literal["stick", "surface"]
"""Where commands enter: before the model's own control law, or behind it."""
BIAS = "-bias-rad"
"""How the properties end that hold what a law makes of a trim."""
CHANNEL = "testbench"
"""Name of the channel that moves the surfaces."""


@dataclass(frozen=True)
class Drive:
    """A property that the aerodynamics reads and a control moves."""

    name: str  # JSBSim property
    # (deflection of the control in rad, value of the property), ascending; linear between them
    points: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Law:
    """The model's own way from the stick to a surface."""

    stick: str  # property of the pilot's command, -1 to 1
    sign: float  # of the stick that deflects the surface to its positive side
    own: str  # property that tells where the model has the surface
    factor: float  # of it to the deflection in rad
    ends: tuple[float, float]  # (lowest, highest) deflection, rad: full stick to either side
    # lag_rad_s, rate_limit_rad_s: of the servo that stands for the whole way where the law is left out
    lag_rad_s: float | None = None
    rate_limit_rad_s: float | None = None


@dataclass(frozen=True)
class Link:
    """One control surface of a model: what it moves, how far, and the servo before it."""

    control: str  # "de", "da" or "dr"
    drives: tuple[Drive, ...]  # properties that follow the deflection
    lag_rad_s: float | None = None  # corner frequency of the servo; None if the surface is where its command is
    rate_limit_rad_s: float | None = None  # of the servo; None without one
    # True if command and surface are properties of their own even without a lag, so that something can be put between
    # them
    apart: bool = False
    law: Law | None = None  # the model's own law, where it has one that feels the motion
    by_stick: bool = False  # whether the command is the stick, and the law flies

    def commanded_at(self, point: CommandedAt) -> Link:
        """Return the link commanded at the "stick" or at the "surface"; without a law both are one."""
        if self.law is None or self.by_stick == (point == "stick"):
            return self
        lag, limit = (self.law.lag_rad_s, self.law.rate_limit_rad_s) if self.by_stick else (None, None)
        return replace(self, by_stick=not self.by_stick, lag_rad_s=lag, rate_limit_rad_s=limit)

    @property
    def word(self) -> str:
        """The word in the names of its properties."""
        return SURFACES[self.control]

    @property
    def command(self) -> str:
        """Property of the command, rad."""
        return f"{PREFIX}{self.word}-command-rad"

    @property
    def demand(self) -> str:
        """Property of what the servo is to follow, rad: the command, or what the law makes of it."""
        return f"{PREFIX}{self.word}-demand-rad" if self.by_stick else self.command

    @property
    def surface(self) -> str:
        """Property of the deflection, rad: where the servo stands, or what it follows unless they are apart."""
        joined = self.lag_rad_s is None and not self.apart
        return self.demand if joined else f"{PREFIX}{self.word}-pos-rad"

    @property
    def lag(self) -> str:
        """Property of the servo's corner frequency, rad/s."""
        return f"{PREFIX}{self.word}-lag-rad_sec"

    @property
    def rate_limit(self) -> str:
        """Property of the servo's rate limit, rad/s."""
        return f"{PREFIX}{self.word}-rate-limit-rad_sec"


@dataclass(frozen=True)
class Adapter:
    """What is added to a foreign model so that it can be commanded, and what it is told once it is loaded."""

    links: tuple[Link, ...] = ()  # its control surfaces
    throttles: tuple[str, ...] = ()  # property of the throttle of every engine; all follow one command
    # property -> value, set before it flies: gear, flaps, mixture, magnetos, fuel
    settings: Mapping[str, float] = field(default_factory=dict)
    # property -> value of those that the model reads and nothing defines
    neutral: Mapping[str, float] = field(default_factory=dict)
    # centre of gravity as it flies, inches in the structural frame, found when the model is loaded
    cg_in: tuple[float, float, float] | None = None

    def link(self, control: str) -> Link | None:
        """Return the link of a control, or None."""
        return next((x for x in self.links if x.control == control), None)

    def commanded_at(self, point: CommandedAt) -> Adapter:
        """Return the adapter with every control commanded at the "stick" or at the "surface"."""
        return replace(self, links=tuple(link.commanded_at(point) for link in self.links))

    def apply(self, tree: ET.Element) -> None:
        """Add declarations and channels to a model in place."""
        control = tree.find("flight_control")
        if control is None:
            control = ET.Element("flight_control", {"name": "FCS"})
            tree.insert(before_aerodynamics(tree), control)
        declared: dict[str, float] = {}
        if self.throttles:
            declared[THROTTLE] = 0.0
            commands = [n for n in self.throttles if not _is_position(n)]
            if commands:
                tree.insert(_first_system(tree), _throttle_system(commands, _outputs(tree)))
        declare(tree, self.neutral)
        channel = ET.Element("channel", {"name": CHANNEL})
        for name in self.throttles:
            if _is_position(name):  # last of all, whatever the model's own control system made of its throttle
                channel.append(_throttle_gain(name, [name]))
        sticks = ET.Element("channel", {"name": "testbench stick"})
        for link in self.links:
            declared[link.command] = 0.0
            if link.law is not None and link.by_stick:
                names = {"WORD": link.word, "OWN": link.law.own, "FACTOR": repr(link.law.factor)}
                names |= dict(zip(("LOW", "HIGH"), map(repr, link.law.ends), strict=True))
                sticks.extend(_components(_STICK, names))
                full = link.law.sign
                ends = tuple(zip((link.law.ends[0], 0.0, link.law.ends[1]), (-full, 0.0, full), strict=True))
                sticks.append(_drive(link.law.stick, [(f"{PREFIX}{link.word}-stick-rad", Drive("", ends))]))
                channel.extend(_components(_LAW, names))
                declared |= {f"{PREFIX}{link.word}-{n}-rad": 0.0 for n in ("trim", "stick", "bias", "demand")}
            if link.surface != link.demand:
                declared[link.surface] = 0.0
                declared[link.rate_limit] = 1e3 if link.rate_limit_rad_s is None else link.rate_limit_rad_s
                if link.lag_rad_s is not None:
                    declared |= {link.lag: link.lag_rad_s, f"{PREFIX}{link.word}-previous-rad": 0.0}
                servo = _RIGID if link.lag_rad_s is None else _SERVO
                channel.extend(_components(servo, {"DEMAND": link.demand, "WORD": link.word}))
            # What was added to coefficients by a deflection follows the surface, whatever servo it has by now.
            for name in {link.command, f"{PREFIX}{link.word}-pos-rad"} - {link.surface}:
                _read_instead(tree, name, link.surface)
        renamed = _own_names(tree)
        for name, links in _by_property(self.links).items():
            lawful = any(link.by_stick for link, _ in links)
            target = f"{PREFIX}{name.replace('/', '-')}" if name in renamed or lawful else name
            if target != name:
                declared[target] = 0.0
                _read_instead(tree, name, target)
            moved = [(link.surface, drive) for link, drive in links]
            if not lawful:
                channel.append(_drive(target, moved))
                continue
            # What the law has moved, and what a servo that was put behind it leaves of that.
            demanded = [(link.demand, drive) for link, drive in links]
            still, bias = f"{target}-still", f"{target}{BIAS}"
            declared |= {still: 0.0, bias: 0.0}
            channel.append(_drive(still, demanded))
            names = {"TARGET": target, "STILL": still, "BIAS": bias, "OWN": name, "LATE": still}
            if moved != demanded:
                names["LATE"] = f"{target}-late"
                declared[names["LATE"]] = 0.0
                channel.append(_drive(names["LATE"], moved))
            channel.extend(_components(_MOVED_BY_LAW, names))
        if len(sticks):
            tree.insert(_first_system(tree), element("system", sticks, name="testbench stick"))
        declare(tree, declared)
        control.append(channel)


def _components(template: str, names: Mapping[str, str]) -> list[ET.Element]:
    """Return the components of a template with words put in."""
    for word, text in names.items():
        template = template.replace(word, text)
    return list(ET.fromstring(f"<channel>{template}</channel>"))


def _first_system(tree: ET.Element) -> int:
    tags = [e.tag for e in tree]
    return min([i for i, t in enumerate(tags) if t in {"system", "autopilot", "flight_control"}], default=len(tags))


def declare(tree: ET.Element, properties: Mapping[str, float]) -> None:
    """Declare properties before anything that reads them, but for those that are declared already."""
    known = {(e.text or "").strip() for e in tree.iter("property") if "value" in e.attrib}
    missing = {name: value for name, value in properties.items() if name not in known}
    if missing:
        rows = (element("property", text=name, value=repr(float(value))) for name, value in missing.items())
        tree.insert(_first_system(tree), element("system", *rows, name="testbench properties"))


def _outputs(tree: ET.Element) -> set[str]:
    return {(e.text or "").strip() for e in tree.iter("output")}


def _throttle_system(throttles: Sequence[str], outputs: set[str]) -> ET.Element:
    """Return the system that gives the throttle command to every engine.

    JSBSim copies throttle commands to positions before the systems run, so that a command written by a system would be
    one frame late: the position is written as well, unless the model's own control system does.
    """
    channel = element("channel", name="testbench throttle")
    for name in throttles:
        position = name.replace("-cmd-norm", "-pos-norm")
        alone = position == name or position in outputs or position.replace("[0]", "") in outputs
        channel.append(_throttle_gain(name, [name] if alone else [name, position]))
    return element("system", channel, name="testbench throttle")


def _is_position(name: str) -> bool:
    """Return whether a throttle is driven at the engine, behind the model's own control system."""
    return "-pos-norm" in name


def _throttle_gain(name: str, targets: Sequence[str]) -> ET.Element:
    own = name.strip("/").replace("/", "-").replace("[", "-").replace("]", "")
    return _component("pure_gain", f"{PREFIX}{own}", THROTTLE, [element("gain", text="1.0")], *targets)


def _component(tag: str, name: str, source: str, parts: Sequence[ET.Element], *targets: str) -> ET.Element:
    """Return a component of an input, what it is told, and its outputs."""
    return element(
        tag, element("input", text=source), *parts, *(element("output", text=target) for target in targets), name=name
    )


def _own_names(tree: ET.Element) -> set[str]:
    """Return the properties that JSBSim ties to components and functions, which nobody else can write."""
    names = set()
    for e in tree.iter():
        name = e.get("name")
        if name and e.tag not in {"channel", "system", "autopilot", "flight_control", "axis"}:
            name = name.strip().replace(" ", "-")
            names.add(name if "/" in name else f"fcs/{name.lower()}")
    return names


def _read_instead(tree: ET.Element, name: str, target: str) -> None:
    """Let the aerodynamics and external reactions read ``target`` for ``name``."""
    for section in (*tree.findall("aerodynamics"), *tree.findall("external_reactions")):
        for e in section.iter():
            if e.tag in {"property", "independentVar", "p"} and (e.text or "").strip() == name:
                e.text = target


def _by_property(links: Sequence[Link]) -> dict[str, list[tuple[Link, Drive]]]:
    out: dict[str, list[tuple[Link, Drive]]] = {}
    for link in links:
        for drive in link.drives:
            out.setdefault(drive.name, []).append((link, drive))
    return out


def _drive(target: str, terms: Sequence[tuple[str, Drive]]) -> ET.Element:
    """Return the component that moves one property with deflections, which are properties in rad."""
    name = f"{PREFIX}drive-{target.removeprefix(PREFIX).replace('/', '-')}"
    if len(terms) == 1:
        deflection, drive = terms[0]
        (low, at_low), (high, at_high) = drive.points[0], drive.points[-1]
        gain = at_high / high if high else 0.0
        if len(drive.points) == 2 and abs(at_low - gain * low) <= 1e-9 * abs(at_high - at_low):
            return _component("pure_gain", name, deflection, [element("gain", text=repr(gain))], target)
        if len(drive.points) == 3 and drive.points[1] == (0.0, 0.0):
            ends = {"domain": (low, high), "range": (at_low, at_high)}
            parts = [
                element(tag, *(element(end, text=repr(float(x))) for end, x in zip(("min", "max"), pair, strict=True)))
                for tag, pair in ends.items()
            ]
            return _component("aerosurface_scale", name, deflection, parts, target)
    total = element("sum")
    for i, (deflection, drive) in enumerate(terms):
        # what the property is without any deflection counts once
        offset = float(np.interp(0.0, *np.array(drive.points).T)) if i else 0.0
        rows = "\n".join(f"{d!r} {v - offset!r}" for d, v in drive.points)
        by = element("independentVar", text=deflection, lookup="row")
        total.append(element("table", by, element("tableData", text=f"\n{rows}\n")))
    if len(terms) == 1:
        total.append(number(0.0))
    return element("fcs_function", element("function", total), element("output", text=target), name=name)


_STILL = "<gt> <property>simulation/dt</property> <value>0</value> </gt>"
# The stick is moved by what is commanded beyond the trim.
_STICK = f"""
<fcs_function name="testbench/WORD-trim"> <function>
  <ifthen> {_STILL} <property>testbench/WORD-trim-rad</property>
    <property>testbench/WORD-command-rad</property> </ifthen>
</function> <output>testbench/WORD-trim-rad</output> </fcs_function>
<fcs_function name="testbench/WORD-stick"> <function>
  <ifthen> {_STILL} <difference> <property>testbench/WORD-command-rad</property>
    <property>testbench/WORD-trim-rad</property> </difference> <value>0</value> </ifthen>
</function> <output>testbench/WORD-stick-rad</output> </fcs_function>
"""
_LAW = f"""
<fcs_function name="testbench/WORD-bias"> <function>
  <ifthen> {_STILL} <property>testbench/WORD-bias-rad</property>
    <difference> <property>testbench/WORD-trim-rad</property>
      <product> <value>FACTOR</value> <property>OWN</property> </product> </difference> </ifthen>
</function> <output>testbench/WORD-bias-rad</output> </fcs_function>
<fcs_function name="testbench/WORD-demand"> <function>
  <max> <value>LOW</value> <min> <value>HIGH</value>
    <sum> <property>testbench/WORD-bias-rad</property>
      <product> <value>FACTOR</value> <property>OWN</property> </product> </sum> </min> </max>
</function> <output>testbench/WORD-demand-rad</output> </fcs_function>
"""
_MOVED_BY_LAW = f"""
<fcs_function name="TARGET-holds"> <function>
  <ifthen> {_STILL} <property>BIAS</property>
    <difference> <property>STILL</property> <property>OWN</property> </difference> </ifthen>
</function> <output>BIAS</output> </fcs_function>
<fcs_function name="TARGET-moves"> <function>
  <sum> <property>OWN</property> <property>BIAS</property>
    <difference> <property>LATE</property> <property>STILL</property> </difference> </sum>
</function> <output>TARGET</output> </fcs_function>
"""

# A surface that turns by CHANGE in a frame, no faster than its limit; without time it is where its command is.
_ACTUATOR = """
<fcs_function name="testbench/WORD-actuator">
  <function>
    <ifthen>
      <gt> <property>simulation/dt</property> <value>0</value> </gt>
      <sum>
        <property>testbench/WORD-pos-rad</property>
        <max>
          <product> <value>-1</value> <property>testbench/WORD-rate-limit-rad_sec</property>
            <property>simulation/dt</property> </product>
          <min>
            <product> <property>testbench/WORD-rate-limit-rad_sec</property>
              <property>simulation/dt</property> </product>
            CHANGE
          </min>
        </max>
      </sum>
      <property>DEMAND</property>
    </ifthen>
  </function>
  <output>testbench/WORD-pos-rad</output>
</fcs_function>
"""
# Without a lag it turns the whole way.
_RIGID = _ACTUATOR.replace(
    "CHANGE", "<difference> <property>DEMAND</property> <property>testbench/WORD-pos-rad</property> </difference>"
)
# With the lag of the packaged aircraft it is exact for commands that run linearly from frame to frame:
# x+ = a x + b0 c + b1 c+, a = exp(-lag dt), b1 = 1 - (1 - a)/(lag dt), b0 = 1 - a - b1.
_LAGGED = """<sum>
  <product>
    <difference> <value>1</value> <property>testbench/WORD-servo-b1</property>
      <property>testbench/WORD-servo-a</property> </difference>
    <property>testbench/WORD-previous-rad</property>
  </product>
  <product> <property>testbench/WORD-servo-b1</property> <property>DEMAND</property> </product>
  <product>
    <difference> <property>testbench/WORD-servo-a</property> <value>1</value> </difference>
    <property>testbench/WORD-pos-rad</property>
  </product>
</sum>"""
_SERVO = f"""
<fcs_function name="testbench/WORD-servo-x"> <function>
  <product> <property>testbench/WORD-lag-rad_sec</property>
    <max> <property>simulation/dt</property> <value>1e-9</value> </max> </product>
</function> </fcs_function>
<fcs_function name="testbench/WORD-servo-a">
  <function> <exp> <product> <value>-1</value> <property>testbench/WORD-servo-x</property> </product> </exp> </function>
</fcs_function>
<fcs_function name="testbench/WORD-servo-b1">
  <function> <difference> <value>1</value> <quotient>
    <difference> <value>1</value> <property>testbench/WORD-servo-a</property> </difference>
    <property>testbench/WORD-servo-x</property> </quotient> </difference> </function>
</fcs_function>
{_ACTUATOR.replace("CHANGE", _LAGGED)}
<fcs_function name="testbench/WORD-memory">
  <function> <sum> <property>DEMAND</property> <value>0</value> </sum> </function>
  <output>testbench/WORD-previous-rad</output>
</fcs_function>
"""
