"""Flights of one aircraft in pieces, in a batch: beside :mod:`testbench.flight.step`, which flies one by JSBSim."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from testbench.aircraft import Aircraft
from testbench.core.errors import ChannelError, LimitError, nearest
from testbench.core.record import FloatArray
from testbench.flight.batch import registers as r
from testbench.flight.batch.check import judged
from testbench.flight.batch.fly import limits_of, placed, watched
from testbench.flight.batch.machine import Driven, Logged, aligned
from testbench.flight.batch.model import BatchModel
from testbench.flight.batch.vector import LANES
from testbench.flight.condition import TrimmedFlight
from testbench.flight.recorder import limit_broken
from testbench.flight.simulate import stride
from testbench.flight.start import Beginning
from testbench.flight.step import SteppedFlight

Mask = npt.NDArray[np.bool_]


class SteppedBatch:
    """Flights of one aircraft from one trim on, each advanced by its own commands and begun again when it is wanted.

    Each flies as :class:`testbench.flight.step.SteppedFlight` does, with a clock of its own, and none depends on the
    others: to begin again is to take back the registers of the beginning, whatever time it is for the others. A flight
    that has ended stands still until it begins again. One that comes near the ground, or leaves the atmosphere of the
    batch, is flown again by JSBSim up to there, which then flies on.

    Args:
        aircraft: the aircraft that was trimmed.
        trimmed: where the flights start; gives the simulation rate.
        controls: what is commanded, in this order.
        channels: channels of the simulator that are logged.
        log_rate_hz: must divide the simulation rate.
        flights: how many.

    Attributes:
        reasons: (flights,) why each ended, "" while it goes on.

    Raises:
        LimitError: the aircraft is not found equal to JSBSim in a batch, or the log rate does not divide the simulation
            rate.
        ChannelError: a control or channel that the aircraft does not have.
    """

    def __init__(
        self,
        aircraft: Aircraft,
        trimmed: TrimmedFlight,
        controls: Sequence[str],
        channels: Sequence[str],
        log_rate_hz: float,
        flights: int,
    ) -> None:
        found = judged(aircraft, trimmed)
        if found.model is None:
            raise LimitError(f"{aircraft.name} cannot be flown in a batch: {found.reason}; let JSBSim fly it")
        model = found.model
        for name, known in (*((c, tuple(model.commands)) for c in controls), *((c, model.channels) for c in channels)):
            if name not in known:
                raise ChannelError(f"{aircraft.name} has no channel '{name}' in flight{nearest(name, known)}")
        self._alone_as = (aircraft, trimmed, tuple(controls), tuple(channels), log_rate_hz)
        self._step = stride(trimmed.rate_hz, log_rate_hz)
        self._aircraft, self._controls, self._n = aircraft, tuple(controls), flights
        self._command_registers = np.array([model.commands[n] for n in controls])
        self._scale = np.array([aircraft.controls[n].scale for n in controls])
        self._high = np.array([aircraft.controls[n].full for n in controls])
        self._low = np.array([aircraft.controls[n].low for n in controls])
        index = [model.channels.index(n) for n in channels]
        self._factors = model.factors[index]
        R = placed([model], [Beginning.at(trimmed)])
        R[r.DT] = 1.0 / model.rate_hz
        model.program.machine.before(R)  # time stood still when they were placed
        model.program.machine.log(R)
        logged = np.array([model.program.logged[n] for n in channels], np.int64)
        self._blocks = [
            _Block(model, R, min(LANES, flights - k), logged, self._factors, self._step)
            for k in range(0, flights, LANES)
        ]
        self._begin = R[:, :1].copy()
        self._begin_row = R[logged, 0] * self._factors
        self._row = np.tile(self._begin_row, (flights, 1))
        self.reasons, self._ended = np.full(flights, "", object), np.zeros(flights, bool)
        self._alone: dict[int, SteppedFlight] = {}
        self._past: list[tuple[FloatArray, int]] = []
        self._since = np.zeros(flights, int)
        self._prelude: list[tuple[FloatArray, int]] = []

    def read(self) -> FloatArray:
        """Return the channels as they are now (flights, channels), SI; those of a flight that ended are its last."""
        return self._row.copy()

    def hold(self) -> None:
        """Take the first flight as it is now for the beginning of all: from here on, ``reset`` returns to it.

        Raises:
            LimitError: that flight has ended.
        """
        if self.reasons[0]:
            raise LimitError(f"a flight that ended is no beginning: {self.reasons[0]}")
        self._begin, self._begin_row = self._blocks[0].R[:, :1].copy(), self._row[0].copy()
        self._prelude = self._prelude + [(u[0], rows) for u, rows in self._past[self._since[0] :]]
        self.reset(np.ones(self._n, bool))

    def reset(self, which: Mask) -> None:
        """Begin the flights ``which`` (flights,) again."""
        for block, part in self._parts(which):
            block.R[:, : block.size][:, part] = self._begin
        self._row[which] = self._begin_row
        self.reasons[which], self._ended[which] = "", False
        for lane in [k for k in self._alone if which[k]]:
            del self._alone[lane]
        self._since[which] = len(self._past)
        gone = int(self._since.min())
        if gone > len(self._past) // 2:
            del self._past[:gone]
            self._since -= gone

    def advance(self, u: FloatArray, rows: int) -> FloatArray:
        """Fly on with absolute commands ``u`` (flights, controls) held, SI, for ``rows`` log intervals.

        Returns:
            (flights, rows, channels) the state at the end of each interval, SI; from where a flight has ended, see
            :attr:`reasons`, the last one within its limits.

        Raises:
            LimitError: a command of a flight that goes on leaves the range of its control.
        """
        ended = self._ended.copy()
        self._check(u, ended)
        self._past.append((u.copy(), rows))
        raw = u / self._scale
        data = np.empty((self._n, rows, len(self._factors)))
        stopped: dict[int, int] = {}
        unread = ended.copy()
        unread[list(self._alone)] = True
        for k, block in enumerate(self._blocks):
            first = k * LANES
            lanes = slice(first, first + block.size)
            block.R[self._command_registers, : block.size] = raw[lanes].T
            left = block.fly(data[lanes], unread[lanes])
            out = left >= 0
            if not out.any():
                continue
            block.R[:, : block.size][:, out] = self._begin  # it stands still: what is not finite is not flown on
            for i in np.flatnonzero(out & ~unread[lanes]).tolist():
                self._end(first + i, block.reason(i))
                stopped[first + i] = int(left[i])
        for lane in stopped:
            if not self._ended[lane]:  # JSBSim flies where the batch does not
                self._alone[lane] = self._again(lane)
        for lane in self._alone:
            if not ended[lane]:
                stopped[lane] = self._by_jsbsim(lane, data)
        for lane, row in stopped.items():
            data[lane, row:] = data[lane, row - 1] if row else self._row[lane]
        if ended.any():
            data[ended] = self._row[ended, None]
        self._row = data[:, -1].copy()
        return data

    def _end(self, lane: int, reason: str) -> None:
        self.reasons[lane], self._ended[lane] = reason, bool(reason)

    def _parts(self, which: Mask) -> list[tuple[_Block, Mask]]:
        parts = [(b, which[k * LANES : k * LANES + b.size]) for k, b in enumerate(self._blocks)]
        return [(b, part) for b, part in parts if part.any()]

    def _check(self, u: FloatArray, ended: Mask) -> None:
        outside = ~((u >= self._low - 1e-9) & (u <= self._high + 1e-9))
        if outside.any() and (outside := outside & ~ended[:, None]).any():
            lane, i = (int(x) for x in np.argwhere(outside)[0])
            raise LimitError(
                f"{self._low[i]:g} <= {self._controls[i]} <= {self._high[i]:g} must hold (rad; 1 for the throttle), "
                f"got {u[lane, i]:g} in flight {lane}; reduce the command"
            )

    def _again(self, lane: int) -> SteppedFlight:
        """Fly the commands that a flight has had, but the last, by JSBSim."""
        flight = SteppedFlight(*self._alone_as)
        for u, rows in [*self._prelude, *((u[lane], rows) for u, rows in self._past[self._since[lane] : -1])]:
            flight.advance(u, rows)
        return flight

    def _by_jsbsim(self, lane: int, data: FloatArray) -> int:
        """Fly the last command by JSBSim; return how many rows it has given."""
        u, rows = self._past[-1]
        new = self._alone[lane].advance(u[lane], rows)
        data[lane, : len(new)] = new
        self._end(lane, self._alone[lane].reason)
        return len(new)


class _Block:
    """Up to LANES of the flights.

    Attributes:
        R: registers.
        size: flights in it.
    """

    def __init__(
        self, model: BatchModel, R: FloatArray, size: int, logged: npt.NDArray[np.int64], factors: FloatArray, step: int
    ) -> None:
        self.R, self.size, self._model, self._step = aligned(len(R)), size, model, step
        self.R[:] = R
        self._logged, self._factors = logged, np.tile(factors[:, None], LANES)
        self._limits = limits_of([model] * size)
        self._watched = watched(self._limits)
        # commands are held: they are written into the registers before, and no input changes from frame to frame
        self._driven = Driven(np.empty((0, 0, LANES)), np.empty(0, np.int64))
        self._unread = np.ones(LANES, bool)  # those that only fill the block, always

    def fly(self, data: FloatArray, ended: Mask) -> npt.NDArray[np.int64]:
        """Fill rows (size, rows, channels); return the row at which each flight left its limits, -1 if it did not."""
        rows = np.empty((*data.shape[1:], LANES))
        self._unread[: self.size] = ended
        left, self._broken, self._value = self._model.program.machine.run(
            self.R, self._driven, Logged(self._step, self._logged, self._factors, rows), self._watched, self._unread
        )
        data[:] = rows.transpose(2, 0, 1)[: self.size]
        return left[: self.size]

    def reason(self, lane: int) -> str:
        """Return which limit a flight broke, "" if JSBSim flies on from there."""
        limit = self._limits[self._broken[lane]]
        if not limit.name:
            return ""
        low, high = self._model.aircraft.limits[limit.of]
        return limit_broken(limit.name, limit.factor, low, high, self._value[lane])
