"""A JSBSim model as a program: the stages of a frame in JSBSim's order, with what the model adds to each.

Propagate, Inertial, Atmosphere and Winds; Systems; MassBalance; Auxiliary; Propulsion; Aerodynamics; GroundReactions;
ExternalReactions; Aircraft; Accelerations (source of FGFDMExec, JSBSim 1.3.3). A stage reads what stages before it have
left in this frame, and what those after it left in the last.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np

from testbench.flight.batch import registers as r
from testbench.flight.batch.components import Components
from testbench.flight.batch.engines import Engines
from testbench.flight.batch.forces import AXIAL_NORMAL, BODY, INERTIAL, LOCAL, STABILITY, WIND_AXES
from testbench.flight.batch.functions import Functions
from testbench.flight.batch.program import Builder, Op, Program, Untranslated
from testbench.flight.batch.properties import (
    AIR_DATA,
    ALTITUDES,
    EULER,
    EULER_RATES,
    GEOGRAPHY,
    PITOT,
    Properties,
    plain,
)
from testbench.flight.batch.units import convert, triplet

_FORCE_AXES = {
    "LIFT": 2, "DRAG": 0, "SIDE": 1, "X": 0, "Y": 1, "Z": 2, "AXIAL": 0, "NORMAL": 2,
}  # fmt: skip
_MOMENT_AXES = {"ROLL": 0, "PITCH": 1, "YAW": 2}
_FRAMES = {"BODY": BODY, "WIND": WIND_AXES, "LOCAL": LOCAL, "INERTIAL": INERTIAL}
_COPIED = ("throttle", "mixture", "advance", "feather")


@dataclass(frozen=True)
class Translation:
    """A model's program, and the numbers that stand in the model."""

    program: Program  # what is run
    numbers: tuple[float, ...]  # of the model, in the program's order
    declared: Mapping[str, float]  # property -> value that the model declares
    components: frozenset[str]  # properties that components write, and what they remember
    # (number, element whose text it is, what it is multiplied by) of those that another model may have otherwise
    places: tuple[tuple[int, ET.Element, float], ...]


def translate(
    tree: ET.Element,
    engine_files: Mapping[str, str],
    dt_s: float,
    inputs: Sequence[str],
    logged: Sequence[str],
    frozen: bool = False,
) -> Translation:
    """Translate a model as JSBSim loads it.

    Args:
        tree: the ``fdm_config`` element, every file that it includes put in.
        engine_files: name -> text of the files of engines and thrusters.
        dt_s: frame time.
        inputs: properties that are written before each frame.
        logged: properties that are read.
        frozen: whether fuel stays, and mass with it.

    Raises:
        Untranslated: it holds something that the batch does not fly.
    """
    return _Model(tree, engine_files, dt_s, inputs, frozen).translated(logged)


