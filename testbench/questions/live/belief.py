"""What is believed of the aircraft where it flies: derivatives, and the aircraft that its uncertainty allows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import expm

from testbench.aircraft import Aircraft
from testbench.aircraft.believed import drawn, with_priors
from testbench.core.errors import Refusal
from testbench.core.record import FloatArray
from testbench.estimators.parametric.structure import LinearStructure
from testbench.estimators.parametric.structures.lateral import lateral_directional
from testbench.estimators.parametric.structures.longitudinal import SHORT, longitudinal
from testbench.estimators.parametric.structures.settings import Trim
from testbench.evaluation.derivatives import Derivative, dimensional_derivatives, true_parameters
from testbench.flight import FlightCondition, linearise, trim

DRAWS = 16
"""Aircraft drawn within the uncertainty of the believed one: their spread is known to 18 %."""
_GROWS_1_S = 0.5  # a motion that grows faster is flown by a feedback, which an open loop does not predict
CONTROLS = {"longitudinal": ("de",), "lateral": ("da", "dr")}
WATCHED = {"longitudinal": ("q", "alpha"), "lateral": ("p", "r", "beta")}
"""Plane of motion -> what its response is judged by."""


def structure_of(plane: str, at: Trim, controls: Sequence[str]) -> LinearStructure:
    """Return the equations of a plane of motion about a trim."""
    if plane == "longitudinal":
        return longitudinal(at, states=SHORT, outputs=SHORT, controls=controls)
    return lateral_directional(at, controls=controls)


@dataclass(frozen=True, eq=False)
class Believed:
    """The believed aircraft at a condition, first, and those drawn within its uncertainty.

    Attributes:
        aircraft: itself.
        at: its trim there.
        members: derivatives of each.
        condition: of the trims.
    """

    aircraft: Aircraft
    at: Trim
    members: tuple[tuple[Derivative, ...], ...]
    condition: FlightCondition

    @classmethod
    def of(cls, aircraft: Aircraft, V_m_s: float, h_m: float) -> Believed:
        """Trim and linearise the aircraft.

        Raises:
            TrimError: it does not fly there.
        """
        condition = FlightCondition(V_m_s, h_m)
        trimmed = trim(aircraft, condition)
        members = (tuple(dimensional_derivatives(linearise(aircraft, trimmed), trimmed)),)
        return cls(aircraft, Trim(V_m_s, trimmed.alpha, trimmed.alpha), members, condition)

    def with_draws(self, numbers: Iterable[int]) -> Believed:
        """Return it with further aircraft of its uncertainty: seed 1, draws of these numbers."""
        known, members = with_priors(self.aircraft), list(self.members)
        for k in numbers if known.uncertainty else ():
            try:
                one = drawn(known, 1, k)
                there = trim(one, self.condition)
                members.append(tuple(dimensional_derivatives(linearise(one, there), there)))
            except Refusal:  # a draw that does not fly says nothing of one that does
                continue
        return replace(self, members=tuple(members))

    def values(self, structure: LinearStructure) -> FloatArray:
        """Return the parameters (1 + draws, k) of a structure; those that no aircraft has are zero."""
        told = [true_parameters(structure.meaning, m, self.at.V) for m in self.members]
        return np.array([[t.get(n, 0.0) for n in structure.parameter_names] for t in told])


@dataclass(frozen=True, eq=False)
class Expected:
    """How the believed aircraft, and the drawn ones, respond to what the controls did: their equations in steps."""

    structure: LinearStructure
    params: FloatArray
    dt_s: float

    @cached_property
    def _steps(self) -> tuple[FloatArray, FloatArray]:
        n, m = len(self.structure.states), len(self.structure.inputs)
        A, B = [], []
        for params in self.params:
            s = self.structure.matrices(params)
            block = expm(self.dt_s * np.block([[s.A, s.B], [np.zeros((m, n + m))]]))
            A.append(block[:n, :n])
            B.append(block[:n, n:])
        return np.array(A), np.array(B)

    @property
    def predicts(self) -> bool:
        """Whether the believed aircraft flies by itself."""
        return bool(np.max(np.linalg.eigvals(self.structure.matrices(self.params[0]).A).real) < _GROWS_1_S)

    def respond(self, u: FloatArray) -> FloatArray:
        """Return the states (N, 1 + draws, n) after inputs (N, m), deviations from trim, that begin at trim."""
        A, B = self._steps
        x, out = np.zeros((len(A), A.shape[1])), np.zeros((len(u), len(A), A.shape[1]))
        for k in range(1, len(u)):
            x = np.einsum("mij,mj->mi", A, x) + B @ (0.5 * (u[k] + u[k - 1]))
            out[k] = x
        return out
