"""An aircraft ready to be flown in batches: its program, and the registers that a flight begins with."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from testbench.aircraft import Aircraft
from testbench.core.constants import FT_M
from testbench.core.record import FloatArray
from testbench.flight.batch import registers as r
from testbench.flight.batch.machine import aligned, on_ground
from testbench.flight.batch.program import Program, Untranslated
from testbench.flight.batch.properties import CORE, ON_GROUND, plain
from testbench.flight.batch.scope import MEMORY
from testbench.flight.batch.translate import Translation, declared, translate
from testbench.flight.batch.units import convert, triplet
from testbench.flight.batch.vector import LANES
from testbench.flight.condition import FlightCondition
from testbench.flight.executive import Executive, model_key
from testbench.flight.start import Beginning

_LB_SLUG = 1.0 / 32.174049
_IN_FT = 1.0 / 12.0
_TURN = np.array([-1.0, 1.0, -1.0])  # from structural axes (aft, right, up) to the body's


@dataclass(frozen=True, eq=False)
class Weights:
    """What a body weighs and how it is spread."""

    weight: float  # lbf
    cg: FloatArray  # (3,) in, structural axes
    inertia: FloatArray  # (3, 3) about the centre of gravity, body axes, slug ft2, as JSBSim's matrix has it

    def about_origin(self) -> FloatArray:
        """Return the inertia (3, 3) about the origin of the structural axes, body axes."""
        return self.inertia + _parallel(self.weight, self.cg)

    def with_empty(self, before: Weights, after: Weights) -> Weights:
        """Return this body after its dry part, ``before``, has been replaced by ``after``; fuel stays as it is."""
        weight = self.weight - before.weight + after.weight
        moment = self.weight * self.cg - before.weight * before.cg + after.weight * after.cg
        origin = self.about_origin() - before.about_origin() + after.about_origin()
        cg = moment / weight
        return Weights(weight, cg, origin - _parallel(weight, cg))


def _parallel(weight: float, at_in: FloatArray) -> FloatArray:
    """Return the inertia (3, 3) of a point about the origin, body axes."""
    x = _TURN * at_in * _IN_FT
    return _LB_SLUG * weight * (x @ x * np.eye(3) - np.outer(x, x))


def dry(tree: ET.Element) -> Weights:
    """Return the empty aircraft with its point masses.

    Raises:
        Untranslated: a point mass has a shape of its own, or a unit is not known.
    """
    balance = tree.find("mass_balance")
    if balance is None:
        raise Untranslated("it has no mass balance")
    sign = 1.0 if balance.get("negated_crossproduct_inertia") == "false" else -1.0
    given = {n: convert(balance.find(n), "SLUG*FT2", 0.0) for n in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")}
    J = np.array(
        [
            [given["ixx"], sign * given["ixy"], -sign * given["ixz"]],
            [sign * given["ixy"], given["iyy"], sign * given["iyz"]],
            [-sign * given["ixz"], sign * given["iyz"], given["izz"]],
        ]
    )
    empty = convert(balance.find("emptywt"), "LBS", 0.0)
    at = next((triplet(e, "IN") for e in balance.findall("location") if e.get("name") == "CG"), [0.0, 0.0, 0.0])
    points = [(empty, np.array(at))]
    for e in balance.findall("pointmass"):
        if e.find("form") is not None:
            raise Untranslated("a point mass has a shape")
        points.append((convert(e.find("weight"), "LBS", 0.0), np.array(triplet(e.find("location"), "IN"))))
    weight = sum(w for w, _ in points)
    if not weight > 0.0:
        raise Untranslated("it weighs nothing without fuel")
    cg = np.sum([w * x for w, x in points], axis=0) / weight
    origin = J + np.sum([_parallel(w, x) for w, x in points], axis=0)
    return Weights(float(weight), cg, origin - _parallel(weight, cg))


_LEVERS = re.compile(r"fcs/(mixture|advance|feather)-cmd-norm(\[\d+\])?")
_SETTLED = ("/propeller-rpm", "/map-pa")
_EARTH_ANGLE = "position/epa-rad"
_FIXED = ("metrics/",)
_OWN = ("gear/", "propulsion/")  # JSBSim's own, which it does not begin with zero
# JSBSim's properties give Ixz with the sign that it has in the matrix, the other two products with the opposite one.
_INERTIA = (("xx", 0, 0, 1.0), ("yy", 1, 1, 1.0), ("zz", 2, 2, 1.0), ("xy", 0, 1, -1.0), ("xz", 0, 2, 1.0),
            ("yz", 1, 2, -1.0))  # fmt: skip
_SECTIONS = {"system", "autopilot", "flight_control", "aerodynamics", "propulsion", "external_reactions",
             "mass_balance", "ground_reactions"}  # fmt: skip
_CLEARANCE = 3.0  # spans above the ground, below which wheels might touch it
TOP_FT = 100000.0


@dataclass(frozen=True, eq=False)
class BatchModel:
    """A translated aircraft."""

    aircraft: Aircraft  # what it is
    rate_hz: float  # frame rate
    program: Program  # what is computed in a frame
    start: FloatArray  # (registers,) at rest, before the aircraft is placed
    channels: tuple[str, ...]  # those of the simulator, in its order
    factors: FloatArray  # of each channel to SI
    iterations: int  # evaluations until a placed aircraft is at rest
    shape: _Shape  # what another model must have in common with it, to fly by the same program
    weights: Weights  # as flown
    dry: Weights | None  # without fuel; None if only JSBSim can tell
    translation: Translation  # of its tree
    memories: npt.NDArray[np.int64]  # registers of what components of the control system remember
    outputs: Mapping[int, float]  # registers of what they write -> value before the first frame
    # height (m) and speed (m/s) of the evaluations that JSBSim makes when the model is loaded
    loading: tuple[tuple[float, float], ...]

    @property
    def commands(self) -> dict[str, int]:
        """Control -> register of its command."""
        found = self.program.properties
        return {n: found[plain(c.command)] for n, c in self.aircraft.controls.items() if plain(c.command) in found}

    @property
    def settles(self) -> bool:
        """Whether engines have states of their own, which JSBSim brings to rest before a flight."""
        return any(n.endswith(_SETTLED) for n in self.program.properties)

    @property
    def floor_ft(self) -> float:
        """Height above the ground below which JSBSim flies: a model may have wheels, which the batch has not."""
        return _CLEARANCE * float(self.start[r.WING_SPAN])


def batch_model(
    aircraft: Aircraft, rate_hz: float, condition: FlightCondition, watched: Sequence[str] = ()
) -> BatchModel:
    """Translate an aircraft.

    Args:
        aircraft: what flies.
        rate_hz: frame rate.
        condition: design condition of the elastic equations.
        watched: properties that are logged under their own names, beside the channels.

    Raises:
        Untranslated: it holds something that the batch does not fly.
        ModelError: JSBSim refuses it.
    """
    fdm = Executive(aircraft, rate_hz, condition)
    tree = aircraft.model_tree(rate_hz, condition.qbar_Pa, condition.V_m_s)
    sources = {n: str(aircraft.source_of(n)[0]) for n in fdm.channels}
    inputs = [aircraft.controls[n].command for n in fdm.command_nodes]
    settings = aircraft.adapter.settings if aircraft.adapter is not None else {}
    frozen = settings.get("propulsion/fuel_freeze", 0.0) != 0.0  # JSBSim takes it but does not give it back
    followed = [*(m.follows for m in aircraft.memories), *(f"modal/etaddot-{i + 1}" for i in range(fdm.mode_count))]
    read = [*sources.values(), *inputs, *followed, *watched]  # a linear model asks for what is followed
    translation = translate(tree, aircraft.engine_files, 1.0 / rate_hz, inputs, read, frozen)
    logged = translation.program.logged
    found = {n: logged[s] for n, s in sources.items()} | {n: logged[n] for n in (*followed, *watched)}
    program = replace(translation.program, logged=found)
    start = np.zeros(program.size)
    start[program.numbers] = translation.numbers
    for name, register in program.properties.items():
        start[register] = translation.declared[name] if name in translation.declared else _value(fdm, name)
    for name, (register, factor) in CORE.items():
        if name.startswith(_FIXED):
            start[register] = fdm.get(name) / factor
    weights = _weights(fdm)
    _set_weights(start, weights)
    memories, outputs = _components(program, translation, fdm, condition, start)
    # Where propellers are brought to rest by themselves, all the rest is evaluated before and after it.
    iterations = 2 * fdm.to_rest + 1 if fdm.propellers.free else fdm.to_rest
    return BatchModel(
        aircraft, rate_hz, program, start, fdm.channels, np.array(fdm.factors), iterations,
        _Shape.of(aircraft, condition, tree, translation), weights, _dry(tree), translation, memories, outputs,
        _loading(aircraft, condition),
    )  # fmt: skip


def _dry(tree: ET.Element) -> Weights | None:
    try:
        return dry(tree)
    except Untranslated:
        return None


def _components(
    program: Program, translation: Translation, fdm: Executive, condition: FlightCondition, start: FloatArray
) -> tuple[npt.NDArray[np.int64], dict[int, float]]:
    """Return what components remember and what they write, and set the latter as JSBSim has it once it is placed."""
    found = {n: program.properties[n] for n in sorted(translation.components) if n in program.properties}
    memories = np.array([k for n, k in found.items() if n.startswith(MEMORY)], np.int64)
    outputs = {
        k: translation.declared.get(n, start[k] if n.startswith(_OWN) else 0.0)
        for n, k in found.items()
        if not n.startswith(MEMORY)
    }
    for name, register in found.items():
        if register in outputs:
            start[register] = _value(fdm, name)
    fdm.place_at(condition)
    fdm.evaluate()
    for name, register in program.properties.items():
        if ON_GROUND.fullmatch(name):
            start[register] = _value(fdm, name)
    return memories, outputs


def _loading(aircraft: Aircraft, condition: FlightCondition) -> tuple[tuple[float, float], ...]:
    """Return height and speed of the evaluations that an executive makes before it is placed (Executive)."""
    if aircraft.adapter is None:
        return ((0.0, 0.0),)
    before = ((0.0, 0.0),) * (2 if "propulsion/fuel_freeze" in aircraft.adapter.settings else 1)
    return (*before, (condition.h_m, condition.V_m_s))


def variant(base: BatchModel, aircraft: Aircraft, condition: FlightCondition, tree: ET.Element) -> BatchModel | None:
    """Return the model of an aircraft that differs from that of ``base`` in numbers only, or None if it does not.

    Args:
        base: translated model.
        aircraft: that wants one.
        condition: for which the steps of its modes are made.
        tree: its rigid tree.

    Raises:
        ModelError: an amendment does not fit the model.
    """
    if _fixed(aircraft) != base.shape.fixed or _placed(tree, base.program) != base.shape.placed:
        return None
    modes = _modes(aircraft, condition)
    if modes == base.shape.modes:
        numbers = base.shape.rigid.numbers(tree, base.translation.numbers)
    else:
        if (modes is None) != (base.shape.modes is None):
            return None
        full = aircraft.model_tree(base.rate_hz, condition.qbar_Pa, condition.V_m_s)
        numbers = base.shape.whole.numbers(full, base.translation.numbers)
    if numbers is None:
        return None
    start = base.start.copy()
    start[base.program.numbers] = numbers
    for section in (e for e in tree.iter() if e.tag in _SECTIONS):
        for name, value in declared(section).items():
            if name in base.program.properties:
                start[base.program.properties[name]] = value
    empty = _dry(tree)
    if base.dry is None or empty is None:
        return None
    weights = base.weights.with_empty(base.dry, empty)
    _set_weights(start, weights)
    factors = np.array([aircraft.source_of(n)[1] for n in base.channels])
    return replace(base, aircraft=aircraft, start=start, factors=factors)


_PlaceOf = tuple[int, int, float]


@dataclass(frozen=True, eq=False)
class _Template:
    """The elements of a tree in order, and which of their texts are numbers that may differ."""

    # (tag, attributes, text) of each; text None where it may differ
    elements: tuple[tuple[str, dict[str, str], str | None], ...]
    # (number of the model, element, factor to the program's unit) of those that the program reads
    places: tuple[_PlaceOf, ...]

    @cached_property
    def _tags(self) -> list[str]:
        return [tag for tag, _, _ in self.elements]

    @cached_property
    def _fixed(self) -> list[tuple[int, str | None]]:
        return [(i, text) for i, (_, _, text) in enumerate(self.elements) if text is not None]

    @cached_property
    def _attributes(self) -> list[dict[str, str]]:
        return [own for _, own, _ in self.elements]

    @classmethod
    def of(cls, tree: ET.Element, translation: Translation) -> _Template:
        """Take the shape of a tree, or of a part of one, that has been translated."""
        order = {id(e): i for i, e in enumerate(tree.iter())}
        places = tuple((n, order[id(e)], factor) for n, e, factor in translation.places if id(e) in order)
        return cls.apart(tree, places)

    @classmethod
    def apart(cls, tree: ET.Element, places: tuple[_PlaceOf, ...]) -> _Template:
        """Take the shape of a tree whose numbers stand at ``places``."""
        free = {at for _, at, _ in places}
        balance = {id(e) for b in tree.iter("mass_balance") for e in b.iter()}
        elements = tuple(
            (e.tag, attributes(e), None if i in free or id(e) in balance else e.text) for i, e in enumerate(tree.iter())
        )
        return cls(elements, places)

    def numbers(self, tree: ET.Element, base: tuple[float, ...]) -> FloatArray | None:
        """Return the numbers of another tree in the program's order, or None if it differs in more than numbers."""
        others = list(tree.iter())
        if [e.tag for e in others] != self._tags or [attributes(e) for e in others] != self._attributes:
            return None
        if [(i, others[i].text) for i, _ in self._fixed] != self._fixed:
            return None
        out = np.array(base)
        try:
            for number, at, factor in self.places:
                out[number] = float(others[at].text or "nan") * factor
        except ValueError:
            return None
        return out


