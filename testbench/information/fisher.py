"""Fisher information of an input about parameters, through given sensors: the Cramer-Rao bound before the flight.

    M = sum over sensors and samples of s s' / sigma^2,    s = d y / d params

with exact sensitivities of the linearised aircraft, passed through each sensor's lag, delay and rate; sigma^2 is the
variance of its noise and of its quantisation, q^2 / 12. An estimator must also estimate offsets of the sensors and
initial states. They are projected out (the Schur complement), so that output error can reach the bound. In turbulence
sensitivities pass a Kalman filter first, so that filter error can. E. A. Morelli and V. Klein, Journal of Aircraft
27(8), 1990; R. K. Mehra, IEEE Trans. Automatic Control 19, 1974.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.linalg import solve_triangular

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.parametric.response import Sampling, respond
from testbench.information.aircraft_structure import AircraftStructure
from testbench.information.turbulence import Turbulence
from testbench.sensors import Sensor
from testbench.sensors.sensor import first_order_lag

Criterion = Literal["worst", "D", "A", "E"]
_NOTHING = 1e-12  # scaled information below this share of the largest is none


class Accuracy(NamedTuple):
    """What an input tells: standard errors (k,) of the parameters and covariance (k, k); inf if it tells nothing."""

    std: FloatArray
    covariance: FloatArray

    def relative(self, wanted: FloatArray) -> FloatArray:
        """Return standard errors over wanted ones (k,)."""
        return self.std / wanted


@dataclass(frozen=True, eq=False)
class Experiment:
    """All of a manoeuvre except its input: the aircraft, the sensors, the duration and the sample times.

    The response is linear in the input. It is therefore computed once for a pulse of one sample on each control, and
    every candidate costs one convolution by fast Fourier transform, at the rate of the sensors, even if the input is
    finer.

    Args:
        structure: the linearised aircraft with its free parameters; inputs are held commands or deflections.
        sensors: of the structure's outputs, in the same order.
        dt_s: sample time of the inputs, s.
        samples: number N of samples of the fastest sensors.
        stride: samples of the inputs per sample of the fastest sensors.
        biases: sensors have an unknown constant offset each.
        initial_states: the initial state is unknown, but for the servos, which rest.
        turbulence: that shakes the aircraft; None in still air.

    Raises:
        EstimationError: a sensor without noise or with a rate that does not fit, sensors that are not the outputs, or
            an aircraft that diverges.
    """

    structure: AircraftStructure
    sensors: tuple[Sensor, ...]
    dt_s: float
    samples: int
    stride: int = 1
    biases: bool = True
    initial_states: bool = False
    turbulence: Turbulence | None = None
    sigma: FloatArray = field(init=False, repr=False)
    _transforms: NDArray[np.complex128] = field(init=False, repr=False)
    _size: int = field(init=False, repr=False)
    _weight: FloatArray = field(init=False, repr=False)
    _nuisance: FloatArray = field(init=False, repr=False)
    _white: NDArray[np.complex128] | None = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        if tuple(s.channel for s in self.sensors) != self.structure.outputs:
            raise EstimationError(
                f"one sensor per output is needed, in their order {self.structure.outputs}, got "
                f"{tuple(s.channel for s in self.sensors)}"
            )
        sigma = np.array([np.sqrt(s.noise_std**2 + s.quantum**2 / 12.0) for s in self.sensors])
        if np.any(sigma <= 0.0):
            name = self.sensors[int(np.argmin(sigma))].channel
            raise EstimationError(f"sensor '{name}' is free of noise: its information is without bound; give it noise")
        size = next_fast_len(2 * self.samples, real=True)
        transforms = [rfft(p, size, axis=0) for j in range(len(self.structure.inputs)) for p in self._pulses(j)]
        weight = np.stack([self._taken(i) / sigma[i] for i in range(len(self.sensors))], axis=1)
        for name, value in (("_transforms", np.stack(transforms)), ("_size", size), ("sigma", sigma)):
            object.__setattr__(self, name, value)
        self._weigh(weight)

    def _weigh(self, weight: FloatArray) -> None:
        """Take other weights (N, p): roots of the shares of samples that are delivered, over the noise."""
        object.__setattr__(self, "_weight", weight)
        if self.turbulence is not None:
            had = np.any(weight > 0.0, axis=1)
            # a sensor that delivers every second sample tells as much as one with twice the variance in each
            sigma = 1.0 / np.sqrt(np.mean(weight[had] ** 2, axis=0))
            impulse = self.turbulence.whitener(sigma, self.dt_s * self.stride, self.samples)
            object.__setattr__(self, "_white", rfft(impulse, self._size, axis=0))
        object.__setattr__(self, "_nuisance", self._nuisances(weight))

    def _weighed(self, y: FloatArray) -> FloatArray:
        """Return what sensors show, (N, p, ...), in units of their noise; in turbulence, as white innovations."""
        if self._white is None:
            return np.asarray(y * self._weight.reshape(*self._weight.shape, *[1] * (y.ndim - 2)))
        Y = rfft(y, self._size, axis=0)
        white = irfft(np.einsum("fij,fj...->fi...", self._white, Y), self._size, axis=0)[: self.samples]
        white[~np.any(self._weight > 0.0, axis=1)] = 0.0
        return np.asarray(white)

    def _pulses(self, j: int) -> list[FloatArray]:
        """Return per place within a sample of the sensors the responses (N, p (1 + k)) to a pulse on input j there."""
        k, N, m = len(self.structure.parameters), self.samples * self.stride, len(self.structure.inputs)
        u = np.zeros((N + 1, m))
        u[1, j] = 1.0  # after one sample at rest, which lags start from
        start, held = np.zeros(len(self.structure.states)), np.ones(m, bool)
        r = respond(self.structure, self.structure.true, range(k), u, Sampling(self.dt_s, held), start)
        both = np.concatenate([r.y[:, :, None], r.dparams], axis=2)
        if not np.all(np.isfinite(both)):
            raise EstimationError("the linearised aircraft diverges over this manoeuvre; shorten it")
        fine = np.stack([self._sensed(both[:, i], i) for i in range(len(self.sensors))], axis=1)[1:].reshape(N, -1)
        out = []
        for place in range(self.stride):  # the same response, so many fine samples later
            shifted = np.zeros_like(fine)
            shifted[place:] = fine[: N - place]
            out.append(shifted[:: self.stride])
        return out

    def _sensed(self, x: FloatArray, i: int) -> FloatArray:
        """Return responses (N, ...) of output i as the sensor shows them, lag and delay applied."""
        sensor = self.sensors[i]
        y = sensor.scale * x
        if sensor.lag_s > 0.0:
            y = np.stack([first_order_lag(c, self.dt_s, sensor.lag_s) for c in y.T], axis=1)
        if sensor.delay_s > 0.0:
            t = self.dt_s * np.arange(len(y))
            y = np.stack([np.interp(t - sensor.delay_s, t, c, left=0.0) for c in y.T], axis=1)
        return y

    def _taken(self, i: int) -> FloatArray:
        """Return (N,) the root of the share of samples that sensor i delivers at each instant."""
        sensor = self.sensors[i]
        base = 1.0 / (self.dt_s * self.stride)
        rate = sensor.rate_hz or base
        stride = round(base / rate)
        if abs(stride * rate / base - 1.0) > 1e-6:
            raise EstimationError(
                f"the rate of sensor '{sensor.channel}', {rate:g} Hz, must divide that of the suite, {base:g} Hz"
            )
        taken = np.zeros(self.samples)
        taken[::stride] = np.sqrt(1.0 - sensor.dropout)
        return taken

    def _nuisances(self, weight: FloatArray) -> FloatArray:
        """Return an orthonormal basis (N p, b) of what offsets and initial states do to the weighted outputs."""
        N, p = weight.shape
        columns = []
        if self.biases:
            columns += [np.tile(np.eye(p)[i], (N, 1)) for i in range(p)]
        if self.initial_states:
            felt = start_responses(self.structure, N * self.stride, self.dt_s)
            sensed = np.stack([self._sensed(felt[:, i], i) for i in range(p)], axis=1)[:: self.stride]
            columns += [sensed[:, :, j] for j in range(felt.shape[2])]
        if not columns:
            return np.zeros((N * p, 0))
        X = self._weighed(np.stack(columns, axis=2)).reshape(N * p, -1)
        U, s, _ = np.linalg.svd(X / np.maximum(np.linalg.norm(X, axis=0), 1e-300), full_matrices=False)
        return np.asarray(U[:, s > 1e-10 * s[0]])

    def until(self, samples: int) -> Experiment:
        """Return the experiment that ends after ``samples`` of the fastest sensors; inputs keep their length."""
        weight = self._weight.copy()
        weight[samples:] = 0.0
        return self._weighted_by(weight)

    def with_less_noise(self, i: int, factor: float) -> Experiment:
        """Return the experiment with the noise of sensor ``i`` times ``factor``."""
        weight = self._weight.copy()
        weight[:, i] /= factor
        return self._weighted_by(weight)

    def _weighted_by(self, weight: FloatArray) -> Experiment:
        out = copy(self)
        out._weigh(weight)
        return out

    def response(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the sensed deviations from trim (N, p) and their sensitivities (N, p, k) to an input.

        Args:
            u: (N stride, m) samples, held.
        """
        m, p = u.shape[1], len(self.sensors)
        U = rfft(
            u.reshape(self.samples, self.stride, m).transpose(0, 2, 1).reshape(self.samples, -1), self._size, axis=0
        )
        Y = sum(U[:, j, None] * T for j, T in enumerate(self._transforms) if np.any(U[:, j]))
        y = irfft(Y, self._size, axis=0)[: self.samples].reshape(self.samples, p, -1)
        return y[:, :, 0], y[:, :, 1:]

    @property
    def taken(self) -> FloatArray:
        """(N, p) root of the share of samples that each sensor delivers at each instant, over the sensor's noise."""
        return self._weight

    def sensitivities(self, u: FloatArray) -> FloatArray:
        """Return sensitivities over noise (N, p, k) of an input (N stride, m), nothing projected out."""
        return self._weighed(self.response(u)[1])

    def misled(self, u: FloatArray, difference: FloatArray) -> FloatArray:
        """Return by how much (k,) estimates are off if the sensors show something else than the estimator's model.

        To first order, (S' S)^-1 S' difference, all over noise and nuisances projected out.

        Args:
            u: (N stride, m) the input.
            difference: (N, p) shown less modelled, without noise.
        """
        W = self.weighted(u)
        size = np.linalg.norm(W, axis=0)
        safe = np.where(size > 0.0, size, 1.0)
        off = self._weighed(difference).ravel()
        found, *_ = np.linalg.lstsq(W / safe, off, rcond=1e-9)  # W is free of nuisances; so is what it explains
        return np.asarray(found / safe)

    def weighted(self, u: FloatArray) -> FloatArray:
        """Return sensitivities over noise (N p, k) of an input (N stride, m), nuisances projected out."""
        S = self.sensitivities(u)
        W = S.reshape(-1, S.shape[2])
        return np.asarray(W - self._nuisance @ (self._nuisance.T @ W))

    def information(self, u: FloatArray) -> FloatArray:
        """Return the Fisher information (k, k) of an input (N stride, m), nuisances projected out."""
        S = self.sensitivities(u)
        W = S.reshape(-1, S.shape[2])
        shadow = self._nuisance.T @ W
        M = W.T @ W - shadow.T @ shadow
        return np.asarray(0.5 * (M + M.T))


