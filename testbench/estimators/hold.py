"""How an input runs between its samples: held from one to the next, or along straight lines.

A computer holds its commands. A deflection that a sensor has read is smooth; but one that is recorded as it was asked
for, a doublet that jumps from sample to sample, is held too, and straight lines would begin it half a sample early.
Which it is shows in the record: a held input changes by jumps that take one sample, and is still between.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from testbench.core.record import FlightRecord, FloatArray

HELD_SUFFIX = "_cmd"
"""Channels with this ending are commands, held by the computer until the next sample."""


# What tells a held input. All are judged; the tests fly ten kinds of input against them.
_STILL = 5.0  # noise between jumps, in standard deviations of the usual change, within which an input is still
_JUMP = 10.0  # the least jump, in the same
_ROUNDING = 1e-6  # the least change that counts, as a share of the input's range
_BY_JUMPS = 0.9  # share of all movement that jumps must make
_RESTING = 0.4  # least share of changes that are still
_THROUGH = 0.1  # most jumps that go on the same way before or after: a servo, hand or filter between two levels
_JUMPS = 2  # how many jumps between still samples there must be
_QUANTA = 4.5  # jumps all of one size, and a range of more of them than this, are a smooth input that was rounded


def recognised(records: Sequence[FlightRecord], name: str) -> bool:
    """Return whether the channel ``name`` is held from sample to sample, as far as the records show.

    Smooth inputs, with noise or rounded, are not called held: in 1800 draws of smooth kinds (multisines, sweeps, a
    pilot's hand, doublets through a servo) none was, so that the probability is below 0.2 % at 95 % confidence. An
    input that jumps less than twice is not called held either.

    Args:
        records: with one sample time; samples that were not taken do not count.
        name: of the channel.
    """
    found = [_changes(record, name) for record in records]
    d = np.concatenate([part for _, part in found]) if found else np.zeros(0)
    values = np.concatenate([part for part, _ in found]) if found else np.zeros(0)
    if np.count_nonzero(np.isfinite(d)) < 8 or not np.ptp(values) > 0.0:
        return False
    known = np.isfinite(d)
    d = d - np.median(d[known])  # a trend that was removed
    extent = float(np.ptp(values))
    noise = 1.4826 * float(np.median(np.abs(d[known])))
    floor = _ROUNDING * extent
    size = np.where(known, np.abs(d), 0.0)
    still = known & (size <= max(_STILL * noise, floor))
    jumps = size > max(_JUMP * noise, floor)
    moved = float(np.sum(size[known & ~still]))
    if not jumps.any() or np.mean(still[known]) < _RESTING or size[jumps].sum() < _BY_JUMPS * moved:
        return False
    after, before = np.append(d[1:], np.nan), np.append(np.nan, d[:-1])
    moving = known & ~still
    on = np.append(moving[1:], False) & (after * d > 0.0)
    off = np.append(False, moving[:-1]) & (before * d > 0.0)
    if np.mean((on | off)[jumps]) > _THROUGH:
        return False
    alone = jumps & np.append(still[1:], False) & np.append(False, still[:-1])
    if np.count_nonzero(alone) < _JUMPS:
        return False
    quantum = float(np.median(size[jumps]))
    rounded = bool(np.all(np.abs(size[jumps] - quantum) <= 0.05 * quantum + 3.0 * noise))
    return not (rounded and extent > _QUANTA * quantum)


def held(
    inputs: Sequence[str], given: Sequence[bool | None], records: Sequence[FlightRecord]
) -> tuple[tuple[bool, ...], tuple[str, ...]]:
    """Return which inputs are held, and the names of those of which only the records say so.

    Args:
        inputs: (m,) channel names.
        given: (m,) what was asked for; where None, commands are held, and other inputs if the records show it.
        records: what is identified from.
    """
    said = [
        g is None and not n.endswith(HELD_SUFFIX) and recognised(records, n) for n, g in zip(inputs, given, strict=True)
    ]
    out = tuple(n.endswith(HELD_SUFFIX) or s if g is None else g for n, g, s in zip(inputs, given, said, strict=True))
    return out, tuple(n for n, s in zip(inputs, said, strict=True) if s)


def _changes(record: FlightRecord, name: str) -> tuple[FloatArray, FloatArray]:
    """Return the samples taken of a channel, and its changes (N,), NaN beside samples that were not taken."""
    x, taken = record[name], record.valid[:, record.channels.index(name)]
    x = np.where(taken, x, np.nan)
    return x[taken], np.append(np.diff(x), np.nan)


def said_of_hold(recognised: Sequence[str]) -> dict[str, str]:
    """Return what the settings of a model say where the records alone showed that inputs are held."""
    return {"held": f"{', '.join(recognised)} (recognised: they step from sample to sample)"} if recognised else {}
