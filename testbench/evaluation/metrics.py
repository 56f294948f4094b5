"""How far predicted outputs lie from measured ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray


def mrse_percent(y: FloatArray, yhat: FloatArray, valid: NDArray[np.bool_] | None = None) -> FloatArray:
    """Return the relative squared error of each channel (EOLO paper, equation 4, one term of its sum).

    100 sqrt(sum_k (y_k - yhat_k)^2 / sum_k y_k^2), y being deviations from trim: 0 is perfect, 100 what a prediction
    of zero gives.

    Args:
        y: (n, p) measured.
        yhat: (n, p) predicted. Infinite or undefined values make the channel's error infinite.
        valid: (n, p) True where a sample counts; all if not given.

    Returns:
        (p,) in percent; infinite for a channel that overflows, or that is predicted to move and does not.

    Raises:
        EstimationError: shapes disagree, or a channel has no valid sample.
    """
    return 100.0 * _ratio(y, yhat, valid, centred=False)


def mrse_mean(y: FloatArray, yhat: FloatArray, valid: NDArray[np.bool_] | None = None) -> float:
    """Return the mean relative squared error over the channels in percent (EOLO paper, equation 4)."""
    return float(np.mean(mrse_percent(y, yhat, valid)))


def fit_percent(y: FloatArray, yhat: FloatArray, valid: NDArray[np.bool_] | None = None) -> FloatArray:
    """Return the fit of each channel, 100 (1 - ||y - yhat|| / ||y - mean(y)||), the "percentage of fitness" in use.

    100 is perfect, 0 what the mean of the measured output gives; there is no lower limit.

    Args, Returns and Raises are those of :func:`mrse_percent`, with minus infinity for a channel that overflows.
    """
    return 100.0 - 100.0 * _ratio(y, yhat, valid, centred=True)


def _ratio(y: FloatArray, yhat: FloatArray, valid: NDArray[np.bool_] | None, *, centred: bool) -> FloatArray:
    y, yhat = np.asarray(y, dtype=np.float64), np.asarray(yhat, dtype=np.float64)
    valid = np.ones(y.shape, bool) if valid is None else np.asarray(valid, bool)
    if y.ndim != 2 or y.shape != yhat.shape or y.shape != valid.shape:
        raise EstimationError(
            f"y, yhat and valid must share one shape (n, p), got {y.shape}, {yhat.shape}, {valid.shape}"
        )
    out = np.empty(y.shape[1])
    for i in range(y.shape[1]):
        measured, predicted = y[valid[:, i], i], yhat[valid[:, i], i]
        if measured.size == 0:
            raise EstimationError(f"an error needs valid samples, got none in channel number {i + 1}; leave it out")
        size = _norm(measured - measured.mean() if centred else measured)
        error = _norm(measured - predicted) if np.all(np.isfinite(predicted)) else np.inf
        with np.errstate(over="ignore"):
            out[i] = error / size if size > 0.0 else (0.0 if error == 0.0 else np.inf)
    return out


def _norm(x: FloatArray) -> float:
    """Return the Euclidean norm without overflow on the way."""
    largest = np.max(np.abs(x))
    if largest == 0.0 or not np.isfinite(largest):
        return float(largest)
    with np.errstate(over="ignore", under="ignore"):
        return float(largest * np.sqrt(np.sum((x / largest) ** 2)))