def start_responses(structure: AircraftStructure, n: int, dt_s: float) -> FloatArray:
    """Return what unit initial states do to the outputs over n samples, (n, p, states); servos begin at rest."""
    m = len(structure.inputs)
    r = respond(
        structure,
        structure.true,
        (),
        np.zeros((n, m)),
        Sampling(dt_s, np.ones(m, bool)),
        np.zeros(len(structure.states)),
    )
    moving = [j for j, state in enumerate(structure.states) if state not in structure.followers]
    return np.asarray(r.dx0[:, :, moving])


def accuracy(information: FloatArray) -> Accuracy:
    """Return standard errors and covariance of an information matrix (k, k), summed over flights if there are several.

    A parameter in a direction without information gets an infinite standard error.
    """
    size = np.sqrt(np.maximum(np.diag(information), 0.0))
    known = size > 0.0
    safe = np.where(known, size, 1.0)
    values, vectors = np.linalg.eigh(information / np.outer(safe, safe))
    lost = values <= _NOTHING * max(float(values[-1]), 1e-300)
    inverse = (vectors[:, ~lost] / values[~lost]) @ vectors[:, ~lost].T
    covariance = inverse / np.outer(safe, safe)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    std[~known | np.any(np.abs(vectors[:, lost]) > 1e-6, axis=1)] = np.inf
    return Accuracy(std, covariance)


