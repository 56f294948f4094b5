"""The two ways to fly an episode: the linearised aircraft alone, or JSBSim beside it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from testbench.core.record import FloatArray
from testbench.design.problem import Problem
from testbench.envs.lifted import Lifted
from testbench.envs.sensed import Sensed
from testbench.envs.tasks import Task
from testbench.flight.step import SteppedFlight


class Piece(NamedTuple):
    """The outcome of one decision.

    ``seen`` (r, p): what the sensors feel, lag and delay applied, SI, still without noise. ``sensitivities`` (r, p, k)
    as scaled in the lifted matrix. ``use`` (R, 2, c): deviations over the upper and over the lower limits; beyond 1 a
    limit is broken. ``ended``: why the flight ended by itself, or "".
    """

    seen: FloatArray
    sensitivities: FloatArray
    use: FloatArray
    ended: str


class LinearFlight:
    """The linearised aircraft, exact for held commands, sensitivities alongside."""

    def __init__(self, task: Task, lifted: Lifted) -> None:
        at = _at_trim(task)
        self._lifted = lifted
        self._trim = np.array([s.scale * at[s.channel] for s in task.problem.experiment.sensors])
        self._states = task.problem.experiment.structure.states
        self._attitude = task.trimmed.theta, task.trimmed.phi
        self._in = np.zeros(lifted.matrix.shape[1])

    def reset(self, quiet: int) -> FloatArray:
        """Begin at trim and return what the sensors feel over ``quiet`` samples of undisturbed flight (quiet, p)."""
        self._in[:] = 0.0
        return np.tile(self._trim, (quiet, 1))

    def fly(self, u: FloatArray) -> Piece:
        """Fly one decision with commands (m,), deviations from trim, SI."""
        self._in[self._lifted.nz :] = u
        z, y, S, use = self._lifted.parts(self._lifted.matrix.dot(self._in))
        self._in[: self._lifted.nz] = z
        return Piece(y + self._trim, S, use, "")

    def attitude(self) -> tuple[float, float]:
        """Return pitch and bank now, rad."""
        change = [self._in[self._states.index(n)] if n in self._states else 0.0 for n in ("theta", "phi")]
        return self._attitude[0] + float(change[0]), self._attitude[1] + float(change[1])


class JSBSimFlight:
    """JSBSim flies and is sensed; the sensitivities are those of the linearised aircraft under the same commands.

    Attributes:
        columns: channel that is logged -> its column.
    """

    def __init__(self, task: Task, lifted: Lifted) -> None:
        self._task, self._linear, self._lifted = task, LinearFlight(task, lifted), lifted
        problem = task.problem
        sensors, self._stride = problem.experiment.sensors, problem.experiment.stride
        limited = [n for n in problem.prediction.names if " of " not in n]
        needed = [*(n for s in sensors for n in s.needs), *limited, *problem.controls, "theta", "phi"]
        self._channels = tuple(dict.fromkeys(needed))
        self.columns = {n: i for i, n in enumerate(self._channels)}
        self._trim = np.array([task.trimmed.controls[c] for c in problem.controls])
        samples = problem.experiment.samples * self._stride
        self._rows = np.empty((samples + lifted.R + 1, len(self._channels)))
        self._sensed = Sensed(sensors, self._channels, problem.rate_hz, len(self._rows))
        self._use = _Use(problem, self._channels)
        self._flight: SteppedFlight | None = None

    def reset(self, quiet: int) -> FloatArray:
        """Fly ``quiet`` samples undisturbed and return what the sensors feel over them (quiet, p)."""
        task = self._task
        self._linear.reset(quiet)
        self._sensed.begin()
        flight = SteppedFlight(task.aircraft, task.trimmed, task.problem.controls, self._channels, task.problem.rate_hz)
        self._flight = flight
        self._rows[0] = flight.read()
        self._count = quiet * self._stride + 1
        self._rows[1 : self._count] = flight.advance(self._trim, self._count - 1)
        return self._sensed.add(self._rows[: self._count - 1], self._stride)

    def fly(self, u: FloatArray) -> Piece:
        """Fly one decision with commands (m,), deviations from trim, SI."""
        assert self._flight is not None
        sensitivities = self._linear.fly(u).sensitivities
        new = self._flight.advance(self._trim + u, self._lifted.R)
        before = self._count - 1
        after = before + self._lifted.R
        ended = self._flight.reason
        if ended:  # hold the last state, so that the observation keeps its shape
            last = new[-1:] if len(new) else self._rows[before : before + 1]
            new = np.vstack([new, np.repeat(last, self._lifted.R - len(new), axis=0)])
        self._rows[before + 1 : after + 1] = new
        self._count = after + 1
        seen = self._sensed.add(self._rows[before:after], self._stride)
        return Piece(seen, sensitivities, self._use(self._rows[before : after + 1], u), ended)

    def attitude(self) -> tuple[float, float]:
        """Return pitch and bank now, rad."""
        now = dict(zip(self._channels, self._rows[self._count - 1].tolist(), strict=True))
        return now["theta"], now["phi"]


class _Use:
    """Use of the limits by a piece of flight, from its rows of channels and its commands."""

    def __init__(self, problem: Problem, channels: Sequence[str]) -> None:
        prediction = problem.prediction
        self._bounds = np.stack([prediction.high, prediction.low])
        self._rate_hz = problem.rate_hz
        self._trim = np.zeros(len(prediction.names))
        self._columns = np.zeros(len(prediction.names), int)  # of the rows; a command stands in none
        self._rates: list[int] = []
        self._commands: list[tuple[int, int]] = []
        for i, name in enumerate(prediction.names):
            if name.startswith("command of "):
                self._commands.append((i, problem.controls.index(name.removeprefix("command of "))))
                continue
            self._columns[i] = channels.index(name.removeprefix("rate of "))
            if name.startswith("rate of "):
                self._rates.append(i)
            else:
                self._trim[i] = prediction.trim[name]

    def __call__(self, rows: FloatArray, u: FloatArray) -> FloatArray:
        """Return the use of the limits (R, 2, c) over ``rows`` (R + 1, channels), the first being the one before."""
        limited = rows.take(self._columns, axis=1)
        out = limited[1:] - self._trim
        for i in self._rates:
            out[:, i] = (limited[1:, i] - limited[:-1, i]) * self._rate_hz
        for i, j in self._commands:
            out[:, i] = u[j]
        return np.asarray(out[:, None] / self._bounds)


def _at_trim(task: Task) -> dict[str, float]:
    """Return channel -> value that its sensor feels in trimmed flight."""
    at = dict(task.trimmed.state)
    return {
        s.channel: float(s.feel({n: np.array([at[n]]) for n in s.needs})[0]) for s in task.problem.experiment.sensors
    }
