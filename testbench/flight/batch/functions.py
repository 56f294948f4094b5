"""JSBSim's functions and tables as operations (FGFunction, FGTable)."""

from __future__ import annotations

import itertools
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from functools import reduce

import numpy as np

from testbench.flight.batch.program import Builder, Op, Untranslated, Value
from testbench.flight.batch.properties import Properties

_ONE = {
    "sqrt": Op.SQRT, "exp": Op.EXP, "ln": Op.LN, "log2": Op.LOG2, "log10": Op.LOG10, "abs": Op.ABS, "sin": Op.SIN,
    "cos": Op.COS, "tan": Op.TAN, "asin": Op.ASIN, "acos": Op.ACOS, "atan": Op.ATAN, "sign": Op.SIGN,
    "floor": Op.FLOOR, "ceil": Op.CEIL, "fraction": Op.FRACTION, "integer": Op.INTEGER, "not": Op.NOT,
}  # fmt: skip
_TWO = {
    "quotient": Op.QUOTIENT, "pow": Op.POW, "fmod": Op.FMOD, "mod": Op.MOD, "atan2": Op.ATAN2, "lt": Op.LT,
    "le": Op.LE, "gt": Op.GT, "ge": Op.GE, "eq": Op.EQ, "nq": Op.NE,
}  # fmt: skip
_MANY = {
    "sum": Op.ADD, "product": Op.MUL, "difference": Op.SUB, "min": Op.MIN, "max": Op.MAX, "and": Op.AND, "or": Op.OR,
}  # fmt: skip
_SKIPPED = {"description", "documentation"}


