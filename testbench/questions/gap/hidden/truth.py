"""What a hidden truth changes: commands on their way to the servos, the JSBSim model, and what sensors read.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from testbench.aircraft.amend import Change
from testbench.core.record import FloatArray
from testbench.flight.air import Gust
from testbench.sensors import Sensor

Size = Mapping[str, float]
Law = Callable[[FloatArray, float], FloatArray]
"""(command (frames,) as deviation from trim, frame time) -> what is sent on."""


@dataclass(frozen=True)
class Truth:
    """What a hidden truth changes, in the order in which it acts.

    Attributes:
        elevator, throttle: what becomes of the command on its way to the servo.
        surfaces: the same for other controls, by name ("da", "dr").
        whole_servo: the elevator's command is turned into the deflection itself; of the believed servo only its slew
            limit is left.
        changes: edits of the JSBSim model.
        fed_back: True if one of them moves a surface beside its command.
        flexible: fly with the elastic modes.
        extra_kg: mass that the edits add.
        read: what becomes of each sensor.
        spoil: (channel, readings, time) -> readings, after the sensors.
        gust: a gust, met in one of the manoeuvres.
        factors: coefficient -> what the true one is times the believed one.
        later: time after take-off, s -> what else has changed by then.
    """

    elevator: Law | None = None
    throttle: Law | None = None
    surfaces: Mapping[str, Law] = field(default_factory=dict)
    whole_servo: bool = False
    changes: tuple[Change, ...] = ()
    fed_back: bool = False
    flexible: bool = False
    extra_kg: float = 0.0
    read: Callable[[Sensor], Sensor] | None = None
    spoil: Callable[[str, FloatArray, FloatArray], FloatArray] | None = None
    gust: Gust | None = None
    factors: Mapping[str, float] = field(default_factory=dict)
    later: Callable[[float], Truth] | None = None

    def with_(self, other: Truth) -> Truth:
        """Return both truths at once; command and sensor parts must not clash."""
        return Truth(
            elevator=self.elevator or other.elevator,
            throttle=self.throttle or other.throttle,
            surfaces={**self.surfaces, **other.surfaces},
            whole_servo=self.whole_servo or other.whole_servo,
            changes=(*self.changes, *other.changes),
            fed_back=self.fed_back or other.fed_back,
            flexible=self.flexible or other.flexible,
            extra_kg=self.extra_kg + other.extra_kg,
            read=self.read or other.read,
            spoil=self.spoil or other.spoil,
            gust=self.gust or other.gust,
            factors={**self.factors, **other.factors},
            later=self.later or other.later,
        )
