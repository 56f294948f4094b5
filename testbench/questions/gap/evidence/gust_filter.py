"""Kalman filters of the believed aircraft in turbulence: innovations of residuals, white with variance one.

The filter about trim is cheap to set up; it tells how much turbulence there is. The filter along the flight of each
record whitens the residuals of hypotheses.

The believed aircraft in Dryden turbulence as a linear model: about trim, or along the flight of a record.

The same gust moves an aircraft differently at another airspeed or angle of attack, so the answer to turbulence changes
within a manoeuvre. To a filter about trim that change looks like an effect that is curved in speed or angle of attack.

Where recorded surfaces drive the aircraft, their noise moves the prediction as a gust would: it is a further input,
white from sample to sample, beside a constant error of each surface, which is all that is known of its zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dtbsv

from testbench.core.errors import LimitError
from testbench.core.record import FlightAborted, FlightRecord, FloatArray
from testbench.estimators.parametric.kalman.innovations import sampled_noise, steady_covariance
from testbench.flight.air import scale_lengths, turbulence_rms
from testbench.flight.linear_model import LAW
from testbench.inference.linear import prewhitened
from testbench.information.turbulence import INERTIAL
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.commanded import LATERAL_CHANNELS, jumps, surface_noise
from testbench.questions.gap.flights import linear_along
from testbench.questions.gap.starts import record_key
from testbench.sensors import Sensor, SensorSuite

COMPONENT = (0, 1, 1, 2, 2)  # u, v or w of each state of the forming filters
FORMING = len(COMPONENT)
_LAG_SHARE = 0.2  # of a sample: shorter lags and delays of sensors are left out
# Process noise per step on every state of the aircraft: keeps the filter stable where it feels nothing.
_UNMODELLED = 1e-5
_ZERO = "error of zero of "


class _Linear(NamedTuple):
    """The aircraft linear about k points: A (k, n, n) of the states ``names``, C (k, outputs, n), pitch theta (k,)."""

    names: Sequence[str]
    A: FloatArray
    C: FloatArray
    outputs: Sequence[str]
    theta: FloatArray


@dataclass(frozen=True, eq=False)
class GustModel:
    """x+ = F x + noise of covariance rms^2 Q + Q0, y = H x + white noise of variance 1: residuals in noise units.

    The states are the aircraft's own, as they would be in still air (x - E g is what the air feels, g the gust), errors
    of zero of the surfaces that drive it, those of the gust's forming filters, those of sensor lags, and the noise of
    those surfaces; the first ``moving`` are the aircraft's and the errors of zero, of which nothing is known as a
    record begins, the last ``renewed`` the noise, which is new at every sample. F, Q (k, n, n) and H (k, p, n) belong
    to k points: to one, trim, or to every sample of a record. Residuals of channels whose noise has a ``colour`` (p,)
    are prewhitened (:func:`testbench.inference.linear.prewhitened`).
    """

    F: FloatArray
    Q: FloatArray
    Q0: FloatArray
    H: FloatArray
    moving: int
    renewed: int = 0
    colour: FloatArray = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def at_trim(cls, believed: Believed, height_m: float, dt_s: float) -> GustModel:
        """Put the believed aircraft, linear about trim, into Dryden turbulence of vertical rms 1 m/s."""
        linear, names = believed.linear, _moving(believed)
        i = [linear.states.index(s) for s in names]
        theta = np.array([believed.trimmed.theta])
        A, C = linear.A[np.ix_(i, i)][None], linear.C[:, i][None]
        return cls._of(believed, height_m, dt_s, _Linear(names, A, C, linear.outputs, theta))

    @classmethod
    def along(cls, believed: Believed, height_m: float, record: FlightRecord, suite: SensorSuite) -> GustModel:
        """Do the same along the aircraft's flight through the commands of a record, linear about every sample.

        It is read by the sensors of ``suite``.
        """
        believed = believed.at(record)
        names, flown = _moving(believed), believed.flown(record)
        A, C, outputs = linear_along(believed.flyer, flown, names)
        linear = _Linear(names, A, C, outputs, flown["theta"])
        found = cls._of(replace(believed, suite=suite), height_m, record.dt_s, linear)
        for i, control in enumerate(believed.surface_noise):
            if control in surface_noise(record):
                found = found._with_jumps(i - len(believed.surface_noise), jumps(record, control))
        return found

    @classmethod
    def _of(cls, believed: Believed, height_m: float, dt_s: float, linear: _Linear) -> GustModel:
        """Join aircraft, gust and sensors.

        The transverse components of the gust are ẋ1 = -a x1 + sqrt(a) n, ẋ2 = a (x1 - x2), w = sqrt(3) x1 +
        (1 - sqrt(3)) x2, the longitudinal one u̇ = -a u + sqrt(2 a) n, with a = V / L (MIL-F-8785C, 3.7.1.2).
        """
        names, A, C = _with_surfaces(believed, linear)
        n, rates = len(names), [believed.condition.V_m_s / length for length in scale_lengths(height_m)]
        G, noise = np.zeros((FORMING, FORMING)), [np.sqrt(2.0 * rates[0])]
        G[0, 0] = -rates[0]
        for k, a in ((1, rates[1]), (3, rates[2])):
            G[k, k] = G[k + 1, k + 1] = -a
            G[k + 1, k] = a
            noise.append(np.sqrt(a))
        E = _felt(names, height_m, linear.theta)
        rows = np.array([0.0 if s in INERTIAL else 1.0 for s in names])[:, None]
        # Climbing is over the ground; attitude angles turn with rates, which E leaves alone.
        sensors = [s for s in believed.suite.sensors if s.channel in believed.outputs]
        own, direct = _read(believed, sensors, C, linear.outputs, E)
        lags = [(k, s.lag_s + s.delay_s) for k, s in enumerate(sensors) if s.lag_s + s.delay_s > _LAG_SHARE * dt_s]
        size, gust = n + FORMING + len(lags), slice(n, n + FORMING)
        M, driven = np.zeros((len(A), size, size)), np.zeros(size)
        M[:, :n, :n], M[:, :n, gust], M[:, gust, gust] = A, -rows * (A @ E), G
        driven[[n, n + 1, n + 3]] = noise
        H = np.concatenate([own, direct, np.zeros((*own.shape[:2], len(lags)))], axis=2)
        for j, (k, lag) in enumerate(lags, n + FORMING):  # a delay stands as a lag: close where turbulence is
            M[:, j] = H[:, k] / lag
            M[:, j, j] = -1.0 / lag
            H[:, k] = np.eye(size)[j]
        F, Q = sampled_noise(M, driven, dt_s)
        Q = 0.5 * (Q + np.swapaxes(Q, -1, -2))
        found = cls(F, Q, np.diag(np.where(np.arange(size) < n, _UNMODELLED**2, 1e-12)), H, n, 0, believed.colours)
        for control, std in believed.surface_noise.items():
            found = found._with_noise(names.index(_ZERO + control), std)
        return found

    def _with_noise(self, zero: int, std: float) -> GustModel:
        """Return the model with the noise of a surface whose error of zero is a state: one more state, new each time.

        A surface moves on straight lines from sample to sample. So within one it does what half of the noise at either
        end would do, were it an error of zero.
        """
        k, size = self.F.shape[:2]
        F, Q, Q0 = (np.zeros((k, size + 1, size + 1)) for _ in range(3))
        half = 0.5 * self.F[:, :, zero]
        half[:, zero] = 0.0
        F[:, :size, :size], Q[:, :size, :size], Q0[:, :size, :size] = self.F, self.Q, self.Q0
        F[:, :size, size] = half
        new = np.column_stack([half, np.ones(k)])
        Q0 += std**2 * new[:, :, None] * new[:, None, :]
        H = np.concatenate([self.H, self.H[:, :, zero : zero + 1]], axis=2)
        return GustModel(F, Q, Q0, H, self.moving, self.renewed + 1, self.colour)

    def _with_jumps(self, noise: int, jumped: FloatArray) -> GustModel:
        """Return the model with what a surface, whose noise is a state, may do besides: its jumps (n,) come anywhere
        within their sample, and a straight line errs by as much as a uniform distribution over them.
        """
        if not jumped.any():
            return self
        does = 2.0 * self.F[:, :, noise]  # the state is that of half of it
        more = (jumped**2 / 12.0)[:, None, None] * does[:, :, None] * does[:, None, :]
        return replace(self, Q0=self.Q0 + more)


def _with_surfaces(believed: Believed, along: _Linear) -> tuple[list[str], FloatArray, FloatArray]:
    """Return names, A and C with a constant error of every surface that drives the aircraft as a further state.

    What a surface does is that about trim.
    """
    linear, driving = believed.linear, list(believed.surface_noise)
    names, A, C = along.names, along.A, along.C
    if not driving:
        return list(names), A, C
    columns = [linear.inputs.index(control) for control in driving]
    states = [linear.states.index(s) for s in names if s in linear.states]
    n, m = len(names), len(driving)
    wide, B = np.zeros((len(A), n + m, n + m)), np.zeros((n, m))
    B[[i for i, s in enumerate(names) if s in linear.states]] = linear.B[np.ix_(states, columns)]
    wide[:, :n, :n], wide[:, :n, n:] = A, B
    D = np.broadcast_to(linear.D[:, columns], (len(C), C.shape[1], m))
    return [*names, *(_ZERO + control for control in driving)], wide, np.concatenate([C, D], axis=2)


def _moving(believed: Believed) -> tuple[str, ...]:
    """Return the states of the aircraft that turbulence moves and the outputs show.

    Servos are among them if something is fed back to their commands, as in some amended aircraft.
    """
    outputs, modes = set(believed.outputs), believed.aircraft.flown_modes()
    count = 0 if modes is None else len(modes)
    modal = [f"{kind}_{i + 1}" for kind in ("eta", "etadot") for i in range(count)]
    return (
        *("u", "w", "q", "theta"),
        *(("h",) if "h" in outputs else ()),
        *modal,
        *(("v", "p", "r", "phi") if {*LATERAL_CHANNELS, "psi", "pdot", "rdot"} & outputs else ()),
        *(m.name for m in believed.aircraft.memories),
        *believed.linear.fed_back,
        *(s for s in believed.linear.states if s.startswith(LAW)),
    )


def _felt(names: Sequence[str], height_m: float, theta: FloatArray) -> FloatArray:
    """Return E (k, n, 5): the air's velocity in body axes, wings level, of the states of the forming filters."""
    rms, transverse = turbulence_rms(1.0, height_m), np.array([np.sqrt(3.0), 1.0 - np.sqrt(3.0)])
    wind = np.zeros((3, FORMING))  # along the heading, to the right, down
    wind[0, 0], wind[1, 1:3], wind[2, 3:5] = rms[0], rms[1] * transverse, rms[2] * transverse
    cos, sin = np.cos(theta)[:, None], np.sin(theta)[:, None]
    felt = {"u": cos * wind[0] - sin * wind[2], "v": wind[1], "w": sin * wind[0] + cos * wind[2]}
    E = np.zeros((theta.size, len(names), FORMING))
    for i, name in enumerate(names):
        E[:, i] = felt.get(name, 0.0)
    return E


