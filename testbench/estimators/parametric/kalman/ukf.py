"""Unscented Kalman filter for states and parameters, with scaled sigma points.

E. A. Wan and R. van der Merwe, "The Unscented Kalman Filter for Nonlinear Estimation", IEEE AS-SPCC, 2000;
S. J. Julier, "The Scaled Unscented Transformation", American Control Conference, 2002.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.parametric.kalman.augmented import Correction, Gaussian, Plant, Prediction, estimate_by
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.parametric.structure import ModelStructure
from testbench.estimators.settings import UnscentedFilter

_ROUNDING = 1e-9  # eigenvalue of a correlation matrix below zero that is its rounding


@dataclass(frozen=True)
class UnscentedKalmanFilter:
    """Means and covariances through 2 s + 1 points: the mean, and steps along the columns of the covariance's root.

    The steps are sqrt(s + lambda) long, lambda = alpha^2 (s + kappa) - s.
    """

    alpha: float = 0.1
    beta: float = 2.0
    kappa: float = 0.0

    def weights(self, s: int) -> tuple[float, FloatArray, FloatArray]:
        """Return s + lambda, and the weights (2 s + 1,) of means and of covariances."""
        spread = self.alpha**2 * (s + self.kappa)
        mean = np.full(2 * s + 1, 0.5 / spread)
        mean[0] = 1.0 - s / spread
        covariance = mean.copy()
        covariance[0] += 1.0 - self.alpha**2 + self.beta
        return spread, mean, covariance

    def points(self, state: Gaussian) -> FloatArray:
        """Return the sigma points (2 s + 1, s).

        Raises:
            EstimationError: the covariance is not positive.
        """
        spread = self.weights(state.mean.size)[0]
        size = np.sqrt(np.maximum(np.diag(state.covariance), 1e-300))
        correlation = state.covariance / np.outer(size, size)
        try:
            root = np.linalg.cholesky(correlation)
        except np.linalg.LinAlgError as error:
            values, vectors = np.linalg.eigh(correlation)
            if not values[0] > -_ROUNDING:
                raise EstimationError(
                    "the covariance of the unscented filter is no longer positive: the equations are too nonlinear "
                    "over its spread; smaller initial deviations, a larger alpha or the extended filter help"
                ) from error
            root = vectors * np.sqrt(np.maximum(values, 0.0))  # data without noise leave nothing but rounding
        steps = np.sqrt(spread) * (size[:, None] * root).T
        return np.asarray(state.mean + np.vstack([np.zeros_like(state.mean)[None], steps, -steps]))

    def predict(self, plant: Plant, state: Gaussian, u: FloatArray, du: FloatArray) -> Prediction:
        """Return the state one sample later; half of the process noise spreads the points, half comes after."""
        half = np.diag(0.5 * plant.Q)
        points = self.points(Gaussian(state.mean, state.covariance + half))
        after = plant.step(points, u, du)
        _, wm, wc = self.weights(state.mean.size)
        mean = after[0] + wm @ (after - after[0])  # weights are large and cancel: differences keep the digits
        d = after - mean
        spread = (points - state.mean).T @ (wc[:, None] * d)
        # of that, the noise's part belongs to what comes after the state before
        cross = state.covariance @ np.linalg.solve(state.covariance + half, spread) if np.any(plant.Q) else spread
        P = d.T @ (wc[:, None] * d) + half
        return Prediction(Gaussian(mean, 0.5 * (P + P.T)), cross)

    def correct(
        self, plant: Plant, state: Gaussian, u: FloatArray, y: FloatArray, valid: NDArray[np.bool_]
    ) -> Correction:
        """Return the corrected state."""
        points = self.points(state)
        out = plant.output(points, u)[:, valid]
        _, wm, wc = self.weights(state.mean.size)
        mean = out[0] + wm @ (out - out[0])
        d = out - mean
        S = d.T @ (wc[:, None] * d) + np.diag(plant.R[valid])
        cross = (points - state.mean).T @ (wc[:, None] * d)
        K = np.linalg.solve(S, cross.T).T
        v = y[valid] - mean
        P = state.covariance - K @ S @ K.T
        return Correction(Gaussian(state.mean + K @ v, 0.5 * (P + P.T)), v, S)


_DEFAULT = UnscentedFilter()


def estimate(
    records: Sequence[FlightRecord], structure: ModelStructure, settings: UnscentedFilter = _DEFAULT
) -> ParametricModel:
    """Estimate states and free parameters along the records by an unscented Kalman filter, as :func:`.ekf.estimate`.

    Raises:
        EstimationError: kappa against its law, or as :func:`.ekf.estimate`.
        ChannelError: a record lacks a channel.
    """
    size = len(structure.states) + int(structure.free.sum())
    if not size + settings.kappa > 0.0:
        raise EstimationError(f"{size} + kappa > 0 must hold for sigma points, got kappa = {settings.kappa:g}")
    return estimate_by(
        UnscentedKalmanFilter(settings.alpha, settings.beta, settings.kappa), records, structure, settings
    )
