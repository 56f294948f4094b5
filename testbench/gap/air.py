"""The air that was flown through: does it move, how much, and residuals as they would be had it stood still.

Turbulence reaches every channel through the aircraft, so that a gap in still air and a gust look alike to a test that
takes residuals for white noise. Two things tell them apart. A gap needs a command: in the quiet flight before the first
one it does not show, turbulence does. And turbulence has a known spectrum (Dryden): in a Kalman filter of the believed
aircraft flying through it, with no more than its rms and height to estimate, the innovations of the residual are white
with covariance S, and S^(-1/2) times them is white noise of variance one (filter error; R. V. Jategaonkar, Flight
Vehicle System Identification, 2nd ed., 2015, chapter 5). The filter is linear: what it takes out of a residual it takes
out of an effect's signature, too, and the likelihoods of hypotheses remain comparable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

from testbench.channels import CONTROLS
from testbench.estimators.trajectories import Trajectories
from testbench.flight import linearise
from testbench.flight.air import scale_lengths, turbulence_rms
from testbench.gap.believed import Believed, quiet_samples
from testbench.gap.gusts import INERTIAL
from testbench.record import FlightRecord, FloatArray
from testbench.scenario import LOWEST_M

FALSE_ALARM = 1e-3  # probability of hearing turbulence in still air
_RMS_M_S = (0.01, 3.0)  # vertical rms that is looked for
_HEIGHTS_M = (15.0, 60.0, 250.0, 700.0)  # above ground; all lengths are 1750 ft from 2000 ft on
_LATERAL = {"beta", "v", "p", "r", "phi", "psi", "ay", "pdot", "rdot"}
Taken = NDArray[np.bool_]  # which samples were taken
_UNMODELLED = (
    1e-5  # process noise per step on every state of the aircraft: keeps the filter stable where it feels nothing
)


@dataclass(frozen=True)
class AirFound:
    """What the residuals say of the air.

    Attributes:
        moves: True if turbulence was found in the quiet flight.
        rms_m_s: vertical rms; 0 if it does not move.
        height_m: above ground, as far as the scale lengths tell it.
        gain: twice the log-likelihood that turbulence gains in the quiet flight.
        threshold: what noise alone exceeds with probability FALSE_ALARM.
        quiet_s: quiet flight that was listened to, all records together.
        in_quiet: False if it was found over all of the records, where it explains more than any effect.
    """

    moves: bool
    rms_m_s: float
    height_m: float
    gain: float
    threshold: float
    quiet_s: float
    in_quiet: bool = True

    @property
    def sentence(self) -> str:
        """What was found, in words."""
        heard = f"twice the log-likelihood gains {self.gain:.3g}, threshold {self.threshold:.3g}"
        if not self.moves:
            return (
                f"no turbulence shows in the {self.quiet_s:.3g} s of quiet flight before the commands ({heard}); the "
                "residuals are held against the noise of the sensors alone"
            )
        where = (
            "the quiet flight before the commands" if self.in_quiet else "the residual, more than any effect explains,"
        )
        return (
            f"the air moved: {where} shows turbulence ({heard}), over all records of {self.rms_m_s:.2g} m/s rms; every "
            "test is made on residuals whitened by a Kalman filter of the believed aircraft in it"
        )


def listen(believed: Believed, records: Sequence[FlightRecord]) -> AirFound:
    """Look for turbulence in the quiet flight before the first commands, and for how much of it in all the records.

    The test is a likelihood ratio of turbulence against none, for which the rms 0 is the edge of what may be: half a
    chi-square with one degree of freedom (Chernoff 1954). Trim errors and biases are free in both.

    Raises:
        FlightAborted, TrimError, LimitError: the believed aircraft cannot fly the measured commands.
        RecordError: a record has less than 0.5 s of quiet flight.
    """
    plain = replace(believed, whiten=None)
    quiet = []
    for record in records:
        n = quiet_samples(record)
        start = record.between(float(record.t_s[0]), float(record.t_s[n - 1]) + 0.5 * record.dt_s)
        quiet.append((start, plain.in_noise_units(start, start.columns(plain.outputs))))  # at trim: means are taken out
    height = max(believed.condition.h_m, LOWEST_M)
    rms, gain = _likeliest(plain, quiet, height)
    threshold = float(chi2.isf(2.0 * FALSE_ALARM, 1))
    heard = AirFound(gain > threshold, rms, height, gain, threshold, sum(r.duration_s for r, _ in quiet))
    return measure(plain, records, heard) if heard.moves else replace(heard, rms_m_s=0.0)


def measure(model: Believed, records: Sequence[FlightRecord], heard: AirFound) -> AirFound:
    """Return ``heard`` with the rms and height that make the residuals of ``model`` on ``records`` likeliest."""
    residuals = _plain_residuals(model, records)
    heights = sorted({heard.height_m, *_HEIGHTS_M})
    found = [(*_likeliest(model, residuals, h), h) for h in heights]
    rms, _, height = max(found, key=lambda f: f[1])
    return replace(heard, rms_m_s=rms, height_m=height)


def listen_again(
    believed: Believed, amended: Believed, records: Sequence[FlightRecord], heard: AirFound, gain: float
) -> AirFound:
    """Return what all of the records say of the air, once something was named.

    Where turbulence was heard, its rms is measured anew beside what was named, as a gap adds to it. Where it was not,
    light turbulence may still be all there is: it does not show in a second or two of quiet flight. It is taken for
    the better explanation if it gains more likelihood on the believed model than what was named.

    Args:
        believed: without what was named.
        amended: with it.
        records: those that it was named from.
        heard: what the quiet flight said.
        gain: fall of chi-square by what was named, 0 if nothing was.
    """
    if heard.moves:
        return measure(amended, records, heard)
    rms, of_turbulence = _likeliest(believed, _plain_residuals(believed, records), heard.height_m)
    if of_turbulence <= max(heard.threshold, gain):
        return heard
    return measure(believed, records, replace(heard, moves=True, rms_m_s=rms, gain=of_turbulence, in_quiet=False))


def _plain_residuals(model: Believed, records: Sequence[FlightRecord]) -> list[tuple[FlightRecord, FloatArray]]:
    plain = replace(model, whiten=None)
    return [(r, plain.residuals(r)) for r in records]


def in_air(believed: Believed, air: AirFound) -> Believed:
    """Return ``believed`` with residuals that are white in ``air``; as it is if the air stands still."""
    if not air.moves:
        return believed
    return replace(believed, whiten=GustFilter.of(believed, air.rms_m_s, air.height_m).whiten)


def _likeliest(
    believed: Believed, residuals: Sequence[tuple[FlightRecord, FloatArray]], height_m: float
) -> tuple[float, float]:
    """Return the rms that is likeliest at one height, and twice the log-likelihood that it gains over none."""
    model = _GustModel.of(believed, height_m, residuals[0][0].dt_s)

    def cost(log_rms: float) -> float:
        return _cost(GustFilter.with_rms(model, float(np.exp(log_rms))), residuals)

    low, high = np.log(_RMS_M_S)
    grid = np.linspace(low, high, 9)
    costs = [cost(x) for x in grid]
    k = int(np.argmin(costs))
    bounds = (grid[max(k - 1, 0)], grid[min(k + 1, grid.size - 1)])
    found = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 0.02})
    still = _cost(GustFilter.with_rms(model, 0.0), residuals)
    return float(np.exp(found.x)), max(still - float(found.fun), 0.0)


def _cost(gusts: GustFilter, residuals: Sequence[tuple[FlightRecord, FloatArray]]) -> float:
    """Return minus twice the log-likelihood of residuals in units of the noise, but for a constant."""
    return sum(float(np.sum(gusts.whiten(record, r) ** 2)) + gusts.log_det(record) for record, r in residuals)


@dataclass(frozen=True, eq=False)
class _GustModel:
    """x+ = F x + noise of covariance rms^2 Q + Q0, y = H x + white noise of variance 1: residuals in noise units.

    The states are the aircraft's own, as they would be in still air (x - E g is what the air feels, g the gust), those
    of the gust's forming filters, and those of sensor lags; the first ``moving`` are the aircraft's.
    """

    F: FloatArray
    Q: FloatArray
    Q0: FloatArray
    H: FloatArray
    moving: int

    @classmethod
    def of(cls, believed: Believed, height_m: float, dt_s: float) -> _GustModel:
        """Put the believed aircraft, linear about trim, into Dryden turbulence of vertical rms 1 m/s.

        Its transverse component is ẋ1 = -a x1 + sqrt(a) n, ẋ2 = a (x1 - x2), w = sqrt(3) x1 + (1 - sqrt(3)) x2, its
        longitudinal one u̇ = -a u + sqrt(2 a) n with a = V / L (MIL-F-8785C, 3.7.1.2).
        """
        linear, V = linearise(believed.aircraft, believed.trimmed), believed.condition.V_m_s
        lateral = bool(_LATERAL & set(believed.outputs))
        modal = [s for s in linear.states if s.startswith("eta")]
        names = ["u", "w", "q", "theta", *(["h"] if {"h"} & set(believed.outputs) else []), *modal]
        names += ["v", "p", "r", "phi"] if lateral else []
        i = [linear.states.index(s) for s in names]
        A, n = linear.A[np.ix_(i, i)], len(names)
        rms, lengths = turbulence_rms(1.0, height_m), scale_lengths(height_m)
        a_u, a_v, a_w = (V / length for length in lengths)
        G = np.zeros((5, 5))
        G[0, 0] = -a_u
        noise = [np.sqrt(2.0 * a_u)]
        for k, a in ((1, a_v), (3, a_w)):
            G[k, k] = G[k + 1, k + 1] = -a
            G[k + 1, k] = a
            noise.append(np.sqrt(a))
        cos, sin = np.cos(believed.trimmed.theta), np.sin(believed.trimmed.theta)
        wind = np.zeros((3, 5))  # along the heading, to the right, down, of the forming filters' states
        wind[0, 0] = rms[0]
        wind[1, 1:3] = rms[1] * np.array([np.sqrt(3.0), 1.0 - np.sqrt(3.0)])
        wind[2, 3:5] = rms[2] * np.array([np.sqrt(3.0), 1.0 - np.sqrt(3.0)])
        felt = {"u": cos * wind[0] - sin * wind[2], "w": sin * wind[0] + cos * wind[2], "v": wind[1]}
        E = np.array([felt.get(s, np.zeros(5)) for s in names])
        rows = np.array([0.0 if s in INERTIAL else 1.0 for s in names])[:, None]
        # Climbing is over the ground; attitude angles turn with rates, which E leaves alone.
        C, direct = _outputs(believed, linear.C[:, i], linear.outputs, E)
        lags = [
            (k, max(s.lag_s + s.delay_s, 1e-9))
            for k, s in enumerate(s for s in believed.suite.sensors if s.channel in believed.outputs)
            if s.lag_s + s.delay_s > 0.2 * dt_s
        ]  # a delay stands as a lag of the same length, which is close where turbulence is
        size = n + 5 + len(lags)
        M, B = np.zeros((size, size)), np.zeros((size, 3))
        M[:n, :n], M[:n, n : n + 5] = A, -rows * (A @ E)
        M[n : n + 5, n : n + 5] = G
        B[[n, n + 1, n + 3], [0, 1, 2]] = noise
        H = np.hstack([C, direct, np.zeros((C.shape[0], len(lags)))])
        for j, (k, lag) in enumerate(lags):
            M[n + 5 + j, :] = H[k] / lag
            M[n + 5 + j, n + 5 + j] = -1.0 / lag
            H[k] = np.eye(size)[n + 5 + j]
        F, Q = _sampled(M, B, dt_s)
        Q0 = np.diag(np.where(np.arange(size) < n, _UNMODELLED**2, 1e-12))
        return cls(F, Q, Q0, H, n)


def _outputs(believed: Believed, C: FloatArray, outputs: Sequence[str], E: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what the sensors read, in units of their noise, of states (p, n) and of gust states (p, 5)."""
    trim = believed.trimmed.state
    own, gust = [], []
    for sensor in believed.suite.sensors:
        if sensor.channel.removesuffix("_cmd") in CONTROLS:
            continue
        row, direct = np.zeros(C.shape[1]), np.zeros(E.shape[1])
        for name, weight in sensor.weights(trim).items():
            c = weight * C[list(outputs).index(name)]
            row += c
            if name not in INERTIAL:
                direct -= c @ E
        factor = sensor.scale / believed.suite.noise_std[sensor.channel]
        own.append(factor * row)
        gust.append(factor * direct)
    return np.array(own), np.array(gust)


