"""Do the inputs react to the outputs? What is new in an input, against the residuals around it.

What an open loop leaves as residuals knows nothing of the inputs. In a closed loop, gusts are in the residuals and in
what the input does beyond its own past (C. W. J. Granger, Econometrica 37, 1969). The residuals are smoothed over some
samples, one number per output: many lags would dilute the test. What is new in the input is clipped, so that the steps
of a pilot do not drown a damper that works at every sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from testbench.core.record import FloatArray
from testbench.estimators.coloured_fit import settled
from testbench.estimators.residuals import Autoregression

_PAST = 40  # samples of its own past that may explain an input
_ROUNDS = 5
_CLIP = 2.5  # robust standard deviations of what is new in an input
_SMOOTH = 2.0  # samples, standard deviation of the window over the residuals
_HELD = 0.5  # an input that stays exactly where it was in more than half of its samples follows no noisy output


class Feedback(NamedTuple):
    """Which input reacts, the share of what is new in it that the residuals explain, and the test's statistic."""

    at: int
    share: float
    statistic: float
    degrees: int


def strongest(
    inputs: Sequence[FloatArray], left: Sequence[FloatArray], good: Sequence[NDArray[np.bool_]], noise: Autoregression
) -> Feedback | None:
    """Return the input that reacts most; None where white residuals or held inputs leave nothing to test.

    Args:
        inputs: (N, m) per record.
        left: residuals (p, N) per record.
        good: (N,) per record, samples that count.
        noise: autoregression of the residuals.
    """
    if not len(noise.A):
        return None
    smooth = [gaussian_filter1d(r, _SMOOTH, axis=1).T for r in left]
    rows = [settled(g, min(_PAST, len(g) // 8)) for g in good]
    lags = min(_PAST, min(len(g) for g in good) // 8)
    found = []
    for j in range(inputs[0].shape[1]):
        if np.mean(np.concatenate([np.diff(u[:, j]) == 0.0 for u in inputs])) > _HELD:
            continue
        past = np.vstack([_past(u[:, j], lags)[r] for u, r in zip(inputs, rows, strict=True)])
        now = np.concatenate([u[r, j] for u, r in zip(inputs, rows, strict=True)])
        known = np.vstack([x[r] for x, r in zip(smooth, rows, strict=True)])
        if len(now) > 2 * (past.shape[1] + known.shape[1]):
            found.append(_test(j, past, now, known))
    return max(found, key=lambda f: f.statistic, default=None)


def _past(u: FloatArray, lags: int) -> FloatArray:
    """Return the samples before (N, lags + 1) and a constant; zeros before the record."""
    out = np.ones((len(u), lags + 1))
    for k in range(1, lags + 1):
        out[:, k - 1] = np.concatenate([np.zeros(k), u[:-k]])
    return out


def _test(j: int, past: FloatArray, now: FloatArray, known: FloatArray) -> Feedback:
    weight = np.ones(len(now))
    for _ in range(_ROUNDS):
        b = np.linalg.lstsq(past * weight[:, None], now * weight, rcond=1e-10)[0]
        new = now - past @ b
        size = _CLIP * 1.4826 * float(np.median(np.abs(new)))
        if size <= 0.0:
            break
        weight = np.sqrt(np.minimum(1.0, size / np.maximum(np.abs(new), 1e-300)))
    clipped = np.clip(new, -size, size) if size > 0.0 else new
    Q = np.linalg.qr(past)[0]
    clipped, known = clipped - Q @ (Q.T @ clipped), known - Q @ (Q.T @ known)
    rest = clipped - known @ np.linalg.lstsq(known, clipped, rcond=1e-10)[0]
    total = float(clipped @ clipped)
    if total <= 0.0:
        return Feedback(j, 0.0, 0.0, known.shape[1])
    share = 1.0 - float(rest @ rest) / total
    samples = len(now) - past.shape[1] - known.shape[1]
    return Feedback(j, share, -samples * float(np.log(max(1.0 - share, 1e-12))), known.shape[1])
