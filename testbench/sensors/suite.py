"""SensorSuite: the instruments of one aircraft, and the record that they make of a flight."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import numpy as np
from pydantic import Field, create_model

from testbench.core.channels import CONTROLS, SURFACES, channel, require, unit_factor
from testbench.core.door import read_toml
from testbench.core.errors import ChannelError, RecordError, ScenarioError, nearest
from testbench.core.escape import table_lines
from testbench.core.paths import SENSOR_SUITES, SUITES, resolve, suite_names
from testbench.core.record import FlightRecord
from testbench.core.schema import NonNegative, Positive, Strict, Text, parse
from testbench.sensors.kinds import KINDS
from testbench.sensors.sensor import Sensor, responses, whole_ratio

_IN_UNIT = ("bias", "quantum", "bias_walk", "drift_std", "bias_rate")  # figures in the unit that the file names
_AS_IS = (
    "scale",
    "lag_s",
    "delay_s",
    "rate_hz",
    "dropout",
    "position_m",
    "part",
    "source",
    "drift_time_s",
    "recorder",
    "price_eur",
    "mass_g",
)
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

    def sensing(self, outputs: Sequence[str] = ()) -> tuple[Sensor, ...]:
        """Return the sensors of the motion: of ``outputs`` alone, if any are given."""
        return tuple(s for s in self.sensors if s.channel in self.outputs and (not outputs or s.channel in outputs))

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


# --- files ------------------------------------------------------------------------------------------------------------


class _Recorder(Strict):
    clock_offset_s: float = 0.0
    clock_ppm: float = 0.0


class SuiteFile(Strict):
    """A sensor suite: its rate, the clocks of its recorders, and its ``[[sensor]]`` tables."""

    title: Text
    rate_hz: Positive
    recorder: dict[str, _Recorder] = {}
    sensor: Annotated[
        tuple[dict[str, Any], ...],
        Field(min_length=1, strict=False, json_schema_extra=lambda s: s.update(items=any_entry().model_json_schema())),
    ]


class SensorEntry(Strict):
    """One ``[[sensor]]``: noise, bias and quantum in ``unit``, noise density in ``unit`` per square root of Hz,
    random walk of the bias in ``unit`` per square root of s, its steady drift per s. ``cutoff_hz`` is another way to
    say ``lag_s``.
    """

    channel: Text
    kind: Text | None = None
    unit: Text
    noise_std: NonNegative | None = None
    noise_density: NonNegative | None = None
    bandwidth_hz: Positive | None = None
    bias: float = 0.0
    bias_walk: NonNegative = 0.0
    bias_rate: float = 0.0
    drift_std: NonNegative = 0.0
    drift_time_s: Positive | None = None
    scale: float = 1.0
    lag_s: NonNegative = 0.0
    cutoff_hz: Positive | None = None
    delay_s: NonNegative = 0.0
    quantum: NonNegative = 0.0
    rate_hz: Positive | None = None
    dropout: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    position_m: Annotated[tuple[float, float, float], Field(strict=False)] = (0.0, 0.0, 0.0)
    recorder: str = ""
    price_eur: NonNegative | None = None
    mass_g: NonNegative | None = None
    part: Text
    source: Text


def noise_std(density: float, rate_hz: float, bandwidth_hz: float | None = None) -> float:
    """Return the standard deviation of one sample of white noise of one-sided ``density``, unit per sqrt(Hz).

    std = density sqrt(B): the variance is the noise power within the bandwidth B of the filter ahead of the sampler. By
    default B = rate / 2, an ideal anti-alias filter at the Nyquist frequency. A sensor that is logged more slowly than
    its filter settles folds all its noise into the samples: then B is the filter's noise bandwidth, whatever the rate.
    """
    return density * math.sqrt(0.5 * rate_hz if bandwidth_hz is None else bandwidth_hz)


def load_suite(name_or_path: str | Path) -> SensorSuite:
    """Read a sensor suite: a packaged one by name, a ``.toml`` file, or a name in the user's folder ``suites/``.

    Raises:
        RecordError: the file cannot be read.
        ScenarioError: no such suite, or the file breaks laws; all of them are listed with file and key.

    Example:
        >>> import testbench as tb
        >>> tb.load_suite("eolo_alpha").channels
        ('V', 'alpha', 'q', 'theta', 'de')
    """
    path = Path(name_or_path)
    if path.suffix != ".toml" or path.is_file():
        named = resolve(str(name_or_path), SENSOR_SUITES)
        path = SUITES / f"{named}.toml" if named in suite_names() else Path(named)
    content = read_toml(path, "suite")
    head, faults = parse(SuiteFile, content, path)
    tables = [item for item in _listed(content.get("sensor")) if isinstance(item, Mapping)]
    sensors: list[Sensor] = []
    for i, table in enumerate(tables):
        sensor, found = _read_sensor(table, head.rate_hz if head else 1.0, head.recorder if head else {})
        faults.extend(f"{path}, sensor[{i}].{fault}" for fault in found)
        if sensor is not None:
            sensors.append(sensor)
    if head is not None:
        sensed = [
            (str(table.get("channel", f"sensor {i}")), _number(table.get("rate_hz"))) for i, table in enumerate(tables)
        ]
        faults.extend(f"{path}, {fault}" for fault in suite_faults(head.rate_hz, sensed))
    if faults or head is None:
        raise ScenarioError(faults)
    return SensorSuite(path.stem, head.title, head.rate_hz, tuple(sensors))


def suite_table() -> list[SensorSuite]:
    """Return all packaged suites, by name."""
    return [load_suite(name) for name in suite_names()]


def suite_toml(suite: SensorSuite) -> str:
    """Return a suite as the text of a .toml file that :func:`load_suite` reads back as it is; SI units."""
    clocks = {s.recorder: s for s in suite.sensors if s.recorder}
    recorders = {
        name: {"clock_offset_s": float(s.clock_offset_s), "clock_ppm": float(s.clock_ppm)} for name, s in clocks.items()
    }
    head = {"title": suite.title, "rate_hz": suite.rate_hz, "recorder": recorders}
    return "\n".join(table_lines({**head, "sensor": [_table(sensor) for sensor in suite.sensors]})) + "\n"


def _table(sensor: Sensor) -> dict[str, Any]:
    """Return a sensor as a ``[[sensor]]``, SI units."""
    plain = {f.name: f.default for f in fields(Sensor)}
    # those that are written where they say something
    later = ("bias_walk", "bias_rate", "drift_std", "drift_time_s", "price_eur", "mass_g")
    figures = {}
    for key in ("noise_std", "bias", "scale", "lag_s", "delay_s", "quantum", "rate_hz", "dropout", *later):
        value = getattr(sensor, key)
        if value is not None and not (key in later and value == plain[key]):
            figures[key] = float(value)
    return {
        "channel": sensor.channel,
        "unit": channel(sensor.channel).unit,
        "kind": sensor.KIND or None,
        **figures,
        "position_m": list(sensor.position_m) if any(sensor.position_m) else None,
        **{
            key: [float(x / factor) for x in value] if isinstance(value, tuple) else float(value / factor)
            for f, key, factor in _figures(type(sensor))
            if (value := getattr(sensor, f.name)) != f.default
        },
        "recorder": sensor.recorder or None,
        "part": sensor.part,
        "source": sensor.source,
    }


def _figures(kind: type[Sensor]) -> tuple[tuple[Any, str, float], ...]:
    """Return field, key in files, and SI value of one there, of each figure that a kind of sensor adds."""
    names = {field: (key, factor) for key, (field, factor) in kind.IN_FILES.items()}
    common = {f.name for f in fields(Sensor)}
    return tuple((f, *names.get(f.name, (f.name, 1.0))) for f in fields(kind) if f.name not in common)


def _times(value: Any, factor: float) -> Any:
    return tuple(x * factor for x in value) if isinstance(value, tuple) else value * factor


@cache
def _schema(name: str) -> type[SensorEntry]:
    """Return the schema of a ``[[sensor]]`` of a kind: the common keys and those that it adds."""
    kind = KINDS.get(name, Sensor)
    hints = get_type_hints(kind)
    extra: dict[str, Any] = {
        key: (Annotated[hints[f.name], Field(strict=False)], f.default) for f, key, _ in _figures(kind)
    }
    return create_model(f"{kind.__name__}Entry", __base__=SensorEntry, **extra)


@cache
def any_entry() -> type[SensorEntry]:
    """Return the schema of a ``[[sensor]]`` with the keys of all kinds, for editors and the reference."""
    kinds = {name: set(_schema(name).model_fields) - set(SensorEntry.model_fields) for name in KINDS}
    extra: dict[str, Any] = {
        key: (field.annotation, field)
        for name, own in kinds.items()
        for key, field in _schema(name).model_fields.items()
        if key in own
    }
    extra["kind"] = (str | None, Field(None, json_schema_extra={"enum": [*KINDS]}))
    return create_model("SensorEntry", __base__=SensorEntry, __doc__=SensorEntry.__doc__, **extra)


def kind_rows() -> list[tuple[str, str, str, str]]:
    """Return name, channels, own keys and words of every kind of sensor."""
    return [
        (
            name,
            kind.READS.replace("|", ", ").replace(r"\d+", "1, ..."),
            ", ".join(key for _, key, _ in _figures(kind)),
            (sys.modules[kind.__module__].__doc__ or "").partition("\n")[0],
        )
        for name, kind in KINDS.items()
    ]


def _read_sensor(
    table: Mapping[str, Any], suite_rate_hz: float, recorders: Mapping[str, _Recorder]
) -> tuple[Sensor | None, list[str]]:
    """Return the sensor of one ``[[sensor]]`` table, if it could be built, and its faults, each with its key."""
    name = table.get("kind")
    kind = KINDS.get(str(name), Sensor)
    entry, faults = parse(_schema(kind.KIND), table, None)
    if isinstance(name, str) and name not in KINDS:
        faults.append(f"kind: unknown kind of sensor '{name}'{nearest(name, KINDS)}")
    if entry is None:
        return None, faults
    faults += _entry_faults(entry, recorders)
    std = entry.noise_std or 0.0
    if entry.noise_density is not None:
        std = noise_std(entry.noise_density, entry.rate_hz or suite_rate_hz, entry.bandwidth_hz)
    key = "channel"
    try:
        channel(entry.channel)
        key = "unit"
        factor = unit_factor(entry.channel, entry.unit)
    except ChannelError as error:
        faults.append(f"{key}: {error}")
        factor = 1.0  # go on: the other figures may have faults of their own
        if key == "channel":
            return None, faults
    clock = recorders.get(entry.recorder, _Recorder())
    values = {key: getattr(entry, key) for key in _AS_IS}
    values |= {f.name: _times(getattr(entry, key), factor) for f, key, factor in _figures(kind)}
    values |= {key: getattr(entry, key) * factor for key in _IN_UNIT}
    if entry.cutoff_hz is not None:
        values["lag_s"] = 1.0 / (2.0 * math.pi * entry.cutoff_hz)
    try:
        sensor = kind(
            channel=entry.channel,
            noise_std=std * factor,
            clock_offset_s=clock.clock_offset_s,
            clock_ppm=clock.clock_ppm,
            **values,
        )
    except ScenarioError as error:
        return None, faults + list(error.faults)
    return sensor, faults


def _entry_faults(entry: SensorEntry, recorders: Mapping[str, _Recorder]) -> list[str]:
    """Return what keys say against each other."""
    faults = []
    if entry.noise_std is not None and entry.noise_density is not None:
        faults.append("noise_density: give either noise_std or noise_density, got both")
    if entry.bandwidth_hz is not None and entry.noise_density is None:
        faults.append("bandwidth_hz: it goes with noise_density, which is missing")
    if entry.cutoff_hz is not None and entry.lag_s > 0.0:
        faults.append("cutoff_hz: give either lag_s or cutoff_hz (lag_s = 1 / (2 pi cutoff_hz)), got both")
    if entry.recorder and entry.recorder not in recorders:
        hint = nearest(entry.recorder, recorders) or "; add a table [recorder." + entry.recorder + "]"
        faults.append(f"recorder: it must name a table [recorder.NAME] of the file, got '{entry.recorder}'{hint}")
    return faults


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else None
