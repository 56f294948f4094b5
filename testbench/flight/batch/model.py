"""An aircraft ready to be flown in batches: its program, and the registers that a flight begins with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from testbench.aircraft import Aircraft
from testbench.core.channels import CHANNELS, channel
from testbench.core.constants import FT_M
from testbench.core.record import FloatArray
from testbench.flight.batch import registers as r
from testbench.flight.batch.integrate import begin, place, weigh
from testbench.flight.batch.interpret import execute
from testbench.flight.batch.program import Program
from testbench.flight.batch.properties import CORE, ON_GROUND, plain
from testbench.flight.batch.scope import MEMORY
from testbench.flight.batch.translate import translate
from testbench.flight.condition import FlightCondition
from testbench.flight.executive import Executive

_BODY = ("metrics/", "inertia/cg-", "inertia/weight-lbs")
_OWN = ("gear/", "propulsion/")  # JSBSim's own, which it does not begin with zero
# JSBSim's properties give Ixz with the sign that it has in the matrix, the other two products with the opposite one.
_INERTIA = (("xx", 1.0), ("yy", 1.0), ("zz", 1.0), ("xy", -1.0), ("xz", 1.0), ("yz", -1.0))


@dataclass(frozen=True, eq=False)
class BatchModel:
    """A translated aircraft.

    Attributes:
        aircraft: what it is.
        rate_hz: frame rate.
        program: what is computed in a frame.
        start: (registers,) at rest, before the aircraft is placed.
        channels: those of the simulator, in its order.
        factors: channel -> factor to SI.
        iterations: evaluations until a placed aircraft is at rest.
        memories: registers of what components of the control system remember.
        outputs: registers of what they write -> value before the first frame.
        loading: height (m) and speed (m/s) of the evaluations that JSBSim makes when the model is loaded.
    """

    aircraft: Aircraft
    rate_hz: float
    program: Program
    start: FloatArray
    channels: tuple[str, ...]
    factors: FloatArray
    iterations: int
    memories: npt.NDArray[np.int64]
    outputs: Mapping[int, float]
    loading: tuple[tuple[float, float], ...]

    @property
    def commands(self) -> dict[str, int]:
        """Control -> register of its command."""
        found = self.program.properties
        return {n: found.get(plain(c.command), -1) for n, c in self.aircraft.controls.items()}

    @property
    def logged(self) -> npt.NDArray[np.int64]:
        """Registers of the channels."""
        return np.array([self.program.logged[n] for n in self.channels], np.int64)


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
    sources = {n: _source(aircraft, n) for n in fdm.channels}
    inputs = [aircraft.controls[n].command for n in fdm.command_nodes]
    translation = translate(tree, aircraft.engine_files, 1.0 / rate_hz, inputs, [*sources.values(), *watched])
    program = translation.program
    start = np.zeros(program.size)
    start[program.numbers] = translation.numbers
    for name, register in program.properties.items():
        start[register] = translation.declared[name] if name in translation.declared else _value(fdm, name)
    _set_body(start, fdm)
    program = _with_logged(program, {**sources, **dict(zip(watched, watched, strict=True))})
    registers = {n: program.properties[n] for n in sorted(translation.components) if n in program.properties}
    memories = np.array([k for n, k in registers.items() if n.startswith(MEMORY)], np.int64)
    outputs = {
        k: translation.declared.get(n, start[k] if n.startswith(_OWN) else 0.0)
        for n, k in registers.items()
        if not n.startswith(MEMORY)
    }
    for k, n in ((k, n) for n, k in registers.items() if k in outputs):
        start[k] = _value(fdm, n)
    fdm.place(condition.h_m, 0.0, 0.0, (condition.V_m_s, 0.0, 0.0))
    fdm.evaluate()
    for name, register in program.properties.items():
        if ON_GROUND.fullmatch(name):
            start[register] = _value(fdm, name)
    loading = _loading(aircraft, condition)
    return BatchModel(
        aircraft, rate_hz, program, start, fdm.channels, np.array(fdm.factors), fdm.to_rest, memories, outputs, loading
    )


def _loading(aircraft: Aircraft, condition: FlightCondition) -> tuple[tuple[float, float], ...]:
    """Return height and speed of the evaluations that an executive makes before it is placed (Executive)."""
    if aircraft.adapter is None:
        return ((0.0, 0.0),)
    before = ((0.0, 0.0),) * (2 if "propulsion/fuel_freeze" in aircraft.adapter.settings else 1)
    return (*before, (condition.h_m, condition.V_m_s))


def _source(aircraft: Aircraft, name: str) -> str:
    source = aircraft.source_of(name)[0] if name in CHANNELS else channel(name).jsbsim_property
    assert source is not None
    return source


def _with_logged(program: Program, sources: Mapping[str, str]) -> Program:
    from dataclasses import replace

    return replace(program, logged={n: program.logged[s] for n, s in sources.items()})


def _value(fdm: Executive, name: str) -> float:
    return fdm.get(name) if not name.startswith(MEMORY) and fdm.has(name) else 0.0


def _set_body(start: FloatArray, fdm: Executive) -> None:
    """Take reference lengths, mass and inertia from JSBSim."""
    for name, (register, factor) in CORE.items():
        if name.startswith(_BODY):
            start[register] = fdm.get(name) / factor
    for i, (axes, sign) in enumerate(_INERTIA):
        start[r.INERTIA + i] = sign * fdm.get(f"inertia/i{axes}-slugs_ft2")


def registers(model: BatchModel, flights: int) -> FloatArray:
    """Return the registers (registers, flights) of flights that have not been placed."""
    R = np.repeat(model.start[:, None], flights, axis=1)
    weigh(R)
    return R


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
    R[r.DT] = 0.0
    _wake(model, R)
    for name, register in model.commands.items():
        if name in commands:
            R[register] = np.asarray(commands[name]) / model.aircraft.controls[name].scale
    euler = np.stack([phi, theta, np.zeros_like(phi)])
    execute(model.program.before, model.program.tables, R)
    for _ in range(times):
        place(R, np.asarray(h_m) / FT_M, euler, uvw_m_s / FT_M, pqr)
        execute(model.program.frame, model.program.tables, R)
        execute(model.program.frame, model.program.tables, R)
    begin(R)


def _wake(model: BatchModel, R: FloatArray) -> None:
    """Let components remember what JSBSim's do: they run already while the model is loaded, commands at rest."""
    if not model.memories.size:
        return
    seen = R.copy()
    for register, value in model.outputs.items():
        R[register] = value
    execute(model.program.before, model.program.tables, R)
    none = np.zeros((3, R.shape[1]))
    for h_m, V_m_s in model.loading:
        speed = np.array([[V_m_s / FT_M], [0.0], [0.0]]) + none
        place(R, np.full(R.shape[1], h_m / FT_M), none, speed, none)
        execute(model.program.frame, model.program.tables, R)
        execute(model.program.frame, model.program.tables, R)
    seen[model.memories] = R[model.memories]
    R[:] = seen


def columns(names: Sequence[str], wanted: Sequence[str]) -> list[int]:
    """Return where each wanted name stands."""
    return [names.index(n) for n in wanted]
