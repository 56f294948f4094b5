"""How far an identified frequency response lies from the true one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class BodeError:
    """Errors of a frequency response, per output, over frequencies and inputs.

    Attributes:
        magnitude_db: (p,) root mean square of 20 log10 |found / true|.
        relative_percent: (p,) root mean square of 100 |found - true| / |true|, which counts phase too.
    """

    magnitude_db: FloatArray
    relative_percent: FloatArray


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
