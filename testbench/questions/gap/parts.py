"""Parts of an aircraft that an engineer can go to, and the cheapest check of each on the ground.

An effect names its part, or its ``place`` tells it. Effects of one part do much the same to a flight. Whoever is sent
to the right part with a relative of the true effect finds it there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from testbench.effects import Effect


@dataclass(frozen=True)
class Part:
    """One part."""

    name: str  #: as in results and in sentences
    ground_check: str  #: what to do on the ground, as an order


_SURFACE = (
    "command the {0} in steps and film stick and surface together: this shows delay, lag, limited rate, throw and "
    "dead band; then push the surface by hand to feel play"
)
_GYRO = "turn the aircraft about its {0} axis by 90 deg and integrate the gyro: this shows scale and offset"
_BY_HAND = "by hand to angles of a protractor"
_SENSOR = {
    **dict.fromkeys(
        ("alpha", "beta"), "turn the vane by hand to angles of a protractor: this shows scale, offset and stickiness"
    ),
    "V": "press a known height of water on the pitot tube: this shows scale, offset and leaks",
    **{c: _GYRO.format(axis) for c, axis in (("p", "roll"), ("q", "pitch"), ("r", "yaw"))},
    **dict.fromkeys(("theta", "phi"), "tilt the aircraft to angles of an inclinometer: this shows scale and offset"),
    "az": "turn the aircraft upside down: the accelerometer must go from -1 g to 1 g; measure where it sits",
    "ay": "lay the aircraft on either side: the accelerometer must go from -1 g to 1 g; measure where it sits",
    **dict.fromkeys(("de", "da", "dr"), f"turn the surface {_BY_HAND}: scale and offset show"),
    "ax": "stand the aircraft on nose and tail: the accelerometer must go from -1 g to 1 g; measure where it sits",
}
_CHECKS = {
    **{f"{s} path": _SURFACE.format(s) for s in ("elevator", "aileron", "rudder")},
    "control path": _SURFACE.format("surface"),
    "thrust": "hold the aircraft by a spring scale at half and full throttle: this shows thrust, its rise and its line",
    "mass": "weigh the aircraft as flown and balance it on two points: this shows mass and centre of gravity",
    "structure": "push wing tips and tail by hand and let go: loose parts move, and vibrations can be heard or filmed",
    "lift": "look along the wings: dirt, dents, warps, open hatches; measure their incidence with an inclinometer",
    "drag": "look for parts in the flow that are not in the model: antennas, wheels, gaps, open hatches",
    "pitching moment": "measure incidence of wing and tail with an inclinometer; balance the aircraft on two points",
    "wing": "measure incidence, twist and dihedral of both wings with an inclinometer; balance it on nose and tail",
    "fin": "look along fin and rudder from behind; measure whether the fin stands upright and in the middle",
    "autopilot": "turn the aircraft by hand with all systems on: a surface that follows has feedback; read settings",
    "air": "none on the ground: fly the manoeuvre again in calm air and compare",
}
_OF_PLACE = {"elevator": "elevator path", "aileron": "aileron path", "rudder": "rudder path", "throttle": "thrust"}


def part_names(effect: Effect) -> tuple[str, ...]:
    """Return the names of the parts that an effect, or each of several together, acts in; none twice."""
    return tuple(dict.fromkeys(e.part or _OF_PLACE.get(e.place, e.place) for e in effect.singles))


def parts_of(effects: Sequence[Effect]) -> tuple[Part, ...]:
    """Return the parts of several effects, with the checks on the ground; none twice.

    The check of a part is that of its first effect, if this brings one of its own.
    """
    out: dict[str, Part] = {}
    for effect in (single for e in effects for single in e.singles):
        name = part_names(effect)[0]
        channel = name.removesuffix(" sensor")
        known = _SENSOR.get(channel, "compare the sensor at rest with another one") if channel != name else ""
        check = effect.ground_check or known or _CHECKS.get(name, "inspect it, and measure the quantity of the effect")
        out.setdefault(name, Part(name, check))
    return tuple(out.values())