def attributes(e: ET.Element) -> dict[str, str]:
    """Return the attributes of an element that must be the same: the value of a declared property may differ."""
    return {"unit": e.get("unit", "")} if e.tag == "property" else e.attrib


@dataclass(frozen=True, eq=False)
class _Shape:
    """What models have in common that differ in numbers only; its text says all of it but the modes' numbers."""

    fixed: tuple[object, ...]  # commands, limits, engines, settings
    # of the wings, with the condition for which their steps are made; None without
    modes: tuple[object, ...] | None = field(repr=False)
    rigid: _Template  # the tree without the modes
    whole: _Template  # the tree
    # what of the tree JSBSim makes properties from that the program reads
    placed: tuple[str, ...] = field(default=(), repr=False)

    @classmethod
    def of(cls, aircraft: Aircraft, condition: FlightCondition, tree: ET.Element, translation: Translation) -> _Shape:
        """Take the shape of a translated aircraft."""
        placed = _placed(tree, translation.program)
        whole = _Template.of(tree, translation)
        rigid = aircraft.rigid_tree()
        modes = _modes(aircraft, condition)
        if modes is None:
            return cls(_fixed(aircraft), None, whole, whole, placed)
        # the elements of the rigid tree are those of the whole, in their order, without those that the modes added
        places: dict[int, list[tuple[int, float]]] = {}
        for number, at, factor in whole.places:
            places.setdefault(at, []).append((number, factor))
        kept: list[_PlaceOf] = []
        at = 0
        everything = list(tree.iter())
        for i, e in enumerate(rigid.iter()):
            while not _alike(everything[at], e):
                at += 1
            kept += [(number, i, factor) for number, factor in places.get(at, ())]
            at += 1
        return cls(_fixed(aircraft), modes, _Template.apart(rigid, tuple(kept)), whole, placed)


