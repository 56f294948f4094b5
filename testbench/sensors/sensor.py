"""Sensor: what one instrument reads of a true flight.

The effects come in the order in which a signal meets them: what the instrument feels where it is mounted (see
``kinds``), scale error, lag, delay and the clock of its recorder, sampling at its own rate, bias and its drifts, noise,
quantisation, dropout; the record holds the last sample taken until the next one.
"""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import channel, require
from testbench.core.errors import ChannelError, ScenarioError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.schema import OF_CHANNELS, OF_ITS_CHANNEL, QUANTITIES

ACCELEROMETERS = ("ax", "ay", "az")
ROTATION = ("p", "q", "r", "pdot", "qdot", "rdot")
_RATE_TOLERANCE = 1e-6  # relative
_STEP = 1e-5  # of the central differences of `weights`; what instruments feel is smooth on the scale of 1
_FASTEST_CLOCK_PPM = 1e4
_RANGED = (
    "noise_std", "lag_s", "delay_s", "quantum", "bias_walk", "drift_std", "price_eur", "mass_g", "bias", "scale",
    "bias_rate", "rate_hz", "clock_offset_s",
)  # fmt: skip
UNSAID: Mapping[str, Any] = {"said": False}
"""Metadata of a figure that the text of a sensor leaves out at its default. Keys of stored results are made of that
text, and a sensor without the figure is the one that it was before there was such a figure."""


