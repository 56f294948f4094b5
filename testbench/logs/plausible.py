"""Questions at the door: values that no flight has, and the unit in which they would make sense.

A wrong unit does not fail. It gives derivatives that are wrong by 57 or by 9.81. So every channel is held against
what aircraft do, and against the others: pitch rate against the slope of pitch, dynamic pressure against airspeed.
Nothing is changed here; a question says what was got, what it would mean and what to set.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import CONTROLS, UNITS, channel
from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord, FloatArray
from testbench.logs.intervals import about, means, times_of_all
from testbench.logs.question import CRITERIA, Criteria, Question, Signals, in_unit, short, shown
from testbench.logs.speeds import against_airspeed


def signals_of(record: FlightRecord) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Return the channels of a record as signals, without samples that were not taken."""
    taken = {name: record.valid[:, i] for i, name in enumerate(record.channels)}
    return {name: (record.t_s[ok], record[name][ok]) for name, ok in taken.items() if np.count_nonzero(ok) > 1}


def implausible(
    signals: Signals,
    criteria: Criteria = CRITERIA,
    unstated: Collection[str] = (),
    stated: Collection[str] = (),
) -> tuple[Question, ...]:
    """Return the questions that the values of some channels raise, none for a flight that is plausible.

    Args:
        signals: the channels; several of them are also held against each other.
        criteria: the limits.
        unstated: channels whose unit nobody stated, which are questioned earlier.
        stated: channels whose unit the writer of the file stated: a few values beyond what flies are no question of it.
    """
    held = {name: (t, x) for name, (t, x) in signals.items() if x.size > 1}
    rates = _clock(held, criteria)
    out = [] if rates else [*angles_against_rates(held, criteria), *against_airspeed(held, criteria)]
    named = {question.channel for question in out}
    sooner = replace(criteria, flow_angle_rad=criteria.unstated_flow_rad, surface_rad=criteria.unstated_surface_rad)
    out += [q for q in _forces(held, criteria) if q.channel not in named]
    out += [] if rates or out else against_motion(held, criteria)  # whose parts are in their own units
    for name, (t, x) in held.items():
        if name not in {question.channel for question in out}:
            out += _range(name, t, x, sooner if name in unstated else criteria, name in stated)
    still = _frozen_throughout(held, criteria)
    out += still
    for name, (t, x) in held.items():
        out += _frozen_stretch(name, t, x, criteria)
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


def _clock(signals: Signals, c: Criteria) -> list[Question]:
    rates = {name: (t.size - 1) / float(t[-1] - t[0]) for name, (t, _) in signals.items() if t[-1] > t[0]}
    if not rates:
        return []
    fastest = max(rates.values())
    if c.slowest_hz <= fastest <= c.fastest_hz:
        return []
    span = max(float(t[-1] - t[0]) for t, _ in signals.values())
    unit = ""
    if fastest < c.slowest_hz:
        unit = next((u for u, f in (("ms", 1e3), ("us", 1e6), ("ns", 1e9)) if 1.0 <= fastest * f <= 2000.0), "")
    means = f"are the times in {unit}" if unit else "what is the unit of the times"
    return [Question("t", f"{short(fastest)} Hz over {short(span)} s", means, unit)]


def _range(name: str, t: FloatArray, x: FloatArray, c: Criteria, stated: bool) -> list[Question]:
    """Question values beyond what the channel can have."""
    limits = _limits(name, c)
    if limits is None:
        return []
    low, high = limits
    beyond = (x < low) | (x > high)
    count = int(np.count_nonzero(beyond))
    if not count:
        return []
    worst = float(x[np.argmax(np.where(beyond, np.abs(x), -1.0))])
    got = f"{shown(name, worst)} in {count} of {x.size} samples"
    first = int(np.argmax(beyond))
    if count < c.few * x.size or (stated and first >= c.flown * x.size and x.size - first < 2 * count + c.frozen):
        at_end = first >= c.flown * x.size and x.size - first < 2 * count + c.frozen
        where = f" from t = {t[first]:.3g} s on" if at_end else ""
        crash = ", or not flight (a crash)" if at_end else ""
        return [Question(name, got + where, f"are these samples damaged{crash}")]
    unit = next((u for u, f in _units(name) if low <= f * x.min() and f * x.max() <= high), "")
    return [Question(name, got, in_unit(name, worst, unit) if unit else "which unit is it in, or is it damaged", unit)]


