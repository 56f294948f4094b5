"""JSBSim's aircraft flown by the batch, in copies of an episode: see :mod:`testbench.envs.dynamics`, which flies one.

What a sensor feels is a function of the channels at that instant; its lag and its
delay are linear in what it has felt, so that those of all sensors over a decision are one matrix.
"""

from __future__ import annotations

import numpy as np

from testbench.core.record import FloatArray
from testbench.envs.dynamics import JSBSimFlight, LinearFlights, Mask, Pieces, Use
from testbench.envs.lifted import Lifted
from testbench.envs.tasks import Task
from testbench.flight.batch.step import SteppedBatch
from testbench.sensors import Sensor
from testbench.sensors.sensor import lag_weights


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