def _placed(tree: ET.Element, program: Program) -> tuple[str, ...]:
    """Return the texts of the sections that JSBSim makes properties from which a program reads.

    These are the places of engines and, of all that it takes from the mass balance, what is no register of its own.
    """
    names = program.properties
    engines = any(n.endswith("-position") for n in names)
    masses = any(n.startswith("inertia/") for n in names)
    sections = (("propulsion",) if engines or masses else ()) + (("mass_balance",) if masses else ())
    return tuple((e.text or "").strip() for name in sections for part in tree.iter(name) for e in part.iter())


def _alike(a: ET.Element, b: ET.Element) -> bool:
    return a.tag == b.tag and a.attrib == b.attrib and (a.text or "").strip() == (b.text or "").strip()


def _modes(aircraft: Aircraft, condition: FlightCondition) -> tuple[object, ...] | None:
    elastic = aircraft.flown_modes()
    return None if elastic is None or not len(elastic) else (repr(elastic), condition.qbar_Pa, condition.V_m_s)


def _fixed(aircraft: Aircraft) -> tuple[object, ...]:
    controls = tuple((n, c.command, c.scale) for n, c in aircraft.controls.items())
    return (
        aircraft.engines, controls,
        tuple(aircraft.limits), None if aircraft.adapter is None else tuple(sorted(aircraft.adapter.settings.items())),
    )  # fmt: skip


