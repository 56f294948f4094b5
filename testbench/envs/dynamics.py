"""The two ways to fly an episode: the linearised aircraft alone, or JSBSim beside it.

Copies come first in every array.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from testbench.core.record import FloatArray
from testbench.design.problem import Problem
from testbench.envs.lifted import Lifted
from testbench.envs.sensed import Sensed
from testbench.envs.tasks import Task
from testbench.flight.step import SteppedFlight

Mask = npt.NDArray[np.bool_]


class Pieces(NamedTuple):
    """The outcome of one decision of every copy.

    ``seen`` (n, r, p): what the sensors feel, lag and delay applied, SI, still without noise. ``sensitivities``
    (n, r, p, k) as scaled in the lifted matrix. ``use`` (n, c): largest share of each limit, either way; beyond 1 it is
    broken. ``ended`` (n,): why a flight ended by itself, or "".
    """

    seen: FloatArray
    sensitivities: FloatArray
    use: FloatArray
    ended: npt.NDArray[np.object_]


class LinearFlights:
    """Copies of the linearised aircraft, exact for held commands, sensitivities alongside.

    Args:
        task: what is flown.
        lifted: one decision.
        copies: how many.
        sensitivities: whether nothing else is wanted, as another simulator flies.
    """

    def __init__(self, task: Task, lifted: Lifted, copies: int = 1, sensitivities: bool = False) -> None:
        self._lifted, self._alone = lifted, sensitivities
        at = dict(task.trimmed.state)
        self._trim = np.array(
            [
                s.scale * float(s.feel({n: np.array([at[n]]) for n in s.needs})[0])
                for s in task.problem.experiment.sensors
            ]
        )
        self._states = task.problem.experiment.structure.states
        self._attitude = task.trimmed.theta, task.trimmed.phi
        nz, seen, most = lifted.nz, lifted.r * lifted.p, lifted.r * lifted.p * (1 + lifted.k)
        rows = np.r_[:nz, nz + seen : nz + most] if sensitivities else np.arange(len(lifted.matrix))
        self._matrix = np.ascontiguousarray(lifted.matrix[rows].T)
        self._in = np.zeros((copies, len(self._matrix)))
        self._out = np.empty((copies, len(rows)))
        self._good = np.full(copies, "", object)

    def start(self, quiet: int) -> FloatArray:
        """Begin all at trim; return what sensors feel over ``quiet`` samples of undisturbed flight (quiet, p)."""
        self._in[:] = 0.0
        return np.tile(self._trim, (quiet, 1))

    def reset(self, which: Mask) -> None:
        """Put the flights ``which`` (n,) back to the end of the undisturbed flight."""
        self._in[which] = 0.0

    def fly(self, u: FloatArray) -> Pieces:
        """Fly one decision with commands (n, m), deviations from trim, SI."""
        x, n = self._lifted, len(u)
        self._in[:, x.nz :] = u
        out = np.matmul(self._in, self._matrix, out=self._out)
        self._in[:, : x.nz] = out[:, : x.nz]
        a, b = x.nz, x.nz + (0 if self._alone else x.r * x.p)
        d = b + x.r * x.p * x.k
        S = out[:, b:d].reshape(n, x.r, x.p, x.k)
        if self._alone:
            return Pieces(np.empty((n, 0, 0)), S, np.empty((n, 0)), self._good)
        use = np.ascontiguousarray(out[:, d:].reshape(n, 2 * x.R, x.c).swapaxes(0, 1)).max(axis=0)
        return Pieces(out[:, a:b].reshape(n, x.r, x.p) + self._trim, S, use, self._good)

    def attitude(self) -> tuple[float, float]:
        """Return pitch and bank of the first copy now, rad."""
        change = [self._in[0, self._states.index(n)] if n in self._states else 0.0 for n in ("theta", "phi")]
        return self._attitude[0] + float(change[0]), self._attitude[1] + float(change[1])


class JSBSimFlight:
    """JSBSim flies and is sensed; the sensitivities are those of the linearised aircraft under the same commands.

    Attributes:
        columns: channel that is logged -> its column.
    """

    def __init__(self, task: Task, lifted: Lifted) -> None:
        self._task, self._linear, self._lifted = task, LinearFlights(task, lifted, sensitivities=True), lifted
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
        self._use = Use(problem, self.columns)
        self._flight: SteppedFlight | None = None

    def start(self, quiet: int) -> FloatArray:
        """Fly ``quiet`` samples undisturbed and return what the sensors feel over them (quiet, p)."""
        task = self._task
        self._linear.start(quiet)
        self._sensed.begin()
        flight = SteppedFlight(task.aircraft, task.trimmed, task.problem.controls, self._channels, task.problem.rate_hz)
        self._flight = flight
        self._rows[0] = flight.read()
        self._count = quiet * self._stride + 1
        self._rows[1 : self._count] = flight.advance(self._trim, self._count - 1)
        return self._sensed.add(self._rows[: self._count - 1], self._stride)

    def fly(self, u: FloatArray) -> Pieces:
        """Fly one decision with commands (1, m), deviations from trim, SI."""
        assert self._flight is not None
        sensitivities = self._linear.fly(u).sensitivities
        new = self._flight.advance(self._trim + u[0], self._lifted.R)
        before = self._count - 1
        after = before + self._lifted.R
        ended = self._flight.reason
        if ended:  # hold the last state, so that the observation keeps its shape
            last = new[-1:] if len(new) else self._rows[before : before + 1]
            new = np.vstack([new, np.repeat(last, self._lifted.R - len(new), axis=0)])
        self._rows[before + 1 : after + 1] = new
        self._count = after + 1
        seen = self._sensed.add(self._rows[before:after], self._stride)
        use = self._use(self._rows[None, before : after + 1], u)
        return Pieces(seen[None], sensitivities, use, np.array([ended], object))

    def attitude(self) -> tuple[float, float]:
        """Return pitch and bank now, rad."""
        now = dict(zip(self._channels, self._rows[self._count - 1].tolist(), strict=True))
        return now["theta"], now["phi"]


class Use:
    """Use of the limits by pieces of flights, from their rows of channels and their commands.

    Args:
        problem: whose limits.
        columns: channel -> its column of the rows.
    """

    def __init__(self, problem: Problem, columns: dict[str, int]) -> None:
        prediction, names = problem.prediction, problem.prediction.names
        limits = [i for i, n in enumerate(names) if " of " not in n]
        self._plain = limits, [columns[names[i]] for i in limits]
        self._rates = [(i, columns[n[8:]]) for i, n in enumerate(names) if n.startswith("rate of ")]
        self._commands = [(i, problem.controls.index(n[11:])) for i, n in enumerate(names) if n.startswith("command ")]
        self._at = np.array([prediction.trim[names[i]] for i in limits])
        self._high, self._low, self._rate_hz = prediction.high, prediction.low, problem.rate_hz

    def __call__(self, rows: FloatArray, u: FloatArray) -> FloatArray:
        """Return the largest use of each limit (n, c) over ``rows`` (n, R + 1, channels), the first the one before."""
        high, low = np.empty((len(u), len(self._high))), np.empty((len(u), len(self._high)))
        # time first: one comparison of all copies and channels after the other
        rows = np.ascontiguousarray(np.swapaxes(rows, 0, 1))
        most, least = rows[1:].max(axis=0), rows[1:].min(axis=0)
        limits, columns = self._plain
        high[:, limits], low[:, limits] = most[:, columns] - self._at, least[:, columns] - self._at
        for i, j in self._rates:
            rate = np.diff(rows[:, :, j], axis=0) * self._rate_hz
            high[:, i], low[:, i] = rate.max(axis=0), rate.min(axis=0)
        for i, j in self._commands:
            high[:, i] = low[:, i] = u[:, j]
        return np.maximum(high / self._high, low / self._low)
