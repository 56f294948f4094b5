"""Manoeuvres in a long record: stretches in which a control moves beyond its noise, and that begin and end quietly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import channel
from testbench.core.constants import DEG_RAD
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord, FloatArray

WINDOW_S = 0.5  # over which a control's range is taken
QUIET_S = 0.5  # before and after a manoeuvre
JOIN_S = 1.0  # movements closer than this belong together
HOLD_S = 10.0  # the longest time that a control may be held away from rest within one manoeuvre
HELD = 0.25  # of the movement so far: a control further than this from where it was is held, not trimmed
SMALL = 0.1  # of a movement of the same control nearby: what is below it neither is a manoeuvre nor disturbs one
NOISE_QUANTILE = 0.1  # a tenth of the record at least is taken to be quiet
FACTOR = 3.0  # how far beyond the range of its noise a control must move
SMALLEST = {"rad": 0.5 * DEG_RAD, "1": 0.02}
"""The smallest movement that counts, by unit: quantisation and dead bands are below it."""
LOST_S = 0.2  # a longer stretch without samples of a control hides what it did
BUSIEST = 0.6  # a control that moves for a larger part of the record is being used to fly, not to test


@dataclass(frozen=True)
class Manoeuvre:
    """A stretch in which controls move.

    ``start_s`` and ``end_s`` are its first and last movement; ``cut_s`` is what to cut out, with quiet flight before
    and the response after, or None, and ``reason`` says why not. ``amplitude`` is the largest deviation of each
    control from where it was before, in its SI unit.
    """

    controls: tuple[str, ...]
    start_s: float
    end_s: float
    amplitude: tuple[float, ...]
    cut_s: tuple[float, float] | None
    reason: str = ""


@dataclass(frozen=True)
class Search:
    """The manoeuvres of a record, and ``said``: per control the threshold that was used, or why it was not used."""

    manoeuvres: tuple[Manoeuvre, ...]
    said: tuple[str, ...]


@dataclass(frozen=True)
class Cutting:
    """Where manoeuvres are cut out of a record.

    Attributes:
        lead_s: quiet flight before each, s.
        tail_s: response after it, s.
        at: first and last time of each, s of the record, in place of those that would be found.

    Example:
        >>> import testbench as tb
        >>> tb.Cutting(at=((10.0, 25.0),)).lead_s
        2.0
    """

    lead_s: float = 2.0
    tail_s: float = 5.0
    at: tuple[tuple[float, float], ...] = ()


def find_manoeuvres(record: FlightRecord, controls: Sequence[str], lead_s: float = 2.0, tail_s: float = 5.0) -> Search:
    """Find the manoeuvres of a uniformly sampled record.

    A control moves where its range within 0.5 s exceeds 3 times the lowest decile of that range over the record
    (its noise), and at least 0.5 deg or 0.02. Movements belong together if less than 1 s passes between them, or if
    the control is held away from where it was before, up to 10 s. If the record ends within 1 s while it is held away,
    the manoeuvre is not whole. Those below a tenth of another nearby are left out.
    Movements of several controls that overlap, or follow within 1 s, are one manoeuvre; 0.5 s of quiet controls must
    lie before and after it. The thresholds are choices, not results.

    Args:
        record: the record.
        controls: the channels to look at.
        lead_s: undisturbed flight to cut before a manoeuvre, as far as there is any; at least 0.5 s.
        tail_s: response to cut after it, up to the next movement.

    Raises:
        RecordError: the record is not uniformly sampled, or lead_s or tail_s is below 0.5 s.
        ChannelError: a control is not in the record.
    """
    if not (QUIET_S <= lead_s < np.inf and QUIET_S <= tail_s < np.inf):
        raise RecordError(f"lead_s and tail_s must be at least {QUIET_S:g} s and finite, got {lead_s:g} and {tail_s:g}")
    spans, said, known = _moved(record, controls, tail_s)
    groups = _joined(sorted(spans), round(JOIN_S / record.dt_s))
    return Search(tuple(_cut(record, groups, i, known, lead_s, tail_s) for i in range(len(groups))), tuple(said))


def cut_at(record: FlightRecord, controls: Sequence[str], cuts: Sequence[tuple[float, float]]) -> Search:
    """Return what moves within cuts that somebody chose, as :func:`find_manoeuvres` returns what it finds.

    Args:
        record: uniformly sampled.
        controls: the channels to look at.
        cuts: first and last time of each, s of the record.

    Raises:
        RecordError: a cut does not lie in the record, or no control moves in it.
    """
    spans, said, _ = _moved(record, controls, QUIET_S)
    t, out = record.t_s, []
    for low, high in sorted(cuts):
        if not t[0] <= low < high <= t[-1] + record.dt_s:
            raise RecordError(
                f"a cut must be START:END within the record, {t[0]:g} to {t[-1]:g} s, got {low:g}:{high:g}; see --cut"
            )
        own = [(max(t[a], low), min(t[b], high), name) for a, b, name in spans if t[a] < high and t[b] > low]
        if not own:
            raise RecordError(f"a control must move within a cut, got {low:g}:{high:g} s, where none does; see --cut")
        names = tuple(dict.fromkeys(name for *_, name in own))
        inside = record.between(low, high)
        sizes = tuple(float(np.max(np.abs(inside[name] - inside[name][0]))) for name in names)
        first, last = min(a for a, *_ in own), max(b for _, b, _ in own)
        out.append(Manoeuvre(names, float(first), float(last), sizes, (low, high)))
    return Search(tuple(out), tuple(said))


def _moved(
    record: FlightRecord, controls: Sequence[str], tail_s: float
) -> tuple[list[tuple[int, int, str]], list[str], NDArray[np.bool_]]:
    """Return first and last index of each movement with its control, what was used, and where all was taken (n,)."""
    dt = record.dt_s
    said: list[str] = []
    spans: list[tuple[int, int, str]] = []
    known: NDArray[np.bool_] = np.ones(len(record), bool)
    for name in controls:
        x = record[name]
        taken = record.valid[:, record.channels.index(name)]
        known &= ~_in_long_gap(taken, round(LOST_S / dt))
        found, threshold = _movements(x, taken, dt, _smallest(record, name))
        if sum(b - a for a, b in found) > BUSIEST * x.size:
            said.append(f"{name}: moves for more than {100 * BUSIEST:g} % of the record, not used to find manoeuvres")
            continue
        often = _times(len(found))
        said.append(f"{name}: moves where its range within {WINDOW_S:g} s exceeds {_sized(name, threshold)}, {often}")
        spans += [(a, b, name) for a, b in _large(x, found, round(tail_s / dt))]
    return spans, said, known


def _times(n: int) -> str:
    return {0: "never", 1: "once", 2: "twice"}.get(n, f"{n} times")


def _sized(name: str, value: float) -> str:
    """Return a size with its unit, degrees for angles."""
    if channel(name).unit == "rad":
        return f"{value / DEG_RAD:.3g} deg"
    return f"{value:.3g}" + ("" if channel(name).unit == "1" else f" {channel(name).unit}")


def _smallest(record: FlightRecord, name: str) -> float:
    return SMALLEST.get(channel(name).unit, 0.0)


def _movements(
    x: FloatArray, taken: NDArray[np.bool_], dt: float, smallest: float
) -> tuple[list[tuple[int, int]], float]:
    """Return first and last index of each movement of one control, and the threshold."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    width = max(3, 2 * round(0.5 * WINDOW_S / dt) + 1)
    spread = maximum_filter1d(x, width) - minimum_filter1d(x, width)
    noise = float(np.quantile(spread[taken], NOISE_QUANTILE)) if taken.any() else 0.0
    threshold = max(FACTOR * noise, smallest)
    moving: NDArray[np.intp] = np.flatnonzero(spread > threshold)
    if not moving.size:
        return [], threshold
    half = width // 2
    pieces = [(int(p[0]) + half, int(p[-1]) - half) for p in np.split(moving, np.flatnonzero(np.diff(moving) > 1) + 1)]
    pieces = [(min(a, b), max(a, b)) for a, b in pieces]
    quiet, join, hold = round(QUIET_S / dt), round(JOIN_S / dt), round(HOLD_S / dt)
    out = [pieces[0]]
    for a, b in pieces[1:]:
        first, last = out[-1]
        if a - last < join:
            out[-1] = (first, max(b, last))
            continue
        rest = float(np.median(x[max(0, first - quiet) : first + 1]))
        held = float(np.median(x[last : a + 1]))
        moved = float(np.max(np.abs(x[first : last + 1] - rest)))
        away = abs(held - rest) > max(0.5 * threshold, HELD * moved)  # else a change of trim
        if away and a - last < hold:
            out[-1] = (first, b)
        else:
            out.append((a, b))
    return out, threshold


