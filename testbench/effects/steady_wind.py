"""A steady wind, as the sensors that see the ground read it."""

from __future__ import annotations

from dataclasses import replace

from testbench.aircraft import Aircraft
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add the wind to ground speed and climb rate; flight through steadily moving air is otherwise the same."""
    added = {"Vg": values["along_m_s"], "hdot": values["up_m_s"]}
    sensors = tuple(replace(s, bias=s.bias + added.get(s.channel, 0.0)) for s in suite.sensors)
    return aircraft, replace(suite, sensors=sensors)


EFFECT = Effect(
    name="steady_wind",
    title="steady wind",
    place="air",
    physics=(
        "The air moves over the ground. Airspeed, angles of flow and rates stay what they are in still air; ground "
        "speed and climb rate do not."
    ),
    parameters=(
        Parameter("along_m_s", "m/s", -30.0, 30.0, (2.0,), none=0.0),
        Parameter("up_m_s", "m/s", -5.0, 5.0, (0.2,), none=0.0),
    ),
    amend=amend,
    mistaken_for="biases of ground speed and climb rate on one heading; it does not show about means",
    separated_by="reciprocal headings, or a turn: the check of the data finds it there",
    flown=True,
)
