"""Responses carried from row to row against those to the record of the whole flight."""

from __future__ import annotations

import numpy as np
import pytest

from testbench.core.record import FlightRecord
from testbench.envs.sensed import Sensed
from testbench.sensors.kinds.flow_vane import FlowVane
from testbench.sensors.kinds.rate_gyro import RateGyro
from testbench.sensors.sensor import Sensor

CHANNELS = ("q", "alpha", "psi", "u", "v", "w", "p", "r", "V")
RATE_HZ, STRIDE, PIECES = 50.0, 5, (40, 5, 10, 5, 100, 40)
SENSORS = (
    Sensor("V"),
    RateGyro("q", scale=1.02, lag_s=0.03, cross_axis=(0.01, 0.0, -0.02)),
    FlowVane("alpha", lag_s=0.1, delay_s=0.033, upwash=1.1, position_m=(0.4, 0.0, 0.1)),
    Sensor("psi", lag_s=0.2),
    Sensor("r", delay_s=0.5, recorder="own", clock_offset_s=0.02, clock_ppm=300.0),
)


def rows() -> np.ndarray:
    """A smooth flight (sum of the pieces, channels) that turns through north."""
    t = np.arange(sum(PIECES)) / RATE_HZ
    data = np.column_stack([1.0 + 0.3 * np.sin(t * (1.0 + 0.2 * i) + i) for i in range(len(CHANNELS))])
    data[:, CHANNELS.index("psi")] = np.mod(6.0 + 4.0 * t, 2.0 * np.pi)
    return data


@pytest.mark.parametrize("sensor", SENSORS, ids=lambda s: s.channel)
def test_a_response_in_pieces_is_that_to_the_whole_flight(sensor):
    data = rows()
    whole = sensor.respond(FlightRecord(np.arange(len(data)) / RATE_HZ, CHANNELS, data, "truth"))[::STRIDE]
    sensed = Sensed([sensor], CHANNELS, RATE_HZ, len(data))
    for _ in range(2):  # a second flight remembers nothing of the first
        sensed.begin()
        pieces = [sensed.add(piece, STRIDE) for piece in np.split(data, np.cumsum(PIECES)[:-1])]
        np.testing.assert_allclose(np.concatenate(pieces)[:, 0], whole, rtol=1e-13)