def _read(
    believed: Believed, sensors: Sequence[Sensor], C: FloatArray, outputs: Sequence[str], E: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return what the sensors read, in units of their noise, of states (k, p, n) and of gust states (k, p, 5)."""
    trim, names = believed.trimmed.state, list(outputs)
    own, gust = np.zeros((len(C), len(sensors), C.shape[2])), np.zeros((len(C), len(sensors), E.shape[2]))
    for i, sensor in enumerate(sensors):
        factor = sensor.scale / believed.noise_std[i]
        for name, weight in sensor.weights(trim).items():
            c = factor * weight * C[:, names.index(name)]
            own[:, i] += c
            if name not in INERTIAL:
                gust[:, i] -= (c[:, None, :] @ E)[:, 0]
    return own, gust


_WIDE = 100.0  # prior deviation of biases (noise units) and initial states (SI): nothing is known of them
_INDEPENDENT = 1e-6  # share of the largest singular value below which free columns depend on each other


@dataclass(frozen=True, eq=False)
class FlightFilter:
    """Whitens the residuals of records, each along the believed flight through it, in turbulence of a vertical rms.

    Where that flight leaves the limits of the aircraft, it is the filter about trim.
    """

    believed: Believed
    rms_m_s: float
    height_m: float
    suite: SensorSuite  #: that reads them
    _along: dict[str, GustFilter] = field(default_factory=dict)

    def whiten(self, record: FlightRecord, residuals: FloatArray) -> FloatArray:
        """Return the white innovations of ``residuals`` (n, p), see :meth:`GustFilter.whiten`."""
        return self._of(record).whiten(residuals)

    def surface_errors(self, record: FlightRecord, residuals: FloatArray) -> dict[str, FloatArray]:
        """Return what ``residuals`` (n, p) say of the noise of driving surfaces: control -> true less recorded (n,)."""
        return dict(zip(self.believed.surface_noise, self._of(record).renewing(residuals).T, strict=True))

    def _of(self, record: FlightRecord) -> GustFilter:
        key = record_key(record)
        if key not in self._along:
            try:
                model = GustModel.along(self.believed, self.height_m, record, self.suite)
            except (FlightAborted, LimitError):
                there = replace(self.believed.at(record), suite=self.suite)
                model = GustModel.at_trim(there, self.height_m, record.dt_s)
            self._along[key] = GustFilter.of(model, self.rms_m_s, self.believed.taken(record))
        return self._along[key]


@dataclass(frozen=True, eq=False)
class GustFilter:
    """The Kalman predictor of a gust model over n samples, x+ = F x + K e, e = y - H x, and S the covariance of e."""

    K: FloatArray  # (n, states, p) gains; zero in the columns of samples that were not taken
    W: FloatArray  # (n, p, p) S^(-1/2); the same
    H: FloatArray  # (n, p, states)
    log_dets: FloatArray  # (n,) log det S
    renewed: FloatArray  # (n, m, states) covariance of the states that are new at every sample with all of them
    _band: FloatArray  # I - (F - K H), all samples stacked: lower triangular, unit diagonal, by diagonals
    _put_in: FloatArray  # (n p, m) what biases and the aircraft's initial state put into innovations

    @classmethod
    def of(cls, model: GustModel, rms_m_s: float, valid: NDArray[np.bool_]) -> GustFilter:
        """Return the filter in turbulence of a vertical rms over samples (n, p) of which those ``valid`` were taken.

        It begins as the steady filter of the model's first point. Of a model about trim it stays that one where no
        sample is missing.
        """
        n, p = valid.shape
        known = size = model.F.shape[1]
        F, H = np.broadcast_to(model.F, (n, size, size)), np.broadcast_to(model.H, (n, p, size))
        Q = np.broadcast_to(rms_m_s**2 * model.Q + model.Q0, F.shape)
        if model.colour.any():
            F, H, Q = _prewhitened(F, H, Q, model.colour, valid)
            size = F.shape[1]
        P = P0 = steady_covariance(F[0], H[-1], Q[0], np.ones(p))
        if len(model.F) == 1 and valid.all():
            K, W, log_det = (np.broadcast_to(g, (n, *np.shape(g))) for g in _gain(F[0], P, H[-1], valid[0]))
            if model.colour.any():  # the first sample follows none
                K, W, log_det = K.copy(), W.copy(), log_det.copy()
                K[0], W[0], log_det[0] = _gain(F[0], P, H[0], valid[0])
        else:
            K, W, log_det = np.empty((n, size, p)), np.empty((n, p, p)), np.empty(n)
            for k in range(n):
                K[k], W[k], log_det[k] = _gain(F[k], P, H[k], valid[k])
                M = F[k] - K[k] @ H[k]
                P = M @ P @ M.T + K[k] @ K[k].T + Q[k]
        band = np.zeros((2 * size, n * size), order="F")
        band[0] = 1.0
        M = F - K @ H
        for i in range(size):
            for j in range(size):
                band[size + i - j, j : (n - 1) * size : size] = -M[:-1, i, j]
        new = slice(known - model.renewed, known)
        renewed = np.concatenate([P0[None, new], Q[:-1, new]])
        alone = cls(K, W, H, log_det, renewed, band, np.zeros((n * p, 0)))
        steady = (prewhitened(np.where(valid, row, 0.0), model.colour, valid) for row in np.eye(p))
        biases = (alone._innovations(x, np.zeros(size)) for x in steady)
        starts = (alone._innovations(np.zeros((n, p)), x0) for x0 in np.eye(size)[: model.moving])
        return cls(K, W, H, log_det, renewed, band, np.column_stack([c.ravel() for c in (*biases, *starts)]))

    def first(self, n: int) -> GustFilter:
        """Return the filter of the first n samples alone: what comes later changes nothing in it."""
        _, p, size = self.H.shape
        band, put_in = self._band[:, : n * size], self._put_in[: n * p]
        return GustFilter(self.K[:n], self.W[:n], self.H[:n], self.log_dets[:n], self.renewed[:n], band, put_in)

    @cached_property
    def log_det(self) -> float:
        """Log det of the covariance of all samples, biases and initial states that are not known being part of it.

        What turbulence does in a short record is much like what these do. Were they taken out of the innovations
        alone, its rms would be too small (D. A. Harville, 1977): with their wide prior the likelihood is that of REML.
        """
        Z = _WIDE * self._put_in
        return float(np.sum(self.log_dets)) + float(np.linalg.slogdet(np.eye(Z.shape[1]) + Z.T @ Z)[1])

    @cached_property
    def _free(self) -> FloatArray:
        """Orthonormal directions (n p, m) that biases and initial states put into innovations."""
        norm = np.linalg.norm(self._put_in, axis=0)
        U, s, _ = np.linalg.svd(self._put_in[:, norm > 1e-9] / norm[norm > 1e-9], full_matrices=False)
        return np.asarray(U[:, s > _INDEPENDENT * s[0]])

    def whiten(self, residuals: FloatArray) -> FloatArray:
        """Return S^(-1/2) times the innovations of ``residuals`` (n, p), biases and initial states taken out by least
        squares; zero where a sample was not taken.
        """
        flat = self._innovations(residuals, np.zeros(self.H.shape[2])).ravel()
        return np.asarray(flat - self._free @ (self._free.T @ flat)).reshape(residuals.shape)

    def renewing(self, residuals: FloatArray) -> FloatArray:
        """Return the likeliest values (n, m) of the states that are new at every sample, by the whole of a record.

        They are covariances times adjoints of the filter's states, which white innovations drive backwards in time
        (A. E. Bryson and M. Frazier, Smoothing for linear and nonlinear dynamic systems, 1963).
        """
        n, _, size = self.H.shape
        put_in = np.swapaxes(self.H, 1, 2) @ np.swapaxes(self.W, 1, 2) @ self.whiten(residuals)[:, :, None]
        adjoint = dtbsv(2 * size - 1, self._band, put_in.ravel(), lower=1, trans=1, diag=1).reshape(n, size)
        return np.asarray((self.renewed @ adjoint[:, :, None])[:, :, 0])

    def _innovations(self, y: FloatArray, x0: FloatArray) -> FloatArray:
        n, _, size = self.H.shape
        drive = np.concatenate([x0[None], (self.K[:-1] @ y[:-1, :, None])[:, :, 0]])
        x = dtbsv(2 * size - 1, self._band, drive.ravel(), lower=1, diag=1).reshape(n, size)
        return np.asarray(self.W @ (y - (self.H @ x[:, :, None])[:, :, 0])[:, :, None])[:, :, 0]


def _prewhitened(
    F: FloatArray, H: FloatArray, Q: FloatArray, colour: FloatArray, valid: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return F, H and Q of prewhitened readings: what coloured channels read last is a further state of each."""
    on = np.flatnonzero(colour)
    (n, p, size), m = H.shape, on.size
    wide, read, noise = np.zeros((n, size + m, size + m)), np.zeros((n, p, size + m)), np.zeros((n, size + m, size + m))
    wide[:, :size, :size], wide[:, size:, :size], noise[:, :size, :size] = F, H[:, on], Q
    noise[:, size:, size:] = 1e-12 * np.eye(m)
    a = np.where(np.concatenate([np.zeros((1, p), dtype=bool), valid[1:] & valid[:-1]]), colour, 0.0)
    over = 1.0 / np.sqrt(1.0 - a**2)
    read[:, :, :size] = over[:, :, None] * H
    read[:, on, size + np.arange(m)] = -(a * over)[:, on]
    return wide, read, noise


def _gain(
    F: FloatArray, P: FloatArray, H: FloatArray, taken: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray, float]:
    """Return the predictor's gain (n, p), S^(-1/2) (p, p), zero in the columns of samples that were not taken, and
    log det S of those that were.
    """
    K, W = np.zeros((F.shape[0], H.shape[0])), np.zeros((H.shape[0], H.shape[0]))
    h = H[taken]
    values, vectors = np.linalg.eigh(h @ P @ h.T + np.eye(h.shape[0]))
    W[np.ix_(taken, taken)] = (vectors / np.sqrt(values)) @ vectors.T
    K[:, taken] = F @ P @ h.T @ (vectors / values) @ vectors.T
    return K, W, float(np.sum(np.log(values)))
