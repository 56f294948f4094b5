"""One flight of a model outside of the testbench, frame by frame: what emitters for other languages write down."""

from __future__ import annotations

import math
from dataclasses import dataclass

from testbench.aircraft import Aircraft
from testbench.core.channels import channel
from testbench.core.constants import FT_M
from testbench.core.errors import LimitError
from testbench.core.record import FloatArray
from testbench.flight.batch import registers as r
from testbench.flight.batch.check import judged
from testbench.flight.batch.fly import column, placed
from testbench.flight.batch.program import Program
from testbench.flight.condition import TrimmedFlight
from testbench.flight.start import Beginning
from testbench.flight.trim import steady_wind

AXES = ("north", "east", "down")
_MOST_WIND_M_S = 100.0


@dataclass(frozen=True)
class Signal:
    """An input or an output."""

    name: str  # as the table of channels has it
    unit: str  # SI
    description: str  # in words
    register: int  # that holds it
    factor: float  # of the register to SI
    at_trim: float  # its value there, SI
    low: float = -math.inf  # least value of an input
    high: float = math.inf  # greatest value of an input


@dataclass(frozen=True, eq=False)
class Alone:
    """A model that flies from a trim, one flight at a time."""

    aircraft: Aircraft  # what it is
    trimmed: TrimmedFlight  # where it begins
    program: Program  # what is computed in a frame
    registers: FloatArray  # (registers,) at the trim, what does not change from frame to frame computed
    inputs: tuple[Signal, ...]  # commands of the controls, then the velocity of the air
    outputs: tuple[Signal, ...]  # channels that are no inputs
    iterations: int  # evaluations until a placed aircraft is at rest
    worst: float  # greatest difference from JSBSim in the flight that compares them, of a channel's range

    @property
    def dt_s(self) -> float:
        """Frame time, s."""
        return 1.0 / self.trimmed.rate_hz

    def at_trim(self) -> tuple[float, ...]:
        """Return height (m), phi, theta, psi, velocity over the ground (3, m/s) and rates (3, rad/s), body axes."""
        h_m, theta, phi, *motion = column(Beginning.at(self.trimmed))[0].tolist()
        return h_m, phi, theta, 0.0, *motion


def alone(aircraft: Aircraft, trimmed: TrimmedFlight) -> Alone:
    """Return a model to be flown outside, from a trim on.

    Raises:
        LimitError: it is not found equal to JSBSim.
    """
    found = judged(aircraft, trimmed)
    model = found.model
    if model is None:
        raise LimitError(f"{aircraft.name} must be translated to be flown outside of JSBSim, but {found.reason}")
    R = placed([model], [Beginning.at(trimmed)])
    R[r.DT] = 1.0 / model.rate_hz
    model.program.machine.before(R)
    start = R[:, 0].copy()
    model.program.machine.log(R)
    inputs = []
    for name, register in model.commands.items():
        of, control = channel(f"{name}_cmd"), aircraft.controls[name]
        at = trimmed.controls[name]
        low, high = min(control.low, at), max(control.full, at)  # a trim may lie a rounding beyond its limit
        inputs.append(Signal(of.name, of.unit, of.description, register, control.scale, at, low, high))
    for i, (axis, at) in enumerate(zip(AXES, steady_wind(trimmed), strict=True)):
        of = channel(f"wind_{axis}")
        inputs.append(Signal(of.name, of.unit, of.description, r.GUST + i, FT_M, at, -_MOST_WIND_M_S, _MOST_WIND_M_S))
    outputs = []
    for name, factor in zip(model.channels, model.factors.tolist(), strict=True):
        if name in {x.name for x in inputs}:
            continue
        of, register = channel(name), model.program.logged[name]
        outputs.append(Signal(name, of.unit, of.description, register, factor, float(R[register, 0]) * factor))
    return Alone(aircraft, trimmed, model.program, start, tuple(inputs), tuple(outputs), model.iterations, found.worst)
