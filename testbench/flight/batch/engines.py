"""Engines and thrusters as operations (FGPropulsion and what it drives)."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping

import numpy as np

from testbench.core.record import FloatArray
from testbench.flight.batch import registers as r
from testbench.flight.batch.functions import Functions
from testbench.flight.batch.program import Builder, Op, Untranslated, Value
from testbench.flight.batch.properties import Properties
from testbench.flight.batch.units import convert, triplet

_FT_LBF_S = 550.0  # of a horsepower


class Engines:
    """Translates the propulsion of a model into a program.

    Args:
        builder: of the program.
        properties: that engines read and write.
        functions: translates their tables.
        files: name -> text of each file of an engine or thruster.
    """

    def __init__(
        self, builder: Builder, properties: Properties, functions: Functions, files: Mapping[str, str]
    ) -> None:
        self._b, self._p, self._f = builder, properties, functions
        self._files = {name.removesuffix(".xml").lower(): text for name, text in files.items()}

    def add(self, propulsion: ET.Element | None) -> None:
        """Translate all engines, in the place of the frame where JSBSim runs them.

        Raises:
            Untranslated: an engine or a thruster is of a kind that is not translated.
        """
        self._b.stage(Op.CLEAR, block=r.ENGINE_FORCE)
        for i, engine in enumerate(propulsion.findall("engine") if propulsion is not None else ()):
            self._engine(i, engine)

    def _engine(self, i: int, e: ET.Element) -> None:
        place = e.find("thruster")
        if place is None:
            raise Untranslated("an engine has no thruster")
        model, thruster = self._read(e), self._read(place)
        if model.tag != "electric_engine":
            raise Untranslated(f"it has a <{model.tag}>")
        if thruster.tag != "direct":
            raise Untranslated(f"it has a <{thruster.tag}>")
        self._thrust(i, place, self._electric(i, model))

    def _read(self, e: ET.Element) -> ET.Element:
        """Return the root of the file that an element names, or what stands in the element itself."""
        name = (e.get("file") or "").removesuffix(".xml").lower()
        if name in self._files:
            return ET.fromstring(self._files[name])
        inside = [x for x in e if x.tag not in {"location", "orient", "feed", "thruster", "sense", "p_factor"}]
        if not inside:
            raise Untranslated(f"the file {e.get('file')} of an engine is not among those read")
        return inside[0]

    def _electric(self, i: int, model: ET.Element) -> Value:
        """Return the power of an electric motor, ft lbf/s (FGElectric)."""
        b = self._b
        watts = b.number(convert(model.find("power"), "WATTS", 745.7))
        throttle = self._p.read(f"fcs/throttle-pos-norm[{i}]")
        horsepower = b.emit(Op.DIV, b.emit(Op.MUL, watts, throttle), b.number(745.7))
        self._write(i, "power-hp", horsepower)
        power = b.emit(Op.MUL, horsepower, b.number(_FT_LBF_S))
        return b.emit(Op.MAX, power, b.number(0.0))  # as long as nothing turns, a negative one is none

    def _write(self, i: int, what: str, value: Value) -> None:
        name = f"propulsion/engine[{i}]/{what}"
        self._p.declare(name)
        self._p.write(name, value)

    def _thrust(self, i: int, place: ET.Element, thrust: Value) -> None:
        """Add a thrust (lbf) along the axis of a thruster."""
        b = self._b
        self._write(i, "thrust-lbs", thrust)
        axis = orientation(place)[:, 0]
        numbers = [*map(b.number, axis), *map(b.number, triplet(place.find("location"), "IN"))]
        b.stage(Op.THRUSTER, block=b.block([thrust, *numbers]))


def orientation(place: ET.Element) -> FloatArray:
    """Return the matrix (3, 3) that takes the axes of a thruster to the body's (FGForce::SetAnglesToBody)."""
    pointing = place.find("pointing")
    if pointing is not None:
        out = np.zeros((3, 3))
        out[:, 0] = [float(x.text or 0.0) for x in pointing]
        return out
    orient = place.find("orient")
    roll, pitch, yaw = (convert(orient.find(n), "RAD", 0.0, orient.get("unit")) if orient is not None else 0.0
                        for n in ("roll", "pitch", "yaw"))  # fmt: skip
    cp, sp, cr, sr = math.cos(pitch), math.sin(pitch), math.cos(roll), math.sin(roll)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cp * cy, sr * sp * cy - cr * sy, cr * cy * sp + sr * sy],
            [cp * sy, sr * sp * sy + cr * cy, cr * sy * sp - sr * cy],
            [-sp, sr * cp, cr * cp],
        ]
    )
