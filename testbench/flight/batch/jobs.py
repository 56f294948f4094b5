"""What is asked of a batch, and what is told of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Literal, Self, TypeVar

from testbench.aircraft import Aircraft
from testbench.core.processes import spread
from testbench.core.record import FlightRecord
from testbench.flight.air import Air
from testbench.flight.condition import Start, TrimmedFlight
from testbench.flight.simulate import Manoeuvre, beginning_of, fly
from testbench.flight.start import Beginning

Simulator = Literal["auto", "batch", "jsbsim"]
"""What flies: "jsbsim" one flight after the other; "batch" many at once, and refuses what it cannot fly; "auto" the
batch where a model has been found equal to JSBSim, else JSBSim.
"""
BATCH, JSBSIM = "batch, judged by JSBSim", "JSBSim, as "
"""What the provenance of a flight of many says of its simulator; behind the second stands why."""
T = TypeVar("T")
BOTH = 200
"""One flight of a batch in so many is flown by JSBSim as well."""


@dataclass(frozen=True, eq=False)
class Job:
    """One flight that is wanted: what :func:`testbench.flight.fly` takes.

    Example:
        >>> import testbench as tb
        >>> taurus = tb.load_aircraft("taurus")
        >>> trimmed = tb.trim(taurus, tb.FlightCondition(12.0, 100.0))
        >>> still = tb.InputSignal([0.0, 1.0 / trimmed.rate_hz], [[0.0], [0.0]], ("de",))
        >>> tb.Job(taurus, trimmed, tb.Manoeuvre("still", still), log_rate_hz=60.0).log_rate_hz
        60.0
    """

    aircraft: Aircraft
    trimmed: TrimmedFlight
    manoeuvre: Manoeuvre
    log_rate_hz: float
    channels: tuple[str, ...] | None = None
    air: Air | None = None
    start: Start | None = None

    def flown_by_jsbsim(self) -> FlightRecord:
        """Return the truth of the flight by :func:`testbench.flight.fly`."""
        return fly(self.aircraft, self.trimmed, self.manoeuvre, self.log_rate_hz, self.channels, self.air, self.start)

    @cached_property
    def beginning(self) -> Beginning:
        """Where it begins."""
        return beginning_of(self.trimmed, self.manoeuvre, self.start)


def by_jsbsim(found: Sequence[T | None], make: Callable[[int], T]) -> list[T]:
    """Return what a batch found; where it found nothing (None), what JSBSim makes, by all processes that may be used.

    Args:
        found: by the batch.
        make: number -> what is wanted.
    """
    rest = [i for i, each in enumerate(found) if each is None]
    made = dict(zip(rest, spread([partial(make, i) for i in rest]), strict=True))
    return [made[i] if each is None else each for i, each in enumerate(found)]


@dataclass
class Tally:
    """By what flights were flown."""

    batch: int = 0  #: number flown by the program
    jsbsim: int = 0  #: number flown by JSBSim
    both: int = 0  #: number flown by both
    worst: float = 0.0  #: greatest difference of those, of a channel's range
    reasons: dict[str, int] = field(default_factory=dict)  #: why JSBSim flew -> number of flights

    def by_jsbsim(self, reason: str, count: int = 1) -> None:
        """Count flights by JSBSim, and why."""
        self.jsbsim += count
        self.reasons[reason] = self.reasons.get(reason, 0) + count

    @classmethod
    def of(cls, records: Iterable[FlightRecord]) -> Self:
        """Count flights of many by what their records say."""
        out = cls()
        for record in records:
            by = str(record.provenance.get("simulator", ""))
            if by == BATCH:
                out.batch += 1
            else:
                out.by_jsbsim(by.removeprefix(JSBSIM))
        return out
