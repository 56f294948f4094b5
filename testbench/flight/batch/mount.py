"""One engine's place in a program: its levers, its properties, the air around it, and where its thrust acts."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
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
        self.b, self.f, self._p, self.number, self.place = builder, functions, properties, number, place
        self.dt = builder.core(r.DT)

    def lever(self, kind: str) -> Value:
        """Return the position of a lever: throttle, mixture, advance or feather."""
        return self._p.read(f"fcs/{kind}-pos-norm[{self.number}]")

    def get(self, what: str) -> Value:
        """Return a property of the engine; before it is set in a frame, that of the last one."""
        name = f"propulsion/engine[{self.number}]/{what}"
        self._p.declare(name)
        return self._p.read(name)

    def set(self, what: str, value: Value) -> None:
        """Give a property of the engine a value."""
        name = f"propulsion/engine[{self.number}]/{what}"
        self._p.declare(name)
        self._p.write(name, value)

    def given(self, what: str, x: float) -> Value:
        """Return a number of the engine's file, or the property that holds it if the model itself moves that."""
        moved = self._p.moves(f"propulsion/engine[{self.number}]/{what}")
        return self.get(what) if moved else self.b.number(x)

    def hidden(self, what: str) -> Value:
        """Return a state that JSBSim has no property for, as the last frame left it."""
        return self.b.read(plain(f"batch/engine[{self.number}]/{what}"))

    def hide(self, what: str, value: Value) -> None:
        """Keep such a state for the next frame."""
        self.b.write(plain(f"batch/engine[{self.number}]/{what}"), value)

    def functions(self, model: ET.Element, kind: str = "pre") -> Mapping[str, Value]:
        """Evaluate the functions of the engine's file; return them by the last word of their names."""
        own = [e for e in model.findall("function") if (e.get("type") or "pre") == kind]
        return {(e.get("name") or "").rpartition("/")[2]: self.f.evaluate(e) for e in own}

    def unmoved(self, *names: str) -> None:
        """Raise Untranslated if the model itself moves one of these properties."""
        for name in (name.replace("#", str(self.number)) for name in names):
            if self._p.moves(name):
                raise Untranslated(f"it writes {plain(name)}")

    @property
    def location(self) -> list[Value]:
        """Where the thruster is, in, structural axes; another model may have its thruster elsewhere.

        Not where the model itself moves it.
        """
        e = self.place.find("location")
        free = self.place.find("p_factor") is None and not any(map(self._p.moves, self._positions))
        if e is None or not free:
            return [self.b.number(x) for x in triplet(e, "IN")]
        out = []
        for axis in "xyz":
            at = e.find(axis)
            unit = "IN" if at is None else at.get("unit") or e.get("unit") or "IN"
            known = at if at is not None and (at.text or "").strip() else None
            out.append(self.b.number(convert(at, "IN", 0.0, e.get("unit")), known, factor(unit, "IN")))
        return out

    @property
    def _positions(self) -> list[str]:
        return [f"propulsion/engine[{self.number}]/{axis}-position" for axis in "xyz"]

    def axes(self) -> list[list[Value]]:
        """Return the matrix (3, 3) that takes the axes of the thruster to the body's, a turned nozzle's included."""
        names = [f"propulsion/engine[{self.number}]/{axis}-angle-rad" for axis in ("pitch", "yaw")]
        if not any(map(self._p.moves, names)):
            return [[self.b.number(x) for x in row] for row in orientation(self.place)]
        if self.place.find("pointing") is not None:
            raise Untranslated("a thruster that points somewhere is turned")
        roll, pitch, yaw = map(self.b.number, angles(self.place))
        if self._p.moves(names[0]):
            pitch = self.get("pitch-angle-rad")
        if self._p.moves(names[1]):
            yaw = self.get("yaw-angle-rad")
        cosines, sines = ([angle.do(op) for angle in (roll, pitch, yaw)] for op in (Op.COS, Op.SIN))
        return _matrix(cosines, sines)

    def push(
        self,
        thrust: Value,
        torque: Value | None = None,
        momentum: Value | None = None,
        at: list[Value] | None = None,
        axes: list[list[Value]] | None = None,
    ) -> None:
        """Add a thrust (lbf), and a torque (lbf ft) and an angular momentum (slug ft2/s) about its axis.

        Args:
            thrust: along the axis of the thruster.
            torque: none if it is left out.
            momentum: none if it is left out.
            at: where it acts (3,), in, structural axes; the place of the thruster if it is left out.
            axes: of the thruster, if they are known already.
        """
        zero, axes = self.b.constant(0.0), axes or self.axes()
        values = [thrust, *(row[0] for row in axes), *(at or self.location), torque or zero, momentum or zero]
        self.b.stage(Op.THRUSTER, block=self.b.block(values))


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
    """Return the matrix of roll, pitch and yaw, of numbers or values."""
    (cr, cp, cy), (sr, sp, sy) = cosines, sines
    return [
        [cp * cy, sr * sp * cy - cr * sy, cr * cy * sp + sr * sy],
        [cp * sy, sr * sp * sy + cr * cy, cr * sy * sp - sr * cy],
        [-sp, sr * cp, cr * cp],
    ]
