"""Sensor and SensorSuite: what a flight looks like through real instruments.

The physics stand in the order in which a signal meets them: mounting position, scale error, lag, delay, sampling at the
sensor's own rate, bias and noise, quantisation, dropout; the record holds the last sample taken until the next one.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from testbench.channels import CONTROLS, channel, require
from testbench.errors import ChannelError, RecordError, ScenarioError
from testbench.record import FlightRecord, FloatArray

ACCELEROMETERS = ("ax", "ay", "az")
_ROTATION = ("p", "q", "r", "pdot", "qdot", "rdot")
_COMMANDS = tuple(f"{name}_cmd" for name in CONTROLS)
_RATE_TOLERANCE = 1e-6  # relative


@dataclass(frozen=True)
class Sensor:
    """One instrument: y = Q(s x(t - T) lagged + b + n), sampled at its own rate, with samples lost at random.

    Values are in the channel's SI unit.

    Args:
        channel: the channel that it reads, of the channel table; also the name that its noise is drawn by.
        noise_std: standard deviation of the white noise of each sample.
        bias: constant offset.
        scale: scale factor, 1 for a perfect sensor; it multiplies the value itself, not its deviation from trim.
        lag_s: time constant of a first-order lag, at rest with the first sample of the flight.
        delay_s: pure delay; before the flight began the value is its first one.
        quantum: step of the quantisation, to the nearest multiple; 0 for none.
        rate_hz: its own rate; the suite's rate if None. It divides the suite's rate.
        dropout: probability that a sample is lost, independent from sample to sample; never the first one.
        position_m: position from the centre of gravity, body axes forward, right, down, m. For ax, ay, az only:
            a_P = a_CG + omegadot x r + omega x (omega x r), rigid body.
        part: the real part that it stands for.
        source: where its figures come from.

    A heading (psi) is unwrapped before lag and delay and recorded in 0 <= psi < 2 pi. No other angle is unwrapped:
    phi beyond 180 deg would lag through the jump.

    Raises:
        ScenarioError: every law that its figures break.
    """

    channel: str
    noise_std: float = 0.0
    bias: float = 0.0
    scale: float = 1.0
    lag_s: float = 0.0
    delay_s: float = 0.0
    quantum: float = 0.0
    rate_hz: float | None = None
    dropout: float = 0.0
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    part: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "position_m", tuple(float(x) for x in self.position_m))
        faults = list(self._faults())
        if faults:
            raise ScenarioError(faults)

    def _faults(self) -> Iterator[str]:
        try:
            channel(self.channel)
        except ChannelError as error:
            yield f"channel: {error}"
        for key in ("noise_std", "lag_s", "delay_s", "quantum"):
            value = getattr(self, key)
            if not (math.isfinite(value) and value >= 0.0):
                yield f"{key}: 0 <= {key} must hold, got {value:g}"
        for key in ("bias", "scale"):
            if not math.isfinite(getattr(self, key)):
                yield f"{key}: a finite number is needed, got {getattr(self, key):g}"
        if self.rate_hz is not None and not (math.isfinite(self.rate_hz) and self.rate_hz > 0.0):
            yield f"rate_hz: 0 < rate_hz must hold, got {self.rate_hz:g}"
        if not 0.0 <= self.dropout < 1.0:
            yield f"dropout: 0 <= dropout < 1 must hold for a probability, got {self.dropout:g}"
        if len(self.position_m) != 3 or not all(math.isfinite(x) for x in self.position_m):
            yield f"position_m: three finite numbers (forward, right, down) are needed, got {self.position_m}"
        elif any(self.position_m) and self.channel not in ACCELEROMETERS:
            yield (
                f"position_m: a position matters to {', '.join(ACCELEROMETERS)} only, got one for '{self.channel}'; "
                "leave it out"
            )
        if self.channel == "psi" and self.scale != 1.0:
            yield f"scale: a heading has no zero to scale from, scale = 1 must hold for psi, got {self.scale:g}"

    @property
    def needs(self) -> tuple[str, ...]:
        """The channels of the true record that it is computed from."""
        return (self.channel, *_ROTATION) if any(self.position_m) else (self.channel,)

    def respond(self, truth: FlightRecord) -> FloatArray:
        """Return position, scale, lag and delay applied to the truth, on its own time grid (n,); still without noise.

        Raises:
            ChannelError: the truth lacks a channel of :attr:`needs`.
        """
        require(self.needs, truth.channels, f"sensor '{self.channel}'")
        x = truth[self.channel]
        if any(self.position_m):
            x = x + lever_arm(truth, self.position_m)[:, ACCELEROMETERS.index(self.channel)]
        if self.channel == "psi":
            x = np.unwrap(x)
        x = self.scale * x
        if self.lag_s > 0.0:
            x = first_order_lag(x, truth.dt_s, self.lag_s)
        if self.delay_s > 0.0:
            x = np.interp(truth.t_s - self.delay_s, truth.t_s, x)
        return x

    def sample(self, x: FloatArray, seed: int) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the samples (m,) that the sensor delivers for its responses ``x`` (m,), and which of them arrive.

        The generator is ``SeedSequence([seed, crc32(channel)])``, so that a sensor's noise depends neither on the other
        sensors nor on the length of the flight; its first child decides which samples are lost.
        """
        root = np.random.SeedSequence([seed, zlib.crc32(self.channel.encode())])
        (losses,) = root.spawn(1)
        y = x + self.bias + self.noise_std * np.random.default_rng(root).standard_normal(x.size)
        if self.quantum > 0.0:
            y = self.quantum * np.rint(y / self.quantum)
        if self.channel == "psi":
            y = np.mod(y, 2.0 * np.pi)
            y[y >= 2.0 * np.pi] = 0.0  # mod of a tiny negative number rounds up to 2 pi itself
        arrived = np.random.default_rng(losses).random(x.size) >= self.dropout
        arrived[:1] = True
        return y, arrived


