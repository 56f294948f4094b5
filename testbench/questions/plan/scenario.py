"""Flight plans: test points, manoeuvres at each, limits, times and energy. Keys carry their units."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from testbench.core.scenario.base import Flown, ManoeuvreLimits, SuiteName
from testbench.core.scenario.inputs import Control, Input
from testbench.core.schema import NonNegative, Positive, Strict, Text
from testbench.inputs import InputSignal, build

_NOT_BY_HAND = ("multisine", "prbs", "gbn")
HEAVY_KG = 150.0  # aircraft above it burn fuel, and are flown in knots and feet, where a plan does not say otherwise
Share = Annotated[float, Field(gt=0.0, le=100.0)]


class PlannedManoeuvre(Strict):
    """A manoeuvre at every point, or at those of ``speeds_m_s`` and ``heights_m``.

    Give ``repeats``, or ``accuracy_percent``: the wanted standard errors of named parameters, in percent of their
    values, from which the repeats follow. With both, so many runs are planned, and `testbench live` says when fewer are
    enough. ``estimated`` are the parameters that are estimated with them; if it is
    empty, those of the rigid motion that the moved controls enter. ``design`` is the file of the design that it was
    taken from (`testbench plan --from`): after the flight it is identified as that file says. ``use`` "validation" is
    a manoeuvre that nothing is identified from: it judges what the others of its design gave.
    """

    name: Text
    duration_s: Annotated[float, Field(gt=0.0, le=600.0)]
    settle_s: Annotated[float, Field(ge=0.0, le=60.0)] = 2.0
    repeats: Annotated[int, Field(ge=1, le=1000)] | None = None
    accuracy_percent: dict[str, Positive] = {}
    estimated: Annotated[tuple[str, ...], Field(strict=False)] = ()
    most_repeats: Annotated[int, Field(ge=1, le=1000)] = 20
    speeds_m_s: Annotated[tuple[Positive, ...], Field(strict=False)] = ()
    heights_m: Annotated[tuple[float, ...], Field(strict=False)] = ()
    design: Text | None = None
    use: Literal["identification", "validation"] = "identification"
    input: Annotated[tuple[Input, ...], Field(min_length=1, strict=False)]

    @model_validator(mode="after")
    def _one_rule_for_the_repeats(self) -> PlannedManoeuvre:
        if self.repeats is None and not self.accuracy_percent:
            raise ValueError("a manoeuvre takes repeats, accuracy_percent or both")
        controls = {i.control for i in self.input}
        if controls & {"de", "thr"} and controls & {"da", "dr"}:
            raise ValueError(
                "the controls of a manoeuvre must belong to one motion, de and thr or da and dr, got "
                f"{', '.join(sorted(controls))}; make two manoeuvres of it"
            )
        return self

    @property
    def plane(self) -> Literal["longitudinal", "lateral"]:
        """The motion that its controls move."""
        return "longitudinal" if self.input[0].control in {"de", "thr"} else "lateral"

    @property
    def controls(self) -> tuple[Control, ...]:
        """The controls that move, each once."""
        return tuple(dict.fromkeys(i.control for i in self.input))


Surface = Literal["de", "da", "dr"]


class PlanLimits(ManoeuvreLimits):
    """The limits of every manoeuvre; changes are relative to trim. Omitted ones come from the aircraft.

    Deflections, trim included, are limited by the aircraft's own stops; alpha and sideslip by its limits; speed by 1.2
    stall speeds and its limit; bank and pitch by half its limit, but 30 to 45 deg; the load factor by 0 and 2 where
    the aircraft states none; height by half the height above the field, at most 5 s of flight. Every card says where
    each of its limits comes from, and who watches it.
    """

    deflection_deg: dict[Surface, Positive] = {}  # type: ignore[assignment]  # no throttle
    rate_deg_s: dict[Surface, Positive] = {}  # type: ignore[assignment]
    V_min_m_s: Positive | None = None
    V_max_m_s: Positive | None = None

    @model_validator(mode="after")
    def _slow_below_fast(self) -> PlanLimits:
        if self.V_min_m_s is not None and self.V_max_m_s is not None and not self.V_min_m_s < self.V_max_m_s:
            raise ValueError(f"V_min_m_s < V_max_m_s must hold, got {self.V_min_m_s:g} and {self.V_max_m_s:g}")
        return self


class Timing(Strict):
    """Time beyond the manoeuvres: ``turn_s`` per run, to fly back and trim again; ``overhead_s`` per flight.

    ``overhead_s`` is take-off, climb, descent and landing; ``field_m`` the height of the field above sea level.
    """

    turn_s: NonNegative
    overhead_s: NonNegative
    field_m: float = 0.0


class Airspace(Strict):
    """The airspace: a box along whose length the runs are flown, heights above sea level, and the wind.

    ``wind_m_s`` is the strongest mean wind and ``gust_m_s`` the strongest gust in which anybody flies; runs are
    reckoned with that wind from behind. ``bank_deg`` is the bank of the turns back.
    """

    length_m: Positive
    width_m: Positive
    lowest_m: float
    highest_m: float
    wind_m_s: NonNegative
    gust_m_s: NonNegative | None = None
    bank_deg: Annotated[float, Field(gt=0.0, le=60.0)] = 30.0

    @model_validator(mode="after")
    def _upwards(self) -> Airspace:
        if not self.highest_m > self.lowest_m:
            raise ValueError(f"highest_m > lowest_m must hold, got {self.highest_m:g} and {self.lowest_m:g}")
        if self.gust_m_s is not None and self.gust_m_s < self.wind_m_s:
            raise ValueError(f"gust_m_s >= wind_m_s must hold, got {self.gust_m_s:g} and {self.wind_m_s:g}")
        return self


class Battery(Strict):
    """Electric: power = thrust V / efficiency + avionics; ``efficiency_percent`` from battery to thrust power."""

    kind: Literal["battery"]
    capacity_Wh: Positive
    usable_percent: Share = 80.0
    efficiency_percent: Share
    avionics_W: NonNegative = 0.0
    source: Text

    @property
    def usable_J(self) -> float:
        """Energy that a flight may use, J."""
        return 3600.0 * self.capacity_Wh * self.usable_percent / 100.0


class Fuel(Strict):
    """A combustion engine: fuel power = thrust V / efficiency; ``heating_MJ_kg`` is the lower heating value.

    ``density_kg_l`` is 0.72 for aviation gasoline, 0.80 for jet fuel.
    """

    kind: Literal["fuel"]
    capacity_kg: Positive
    usable_percent: Share = 80.0
    efficiency_percent: Share
    heating_MJ_kg: Positive = 43.0
    density_kg_l: Positive = 0.72
    avionics_W: NonNegative = 0.0
    source: Text

    @property
    def usable_J(self) -> float:
        """Energy that a flight may use, J."""
        return 1e6 * self.capacity_kg * self.heating_MJ_kg * self.usable_percent / 100.0


class Tow(Strict):
    """A glider: its energy is height, from ``release_m`` down to ``lowest_m`` above sea level, for every flight."""

    kind: Literal["tow"]
    release_m: float
    lowest_m: float

    @model_validator(mode="after")
    def _downwards(self) -> Tow:
        if not self.release_m > self.lowest_m:
            raise ValueError(f"release_m > lowest_m must hold, got {self.release_m:g} and {self.lowest_m:g}")
        return self


class OnTheCard(Strict):
    """Data of cards that do not follow from the simulation, and their units.

    ``units`` are "metric" (m/s, m) or "aviation" (knots, feet); aircraft above 150 kg have the latter where nothing is
    given. ``configuration`` is that of flaps, gear and payload. ``emergency`` are lines on what is done when something
    fails; ``hazards`` stand beside those that the manoeuvre itself has.
    """

    units: Literal["metric", "aviation"] | None = None
    configuration: Text | None = None
    hazards: Annotated[tuple[Text, ...], Field(strict=False)] = ()
    emergency: Annotated[tuple[Text, ...], Field(strict=False)] = ()


_FASTEST_MS = {"ardupilot": 20, "px4": 20, "own": 1}  # scripting reaches 30 to 50 Hz, a companion's messages as well


class Autopilot(Strict):
    """How an autopilot flies a sequence: its kind, start switch, required mode, rate, and the surfaces that it holds.

    ``system`` is "ardupilot" (a Lua script per card), "px4" (a MAVLink sender per card for a companion computer) or
    "own" (the signals as CSV alone). The simulated input is sampled and held every ``period_ms``, as the flown one.
    ArduPilot: ``switch_option`` is the RCn_OPTION of the start switch (300 to 307: Scripting1 to Scripting8), ``mode``
    the number of the flight mode (0: MANUAL). PX4: ``switch_channel`` is the radio channel of the start switch;
    ``interface`` is "manual_control" (PX4 1.17 and later) or "actuator_control" (1.13 with mixers). ``hold`` "all"
    keeps every surface at its trim while a sequence runs; "moved" only those that it moves. ``stick_us`` is how far the
    pulse of the pilot's roll, pitch or yaw stick may be from where it was at the start before the run ends.
    """

    system: Literal["ardupilot", "px4", "own"] = "ardupilot"
    switch_option: Annotated[int, Field(ge=300, le=307)] = 300
    switch_channel: Annotated[int, Field(ge=1, le=18)] = 7
    interface: Literal["manual_control", "actuator_control"] = "manual_control"
    mode: Annotated[int, Field(ge=0)] = 0
    period_ms: Annotated[int, Field(ge=1, le=100)] = 20
    hold: Literal["all", "moved"] = "moved"
    speed_window_m_s: Positive = 1.0
    bank_at_start_deg: Positive = 10.0
    stick_us: Annotated[int, Field(ge=20, le=400)] = 50

    @model_validator(mode="after")
    def _no_faster_than_it_can(self) -> Autopilot:
        least = _FASTEST_MS[self.system]
        if self.period_ms < least:
            raise ValueError(
                f"period_ms >= {least} must hold for system '{self.system}', got {self.period_ms}; a faster player "
                "of your own takes system = 'own'"
            )
        return self

    @property
    def scripted(self) -> bool:
        """Whether a script is written for every card that one can fly."""
        return self.system != "own"


class PlanScenario(Flown):
    """A campaign: points over speed and height, manoeuvres at them, limits, times and energy.

    ``uncertainty_percent`` is the standard deviation of every derivative of the rigid motion of which the aircraft does
    not state one itself (``[uncertainty]`` of aircraft.toml), ``turbulence_rms_m_s`` that of the vertical air: both
    widen the band of the expected response. The onset of instability that the model predicts, less
    ``onset_margin_percent``, is the fastest admissible speed.
    """

    unnamed: ClassVar[str] = "plan"
    checked_by: ClassVar[str] = "testbench.questions.plan.check:check"

    flown_by: Literal["pilot", "autopilot"]
    speeds_m_s: Annotated[tuple[Positive, ...], Field(min_length=1, strict=False)]
    heights_m: Annotated[tuple[float, ...], Field(min_length=1, strict=False)]
    onset_margin_percent: Annotated[float, Field(ge=0.0, lt=100.0)] = 10.0
    allow_above_onset: bool = False
    scale: bool = False
    suite: SuiteName
    turbulence_rms_m_s: NonNegative = 0.0
    uncertainty_percent: NonNegative = 15.0
    limits: PlanLimits
    timing: Timing
    airspace: Airspace | None = None
    energy: Annotated[Battery | Fuel | Tow, Field(discriminator="kind")]
    autopilot: Autopilot = Autopilot()
    card: OnTheCard = OnTheCard()
    manoeuvre: Annotated[tuple[PlannedManoeuvre, ...], Field(min_length=1, strict=False)]

    @property
    def held_ms(self) -> int | None:
        """How long a script holds each command; None if a pilot flies."""
        return self.autopilot.period_ms if self.flown_by == "autopilot" else None

    @model_validator(mode="after")
    def _flyable_and_consistent(self) -> PlanScenario:
        faults = []
        names = [m.name for m in self.manoeuvre]
        if len(set(names)) != len(names):
            faults.append(f"manoeuvre names must differ, got {', '.join(names)}")
        for key in ("speeds_m_s", "heights_m"):
            values = getattr(self, key)
            if len(set(values)) != len(values):
                faults.append(f"{key}: every value must stand there once, got {list(values)}")
        for m in self.manoeuvre:
            for key in ("speeds_m_s", "heights_m"):
                strange = sorted(set(getattr(m, key)) - set(getattr(self, key)))
                if strange:
                    faults.append(f"{key} of manoeuvre '{m.name}' must be among those of the plan, got {strange}")
            by_hand = [i.signal for i in m.input if i.signal in _NOT_BY_HAND]
            if self.flown_by == "pilot" and by_hand:
                faults.append(
                    f"a pilot flies steps, manoeuvre '{m.name}' has a {by_hand[0]}; set flown_by = 'autopilot'"
                )
        if faults:
            raise ValueError("; ".join(faults))
        return self


# --- what is commanded: by hand as it is drawn, by a script sampled and held at its period ----------------------------


def commanded(inputs: Sequence[Input], duration_s: float, rate_hz: float, period_ms: int | None = None) -> InputSignal:
    """Return the commands at the rate of the simulator, deviations from trim, SI.

    Args:
        inputs: of the manoeuvre.
        duration_s: of the manoeuvre.
        rate_hz: of the simulator.
        period_ms: of the script that sends them: each value holds until the next one is sent; None for a pilot.

    Raises:
        ScenarioError: the inputs break a law, or cannot be sampled at the period.
    """
    if period_ms is None:
        return build(inputs, duration_s, rate_hz)
    sent = build(inputs, duration_s, 1e3 / period_ms)
    t = np.arange(round(duration_s * rate_hz)) / rate_hz
    row = np.minimum(np.floor(t * 1e3 / period_ms + 1e-6).astype(int), len(sent.u) - 1)
    return InputSignal(t, sent.u[row], sent.channels)
