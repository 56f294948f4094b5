"""Do the inputs react to the outputs? What is new in an input, against the residuals around it.

What an open loop leaves as residuals knows nothing of the inputs. In a closed loop, gusts are in the residuals and in
what the input does beyond its own past (C. W. J. Granger, Econometrica 37, 1969). One number per output is tested, what
moves the aircraft in the residual of the same sample: a damper has sensors of its own, whose noise is not that of the
outputs, which a Wiener filter over this sample and the two before it therefore takes away. Each of these samples by
itself would add degrees of freedom and little news. What is new in the input is clipped, so that the steps of a pilot
do not drown a damper that works at every sample. Where the aircraft bends, steps go with residuals without any loop:
these samples are then left out, though the test misses more loops without them.

An input that moves between samples reaches the outputs before the next sample. Part of one sample's response, anything
from nothing (held inputs) to all of it (inputs that are stamped a sample late), is therefore taken from the residuals
first: the part that leaves least to find. A loop that damps or stiffens has the other sign and is found all the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.causes.coloured_fit import settled
from testbench.estimators.residuals import Autoregression

_PAST = 40  # samples of its own past that may explain an input
_FILTERED = 2  # samples before the present one that tell the noise of sensors from what moves the aircraft
_ROUNDS = 5
_CLIP = 4.0  # robust standard deviations of what is new in an input
_PARTS = (0.0, 0.25, 0.5, 0.75, 1.0)  # of one sample's response that may lie within the sample
_NEWS = 1e-6  # of an input, below which what is new in it is rounding: its past tells all of a multisine of few lines
_HELD = 0.5  # an input that stays exactly where it was in more than half of its samples follows no noisy output


class Feedback(NamedTuple):
    """Which input reacts, the share of what is new in it that the residuals explain, and the test's statistic.

    ``news`` is the (robust) deviation of what is new in it, relative to that of the input.
    """

    at: int
    share: float
    statistic: float
    degrees: int
    news: float = 0.0


def testable(records: Sequence[FlightRecord], inputs: Sequence[str]) -> bool:
    """Return whether any input moves at most samples, as one does that follows outputs with noise."""
    return any(not _held([r[name] for r in records]) for name in inputs)


def _held(inputs: Sequence[FloatArray]) -> bool:
    return bool(np.mean(np.concatenate([np.diff(u) == 0.0 for u in inputs])) > _HELD)


def strongest(
    inputs: Sequence[FloatArray],
    left: Sequence[FloatArray],
    good: Sequence[NDArray[np.bool_]],
    noise: Autoregression,
    first: FloatArray,
    steps: bool = True,
) -> Feedback | None:
    """Return the input that reacts most; None where white residuals or held inputs leave nothing to test.

    Args:
        inputs: (N, m) per record.
        left: residuals (p, N) per record, without what follows inputs of samples before.
        good: (N,) per record, samples that count.
        noise: autoregression of the residuals.
        first: (p, m) how the outputs answer an input one sample after it.
        steps: whether samples in which an input steps count.
    """
    if not len(noise.A):
        return None
    rows = [settled(g, min(2 * _PAST, len(g) // 8)) for g in good]
    lags = min(_PAST, min(len(g) for g in good) // 8)
    left, gain = _moving(left)
    first, found = gain @ first, []
    for j in range(inputs[0].shape[1]):
        if _held([u[:, j] for u in inputs]):
            continue
        past = np.vstack([_past(u[:, j], lags)[r] for u, r in zip(inputs, rows, strict=True)])
        now = np.concatenate([u[r, j] for u, r in zip(inputs, rows, strict=True)])
        known = np.vstack([x.T[r] for x, r in zip(left, rows, strict=True)])
        if len(now) > 2 * (past.shape[1] + known.shape[1]):
            found.append(_test(j, past, now, known, first[:, j], steps))
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
    out = []
    for v in left:
        moved = np.zeros_like(v)
        for k in lags:
            moved[:, k:] += filters[:, k] @ v[:, : v.shape[1] - k]
        out.append(moved)
    return out, filters[:, 0]


def _past(u: FloatArray, lags: int) -> FloatArray:
    """Return the samples before (N, lags + 1) and a constant; zeros before the record."""
    out = np.ones((len(u), lags + 1))
    for k in range(1, lags + 1):
        out[:, k - 1] = np.concatenate([np.zeros(k), u[:-k]])
    return out


def _test(
    j: int, past: FloatArray, now: FloatArray, known: FloatArray, first: FloatArray, steps: bool = True
) -> Feedback:
    weight, new, size = np.ones(len(now)), now, 0.0
    for _ in range(_ROUNDS):
        b = np.linalg.lstsq(past * weight[:, None], now * weight, rcond=1e-10)[0]
        new = now - past @ b
        size = _CLIP * 1.4826 * float(np.median(np.abs(new)))
        if size <= _CLIP * _NEWS * float(np.std(now)):
            return Feedback(j, 0.0, 0.0, known.shape[1])
        weight = np.sqrt(np.minimum(1.0, size / np.maximum(np.abs(new), 1e-300)))
    if not steps:
        counts = np.abs(new) <= size
        past, new, known = past[counts], new[counts], known[counts]
    clipped = np.clip(new, -size, size)
    Q = np.linalg.qr(past)[0]
    clipped, new, known = (x - Q @ (Q.T @ x) for x in (clipped, new, known))
    total, samples = float(clipped @ clipped), len(new) - past.shape[1] - known.shape[1]
    if total <= 0.0:
        return Feedback(j, 0.0, 0.0, known.shape[1])
    rest = total
    for part in _PARTS:
        left = known - part * new[:, None] * first
        rest_of_it = clipped - left @ np.linalg.lstsq(left, clipped, rcond=1e-10)[0]
        rest = max(rest if part else 0.0, float(rest_of_it @ rest_of_it))
    share = max(1.0 - rest / total, 0.0)
    news = size / (_CLIP * float(np.std(now)))
    return Feedback(j, share, -samples * float(np.log(max(1.0 - share, 1e-12))), known.shape[1], news)
