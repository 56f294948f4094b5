"""The laws of sensor suites, packaged or brought, tried on a smooth synthetic flight."""

from __future__ import annotations

import numpy as np

from testbench.core.channels import CHANNELS, station_channels
from testbench.core.contract import Law
from testbench.core.record import FlightRecord, FloatArray
from testbench.sensors.sensor import Sensor
from testbench.sensors.suite import SensorSuite

SECONDS = 20.0
_STATIONS = 11


def synthetic_flight(rate_hz: float) -> FlightRecord:
    """Return a smooth truth with all channels, those of eleven wing stations too, logged at three times ``rate_hz``."""
    names = (*CHANNELS, *station_channels(_STATIONS, flexible=True))
    t = np.arange(round(3.0 * rate_hz * SECONDS) + 1) / (3.0 * rate_hz)
    data = np.column_stack([1.0 + 0.1 * np.sin(t * (0.5 + 0.05 * i) + i) for i in range(len(names))])
    return FlightRecord(t, names, data, "truth", provenance={"aircraft": "synthetic"})


def suite_laws(suite: SensorSuite) -> list[Law]:
    """Return every law of suites and whether this suite keeps it.

    Noise is held to six standard deviations, which one of 2000 samples exceeds with probability 4e-6.
    """
    truth = synthetic_flight(suite.rate_hz)
    record = suite.measure(truth, 1)
    again = suite.measure(truth, 1)
    columns = list(zip(suite.sensors, record.data.T, strict=True))
    far = [s.channel for s, column in columns if not _near(suite, s, truth, column)]
    silent = [s.channel for s, column in columns if _faulty(s) != bool(np.any(column != _exact(s, truth)))]
    return [
        Law("has a title", bool(suite.title), "give title"),
        Law("records are measured, not true", record.kind == "measured", f"kind is '{record.kind}'"),
        Law("records have the channels of its sensors", record.channels == suite.channels, ", ".join(record.channels)),
        Law("records have its rate", abs(record.dt_s * suite.rate_hz - 1.0) <= 1e-9, f"{1.0 / record.dt_s:g} Hz"),
        Law("the first sample of every channel is taken", bool(record.valid[0].all()), "a channel begins without one"),
        Law("the same seed gives the same bytes", again.data.tobytes() == record.data.tobytes(), "they differ"),
        Law("figures lie near the truth, within noise, bias, lag and delay", not far, f"{', '.join(far)} does not"),
        Law("a sensor with errors shows them, one without has none", not silent, f"not so for {', '.join(silent)}"),
    ]


def _exact(sensor: Sensor, truth: FlightRecord) -> FloatArray:
    return np.asarray(sensor.scale * sensor.feel({n: truth[n] for n in sensor.needs})[::3])


def _faulty(sensor: Sensor) -> bool:
    return sensor.noise_std > 0.0 or sensor.bias != 0.0 or sensor.bias_rate != 0.0 or sensor.quantum > 0.0


def _near(suite: SensorSuite, sensor: Sensor, truth: FlightRecord, column: FloatArray) -> bool:
    """Say whether samples are no further off than their noise, drifts, bias, quantum and age allow.

    The age counts with the fastest slope; up to three values are lost in a row.
    """
    exact = _exact(sensor, truth)
    late = sensor.delay_s + abs(sensor.clock_offset_s) + 1e-6 * abs(sensor.clock_ppm) * SECONDS
    age = sensor.lag_s + late + (4.0 if sensor.dropout else 1.0) / (sensor.rate_hz or suite.rate_hz)
    drift = np.hypot(sensor.drift_std, sensor.bias_walk * np.sqrt(SECONDS))
    random = 6.0 * np.hypot(sensor.noise_std, drift)
    slope = np.abs(np.gradient(exact, 1.0 / suite.rate_hz)).max()
    bound = random + abs(sensor.bias) + abs(sensor.bias_rate) * SECONDS + 0.5 * sensor.quantum + 1.05 * slope * age
    return bool(np.abs(column - exact).max() <= bound)
