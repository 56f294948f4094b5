"""What all records were flown in: an airspeed, and air, other than the believed condition says."""

from __future__ import annotations

from dataclasses import replace

from testbench.aircraft import Aircraft
from testbench.core.atmosphere import air_density, height_of_density
from testbench.effects.base import Effect, Parameter, Values, unchanged
from testbench.flight import FlightCondition
from testbench.sensors import SensorSuite


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


EFFECTS = (
    Effect(
        name="air_density",
        title="air thinner or denser than believed",
        place="air",
        physics=(
            "The day is hotter or colder than the standard one, or the flight was higher or lower than believed. All "
            "forces and moments of the air at the same true airspeed change by one factor, thrust by about as much."
        ),
        parameters=(Parameter("over_believed", "1", 0.6, 1.4, (0.95, 1.05), none=1.0),),
        amend=unchanged,
        elsewhere=in_other_air,
        mistaken_for=(
            "mass and moments of inertia that are off by one factor together; an airspeed that is read wrong, where "
            "kinematics do not tell the airspeed"
        ),
        separated_by="the thermometer and the pressure of the day; weighing",
        ground_check=(
            "look up temperature and pressure of the day and the height flown above the field: 10 degC or 300 m are "
            "3 % of the density"
        ),
    ),
    Effect(
        name="airspeed_flown",
        title="airspeed flown other than read",
        place="V sensor",
        physics=(
            "The ports of pitot and static pressure sit where the flow is disturbed, or an indicated airspeed was "
            "taken for a true one. The aircraft flies faster or slower than read in every record, by one factor, and "
            "forces and moments belong to the airspeed flown."
        ),
        parameters=(Parameter("over_read", "1", 0.6, 1.6, (0.95, 1.05), none=1.0),),
        amend=misread,
        elsewhere=at_other_speed,
        mistaken_for=(
            "a scale error of the airspeed sensor alone, where the condition was told by another instrument; air "
            "thinner or denser than believed"
        ),
        separated_by="runs along one line both ways, timed by GPS, in calm air",
        ground_check=(
            "look whether the log holds indicated or true airspeed, and where the static ports sit; press a known "
            "height of water on the pitot tube"
        ),
    ),
)