def _large(x: FloatArray, found: list[tuple[int, int]], near: int) -> list[tuple[int, int]]:
    """Leave out movements that are small beside another one of the control within ``near`` samples."""
    sizes = [float(np.ptp(x[a : b + 1])) for a, b in found]
    return [
        (a, b)
        for (a, b), size in zip(found, sizes, strict=True)
        if not any(
            size < SMALL * other and a - near < d and c < b + near for (c, d), other in zip(found, sizes, strict=True)
        )
    ]


def _joined(spans: Sequence[tuple[int, int, str]], quiet: int) -> list[tuple[int, int, tuple[str, ...]]]:
    groups: list[tuple[int, int, tuple[str, ...]]] = []
    for a, b, name in spans:
        if groups and a - groups[-1][1] < quiet:
            first, last, names = groups[-1]
            groups[-1] = (first, max(last, b), names if name in names else (*names, name))
        else:
            groups.append((a, b, (name,)))
    return groups


def _cut(
    record: FlightRecord,
    groups: Sequence[tuple[int, int, tuple[str, ...]]],
    i: int,
    taken: NDArray[np.bool_],
    lead_s: float,
    tail_s: float,
) -> Manoeuvre:
    """Return the manoeuvre of one group of movements, with the times to cut it out."""
    t, dt, n = record.t_s, record.dt_s, len(record)
    a, b, names = groups[i]
    quiet = round(QUIET_S / dt)
    before = groups[i - 1][1] if i else -1
    after = groups[i + 1][0] if i + 1 < len(groups) else n
    first = max(before + 1, a - round(lead_s / dt), 0)
    last = min(after - 1, b + round(tail_s / dt), n - 1)
    inside = [g for g in _gaps(taken) if g[0] <= last and g[1] >= first]
    reason = ""
    if any(g[0] <= b and g[1] >= a for g in inside):
        reason = "samples of the controls were lost within it"
    else:
        first = max([first, *(g[1] + 1 for g in inside if g[1] < a)])
        last = min([last, *(g[0] - 1 for g in inside if g[0] > b)])
    if not reason and a - first < quiet:
        reason = f"less than {QUIET_S:g} s of quiet controls before it"
    if not reason and last - b < quiet:
        reason = f"less than {QUIET_S:g} s of quiet controls after it"
    amplitude = []
    for name in names:
        x = record[name]
        off = np.abs(x - np.median(x[max(0, a - quiet) : a + 1]))
        amplitude.append(float(np.max(off[a : b + 1])))
        if not reason and n - 1 - b < round(JOIN_S / dt) and off[-1] > HELD * amplitude[-1]:
            reason = f"the record ends {(n - 1 - b) * dt:.3g} s after it, while {name} is still held away from rest"
    cut = None if reason else (float(t[first]), float(t[last]))
    return Manoeuvre(names, float(t[a]), float(t[b]), tuple(amplitude), cut, reason)


def _gaps(taken: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last index of each stretch of samples that were not taken."""
    edges = np.flatnonzero(np.diff(np.r_[True, taken, True].astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _in_long_gap(taken: NDArray[np.bool_], longest: int) -> NDArray[np.bool_]:
    """Return where more than ``longest`` samples in a row were not taken: a channel logged slowly has short ones."""
    out = np.zeros(taken.size, bool)
    for a, b in _gaps(taken):
        out[a : b + 1] = b - a >= longest
    return out
