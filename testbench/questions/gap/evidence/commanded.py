"""What was commanded in a measured record, or which surfaces drive it, and the quiet flight before it.

Which channels of a believed suite are compared with measurements, and which are left out, and why.

Commands that a sensor measured: their noise is taken out where they rest.

The number that was sent is exact. The position of a lever or stick is not, and its noise would drive the believed
model: an engine that slows sooner than it gathers speed loses thrust to it, and no quiet flight is seen before the
first command. Where a command varies as white noise of the stated size does, it rests.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.stats import chi2

from testbench.core.channels import CONTROLS
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord, FloatArray
from testbench.page.words import grouped
from testbench.questions.gap.criteria import CRITERIA
from testbench.sensors import SensorSuite

RESTED = "commands_rested"  # in the provenance of a record: control -> noise that was taken out where it rests
_WINDOW_S, _FEWEST = 1.0, 12  # of a window that tells noise from motion, and its fewest samples


def rested(suite: SensorSuite, records: Mapping[str, FlightRecord]) -> dict[str, FlightRecord]:
    """Return records whose commands stand still where no more than the noise of their sensors moves them."""
    told = {s.channel: s.noise_std for s in suite.sensors}
    noise = {c: told[f"{c}_cmd"] for c in CONTROLS if told.get(f"{c}_cmd", 0.0) > 0.0}
    out = dict(records)
    for name, record in records.items():
        done: Mapping[str, float] = record.provenance.get(RESTED, {})
        own = {c: s for c, s in noise.items() if f"{c}_cmd" in record and c not in done}
        if own:
            still = {f"{c}_cmd": stilled(record[f"{c}_cmd"], s, record.dt_s) for c, s in own.items()}
            out[name] = replace(record.with_columns(still), provenance={**record.provenance, RESTED: {**done, **own}})
    return out


def stilled(u: FloatArray, noise_std: float, dt_s: float) -> FloatArray:
    """Return a command (n,) at rest where it rests; where it moves it is as it was measured.

    A rest is held at its mean, unless it drifts by more than the noise of its means: it then follows them. A sample
    that lies beyond the noise belongs to what comes before or after the rest.
    """
    out, window = u.copy(), _window(dt_s)
    for first, last in rests(u, noise_std, dt_s):
        part = u[first:last]
        total, k = np.concatenate([[0.0], np.cumsum(part)]), np.arange(part.size)
        begin, end = np.maximum(k - window // 2, 0), np.minimum(k + window // 2 + 1, part.size)
        local, level = (total[end] - total[begin]) / (end - begin), float(part.mean())  # within half a window of each
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


# The believed flight begins northwards in still air, and its linear predictions hold neither heading nor place.
_OF_PLACE = ("psi", "north", "east", "v_north", "v_east")
_OF_STATION = re.compile(r"(az|strain)_wing_\d+")
DRIFT = 0.2  # a bias that wanders by more than this share of the noise within DRIFT_OVER_S colours the residual
DRIFT_OVER_S = 20.0  # length of a manoeuvre


def left_out(suite: SensorSuite) -> dict[str, str]:
    """Return channel of a suite that is not compared -> why, in words; commands and deflections aside."""
    out = {}
    for s in suite.sensors:
        if s.channel in _OF_PLACE:
            out[s.channel] = "heading and wind are not known"
        elif _OF_STATION.fullmatch(s.channel):
            out[s.channel] = "effects that bend the wing do not predict the motion there"
        elif s.drift_over(DRIFT_OVER_S) > DRIFT * suite.noise_std[s.channel]:
            out[s.channel] = f"the bias wanders by more than {DRIFT:g} times the noise within {DRIFT_OVER_S:g} s"
    return out


def not_compared(suite: SensorSuite) -> list[str]:
    """Return what of a suite is not compared, and why, a sentence for each reason."""
    return [f"not compared: {', '.join(names)} ({why})" for why, names in grouped(left_out(suite)).items()]


LATERAL_COMMANDS = ("da_cmd", "dr_cmd")
LATERAL_CHANNELS = {"beta", "v", "p", "r", "phi", "ay"}
FREE = "free_start"  # in the provenance of a record that does not begin at trim
DRIVEN = "driven_by_surface"  # in that of a record whose recorded surfaces stand in place of commands
BETWEEN = "moves_between_samples"  # in that of a record of a log: controls whose commands move on between samples
LEAST_QUIET_S = 0.5
MOVED = 1e-3  # rad, or share of the throttle, by which a command must change to count as moved


def moves_laterally(records: Sequence[FlightRecord]) -> bool:
    """Return whether an aileron or rudder command moves in any of the records."""
    return any(_moved(r, [n for n in LATERAL_COMMANDS if n in r]).any() for r in records)


def commands(record: FlightRecord) -> tuple[tuple[str, ...], FloatArray]:
    """Return the controls whose commands the record holds, and their deviations (n, m) from the quiet flight.

    Of a record that starts freely they are the deviations from what it says it is measured from.
    """
    names = tuple(n for n in CONTROLS if f"{n}_cmd" in record)
    if not names:
        raise RecordError("a record of the gap workflow must hold a command such as de_cmd, got none")
    u = record.columns(f"{n}_cmd" for n in names)
    if starts_freely(record):
        level = record.provenance[FREE]["commands"]
        return names, u - np.array([level[n] for n in names])
    return names, u - u[: quiet_samples(record)].mean(axis=0)


def moves_on(record: FlightRecord, control: str, u: FloatArray) -> NDArray[np.bool_]:
    """Return after which samples (n,) the command ``u`` (n,) of a control moves on until the next one.

    A surface that drives the model does; so does a command that :func:`between_samples` says of, but where it jumps.
    """
    if control in surface_noise(record):
        return np.ones(u.size, bool)
    if control not in record.provenance.get(BETWEEN, ()):
        return np.zeros(u.size, bool)
    return ~_isolated(u)


def between_samples(record: FlightRecord) -> FlightRecord:
    """Return a record of a log, said to hold commands that move on between samples if they go step by step.

    What a log holds was seldom sent once for each of its samples. A stick moves all the time, an autopilot sends
    several commands from sample to sample; held until the next sample, both would come half a sample late. A command
    that stands still but for single jumps is held.
    """
    on = []
    for control in (c for c in CONTROLS if f"{c}_cmd" in record and c not in surface_noise(record)):
        u = record[f"{control}_cmd"]
        way, _ = _ways(u)
        if way.sum() > MOVED and way[~_isolated(u)].sum() > 0.5 * way.sum():  # most of it step by step
            on.append(control)
    return replace(record, provenance={**record.provenance, BETWEEN: on}) if on else record


def _isolated(u: FloatArray) -> NDArray[np.bool_]:
    """Return after which samples (n,) a command jumps: it moves by far more than before and after."""
    way, beside = _ways(u)
    return np.asarray(way > CRITERIA.jumps * beside)


def _ways(u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how far a command or surface (n,) goes until the next sample, and in the two steps beside that."""
    way = np.abs(np.diff(u, append=u[-1:]))
    return way, np.append(way[1:], 0.0) + np.insert(way[:-1], 0, 0.0)


