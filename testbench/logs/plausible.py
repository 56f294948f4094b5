"""Questions at the door: values that no flight has, and the unit in which they would make sense.

A wrong unit does not fail. It gives derivatives that are wrong by 57 or by 9.81. So every channel is held against
what aircraft do, and against the others: pitch rate against the slope of pitch, dynamic pressure against airspeed.
Nothing is changed here; a question says what was got, what it would mean and what to set.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import CONTROLS, UNITS, channel
from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord, FloatArray

Signals = Mapping[str, tuple[FloatArray, FloatArray]]
"""Channel -> its times, s, and its samples in SI units, (n,) each, without those that were not taken."""


@dataclass(frozen=True)
class Criteria:
    """Where a value is questioned. All are judged: beyond what aircraft with instruments on board do."""

    slowest_hz: float = 0.2
    fastest_hz: float = 20_000.0
    flow_angle_rad: float = 0.5 * np.pi  # air from behind
    pitch_rad: float = 0.51 * np.pi  # by the definition of Euler angles, and rounding
    turns_rad: float = 16.0 * np.pi  # of bank and heading, which count on
    roll_rate_rad_s: float = 20.0
    rate_rad_s: float = 10.0
    angular_rad_s2: float = 1000.0
    force_m_s2: float = 32.0 * G0_M_S2  # the range of the widest inertial units in autopilots
    fastest_m_s: float = 700.0
    slowest_m_s: float = 3.0  # nothing that is flown for identification flies slower
    surface_rad: float = np.pi / 3.0
    throttle: float = 1.5
    lowest_m: float = -500.0
    highest_m: float = 40_000.0
    pressure_pa: float = 2.5e5
    few: float = 0.01  # share of samples beyond: below it they are damaged, above it the unit is wrong
    one_g: tuple[float, float] = (0.7, 1.3)  # median of |a|, m/s2, that is one g in g
    moving_rad_s: float = 0.01  # spread of a rate of an aircraft that is not standing
    unit_match: float = 1.5  # a unit is wrong if another one brings two channels within this ratio
    thinnest: float = 0.05  # density over that at sea level; at 20 km a fourteenth
    frozen: int = 8  # samples
    chance: float = 1e-6  # that a stretch without change is chance
    jump: float = 5.0  # of the usual change between samples, into and out of a stretch without change
    crossed: float = 0.25  # of the range of the channel, where the stretch lies at an end of the record


CRITERIA = Criteria()
_SEA_LEVEL_KG_M3 = 1.225  # ISO 2533


@dataclass(frozen=True)
class Question:
    """A value that is hardly meant: of which channel ("t" for the times), what was got, what it means, what to set.

    ``unit`` is the unit in which the values would make sense, "" if none does.
    """

    channel: str
    got: str
    means: str
    unit: str = ""

    def asked(self, how: Callable[[str, str], str]) -> str:
        """Return the question in words; ``how(channel, unit)`` says what to set at this door."""
        return f"{self.channel}: {self.got}; {self.means}? {how(self.channel, self.unit)}".strip()


def signals_of(record: FlightRecord) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Return the channels of a record as signals, without samples that were not taken."""
    taken = {name: record.valid[:, i] for i, name in enumerate(record.channels)}
    return {name: (record.t_s[ok], record[name][ok]) for name, ok in taken.items() if np.count_nonzero(ok) > 1}


def implausible(signals: Signals, criteria: Criteria = CRITERIA) -> tuple[Question, ...]:
    """Return the questions that the values of some channels raise, none for a flight that is plausible.

    Args:
        signals: the channels; several of them are also held against each other.
        criteria: the limits.
    """
    held = {name: (t, x) for name, (t, x) in signals.items() if x.size > 1}
    rates = _clock(held, criteria)
    out = [] if rates else [*_angles_against_rates(held, criteria), *_against_airspeed(held, criteria)]
    named = {question.channel for question in out}
    out += [q for q in _forces(held, criteria) if q.channel not in named]
    for name, (_, x) in held.items():
        if name not in {question.channel for question in out}:
            out += _range(name, x, criteria)
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
    return [Question("t", f"{_short(fastest)} Hz over {_short(span)} s", means, unit)]


def _range(name: str, x: FloatArray, c: Criteria) -> list[Question]:
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
    got = f"{_shown(name, worst)} in {count} of {x.size} samples"
    if count < c.few * x.size:
        return [Question(name, got, "are these samples damaged")]
    unit = next((u for u, f in _units(name) if low <= f * x.min() and f * x.max() <= high), "")
    return [Question(name, got, _in_unit(name, worst, unit) if unit else "which unit is it in, or is it damaged", unit)]


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
    return [(unit, factor) for unit, factor in UNITS.get(channel(name).unit, {}).items() if factor < 1.0]


