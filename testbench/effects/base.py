"""What an effect is: physics in words, bounded parameters, and how it changes aircraft or sensors.

A law says what an effect adds to an aircraft; the rows of the tables beside it say all else.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.paths import ControlPath
from testbench.aircraft.seams import opened
from testbench.core.errors import ModelError
from testbench.flight import FlightCondition
from testbench.flight.air import Gust
from testbench.sensors import SensorSuite

# Where an effect acts, from the forces up to the pilot's command; what acts farther up passes through all below it.
FORCES, LINKAGE, SERVO, GEARING, AUTOPILOT, LINK = range(6)

SIZE = 4.0  #: prior standard deviation of a size, in multiples of its usual start


@dataclass(frozen=True)
class Parameter:
    """One free quantity of an effect, within physical bounds, with the values that a fit starts from.

    ``prior`` is (value, relative standard deviation) where handbook knowledge bounds what flight data cannot separate.
    ``none`` is the value at which the effect vanishes, or None if that depends on what is believed. A length may be
    off by as much as ``of_span`` of the aircraft's span, if that is more than the bounds allow.
    """

    name: str
    unit: str
    low: float
    high: float
    starts: tuple[float, ...]
    prior: tuple[float, float] | None = None
    none: float | None = None
    of_span: float = 0.0

    def sized(self, aircraft: Aircraft) -> Parameter:
        """Return the parameter with bounds (SI) that are wide enough for the size of an aircraft."""
        reach = self.of_span * aircraft.geometry.b_m
        return replace(self, low=min(self.low, -reach), high=max(self.high, reach)) if reach else self


@dataclass(frozen=True)
class MetGust:
    """A gust that one record met: it belongs to that record and not to the aircraft."""

    record: str  #: key of the record, see :func:`testbench.questions.gap.starts.record_key`
    manoeuvre: str  #: its name, for people
    gust: Gust  #: on the clock of the record, which starts with its first sample


Values = Mapping[str, float]
Amend = Callable[[Aircraft, SensorSuite, Values], tuple[Aircraft, SensorSuite]]
Law = Callable[[Aircraft, Values], Amendment]
PathLaw = Callable[[Aircraft, ControlPath, Values], Amendment]
OverTime = Callable[[Aircraft, SensorSuite, Values, float], tuple[Aircraft, SensorSuite]]


@dataclass(frozen=True)
class Effect:
    """One physical effect that a believed model may lack."""

    name: str  #: short name, as in results
    title: str  #: name for people
    #: part of the aircraft or sensor that it acts in. A second effect found in the same place is likely due to the form
    #: of the first, which is never quite right.
    place: str
    physics: str  #: what happens, in two sentences
    parameters: tuple[Parameter, ...]  #: what a fit estimates
    amend: Amend  #: returns aircraft and suite with the effect added; neither argument is changed
    mistaken_for: str  #: what it cannot be told from, and when
    separated_by: str  #: what flight or measurement tells them apart
    lateral: bool = False  #: True if it is sought only in records whose aileron or rudder command moves
    contains: tuple[str, ...] = ()  #: effects that are special cases of this one
    #: effects of which this one is put together (see :func:`together`); their parameters are this one's, called
    #: EFFECT.PARAMETER
    parts: tuple[Effect, ...] = ()
    #: values -> the gust that one record met; None for all effects that belong to aircraft or sensors
    met: Callable[[Values], MetGust] | None = None
    #: number of places (records, times, components) where the effect was sought, the best of which was taken;
    #: thresholds are Bonferroni's over all of them. 0 if it was not found anywhere.
    looks: int = 1
    #: how far up the path from the pilot's command to the forces it acts (FORCES, LINKAGE, ...). Effects found together
    #: act in that order, whichever was found first.
    upstream: int = FORCES
    #: part of the aircraft that whoever looks for the cause goes to, see :mod:`testbench.questions.gap.parts`; that of
    #: ``place`` if not given
    part: str = ""
    ground_check: str = ""  #: the cheapest check on the ground, in words; that of the part if not given
    #: what it makes of an aircraft and its sensors so many s after take-off, for an effect that grows during the
    #: flight: (aircraft, sensors, values, time) -> both. Then ``amend`` is that ten minutes after.
    over_time: OverTime | None = None
    #: the effect that does the same in models of the testbench's own form, where this one is left out
    own_form: str = ""
    #: (believed condition of a record, values) -> the one that it was really flown from, for an effect that moves it
    elsewhere: Callable[[FlightCondition, Values], FlightCondition] | None = None
    later: bool = False  #: whether it acts only in records that say that it has begun in flight
    #: how far the real thing departs from this form, relative to its own signature (judged). The residual that it
    #: leaves may be as large as form_error times its own signature.
    form_error: float = 0.03

    @property
    def singles(self) -> tuple[Effect, ...]:
        """Its parts, or itself."""
        return self.parts or (self,)

    def sized(self, aircraft: Aircraft) -> Effect:
        """Return the effect with bounds that are wide enough for the size of an aircraft."""
        return replace(self, parameters=tuple(p.sized(aircraft) for p in self.parameters))


def unchanged(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Return both as they are: what an effect of the air amends."""
    return aircraft, suite