def _value(fdm: Executive, name: str) -> float:
    return fdm.get(name) if not name.startswith(MEMORY) and fdm.has(name) else 0.0


def _weights(fdm: Executive) -> Weights:
    """Return mass, centre of gravity and inertia as JSBSim has them."""
    J = np.zeros((3, 3))
    for axes, i, k, sign in _INERTIA:
        J[i, k] = J[k, i] = sign * fdm.get(f"inertia/i{axes}-slugs_ft2")
    return Weights(fdm.get("inertia/weight-lbs"), np.array([fdm.get(f"inertia/cg-{a}-in") for a in "xyz"]), J)


def _set_weights(start: FloatArray, weights: Weights) -> None:
    start[r.WEIGHT] = weights.weight
    start[r.CG : r.CG + 3] = weights.cg
    start[r.INERTIA : r.INERTIA + 6] = [weights.inertia[i, k] for _, i, k, _ in _INERTIA]


_HELD: OrderedDict[object, tuple[BatchModel, Beginning, dict[str, float]]] = OrderedDict()
_KEPT = 32 * LANES  # beginnings whose engines are known


def states_at(model: BatchModel, beginning: Beginning) -> dict[str, float]:
    """Return what is not motion when a flight begins: property -> value, see :func:`read_states`.

    JSBSim tells it of flights that did not begin there a moment ago.
    """
    known = _HELD.get(_key(model, beginning))
    if known is not None:
        return known[2]
    fdm = Executive(model.aircraft, model.rate_hz, beginning.trimmed.condition)
    return keep_states(model, beginning, read_states(model, beginning, fdm))


