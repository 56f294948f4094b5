"""One engine's place in a program: its levers, its properties, the air around it, and where its thrust acts."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from testbench.core.record import FloatArray
from testbench.flight.batch import registers as r
from testbench.flight.batch.functions import Functions
from testbench.flight.batch.program import Builder, Op, Untranslated, Value
from testbench.flight.batch.properties import Properties, plain
from testbench.flight.batch.units import convert, factor, triplet


class Mount:
    """An engine's place.

    Args:
        builder: of the program.
        properties: that engines read and write.
        functions: translates their functions and tables.
        number: of the engine, from 0.
        place: the ``thruster`` element.
    """

    def __init__(
        self, builder: Builder, properties: Properties, functions: Functions, number: int, place: ET.Element
    ) -> None:
        self._b, self._p, self._f, self.number, self.place = builder, properties, functions, number, place
        self.dt = self.core(r.DT)

    def term(self, x: float) -> Term:
        """Return a number of the model."""
        return Term(self._b, self._b.number(x))

    def core(self, register: int) -> Term:
        """Return what a register of the rigid body holds."""
        return Term(self._b, self._b.core(register))

    def lever(self, kind: str) -> Term:
        """Return the position of a lever: throttle, mixture, advance or feather."""
        return Term(self._b, self._p.read(f"fcs/{kind}-pos-norm[{self.number}]"))

    def get(self, what: str) -> Term:
        """Return a property of the engine; before it is set in a frame, that of the last one."""
        name = f"propulsion/engine[{self.number}]/{what}"
        self._p.declare(name)
        return Term(self._b, self._p.read(name))

    def set(self, what: str, value: Term) -> None:
        """Give a property of the engine a value."""
        name = f"propulsion/engine[{self.number}]/{what}"
        self._p.declare(name)
        self._p.write(name, value.value)

    def given(self, what: str, x: float) -> Term:
        """Return a number of the engine's file, or the property that holds it if the model itself moves that."""
        moved = self._p.moves(f"propulsion/engine[{self.number}]/{what}")
        return self.get(what) if moved else self.term(x)

    def hidden(self, what: str) -> Term:
        """Return a state that JSBSim has no property for, as the last frame left it."""
        return Term(self._b, self._b.read(self._hidden(what)))

    def hide(self, what: str, value: Term) -> None:
        """Keep such a state for the next frame."""
        self._b.write(self._hidden(what), value.value)

    def _hidden(self, what: str) -> str:
        return plain(f"batch/engine[{self.number}]/{what}")

    def functions(self, model: ET.Element, kind: str = "pre") -> Mapping[str, Term]:
        """Evaluate the functions of the engine's file; return them by the last word of their names."""
        out = {}
        for e in model.findall("function"):
            if (e.get("type") or "pre") == kind:
                out[(e.get("name") or "").rpartition("/")[2]] = Term(self._b, self._f.evaluate(e))
        return out

    def table(self, e: ET.Element, *keys: Term) -> Term:
        """Return what a table of the file gives."""
        return Term(self._b, self._f.looked_up(e, [k.value for k in keys]))

    def looked_up(self, e: ET.Element) -> Term:
        """Return what a table gives at the properties that it names."""
        return Term(self._b, self._f.table(e))

    def interpolated(self, points: Sequence[tuple[float, float]], key: Term) -> Term:
        """Return what a table of pairs gives that stands in no file."""
        keys, values = zip(*points, strict=True)
        table = self._b.table([float(len(points)), *keys, *values])
        return Term(self._b, self._b.emit(Op.TABLE_1, key.value, extra=table))

    def constant(self, x: float) -> Term:
        """Return a number that is the same in every model."""
        return Term(self._b, self._b.constant(x))

    def unmoved(self, *names: str) -> None:
        """Raise Untranslated if the model itself moves one of these properties."""
        for name in names:
            if self._p.moves(name.replace("#", str(self.number))):
                raise Untranslated(f"it writes {plain(name.replace('#', str(self.number)))}")

    @property
    def location(self) -> list[Term]:
        """Where the thruster is, in, structural axes; another model may have its thruster elsewhere.

        Not where the model itself moves it.
        """
        e = self.place.find("location")
        free = self.place.find("p_factor") is None and not any(map(self._p.moves, self._positions))
        if e is None or not free:
            return [self.term(x) for x in triplet(e, "IN")]
        out = []
        for axis in "xyz":
            at = e.find(axis)
            unit = "IN" if at is None else at.get("unit") or e.get("unit") or "IN"
            known = at if at is not None and (at.text or "").strip() else None
            x = self._b.number(convert(at, "IN", 0.0, e.get("unit")), known, factor(unit, "IN"))
            out.append(Term(self._b, x))
        return out

    @property
    def _positions(self) -> list[str]:
        return [f"propulsion/engine[{self.number}]/{axis}-position" for axis in "xyz"]

    def axes(self) -> list[list[Term]]:
        """Return the matrix (3, 3) that takes the axes of the thruster to the body's, a turned nozzle's included."""
        names = [f"propulsion/engine[{self.number}]/{axis}-angle-rad" for axis in ("pitch", "yaw")]
        if not any(map(self._p.moves, names)):
            return [[self.term(x) for x in row] for row in orientation(self.place)]
        if self.place.find("pointing") is not None:
            raise Untranslated("a thruster that points somewhere is turned")
        roll, pitch, yaw = map(self.term, angles(self.place))
        if self._p.moves(names[0]):
            pitch = self.get("pitch-angle-rad")
        if self._p.moves(names[1]):
            yaw = self.get("yaw-angle-rad")
        cosines, sines = ([angle.apply(op) for angle in (roll, pitch, yaw)] for op in (Op.COS, Op.SIN))
        return _matrix(cosines, sines)

    def push(
        self,
        thrust: Term,
        torque: Term | None = None,
        momentum: Term | None = None,
        at: list[Term] | None = None,
        axes: list[list[Term]] | None = None,
    ) -> None:
        """Add a thrust (lbf), and a torque (lbf ft) and an angular momentum (slug ft2/s) about its axis.

        Args:
            thrust: along the axis of the thruster.
            torque: none if it is left out.
            momentum: none if it is left out.
            at: where it acts (3,), in, structural axes; the place of the thruster if it is left out.
            axes: of the thruster, if they are known already.
        """
        zero, axes = self.term(0.0), axes or self.axes()
        values = [thrust, *(row[0] for row in axes), *(at or self.location), torque or zero, momentum or zero]
        self._b.stage(Op.THRUSTER, block=self._b.block([v.value for v in values]))