def _sampled(M: FloatArray, B: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
    """Return transition and noise covariance over a sample of ẋ = M x + B n (C. F. Van Loan, IEEE TAC 23(3), 1978)."""
    size = M.shape[0]
    block = np.zeros((2 * size, 2 * size))
    block[:size, :size], block[:size, size:], block[size:, size:] = -M, B @ B.T, M.T
    e = expm(block * dt_s)
    F = e[size:, size:].T
    Q = F @ e[:size, size:]
    return F, 0.5 * (Q + Q.T)


@dataclass(frozen=True, eq=False)
class GustFilter:
    """The steady Kalman filter of a gust model; where samples are missing, the filter that knows it.

    Attributes:
        model: what it filters.
        P: (n, n) covariance of the predicted state.
    """

    model: _GustModel
    P: FloatArray
    _bases: dict[tuple[int, bytes], FloatArray] = field(default_factory=dict)
    _gains: dict[bytes, list[tuple[FloatArray, FloatArray]]] = field(default_factory=dict)

    @classmethod
    def of(cls, believed: Believed, rms_m_s: float, height_m: float) -> GustFilter:
        """Return the filter of the believed aircraft in turbulence of a vertical rms."""
        return cls.with_rms(_GustModel.of(believed, height_m, 1.0 / believed.suite.rate_hz), rms_m_s)

    @classmethod
    def with_rms(cls, model: _GustModel, rms_m_s: float) -> GustFilter:
        """Return the filter of a model at one rms."""
        Q = rms_m_s**2 * model.Q + model.Q0
        P = solve_discrete_are(model.F.T, model.H.T, Q, np.eye(model.H.shape[0]))
        return cls(replace(model, Q0=Q), P)

    def whiten(self, record: FlightRecord, residuals: FloatArray) -> FloatArray:
        """Return S^(-1/2) times the innovations of ``residuals`` (n, p), biases and initial states taken out by least
        squares; zero where a sample was not taken.
        """
        valid = self._valid(record, residuals.shape[1])
        white = self._innovations(residuals, valid)
        key = (residuals.shape[0], valid.tobytes() if not valid.all() else b"")
        if key not in self._bases:
            self._bases[key] = self._free(valid)
        basis = self._bases[key]
        flat = white.ravel()
        return (flat - basis @ (basis.T @ flat)).reshape(white.shape)

    def log_det(self, record: FlightRecord) -> float:
        """Return the sum of log det S over the samples of a record."""
        valid = self._valid(record, self.model.H.shape[0])
        if valid.all():
            return -2.0 * len(record) * float(np.linalg.slogdet(self._steady[1])[1])
        return -2.0 * sum(
            float(np.linalg.slogdet(W[np.ix_(v, v)])[1]) for (_, W), v in zip(self._varying(valid), valid, strict=True)
        )

    def _valid(self, record: FlightRecord, p: int) -> Taken:
        index = [k for k, n in enumerate(record.channels) if n.removesuffix("_cmd") not in CONTROLS]
        return record.valid[:, index[:p]]

    @property
    def _steady(self) -> tuple[FloatArray, FloatArray]:
        """Gain of the predictor, F P H' S^-1, and S^(-1/2)."""
        H = self.model.H
        return _gain(self.model.F, self.P, H, np.ones(H.shape[0], bool))

    def _innovations(self, y: FloatArray, valid: Taken) -> FloatArray:
        F, H = self.model.F, self.model.H
        if valid.all():
            K, W = self._steady
            x = Trajectories(F - K @ H, y.shape[0]).forced((y @ K.T)[:, :, None])[:, :, 0]
            return np.asarray((y - x @ H.T) @ W.T)
        out, x = np.zeros_like(y), np.zeros(F.shape[0])
        for k, (K, W) in enumerate(self._varying(valid)):
            e = (y[k] - H @ x) * valid[k]
            out[k] = W @ e
            x = F @ x + K @ e
        return out

    def _varying(self, valid: Taken) -> list[tuple[FloatArray, FloatArray]]:
        """Return gain and S^(-1/2) at every sample, zero for samples that were not taken."""
        key = valid.tobytes()
        if key not in self._gains:
            F, H, P, gains = self.model.F, self.model.H, self.P, []
            for row in valid:
                K, W = _gain(F, P, H, row)
                gains.append((K, W))
                M = F - K @ (H * row[:, None])
                P = M @ P @ M.T + K @ K.T + self.model.Q0
            self._gains[key] = gains
        return self._gains[key]

    def _free(self, valid: Taken) -> FloatArray:
        """Return an orthonormal basis of what biases and the aircraft's initial state put into whitened residuals."""
        n, p = valid.shape
        columns = [self._innovations(np.tile(np.eye(p)[j], (n, 1)) * valid, valid).ravel() for j in range(p)]
        F, H = self.model.F, self.model.H
        gains = [self._steady] * n if valid.all() else self._varying(valid)
        x = np.eye(F.shape[0])[:, : self.model.moving]
        start = np.zeros((n, p, x.shape[1]))
        for k, (K, W) in enumerate(gains):
            seen = H * valid[k][:, None] @ x
            start[k] = W @ seen
            x = F @ x - K @ seen
        free = np.column_stack([*columns, start.reshape(n * p, -1)])
        size = np.linalg.norm(free, axis=0)
        U, s, _ = np.linalg.svd(free[:, size > 1e-9] / size[size > 1e-9], full_matrices=False)
        return np.asarray(U[:, s > 1e-6 * s[0]])


def _gain(F: FloatArray, P: FloatArray, H: FloatArray, taken: Taken) -> tuple[FloatArray, FloatArray]:
    """Return the predictor's gain (n, p) and S^(-1/2) (p, p), zero in the columns of samples that were not taken."""
    K, W = np.zeros((F.shape[0], H.shape[0])), np.zeros((H.shape[0], H.shape[0]))
    h = H[taken]
    values, vectors = np.linalg.eigh(h @ P @ h.T + np.eye(h.shape[0]))
    W[np.ix_(taken, taken)] = (vectors / np.sqrt(values)) @ vectors.T
    K[:, taken] = F @ P @ h.T @ (vectors / values) @ vectors.T
    return K, W
