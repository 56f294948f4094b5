"""What the sensors feel while a flight goes on: :meth:`testbench.sensors.Sensor.respond`, carried from row to row.

A record of the flight so far would be made, checked and filtered anew in every decision, which takes longer than the
decision's frames in JSBSim. Here lags are carried on, so that they forget nothing: to rounding, the response is that of
a record of the whole flight.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from testbench.core.record import FloatArray
from testbench.sensors import Sensor
from testbench.sensors.sensor import lag_weights


class Sensed:
    """Responses of sensors to a flight that is logged row by row.

    Args:
        sensors: (p) those that feel.
        channels: columns of the rows; every one that a sensor needs.
        rate_hz: of the rows.
        rows: the most that a flight has.
    """

    def __init__(self, sensors: Sequence[Sensor], channels: Sequence[str], rate_hz: float, rows: int) -> None:
        self._t = np.arange(rows) / rate_hz
        self._felt = [_Felt(s, channels, self._t) for s in sensors]

    def begin(self) -> None:
        """Forget the flight before."""
        for felt in self._felt:
            felt.begin()

    def add(self, rows: FloatArray, stride: int) -> FloatArray:
        """Take in the next ``rows`` (n, channels), SI, and return what is felt at every ``stride``-th (n / stride, p).

        The first row of a flight, and with it the first of each call, is one of those that are returned.
        """
        out = np.empty((len(rows) // stride, len(self._felt)))
        for i, felt in enumerate(self._felt):
            out[:, i] = felt.add(rows, stride)
        return out


class _Felt:
    """One sensor of :class:`Sensed`."""

    def __init__(self, sensor: Sensor, channels: Sequence[str], t: FloatArray) -> None:
        self._sensor, self._t = sensor, t
        self._needs = [(n, channels.index(n)) for n in sensor.needs]
        self._weights = lag_weights(float(t[1]), sensor.lag_s) if sensor.lag_s > 0.0 else None
        late = sensor.delay_s > 0.0 or sensor.clock_offset_s or sensor.clock_ppm
        self._past = np.empty_like(t) if late else None
        self.begin()

    def begin(self) -> None:
        self._count = 0
        self._heading = self._origin = self._carried = 0.0

    def add(self, rows: FloatArray, stride: int) -> FloatArray:
        """Return what is felt at every ``stride``-th of the next rows."""
        sensor, before = self._sensor, self._count
        self._count += len(rows)
        x = sensor.feel({n: rows[:, i] for n, i in self._needs})
        if sensor.channel == "psi":
            x = np.unwrap(x if before == 0 else np.concatenate([[self._heading], x]))[-len(rows) :]
            self._heading = float(x[-1])
        if sensor.scale != 1.0:
            x = sensor.scale * x
        if self._weights is not None:
            x = self._lagged(x, self._weights, begins=before == 0)
        if self._past is None:
            return np.asarray(x[::stride])
        self._past[before : self._count] = x
        t = self._t[before : self._count : stride]
        late = sensor.delay_s + sensor.clock_offset_s + 1e-6 * sensor.clock_ppm * t
        return np.interp(t - late, self._t[: self._count], self._past[: self._count])

    def _lagged(self, x: FloatArray, weights: tuple[float, float, float], begins: bool) -> FloatArray:
        """Return the next of :func:`testbench.sensors.sensor.first_order_lag`, which is too slow for a few rows."""
        if begins:
            self._origin = float(x[0])
        a, b0, b1 = weights
        origin, carried, out = self._origin, self._carried, []
        for value in x.tolist():
            change = value - origin
            y = carried + b1 * change
            carried = b0 * change + a * y
            out.append(y + origin)
        self._carried = carried
        return np.array(out)