class _Model:
    def __init__(
        self, tree: ET.Element, engine_files: Mapping[str, str], dt_s: float, inputs: Sequence[str], frozen: bool
    ) -> None:
        self._tree = tree
        self._b = Builder(frozenset(plain(n) for n in inputs))
        self._p = Properties(self._b)
        self._f = Functions(self._b, self._p)
        switchable = frozenset(plain(x) for x in (*inputs, *_words(tree)) if _FAILURE.fullmatch(x))
        self._components = Components(self._b, self._p, self._f, dt_s, switchable)
        self._engine_files = engine_files
        self._engines = Engines(self._b, self._p, self._f, engine_files, frozen)
        self._declared: dict[str, float] = {}
        self._moved: frozenset[str] = frozenset()
        self._sections = [
            *tree.findall("system"), *tree.findall("autopilot"), *tree.findall("flight_control"),
        ]  # fmt: skip

    def translated(self, logged: Sequence[str]) -> Translation:
        tree, b = self._tree, self._b
        for section in tree.iter():
            if section.tag in {"system", "autopilot", "flight_control", "aerodynamics", "propulsion",
                               "external_reactions", "mass_balance", "ground_reactions"}:  # fmt: skip
                if section.get("file"):
                    raise Untranslated(f"<{section.tag}> is in a file of its own")
                for name, value in declared(section).items():
                    self._declared[name] = value
                    self._p.declared(name)
        for e in tree.iter():
            self._p.declared((e.text or "") if e.tag == "output" else e.get("name") or "")
        self._engines.declare(tree.find("propulsion"))
        self._p.declare("aero/stall-hyst-norm")
        read = self._read()
        b.stage(Op.PROPAGATE)
        needed = read | ({plain(n) for n in logged} & EULER_RATES.keys())  # which are of this frame's angles
        for op, names in ((Op.EULER, EULER.keys() | EULER_RATES.keys()), (Op.GEOGRAPHY, GEOGRAPHY.keys()),
                          (Op.ALTITUDES, ALTITUDES.keys())):  # fmt: skip
            if needed & names:
                b.stage(op)
        self._systems()
        self._functions([*tree.findall("mass_balance")])
        b.stage(Op.AUXILIARY)
        read |= self._engines.breathed(tree.find("propulsion"))
        wanted = read | {plain(n) for n in logged}
        for op, names in ((Op.EULER_RATES, EULER_RATES.keys()), (Op.AIR_DATA, AIR_DATA.keys()),
                          (Op.PITOT, PITOT.keys())):  # fmt: skip
            if wanted & names:
                b.stage(op)
        propulsion = tree.find("propulsion")
        self._functions([propulsion] if propulsion is not None else [])
        self._engines.add(propulsion)
        self._aerodynamics()
        self._functions(tree.findall("ground_reactions"))
        self._reactions()
        if tree.find("buoyant_forces") is not None and len(tree.find("buoyant_forces") or ()):
            raise Untranslated("it has buoyant forces")
        b.stage(Op.ACCELERATE)
        b.begin_log()
        for op, names in ((Op.EULER, EULER.keys()), (Op.GEOGRAPHY, GEOGRAPHY.keys())):
            if wanted & names and not read & names:
                b.stage(op)
        for name in logged:
            b.log(name, self._p.read(name))
        return Translation(b.build(), tuple(b.numbers), self._declared, self._moved, tuple(b.places))

    def _read(self) -> set[str]:
        """Return every word of the model, its engines' files included, that may be a property that something reads."""
        trees = [self._tree, *map(ET.fromstring, self._engine_files.values())]
        return {plain(word.lstrip("-")) for tree in trees for word in _words(tree)}

    def _functions(self, sections: Sequence[ET.Element], kind: str = "pre") -> None:
        """Evaluate the functions that stand by themselves in sections of the model."""
        for section in sections:
            for e in section.findall("function"):
                if (e.get("type") or "pre") == kind:
                    self._f.evaluate(e)

    def _systems(self) -> None:
        p = self._p
        self._functions(self._sections)
        count = len(self._tree.findall("propulsion/engine"))
        for kind in _COPIED:
            for i in range(count):
                index = f"[{i}]" if i else ""
                p.write(f"fcs/{kind}-pos-norm{index}", p.read(f"fcs/{kind}-cmd-norm{index}"))
        before = dict(self._b.present)
        for section in self._sections:
            for channel in section.findall("channel"):
                self._components.channel(channel)
        self._components.end()
        self._moved = frozenset(n for n, v in self._b.present.items() if before.get(n) is not v)
        self._functions(self._sections, "post")

    def _aerodynamics(self) -> None:
        b = self._b
        sections = self._tree.findall("aerodynamics")
        self._functions(sections)
        b.stage(Op.MOTION_NUMBERS)
        self._stall(self._tree.find("aerodynamics/hysteresis_limits"))
        forces, moments = BODY, BODY
        sums: dict[int, list[ET.Element]] = {}
        for axis in (a for s in sections for a in s.findall("axis")):
            name, frame = (axis.get("name") or "").strip(), (axis.get("frame") or "").strip()
            if name in _MOMENT_AXES:
                if frame in {"STABILITY", "WIND"}:
                    moments = STABILITY if frame == "STABILITY" else WIND_AXES
            elif name in {"LIFT", "DRAG"}:
                forces = WIND_AXES
            elif name in {"AXIAL", "NORMAL"}:
                forces = AXIAL_NORMAL
            elif name in {"X", "Y", "Z"} and frame in {"STABILITY", "WIND"}:
                forces = STABILITY if frame == "STABILITY" else WIND_AXES
            for e in axis.findall("function"):
                at_cg = (e.get("apply_at_cg") or "") == "true"
                if name in _MOMENT_AXES:
                    register = r.NATIVE_MOMENT + _MOMENT_AXES[name]
                elif name in _FORCE_AXES:
                    register = (r.NATIVE_AT_CG if at_cg else r.NATIVE) + _FORCE_AXES[name]
                else:
                    raise Untranslated(f"it has the axis {name}")
                sums.setdefault(register, []).append(e)
        order = [r.NATIVE + i for i in range(3)], [r.NATIVE_MOMENT + i for i in range(3)]
        for i, register in enumerate(order[0]):
            self._sum(register, sums.get(register, []))
            self._sum(r.NATIVE_AT_CG + i, sums.get(r.NATIVE_AT_CG + i, []))
        shift = self._tree.find("aerodynamics/aero_ref_pt_shift_x/function")
        b.store(r.REFERENCE_SHIFT, self._f.value(shift) if shift is not None else b.constant(0.0))
        for register in order[1]:
            self._sum(register, sums.get(register, []))
        b.stage(Op.AERODYNAMICS, forces, moments)
        self._functions(sections, "post")

    def _stall(self, limits: ET.Element | None) -> None:
        """Set the memory of a stall, which begins above one angle of attack and ends below another."""
        if limits is None:
            return
        b, name, unit = self._b, "aero/stall-hyst-norm", limits.get("unit")
        low, high = (b.number(convert(limits.find(end), "RAD", 0.0, unit)) for end in ("min", "max"))
        alpha = b.core(r.ALPHA)
        stalled = (alpha > high).then(1.0, (alpha < low).then(0.0, b.read(name)))
        b.write(name, (low.differs(0.0) & high.differs(0.0)).then(stalled, 0.0))

    def _sum(self, register: int, functions: Sequence[ET.Element]) -> None:
        """Store the sum of the functions of an axis, and give each its property."""
        values = [self._f.evaluate(e) for e in functions]
        self._b.store(register, reduce(add, values) if values else self._b.constant(0.0))

    def _reactions(self) -> None:
        b = self._b
        b.stage(Op.CLEAR, block=r.ADDED_FORCE)
        sections = self._tree.findall("external_reactions")
        self._functions(sections)
        for e in (x for s in sections for x in s):
            if e.tag not in {"force", "moment"}:
                continue
            name, function = (e.get("name") or "").strip(), e.find("function")
            if function is not None:
                size = self._f.value(function)
            else:
                word = "magnitude" if e.tag == "force" else "magnitude-lbsft"
                size = self._p.read(f"external_reactions/{name}/{word}")
            frame = (e.get("frame") or "BODY").strip()
            if frame not in _FRAMES:
                raise Untranslated(f"external reaction {name} is in the frame {frame}")
            direction = np.array(triplet(e.find("direction"), "IN"))
            length = float(np.linalg.norm(direction))
            direction = direction / length if length > 0.0 else direction
            numbers = [*map(b.number, direction), *map(b.number, triplet(e.find("location"), "IN"))]
            b.stage(Op.REACTION, _FRAMES[frame], int(e.tag == "moment"), block=b.block([size, *numbers]))


_FAILURE = re.compile(r"[^\s/]\S*/malfunction/fail_\w+")


def _words(tree: ET.Element) -> Iterator[str]:
    """Yield every word in a model's texts and attributes, tables left out."""
    for e in tree.iter():
        if e.tag != "tableData":
            for text in (e.text, e.tail, *e.attrib.values()):
                yield from (text or "").split()


def declared(section: ET.Element) -> dict[str, float]:
    """Return the properties that a section of a model declares, and their values."""
    return {plain(e.text or ""): float(e.get("value") or 0.0) for e in section.findall("property")}
