"""What the sensors feel while a flight goes on: :meth:`testbench.sensors.Sensor.respond`, carried from row to row.

A record of the flight so far would be made, checked and filtered anew in every decision, which takes longer than the
decision's frames in JSBSim. Here lags are carried on, so that they forget nothing: to rounding, the response is that of
a record of the whole flight.

What the sensors add in an episode, and how a sample is shown to the agent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FloatArray
from testbench.envs.tasks import Task
from testbench.sensors import Sensor
from testbench.sensors.sensor import lag_weights


class Drawn(NamedTuple):
    """What chance decides in one episode.

    ``error`` (N, p): what the sensors add. ``source`` (N, p): place, in the flattened samples, of the one that each
    instant shows; None if each shows its own.
    """

    error: FloatArray
    source: NDArray[np.int64] | None


class Display:
    """Samples of the sensors as the agent sees them: deviation from trim in units of the limit or of the noise.

    Args:
        task: whose sensors.
        rate_hz: of the fastest of them.
        samples: N of an episode.

    Attributes:
        centre: (p,) what is subtracted.
        unit: (p,) what is divided by.
        held: whether some instants show an earlier sample, as sensors are slow or lose samples.
    """

    def __init__(self, task: Task, rate_hz: float, samples: int) -> None:
        sensors = task.problem.experiment.sensors
        self.centre, self.unit = _centre_and_unit(task)
        quantum = np.array([s.quantum or 1e-9 * u for s, u in zip(sensors, self.unit, strict=True)])
        self._counts, self._step_shown = 1.0 / quantum, quantum / self.unit
        self._centre_shown = self.centre / self.unit
        self._exact = tuple(replace(s, quantum=0.0) for s in sensors)  # rounded together with the signal, later
        self._every = [round(rate_hz / (s.rate_hz or rate_hz)) for s in sensors]
        self.held = any(e > 1 for e in self._every) or any(s.dropout > 0.0 for s in sensors)
        self._rate, self._samples = rate_hz, samples
        self._own = np.tile(np.arange(samples)[:, None], (1, len(sensors)))

    def draw(self, seed: int) -> Drawn:
        """Draw what the sensors add and, where samples are held or lost, which sample each instant shows."""
        n, p = self._own.shape
        error, source = np.empty((n, p)), self._own.copy() if self.held else None
        for i, (sensor, every) in enumerate(zip(self._exact, self._every, strict=True)):
            count = -(-n // every)
            noise, arrived = sensor.sample(np.zeros(count), seed, every / self._rate)
            if sensor.bias_rate:
                noise = noise + sensor.drifted(np.arange(count) * every / self._rate)
            error[:, i] = np.repeat(noise, every)[:n] if every > 1 else noise
            if source is not None:
                last = np.maximum.accumulate(np.where(arrived, np.arange(count), 0)) * every
                source[:, i] = np.repeat(last, every)[:n]
        if source is None:
            return Drawn(error, None)
        return Drawn(np.take_along_axis(error, source, axis=0), source * p + np.arange(p))

    def show(self, y: FloatArray) -> FloatArray:
        """Return samples (..., p), SI, errors included, as they are shown."""
        return np.asarray(np.rint(y * self._counts) * self._step_shown - self._centre_shown)


def _centre_and_unit(task: Task) -> tuple[FloatArray, FloatArray]:
    problem, at = task.problem, task.trimmed.state
    prediction, experiment = problem.prediction, problem.experiment
    centre, unit = [], []
    for sensor, sigma in zip(experiment.sensors, experiment.sigma, strict=True):
        centre.append(float(sensor.feel({n: np.array([at[n]]) for n in sensor.needs})[0]) * sensor.scale)
        if sensor.channel in prediction.names:
            i = prediction.names.index(sensor.channel)
            unit.append(float(min(prediction.high[i], -prediction.low[i])))
        else:
            unit.append(10.0 * float(sigma))
    return np.array(centre), np.array(unit)


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