def keep_states(model: BatchModel, beginning: Beginning, states: dict[str, float]) -> dict[str, float]:
    """Keep, and return, what is not motion when a flight begins, for flights that begin there soon."""
    _HELD[_key(model, beginning)] = model, beginning, states
    if len(_HELD) > _KEPT:
        _HELD.popitem(last=False)
    return states


def _key(model: BatchModel, beginning: Beginning) -> object:
    # Addresses tell as long as what they are of lives, which is kept beside.
    written = model_key(model.aircraft, model.rate_hz, beginning.trimmed.condition)
    return written, id(model.program), beginning.key


def read_states(model: BatchModel, beginning: Beginning, fdm: Executive) -> dict[str, float]:
    """Return what is not motion when a flight begins, from JSBSim: property -> value.

    Of engines the speeds, blade angles and pressures, the levers that hold them, and what has no property but follows
    from others; and the angle by which the Earth has turned while engines were held.

    Args:
        model: of the flight.
        beginning: of the flight.
        fdm: of its aircraft, fresh or at rest near by; it is put there.
    """
    beginning.put(fdm)
    names = (n for n in model.program.properties if n.startswith("propulsion/") or _LEVERS.fullmatch(n))
    states = {n: fdm.get(n) for n in names if fdm.has(n)}
    for name in model.program.properties:
        if name.startswith("batch/") and name.endswith("/starved"):
            flow = name.replace("batch/", "propulsion/").replace("starved", "fuel-flow-rate-pps")
            states[name] = float(fdm.get(flow) == 0.0)
    states[_EARTH_ANGLE] = fdm.get(_EARTH_ANGLE)
    return states


