"""The two ways to fly an episode: the linearised aircraft alone, or JSBSim beside it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from testbench.core.record import FlightRecord, FloatArray
from testbench.envs.lifted import Lifted
from testbench.envs.tasks import Task
from testbench.flight.step import SteppedFlight

_FORGOTTEN = 40.0  # time constants after which a lag remembers 4e-18 of a value


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
        prediction = problem.prediction
        self._sensors = problem.experiment.sensors
        self._stride = problem.experiment.stride
        memory = max(_FORGOTTEN * s.lag_s + s.delay_s for s in self._sensors) * problem.rate_hz
        self._memory = self._stride * int(np.ceil((memory + 2.0) / self._stride))
        self._limited = [n for n in prediction.names if " of " not in n]
        needed = [*(n for s in self._sensors for n in s.needs), *self._limited, *problem.controls, "theta", "phi"]
        self._channels = tuple(dict.fromkeys(needed))
        self.columns = {n: i for i, n in enumerate(self._channels)}
        self._flight: SteppedFlight | None = None

    def reset(self, quiet: int) -> FloatArray:
        """Fly ``quiet`` samples undisturbed and return what the sensors feel over them (quiet, p)."""
        task = self._task
        self._linear.reset(quiet)
        flight = SteppedFlight(task.aircraft, task.trimmed, task.problem.controls, self._channels, task.problem.rate_hz)
        self._flight = flight
        self._trim = np.array([task.trimmed.controls[c] for c in task.problem.controls])
        start = flight.read()
        samples = task.problem.experiment.samples * self._stride
        self._rows = np.empty((samples + self._lifted.R + 1, len(self._channels)))
        self._rows[0] = start
        self._count = quiet * self._stride + 1
        self._rows[1 : self._count] = flight.advance(self._trim, self._count - 1)
        return self._seen(0, quiet)

    def fly(self, u: FloatArray) -> Piece:
        """Fly one decision with commands (m,), deviations from trim, SI."""
        assert self._flight is not None
        linear = self._linear.fly(u)
        new = self._flight.advance(self._trim + u, self._lifted.R)
        before, R = self._count - 1, self._lifted.R
        ended = self._flight.reason
        if ended:  # hold the last state, so that the observation keeps its shape
            last = new[-1:] if len(new) else self._rows[before : before + 1]
            new = np.vstack([new, np.repeat(last, R - len(new), axis=0)])
        self._rows[self._count : self._count + R] = new
        self._count += R
        seen = self._seen(before // self._stride, self._lifted.r)
        return Piece(seen, linear.sensitivities, self._use(new, self._rows[before], u), ended)

    def attitude(self) -> tuple[float, float]:
        """Return pitch and bank now, rad."""
        return float(self._rows[self._count - 1, self.columns["theta"]]), float(
            self._rows[self._count - 1, self.columns["phi"]]
        )

    def _seen(self, first: int, count: int) -> FloatArray:
        """Return what the sensors feel over samples ``first`` to ``first + count`` (count, p).

        They are shown no more of the flight than their lags and delays remember.
        """
        begin = max(0, first * self._stride - self._memory)
        rows = self._rows[begin : (first + count) * self._stride]
        record = FlightRecord(
            t_s=(begin + np.arange(len(rows))) / self._task.problem.rate_hz,
            channels=self._channels,
            data=rows,
            kind="truth",
        )
        skip = first - begin // self._stride
        return np.stack([s.respond(record)[:: self._stride][skip : skip + count] for s in self._sensors], axis=1)

    def _use(self, rows: FloatArray, before: FloatArray, u: FloatArray) -> FloatArray:
        """Return the use of the limits (R, 2, c) over new rows."""
        problem = self._task.problem
        prediction = problem.prediction
        out = np.empty((len(rows), len(prediction.names)))
        for i, name in enumerate(prediction.names):
            if name.startswith("command of "):
                out[:, i] = u[list(problem.controls).index(name.removeprefix("command of "))]  # type: ignore[arg-type]
            elif name.startswith("rate of "):
                j = self.columns[name.removeprefix("rate of ")]
                out[:, i] = np.diff(np.concatenate([before[j : j + 1], rows[:, j]])) * problem.rate_hz
            else:
                out[:, i] = rows[:, self.columns[name]] - prediction.trim[name]
        return np.stack([out / prediction.high, out / prediction.low], axis=1)


def _at_trim(task: Task) -> dict[str, float]:
    """Return channel -> value that its sensor feels in trimmed flight."""
    at = dict(task.trimmed.state)
    return {
        s.channel: float(s.feel({n: np.array([at[n]]) for n in s.needs})[0]) for s in task.problem.experiment.sensors
    }
