"""Questions at the door: values that no flight has, and the unit in which they would make sense.

A wrong unit does not fail. It gives derivatives that are wrong by 57 or by 9.81. So every channel is held against
what aircraft do, and against the others (see readings.py). Nothing is changed here; a question says what was got,
what it would mean, how likely that is, and what to set.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import CONTROLS
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord, FloatArray
from testbench.logs.question import FROZEN, MOVING_RAD_S, Question, Signals, beyond, damaged, short, shown
from testbench.logs.readings import Reading, readings

_SLOWEST_HZ, _FASTEST_HZ = 0.2, 20_000.0
_SLOWEST_M_S = 3.0  # nothing that is flown for identification flies slower
_CHANCE = 1e-6  # that a stretch without change is chance
_JUMP = 5.0  # of the usual change between samples, into and out of a stretch without change
_CROSSED = 0.25  # of the range of the channel, where the stretch lies at an end of the record


def signals_of(record: FlightRecord) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Return the channels of a record as signals, without samples that were not taken."""
    taken = {name: record.valid[:, i] for i, name in enumerate(record.channels)}
    return {name: (record.t_s[ok], record[name][ok]) for name, ok in taken.items() if np.count_nonzero(ok) > 1}


def implausible(
    signals: Signals,
    unstated: Collection[str] = (),
    stated: Collection[str] = (),
    found: Sequence[Reading] | None = None,
) -> tuple[Question, ...]:
    """Return the questions that the values of some channels raise, none for a flight that is plausible.

    Args:
        signals: the channels; several of them are also held against each other.
        unstated: channels whose unit nobody stated, which are questioned earlier.
        stated: channels whose unit the writer of the file stated: a few values beyond what flies are no question of it.
        found: readings that are likelier than those by which the channels were read, where they are known already.
    """
    held = {name: (t, x) for name, (t, x) in signals.items() if x.size > 1}
    rates = _clock(held)
    likelier = () if rates else found if found is not None else readings(held, unstated, stated=stated)
    out = [*(reading.question for reading in likelier), *_slow(held)]
    for name, (t, x) in held.items():
        if name not in {question.channel for question in out}:
            out += _range(name, t, x, name in unstated, name in stated)
    still = _frozen_throughout(held)
    out += still
    for name, (t, x) in held.items():
        out += _frozen_stretch(name, t, x)
    return (*rates, *out)


def to_set(file: Path | None) -> Callable[[str, str], str]:
    """Return what to set in a description so that a channel, or the times, are read in another unit."""

    def how(name: str, unit: str) -> str:
        if not unit:
            return "leave the time out (segments) or the channel, or confirm it"
        where = f" in '{file}'" if file else ""
        return f'set time.unit = "{unit}"{where}' if name == "t" else f'set unit = "{unit}" of channel {name}{where}'

    return how


def refusal(file: Path | str, asked: Sequence[str]) -> str:
    """Return the refusal of questions, one a line."""
    count = "one that is not" if len(asked) == 1 else f"{len(asked)} questions"
    return f"every value of '{file}' must be plausible (strict), got {count}:\n  " + "\n  ".join(asked)


def questions_of(
    records: Iterable[tuple[str, FlightRecord]], file: Path | None = None, strict: bool = False
) -> tuple[str, ...]:
    """Return the questions that described records raise, in words, a question of several records once.

    Args:
        records: name and record of each.
        file: the description, for what to set.
        strict: refuse instead.

    Raises:
        RecordError: ``strict``, and there is a question.
    """
    asked: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for name, record in records:
        for question in implausible(signals_of(record)):
            key = (question.channel, question.unit or question.means)
            asked.setdefault(key, []).append((name, question.asked(to_set(file))))
    out = []
    for found in asked.values():
        also = f" (and in {', '.join(name for name, _ in found[1:])})" if found[1:] else ""
        out.append(f"in record '{found[0][0]}'{also}, {found[0][1]}")
    if strict and out:
        raise RecordError(refusal(file or "the records", out))
    return tuple(out)


