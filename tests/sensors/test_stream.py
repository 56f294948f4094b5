"""Samples of a suite that come one by one are those of the whole flight."""

import numpy as np
import pytest

from testbench.core.errors import ChannelError, ScenarioError
from testbench.core.record import FlightRecord
from testbench.sensors.kinds.gps import Gps
from testbench.sensors.kinds.pitot import Pitot
from testbench.sensors.kinds.rate_gyro import RateGyro
from testbench.sensors.sensor import Sensor
from testbench.sensors.stream import Measuring
from testbench.sensors.suite import SensorSuite

RATE_HZ = 120.0
CHANNELS = ("p", "q", "r", "V", "psi", "north")
SUITE = SensorSuite(
    "every_fault",
    "One of everything",
    40.0,
    (
        RateGyro(
            "q", 0.01, bias=0.02, scale=1.1, lag_s=0.05, bias_walk=0.01, bias_rate=1e-3, cross_axis=(0.1, 0.0, 0.0)
        ),
        Pitot("V", 0.3, quantum=0.25, delay_s=0.07, dropout=0.2, static_cp=0.05),
        Gps("north", drift_std=2.0, drift_time_s=30.0, delay_s=0.2, rate_hz=10.0),
        Sensor("psi", 0.05, recorder="b", clock_offset_s=0.1, clock_ppm=500.0),
    ),
)


def test_samples_that_come_one_by_one_are_those_of_the_whole_flight():
    t = np.arange(5000) / RATE_HZ
    data = np.column_stack([2.0 + np.sin(t * (1.0 + 0.2 * i) + i) for i in range(len(CHANNELS))])
    data[:, CHANNELS.index("psi")] = np.mod(6.0 + 0.7 * t, 2.0 * np.pi)  # turns through north
    whole = SUITE.measure(FlightRecord(t, CHANNELS, data, "truth"), 3)
    measuring, rows, fresh = Measuring(SUITE, CHANNELS, RATE_HZ, 3), [], []
    for row in data:
        measuring.add(row)
        rows.append(measuring.values.copy())
        fresh.append(measuring.fresh.copy())
    np.testing.assert_allclose(np.array(rows)[::3], whole.data, rtol=1e-12)
    np.testing.assert_array_equal(np.array(fresh)[::3], whole.valid)
    assert not np.array(fresh)[1::3].any()
    assert 0.1 < 1.0 - whole.valid[:, 1].mean() < 0.3


def test_what_the_rows_cannot_give_is_refused():
    with pytest.raises(ChannelError, match="needs channel 'north'"):
        Measuring(SUITE, CHANNELS[:-1], RATE_HZ, 0)
    with pytest.raises(ScenarioError, match="must divide"):
        Measuring(SUITE, CHANNELS, 100.0, 0)