def _in_unit(name: str, value: float, unit: str) -> str:
    return f"is it in {unit} ({value:.3g} {unit}, read as {value:.3g} {channel(name).unit})"


def _angles_against_rates(signals: Signals, c: Criteria) -> list[Question]:
    """Question q against the slope of theta, and p against that of phi, where one of the two is in degrees.

    The slope is that over half a second; quick oscillations do not count.
    """
    out = []
    for rate, angle in (("q", "theta"), ("p", "phi")):
        if rate not in signals or angle not in signals:
            continue
        (t, x), (ta, a) = signals[rate], signals[angle]
        start, end = max(t[0], ta[0]), min(t[-1], ta[-1])
        if end - start < 2.0:
            continue
        at = np.arange(start, end, 0.5)
        angles = np.interp(at, ta, a)
        turned = np.r_[0.0, np.cumsum(0.5 * (x[1:] + x[:-1]) * np.minimum(np.diff(t), 1.0))]
        by_rate, by_angle = (float(np.std(np.diff(y))) for y in (np.interp(at, t, turned), angles))
        if min(by_rate, by_angle) * 2.0 < c.moving_rad_s * DEG_RAD or max(by_rate, by_angle) * 2.0 < c.moving_rad_s:
            continue  # standing: noise against noise
        ratio = by_rate / by_angle
        if 1.0 / c.unit_match < ratio * DEG_RAD < c.unit_match:
            out.append(_degrees(rate, "deg/s", ratio, angle, x))
        elif 1.0 / c.unit_match < ratio / DEG_RAD < c.unit_match:
            out.append(_degrees(angle, "deg", 1.0 / ratio, rate, a))
    return out


def _degrees(name: str, unit: str, ratio: float, other: str, x: FloatArray) -> Question:
    largest = float(x[np.argmax(np.abs(x))])
    got = f"up to {_shown(name, largest)}, {ratio:.0f} times what {other} says"
    return Question(name, got, _in_unit(name, largest, unit), unit)


def _against_airspeed(signals: Signals, c: Criteria) -> list[Question]:
    """Question dynamic pressure that airspeed contradicts by the factor of a unit, and airspeed too slow to fly."""
    out: list[Question] = []
    if "V" not in signals:
        return out
    V = signals["V"][1]
    typical = float(np.median(V))
    if 0.0 < typical < c.slowest_m_s and float(np.min(V)) > 0.5 * typical and _moves(signals, c):
        got = f"{typical:.3g} m/s while the aircraft moves"
        out.append(Question("V", got, "is it in km/s, a Mach number or a fraction, or was the pitot tube covered"))
    if "qbar" in signals and c.slowest_m_s < typical < c.fastest_m_s:
        ratio = float(np.median(signals["qbar"][1])) / (0.5 * _SEA_LEVEL_KG_M3 * typical**2)
        if 0.0 < ratio < c.thinnest:
            fits = {u: f * ratio for u, f in UNITS["Pa"].items() if 0.1 < f * ratio < 1.5}
            unit = min(fits, key=lambda u: abs(np.log(fits[u])), default="")
            pressure = np.median(signals["qbar"][1])
            got = f"{pressure:.3g} Pa at {typical:.3g} m/s, {ratio:.2g} of what air at sea level gives"
            out.append(Question("qbar", got, f"is it in {unit}" if unit else "which unit is it in", unit))
    return out


def _moves(signals: Signals, c: Criteria) -> bool:
    """Say whether rates or angles of the aircraft move, or nothing tells."""
    rates = [np.std(signals[name][1]) > c.moving_rad_s for name in ("p", "q", "r") if name in signals]
    angles = [np.ptp(signals[name][1]) > 5.0 * c.moving_rad_s for name in ("phi", "theta", "alpha") if name in signals]
    return any([*rates, *angles]) or not (rates or angles)


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
        Question(name, f"{_shown(name, float(signals[name][1][0]))} throughout", "is the instrument frozen")
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
    got = f"{_shown(name, float(x[a]))} from {t[a]:.6g} to {t[b]:.6g} s, in {b - a + 1} samples without any change"
    return [Question(name, got, "is this stretch damaged or the sensor frozen")]


def _runs(same: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last sample of each stretch without change; ``same`` compares each sample with the next."""
    edges = np.flatnonzero(np.diff(np.r_[False, same, False].astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _shown(name: str, value: float) -> str:
    """Return a value with its unit, degrees for angles."""
    unit = channel(name).unit
    if unit.startswith("rad"):
        return f"{_short(value / DEG_RAD)} {unit.replace('rad', 'deg')}"
    return f"{_short(value)}" + ("" if unit == "1" else f" {unit}")


def _short(value: float) -> str:
    return f"{value:.3g}"
