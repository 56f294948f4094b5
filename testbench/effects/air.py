"""The air of a flight, and near the ground: gusts, wind, density, an airspeed other than read, ground effect."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Literal

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.seams import product, prop, value
from testbench.core.atmosphere import air_density, height_of_density
from testbench.core.constants import FT_M
from testbench.effects.aerodynamics import ALPHA, CURVED, force
from testbench.effects.base import Effect, MetGust, Parameter, Values, added, unchanged
from testbench.flight import FlightCondition
from testbench.flight.air import Gust
from testbench.sensors import SensorSuite

Axis = Literal["north", "east", "down"]
LARGEST_M_S = 15.0  # what linear predictions and a small aircraft's limits stand; CS-23 asks for 15.24 m/s (50 ft/s)
SHORTEST_S, LONGEST_S = 0.2, 6.0  # shorter ones pass the sensors' lags by, longer ones are a wind
_WORDS = {"north": "along the heading", "east": "from the left", "down": "vertical, downward positive"}
_DECAY = 4.0  # of ground effect with height over span: gone at one span, half there at a sixth (handbooks, estimate)

# --- laws -------------------------------------------------------------------------------------------------------------


def ground_effect(aircraft: Aircraft, values: Values) -> Amendment:
    """Add k exp(-4 h / b) of the lift due to alpha, h the height above ground."""
    rate = -_DECAY * FT_M / aircraft.geometry.b_m
    share = f"<exp> {product(value(rate), prop('position/h-agl-ft'))} </exp>"
    lift = product(value(aircraft.coefficient("CL_alpha")), prop(ALPHA))
    text = f"lift slope {100 * values['k']:+.3g} % at the ground, next to nothing at one span"
    return Amendment("ground_effect", text, (force("CL", "ground-effect", value(values["k"]), share, lift),))


def steady_wind(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add the wind to ground speed and climb rate; flight through steadily moving air is otherwise the same."""
    wind = {"Vg": values["along_m_s"], "hdot": values["up_m_s"]}
    sensors = tuple(replace(s, bias=s.bias + wind.get(s.channel, 0.0)) for s in suite.sensors)
    return aircraft, replace(suite, sensors=sensors)


def in_other_air(condition: FlightCondition, values: Values) -> FlightCondition:
    """Return the condition at the height where the standard atmosphere has so many times the believed density."""
    return replace(condition, h_m=height_of_density(values["over_believed"] * air_density(condition.h_m)))


def at_other_speed(condition: FlightCondition, values: Values) -> FlightCondition:
    """Return the condition at so many times the believed airspeed."""
    return replace(condition, V_m_s=values["over_read"] * condition.V_m_s)


