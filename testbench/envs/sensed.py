"""What the sensors add in an episode, and how a sample is shown to the agent."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FloatArray
from testbench.envs.tasks import Task


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
