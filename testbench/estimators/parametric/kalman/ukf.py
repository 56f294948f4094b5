"""Unscented Kalman filter for states and parameters, with scaled sigma points.

E. A. Wan and R. van der Merwe, "The Unscented Kalman Filter for Nonlinear Estimation", IEEE AS-SPCC, 2000;
S. J. Julier, "The Scaled Unscented Transformation", American Control Conference, 2002.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.call import with_settings
from testbench.estimators.parametric.kalman.augmented import Correction, Gaussian, Plant, Prediction
from testbench.estimators.parametric.kalman.passes import estimate_by
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
                    "the covariance of the unscented filter is no longer positive: the equations bend too much over "
                    "its spread; smaller initial deviations, a larger alpha or the extended filter help"
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


@with_settings(UnscentedFilter)
def estimate(
    records: Sequence[FlightRecord],
    structure: ModelStructure,
    *,
    measurement_noise: Mapping[str, float] | None,
    process_noise: Mapping[str, float] | None,
    parameter_drift: Mapping[str, float] | None,
    initial_std: Mapping[str, float] | None,
    delays_s: Mapping[str, float] | None,
    held: Sequence[str] | None,
    substeps: int,
    smooth: bool,
    passes: int,
    alpha: float,
    beta: float,
    kappa: float,
) -> ParametricModel:
    """Estimate states and free parameters along the records by an unscented Kalman filter.

    Args:
        records: see :func:`.ekf.estimate`, as for the arguments up to ``smooth``.
        structure: the equations.
        measurement_noise: output -> standard deviation.
        process_noise: state -> process noise, unit of the state per square root of a second.
        parameter_drift: free parameter -> random walk, unit per square root of a second.
        initial_std: state or free parameter -> standard deviation at the start.
        delays_s: known delay per input, s.
        held: inputs that are held between samples.
        substeps: Runge-Kutta steps per sample.
        smooth: also estimate along each record from all of it.
        passes: how often the filter runs over the records, see :func:`.ekf.estimate`.
        alpha: spread of the sigma points, above 0 and at most 1.
        beta: 2 for Gaussian distributions.
        kappa: second spread; s + kappa > 0 for s states and parameters.

    Returns:
        The model and diagnostics of :func:`.ekf.estimate`.

    Raises:
        EstimationError: alpha or kappa against their laws, or as :func:`.ekf.estimate`.
        ChannelError: a record lacks a channel.
    """
    size = len(structure.states) + int(structure.free.sum())
    if not 0.0 < alpha <= 1.0 or not size + kappa > 0.0:
        raise EstimationError(
            f"0 < alpha <= 1 and {size} + kappa > 0 must hold for sigma points, got {alpha:g} and {kappa:g}"
        )
    return estimate_by(
        UnscentedKalmanFilter(alpha, beta, kappa),
        "ukf",
        records,
        structure,
        measurement_noise=measurement_noise,
        process_noise=process_noise,
        parameter_drift=parameter_drift,
        initial_std=initial_std,
        delays_s=delays_s,
        held=held,
        substeps=substeps,
        smooth=smooth,
        passes=passes,
        settings={"alpha": alpha, "beta": beta, "kappa": kappa},
    )
