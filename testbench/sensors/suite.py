"""SensorSuite: the instruments of one aircraft, and the record that they make of a flight."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.core.channels import CONTROLS, SURFACES, require
from testbench.core.errors import RecordError, ScenarioError
from testbench.core.record import FlightRecord
from testbench.sensors.sensor import Sensor, responses, whole_ratio

_COMMANDS = tuple(f"{name}_cmd" for name in CONTROLS)


MOTIONS = {"longitudinal": ("alpha", "q"), "lateral": ("beta", "p", "r")}
"""Motion -> channels of which one at least tells its derivatives."""


def needed(motion: str = "") -> str:
    """Return in words which channels a motion takes; of all motions if none is named."""
    if motion:
        return " or ".join(MOTIONS[motion])
    return "; ".join(f"{needed(each)} for the {each} one" for each in MOTIONS)


@dataclass(frozen=True)
class SensorSuite:
    """The instruments of one aircraft and the rate of its log.

    Args:
        name: short name, as in a scenario.
        title: what it stands for, in words.
        rate_hz: rate of the log; it divides the rate at which the truth is logged.
        sensors: one per channel.

    Raises:
        ScenarioError: no sensor, two of one channel, a sensor whose rate does not divide the suite's, or sensors of
            one recorder with different clocks.
    """

    name: str
    title: str
    rate_hz: float
    sensors: tuple[Sensor, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensors", tuple(self.sensors))
        faults = suite_faults(self.rate_hz, [(s.channel, s.rate_hz) for s in self.sensors])
        faults += _recorder_faults(self.sensors)
        if faults:
            raise ScenarioError(faults)

    def sees(self, motion: str) -> bool:
        """Return whether something of a motion of :data:`MOTIONS` is sensed that its derivatives could be told from."""
        return bool(set(MOTIONS[motion]) & set(self.channels))

    @property
    def channels(self) -> tuple[str, ...]:
        """The recorded channels, in the order of the sensors."""
        return tuple(sensor.channel for sensor in self.sensors)

    @property
    def outputs(self) -> tuple[str, ...]:
        """The recorded channels that are neither controls nor commands."""
        return tuple(name for name in self.channels if name not in (*CONTROLS, *_COMMANDS))

    @property
    def surfaces(self) -> tuple[str, ...]:
        """The recorded control surfaces."""
        return tuple(name for name in self.channels if name in SURFACES)

    @property
    def noise_std(self) -> dict[str, float]:
        """Channel -> standard deviation of one sample, noise and rounding (quantum / sqrt 12) together, SI."""
        return {s.channel: math.hypot(s.noise_std, s.quantum / math.sqrt(12.0)) for s in self.sensors}

    @property
    def price_eur(self) -> float | None:
        """Price of all sensors, or None if that of one is not known."""
        return _total(s.price_eur for s in self.sensors)

    @property
    def mass_g(self) -> float | None:
        """Mass of all sensors, or None if that of one is not known."""
        return _total(s.mass_g for s in self.sensors)

    def without_errors(self) -> SensorSuite:
        """Return the suite without noise, dropouts and biases; lags, delays and steady drifts stay."""
        perfect = {"noise_std": 0.0, "bias": 0.0, "quantum": 0.0, "dropout": 0.0, "bias_walk": 0.0, "drift_std": 0.0}
        sensors = tuple(replace(s, **perfect, drift_time_s=None) for s in self.sensors)  # type: ignore[arg-type]
        return replace(self, sensors=sensors)

    def check_log_rate(self, log_hz: float) -> int:
        """Return how many samples of a truth logged at ``log_hz`` make one of the suite's.

        Raises:
            ScenarioError: the suite's rate does not divide it.
        """
        stride = whole_ratio(log_hz, self.rate_hz)
        if stride is None:
            raise ScenarioError(_log_rate_fault(self.name, self.rate_hz, log_hz))
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
            raise ScenarioError(f"0 <= seed must hold, got {seed}")
        needed = dict.fromkeys(name for sensor in self.sensors for name in sensor.needs)
        require(needed, truth.channels, f"sensor suite '{self.name}'")
        stride = self.check_log_rate(1.0 / truth.dt_s)
        t = truth.t_s[::stride]
        data, valid = np.empty((t.size, len(self.sensors))), np.zeros((t.size, len(self.sensors)), bool)
        felt = responses(self.sensors, truth)
        for i, sensor in enumerate(self.sensors):
            every = whole_ratio(self.rate_hz, sensor.rate_hz or self.rate_hz) or 1
            y, arrived = sensor.sample(felt[:: stride * every, i], seed, every / self.rate_hz)
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


def _recorder_faults(sensors: Sequence[Sensor]) -> list[str]:
    """Return a fault for each sensor whose recorder shows another sensor another clock."""
    clocks: dict[str, tuple[float, float]] = {}
    faults = []
    for i, s in enumerate(sensors):
        clock = (s.clock_offset_s, s.clock_ppm)
        if s.recorder and clocks.setdefault(s.recorder, clock) != clock:
            faults.append(f"sensor[{i}].recorder: the sensors of recorder '{s.recorder}' must share one clock")
    return faults


def _total(values: Iterable[float | None]) -> float | None:
    found = list(values)
    return None if any(v is None for v in found) else float(sum(v for v in found if v is not None))


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
