"""The common part of EKF and UKF: the state with the parameters beside it, and one run over a record.

    z = (x, free parameters),   dz = (f(x, u, params), 0) dt + F dw,   y[i] = h(x[i], u[i], params) + G e[i]

Between samples inputs run linearly or are held; linear structures are solved exactly, others run by classical
Runge-Kutta steps. The process noise of a sample, F F' dt, comes in half before and half after the step (the trapezoidal
rule, exact to the second order in dt).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.parametric.response import runge_kutta, taylor
from testbench.estimators.parametric.structure import Affine, AnyArray, LinearStructure, Matrices, ModelStructure


class Gaussian(NamedTuple):
    """Mean (s,) and covariance (s, s)."""

    mean: FloatArray
    covariance: FloatArray


class Prediction(NamedTuple):
    """The next sample's Gaussian, and the covariance (s, s) of the state before with the one after."""

    state: Gaussian
    cross: FloatArray


class Correction(NamedTuple):
    """Gaussian after a measurement, the innovations (o,) and their covariance (o, o)."""

    state: Gaussian
    innovation: FloatArray
    expected: FloatArray


@dataclass(frozen=True, eq=False)
class Plant:
    """A structure whose free parameters are states.

    Attributes:
        structure: the equations.
        chosen: (f,) indices of the parameters that are states.
        values: (k,) of all parameters; only the fixed ones are used.
        dt_s: sample time, s.
        substeps: Runge-Kutta steps per sample.
        Q: (n + f,) variance of the process noise of one sample.
        R: (p,) variance of the measurement noise.
        affine: the matrices of a linear structure as a sum over its parameters, or None.
    """

    structure: ModelStructure
    chosen: NDArray[np.intp]
    values: FloatArray
    dt_s: float
    substeps: int
    Q: FloatArray
    R: FloatArray
    affine: Affine | None = None

    @property
    def states(self) -> int:
        """Number of states without parameters."""
        return len(self.structure.states)

    def matrices(self, params: AnyArray) -> Matrices:
        """Return the matrices of a linear structure, which are cheap where the parameters stand in them linearly."""
        if self.affine is not None:
            return self.affine.at(params)
        return self.structure.matrices(params)  # type: ignore[attr-defined]

    def split(self, z: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Return states (..., n) and all parameters (..., k) of augmented states (..., n + f)."""
        params = np.array(np.broadcast_to(self.values, (*z.shape[:-1], self.values.size)), z.dtype)
        params[..., self.chosen] = z[..., self.states :]
        return z[..., : self.states], params

    def step(self, z: AnyArray, u: FloatArray, du: FloatArray) -> AnyArray:
        """Return augmented states (..., n + f) one sample later; the parameters stay."""
        x, params = self.split(z)
        if isinstance(self.structure, LinearStructure):
            x = taylor(self.matrices(params), x, u, du, self.dt_s)
        else:
            U, dU = (np.broadcast_to(part, (*z.shape[:-1], part.size)) for part in (u, du))
            x = runge_kutta(self.structure, x, U, dU, params, self.dt_s, self.substeps)
        return np.concatenate([x, z[..., self.states :]], axis=-1)

    def output(self, z: AnyArray, u: FloatArray) -> AnyArray:
        """Return the outputs (..., p)."""
        x, params = self.split(z)
        if isinstance(self.structure, LinearStructure):
            s = self.matrices(params)
            return np.asarray((s.C @ x[..., None])[..., 0] + s.D @ u + s.by)
        return self.structure.output(x, np.broadcast_to(u, (*z.shape[:-1], u.size)), params)


class Filter(Protocol):
    """One kind of Kalman filter."""

    def predict(self, plant: Plant, state: Gaussian, u: FloatArray, du: FloatArray) -> Prediction:
        """Return the state one sample later."""
        ...

    def correct(
        self, plant: Plant, state: Gaussian, u: FloatArray, y: FloatArray, valid: NDArray[np.bool_]
    ) -> Correction:
        """Return the state after the valid ones of the measurements y (p,)."""
        ...


@dataclass(frozen=True, eq=False)
class Track:
    """Estimates along one record.

    Attributes:
        t_s: (N,) times.
        states: (N, n) filtered, with ``states_std`` (N, n).
        parameters: (N, f) of the free parameters, with ``parameters_std`` (N, f).
        covariance: (N, n + f, n + f) of states and parameters together.
        innovations: (N, p), zero where not measured.
        innovations_std: (N, p) that the filter expects, nan-free: zero where not measured.
        smoothed: (N, n + f) states and parameters given the whole record, or None.
        smoothed_covariance: (N, n + f, n + f), or None.
    """

    t_s: FloatArray
    states: FloatArray
    states_std: FloatArray
    parameters: FloatArray
    parameters_std: FloatArray
    covariance: FloatArray
    innovations: FloatArray
    innovations_std: FloatArray
    smoothed: FloatArray | None = None
    smoothed_covariance: FloatArray | None = None


def run(
    kind: Filter,
    plant: Plant,
    start: Gaussian,
    record: FlightRecord,
    u: FloatArray,
    held: NDArray[np.bool_],
    smooth: bool = False,
) -> tuple[Track, Gaussian]:
    """Filter one record from ``start``, which is believed before its first sample, and return its last Gaussian too.

    Raises:
        EstimationError: the estimate diverges, or its covariance stops being one.
    """
    part = record.select(plant.structure.outputs)
    N, s, n, p = len(u), start.mean.size, plant.states, len(plant.structure.outputs)
    du = np.where(held, 0.0, np.diff(u, axis=0, append=u[-1:]))
    mean, covariance = np.zeros((N, s)), np.zeros((N, s, s))
    before: list[Prediction] = []
    innovation, expected = np.zeros((N, p)), np.zeros((N, p))
    state = start
    for k in range(N):
        if k:
            before.append(kind.predict(plant, state, u[k - 1], du[k - 1]))
            state = before[-1].state
        valid = part.valid[k]
        if valid.any():
            state, innovation[k, valid], S = kind.correct(plant, state, u[k], part.data[k], valid)
            expected[k, valid] = np.sqrt(np.diag(S))
        if not np.all(np.isfinite(state.mean)) or np.any(np.diag(state.covariance) < 0.0):
            raise EstimationError(
                f"the filter diverges at t = {record.t_s[k]:g} s; start from better values or smaller deviations, or "
                "raise substeps"
            )
        mean[k], covariance[k] = state
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    back = _smooth(mean, covariance, before) if smooth else (None, None)
    track = Track(record.t_s, mean[:, :n], std[:, :n], mean[:, n:], std[:, n:], covariance, innovation, expected, *back)
    return track, state


def _smooth(mean: FloatArray, covariance: FloatArray, before: Sequence[Prediction]) -> tuple[FloatArray, FloatArray]:
    """Return means and covariances given the whole record (Rauch, Tung and Striebel, AIAA Journal 3, 1965)."""
    m, P = mean.copy(), covariance.copy()
    for k in range(len(mean) - 2, -1, -1):
        ahead = before[k]
        size = np.sqrt(np.maximum(np.diag(ahead.state.covariance), 1e-300))
        # Constant parameters that the data have fixed make the covariance nearly singular: solve for what it holds.
        scaled = ahead.state.covariance / np.outer(size, size)
        gain = ahead.cross / size @ np.linalg.pinv(scaled, rcond=1e-13, hermitian=True) / size
        m[k] = mean[k] + gain @ (m[k + 1] - ahead.state.mean)
        P[k] = covariance[k] + gain @ (P[k + 1] - ahead.state.covariance) @ gain.T
    return m, P
