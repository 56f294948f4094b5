"""A flight in pieces, for a controller or agent that chooses the next command during the flight."""

from __future__ import annotations

from collections.abc import Sequence

from testbench.aircraft import Aircraft
from testbench.core.errors import ChannelError, LimitError, nearest
from testbench.core.record import FloatArray
from testbench.flight.condition import TrimmedFlight
from testbench.flight.executive import Executive
from testbench.flight.recorder import Recorder
from testbench.flight.simulate import stride
from testbench.flight.trim import place_at_trim


class SteppedFlight:
    """JSBSim from trim on, advanced by commands that are given as it flies.

    The servos take commands as running linearly from frame to frame, as in :func:`testbench.flight.fly`. There a step
    begins one frame before its instant, because the next command is known. Here it begins with the first frame after
    it, so that a flight by steps equals the flight of the same signal one frame later.

    Args:
        aircraft: the aircraft that was trimmed.
        trimmed: where the flight starts; gives the simulation rate.
        controls: what is commanded, in this order.
        channels: channels of the simulator that are logged.
        log_rate_hz: must divide the simulation rate.

    Attributes:
        reason: why the flight ended, "" while it goes on.

    Raises:
        LimitError: the log rate does not divide the simulation rate.
        ChannelError: a control or channel that the aircraft does not have.
    """

    def __init__(
        self,
        aircraft: Aircraft,
        trimmed: TrimmedFlight,
        controls: Sequence[str],
        channels: Sequence[str],
        log_rate_hz: float,
    ) -> None:
        self._step = stride(trimmed.rate_hz, log_rate_hz)
        self._fdm = Executive(aircraft, trimmed.rate_hz, trimmed.condition)
        place_at_trim(self._fdm, trimmed)
        for name, known in (
            *((c, tuple(self._fdm.command_nodes)) for c in controls),
            *((c, self._fdm.channels) for c in channels),
        ):
            if name not in known:
                raise ChannelError(f"{aircraft.name} has no channel '{name}' in flight{nearest(name, known)}")
        self._log = Recorder(self._fdm, channels)
        self._writers = [self._fdm.command_nodes[n].set_double_value for n in controls]
        self._scales = [aircraft.controls[n].scale for n in controls]
        self._ranges = [(aircraft.controls[n].low, aircraft.controls[n].full) for n in controls]
        self._controls = tuple(controls)
        self.reason = ""

    def read(self) -> FloatArray:
        """Return the channels as they are now (channels,), SI."""
        return self._log.read()

    def advance(self, u: FloatArray, rows: int) -> FloatArray:
        """Fly on with absolute commands ``u`` (controls,) held, SI, for ``rows`` log intervals.

        Returns:
            (rows, channels) the state at the end of each interval, SI; fewer rows if the flight ended, see ``reason``.

        Raises:
            LimitError: a command leaves the range of its control, or the flight has ended.
        """
        if self.reason:
            raise LimitError(f"a flight that ended cannot go on: {self.reason}; start another")
        values = u.tolist()
        for name, value, (low, high) in zip(self._controls, values, self._ranges, strict=True):
            if not low - 1e-9 <= value <= high + 1e-9:
                raise LimitError(
                    f"{low:g} <= {name} <= {high:g} must hold (rad; 1 for the throttle), got {value:g}; "
                    "reduce the command"
                )
        for write, value, scale in zip(self._writers, values, self._scales, strict=True):
            write(value / scale)
        run, log = self._fdm.fdm.run, self._log
        taken = log.empty(rows)
        for row in range(rows):
            try:
                for _ in range(self._step):
                    run()
                self.reason = log.take(taken, row)
            except RuntimeError as error:  # a function has no value there
                self.reason = f"JSBSim stopped: {self._fdm.stopped(error)}"
            if self.reason:
                return log.si(taken, row)
        return log.si(taken, rows)