@dataclass(frozen=True)
class Sensor:
    """One instrument: y = Q(s x(t - T) lagged + b + b' t + n), sampled at its own rate, with samples lost at random.

    Values are in the channel's SI unit. This class reads its channel as it is; the classes in ``kinds`` say what a
    real instrument feels instead.

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
        position_m: position from the centre of gravity, body axes forward, right, down, m. For ax, ay, az:
            a_P = a_CG + omegadot x r + omega x (omega x r), rigid body; for vanes see ``kinds.flow_vane``,
            for airspeed ``kinds.pitot``.
        part: the real part that it stands for.
        source: where its figures come from.
        bias_walk: growth of a bias that walks at random from zero, per square root of s.
        drift_std, drift_time_s: standard deviation and correlation time of a bias that wanders about ``bias``
            (first-order Gauss-Markov process, steady from the first sample).
        recorder: the recorder that stamps its samples, if it is not the one that all others share.
        clock_offset_s, clock_ppm: how far that recorder's clock is ahead of the flight's at t = 0, and how fast it
            runs away: a sample stamped t was taken at t - clock_offset_s - clock_ppm 1e-6 t.
        price_eur, mass_g: of the part with its mounting, where known.
        bias_rate: steady drift, per s: the bias grows by it every second from the first sample of the flight on, where
            it is ``bias``. Unlike the drifts by chance it is certain, as scale and lag are.

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
    bias_walk: float = 0.0
    drift_std: float = 0.0
    drift_time_s: float | None = None
    recorder: str = ""
    clock_offset_s: float = 0.0
    clock_ppm: float = 0.0
    price_eur: float | None = None
    mass_g: float | None = None
    bias_rate: float = field(default=0.0, metadata=UNSAID)

    KIND: ClassVar[str] = ""
    READS: ClassVar[str] = ".*"
    """Pattern of the channels that this kind of instrument measures."""
    PLACED: ClassVar[tuple[str, ...]] = ACCELEROMETERS
    """Channels whose reading depends on the position."""
    IN_FILES: ClassVar[Mapping[str, tuple[str, float]]] = {}
    """Key in a file -> field of this kind and factor to SI, where they differ."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        cls.__repr__ = Sensor.__repr__  # type: ignore[method-assign]  # which the dataclass of a kind would replace

    def __repr__(self) -> str:
        said = (f for f in fields(self) if f.metadata.get("said", True) or getattr(self, f.name) != f.default)
        return f"{type(self).__qualname__}({', '.join(f'{f.name}={getattr(self, f.name)!r}' for f in said)})"

    def __post_init__(self) -> None:
        object.__setattr__(self, "position_m", tuple(float(x) for x in self.position_m))
        faults = [*self._faults(), *self._clock_faults(), *self._kind_faults()]
        if faults:
            raise ScenarioError(faults)

    def _faults(self) -> Iterator[str]:
        most = math.inf
        try:
            most = OF_CHANNELS[channel(self.channel).unit]
        except ChannelError as error:
            yield f"channel: {error}"
        for key in _RANGED:
            value, (unit, low, high) = getattr(self, key), QUANTITIES[key]
            if unit == OF_ITS_CHANNEL:
                low, high = max(low, -most), min(high, most)
            if value is not None and not low <= value <= high:
                yield f"{key}: {low:g} <= {key} <= {high:g} must hold, got {value:g}"
        if not 0.0 <= self.dropout < 1.0:
            yield f"dropout: 0 <= dropout < 1 must hold for a probability, got {self.dropout:g}"
        if len(self.position_m) != 3 or not all(math.isfinite(x) for x in self.position_m):
            yield f"position_m: three finite numbers (forward, right, down) are needed, got {self.position_m}"
        elif any(self.position_m) and self.channel not in self.PLACED:
            yield (
                f"position_m: a position matters to {', '.join(self.PLACED) or 'no channel of this kind'} only, got "
                f"one for '{self.channel}'; leave it out"
            )
        if self.channel == "psi" and self.scale != 1.0:
            yield f"scale: a heading has no zero to scale from, scale = 1 must hold for psi, got {self.scale:g}"

    def _clock_faults(self) -> Iterator[str]:
        if (self.drift_std > 0.0) != (self.drift_time_s is not None):
            yield "drift_time_s: drift_std and drift_time_s go together; give both or neither"
        elif self.drift_time_s is not None and not (math.isfinite(self.drift_time_s) and self.drift_time_s > 0.0):
            yield f"drift_time_s: 0 < drift_time_s must hold, got {self.drift_time_s:g}"
        if not abs(self.clock_ppm) <= _FASTEST_CLOCK_PPM:
            yield f"clock_ppm: |clock_ppm| <= {_FASTEST_CLOCK_PPM:g} must hold, got {self.clock_ppm:g}"
        if (self.clock_offset_s or self.clock_ppm) and not self.recorder:
            yield "recorder: a clock of its own belongs to a recorder; name the recorder"

    def _kind_faults(self) -> Iterator[str]:
        """Yield the laws that a kind adds."""
        if not re.fullmatch(self.READS, self.channel):
            words = self.READS.replace("|", ", ").replace(r"\d+", "1, ...").replace(".*", "")
            yield f"channel: a sensor of kind {self.KIND} measures {words}; got '{self.channel}'"

    @property
    def needs(self) -> tuple[str, ...]:
        """The channels of the true record that it is computed from, its own first."""
        return (self.channel, *ROTATION) if any(self.position_m) else (self.channel,)

    def feel(self, x: Mapping[str, FloatArray]) -> FloatArray:
        """Return what acts on the instrument (n,), from the true channels of :attr:`needs`, each (n,)."""
        out = x[self.channel]
        if any(self.position_m):
            arm = lever(np.column_stack([x[name] for name in ROTATION]), self.position_m)
            out = out + arm[:, ACCELEROMETERS.index(self.channel)]
        return out

    def weights(self, trim: Mapping[str, float]) -> dict[str, float]:
        """Return d feel / d channel at trim, for small motion; the scale factor is not in it.

        Args:
            trim: value of every channel of :attr:`needs` in trimmed flight, SI.
        """
        require(self.needs, trim, f"sensor '{self.channel}'")
        at = {name: np.full(2, trim[name]) for name in self.needs}
        out = {}
        for name in self.needs:
            low, high = self.feel(at | {name: trim[name] + _STEP * np.array([-1.0, 1.0])})
            out[name] = float(high - low) / (2.0 * _STEP)
        return out

    def respond(self, truth: FlightRecord) -> FloatArray:
        """Return what is felt, scale, lag, delay and steady drift, on the truth's own time grid (n,); without noise.

        Raises:
            ChannelError: the truth lacks a channel of :attr:`needs`.
        """
        return responses([self], truth)[:, 0]

    def _scaled(self, truth: FlightRecord) -> FloatArray:
        """Return what is felt, times the scale factor (n,)."""
        require(self.needs, truth.channels, f"sensor '{self.channel}'")
        x = self.feel({name: truth[name] for name in self.needs})
        if self.channel == "psi":
            x = np.unwrap(x)
        return self.scale * x

    def _late(self, x: FloatArray, t_s: FloatArray) -> FloatArray:
        """Return ``x`` (n,) as its delay and its clock make it of samples at ``t_s`` (n,)."""
        if not (self.delay_s > 0.0 or self.clock_offset_s or self.clock_ppm):
            return x
        late = self.delay_s + self.clock_offset_s + 1e-6 * self.clock_ppm * t_s
        return np.interp(t_s - late, t_s, x)

    def drifted(self, t_s: FloatArray) -> FloatArray | float:
        """Return how far its steady drift has taken it at the times ``t_s`` (n,) since the first of them."""
        return self.bias_rate * (t_s - t_s[0]) if self.bias_rate else 0.0

    def sample(self, x: FloatArray, seed: int, dt_s: float = 1.0) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the samples (m,) that the sensor delivers for its responses ``x`` (m,), and which of them arrive.

        The generator is ``SeedSequence([seed, crc32(channel)])``, so that a sensor's noise depends neither on the other
        sensors nor on the length of the flight; its first child decides which samples are lost, its second one
        makes the bias drift.

        Args:
            x: responses at the sensor's own rate.
            seed: >= 0.
            dt_s: its own sample time; matters to a drifting bias only.
        """
        entropy = [seed, zlib.crc32(self.channel.encode())]
        root = np.random.SeedSequence(entropy)
        y = x + self.bias + self.noise_std * np.random.default_rng(root).standard_normal(x.size)
        if self.drift_std > 0.0 or self.bias_walk > 0.0:
            drift = np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=(1,)))
            y = y + self._drift(x.size, dt_s, drift)
        if self.quantum > 0.0:
            y = self.quantum * np.rint(y / self.quantum)
        if self.channel == "psi":
            y = np.mod(y, 2.0 * np.pi)
            y[y >= 2.0 * np.pi] = 0.0  # mod of a tiny negative number rounds up to 2 pi itself
        if self.dropout == 0.0:
            return y, np.ones(x.size, bool)
        losses = np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=(0,)))
        arrived = losses.random(x.size) >= self.dropout
        arrived[:1] = True
        return y, arrived

    def drift_over(self, duration_s: float) -> float:
        """Return by how much the bias wanders about its mean over a flight of that length: expected rms, SI.

        A random walk of growth w: w sqrt(T / 6); a Gauss-Markov process of deviation s and correlation time T1, with
        x = T / T1: s sqrt(1 - 2 (x - 1 + exp(-x)) / x^2).
        """
        square = self.bias_walk**2 * duration_s / 6.0
        if self.drift_time_s is not None:
            x = duration_s / self.drift_time_s
            square += self.drift_std**2 * (1.0 - 2.0 * (x + math.expm1(-x)) / x**2)
        return math.sqrt(max(square, 0.0))

    def _drift(self, n: int, dt_s: float, rng: np.random.Generator) -> FloatArray:
        """Return the part of the bias that changes (n,): b' = a b + std sqrt(1 - a^2) w with a = exp(-dt / T), and a
        random walk.
        """
        from scipy.signal import lfilter

        w = rng.standard_normal((n, 2))  # row by row, so that a shorter flight sees the same beginning
        out = np.zeros(n)
        if self.drift_std > 0.0 and self.drift_time_s is not None:
            a = math.exp(-dt_s / self.drift_time_s)
            shocks = self.drift_std * np.where(np.arange(n) == 0, 1.0, math.sqrt(1.0 - a * a)) * w[:, 0]
            out += lfilter([1.0], [1.0, -a], shocks)
        if self.bias_walk > 0.0 and n:
            out[1:] += self.bias_walk * math.sqrt(dt_s) * np.cumsum(w[1:, 1])
        return out


def responses(sensors: Sequence[Sensor], truth: FlightRecord) -> FloatArray:
    """Return :meth:`Sensor.respond` of several instruments, (n, sensors).

    Those of one lag pass through it together, which takes a third of the time that each by itself would.

    Raises:
        ChannelError: the truth lacks a channel that one of them needs.
    """
    out = np.empty((len(truth), len(sensors)))
    for i, sensor in enumerate(sensors):
        out[:, i] = sensor._scaled(truth)
    for lag_s in {s.lag_s for s in sensors if s.lag_s > 0.0}:
        alike = [i for i, s in enumerate(sensors) if s.lag_s == lag_s]
        out[:, alike] = first_order_lag(out[:, alike], truth.dt_s, lag_s)
    for i, sensor in enumerate(sensors):
        out[:, i] = sensor._late(out[:, i], truth.t_s)
        if sensor.bias_rate:
            out[:, i] += sensor.drifted(truth.t_s)
    return out


def lever(rotation: FloatArray, position_m: Sequence[float]) -> FloatArray:
    """Return omegadot x r + omega x (omega x r), (n, 3), of ``rotation`` p, q, r, pdot, qdot, rdot (n, 6)."""
    omega, omegadot, r = rotation[:, :3], rotation[:, 3:], np.asarray(position_m, float)
    return np.cross(omegadot, r) + np.cross(omega, np.cross(omega, r))


def first_order_lag(x: FloatArray, dt_s: float, lag_s: float) -> FloatArray:
    """Return the response (n, ...) of tau dy/dt + y = x to samples ``x`` (n, ...) joined by straight lines; exact.

    y_(k+1) = a y_k + b0 x_k + b1 x_(k+1) with a = exp(-h), h = dt / tau, b1 = 1 - (1 - a) / h, b0 = (1 - a) / h - a
    (first-order hold); y_0 = x_0, the steady state before the record.
    """
    from scipy.signal import lfilter

    a, b0, b1 = lag_weights(dt_s, lag_s)
    return np.asarray(lfilter([b1, b0], [1.0, -a], x - x[0], axis=0), float) + x[0]


def lag_weights(dt_s: float, lag_s: float) -> tuple[float, float, float]:
    """Return a, b0 and b1 of :func:`first_order_lag`."""
    h = dt_s / lag_s
    a, mean = math.exp(-h), -math.expm1(-h) / h
    return a, mean - a, 1.0 - mean


def whole_ratio(fast_hz: float, slow_hz: float) -> int | None:
    """Return fast / slow if it is a whole number >= 1 (to 1e-6 of itself), else None."""
    ratio = fast_hz / slow_hz
    whole = round(ratio)
    return whole if whole >= 1 and abs(ratio - whole) <= _RATE_TOLERANCE * ratio else None