def _limits(name: str, c: Criteria) -> tuple[float, float] | None:
    base = name.removesuffix("_cmd")
    sizes = {
        "alpha": c.flow_angle_rad, "beta": c.flow_angle_rad, "theta": c.pitch_rad, "phi": c.turns_rad,
        "psi": c.turns_rad, "p": c.roll_rate_rad_s, "q": c.rate_rad_s, "r": c.rate_rad_s, "pdot": c.angular_rad_s2,
        "qdot": c.angular_rad_s2, "rdot": c.angular_rad_s2, "ax": c.force_m_s2, "ay": c.force_m_s2,
        "az": c.force_m_s2, "de": c.surface_rad, "da": c.surface_rad, "dr": c.surface_rad, "thr": c.throttle,
        "V": c.fastest_m_s, "u": c.fastest_m_s, "v": c.fastest_m_s, "w": c.fastest_m_s, "Vg": c.fastest_m_s,
        "hdot": c.fastest_m_s, "qbar": c.pressure_pa,
    }  # fmt: skip
    if base == "h":
        return c.lowest_m, c.highest_m
    return (-sizes[base], sizes[base]) if base in sizes else None


def _units(name: str) -> list[tuple[str, float]]:
    """Return the other units of a channel that make its values smaller, and their factors to SI."""
    units = UNITS.get(channel(name).unit, {}).items()
    return [(unit, factor) for unit, factor in units if factor < 1.0 and (unit != "ft/min" or name == "hdot")]


def angles_against_rates(signals: Signals, c: Criteria) -> list[Question]:
    """Question q against the slope of theta, and p against that of phi, where one of the two is in degrees.

    The slope is that over half a second, or between the samples of slower logs; quick oscillations do not count.
    """
    out = []
    for rate, angle in (("q", "theta"), ("p", "phi")):
        if rate not in signals or angle not in signals:
            continue
        (t, x), (ta, a) = signals[rate], signals[angle]
        start, end = max(t[0], ta[0]), min(t[-1], ta[-1])
        if end - start < 2.0:
            continue
        step_s = max(0.5, float(np.median(np.diff(t))), float(np.median(np.diff(ta))))
        at = np.arange(start, end, step_s)
        angles = about((ta, a), at, 0.1)  # the noise of single samples is no motion
        turned = np.r_[0.0, np.cumsum(0.5 * (x[1:] + x[:-1]) * np.minimum(np.diff(t), 1.0))]
        by_rate, by_angle = (float(np.std(np.diff(y))) for y in (np.interp(at, t, turned), angles))
        slowest, fastest = min(by_rate, by_angle) / step_s, max(by_rate, by_angle) / step_s
        if slowest < c.moving_rad_s * DEG_RAD or fastest < c.moving_rad_s:
            continue  # standing: noise against noise
        ratio = by_rate / by_angle
        if 1.0 / c.unit_match < ratio * DEG_RAD < c.unit_match:
            out.append(_degrees(rate, "deg/s", ratio, angle, x))
        elif 1.0 / c.unit_match < ratio / DEG_RAD < c.unit_match:
            out.append(_degrees(angle, "deg", 1.0 / ratio, rate, a))
    return out


def _degrees(name: str, unit: str, ratio: float, other: str, x: FloatArray) -> Question:
    largest = float(x[np.argmax(np.abs(x))])
    got = f"up to {shown(name, largest)}, {ratio:.0f} times what {other} says"
    return Question(name, got, in_unit(name, largest, unit), unit)


def _forces(signals: Signals, c: Criteria) -> list[Question]:
    """Question specific forces whose usual size is one g in g, or whose vertical one has the other sign."""
    if "az" not in signals:
        return []
    az = signals["az"][1]
    size, typical = float(np.median(np.abs(az))), float(np.median(az))
    if c.one_g[0] < size < c.one_g[1]:
        got = f"{typical:.3g} m/s2 in the mean, where level flight has -9.81 m/s2"
        return [Question("az", got, "is it in g", "g")]
    if typical > 0.5 * G0_M_S2:
        got = f"{typical:.3g} m/s2 in the mean, where level flight has -9.81 m/s2"
        return [Question("az", got, "does it count upwards (scale = -1.0), or was the flight inverted")]
    return []


