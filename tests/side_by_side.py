"""Sections added to a small model, computed by JSBSim and by the batch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from testbench.aircraft import Aircraft
from testbench.flight import FlightCondition
from testbench.flight.batch import registers as r
from testbench.flight.batch.machine import Machine, object_code
from testbench.flight.batch.model import BatchModel, batch_model, put, registers
from testbench.flight.batch.vector import LANES, Code, Module, Rows
from testbench.flight.executive import Executive

CONDITION = FlightCondition(12.0, 100.0)
RATE_HZ = 120.0
INPUTS = tuple(f"fcs/{name}-cmd-norm" for name in ("elevator", "aileron", "rudder", "throttle"))
"""Properties that are moved: the commands, which nothing else moves."""
_AT = {"h_m": 100.0, "theta": 0.06, "phi": 0.01, "uvw_m_s": (11.98, 0.0, 0.72), "pqr": (0.0, 0.0, 0.0)}


def by_itself(work: Callable[[Rows], None]) -> Callable[[np.ndarray], None]:
    """Return a stage of the frame, or what else changes registers R (registers, LANES), compiled alone."""
    module = Module()

    def body(code: Code) -> str:
        work(Rows(code))
        return "void"

    module.define("alone", "void @alone(ptr %R)", body)
    machine = Machine(object_code(module.text))
    return machine.function("alone", "ptr")


def with_sections(aircraft: Aircraft, sections: str) -> Aircraft:
    """Return an aircraft with sections that come before its flight control."""
    at = aircraft.xml.index("<flight_control")
    return replace(aircraft, xml=aircraft.xml[:at] + sections + aircraft.xml[at:])


@dataclass
class SideBySide:
    """An aircraft with sections, in JSBSim and in the batch, placed at the same state."""

    fdm: Executive
    model: BatchModel
    R: np.ndarray
    names: tuple[str, ...]

    @classmethod
    def of(cls, aircraft: Aircraft, sections: str, names, first=(0.1, -0.2, 0.3, 0.4)) -> SideBySide:
        """Place an aircraft of which ``names`` are compared, the commands at ``first``."""
        aircraft, names = with_sections(aircraft, sections), tuple(names)
        fdm = Executive(aircraft, RATE_HZ, CONDITION)
        model = batch_model(aircraft, RATE_HZ, CONDITION, names)
        R = registers([model])
        one = np.ones(1)
        scales = [aircraft.controls[n].scale for n in model.commands]
        commands = {n: x * s for n, x, s in zip(model.commands, first, scales, strict=True)}
        fdm.place(_AT["h_m"], _AT["theta"], _AT["phi"], _AT["uvw_m_s"], _AT["pqr"])
        fdm.command(commands)
        fdm.evaluate(to_rest=True)
        at = np.array([_AT["h_m"], _AT["theta"], _AT["phi"], *_AT["uvw_m_s"], *_AT["pqr"]])[:, None]
        moved = {n: v * one for n, v in commands.items()}
        put(model, R, at, moved)
        R[r.DT] = 1.0 / RATE_HZ
        model.program.machine.before(R)
        return cls(fdm, model, R, names)

    def points(self, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the values (points, names) of what depends on the inputs (points, 4) alone, by both."""
        truth = []
        for row in inputs:
            for name, x in zip(INPUTS, row, strict=True):
                self.fdm.set(name, float(x))
            self.fdm.fdm.run_ic()  # evaluates the functions, from the same state again and again
            truth.append(self._read())
        return np.array(truth), self.computed(inputs)

    def computed(self, inputs: np.ndarray) -> np.ndarray:
        """Return the values (points, names) by the batch, a point per flight, block by block."""
        out = []
        for k in range(0, len(inputs), LANES):
            block = inputs[k : k + LANES]
            for i, register in enumerate(self.model.commands.values()):
                self.R[register, : len(block)] = block[:, i]
            out.append(self._frame()[:, : len(block)])
        return np.concatenate(out, axis=1).T

    def flown(self, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the values (frames + 1, names) while the inputs (frames, 4) are flown, by both."""
        truth, got = [self._read()], [self._logged()[:, 0]]
        for row in inputs:
            for name, x in zip(INPUTS, row, strict=True):
                self.fdm.set(name, float(x))
            self.fdm.fdm.run()
            truth.append(self._read())
            for x, register in zip(row, self.model.commands.values(), strict=True):
                self.R[register] = x
            got.append(self._frame()[:, 0])
        return np.array(truth), np.array(got)

    def _read(self) -> list[float]:
        return [self.fdm.get(n) for n in self.names]

    def _frame(self) -> np.ndarray:
        self.model.program.machine.frame(self.R)
        return self._logged()

    def _logged(self) -> np.ndarray:
        self.model.program.machine.log(self.R)
        return self.R[[self.model.program.logged[n] for n in self.names]]


def differences(truth: np.ndarray, got: np.ndarray) -> np.ndarray:
    """Return how far two arrays are apart, relative to the larger of 1 and the truth; NaN and infinities are equal."""
    with np.errstate(invalid="ignore", over="ignore"):
        apart = np.abs(got - truth) / np.maximum(1.0, np.abs(truth))
    same = (truth == got) | (np.isnan(truth) & np.isnan(got))
    return np.where(same, 0.0, np.where(np.isnan(apart), np.inf, apart))