def driven_by_surfaces(record: FlightRecord, noise: Mapping[str, float]) -> FlightRecord:
    """Return the record, said to hold surfaces in place of commands: control -> standard deviation of its noise."""
    return replace(record, provenance={**record.provenance, DRIVEN: dict(noise)})


def surface_noise(record: FlightRecord) -> Mapping[str, float]:
    """Return the controls whose recorded surfaces stand in place of commands -> standard deviation of their noise."""
    found: Mapping[str, float] = record.provenance.get(DRIVEN, {})
    return found


def starts_freely(record: FlightRecord) -> bool:
    """Return whether a record is said not to begin at trim, see :func:`freed`."""
    return FREE in record.provenance


def freed(record: FlightRecord, key: str, level: Mapping[str, float]) -> FlightRecord:
    """Return the record, said not to begin at trim but where ``key`` tells, its commands deviations from ``level``."""
    return replace(record, provenance={**record.provenance, FREE: {"key": key, "commands": dict(level)}})


def key_of_start(record: FlightRecord) -> str:
    """Return what tells the start of a record that starts freely from others."""
    return str(record.provenance[FREE]["key"])


def quiet_samples(record: FlightRecord) -> int:
    """Return how many samples pass before the first command moves."""
    count = _still(record)
    if not begins_quietly(record):
        raise RecordError(
            f"a record must begin with at least {LEAST_QUIET_S:g} s of quiet flight, got {count * record.dt_s:.2f} s; "
            'cut it earlier, or let it be cut into windows that start freely (windows = "auto", --windows auto)'
        )
    return count


def begins_quietly(record: FlightRecord) -> bool:
    """Return whether a record begins with half a second in which no command moves."""
    return not starts_freely(record) and _still(record) * record.dt_s >= LEAST_QUIET_S


def _still(record: FlightRecord) -> int:
    """Return the number of samples before any command moves."""
    first = len(record)
    for name in (n for n in record.channels if n.endswith("_cmd")):
        moved = _moved(record, [name])
        if moved.any():
            noise = surface_noise(record).get(name.removesuffix("_cmd"))
            k = int(np.argmax(moved))
            first = min(first, k if noise is None else _onset(record[name][: k + 1], noise, record.dt_s))
    return first


def _onset(surface: FloatArray, noise_std: float, dt_s: float) -> int:
    """Return from which sample on a surface (n,) moves that stirs at the last one.

    By then it has moved for some time within its noise. A shift of twice ``Criteria.shift`` is likeliest to begin where
    the sum of what lies beyond half of that is least (the cumulative sum of E. S. Page, Biometrika 41, 1954).
    """
    began = _began(surface, dt_s)
    beyond = np.sign(surface[-1] - began) * (surface - began) - MOVED - CRITERIA.shift * noise_std
    return int(np.argmin(np.cumsum(beyond[:-1]))) + 1 if len(beyond) > 1 else 0


def _began(surface: FloatArray, dt_s: float) -> float:
    return float(np.mean(surface[: max(1, round(LEAST_QUIET_S / dt_s))]))


def _moved(record: FlightRecord, channels: Sequence[str]) -> NDArray[np.bool_]:
    """Return at which samples (n,) any of some commands is not where it began, beyond the noise of a surface."""
    out = np.zeros(len(record), bool)
    for name in channels:
        u, noise = record[name], surface_noise(record).get(name.removesuffix("_cmd"))
        if noise is None:
            out |= np.abs(u - u[0]) > MOVED
        else:
            out |= stirs(u, noise, record.dt_s)
    return out


def stirs(surface: FloatArray, noise_std: float, dt_s: float) -> NDArray[np.bool_]:
    """Return at which samples (n,) a recorded surface is not where it began, beyond its noise."""
    return np.asarray(np.abs(surface - _began(surface, dt_s)) > MOVED + CRITERIA.stirs * noise_std)


def jumps(record: FlightRecord, control: str) -> FloatArray:
    """Return by how much a surface that drives the model jumps between each sample and the next (n,), rad; else 0.

    It jumps if it moves by far more than its noise, and far more than in the samples before and after.
    """
    steps, beside = _ways(record[f"{control}_cmd"])
    least = MOVED + CRITERIA.stirs * surface_noise(record)[control]
    return np.where(steps > np.maximum(least, CRITERIA.jumps * beside), steps, 0.0)
