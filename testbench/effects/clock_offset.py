"""Sensors and commands stamped by two clocks."""

from __future__ import annotations

from dataclasses import replace

from testbench.aircraft import Aircraft
from testbench.core.channels import CONTROLS
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Stamp all sensors but the command log by a clock that is ahead by ``offset_s``, so that they seem late."""
    offset = values["offset_s"]
    if offset == 0.0:
        return aircraft, suite
    sensors = tuple(
        s
        if s.channel.removesuffix("_cmd") in CONTROLS
        else replace(s, clock_offset_s=s.clock_offset_s + offset, recorder=s.recorder or "second recorder")
        for s in suite.sensors
    )
    return aircraft, replace(suite, sensors=sensors)


EFFECT = Effect(
    name="clock_offset",
    title="clock of the sensors apart from that of the commands",
    place="elevator",
    physics=(
        "Sensors and commands are logged by two recorders whose clocks differ by a constant. "
        "All sensors seem late or early by the same time against the commands, whatever moves the aircraft."
    ),
    parameters=(Parameter("offset_s", "s", -0.3, 0.3, (0.02, -0.02), none=0.0),),
    amend=amend,
    mistaken_for="a delay of the elevator command, exactly, where the elevator alone moves and the clock is ahead",
    separated_by="throttle steps, which a delay of the elevator's command leaves in time; a common event on both logs",
    flown=True,
)
