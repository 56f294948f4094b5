"""The two ways to fly an episode: the linearised aircraft alone, or JSBSim beside it, one flight or a batch of them.

Copies come first in every array.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from testbench.core.record import FloatArray
from testbench.design.problem import Problem
from testbench.envs.lifted import Lifted
from testbench.envs.tasks import Task
from testbench.flight.batch.step import SteppedBatch
from testbench.flight.step import SteppedFlight
from testbench.sensors import Sensor
from testbench.sensors.sensor import lag_weights
from testbench.sensors.stream import Sensed

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


# --- JSBSim's aircraft flown by the batch, in copies of an episode ----------------------------------------------------


class BatchFlights:
    """Copies of :class:`testbench.envs.dynamics.JSBSimFlight`, flown by the batch.

    Args:
        task: what is flown.
        lifted: one decision.
        copies: how many.

    Raises:
        LimitError: the aircraft is not found equal to JSBSim in a batch.
    """

    def __init__(self, task: Task, lifted: Lifted, copies: int) -> None:
        problem = task.problem
        one = JSBSimFlight(task, lifted)
        self._linear = LinearFlights(task, lifted, copies, sensitivities=True)
        self._lifted, self._n = lifted, copies
        self._columns = one.columns
        self._flights = SteppedBatch(
            task.aircraft, task.trimmed, problem.controls, tuple(one.columns), problem.rate_hz, copies
        )
        self._trim = np.array([task.trimmed.controls[c] for c in problem.controls])
        self._sensors = problem.experiment.sensors
        self._stride = problem.experiment.stride
        self._bank = _Bank(self._sensors, 1.0 / problem.rate_hz, lifted.R, self._stride)
        self._use = Use(problem, one.columns)

    def start(self, quiet: int) -> FloatArray:
        """Begin all at trim; return what sensors feel over ``quiet`` samples of undisturbed flight (quiet, p)."""
        self._linear.start(quiet)
        rows = np.concatenate([
            self._flights.read()[:1, None],
            self._flights.advance(np.tile(self._trim, (self._n, 1)), quiet * self._stride)[:1],
        ], axis=1)  # fmt: skip
        self._flights.hold()
        self._begin_row = rows[:, -1]
        self._last = np.repeat(self._begin_row, self._n, axis=0)
        felt = self._felt(rows[:, :-1])
        seen, self._begin = self._bank.start(felt)
        self._memory = np.repeat(self._begin, self._n, axis=0)
        return seen

    def reset(self, which: Mask) -> None:
        """Put the flights ``which`` (n,) back to the end of the undisturbed flight."""
        self._linear.reset(which)
        self._flights.reset(which)
        self._last[which], self._memory[which] = self._begin_row, self._begin

    def fly(self, u: FloatArray) -> Pieces:
        """Fly one decision with commands (n, m), deviations from trim, SI."""
        S = self._linear.fly(u).sensitivities
        new = self._flights.advance(self._trim + u, self._lifted.R)
        # the sensors are shown the rows from the last instant on: the newest one begins the next decision
        rows = np.concatenate([self._last[:, None], new], axis=1)
        self._last = new[:, -1]
        seen, self._memory = self._bank.next(self._memory, self._felt(rows[:, :-1]))
        return Pieces(seen, S, self._use(rows, u), self._flights.reasons.copy())

    def _felt(self, rows: FloatArray) -> FloatArray:
        """Return what acts on the sensors (n, p, rows), scale applied."""
        n, count, _ = rows.shape
        out = np.empty((n, len(self._sensors), count))
        for i, sensor in enumerate(self._sensors):
            x = {name: rows[:, :, self._columns[name]].ravel() for name in sensor.needs}
            out[:, i] = (sensor.scale * sensor.feel(x)).reshape(n, count)
        return out


def why_alone(sensors: tuple[Sensor, ...]) -> str:
    """Return why the sensors of many flights cannot be computed at once, one clause; "" if they can."""
    rng = np.random.default_rng(0)
    for s in sensors:
        if s.channel == "psi" or s.clock_offset_s or s.clock_ppm or type(s).respond is not Sensor.respond:
            return f"its sensor '{s.channel}' takes a flight as a whole"
        x = {n: 10.0 + 0.3 * rng.standard_normal(64) for n in s.needs}
        turned = {n: v[::-1] for n, v in x.items()}
        if not np.array_equal(np.asarray(s.feel(x)), np.asarray(s.feel(turned))[::-1]):
            return f"its sensor '{s.channel}' remembers what it felt"
    return ""


class _Bank:
    """Lag and delay of every sensor, over one decision: a matrix that takes memory and felt rows to samples and memory.

    The memory of a sensor is what it felt last, and its lagged values as far back as its delay.

    Args:
        sensors: the sensors.
        dt_s: between rows.
        rows: R of a decision.
        stride: rows per sample.
    """

    def __init__(self, sensors: tuple[Sensor, ...], dt_s: float, rows: int, stride: int) -> None:
        self._sensors, self._dt, self._stride = sensors, dt_s, stride
        late = [s.delay_s / dt_s for s in sensors]
        self._late = [float(round(x)) if abs(x - round(x)) < 1e-9 else x for x in late]
        self._depth = [max(1, int(np.ceil(x))) for x in self._late]
        size = sum(self._depth) + len(sensors)
        unit = np.eye(size + len(sensors) * rows)
        seen, memory = self._pass(unit[:, :size], unit[:, size:].reshape(-1, len(sensors), rows))
        self._shape = seen.shape[1:]
        self._cut = seen[0].size
        self._matrix = np.concatenate([seen.reshape(len(unit), -1), memory], axis=1)

    def start(self, felt: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return samples (samples, p) of a flight from its beginning on, felt (1, p, rows), and the memory (1, .)."""
        steady = [felt[:, i, :1] for i, depth in enumerate(self._depth) for _ in range(depth + 1)]
        seen, memory = self._pass(np.concatenate(steady, axis=1), felt)
        return seen[0], memory

    def next(self, memory: FloatArray, felt: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return samples (n, r, p) of the next decision, and the memory after it."""
        out = np.concatenate([memory, felt.reshape(len(felt), -1)], axis=1) @ self._matrix
        return out[:, : self._cut].reshape(-1, *self._shape), out[:, self._cut :]

    def _pass(self, memory: FloatArray, felt: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pass rows (n, p, rows) through lags and delays; see :func:`testbench.sensors.sensor.first_order_lag`."""
        seen, left, at = [], [], 0
        for i, (sensor, depth, late) in enumerate(zip(self._sensors, self._depth, self._late, strict=True)):
            before, past, x = memory[:, at], memory[:, at + 1 : at + 1 + depth], felt[:, i]
            at += 1 + depth
            y = np.empty_like(x)
            a, b0, b1 = lag_weights(self._dt, sensor.lag_s) if sensor.lag_s > 0.0 else (0.0, 0.0, 1.0)
            last = past[:, -1]
            for j in range(x.shape[1]):
                last = a * last + b0 * (before if j == 0 else x[:, j - 1]) + b1 * x[:, j]
                y[:, j] = last
            line = np.concatenate([past, y], axis=1)
            place = depth - late + np.arange(0, x.shape[1], self._stride)
            whole = np.floor(place).astype(int)
            part = place - whole
            after = np.minimum(whole + 1, line.shape[1] - 1)
            seen.append((1.0 - part) * line[:, whole] + part * line[:, after])
            left += [x[:, -1:], line[:, -depth:]]
        return np.stack(seen, axis=2), np.concatenate(left, axis=1)
