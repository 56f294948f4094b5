"""Extended Kalman filter for states and parameters; its Jacobians are exact (complex step through the whole sample).

A. H. Jazwinski, Stochastic Processes and Filtering Theory, 1970; R. V. Jategaonkar, Flight Vehicle System
Identification, 2nd ed., 2015, chapter 7.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.parametric.kalman.augmented import Correction, Gaussian, Plant, Prediction, estimate_by
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.parametric.structure import STEP, ModelStructure
from testbench.estimators.settings import ExtendedFilter


class ExtendedKalmanFilter:
    """First-order filter: means through the equations, covariances through their derivatives at the mean."""

    def predict(self, plant: Plant, state: Gaussian, u: FloatArray, du: FloatArray) -> Prediction:
        """Return P' = J (P + Q/2) J' + Q/2 around the mean one sample later, J its derivative by the mean."""
        s = state.mean.size
        stepped = plant.step(_directions(state.mean), u, du)
        J, half = stepped[:s].imag.T / STEP, np.diag(0.5 * plant.Q)
        cross = state.covariance @ J.T
        P = J @ (state.covariance + half) @ J.T + half
        return Prediction(Gaussian(stepped[s].real, 0.5 * (P + P.T)), cross)

    def correct(
        self, plant: Plant, state: Gaussian, u: FloatArray, y: FloatArray, valid: NDArray[np.bool_]
    ) -> Correction:
        """Return the corrected state, its covariance in Joseph's form, which rounding cannot make negative."""
        s = state.mean.size
        out = plant.output(_directions(state.mean), u)[:, valid]
        H, R = out[:s].imag.T / STEP, np.diag(plant.R[valid])
        v = y[valid] - out[s].real
        S = H @ state.covariance @ H.T + R
        K = np.linalg.solve(S, H @ state.covariance).T
        rest = np.eye(s) - K @ H
        P = rest @ state.covariance @ rest.T + K @ R @ K.T
        return Correction(Gaussian(state.mean + K @ v, 0.5 * (P + P.T)), v, S)


def _directions(mean: FloatArray) -> NDArray[np.complex128]:
    """Return (s + 1, s): the mean with a complex step along each axis, then the mean."""
    return np.asarray(mean + 1j * STEP * np.eye(mean.size + 1, mean.size))


_DEFAULT = ExtendedFilter()


def estimate(
    records: Sequence[FlightRecord], structure: ModelStructure, settings: ExtendedFilter = _DEFAULT
) -> ParametricModel:
    """Estimate states and free parameters along the records by an extended Kalman filter.

    Args:
        records: measured records with one sample time. The filter runs through one after the other: parameters carry
            over, states start anew.
        structure: the equations. Bounds of its parameters are not enforced; the advice names an estimate beyond them.
        settings: noise and initial deviations, as far as they are known.

    Returns:
        The model with the last estimates, the covariances the filter's own (not corrected for coloured innovations).
        Diagnostics: ``tracks`` (:class:`~.augmented.Track` per record: estimates over time), ``initial_std`` (f,),
        ``residual_std`` (p,) of the innovations, ``normalised_innovations`` (p,) mean square over expected,
        ``whiteness_p`` (p,), ``correlation`` (f, f).

    Raises:
        EstimationError: a name is not one of the structure's, no initial deviation can be told, or the filter diverges.
        ChannelError: a record lacks a channel.
    """
    return estimate_by(ExtendedKalmanFilter(), records, structure, settings)
