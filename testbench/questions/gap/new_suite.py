"""A sensor suite made from records: their channels and rate, and the noise that third differences show."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbench.core.channels import CONTROLS
from testbench.core.constants import DEG_RAD
from testbench.core.errors import RecordError
from testbench.core.paths import suite_names
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.regression.smoothing import LEAST, noise_level
from testbench.page.words import grouped
from testbench.questions.gap.evidence.commanded import MOVED, rests
from testbench.sensors import SensorSuite, load_suite
from testbench.sensors.kinds import KINDS
from testbench.sensors.sensor import Sensor

_USUAL = {  # channel -> kind of sensor, noise of one sample if the record does not show it (the packaged suites'), SI
    "V": ("pitot", 0.2),
    **dict.fromkeys(("alpha", "beta"), ("flow_vane", 0.25 * DEG_RAD)),
    **dict.fromkeys(("p", "q", "r"), ("rate_gyro", 0.2 * DEG_RAD)),
    **dict.fromkeys(("phi", "theta"), ("", 0.2 * DEG_RAD)),
    **dict.fromkeys(("ax", "ay", "az"), ("accelerometer", 0.2)),
    "h": ("barometer", 0.5),
    **dict.fromkeys(("de", "da", "dr"), ("surface_position", 0.1 * DEG_RAD)),
    **{f"{n}_cmd": ("command_log", 0.0) for n in CONTROLS},
}
_SMOOTHED = 0.1  # of the usual noise: less was filtered away before it was recorded, and the error left is no noise
_CLEAN = 0.02  # likewise, where third differences are those of white noise: such a sensor is cleaner than usual
_WHITE = -0.65  # their correlation with the next one, at most; that of white noise is -0.75, what was filtered has more
_RESTS = 0.2  # of the samples of a command that must rest in white noise if it was measured
_EXACT = 0.02  # of what counts as motion: less noise than this drives nothing
_NEAR = 1e-3  # by which a rate may be off from a whole number that is meant


def suite_of_records(name: str, aircraft: str, records: Mapping[str, FlightRecord]) -> tuple[SensorSuite, list[str]]:
    """Return the sensors that records show, and what is left out of them, in sentences.

    Lags, biases and places are those of the packaged suites of the aircraft, where it has such a sensor, else none.

    Raises:
        RecordError: rates differ, or nothing is left that can be compared.
    """
    rates = {n: 1.0 / r.dt_s for n, r in records.items()}
    low, high = min(rates, key=lambda n: rates[n]), max(rates, key=lambda n: rates[n])
    if rates[high] > (1.0 + _NEAR) * rates[low]:
        raise RecordError(
            f"records of a gap case must have one rate, got {rates[low]:.6g} Hz in '{low}' and {rates[high]:.6g} Hz in "
            f"'{high}'; import the logs again with one --rate"
        )
    rate = rates[low]
    rate = float(round(rate)) if abs(rate - round(rate)) < _NEAR * rate else rate
    every = list(dict.fromkeys(c for r in records.values() for c in r.channels))
    why = {c: _left_out(c, records) for c in every}
    known = _packaged(aircraft, set(every))
    kept = [c for c in _USUAL if c in every and not why[c]]
    if all(c.removesuffix("_cmd") in CONTROLS for c in kept):
        raise RecordError(
            "records must share a channel that is compared (V, alpha, beta, p, q, r, phi, theta, ax, ay, az, h), got "
            f"{', '.join(every)}"
        )
    sensors = tuple(_sensor(c, records, known.get(c)) for c in kept)
    left = [f"no sensor of the suite: {', '.join(names)} ({reason})" for reason, names in grouped(why).items()]
    return SensorSuite(name, f"what the records of {aircraft} hold, at {rate:g} Hz", rate, sensors), left


def _left_out(name: str, records: Mapping[str, FlightRecord]) -> str:
    """Return why a channel becomes no sensor; "" if it does."""
    if name not in _USUAL:
        return "not compared by a generated gap case; add it to the suite if it is reliable"
    lacking = [n for n, r in records.items() if name not in r]
    if lacking:
        return f"'{lacking[0]}' does not hold it"
    if not name.endswith("_cmd") and all(np.ptp(r[name]) == 0.0 for r in records.values()):
        return "it never changes"
    return ""


def _packaged(aircraft: str, held: set[str]) -> dict[str, Sensor]:
    """Return channel -> sensor of the packaged suites of an aircraft: of the suite most like what is ``held``."""
    suites = [load_suite(name) for name in suite_names() if name.startswith(f"{aircraft}_")]
    suites.sort(key=lambda suite: len(held ^ set(suite.channels)))
    return {s.channel: s for suite in reversed(suites) for s in suite.sensors}


def _sensor(name: str, records: Mapping[str, FlightRecord], known: Sensor | None) -> Sensor:
    kind, usual = _USUAL[name]
    plain = KINDS.get(kind, Sensor)(channel=name)
    if name.endswith("_cmd"):
        sent = known or replace(plain, part="command log", source="exact: the number that was sent.")
        return _command(sent, [_taken(r, name) for r in records.values()], next(iter(records.values())).dt_s)
    sensor = known or plain
    sensor = replace(sensor, rate_hz=None, dropout=0.0)  # records mark the samples that were taken
    if known is not None:
        usual = math.hypot(known.noise_std, known.quantum / math.sqrt(12.0)) or usual
    rest = "lag, bias and place as in the packaged suites of this aircraft" if known else "YOURS: lag, bias and place"
    own = [y for r in records.values() if (y := _taken(r, name)).size >= LEAST]
    found = [noise_level(y) for y in own]
    noise = float(np.median(found)) if found else 0.0
    white = bool(found) and float(np.median([_correlation(y) for y in own])) < _WHITE
    if noise < (_CLEAN if white else _SMOOTHED) * usual:
        told = (
            f"YOURS: the noise is assumed, because the records are too smooth or too short to show it ({noise:.2g}, SI)"
        )
        noise = usual
    else:
        told = "noise from third differences of the records"
    own_noise = math.sqrt(max(noise**2 - sensor.quantum**2 / 12.0, 0.0))
    part = known.part if known else "YOURS: which sensor"
    return replace(sensor, noise_std=float(f"{own_noise:.3g}"), part=part, source=f"{told}; {rest}.")


def _correlation(y: FloatArray) -> float:
    """Return the correlation of third differences of samples (n,) with the next ones."""
    d = np.diff(y, 3)
    return float(d[1:] @ d[:-1]) / max(float(d @ d), np.finfo(float).tiny)


def _command(sent: Sensor, commands: Sequence[FloatArray], dt_s: float) -> Sensor:
    """Return the sensor of a command (n,) in each record: ``sent``, or one with noise where it rests as noise does."""
    long = [u for u in commands if u.size >= LEAST]
    noise = float(f"{np.median([noise_level(u) for u in long]):.3g}") if long else 0.0
    still = sum(b - a for u in long for a, b in rests(u, noise, dt_s)) if noise > 0.0 else 0
    if still < _RESTS * sum(u.size for u in long) or noise < _EXACT * MOVED:
        return sent
    told = (
        "YOURS: assumed to be the position of a lever or stick, because it has white noise at rest, which does not "
        "drive the model; 0.0 if it is the number that was sent"
    )
    return replace(sent, noise_std=noise, part="YOURS: which sensor", source=f"noise from third differences; {told}.")


def _taken(record: FlightRecord, name: str) -> FloatArray:
    i = record.channels.index(name)
    return np.asarray(record.data[record.valid[:, i], i])
