"""The aircraft that is served: flown frame by frame by an autopilot's outputs, measured, and recorded."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.atmosphere import air_density
from testbench.core.record import FlightRecord, FloatArray
from testbench.flight import FlightCondition, TrimmedFlight, trim
from testbench.flight.air import Air
from testbench.flight.simulate import truth_of
from testbench.flight.step import SteppedFlight
from testbench.sensors import SensorSuite
from testbench.sensors.stream import Measuring

RECORD_HZ = 100.0
"""Records hold every so many frames that they are not faster: autopilots fly for hours."""
LONGEST_S = 3600.0
"""Of a record; what a flight does after that is served and not kept."""
ABOVE_M = 100.0
"""Height above the ground at which a flight begins, if nothing else is asked for."""


def trim_for(
    aircraft: Aircraft,
    V_m_s: float | None = None,
    h_m: float | None = None,
    wind_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0),
    suite: SensorSuite | None = None,
    rate_hz: float | None = None,
) -> TrimmedFlight:
    """Return where a served flight begins: steady, straight and level, heading north.

    Args:
        aircraft: what is served.
        V_m_s: true airspeed; that of its design if not given.
        h_m: height above sea level; that of its design if not given.
        wind_m_s: velocity of the air north, east, down.
        suite: instruments; their rate divides that of the flight.
        rate_hz: frames a second, one for each answer of the autopilot; the aircraft's own if not given, raised to a
            multiple of the suite's.

    Raises:
        TrimError: there is no equilibrium.
        ScenarioError: the suite's rate does not divide the rate.
    """
    if rate_hz is None:
        own, step = aircraft.rate_hz, suite.rate_hz if suite is not None else aircraft.rate_hz
        rate_hz = step * math.ceil(own / step - 1e-9)
    if suite is not None:
        suite.check_log_rate(rate_hz)
    condition = FlightCondition(V_m_s or aircraft.design_V_m_s, aircraft.design_h_m if h_m is None else h_m)
    return trim(aircraft, condition, rate_hz, Air(*wind_m_s) if any(wind_m_s) else None)


@dataclass
class Flown:
    """One flight that was served, from its trim to its end."""

    # truth, measured: its records; ``measured`` is what the suite told the autopilot, None without one
    truth: FlightRecord
    measured: FlightRecord | None
    duration_s: float  # of the flight, which may be longer than its record
    reason: str  # why it ended; "" if the autopilot, or the user, ended it


@dataclass
class Tally:
    """What the link did: steps that were flown, and what came besides."""

    steps: int = 0
    repeated: int = 0
    missed: int = 0
    late: int = 0
    foreign: int = 0
    unanswered: int = 0
    flights: list[Flown] = field(default_factory=list)


class Served:
    """One aircraft in the air, advanced frame by frame by the commands of an autopilot.

    Args:
        aircraft: what flies, amendments included.
        trimmed: where each flight begins; its rate is that of the frames.
        suite: instruments whose samples the autopilot gets in place of the truth; none: it gets the truth.
        seed: of their noise; the n-th flight takes ``seed + n``.
        release_s: the aircraft flies its trim for so long before commands act.
        ground_m: height of the ground above sea level.

    Attributes:
        t_s: of the flight, s.
        now: channel -> value after the last frame, SI, the truth.
        told: channel -> value that the instruments tell; the truth where there is none.
        fresh: channels of instruments that the last frame brought.
        reason: why the flight has ended; "" while it goes on.

    Raises:
        ScenarioError: the suite's rate does not divide that of the frames.
        ChannelError: the aircraft lacks a channel that an instrument needs.

    Example:
        >>> import testbench as tb
        >>> taurus = tb.load_aircraft("taurus")
        >>> served = Served(taurus, trim_for(taurus), release_s=0.0)
        >>> served.step({"de": -0.05})
        >>> served.told["q"] > 0.0
        True
    """

    def __init__(
        self,
        aircraft: Aircraft,
        trimmed: TrimmedFlight,
        suite: SensorSuite | None = None,
        seed: int = 0,
        release_s: float = 0.0,
        ground_m: float | None = None,
    ) -> None:
        self.aircraft, self.trimmed, self.suite, self.rate_hz = aircraft, trimmed, suite, trimmed.rate_hz
        self.release_s, self.tally = release_s, Tally()
        self.ground_m = max(trimmed.condition.h_m - ABOVE_M, 0.0) if ground_m is None else ground_m
        self._seed, self._controls, self._names = seed, tuple(trimmed.controls), tuple(trimmed.state)
        self._every = max(math.ceil(self.rate_hz / RECORD_HZ - 1e-9), 1)
        self._flight: SteppedFlight | None = None
        self.begin()

    def begin(self) -> None:
        """Begin a flight at the trim; the one before, if it moved, is kept in ``tally.flights``."""
        self.end()
        self._flight = SteppedFlight(self.aircraft, self.trimmed, self._controls, self._names, self.rate_hz)
        self.frames, self.reason = 0, ""
        self._rows: list[FloatArray] = []
        self._samples: list[tuple[FloatArray, np.ndarray]] = []
        self._measuring: Measuring | None = None
        if self.suite is not None:
            seed = self._seed + len(self.tally.flights)
            self._measuring = Measuring(self.suite, self._names, self.rate_hz, seed)
        self._take(self._flight.read())

    @property
    def t_s(self) -> float:
        """Time of the flight, s."""
        return self.frames / self.rate_hz

    @property
    def released(self) -> bool:
        """Whether commands act."""
        return self.t_s >= self.release_s - 0.5 / self.rate_hz

    def step(self, commands: Mapping[str, float]) -> None:
        """Fly one frame; controls that are not commanded, or not yet, are where they hold the trim.

        A flight that has left the limits of the aircraft stands still; ``reason`` says why.
        """
        if self.reason or self._flight is None:
            return
        given = commands if self.released else {}
        u = np.array([given.get(n, self.trimmed.controls[n]) for n in self._controls])
        rows = self._flight.advance(u, 1)
        self.reason = self._flight.reason
        if len(rows) and np.all(np.isfinite(rows)):
            self.frames += 1
            self.tally.steps += 1
            self._take(rows[0])

    def _take(self, row: FloatArray) -> None:
        self.now: dict[str, float] = dict(zip(self._names, row.tolist(), strict=True))
        self.told, self.fresh = self.now, frozenset[str]()
        kept = self.frames < LONGEST_S * self.rate_hz
        if self.frames % self._every == 0 and kept:
            self._rows.append(row)
        if self._measuring is not None and self.suite is not None:
            self._measuring.add(row)
            values, fresh, names = self._measuring.values, self._measuring.fresh, self.suite.channels
            self.told = self.now | dict(zip(names, values.tolist(), strict=True))
            self.fresh = frozenset(n for n, new in zip(names, fresh, strict=True) if new)
            if self.frames % self.suite.check_log_rate(self.rate_hz) == 0 and kept:
                self._samples.append((values.copy(), fresh.copy()))

    def end(self) -> None:
        """End the flight, and keep it if it moved."""
        if self._flight is None or not self.frames:
            return
        said = {
            "aircraft": self.aircraft.name,
            "amendments": [a.name for a in self.aircraft.amendments],
            "V_m_s": self.trimmed.condition.V_m_s,
            "h_m": self.trimmed.condition.h_m,
            "manoeuvre": "flown by an autopilot",
            "release_s": self.release_s,
            "simulation_rate_hz": self.rate_hz,
        }
        rows = np.array(self._rows)
        truth = truth_of(self.aircraft, rows, self._names, None, self.rate_hz / self._every, said, self.reason)
        measured = None
        if self.suite is not None:
            data, valid = (np.array(part) for part in zip(*self._samples, strict=True))
            t = np.arange(len(data)) / self.suite.rate_hz
            told = {"suite": self.suite.name, "seed": self._seed + len(self.tally.flights), "truth": said}
            measured = FlightRecord(t, self.suite.channels, data, "measured", valid, told, truth.outcome, truth.reason)
        self.tally.flights.append(Flown(truth, measured, self.t_s, self.reason))
        self._flight = None

    def velocity(self, of: Mapping[str, float]) -> tuple[float, float, float]:
        """Return the velocity over ground north, east, down, m/s."""
        return of["v_north"], of["v_east"], -of["hdot"]

    def equivalent_airspeed(self) -> float:
        """Return the equivalent airspeed that the instruments tell, m/s: of the dynamic pressure at sea level."""
        qbar = self.told["qbar"]
        if self.suite is not None and "qbar" not in self.suite.channels and "V" in self.suite.channels:
            qbar = 0.5 * air_density(self.now["h"]) * self.told["V"] ** 2
        return math.sqrt(max(2.0 * qbar / air_density(0.0), 0.0))
