"""The best case: maximum likelihood that knows the aircraft's equations and instruments, started at the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.parametric import input_noise
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.parametric.structure import AnyArray, LinearStructure, Matrices
from testbench.information.aircraft_structure import AircraftStructure
from testbench.questions.compare.seen import Known, structure_seen
from testbench.sensors import Sensor, SensorSuite

_MOST_ITERATIONS = 30  # some ten are enough from the truth, unless the sensors do not tell the parameters


@dataclass(frozen=True, eq=False, kw_only=True)
class LaggedStructure(LinearStructure):
    """The linearised aircraft through first-order lags: tau y' + y = C x + D u where tau > 0.

    Attributes:
        base: the aircraft.
        lags_s: (p,) time constants, 0 for none.
    """

    base: AircraftStructure
    lags_s: FloatArray

    def matrices(self, params: AnyArray) -> Matrices:
        """Return the matrices of parameters (..., k)."""
        m = self.base.matrices(params)
        late = np.flatnonzero(self.lags_s > 0.0)
        shape, n, k = m.A.shape[:-2], m.A.shape[-1], late.size
        rate = 1.0 / self.lags_s[late][:, None]
        A = np.zeros((*shape, n + k, n + k), m.A.dtype)
        A[..., :n, :n] = m.A
        A[..., n:, :n] = m.C[..., late, :] * rate
        A[..., n:, n:] = -np.diag(rate[:, 0])
        B = np.concatenate([m.B, m.D[..., late, :] * rate], axis=-2)
        C = np.concatenate([m.C, np.zeros((*m.C.shape[:-1], k), m.C.dtype)], axis=-1)
        D = m.D.copy()
        C[..., late, :], D[..., late, :] = 0.0, 0.0
        C[..., late, n + np.arange(k)] = 1.0
        bx = np.concatenate([m.bx, np.zeros((*shape, k), m.bx.dtype)], axis=-1)
        return Matrices(A, B, C, D, bx, m.by)

    @property
    def true(self) -> FloatArray:
        """(k,) true values of the parameters."""
        return self.base.true


def lagged_structure(known: Known, sensors: tuple[Sensor, ...], inputs: tuple[str, ...]) -> LaggedStructure:
    """Return the aircraft as the sensors show it, delays apart."""
    base = structure_seen(known, sensors, inputs)
    lags = np.array([s.lag_s for s in sensors])
    return LaggedStructure(
        name="linearised aircraft through its sensors",
        states=(*base.states, *(f"lag_{s.channel}" for s in sensors if s.lag_s > 0.0)),
        inputs=base.inputs,
        outputs=base.outputs,
        parameters=base.parameters,
        base=base,
        lags_s=lags,
    )


def best_estimate(record: FlightRecord, structure: LaggedStructure, suite: SensorSuite) -> ParametricModel:
    """Return the maximum-likelihood estimate from a prepared record, with known noise of outputs and inputs.

    Offsets of the sensors and of noisy inputs are estimated with the parameters.

    Raises:
        EstimationError: the record does not tell them.
    """
    outputs = {name: suite.noise_std[name] for name in structure.outputs}
    noise = noisy_inputs(suite, structure.inputs)
    return input_noise.estimate(record, structure, outputs, noise, max_iterations=_MOST_ITERATIONS)


def noisy_inputs(suite: SensorSuite, inputs: Sequence[str]) -> dict[str, float]:
    """Return the standard deviations of those inputs that have noise."""
    return {name: suite.noise_std[name] for name in inputs if suite.noise_std[name] > 0.0}


def aircraft_poles(model: ParametricModel) -> np.ndarray:
    """Return the poles of the aircraft alone, rad/s, without those of its sensors."""
    structure = model.structure
    assert isinstance(structure, LaggedStructure)
    return np.asarray(np.linalg.eigvals(structure.base.matrices(model.params).A), np.complex128)