def added(law: Law, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Return the aircraft with the amendment that ``law`` makes of it, and the sensors as they are."""
    return aircraft.amended(law(aircraft, values)), suite


def on_path(
    law: PathLaw, control: str, aircraft: Aircraft, suite: SensorSuite, values: Values
) -> tuple[Aircraft, SensorSuite]:
    """Return the aircraft with the amendment that ``law`` makes on the way of a control, and the sensors as they are.

    Raises:
        ModelError: the aircraft has no such control.
    """
    aircraft, path = opened(aircraft, control)
    return aircraft.amended(law(aircraft, path, values)), suite


_TEN_MIN_S = 600.0  # when as much is gone as at the mean rate, whatever the power; and of what no record tells when
_LEAST = 0.05  # of what there was, which is left at any time
POWER = Parameter("power", "1", 0.3, 4.0, (0.6, 1.8))
"""Of time by which more is gone, where an effect grows unevenly, see :func:`left`."""


def left(values: Values, at_s: float) -> float:
    """Return the share that is left so many s after take-off, of what falls by "per_min" a minute.

    Where a "power" is given, the rate is the mean one of the first ten minutes, and what is gone grows as that power of
    time.
    """
    even = at_s / _TEN_MIN_S
    gone = values["per_min"] * _TEN_MIN_S / 60.0 * math.copysign(abs(even) ** values.get("power", 1.0), even)
    return max(1.0 - gone, _LEAST)


def ten_minutes_after(
    grown: OverTime, aircraft: Aircraft, suite: SensorSuite, values: Values
) -> tuple[Aircraft, SensorSuite]:
    """Return what an effect that grows during the flight has made of both ten minutes after take-off."""
    return grown(aircraft, suite, values, _TEN_MIN_S)


def together(*effects: Effect) -> Effect:
    """Return the effect that consists of ``effects``, each with parameters of its own."""
    return Effect(
        name=" + ".join(e.name for e in effects),
        title=" and ".join(e.title for e in effects),
        place=" and ".join(e.place for e in effects),
        physics=" ".join(e.physics for e in effects),
        parameters=tuple(replace(p, name=f"{e.name}.{p.name}") for e in effects for p in e.parameters),
        amend=_amend_all,
        mistaken_for="; ".join(e.mistaken_for for e in effects),
        separated_by="; ".join(e.separated_by for e in effects),
        lateral=any(e.lateral for e in effects),
        parts=effects,
        looks=math.prod(e.looks for e in effects),
        form_error=max(e.form_error for e in effects),
    )


def _amend_all(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    raise ModelError("effects put together must be added one by one (Believed.with_effect), got one call for all")


def in_place(aircraft: Aircraft, known: int, effect: Effect) -> Aircraft:
    """Return an aircraft whose amendments behind the ``known`` first ones act where ``effect`` does."""
    new = (replace(a, upstream=effect.upstream) for a in aircraft.amendments[known:])
    return replace(aircraft, amendments=(*aircraft.amendments[:known], *new))


def grown_by(
    effect: Effect, values: Values, aircraft: Aircraft, suite: SensorSuite, at_s: float
) -> tuple[Aircraft, SensorSuite]:
    """Return both with an effect as it has grown so many s after take-off."""
    assert effect.over_time is not None
    known = len(aircraft.amendments)
    grown, suite = effect.over_time(aircraft, suite, values, at_s)
    return in_place(grown, known, effect), suite


def raised(aircraft: Aircraft, by_m: float) -> Aircraft:
    """Return an aircraft that may fly higher or lower by so much, one that may stand on the ground no lower.

    The height stands for the density of the air there, which is another one at the height that is flown.
    """
    if by_m == 0.0 or "h" not in aircraft.limits:
        return aircraft
    low, high = aircraft.limits["h"]
    low = low + by_m if aircraft.adapter is None else low + max(by_m, 0.0)
    return replace(aircraft, limits={**aircraft.limits, "h": (low, high + max(by_m, 0.0))})


def moved_by(effect: Effect, values: Values, believed: FlightCondition) -> FlightCondition:
    """Return the condition that an effect makes of the believed one."""
    assert effect.elsewhere is not None
    return effect.elsewhere(believed, values)
