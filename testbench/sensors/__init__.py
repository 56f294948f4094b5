"""Sensor models and the named sensor suites, read from TOML."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from testbench.channels import channel, unit_factor
from testbench.errors import ChannelError, ScenarioError, nearest
from testbench.paths import SUITES, suite_names
from testbench.schema import NonNegative, Positive, Strict, parse, read_toml
from testbench.sensors.sensor import Sensor, SensorSuite, suite_faults

__all__ = ["Sensor", "SensorSuite", "load_suite", "noise_std", "suite_table", "suite_toml"]

Text = Annotated[str, Field(min_length=1)]


class _SuiteFile(Strict):
    title: Text
    rate_hz: Positive
    sensor: Annotated[tuple[dict[str, Any], ...], Field(min_length=1, strict=False)]


class _SensorEntry(Strict):
    """One ``[[sensor]]``: noise, bias and quantum in ``unit``, noise density in ``unit`` per square root of Hz."""

    channel: Text
    unit: Text
    noise_std: NonNegative | None = None
    noise_density: NonNegative | None = None
    bandwidth_hz: Positive | None = None
    bias: float = 0.0
    scale: float = 1.0
    lag_s: NonNegative = 0.0
    delay_s: NonNegative = 0.0
    quantum: NonNegative = 0.0
    rate_hz: Positive | None = None
    dropout: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    position_m: Annotated[tuple[float, float, float], Field(strict=False)] = (0.0, 0.0, 0.0)
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
    """Read a sensor suite: a packaged one by name, or any ``.toml`` file.

    Raises:
        RecordError: the file cannot be read.
        ScenarioError: no such suite, or the file breaks laws; all of them are listed with file and key.
    """
    path = Path(name_or_path)
    if str(name_or_path) in suite_names():
        path = SUITES / f"{name_or_path}.toml"
    elif path.suffix != ".toml":
        raise ScenarioError(
            [
                f"a sensor suite must be a packaged one or a .toml file, got '{name_or_path}'"
                + nearest(str(name_or_path), suite_names())
            ]
        )
    content = read_toml(path)
    head, faults = parse(_SuiteFile, content, path)
    tables = [item for item in _listed(content.get("sensor")) if isinstance(item, Mapping)]
    sensors: list[Sensor] = []
    for i, table in enumerate(tables):
        sensor, found = _read_sensor(table, head.rate_hz if head else 1.0)
        faults.extend(f"{path}, sensor[{i}].{fault}" for fault in found)
        if sensor is not None:
            sensors.append(sensor)
    if head is not None:
        named = [
            (str(table.get("channel", f"sensor {i}")), _number(table.get("rate_hz"))) for i, table in enumerate(tables)
        ]
        faults.extend(f"{path}, {fault}" for fault in suite_faults(head.rate_hz, named))
    if faults or head is None:
        raise ScenarioError(faults)
    return SensorSuite(path.stem, head.title, head.rate_hz, tuple(sensors))


def suite_table() -> list[SensorSuite]:
    """Return all packaged suites, by name."""
    return [load_suite(name) for name in suite_names()]


def suite_toml(suite: SensorSuite) -> str:
    """Return a suite as the text of a .toml file that :func:`load_suite` reads back as it is; SI units."""
    lines = [f"title = {json.dumps(suite.title)}", f"rate_hz = {suite.rate_hz!r}"]
    for sensor in suite.sensors:
        lines += ["", "[[sensor]]", f'channel = "{sensor.channel}"', f'unit = "{channel(sensor.channel).unit}"']
        for key in ("noise_std", "bias", "scale", "lag_s", "delay_s", "quantum", "rate_hz", "dropout"):
            value = getattr(sensor, key)
            if value is not None:
                lines.append(f"{key} = {float(value)!r}")
        if any(sensor.position_m):
            lines.append(f"position_m = {list(sensor.position_m)}")
        lines += [f"{key} = {json.dumps(getattr(sensor, key), ensure_ascii=False)}" for key in ("part", "source")]
    return "\n".join(lines) + "\n"


def _read_sensor(table: Mapping[str, Any], suite_rate_hz: float) -> tuple[Sensor | None, list[str]]:
    """Return the sensor of one ``[[sensor]]`` table, if it could be built, and its faults, each with its key."""
    entry, faults = parse(_SensorEntry, table, None)
    if entry is None:
        return None, faults
    if entry.noise_std is not None and entry.noise_density is not None:
        faults.append("noise_density: give either noise_std or noise_density, got both")
    if entry.bandwidth_hz is not None and entry.noise_density is None:
        faults.append("bandwidth_hz: it goes with noise_density, which is missing")
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
    try:
        sensor = Sensor(
            channel=entry.channel,
            noise_std=std * factor,
            bias=entry.bias * factor,
            scale=entry.scale,
            lag_s=entry.lag_s,
            delay_s=entry.delay_s,
            quantum=entry.quantum * factor,
            rate_hz=entry.rate_hz,
            dropout=entry.dropout,
            position_m=entry.position_m,
            part=entry.part,
            source=entry.source,
        )
    except ScenarioError as error:
        return None, faults + list(error.faults)
    return sensor, faults


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else None
