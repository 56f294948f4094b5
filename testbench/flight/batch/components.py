"""Components of JSBSim's flight control as operations (FGFCSComponent and what comes of it).

A component reads its inputs, computes, clips, and writes its outputs and the property of its own name.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable

from testbench.flight.batch.functions import Functions
from testbench.flight.batch.program import Builder, Op, Untranslated, Value
from testbench.flight.batch.properties import Properties


class Components:
    """Translates components into a program.

    Args:
        builder: of the program.
        properties: that they read and write.
        functions: translates their functions and tables.
        dt_s: frame time that the components were made for.
    """

    def __init__(self, builder: Builder, properties: Properties, functions: Functions, dt_s: float) -> None:
        self._b, self._p, self._f, self._dt = builder, properties, functions, dt_s
        self._kinds: dict[str, Callable[[ET.Element], Value]] = {
            "fcs_function": self._function,
            "pure_gain": self._gain,
            "scheduled_gain": self._scheduled,
            "aerosurface_scale": self._scale,
            "summer": self._summer,
        }

    def add(self, e: ET.Element) -> None:
        """Translate one component; what it writes is unknown if it is not translated."""
        try:
            value = self._clipped(e, self._value(e))
        except Untranslated as missing:
            value = self._b.unknown(str(missing))
        for name in outputs(e):
            self._p.write(name, value)

    def unknown(self, e: ET.Element, reason: str) -> None:
        """Say that what a component writes is not known."""
        for name in outputs(e):
            self._p.write(name, self._b.unknown(reason))

    def _value(self, e: ET.Element) -> Value:
        kind = self._kinds.get(e.tag)
        if kind is None:
            raise Untranslated(f"it has the component <{e.tag}>")
        if e.find("delay") is not None:
            raise Untranslated("a component has a <delay>")
        return kind(e)

    def number_or_property(self, e: ET.Element | None, default: float = 0.0) -> Value:
        """Return the value of an element that holds a number or the name of a property."""
        text = "" if e is None else (e.text or "").strip()
        if not text:
            return self._b.number(default)
        try:
            return self._b.number(float(text), e)
        except ValueError:
            return self._p.read(text)

    def _inputs(self, e: ET.Element) -> list[Value]:
        return [self.number_or_property(x) for x in e.findall("input")]

    def _clipped(self, e: ET.Element, value: Value) -> Value:
        clip = e.find("clipto")
        if clip is None or clip.find("min") is None or clip.find("max") is None:
            return value
        if clip.get("type") == "cyclic":
            raise Untranslated("a component clips to a cycle")
        low, high = (self.number_or_property(clip.find(end)) for end in ("min", "max"))
        return self._b.emit(Op.CLIP, value, low, high)

    def _function(self, e: ET.Element) -> Value:
        function = e.find("function")
        if function is None:
            raise Untranslated(f"component {e.get('name')} has no function")
        value, inputs = self._f.value(function), self._inputs(e)
        return self._b.emit(Op.MUL, value, inputs[0]) if inputs else value

    def _gain(self, e: ET.Element) -> Value:
        return self._b.emit(Op.MUL, self.number_or_property(e.find("gain"), 1.0), self._inputs(e)[0])

    def _scheduled(self, e: ET.Element) -> Value:
        table = e.find("table")
        if table is None:
            raise Untranslated(f"component {e.get('name')} has no table")
        gain = self.number_or_property(e.find("gain"), 1.0)
        return self._b.emit(Op.MUL, self._b.emit(Op.MUL, gain, self._f.table(table)), self._inputs(e)[0])

    def _scale(self, e: ET.Element) -> Value:
        b, x = self._b, self._inputs(e)[0]
        low, high = (b.number(float(e.findtext(f"domain/{end}") or default)) for end, default in _DOMAIN)
        least, most = (b.number(float(e.findtext(f"range/{end}") or 0.0)) for end in ("min", "max"))
        if (e.findtext("zero_centered") or "").strip() in {"0", "false"}:
            share = b.emit(Op.DIV, b.emit(Op.SUB, x, low), b.emit(Op.SUB, high, low))
            out = b.emit(Op.ADD, least, b.emit(Op.MUL, share, b.emit(Op.SUB, most, least)))
        else:
            zero = b.number(0.0)
            up = b.emit(Op.MUL, b.emit(Op.DIV, x, high), most)
            down = b.emit(Op.MUL, b.emit(Op.DIV, x, low), least)
            out = b.emit(Op.SELECT, b.emit(Op.GT, x, zero), up, down)
            out = b.emit(Op.SELECT, b.emit(Op.EQ, x, zero), zero, out)
        return b.emit(Op.MUL, out, self.number_or_property(e.find("gain"), 1.0))

    def _summer(self, e: ET.Element) -> Value:
        b = self._b
        total, *rest = self._inputs(e)
        for value in rest:
            total = b.emit(Op.ADD, total, value)
        bias = e.findtext("bias")
        return b.emit(Op.ADD, total, b.number(float(bias))) if bias else total


_DOMAIN = (("min", "-1.0"), ("max", "1.0"))


def outputs(e: ET.Element) -> list[str]:
    """Return the properties that a component writes: its outputs, then the one of its own name."""
    names = [(x.text or "").strip() for x in e.findall("output")]
    own = re.sub(r"\s", "-", (e.get("name") or "").strip())
    return [*names, own if "/" in own else f"fcs/{own.lower()}"]
