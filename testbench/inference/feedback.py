"""Do the inputs react to the outputs? What is new in an input, against the residuals of the same sample.

What an open loop leaves as residuals knows nothing of the inputs. In a closed loop, gusts are in the residuals and in
what the input does beyond its own past (C. W. J. Granger, Econometrica 37, 1969). One number per output is tested, what
moves the aircraft in the residual of the same sample: a damper has sensors of its own, whose noise is not that of the
outputs, which a Wiener filter over this sample and the two before it therefore takes away. What is new in the input is
clipped, so that the steps of a pilot do not drown a damper that works at every sample.

An input that moves between samples reaches the outputs before the next sample. Part of one sample's response, anything
from nothing (held inputs) to all of it (inputs that are stamped a sample late), is therefore taken from the residuals
first: the part that leaves least to find.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FloatArray

_PAST = 40  # samples of its own past that may explain an input
_FILTERED = 2  # samples before the present one that tell the noise of sensors from what moves the aircraft
_ROUNDS = 5
_CLIP = 4.0  # robust standard deviations of what is new in an input
_PARTS = (0.0, 0.25, 0.5, 0.75, 1.0)  # of one sample's response that may lie within the sample
_ROUNDING = 1e-6  # of an input, below which what is new in it is none: its past tells all of a multisine of few lines
_HELD = 0.5  # an input that stays exactly where it was in more than half of its samples follows no noisy output


class Feedback(NamedTuple):
    """Which input reacts, the share of what is new in it that the residuals explain, and 2 ln L of it."""

    at: int
    share: float
    statistic: float
    degrees: int


def steps(inputs: Sequence[FloatArray]) -> bool:
    """Return whether an input, (N,) per record, is held through most samples, as none is that follows noisy outputs."""
    return bool(np.mean(np.concatenate([np.diff(u) == 0.0 for u in inputs])) > _HELD)


def strongest_feedback(
    inputs: Sequence[FloatArray], left: Sequence[FloatArray], good: Sequence[NDArray[np.bool_]], first: FloatArray
) -> Feedback | None:
    """Return the input that reacts most; None where held inputs leave nothing to test.

    Args:
        inputs: (N, m) per record.
        left: residuals (p, N) per record, without what follows inputs of samples before.
        good: (N,) per record, samples with enough others before them that count.
        first: (p, m) how the outputs answer an input one sample after it.
    """
    lags = min(_PAST, min(map(len, inputs)) // 8)
    moving, gain = _moving(left)
    first, found = gain @ first, []
    for j in range(inputs[0].shape[1]):
        if steps([u[:, j] for u in inputs]):
            continue
        rows = [g & (np.arange(len(g)) >= lags) for g in good]
        past = np.vstack([_past(u[:, j], lags)[r] for u, r in zip(inputs, rows, strict=True)])
        now = np.concatenate([u[r, j] for u, r in zip(inputs, rows, strict=True)])
        known = np.vstack([x.T[r] for x, r in zip(moving, rows, strict=True)])
        if len(now) > 2 * (past.shape[1] + known.shape[1]):
            found.append(_test(j, past, now, known, first[:, j]))
    return max(found, key=lambda f: f.statistic, default=None)


def _moving(left: Sequence[FloatArray]) -> tuple[list[FloatArray], FloatArray]:
    """Return the residuals (p, N) per record without white noise, by a causal Wiener filter, and its first gain (p, p).

    What is not white has the autocovariance of the residuals, but at no lag, where it follows on a line from lags one
    and two. Its regression on the present residuals and those before is the filter.
    """
    lags, p = range(_FILTERED + 1), left[0].shape[0]
    R = np.sum([[v[:, k:] @ v[:, : v.shape[1] - k].T for k in (*lags, _FILTERED + 1)] for v in left], axis=0)
    size = np.sqrt(np.maximum(np.diag(R[0]), 1e-300))
    R = R / np.outer(size, size)
    values, vectors = np.linalg.eigh(R[1] + R[1].T - 0.5 * (R[2] + R[2].T))
    now = (vectors * np.maximum(values, 0.0)) @ vectors.T
    whole = np.block([[R[b - a] if b >= a else R[a - b].T for b in lags] for a in lags])
    goal = np.hstack([now, *R[1 : _FILTERED + 1]])
    filters = np.linalg.lstsq(whole.T, goal.T, rcond=1e-10)[0].T.reshape(p, len(lags), p) * size[:, None, None] / size
    out = [
        np.sum([np.pad(filters[:, k] @ v[:, : v.shape[1] - k], ((0, 0), (k, 0))) for k in lags], axis=0) for v in left
    ]
    return out, filters[:, 0]


def _past(u: FloatArray, lags: int) -> FloatArray:
    """Return the samples before (N, lags + 1) and a constant; zeros before the record."""
    return np.column_stack([*(np.concatenate([np.zeros(k), u[:-k]]) for k in range(1, lags + 1)), np.ones(len(u))])


def _test(j: int, past: FloatArray, now: FloatArray, known: FloatArray, first: FloatArray) -> Feedback:
    weight, new, size = np.ones(len(now)), now, 0.0
    for _ in range(_ROUNDS):
        new = now - past @ np.linalg.lstsq(past * weight[:, None], now * weight, rcond=1e-10)[0]
        size = _CLIP * 1.4826 * float(np.median(np.abs(new)))
        if size <= _CLIP * _ROUNDING * float(np.std(now)):
            return Feedback(j, 0.0, 0.0, known.shape[1])
        weight = np.sqrt(np.minimum(1.0, size / np.maximum(np.abs(new), 1e-300)))
    Q = np.linalg.qr(past)[0]
    clipped, new, known = (x - Q @ (Q.T @ x) for x in (np.clip(new, -size, size), new, known))
    total, samples = float(clipped @ clipped), len(new) - past.shape[1] - known.shape[1]
    rests = []
    for part in _PARTS:
        left = known - part * new[:, None] * first
        rests.append(float(np.sum((clipped - left @ np.linalg.lstsq(left, clipped, rcond=1e-10)[0]) ** 2)))
    share = max(1.0 - max(rests) / total, 0.0) if total > 0.0 else 0.0
    statistic = -samples * float(np.log(max(1.0 - share, 1e-12)))
    return Feedback(j, share, statistic, known.shape[1])
