"""Kalman filters of the believed aircraft in turbulence: innovations of residuals, white with variance one.

The filter about trim is cheap to set up; it tells how much turbulence there is. The filter along the flight of each
record whitens the residuals of hypotheses.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are
from scipy.linalg.blas import dtbsv

from testbench.core.record import FlightRecord, FloatArray
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.gust_model import GustModel
from testbench.questions.gap.evidence.gusts import record_key

_INDEPENDENT = 1e-6  # share of the largest singular value below which free columns depend on each other


@dataclass(frozen=True, eq=False)
class FlightFilter:
    """Whitens the residuals of records, each along the believed flight through it, in turbulence of a vertical rms."""

    believed: Believed
    rms_m_s: float
    height_m: float
    _along: dict[str, GustFilter] = field(default_factory=dict)

    def whiten(self, record: FlightRecord, residuals: FloatArray) -> FloatArray:
        """Return the white innovations of ``residuals`` (n, p), see :meth:`GustFilter.whiten`.

        Raises:
            FlightAborted, LimitError: the believed aircraft does not survive the record's commands.
        """
        return self._of(record).whiten(residuals)

    def surface_errors(self, record: FlightRecord, residuals: FloatArray) -> dict[str, FloatArray]:
        """Return what ``residuals`` (n, p) say of the noise of surfaces that drive: control -> true less recorded (n,).

        Raises:
            FlightAborted, LimitError: as :meth:`whiten`.
        """
        return dict(zip(self.believed.surface_noise, self._of(record).renewing(residuals).T, strict=True))

    def _of(self, record: FlightRecord) -> GustFilter:
        key = record_key(record)
        if key not in self._along:
            model = GustModel.along(self.believed, self.height_m, record)
            self._along[key] = GustFilter.of(model, self.rms_m_s, self.believed.taken(record))
        return self._along[key]


@dataclass(frozen=True, eq=False)
class GustFilter:
    """The Kalman predictor of a gust model over n samples, x+ = F x + K e with e = y - H x, and S the covariance of e.

    Attributes:
        K: (n, states, p) gains; zero in the columns of samples that were not taken.
        W: (n, p, p) S^(-1/2); the same.
        H: (n, p, states).
        log_dets: (n,) log det S.
        renewed: (n, m, states) covariance of the states that are new at every sample with all of them.
    """

    K: FloatArray
    W: FloatArray
    H: FloatArray
    log_dets: FloatArray
    renewed: FloatArray
    _band: FloatArray  # I - (F - K H), all samples stacked: lower triangular, unit diagonal, by diagonals
    _put_in: FloatArray  # (n p, m) what biases and the aircraft's initial state put into innovations

    @classmethod
    def of(cls, model: GustModel, rms_m_s: float, valid: NDArray[np.bool_]) -> GustFilter:
        """Return the filter in turbulence of a vertical rms over samples (n, p) of which those ``valid`` were taken.

        It begins as the steady filter of the model's first point. Of a model about trim it stays that one where no
        sample is missing.
        """
        n, p = valid.shape
        size = model.F.shape[1]
        F, H = np.broadcast_to(model.F, (n, size, size)), np.broadcast_to(model.H, (n, p, size))
        Q = np.broadcast_to(rms_m_s**2 * model.Q + model.Q0, F.shape)
        P = P0 = solve_discrete_are(F[0].T, H[0].T, Q[0], np.eye(p))
        if len(model.F) == 1 and valid.all():
            K, W, log_det = (np.broadcast_to(g, (n, *np.shape(g))) for g in _gain(F[0], P, H[0], valid[0]))
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
        new = slice(size - model.renewed, size)
        renewed = np.concatenate([P0[None, new], Q[:-1, new]])
        alone = cls(K, W, H, log_det, renewed, band, np.zeros((n * p, 0)))
        biases = (alone._innovations(np.where(valid, row, 0.0), np.zeros(size)) for row in np.eye(p))
        starts = (alone._innovations(np.zeros((n, p)), x0) for x0 in np.eye(size)[: model.moving])
        return cls(K, W, H, log_det, renewed, band, np.column_stack([c.ravel() for c in (*biases, *starts)]))

    def first(self, n: int) -> GustFilter:
        """Return the filter of the first n samples alone: what comes later changes nothing in it."""
        _, p, size = self.H.shape
        band, put_in = self._band[:, : n * size], self._put_in[: n * p]
        return GustFilter(self.K[:n], self.W[:n], self.H[:n], self.log_dets[:n], self.renewed[:n], band, put_in)

    @property
    def log_det(self) -> float:
        """Sum of log det S over the samples."""
        return float(np.sum(self.log_dets))

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
