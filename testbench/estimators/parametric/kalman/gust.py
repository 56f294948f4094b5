"""A gust that turns the flow: one more state of a structure, through which turbulence acts on all equations at once.

    dx/dt = f(x + e g, u, params),    y = h(x + e g, u, params),    dg/dt = -a g + noise

e picks the flow angle (alpha, or beta): the forces feel the angle of the air, the inertial angle plus that of the gust
g, so that the gust enters the equations in the proportion of their own derivatives, Z_alpha to M_alpha. Where the
sensor of the flow angle is inertial (a navigation filter), its output does not feel g; where it is a vane, it does. The
gust is of first order with the bandwidth a, rad/s: for vertical gusts close to Dryden's spectrum with a about V / L
(MIL-F-8785C, 1980).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from testbench.core.record import FloatArray
from testbench.estimators.parametric.structure import AnyArray, LinearStructure, Matrices, ModelStructure, Parameter

Sensor = Literal["inertial", "vane"]
ANGLES = ("alpha", "beta")
BANDWIDTH = "ln_gust_bandwidth"
_MIDDLE, _SPREAD = 1.0, 1.5  # prior of the bandwidth: 1 rad/s, within a factor exp(1.5) of it (judged)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Gust(ModelStructure):
    """The structure with its gust: the state "gust" comes first, the parameter ln a last.

    Attributes:
        calm: the structure without gust.
        angle: index of the state that is the flow angle.
        inertial: (p,) outputs that do not feel the gust.
    """

    calm: ModelStructure
    angle: int
    inertial: tuple[bool, ...]

    @property
    def meaning(self) -> str:
        """That of the structure without gust."""
        return self.calm.meaning

    @property
    def followers(self) -> tuple[str, ...]:
        """Those of the structure without gust."""
        return self.calm.followers

    def at_rest(self, u: FloatArray) -> FloatArray:
        """Return the states ``followers`` where the inputs (m,) have been constant."""
        return self.calm.at_rest(u)

    def derivative(self, x: AnyArray, u: AnyArray, params: AnyArray) -> AnyArray:
        """Return d/dt of gust and states."""
        moved = self.calm.derivative(self._felt(x), u, params[..., :-1])
        gust = -np.exp(params[..., -1]) * x[..., 0]
        return np.concatenate([np.broadcast_to(gust[..., None], (*moved.shape[:-1], 1)), moved], axis=-1)

    def output(self, x: AnyArray, u: AnyArray, params: AnyArray) -> AnyArray:
        """Return the outputs."""
        y = self.calm.output(self._felt(x), u, params[..., :-1])
        return y - np.where(self.inertial, x[..., :1], 0.0)

    def _felt(self, x: AnyArray) -> AnyArray:
        out = x[..., 1:].copy()
        out[..., self.angle] += x[..., 0]
        return out


@dataclass(frozen=True, eq=False, kw_only=True)
class _LinearGust(_Gust, LinearStructure):
    """The same of a linear structure."""

    def matrices(self, params: AnyArray) -> Matrices:
        """Return the matrices of parameters (..., k)."""
        assert isinstance(self.calm, LinearStructure)
        s, lead = self.calm.matrices(params[..., :-1]), params.shape[:-1]
        n, m, p = len(self.calm.states), len(self.inputs), len(self.outputs)
        kind = np.result_type(params, float)
        A, B = np.zeros((*lead, n + 1, n + 1), kind), np.zeros((*lead, n + 1, m), kind)
        C, bx = np.zeros((*lead, p, n + 1), kind), np.zeros((*lead, n + 1), kind)
        A[..., 1:, 1:], A[..., 1:, 0], A[..., 0, 0] = s.A, s.A[..., :, self.angle], -np.exp(params[..., -1])
        C[..., 1:], C[..., 0] = s.C, s.C[..., :, self.angle] - np.array(self.inertial, float)
        B[..., 1:, :], bx[..., 1:] = s.B, s.bx
        return Matrices(A, B, C, s.D, bx, s.by)

    derivative = LinearStructure.derivative
    output = LinearStructure.output


def flow_angle(structure: ModelStructure) -> str | None:
    """Return the state that a gust turns: alpha, else beta, else None."""
    return next((name for name in ANGLES if name in structure.states), None)


def with_gust(structure: ModelStructure, sensor: Sensor, nyquist_rad_s: float) -> ModelStructure:
    """Return a structure that has a flow angle among its states, with a gust.

    Args:
        structure: without gust.
        sensor: what measures the flow angle, if it is an output.
        nyquist_rad_s: upper bound of the gust's bandwidth.
    """
    name = flow_angle(structure)
    assert name is not None
    low, high = np.log(1e-2), np.log(nyquist_rad_s)
    bandwidth = Parameter(BANDWIDTH, min(np.log(_MIDDLE), high - 1.0), low=low, high=high, prior_std=_SPREAD)
    make = _LinearGust if isinstance(structure, LinearStructure) else _Gust
    return make(
        name=structure.name,
        states=("gust", *structure.states),
        inputs=structure.inputs,
        outputs=structure.outputs,
        parameters=(*structure.parameters, bandwidth),
        calm=structure,
        angle=structure.states.index(name),
        inertial=tuple(sensor == "inertial" and output == name for output in structure.outputs),
    )
