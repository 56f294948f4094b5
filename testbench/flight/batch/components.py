"""Components of JSBSim's flight control as operations (FGFCSComponent, FGFCSChannel, FGGain, FGSummer, FGFCSFunction).

A component reads its inputs, computes, clips, and writes its outputs and the property of its own name.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from functools import reduce
from operator import add

from testbench.flight.batch import actuators, filters, logic
from testbench.flight.batch import registers as r
from testbench.flight.batch.functions import Functions
from testbench.flight.batch.program import Builder, Untranslated, Value
from testbench.flight.batch.properties import Properties
from testbench.flight.batch.scope import MEMORY, STARTED, Channel, Scope

_SKIPPED = {"description", "documentation", "property"}


class Components:
    """Translates channels of components into a program.

    Args:
        builder: of the program.
        properties: that they read and write.
        functions: translates their functions and tables.
        dt_s: frame time that the components are made for.
        switchable: names of failures that something in the model sets.
    """

    def __init__(
        self,
        builder: Builder,
        properties: Properties,
        functions: Functions,
        dt_s: float,
        switchable: frozenset[str] = frozenset(),
    ) -> None:
        self._b, self._p, self._f, self._dt = builder, properties, functions, dt_s
        self._switchable = switchable
        self._channels = self._count = 0

    def channel(self, e: ET.Element) -> None:
        """Translate a channel; what a component writes is unknown if it is not translated."""
        channel = self._channel(e)
        for component in e:
            if component.tag not in _SKIPPED:
                self._component(component, channel)
        if channel.runs is not None:
            started = f"{MEMORY}channel-{self._channels}/started"
            self._b.write(started, channel.runs.then(1.0, channel.started))

    def end(self) -> None:
        """End the frame's part of the components: all that run in every frame have run."""
        self._b.write(STARTED, self._b.constant(1.0))

    def _channel(self, e: ET.Element) -> Channel:
        """Return a channel; one that has a switch or a rate of its own does not run in every frame.

        It counts frames in which time passes, and runs in every frame while it stands still.
        """
        b, name = self._b, e.get("execute")
        self._channels += 1
        rate = max(int(e.get("execrate") or "1"), 1)
        dt_s = self._dt * rate
        if not name and not e.get("execrate"):
            return Channel(b.number(dt_s), dt_s, None, b.read(STARTED))
        key = f"{MEMORY}channel-{self._channels}"
        left = b.read(f"{key}/frames-left")
        counted = b.core(r.DT).differs(0.0).then((left <= 0.0).then(rate, left) - 1.0, left)
        runs = counted <= 0.0
        if name:
            on = self._p.read(name).differs(0.0)
            runs, counted = on & runs, on.then(counted, left)
        b.write(f"{key}/frames-left", counted)
        return Channel(b.number(dt_s), dt_s, runs, b.read(f"{key}/started"))

    def _component(self, e: ET.Element, channel: Channel) -> None:
        self._count += 1
        c = Scope(e, f"component-{self._count}", channel, self._b, self._p, self._f, self._switchable)
        try:
            if e.tag == "distributor":
                logic.distribute(c)
                return
            kind = _KINDS.get(e.tag)
            if kind is None:
                raise Untranslated(f"it has the component <{e.tag}>")
            value = c.clipped(kind(c))
        except Untranslated as missing:
            value = self._b.unknown(str(missing))
        for name in logic.distributed(e) if e.tag == "distributor" else c.outputs:
            c.write(name, value)
        if e.tag == "actuator":
            self._p.declare(f"{c.name}/saturated")
            c.write(f"{c.name}/saturated", actuators.saturated(c, value))


def _function(c: Scope) -> Value:
    function = c.e.find("function")
    if function is None:
        raise Untranslated(f"component {c.name} has no function")
    value, inputs = c.f.value(function), c.inputs()
    return value * inputs[0] if inputs else value


def _gain(c: Scope) -> Value:
    return c.parameter("gain", 1.0) * c.input()


def _scheduled(c: Scope) -> Value:
    table = c.e.find("table")
    if table is None:
        raise Untranslated(f"component {c.name} has no table")
    return c.parameter("gain", 1.0) * c.f.table(table) * c.input()


def _scale(c: Scope) -> Value:
    x = c.input()
    told = all(c.e.find(f"domain/{end}") is not None for end in ("min", "max"))
    low, high = (c.number(f"domain/{end}", d) if told else c.b.number(d) for end, d in (("min", -1.0), ("max", 1.0)))
    least, most = (c.number(f"range/{end}") for end in ("min", "max"))
    if (c.e.findtext("zero_centered") or "").strip() in {"0", "false"}:
        out = least + (x - low) / (high - low) * (most - least)
    else:
        out = x.equals(0.0).then(0.0, (x > 0.0).then(x / high * most, x / low * least))
    return out * c.parameter("gain", 1.0)


def _summer(c: Scope) -> Value:
    total = reduce(add, c.inputs() or [c.b.constant(0.0)])
    return total + c.number("bias") if c.e.find("bias") is not None else total


_KINDS: Mapping[str, Callable[[Scope], Value]] = {
    "fcs_function": _function,
    "pure_gain": _gain,
    "scheduled_gain": _scheduled,
    "aerosurface_scale": _scale,
    "summer": _summer,
    "lag_filter": filters.lag_filter,
    "lead_lag_filter": filters.lead_lag_filter,
    "washout_filter": filters.washout_filter,
    "second_order_filter": filters.second_order_filter,
    "integrator": filters.integrator,
    "pid": filters.pid,
    "switch": logic.switch,
    "deadband": actuators.deadband,
    "kinematic": actuators.kinematic,
    "actuator": actuators.actuator,
    "sensor": actuators.sensor,
    "gyro": actuators.gyro,
    "accelerometer": actuators.accelerometer,
    "angle": actuators.angle,
}
