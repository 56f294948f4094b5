"""Commands that a sensor measured: their noise is taken out where they rest.

The number that was sent is exact. The position of a lever or stick is not, and its noise would drive the believed
model: an engine that slows sooner than it gathers speed loses thrust to it, and no quiet flight is seen before the
first command. Where a command varies as white noise of the stated size does, it rests.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.stats import chi2

from testbench.core.channels import CONTROLS
from testbench.core.record import FlightRecord, FloatArray
from testbench.questions.gap.criteria import CRITERIA
from testbench.sensors import SensorSuite

RESTED = "commands_rested"  # in the provenance of a record: control -> noise that was taken out where it rests
_WINDOW_S, _FEWEST = 1.0, 12  # of a window that tells noise from motion, and its fewest samples


def rested(suite: SensorSuite, records: Mapping[str, FlightRecord]) -> dict[str, FlightRecord]:
    """Return records whose commands stand still where no more than the noise of their sensors moves them."""
    told = {s.channel: s.noise_std for s in suite.sensors}
    noise = {c: told[f"{c}_cmd"] for c in CONTROLS if told.get(f"{c}_cmd", 0.0) > 0.0}
    return {n: _rested(r, noise) for n, r in records.items()} if noise else dict(records)


def _rested(record: FlightRecord, noise: Mapping[str, float]) -> FlightRecord:
    done: Mapping[str, float] = record.provenance.get(RESTED, {})
    own = {c: s for c, s in noise.items() if f"{c}_cmd" in record and c not in done}
    if not own:
        return record
    still = {f"{c}_cmd": stilled(record[f"{c}_cmd"], s, record.dt_s) for c, s in own.items()}
    return replace(record.with_columns(still), provenance={**record.provenance, RESTED: {**done, **own}})


def stilled(u: FloatArray, noise_std: float, dt_s: float) -> FloatArray:
    """Return a command (n,) at rest where it rests; where it moves it is as it was measured.

    A rest is held at its mean, unless it drifts by more than the noise of its means: it then follows them. A sample
    that lies beyond the noise belongs to what comes before or after the rest.
    """
    out, window = u.copy(), _window(dt_s)
    for first, last in rests(u, noise_std, dt_s):
        part = u[first:last]
        local, level = _means(part, window), float(part.mean())
        drifts = bool(np.max(np.abs(local - level)) > CRITERIA.stirs * noise_std * np.sqrt(2.0 / window))
        still = local if drifts else np.full_like(part, level)
        out[first:last] = np.where(np.abs(part - still) > CRITERIA.stirs * noise_std, part, still)
    return out


def rests(u: FloatArray, noise_std: float, dt_s: float) -> Iterator[tuple[int, int]]:
    """Yield first sample and end of each stretch of a command (n,) in which noise alone accounts for every second.

    White noise exceeds the limit of its variance once in a thousand times. A hand that is never still does so as well
    where it moves slowly beside the samples, as ``noise_std`` is that of third differences.
    """
    window = _window(dt_s)
    if u.size < window:
        return
    most = noise_std**2 * float(chi2.isf(CRITERIA.false_alarm, window - 1)) / (window - 1)
    quiet = sliding_window_view(u, window).var(axis=1, ddof=1) <= most
    edges = np.flatnonzero(np.diff(np.concatenate([[False], quiet, [False]]).astype(int)))
    yield from ((int(a), int(b) - 1 + window) for a, b in zip(edges[::2], edges[1::2], strict=True))


def _window(dt_s: float) -> int:
    return max(_FEWEST, round(_WINDOW_S / dt_s))


def _means(u: FloatArray, window: int) -> FloatArray:
    """Return the means (n,) of what lies within half a window of every sample."""
    total, k = np.concatenate([[0.0], np.cumsum(u)]), np.arange(u.size)
    first, last = np.maximum(k - window // 2, 0), np.minimum(k + window // 2 + 1, u.size)
    return np.asarray((total[last] - total[first]) / (last - first))