def misread(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Scale the airspeed sensor so that it reads the believed airspeed where another one is flown."""
    sensors = (replace(s, scale=s.scale / values["over_read"]) if s.channel == "V" else s for s in suite.sensors)
    return aircraft, replace(suite, sensors=tuple(sensors))


def _met(record: str, manoeuvre: str, axis: Axis, values: Values) -> MetGust:
    gust = Gust(axis, values["amplitude_m_s"], values["start_s"], values["duration_s"])
    return MetGust(record, manoeuvre, gust)


def placed(
    effect: Effect,
    record: str,
    manoeuvre: str,
    axis: Axis,
    start: tuple[float, float, float],
    lasts_s: float,
    looks: int,
) -> Effect:
    """Return ``effect``, a gust, in one record along one axis, its parameters about where it was found.

    ``start`` is amplitude, start and duration that a fit starts from, brought within the bounds; the record
    ``lasts_s``, and so many places were looked at.
    """
    amplitude, begins, duration = effect.parameters
    bounded = (amplitude, replace(begins, high=lasts_s), duration)
    inside = [
        min(max(x, 0.98 * p.low + 0.02 * p.high), 0.02 * p.low + 0.98 * p.high)
        for x, p in zip(start, bounded, strict=True)
    ]
    return replace(
        effect,
        title=f"gust in manoeuvre '{manoeuvre}', {_WORDS[axis]}",
        parameters=tuple(replace(p, starts=(x,)) for p, x in zip(bounded, inside, strict=True)),
        met=partial(_met, record, manoeuvre, axis),
        looks=looks,
    )


# --- the table --------------------------------------------------------------------------------------------------------
# fmt: off

EFFECTS = (
    Effect(
        name="gust", title="gust met in one manoeuvre", place="air",
        physics="In one manoeuvre the air moves as a 1-cosine for a second or so, along one axis. Every channel "
                "responds as to a change of airspeed or flow angle without a command; the other manoeuvres do not "
                "show it.",
        parameters=(Parameter("amplitude_m_s", "m/s", -LARGEST_M_S, LARGEST_M_S, (1.0,), none=0.0),
                    Parameter("start_s", "s", 0.0, 3600.0, (1.0,)),
                    Parameter("duration_s", "s", SHORTEST_S, LONGEST_S, (1.0,))),
        amend=unchanged,  # a gust is of one record's air (``met``)
        mistaken_for="a missing response to a command at the same time (a servo that sticks once, a stall in the one "
                     "manoeuvre that reaches it); a shear of the wind; turbulence",
        separated_by="the same manoeuvre once more: a gust does not occur twice, an effect of the aircraft does",
        met=partial(_met, "", "", "down"), looks=0, form_error=CURVED),
    Effect(
        name="steady_wind", title="steady wind", place="air",
        physics="The air moves over the ground. Airspeed, angles of flow and rates stay what they are in still air; "
        "ground speed and climb rate do not.",
        parameters=(Parameter("along_m_s", "m/s", -30.0, 30.0, (2.0,), none=0.0),
                    Parameter("up_m_s", "m/s", -5.0, 5.0, (0.2,), none=0.0)),
        amend=steady_wind,
        mistaken_for="biases of ground speed and climb rate on one heading; it does not show about means",
        separated_by="reciprocal headings, or a turn: the check of the data finds it there",
        form_error=0.01),
    Effect(
        name="ground_effect", title="ground effect", place="air",
        physics="Within a span of the ground the downwash is hindered, so that the wing gives more lift at the same "
        "alpha. The gain dies out with height over span.",
        parameters=(Parameter("k", "1", -0.5, 1.0, (0.2, -0.1), none=0.0),), amend=partial(added, ground_effect),
        mistaken_for="an error of CL_alpha if the height stays the same; it does not show well above the ground",
        separated_by="the same manoeuvre at two heights, one of them below half a span",
        form_error=CURVED),
    Effect(
        name="air_density", title="air thinner or denser than assumed", place="air",
        physics="The day is hotter or colder than the standard one, or the flight was higher or lower than assumed. "
                "All forces and moments of the air at the same true airspeed change by one factor, thrust by about as "
                "much.",
        parameters=(Parameter("over_believed", "1", 0.6, 1.4, (0.95, 1.05), none=1.0),), amend=unchanged,
        elsewhere=in_other_air,
        mistaken_for="mass and moments of inertia that are off by one factor together; an airspeed that is read wrong, "
        "where kinematics do not tell the airspeed",
        separated_by="the thermometer and the pressure of the day; weighing",
        ground_check="look up temperature and pressure of the day and the height flown above the field: 10 degC or 300 "
        "m are 3 % of the density",
        form_error=0.01),
    Effect(
        name="airspeed_flown", title="airspeed flown other than read", place="V sensor",
        physics="The ports of pitot and static pressure sit where the flow is disturbed, or an indicated airspeed was "
        "taken for a true one. The aircraft flies faster or slower than read in every record, by one factor, and "
        "forces and moments belong to the airspeed flown.",
        parameters=(Parameter("over_read", "1", 0.6, 1.6, (0.95, 1.05), none=1.0),), amend=misread,
        elsewhere=at_other_speed,
        mistaken_for="a scale error of the airspeed sensor alone, where the condition is from another instrument; air "
                     "thinner or denser than assumed",
        separated_by="runs along one line both ways, timed by GPS, in calm air",
        ground_check="look whether the log holds indicated or true airspeed, and where the static ports sit; press a "
        "known height of water on the pitot tube",
        form_error=0.01),
)
