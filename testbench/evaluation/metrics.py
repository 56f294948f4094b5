"""How far predicted outputs lie from measured ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray

ComplexArray = NDArray[np.complex128]


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


# --- frequency responses ----------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class BodeError:
    """Errors of a frequency response, per output, over frequencies and inputs."""

    magnitude_db: FloatArray  #: (p,) root mean square of 20 log10 |found / true|
    relative_percent: FloatArray  #: (p,) root mean square of 100 |found - true| / |true|, which counts phase too


def bode_error(found: ComplexArray, true: ComplexArray) -> BodeError:
    """Return the errors of ``found`` (k, p, m) against ``true`` (k, p, m).

    Entries where both are zero (no path from input to output) do not count; where one is, the error is infinite.

    Raises:
        EstimationError: shapes disagree, or there is no frequency.
    """
    found, true = np.asarray(found, dtype=np.complex128), np.asarray(true, dtype=np.complex128)
    if found.shape != true.shape or found.ndim != 3 or found.size == 0:
        raise EstimationError(
            f"frequency responses must share one shape (k, p, m) with k >= 1, got {found.shape} and {true.shape}"
        )
    counts = (found != 0.0) | (true != 0.0)
    number = np.maximum(counts.sum(axis=(0, 2)), 1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        db = np.where(counts, 20.0 * np.log10(np.abs(found) / np.abs(true)), 0.0)
        relative = np.where(counts, np.abs(found - true) / np.abs(true), 0.0)
        return BodeError(
            np.sqrt(np.sum(db**2, axis=(0, 2)) / number), 100.0 * np.sqrt(np.sum(relative**2, axis=(0, 2)) / number)
        )


def zero_order_hold(omega_rad_s: FloatArray, dt_s: float) -> ComplexArray:
    """Return the response of the hold, sinc(w dt / 2) exp(-j w dt / 2), shape (k,).

    A discrete model identified from held inputs contains it: a continuous response G(jw) is comparable after
    multiplication with it (aliases of G beyond the Nyquist frequency neglected). At a tenth of the sample rate it turns
    the phase by 18 deg.
    """
    x = np.asarray(omega_rad_s, dtype=np.float64) * dt_s / 2.0
    return np.asarray(np.sinc(x / np.pi) * np.exp(-1j * x), dtype=np.complex128)
