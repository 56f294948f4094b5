"""The first steps of every subspace method: scale the records, measure the excitation, decimate.

The model order from singular values.

What it has found.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve, firwin

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.hankel import window_starts
from testbench.estimators.settings import Offset

EXACT = 1e-9
"""Innovations below this share of an output's root mean square are rounding: the output is free of noise."""

_FLOOR = 2.0  # singular values beyond this many noise floors belong to states
_GAP = 3.0  # a fall by this factor from one singular value to the next is a clear gap


def choose_order(values: FloatArray, noisy: bool, most: int) -> tuple[int, str]:
    """Return the order and why, from singular values relative to the noise floor (noise-free: to the largest).

    Raises:
        EstimationError: no singular value stands above the floor.
    """
    floor = _FLOOR if noisy else EXACT
    above = min(int(np.sum(values > floor)), most)
    if above == 0:
        raise EstimationError(
            f"no state exceeds the noise: the largest singular value is {values[0]:.2g} times the noise floor, "
            f"{floor:g} is needed; excite more strongly, or lengthen the future horizon"
        )
    following = np.append(values[1:], 0.0)[:most]
    ratios = (values[:most] / np.maximum(following, 1e-3 * floor))[:above]
    clear = np.flatnonzero(ratios >= _GAP)
    n = int(clear[-1] if clear.size else np.argmax(ratios)) + 1
    kind = "last clear" if clear.size else "widest, not clear"
    return (
        n,
        f"{above} singular values are above the noise floor; the {kind} gap, a factor {ratios[n - 1]:.3g}, follows "
        f"number {n}",
    )


LEAD = {"none": 0, "offset": 1, "trend": 2}
"""Setting ``offset`` -> number of terms (1, t) per record and channel that are estimated along."""

_OVERSAMPLING = 10.0  # sampling rate over bandwidth that automatic decimation aims at
_SHARE = 0.99  # of the power of an input lies within its bandwidth
_HALF = 5  # half length of the anti-alias filter, in samples of the lower rate


class Stretch(NamedTuple):
    """One record, every channel divided by its root mean square over all records."""

    u: FloatArray
    y: FloatArray
    valid_u: NDArray[np.bool_]
    valid_y: NDArray[np.bool_]

    @property
    def both(self) -> FloatArray:
        """[u, y] side by side, (N, m + p)."""
        return np.hstack([self.u, self.y])

    @property
    def good(self) -> NDArray[np.bool_]:
        """(N,) True where every channel was sampled."""
        return np.asarray(self.valid_u.all(axis=1) & self.valid_y.all(axis=1))


def scale(
    records: Sequence[FlightRecord], inputs: Sequence[str], outputs: Sequence[str], offset: Offset = "none"
) -> tuple[list[Stretch], FloatArray, FloatArray]:
    """Return the records scaled, and the root mean squares of inputs (m,) and outputs (p,) over their valid samples.

    With an offset or a trend to be estimated, the mean of each record is taken out first: it says nothing.

    Raises:
        EstimationError: a channel is zero throughout.
    """
    sizes, columns = [], []
    for names in (inputs, outputs):
        parts = [r.select(names) for r in records]
        values = [r.data for r in parts]
        if LEAD[offset]:
            means = [np.mean(r.data, axis=0, where=r.valid | ~r.valid.any(axis=0)) for r in parts]
            values = [v - mean for v, mean in zip(values, means, strict=True)]
        squares = np.sum(
            [np.sum(np.where(r.valid, v, 0.0) ** 2, axis=0) for r, v in zip(parts, values, strict=True)], axis=0
        )
        counts = np.sum([r.valid.sum(axis=0) for r in parts], axis=0)
        for name, square in zip(names, squares, strict=True):
            if square == 0.0:
                raise EstimationError(f"channel '{name}' must move to be modelled, but all its valid samples are zero")
        sizes.append(np.sqrt(squares / counts))
        columns.append([v / sizes[-1] for v in values])
    stretches = [
        Stretch(u, y, r.select(inputs).valid, r.select(outputs).valid)
        for u, y, r in zip(columns[0], columns[1], records, strict=True)
    ]
    return stretches, sizes[0], sizes[1]


def bandwidth(stretches: Sequence[Stretch], dt_s: float) -> float:
    """Return the frequency in Hz below which every input has 99 % of its power (means removed), over all records."""
    width = 0.0
    length = max(len(s.u) for s in stretches)
    for column in range(stretches[0].u.shape[1]):
        power = np.zeros(length // 2 + 1)
        for s in stretches:
            u = s.u[:, column] - s.u[:, column].mean()
            power += np.abs(np.fft.rfft(u, length)) ** 2
        if power.sum() > 0.0:
            share = np.cumsum(power) / power.sum()
            width = max(width, float(np.searchsorted(share, _SHARE)) / (length * dt_s))
    return width


def automatic_stride(stretches: Sequence[Stretch], dt_s: float) -> int:
    """Return the stride that samples the inputs at about ten times their bandwidth, 1 if they are sampled slower."""
    width = bandwidth(stretches, dt_s)
    return max(int(1.0 / (dt_s * _OVERSAMPLING * width) + 1e-6), 1) if width > 0.0 else 1


def check_order(order: int | None, L: int, p: int) -> None:
    """Check an order against future horizon L and p outputs.

    Raises:
        EstimationError: p >= 1 or order <= p (L - 1) does not hold.
    """
    if p == 0:
        raise EstimationError("an estimate needs at least one output channel, got none; name outputs or add sensors")
    if order is not None and not order <= p * (L - 1):
        raise EstimationError(
            f"1 <= order <= outputs x (future_horizon - 1) = {p * (L - 1)} must hold, got {order}; "
            "lengthen the future horizon or lower the order"
        )


def decimate(stretches: Sequence[Stretch], stride: int) -> list[Stretch]:
    """Return the stretches at a rate lower by ``stride``, inputs and outputs through one and the same low pass.

    A symmetric filter of 10 ``stride`` + 1 taps (Hamming window, half power near 0.8 of the new Nyquist frequency).
    The response of a linear system to its filtered input is its filtered output, so the filter does not move the poles.
    Samples within its reach of an invalid one or of an end are marked invalid.
    """
    if stride == 1:
        return list(stretches)
    reach = _HALF * stride
    taps = firwin(2 * reach + 1, 0.8 / stride)
    out = []
    for s in stretches:
        parts = []
        for z, valid in ((s.u, s.valid_u), (s.y, s.valid_y)):
            low = fftconvolve(z, taps[:, None], mode="same", axes=0)[::stride] if len(z) > 2 * reach else z[::stride]
            clear = np.zeros(valid.shape, bool)
            for j in range(valid.shape[1]):
                clear[window_starts(valid[:, j], 2 * reach + 1) + reach, j] = True
            parts.append((low, clear[::stride]))
        (u, valid_u), (y, valid_y) = parts
        out.append(Stretch(u, y, valid_u, valid_y))
    return out


class Outcome(NamedTuple):
    """Matrices in units of the stretches, at the records' rate, and intermediate results."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    K: FloatArray
    found: dict[str, Any]