class Functions:
    """Translates functions into a program.

    Args:
        builder: of the program.
        properties: that they read.
    """

    def __init__(self, builder: Builder, properties: Properties) -> None:
        self._b, self._p = builder, properties

    def value(self, element: ET.Element) -> Value:
        """Return the value of a <function>: that of the first element in it.

        Raises:
            Untranslated: it holds something that is not translated.
        """
        inside = [e for e in element if e.tag not in _SKIPPED]
        if not inside:
            raise Untranslated(f"function {element.get('name')} is empty")
        return self._element(inside[0])

    def evaluate(self, element: ET.Element) -> Value:
        """Return the value of a <function> and give it to the properties that bear its names.

        It is unknown if it holds something that is not translated.
        """
        try:
            value = self.value(element)
        except Untranslated as missing:
            value = self._b.unknown(str(missing))
        for name in (element.get("name"), element.get("copyto")):
            if name and "/" in name:
                self._p.declare(name)
                self._p.write(name, value)
        return value

    def _element(self, e: ET.Element) -> Value:
        b, tag = self._b, e.tag
        if tag in {"property", "p"}:
            if e.get("apply"):
                raise Untranslated("a template function is applied")
            return self._p.read(e.text or "")
        if tag in {"value", "v"}:
            return b.number(float(e.text or "nan"), e)
        if tag == "pi":
            return b.number(math.pi)
        if tag in {"table", "t"}:
            return self.table(e)
        if e.get("name"):
            self._p.hide(e.get("name") or "")
        inside = [self._element(x) for x in e if x.tag not in _SKIPPED]
        if tag in _ONE:
            return b.emit(_ONE[tag], inside[0])
        if tag in _TWO:
            return b.emit(_TWO[tag], inside[0], inside[1])
        if tag in _MANY:
            return self._many(_MANY[tag], inside)
        if tag == "avg":
            return self._many(Op.ADD, inside) / len(inside)
        if tag in {"toradians", "todegrees"}:
            first, second = (math.pi, 180.0) if tag == "toradians" else (180.0, math.pi)
            return inside[0] * first / second
        if tag == "roundmultiple":
            if len(inside) == 1:
                return inside[0].do(Op.ROUND)
            return (inside[0] / inside[1]).do(Op.ROUND) * inside[1]
        if tag == "ifthen":
            return inside[0].then(inside[1], inside[2])
        if tag == "switch":
            return self._switch(inside)
        if tag == "interpolate1d":
            return self._interpolate(inside)
        raise Untranslated(f"it has the function <{tag}>")

    def _many(self, op: Op, values: Sequence[Value]) -> Value:
        """Return the values taken together, from the first to the last as JSBSim does.

        Its sums begin with zero: one of nothing but negative zeros is positive there, and negative here.
        """
        return reduce(lambda total, value: total.do(op, value), values)

    def _switch(self, values: Sequence[Value]) -> Value:
        """Return the value that the first one, rounded, counts off; NaN out of range, where JSBSim stops."""
        out = nothing = self._b.constant(math.nan)
        for i in range(len(values) - 2, -1, -1):
            out = (values[0] + 0.5 < i + 1.0).then(values[i + 1], out)
        return (values[0] < 0.0).then(nothing, out)

    def _interpolate(self, values: Sequence[Value]) -> Value:
        """Return the linear interpolation between points that are values themselves."""
        x = values[0]
        points = [(values[i], values[i + 1]) for i in range(1, len(values) - 1, 2)]
        out = points[-1][1]
        for (x0, y0), (x1, y1) in reversed(list(itertools.pairwise(points))):
            between = y0 + (x - x0) * (y1 - y0) / (x1 - x0)
            above = x.equals(x1).then(y1, out)  # its end has not to be finite
            out = (x < x1).then(between, above)
        return (x <= points[0][0]).then(points[0][1], out)

    def table(self, e: ET.Element) -> Value:
        """Return what a table gives at the properties that it is looked up by.

        Raises:
            Untranslated: it has more than three dimensions.
        """
        if e.get("name"):
            self._p.hide(e.get("name") or "")
        by = {}
        for axis in e.findall("independentVar"):
            by[_AXES.get((axis.get("lookup") or "row").strip(), -1)] = self._p.read(axis.text or "")
        if -1 in by or sorted(by) != list(range(len(by))) or not by:
            raise Untranslated("a table is looked up by axes that are not translated")
        return self.looked_up(e, [by[i] for i in range(len(by))])

    def looked_up(self, e: ET.Element, keys: Sequence[Value]) -> Value:
        """Return what the table of an element gives at given values."""
        b, data = self._b, e.findall("tableData")
        if len(keys) == 3:
            planes = sorted((float(d.get("breakPoint") or "nan"), _grid(d)) for d in data)
            head = [float(len(planes)), *(key for key, _ in planes)]
            blocks, at = [], len(head) + len(planes)
            for _, grid in planes:
                head.append(float(at))
                blocks.append(grid)
                at += len(grid)
            return b.emit(Op.TABLE_3, *keys, extra=b.table([*head, *(x for g in blocks for x in g)]))
        if len(keys) == 2:
            return b.emit(Op.TABLE_2, *keys, extra=b.table(_grid(data[0])))
        numbers = np.array((data[0].text or "").split(), float)
        if numbers.size % 2:
            raise Untranslated("a table of one dimension has an odd number of numbers")
        return self.interpolated(numbers.reshape(-1, 2), keys[0])

    def interpolated(self, points: Iterable[Iterable[float]], key: Value) -> Value:
        """Return what a table of pairs gives."""
        xs, ys = zip(*points, strict=True)
        return self._b.emit(Op.TABLE_1, key, extra=self._b.table([float(len(xs)), *xs, *ys]))


_AXES = {"row": 0, "axis1": 0, "column": 1, "axis2": 1, "table": 2, "axis3": 2}


def _grid(data: ET.Element) -> list[float]:
    """Return a table of two dimensions as numbers: rows, columns, keys of rows, keys of columns, values."""
    lines = [line.split() for line in (data.text or "").splitlines() if line.strip()]
    columns = [float(x) for x in lines[0]]
    rows = np.array(lines[1:], float)
    if rows.ndim != 2 or rows.shape[1] != len(columns) + 1:
        raise Untranslated("a table of two dimensions has lines of other lengths")
    return [float(len(rows)), float(len(columns)), *rows[:, 0], *columns, *rows[:, 1:].ravel()]
