"""Extended Kalman filter for states and parameters; its Jacobians are exact (complex step through the whole sample).

A. H. Jazwinski, Stochastic Processes and Filtering Theory, 1970; R. V. Jategaonkar, Flight Vehicle System
Identification, 2nd ed., 2015, chapter 7.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.call import with_settings
from testbench.estimators.parametric.kalman.augmented import Correction, Gaussian, Plant, Prediction
from testbench.estimators.parametric.kalman.passes import estimate_by
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


@with_settings(ExtendedFilter)
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
) -> ParametricModel:
    """Estimate states and free parameters along the records by an extended Kalman filter.

    Args:
        records: measured records with one sample time. The filter runs through one after the other: parameters carry
            over, states start anew.
        structure: the equations. Bounds of its parameters are not enforced; the advice names an estimate beyond them.
        measurement_noise: output -> standard deviation; those not named from third differences of the record.
        process_noise: state -> process noise, unit of the state per square root of a second; 0 where not named.
        parameter_drift: free parameter -> random walk, unit per square root of a second; constant where not named.
        initial_std: state or free parameter -> standard deviation of its prior at the start. By default that of the
            parameter; without one, wide enough to move the outputs by as much as they move.
        delays_s: known delay per input, s.
        held: inputs that are held between samples; None takes those called ``*_cmd``. The others run linearly.
        substeps: Runge-Kutta steps per sample.
        smooth: also estimate along each record from all of it (Rauch, Tung and Striebel).
        passes: how often the filter runs over the records; 1 is the filter as it would run in flight. Each further pass
            starts near where the last one ended, and takes measurement noise that is not named from its innovations:
            a single pass from wide beliefs linearises at points far off, and its errors come out too small. Parameters
            that drift get one pass.

    Returns:
        The model with the last estimates, the covariances the filter's own (not corrected for coloured innovations).
        Diagnostics: ``tracks`` (:class:`~.augmented.Track` per record: estimates over time), ``initial_std`` (f,),
        ``residual_std`` (p,) of the innovations, ``normalised_innovations`` (p,) mean square over expected,
        ``whiteness_p`` (p,), ``correlation`` (f, f).

    Raises:
        EstimationError: a name is not one of the structure's, no initial deviation can be told, or the filter diverges.
        ChannelError: a record lacks a channel.
    """
    return estimate_by(
        ExtendedKalmanFilter(),
        "ekf",
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
        settings={},
    )
