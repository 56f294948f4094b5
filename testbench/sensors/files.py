"""Suite files: TOML in, SensorSuite out, and back."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Annotated, Any, get_type_hints

from pydantic import Field, create_model

from testbench.core.channels import channel, unit_factor
from testbench.core.door import read_toml
from testbench.core.errors import ChannelError, ScenarioError, nearest
from testbench.core.paths import SENSOR_SUITES, SUITES, resolve, suite_names
from testbench.core.schema import NonNegative, Positive, Strict, parse
from testbench.sensors.kinds import KINDS
from testbench.sensors.sensor import Sensor
from testbench.sensors.suite import SensorSuite, suite_faults

Text = Annotated[str, Field(min_length=1)]

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


class _Recorder(Strict):
    clock_offset_s: float = 0.0
    clock_ppm: float = 0.0


class SuiteFile(Strict):
    """A sensor suite: its rate, the clocks of its recorders, and its ``[[sensor]]`` tables."""

    title: Text
    rate_hz: Positive
    recorder: dict[str, _Recorder] = {}
    sensor: Annotated[tuple[dict[str, Any], ...], Field(min_length=1, strict=False)]


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
    lines = [f"title = {json.dumps(suite.title)}", f"rate_hz = {suite.rate_hz!r}"]
    clocks = {s.recorder: s for s in suite.sensors if s.recorder}
    for name, s in clocks.items():
        lines += ["", f"[recorder.{json.dumps(name)}]", f"clock_offset_s = {float(s.clock_offset_s)!r}"]
        lines.append(f"clock_ppm = {float(s.clock_ppm)!r}")
    plain = {f.name: f.default for f in fields(Sensor)}
    # those that are written where they say something
    later = ("bias_walk", "bias_rate", "drift_std", "drift_time_s", "price_eur", "mass_g")
    for sensor in suite.sensors:
        lines += ["", "[[sensor]]", f'channel = "{sensor.channel}"', f'unit = "{channel(sensor.channel).unit}"']
        if sensor.KIND:
            lines.append(f'kind = "{sensor.KIND}"')
        for key in ("noise_std", "bias", "scale", "lag_s", "delay_s", "quantum", "rate_hz", "dropout", *later):
            value = getattr(sensor, key)
            if value is not None and not (key in later and value == plain[key]):
                lines.append(f"{key} = {float(value)!r}")
        if any(sensor.position_m):
            lines.append(f"position_m = {list(sensor.position_m)}")
        lines += [f"{key} = {_toml(value)}" for key, value in _own(sensor).items()]
        if sensor.recorder:
            lines.append(f"recorder = {json.dumps(sensor.recorder)}")
        lines += [f"{key} = {json.dumps(getattr(sensor, key), ensure_ascii=False)}" for key in ("part", "source")]
    return "\n".join(lines) + "\n"


def _own(sensor: Sensor) -> dict[str, Any]:
    """Return key -> value in files of the figures that a sensor's kind adds."""
    names = {field: (key, factor) for key, (field, factor) in sensor.IN_FILES.items()}
    common = {f.name for f in fields(Sensor)}
    out = {}
    for f in fields(sensor):
        value = getattr(sensor, f.name)
        if f.name not in common and value != f.default:
            key, factor = names.get(f.name, (f.name, 1.0))
            out[key] = [x / factor for x in value] if isinstance(value, tuple) else value / factor
    return out


def _toml(value: Any) -> str:
    return f"[{', '.join(repr(float(x)) for x in value)}]" if isinstance(value, list) else repr(float(value))


@cache
def _schema(name: str) -> type[SensorEntry]:
    """Return the schema of a ``[[sensor]]`` of a kind: the common keys and those that it adds."""
    kind = KINDS.get(name, Sensor)
    names = {field: key for key, (field, _) in kind.IN_FILES.items()}
    hints, common = get_type_hints(kind), {f.name for f in fields(Sensor)}
    extra: dict[str, Any] = {
        names.get(f.name, f.name): (Annotated[hints[f.name], Field(strict=False)], f.default)
        for f in fields(kind)
        if f.name not in common
    }
    return create_model(f"{kind.__name__}Entry", __base__=SensorEntry, **extra)


def _own_values(kind: type[Sensor], entry: SensorEntry) -> dict[str, Any]:
    """Return the figures that a kind adds, SI, out of an entry of its schema."""
    names = {field: (key, factor) for key, (field, factor) in kind.IN_FILES.items()}
    common = {f.name for f in fields(Sensor)}
    out = {}
    for f in fields(kind):
        if f.name not in common:
            key, factor = names.get(f.name, (f.name, 1.0))
            value = getattr(entry, key)
            out[f.name] = tuple(x * factor for x in value) if isinstance(value, tuple) else value * factor
    return out


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
    values = {key: getattr(entry, key) for key in _AS_IS} | _own_values(kind, entry)
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
