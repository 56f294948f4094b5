"""An aircraft ready to be flown in batches: its program, and the registers that a flight begins with."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.channels import CHANNELS, channel
from testbench.core.constants import FT_M
from testbench.core.record import FloatArray
from testbench.flight.batch import registers as r
from testbench.flight.batch.integrate import begin, place, weigh
from testbench.flight.batch.interpret import execute
from testbench.flight.batch.program import Program, Untranslated
from testbench.flight.batch.properties import CORE, plain
from testbench.flight.batch.translate import Translation, declared, translate
from testbench.flight.batch.weights import Weights, dry
from testbench.flight.condition import FlightCondition
from testbench.flight.executive import Executive

_FIXED = ("metrics/",)
# JSBSim's properties give Ixz with the sign that it has in the matrix, the other two products with the opposite one.
_INERTIA = (("xx", 0, 0, 1.0), ("yy", 1, 1, 1.0), ("zz", 2, 2, 1.0), ("xy", 0, 1, -1.0), ("xz", 0, 2, 1.0),
            ("yz", 1, 2, -1.0))  # fmt: skip
_SECTIONS = {"system", "autopilot", "flight_control", "aerodynamics", "propulsion", "external_reactions",
             "mass_balance", "ground_reactions"}  # fmt: skip
_CLEARANCE = 3.0  # spans above the ground, below which wheels might touch it
TOP_FT = 100000.0


@dataclass(frozen=True, eq=False)
class BatchModel:
    """A translated aircraft.

    Attributes:
        aircraft: what it is.
        rate_hz: frame rate.
        program: what is computed in a frame.
        start: (registers,) at rest, before the aircraft is placed.
        channels: those of the simulator, in its order.
        factors: of each channel to SI.
        iterations: evaluations until a placed aircraft is at rest.
        shape: what another model must have in common with it, to fly by the same program.
        weights: as flown.
        dry: without fuel.
        translation: of its tree.
    """

    aircraft: Aircraft
    rate_hz: float
    program: Program
    start: FloatArray
    channels: tuple[str, ...]
    factors: FloatArray
    iterations: int
    shape: tuple[object, ...]
    weights: Weights
    dry: Weights
    translation: Translation

    @property
    def commands(self) -> dict[str, int]:
        """Control -> register of its command."""
        found = self.program.properties
        return {n: found[plain(c.command)] for n, c in self.aircraft.controls.items() if plain(c.command) in found}

    @property
    def floor_ft(self) -> float:
        """Height above the ground below which JSBSim flies: a model may have wheels, which the batch has not."""
        return _CLEARANCE * float(self.start[r.WING_SPAN])


def batch_model(aircraft: Aircraft, rate_hz: float, condition: FlightCondition) -> BatchModel:
    """Translate an aircraft.

    Raises:
        Untranslated: it holds something that the batch does not fly.
        ModelError: JSBSim refuses it.
    """
    fdm = Executive(aircraft, rate_hz, condition)
    tree = aircraft.model_tree(rate_hz, condition.qbar_Pa, condition.V_m_s)
    sources = {n: _source(aircraft, n) for n in fdm.channels}
    inputs = [aircraft.controls[n].command for n in fdm.command_nodes]
    translation = translate(tree, aircraft.engine_files, 1.0 / rate_hz, inputs, [*sources.values(), *inputs])
    program = replace(
        translation.program, logged={n: translation.program.logged[s] for n, s in sources.items()}
    )
    start = np.zeros(program.size)
    start[program.numbers] = translation.numbers
    for name, register in program.properties.items():
        start[register] = translation.declared[name] if name in translation.declared else _value(fdm, name)
    for name, (register, factor) in CORE.items():
        if name.startswith(_FIXED):
            start[register] = fdm.get(name) / factor
    weights = _weights(fdm)
    _set_weights(start, weights)
    return BatchModel(
        aircraft, rate_hz, program, start, fdm.channels, np.array(fdm.factors), fdm.to_rest,
        shape_of(aircraft, tree, translation), weights, dry(tree), translation,
    )  # fmt: skip


def variant(base: BatchModel, aircraft: Aircraft, tree: ET.Element) -> BatchModel:
    """Return the model of an aircraft whose tree has the shape of that of ``base``, with its own numbers.

    Raises:
        Untranslated: it reads a property that JSBSim takes from the mass balance, which only JSBSim can tell.
    """
    if any(n.startswith("inertia/") for n in base.program.properties):
        raise Untranslated("it reads the mass balance")
    elements = list(tree.iter())
    numbers = np.array(base.translation.numbers)
    for number, at in base.translation.places:
        numbers[number] = float(elements[at].text or "nan")
    start = base.start.copy()
    start[base.program.numbers] = numbers
    for section in (e for e in elements if e.tag in _SECTIONS):
        for name, value in declared(section).items():
            if name in base.program.properties:
                start[base.program.properties[name]] = value
    empty = dry(tree)
    weights = base.weights.with_empty(base.dry, empty)
    _set_weights(start, weights)
    factors = np.array([_factor(aircraft, n) for n in base.channels])
    return replace(base, aircraft=aircraft, start=start, factors=factors)


def shape_of(aircraft: Aircraft, tree: ET.Element, translation: Translation | None = None) -> tuple[object, ...]:
    """Return what two models have in common that differ in numbers only.

    Numbers that may differ are those that the translation has found as such, values of declared properties, and what
    stands in the mass balance; everything else must be the same, letter by letter.
    """
    free = {at for _, at in translation.places} if translation is not None else None
    parts: list[object] = []
    in_balance = 0
    for i, e in enumerate(tree.iter()):
        if e.tag == "mass_balance":
            in_balance = sum(1 for _ in e.iter())
        text = (e.text or "").strip()
        if in_balance > 0:
            in_balance -= 1
            text = ""
        elif (free is None or i in free) and _is_number(text):
            text = "#"
        attributes = {k: v for k, v in e.attrib.items() if not (e.tag == "property" and k == "value")}
        parts.append((e.tag, tuple(attributes.items()), text))
    return (
        hash(tuple(parts)), tuple(sorted(aircraft.engine_files.items())), tuple(aircraft.controls),
        tuple(c.command for c in aircraft.controls.values()), tuple(aircraft.limits),
        None if aircraft.adapter is None else tuple(sorted(aircraft.adapter.settings.items())),
    )  # fmt: skip


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _source(aircraft: Aircraft, name: str) -> str:
    source = aircraft.source_of(name)[0] if name in CHANNELS else channel(name).jsbsim_property
    assert source is not None
    return source


def _factor(aircraft: Aircraft, name: str) -> float:
    return aircraft.source_of(name)[1] if name in CHANNELS else channel(name).factor


def _value(fdm: Executive, name: str) -> float:
    return fdm.get(name) if fdm.has(name) else 0.0


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


def put(
    model: BatchModel,
    R: FloatArray,
    h_m: FloatArray,
    theta: FloatArray,
    phi: FloatArray,
    uvw_m_s: FloatArray,
    pqr: FloatArray,
    commands: Mapping[str, FloatArray],
    times: int,
) -> None:
    """Place flights, heading north, and evaluate their forces while time stands still.

    Args:
        model: what flies.
        R: registers, changed.
        h_m: (flights,).
        theta: (flights,), rad.
        phi: (flights,), rad.
        uvw_m_s: (3, flights) over the ground, body axes.
        pqr: (3, flights), rad/s.
        commands: control -> (flights,), SI.
        times: evaluations, each of which JSBSim makes as two frames.
    """
    for name, register in model.commands.items():
        if name in commands:
            R[register] = np.asarray(commands[name]) / model.aircraft.controls[name].scale
    euler = np.stack([phi, theta, np.zeros_like(phi)])
    weigh(R)
    R[r.DT] = 0.0
    execute(model.program.before, model.program.tables, R)
    for _ in range(times):
        place(R, np.asarray(h_m) / FT_M, euler, uvw_m_s / FT_M, pqr)
        execute(model.program.frame, model.program.tables, R)
        execute(model.program.frame, model.program.tables, R)
    begin(R)


def read(model: BatchModel, R: FloatArray) -> FloatArray:
    """Return every channel of the simulator (channels, flights) as it is now, in JSBSim's unit."""
    execute(model.program.log, model.program.tables, R)
    return R[[model.program.logged[n] for n in model.channels]]


