"""What sensors tell while a flight goes on: :meth:`testbench.sensors.SensorSuite.measure`, carried from row to row.

A record of the flight so far would be made, checked and filtered anew with every row, which takes longer than the
row's frames in JSBSim. Here lags are carried on, so that they forget nothing: to rounding, what is told is that of a
record of the whole flight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import require
from testbench.core.record import FloatArray
from testbench.sensors.sensor import Sensor, lag_weights, whole_ratio
from testbench.sensors.suite import SensorSuite


class Measuring:
    """The samples of a suite as they come, of a flight that is logged row by row and may go on for ever.

    Args:
        suite: its rate must divide that of the rows.
        channels: columns of the rows.
        rate_hz: of the rows; the first is taken when the flight begins.
        seed: of noise and dropouts, >= 0.

    Attributes:
        values: (sensors,) SI, in the order of the suite; the last sample that arrived.
        fresh: (sensors,) whether the last row brought it.

    Raises:
        ScenarioError: the suite's rate does not divide that of the rows.
        ChannelError: the rows lack a channel.
    """

    def __init__(self, suite: SensorSuite, channels: Sequence[str], rate_hz: float, seed: int) -> None:
        require((n for s in suite.sensors for n in s.needs), channels, f"sensor suite '{suite.name}'")
        self._suite, self._seed, self._rate_hz = suite, seed, rate_hz
        stride = suite.check_log_rate(rate_hz)
        self._every = [stride * (whole_ratio(suite.rate_hz, s.rate_hz or suite.rate_hz) or 1) for s in suite.sensors]
        self._sensed = Sensed(suite.sensors, channels, rate_hz)
        self._exact = [replace(s, quantum=0.0) for s in suite.sensors]  # rounded together with the signal
        self._added = [(np.empty(0), np.empty(0, bool)) for _ in suite.sensors]
        self._rows = 0
        self.values: FloatArray = np.zeros(len(suite.sensors))
        self.fresh: NDArray[np.bool_] = np.zeros(len(suite.sensors), bool)

    def add(self, row: FloatArray) -> None:
        """Take in the next row (channels,), SI."""
        felt = self._sensed.add(row[None], 1)[0]
        for i, (sensor, every) in enumerate(zip(self._suite.sensors, self._every, strict=True)):
            k, rest = divmod(self._rows, every)
            self.fresh[i] = not rest and self._arrives(i, k)
            if self.fresh[i]:
                y = felt[i] + sensor.bias_rate * self._rows / self._rate_hz + self._added[i][0][k]
                if sensor.quantum > 0.0:
                    y = sensor.quantum * np.rint(y / sensor.quantum)
                self.values[i] = np.mod(y, 2.0 * np.pi) if sensor.channel == "psi" else y
        self._rows += 1

    def _arrives(self, i: int, k: int) -> bool:
        """Return whether sample ``k`` of a sensor arrives. What chance adds begins the same, however long it is."""
        if k >= self._added[i][0].size:
            self._added[i] = self._exact[i].sample(
                np.zeros(max(1024, 2 * k)), self._seed, self._every[i] / self._rate_hz
            )
        return bool(self._added[i][1][k])


class Sensed:
    """Responses of sensors to a flight that is logged row by row.

    Args:
        sensors: (p) those that feel.
        channels: columns of the rows; every one that a sensor needs.
        rate_hz: of the rows.
        rows: the most that a flight has, if that is known; memory is else taken as it goes on.
    """

    def __init__(self, sensors: Sequence[Sensor], channels: Sequence[str], rate_hz: float, rows: int = 4096) -> None:
        self._felt = [_Felt(s, channels, rate_hz, rows) for s in sensors]

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

    def __init__(self, sensor: Sensor, channels: Sequence[str], rate_hz: float, rows: int) -> None:
        self._sensor, self._rate_hz = sensor, rate_hz
        self._needs = [(n, channels.index(n)) for n in sensor.needs]
        self._weights = lag_weights(1.0 / rate_hz, sensor.lag_s) if sensor.lag_s > 0.0 else None
        late = sensor.delay_s > 0.0 or sensor.clock_offset_s or sensor.clock_ppm
        self._t = np.arange(rows) / rate_hz
        self._past = np.empty(rows) if late else None
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
        if self._count > self._past.size:
            self._t = np.arange(2 * self._count) / self._rate_hz
            self._past = np.concatenate([self._past[:before], np.empty(2 * self._count - before)])
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
