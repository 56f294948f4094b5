"""What the translation of one component has at hand: its inputs, its memory, and the channel that it runs in."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass

from testbench.flight.batch.functions import Functions
from testbench.flight.batch.program import Builder, Op, Untranslated, Value
from testbench.flight.batch.properties import Properties

MEMORY = "batch/"
"""Beginning of the names under which components keep what JSBSim keeps inside of them."""
STARTED = f"{MEMORY}started"


def property_name(name: str) -> str:
    """Return the property that a name stands for; one without a path lies in fcs/ (FGFCSComponent::bind)."""
    return name if "/" in name else "fcs/" + re.sub(r"\s", "-", name).lower()


@dataclass(frozen=True)
class Channel:
    """A channel of components."""

    dt: Value  # time between two of its runs, fixed when the model is loaded
    dt_s: float  # the same as a number
    runs: Value | None  # whether it runs in this frame; always if None
    started: Value  # whether it has run before


@dataclass(frozen=True)
class Scope:
    """Translates one component."""

    e: ET.Element  # the component's element
    key: str  # under which its memory lies, that of no other component
    channel: Channel  # that it runs in
    b: Builder  # the program's builder
    p: Properties  # properties
    f: Functions  # functions
    switchable: frozenset[str] = frozenset()  # names of failures that something in the model sets

    def number(self, tag: str, default: float = 0.0) -> Value:
        """Return the number that an element inside holds."""
        return self.b.number(self.constant(tag, default))

    def constant(self, tag: str, default: float = 0.0) -> float:
        """Return the same as a number.

        Raises:
            Untranslated: it is not a number.
        """
        text = (self.e.findtext(tag) or "").strip()
        try:
            return float(text) if text else default
        except ValueError:
            raise Untranslated(f"it gives {text} for the <{tag}> of {self.name}, where JSBSim wants a number") from None

    def parameter(self, tag: str, default: float = 0.0) -> Value:
        """Return the value of an element inside that holds a number or the name of a property."""
        return self.parameter_of(self.e.findtext(tag) or "", default, self.e.find(tag))

    def parameter_of(self, text: str, default: float = 0.0, at: ET.Element | None = None) -> Value:
        """Return the value of a text, that of the element ``at``, that is a number or the name of a property."""
        text = text.strip()
        if not text:
            return self.b.number(default)
        try:
            return self.b.number(float(text), at)
        except ValueError:
            return self.p.read(text)

    @property
    def name(self) -> str:
        """Property that the component is named for."""
        return property_name((self.e.get("name") or "").strip())

    @property
    def outputs(self) -> list[str]:
        """Properties that it writes: its outputs, then the one of its own name."""
        return [*((x.text or "").strip() for x in self.e.findall("output")), self.name]

    def input(self) -> Value:
        """Return the first input.

        Raises:
            Untranslated: there is none.
        """
        values = self.inputs()
        if not values:
            raise Untranslated(f"component {self.name} has no input")
        return values[0]

    def inputs(self) -> list[Value]:
        """Return all inputs."""
        return [self.parameter_of(x.text or "") for x in self.e.findall("input")]

    def recall(self, what: str) -> Value:
        """Return what was kept when the component ran last."""
        return self.b.read(f"{MEMORY}{self.key}/{what}")

    def keep(self, what: str, value: Value) -> None:
        """Keep a value for the next run."""
        last = self.recall(what)
        self.b.write(f"{MEMORY}{self.key}/{what}", self._if_it_runs(value, last))

    def write(self, name: str, value: Value) -> None:
        """Write a property, if the component runs in this frame."""
        last = self.p.read(name) if self.channel.runs is not None else value
        self.p.write(name, self._if_it_runs(value, last))

    def _if_it_runs(self, value: Value, last: Value) -> Value:
        runs = self.channel.runs
        return value if runs is None else runs.then(value, last)

    def once_started(self, value: Value, first: Value | float = 0.0) -> Value:
        """Return a value, another one when the component runs for the first time."""
        return self.channel.started.then(value, first)

    def fails(self, how: str) -> Value | None:
        """Return whether a failure is switched on, None if nothing in the model switches it."""
        name = f"{self.name}/malfunction/{how}"
        if name not in self.switchable:
            return None
        self.p.declare(name)
        return self.p.read(name).differs(0.0)

    def clip_ends(self) -> tuple[Value, Value] | None:
        """Return the limits of <clipto>, None if it has not got both."""
        clip = self.e.find("clipto")
        if clip is None or clip.find("min") is None or clip.find("max") is None:
            return None
        return self.parameter("clipto/min"), self.parameter("clipto/max")

    def clipped(self, value: Value) -> Value:
        """Return an output within its limits, or wrapped into them (FGFCSComponent::Clip)."""
        ends = self.clip_ends()
        if ends is None:
            return value
        low, high = ends
        within = value.do(Op.CLIP, low, high)
        if self.e.find("clipto[@type='cyclic']") is None:
            return within
        cycle = high - low
        wrapped = (value - low).do(Op.FMOD, cycle) + low
        wrapped = (wrapped < low).then(wrapped + cycle, wrapped)
        return (cycle > 0.0).then(wrapped, within)

    def delayed(self, value: Value) -> Value:
        """Return what the output was some frames ago; a <delay> of n frames is one of n - 1 (FGFCSComponent::Delay).

        Before the first frame it was zero; that of a switch, too, whose default JSBSim fills in and then resets.

        Raises:
            Untranslated: the delay is not a number.
        """
        e = self.e.find("delay")
        if e is None:
            return value
        length, kind = self.constant("delay"), e.get("type") or "time"
        frames = int({"frames": length, "time": length / self.channel.dt_s}.get(kind, 0.0))
        waiting = [f"delayed-{k}" for k in range(1, frames)]
        if not waiting:
            return value
        out = self.recall(waiting[-1])
        for k in range(len(waiting) - 1, 0, -1):
            self.keep(waiting[k], self.recall(waiting[k - 1]))
        self.keep(waiting[0], value)
        return out
