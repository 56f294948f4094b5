"""The types of a flight plan: points, cards, runs and flights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from testbench.aircraft import Aircraft
from testbench.core.constants import G0_M_S2
from testbench.core.door import read_json
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.schema import Positive, Strict, parse
from testbench.estimators.operational.onset import CLEARANCE
from testbench.flight import LinearModel, TrimmedFlight
from testbench.flight.batch.jobs import Tally
from testbench.inputs import InputSignal
from testbench.page.shown import Shown
from testbench.questions.plan.scenario import PlannedManoeuvre, PlanScenario
from testbench.sensors import SensorSuite

if TYPE_CHECKING:
    from testbench.evaluation.envelope import Envelope, Onset

Status = Literal["fly", "scaled", "refused"]


@dataclass(frozen=True)
class ModeAt:
    """A mode at a point."""

    name: str  # of the mode
    elastic: bool  # whether the structure vibrates in it
    f_hz: float  # natural frequency
    zeta: float  # predicted damping ratio here; the least one of a mode that has split into two roots
    zeta_next: float | None  # predicted at the next speed of the build-up, or None after the last one


@dataclass(frozen=True, eq=False)
class Point:
    """One speed and height of the build-up."""

    number: int  # from 1, in the order of flying
    # V_m_s, h_m: true airspeed and height above sea level
    V_m_s: float
    h_m: float
    # trimmed, model: the aircraft there
    trimmed: TrimmedFlight
    model: LinearModel
    power_W: float  # drawn from battery or fuel in level flight
    onset: Onset | None  # the first onset of an elastic instability with rising speed at this height; None without one
    modes: tuple[ModeAt, ...]  # predicted modes
    next_V_m_s: float | None  # next speed of the build-up at this height

    @property
    def margin(self) -> float | None:
        """Distance to the onset as a share of it, or None if there is no onset."""
        if self.onset is None or self.onset.V_m_s is None:
            return None
        return 1.0 - self.V_m_s / self.onset.V_m_s

    @property
    def label(self) -> str:
        """Speed and height in words."""
        return f"{self.V_m_s:g} m/s, {self.h_m:g} m"


@dataclass(frozen=True)
class Reached:
    """Relative standard errors of one parameter: wanted, after one run, after all repeats of the card."""

    name: str
    wanted: float
    one: float
    reached: float
    needed: int | None

    @property
    def sentence(self) -> str:
        """The finding in words."""
        if self.needed is None:
            return (
                f"{self.name}: {100.0 * self.wanted:.3g} % cannot be reached by any number of repeats: these sensors "
                "and this input give no information on it alone"
            )
        text = f"{self.name}: {100.0 * self.reached:.2g} % reached, {100.0 * self.wanted:.3g} % wanted"
        return text if self.reached <= self.wanted * (1.0 + 1e-9) else f"{text}; that takes {self.needed} runs"


@dataclass(frozen=True)
class Limit:
    """A limit as it stands on a card: channel, lowest and highest value (SI, absolute), and where it comes from."""

    channel: str
    low: float
    high: float
    source: str = "as the plan says"


@dataclass(frozen=True, eq=False)
class Card:
    """One manoeuvre at one point."""

    number: int  # from 1, in the order of flying
    # point, spec: where and what
    point: Point
    spec: PlannedManoeuvre
    status: Status  # "fly" as given, "scaled" to ``factor``, or "refused"
    factor: float  # on the amplitudes of the scenario
    met: tuple[str, ...]  # limits that the manoeuvre breaks in the simulator at the amplitude of the scenario, in words
    signal: InputSignal  # what is commanded, deviations from trim, at the rate of the simulator
    # the response in the simulator, up to where the flight ended; t = 0 is the start of the input
    expected: FlightRecord
    band: Mapping[str, FloatArray]  # channel -> (n,) half width of the 95 % band about ``expected``
    limits: tuple[Limit, ...]  # that hold
    repeats: int  # number of runs; 0 for a refused card
    reached: tuple[Reached, ...]  # accuracy, if it sets the repeats

    @property
    def title(self) -> str:
        """What is flown where."""
        return f"{self.spec.name} at {self.point.label}"

    @property
    def t_s(self) -> FloatArray:
        """Times of ``expected`` on the clock of the inputs."""
        return self.expected.t_s - self.spec.settle_s

    @property
    def length_s(self) -> float:
        """Time of one run on condition: settling and manoeuvre."""
        return self.spec.settle_s + self.spec.duration_s


@dataclass(frozen=True, eq=False)
class Run:
    """One repetition of a card: which flight, when after take-off, and the energy drawn until its end."""

    number: int
    card: Card
    repeat: int
    flight: int
    start_s: float
    used_J: float


@dataclass(frozen=True)
class FlightLeg:
    """One flight on one battery or tank: its runs, its time from take-off to landing, and the energy that it takes."""

    number: int
    first_run: int
    last_run: int
    time_s: float
    energy_J: float
    usable_J: float

    @property
    def share(self) -> float:
        """Energy over what is usable."""
        return self.energy_J / self.usable_J


_FIRST = 2
"""Speeds of an aircraft whose structure vibrates that are flown before anything is cleared: two make a trend."""


class Cleared(Strict):
    """What `testbench modes` found in records of the speeds flown so far: the next speed, at most, and the onset."""

    flown_m_s: Annotated[tuple[Positive, ...], Field(min_length=1, strict=False)]
    cleared_m_s: Positive
    risk: Annotated[float, Field(gt=0.0, lt=1.0)]
    onset_m_s: Mapping[str, Positive]


def read_cleared(folder: Path) -> Cleared:
    """Return what a result of `testbench modes` cleared.

    Raises:
        RecordError: the folder holds no such result, or only records of one speed went into it.
    """
    file = folder / CLEARANCE
    if not file.is_file():
        raise RecordError(
            f"--after takes the folder of a result of testbench modes on records at two speeds or more, got {folder}"
        )
    found, faults = parse(Cleared, read_json(file, "model"), file)
    if found is None:
        raise RecordError("; ".join(faults))
    return found


@dataclass(frozen=True, eq=False)
class Plan(Shown, page="testbench.questions.plan.page:plan_page"):
    """A campaign that can be flown; ``tally`` says by what its cards were flown in the simulator.

    ``cleared`` is what flights of its slower points told of flutter; None before them.
    """

    scenario: PlanScenario
    aircraft: Aircraft
    suite: SensorSuite
    envelopes: tuple[Envelope, ...]
    points: tuple[Point, ...]
    cards: tuple[Card, ...]
    runs: tuple[Run, ...]
    flights: tuple[FlightLeg, ...]
    tally: Tally
    cleared: Cleared | None = None

    def waits(self, V_m_s: float) -> str:
        """Return why a speed is not flown yet, "" if it may be: flutter must be ruled out at a stated risk before."""
        if not any(m.elastic for p in self.points for m in p.modes):
            return ""
        if self.cleared is not None:
            most, risk = self.cleared.cleared_m_s, 100.0 * self.cleared.risk
            said = f"cleared to {most:.3g} m/s, with flutter there at a probability of {risk:.2g} %"
            return "" if V_m_s <= most else said
        first = sorted({p.V_m_s for p in self.points})[:_FIRST]
        return "" if V_m_s <= first[-1] else "testbench modes has not cleared it from records of the slower speeds"

    @property
    def weight_N(self) -> float:
        """Weight of the aircraft."""
        return self.aircraft.mass.mass_kg * G0_M_S2

    @property
    def name(self) -> str:
        """The plan's file stem."""
        return self.scenario.name