def angles(place: ET.Element) -> list[float]:
    """Return roll, pitch and yaw of a thruster, rad."""
    orient = place.find("orient")
    if orient is None:
        return [0.0, 0.0, 0.0]
    return [convert(orient.find(n), "RAD", 0.0, orient.get("unit")) for n in ("roll", "pitch", "yaw")]


def orientation(place: ET.Element) -> FloatArray:
    """Return the matrix (3, 3) that takes the axes of a thruster to the body's (FGForce::SetAnglesToBody)."""
    pointing = place.find("pointing")
    if pointing is not None:
        out = np.zeros((3, 3))
        out[:, 0] = [float(x.text or 0.0) for x in pointing]
        return out
    at = angles(place)
    return np.array(_matrix([math.cos(a) for a in at], [math.sin(a) for a in at]))


def _matrix(cosines: Sequence[Any], sines: Sequence[Any]) -> list[list[Any]]:
    """Return the matrix of roll, pitch and yaw, of numbers or terms."""
    (cr, cp, cy), (sr, sp, sy) = cosines, sines
    return [
        [cp * cy, sr * sp * cy - cr * sy, cr * cy * sp + sr * sy],
        [cp * sy, sr * sp * sy + cr * cy, cr * sy * sp - sr * cy],
        [-sp, sr * cp, cr * cp],
    ]


# --- formulas ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Term:
    """A value of a program, with arithmetic.

    Attributes:
        builder: of the program.
        value: what it stands for.
    """

    builder: Builder
    value: Value

    def _with(self, op: Op, other: Term | float) -> Term:
        return Term(self.builder, self.builder.emit(op, self.value, self._of(other).value))

    def _of(self, x: Term | float) -> Term:
        return x if isinstance(x, Term) else Term(self.builder, self.builder.constant(x))

    def __add__(self, other: Term | float) -> Term:
        return self._with(Op.ADD, other)

    def __radd__(self, other: float) -> Term:
        return self._of(other) + self

    def __sub__(self, other: Term | float) -> Term:
        return self._with(Op.SUB, other)

    def __rsub__(self, other: float) -> Term:
        return self._of(other) - self

    def __mul__(self, other: Term | float) -> Term:
        return self._with(Op.MUL, other)

    def __rmul__(self, other: float) -> Term:
        return self._of(other) * self

    def __truediv__(self, other: Term | float) -> Term:
        return self._with(Op.DIV, other)

    def __rtruediv__(self, other: float) -> Term:
        return self._of(other) / self

    def __pow__(self, other: Term | float) -> Term:
        return self._with(Op.POW, other)

    def __neg__(self) -> Term:
        return self.apply(Op.NEG)

    def __lt__(self, other: Term | float) -> Term:
        return self._with(Op.LT, other)

    def __le__(self, other: Term | float) -> Term:
        return self._with(Op.LE, other)

    def __gt__(self, other: Term | float) -> Term:
        return self._with(Op.GT, other)

    def __ge__(self, other: Term | float) -> Term:
        return self._with(Op.GE, other)

    def __and__(self, other: Term) -> Term:
        return self._with(Op.AND, other)

    def equals(self, other: Term | float) -> Term:
        """Return 1 where both are equal, else 0."""
        return self._with(Op.EQ, other)

    def apply(self, op: Op) -> Term:
        """Return the result of an operation on this term alone."""
        return Term(self.builder, self.builder.emit(op, self.value))

    def at_most(self, other: Term | float) -> Term:
        """Return the lesser of both."""
        return self._with(Op.MIN, other)

    def at_least(self, other: Term | float) -> Term:
        """Return the greater of both."""
        return self._with(Op.MAX, other)

    def then(self, yes: Term | float, no: Term | float) -> Term:
        """Return ``yes`` where this condition holds (is 1), else ``no``."""
        return Term(self.builder, self.builder.emit(Op.SELECT, self.value, self._of(yes).value, self._of(no).value))

    def bounded(self, low: Term | float, high: Term | float) -> Term:
        """Return this term between two bounds; the lower one where both are broken, as ``if .. else if`` does."""
        return (self < low).then(low, (self > high).then(high, self))

    def seek(self, target: Term, up: Term | float, down: Term | float, dt: Term) -> Term:
        """Return this term moved towards a target, at no more than a rate each way (FGTurbine::Seek)."""
        lower = (self - dt * down).at_least(target)
        higher = (self + dt * up).at_most(target)
        return (self > target).then(lower, (self < target).then(higher, self))