def cost(information: FloatArray, gradient: FloatArray, criterion: Criterion) -> float:
    """Return the cost that a design minimises, from the covariance G M^-1 G' of the targets in wanted errors.

    "worst": the largest standard error; "A": root of the mean variance; "E": root of the largest eigenvalue; "D": the
    t-th root of the volume of the error ellipsoid. All scale as 1 / amplitude; inf where nothing is known of some
    direction. With M = 0 it is inf, too.

    Args:
        information: M (k, k).
        gradient: G (t, k), targets in units of their wanted standard errors by parameters.
        criterion: which of the four.
    """
    size = np.sqrt(np.maximum(np.diag(information), 0.0))
    if not np.all(size > 0.0):
        return float("inf")
    scaled = information / np.outer(size, size)
    try:
        L = np.linalg.cholesky(scaled)
    except np.linalg.LinAlgError:
        return float("inf")
    if np.min(np.diag(L)) <= np.sqrt(_NOTHING):
        return float("inf")
    half = solve_triangular(L, (gradient / size).T, lower=True, check_finite=False)  # C = half' half
    if criterion == "worst":
        return float(np.sqrt(np.max(np.sum(half**2, axis=0))))
    if criterion == "A":
        return float(np.sqrt(np.mean(np.sum(half**2, axis=0))))
    values = np.linalg.svd(half, compute_uv=False)
    return float(values[0]) if criterion == "E" else float(np.exp(np.mean(np.log(np.maximum(values, 1e-300)))))