_ALIVE = ("V", "alpha", "beta", "p", "q", "r", "ax", "ay", "az", "qbar")
"""Channels of instruments, which always have noise; attitudes of estimators may stand still on the ground."""


def _frozen_throughout(signals: Signals, c: Criteria) -> list[Question]:
    still = [n for n in _ALIVE if n in signals and signals[n][1].size >= c.frozen and np.ptp(signals[n][1]) == 0.0]
    return [
        Question(name, f"{shown(name, float(signals[name][1][0]))} throughout", "is the instrument frozen")
        for name in still
    ]


def _frozen_stretch(name: str, t: FloatArray, x: FloatArray, c: Criteria) -> list[Question]:
    """Question the longest stretch of one value in a channel that else changes from sample to sample.

    The chance of n equal samples in a row is r^n if a share r of all samples repeats. A stretch counts if its chance,
    over the record, is below 10^-6 and if the channel jumps into it and out of it; an aircraft at rest does not jump.
    At an end of the record, where one of the two cannot be seen, the other must cross a quarter of the channel's
    range.
    """
    if name.removesuffix("_cmd") in (*CONTROLS, "thrust") or x.size < 3 * c.frozen:
        return []
    change = np.diff(x)
    runs = [(a, b) for a, b in _runs(change == 0.0) if b - a + 1 >= c.frozen]
    if not runs:
        return []
    a, b = max(runs, key=lambda run: run[1] - run[0])
    outside = np.r_[change[:a], change[b:]]
    if not np.any(outside):
        return []
    repeats = max(float(np.mean(outside == 0.0)), 0.01)
    usual = float(np.median(np.abs(outside[outside != 0.0])))
    jumps = [abs(float(change[i])) for i in (a - 1, b) if 0 <= i < change.size]
    least = c.jump * usual if len(jumps) == 2 else max(c.jump * usual, c.crossed * float(np.ptp(x)))
    if x.size * repeats ** (b - a) > c.chance or min(jumps) <= least:
        return []
    got = f"{shown(name, float(x[a]))} from {t[a]:.6g} to {t[b]:.6g} s, in {b - a + 1} samples without any change"
    return [Question(name, got, "is this stretch damaged or the sensor frozen")]


def _runs(same: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last sample of each stretch without change; ``same`` compares each sample with the next."""
    edges = np.flatnonzero(np.diff(np.r_[False, same, False].astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


# --- side force -------------------------------------------------------------------------------------------------------


_STEP_S = 0.5
_NAMES = ("ay", "beta", "alpha", "p", "r", "phi", "theta", "V")


def against_motion(signals: Signals, c: Criteria) -> list[Question]:
    """Question a lateral specific force in g, and one that counts to the left."""
    at = times_of_all(signals, _NAMES, _STEP_S)
    if at is None:
        return []
    mean = {name: means(signals[name], at[:-1], at[1:]) for name in _NAMES}
    slipping = np.diff(about(signals["beta"], at, 0.1)) / _STEP_S
    turning = slipping + mean["r"] * np.cos(mean["alpha"]) - mean["p"] * np.sin(mean["alpha"])
    expected = mean["V"] * turning - G0_M_S2 * np.sin(mean["phi"]) * np.cos(mean["theta"])
    if np.std(expected) < c.felt_m_s2 or not np.std(mean["ay"]) > 0.0:
        return []
    r = float(np.corrcoef(mean["ay"], expected)[0, 1])
    if r**2 < c.follows:
        return []
    times = float(np.std(mean["ay"]) / np.std(expected))
    got = f"{'minus ' if r < 0.0 else ''}{times:.2g} times what sideslip, rates and bank make of it"
    if 1.0 / c.unit_match < times * G0_M_S2 < c.unit_match:
        return [Question("ay", got, "is it in g" + (", and does it count to the left" if r < 0.0 else ""), "g")]
    if r < 0.0:
        return [Question("ay", got, "does it count to the left (scale = -1.0)")]
    return []