def _clock(signals: Signals) -> list[Question]:
    rates = {name: (t.size - 1) / float(t[-1] - t[0]) for name, (t, _) in signals.items() if t[-1] > t[0]}
    if not rates:
        return []
    fastest = max(rates.values())
    if _SLOWEST_HZ <= fastest <= _FASTEST_HZ:
        return []
    span = max(float(t[-1] - t[0]) for t, _ in signals.values())
    unit = ""
    if fastest < _SLOWEST_HZ:
        unit = next((u for u, f in (("ms", 1e3), ("us", 1e6), ("ns", 1e9)) if 1.0 <= fastest * f <= 2000.0), "")
    means = f"are the times in {unit}" if unit else "what is the unit of the times"
    return [Question("t", f"{short(fastest)} Hz over {short(span)} s", means, unit)]


def _range(name: str, t: FloatArray, x: FloatArray, unstated: bool, stated: bool) -> list[Question]:
    """Question values beyond what the channel can have."""
    out = beyond(name, t, x, unstated)
    count = int(np.count_nonzero(out))
    if not count:
        return []
    worst = float(x[np.argmax(np.where(out, np.abs(x), -1.0))])
    got = f"{shown(name, worst)} in {count} of {x.size} samples"
    few, at_end = damaged(out, stated)
    if not few:
        return [Question(name, got, "which unit is it in, or is it damaged")]
    where = f" from t = {t[np.argmax(out)]:.3g} s on" if at_end else ""
    return [Question(name, got + where, f"are these samples damaged{', or not flight (a crash)' if at_end else ''}")]


def _slow(signals: Signals) -> list[Question]:
    """Question an airspeed too slow to fly of an aircraft that moves."""
    V = signals["V"][1] if "V" in signals else np.zeros(1)
    typical = float(np.median(V))
    if not 0.0 < typical < _SLOWEST_M_S or float(np.min(V)) <= 0.5 * typical:
        return []
    spreads = [np.std(signals[name][1]) / MOVING_RAD_S for name in "pqr" if name in signals]
    spreads += [
        np.ptp(signals[name][1]) / (5.0 * MOVING_RAD_S) for name in ("phi", "theta", "alpha") if name in signals
    ]
    got = f"{typical:.3g} m/s while the aircraft moves"
    means = "is it in km/s, a Mach number or a fraction, or was the pitot tube covered"
    return [Question("V", got, means)] if not spreads or max(spreads) > 1.0 else []


_ALIVE = ("V", "alpha", "beta", "p", "q", "r", "ax", "ay", "az", "qbar")
"""Channels of instruments, which always have noise; attitudes of estimators may stand still on the ground."""


def _frozen_throughout(signals: Signals) -> list[Question]:
    still = [n for n in _ALIVE if n in signals and signals[n][1].size >= FROZEN and np.ptp(signals[n][1]) == 0.0]
    return [
        Question(name, f"{shown(name, float(signals[name][1][0]))} throughout", "is the instrument frozen")
        for name in still
    ]


def _frozen_stretch(name: str, t: FloatArray, x: FloatArray) -> list[Question]:
    """Question the longest stretch of one value in a channel that else changes from sample to sample.

    The chance of n equal samples in a row is r^n if a share r of all samples repeats. A stretch counts if its chance,
    over the record, is below 10^-6 and if the channel jumps into it and out of it; an aircraft at rest does not jump.
    At an end of the record, where one of the two cannot be seen, the other must cross a quarter of the channel's
    range.
    """
    if name.removesuffix("_cmd") in (*CONTROLS, "thrust") or x.size < 3 * FROZEN:
        return []
    change = np.diff(x)
    runs = [(a, b) for a, b in _runs(change == 0.0) if b - a + 1 >= FROZEN]
    if not runs:
        return []
    a, b = max(runs, key=lambda run: run[1] - run[0])
    outside = np.r_[change[:a], change[b:]]
    if not np.any(outside):
        return []
    repeats = max(float(np.mean(outside == 0.0)), 0.01)
    usual = float(np.median(np.abs(outside[outside != 0.0])))
    jumps = [abs(float(change[i])) for i in (a - 1, b) if 0 <= i < change.size]
    least = _JUMP * usual if len(jumps) == 2 else max(_JUMP * usual, _CROSSED * float(np.ptp(x)))
    if x.size * repeats ** (b - a) > _CHANCE or min(jumps) <= least:
        return []
    got = f"{shown(name, float(x[a]))} from {t[a]:.6g} to {t[b]:.6g} s, in {b - a + 1} samples without any change"
    return [Question(name, got, "is this stretch damaged or the sensor frozen")]


def _runs(same: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last sample of each stretch without change; ``same`` compares each sample with the next."""
    edges = np.flatnonzero(np.diff(np.r_[False, same, False].astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