def registers(models: Sequence[BatchModel]) -> FloatArray:
    """Return the registers (registers, LANES) of up to LANES flights; the last is repeated to fill the block."""
    R = aligned(models[0].start.size)
    for k, model in enumerate(models):
        R[:, k] = model.start
    R[:, len(models) :] = models[-1].start[:, None]
    return R


def filled(x: FloatArray) -> FloatArray:
    """Return an array whose last axis counts flights, with the last flight repeated up to LANES."""
    missing = LANES - x.shape[-1]
    return np.concatenate([x, np.repeat(x[..., -1:], missing, axis=-1)], axis=-1) if missing else x


def put(
    model: BatchModel,
    R: FloatArray,
    at: FloatArray,
    commands: Mapping[str, FloatArray],
    states: Sequence[Mapping[str, float]] = (),
) -> None:
    """Place flights, heading north, and evaluate their forces while time stands still.

    Args:
        model: what flies.
        R: registers, changed.
        at: (9, flights) height, pitch and bank, velocity over the ground in body axes, rates; SI.
        commands: control -> (flights,), SI.
        states: of every flight, see ``states_at``; none of them moves while time stands still.
    """
    R[r.DT] = 0.0
    machine, ground = model.program.machine, on_ground()
    ground.weigh(R)
    _wake(model, R)
    for name, register in model.commands.items():
        if name in commands:
            R[register] = filled(np.asarray(commands[name])) / model.aircraft.controls[name].scale
    h_m, theta, phi = at[:3]
    place = filled(np.stack([h_m / FT_M, phi, theta, np.zeros_like(phi), *(at[3:6] / FT_M), *at[6:]]))
    held = {n: filled(np.array([s[n] for s in states])) for n in (states[0] if states else ())}
    turned = held.pop(_EARTH_ANGLE, np.zeros(1))
    for name, values in held.items():
        R[model.program.properties[name]] = values
    machine.before(R)
    ground.settle(R, place, machine.frame_at, model.iterations)
    if turned.any():
        R[r.EARTH_ANGLE] = turned
        machine.frame(R)


def _wake(model: BatchModel, R: FloatArray) -> None:
    """Let components remember what JSBSim's do: they run already while the model is loaded, commands at rest."""
    if not model.memories.size:
        return
    seen = R.copy()
    for register, value in model.outputs.items():
        R[register] = value
    model.program.machine.before(R)
    for h_m, V_m_s in model.loading:
        at = np.zeros((10, LANES))
        at[0], at[4] = h_m / FT_M, V_m_s / FT_M
        on_ground().place(R, at)
        model.program.machine.frame(R)
        model.program.machine.frame(R)
    seen[model.memories] = R[model.memories]
    R[:] = seen


def read(model: BatchModel, R: FloatArray) -> FloatArray:
    """Return every channel of the simulator (channels, flights) as it is now, in JSBSim's unit."""
    model.program.machine.log(R)
    return R[[model.program.logged[n] for n in model.channels]]