@dataclass(frozen=True)
class SensorSuite:
    """The instruments of one aircraft and the rate of its log.

    Args:
        name: short name, as in a scenario.
        title: what it stands for, in words.
        rate_hz: rate of the log; it divides the rate at which the truth is logged.
        sensors: one per channel.

    Raises:
        ScenarioError: no sensor, two of one channel, or a sensor whose rate does not divide the suite's.
    """

    name: str
    title: str
    rate_hz: float
    sensors: tuple[Sensor, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensors", tuple(self.sensors))
        faults = suite_faults(self.rate_hz, [(s.channel, s.rate_hz) for s in self.sensors])
        if faults:
            raise ScenarioError(faults)

    @property
    def channels(self) -> tuple[str, ...]:
        """The recorded channels, in the order of the sensors."""
        return tuple(sensor.channel for sensor in self.sensors)

    @property
    def outputs(self) -> tuple[str, ...]:
        """The recorded channels that are neither controls nor commands."""
        return tuple(name for name in self.channels if name not in (*CONTROLS, *_COMMANDS))

    @property
    def noise_std(self) -> dict[str, float]:
        """Channel -> standard deviation of one sample, noise and rounding (quantum / sqrt 12) together, SI."""
        return {s.channel: math.hypot(s.noise_std, s.quantum / math.sqrt(12.0)) for s in self.sensors}

    def check_log_rate(self, log_hz: float) -> int:
        """Return how many samples of a truth logged at ``log_hz`` make one of the suite's.

        Raises:
            ScenarioError: the suite's rate does not divide it.
        """
        stride = whole_ratio(log_hz, self.rate_hz)
        if stride is None:
            raise ScenarioError([_log_rate_fault(self.name, self.rate_hz, log_hz)])
        return stride

    def measure(self, truth: FlightRecord, seed: int) -> FlightRecord:
        """Return what the suite records of a flight.

        Args:
            truth: record of kind "truth", uniform in time, logged at a whole multiple of the suite's rate.
            seed: seed of all noise and dropouts, >= 0.

        Returns:
            Record of kind "measured" at the suite's rate, with the truth's outcome. Between a sensor's own samples, and
            where one was lost, the last one that arrived is held and marked not valid; the first is always valid.
            ``provenance`` holds the suite's name, the seed and the truth's provenance.

        Raises:
            RecordError: the record is not of kind "truth" or not uniform in time.
            ScenarioError: the suite's rate does not divide the log rate, or the seed is negative.
            ChannelError: the truth lacks a channel.
        """
        if truth.kind != "truth":
            raise RecordError(f"a sensor suite measures records of kind 'truth', got one of kind '{truth.kind}'")
        if seed < 0:
            raise ScenarioError([f"0 <= seed must hold, got {seed}"])
        needed = dict.fromkeys(name for sensor in self.sensors for name in sensor.needs)
        require(needed, truth.channels, f"sensor suite '{self.name}'")
        stride = self.check_log_rate(1.0 / truth.dt_s)
        t = truth.t_s[::stride]
        data, valid = np.empty((t.size, len(self.sensors))), np.zeros((t.size, len(self.sensors)), bool)
        for i, sensor in enumerate(self.sensors):
            every = whole_ratio(self.rate_hz, sensor.rate_hz or self.rate_hz) or 1
            y, arrived = sensor.sample(sensor.respond(truth)[:: stride * every], seed)
            last = np.maximum.accumulate(np.where(arrived, np.arange(y.size), 0))
            data[:, i] = np.repeat(y[last], every)[: t.size]
            valid[::every, i] = arrived
        return FlightRecord(
            t_s=t,
            channels=self.channels,
            data=data,
            kind="measured",
            valid=valid,
            provenance={"suite": self.name, "seed": int(seed), "truth": dict(truth.provenance)},
            outcome=truth.outcome,
            reason=truth.reason,
        )


def lever_arm(truth: FlightRecord, position_m: Sequence[float]) -> FloatArray:
    """Return omegadot x r + omega x (omega x r), (n, 3) in m/s2: what a position adds to the specific force at the CG.

    Args:
        truth: record with p, q, r and their derivatives.
        position_m: r, from the centre of gravity, body axes, m.
    """
    rotation = truth.columns(_ROTATION)
    omega, omegadot, r = rotation[:, :3], rotation[:, 3:], np.asarray(position_m, float)
    return np.cross(omegadot, r) + np.cross(omega, np.cross(omega, r))


def first_order_lag(x: FloatArray, dt_s: float, lag_s: float) -> FloatArray:
    """Return the response (n,) of tau dy/dt + y = x to samples ``x`` (n,) joined by straight lines; exact.

    y_(k+1) = a y_k + b0 x_k + b1 x_(k+1) with a = exp(-h), h = dt / tau, b1 = 1 - (1 - a) / h, b0 = (1 - a) / h - a
    (first-order hold); y_0 = x_0, the steady state before the record.
    """
    from scipy.signal import lfilter

    h = dt_s / lag_s
    a, mean = math.exp(-h), -math.expm1(-h) / h
    return np.asarray(lfilter([1.0 - mean, mean - a], [1.0, -a], x - x[0]), float) + x[0]


def whole_ratio(fast_hz: float, slow_hz: float) -> int | None:
    """Return fast / slow if it is a whole number >= 1 (to 1e-6 of itself), else None."""
    ratio = fast_hz / slow_hz
    whole = round(ratio)
    return whole if whole >= 1 and abs(ratio - whole) <= _RATE_TOLERANCE * ratio else None


def suite_faults(rate_hz: float, sensors: Sequence[tuple[str, float | None]]) -> list[str]:
    """Return every law that a suite of (channel, own rate) breaks, each with its key."""
    if not (math.isfinite(rate_hz) and rate_hz > 0.0):
        return [f"rate_hz: 0 < rate_hz must hold, got {rate_hz:g}"]
    faults = [] if sensors else ["sensor: a suite must have at least one sensor, got none"]
    first: dict[str, int] = {}
    for i, (name, own_hz) in enumerate(sensors):
        if name in first:
            faults.append(
                f"sensor[{i}].channel: channels of a suite must differ, got '{name}' in sensor[{first[name]}] too"
            )
        first.setdefault(name, i)
        if own_hz is not None and own_hz > 0.0 and whole_ratio(rate_hz, own_hz) is None:
            faults.append(
                f"sensor[{i}].rate_hz: a sensor's rate must divide the suite's rate of {rate_hz:g} Hz, got "
                f"{own_hz:g} Hz for '{name}'; nearest valid: {_nearest_divisors(rate_hz, own_hz)}"
            )
    return faults


def _nearest_divisors(rate_hz: float, wanted_hz: float) -> str:
    """Return the rates next to ``wanted_hz`` that divide ``rate_hz``, in words."""
    below = max(1, math.ceil(rate_hz / wanted_hz))
    rates = [rate_hz / k for k in (below, below - 1) if k >= 1]
    return " or ".join(f"{rate:g} Hz" for rate in rates)


def _log_rate_fault(name: str, rate_hz: float, log_hz: float) -> str:
    below = math.floor(log_hz / rate_hz)
    rates = " or ".join(f"{k * rate_hz:g} Hz" for k in (below, below + 1) if k >= 1)
    return (
        f"the rate of sensor suite '{name}' must divide the rate at which the truth is logged, got {rate_hz:g} Hz into "
        f"{log_hz:g} Hz; log the truth at {rates} (simulation.log_rate_hz), or record at "
        f"{_nearest_divisors(log_hz, rate_hz)}"
    )
