"""A load that nobody mentioned, fuel or payload, away from the centre of gravity."""

from __future__ import annotations

from dataclasses import replace

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.seams import added_load
from testbench.effects.base import Effect, Parameter, Values
from testbench.effects.cg_shift import left_behind
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add a point mass; the centre of gravity and the inertia follow, accelerometers stay in the airframe."""
    load, aft = values["ratio"] * aircraft.mass.mass_kg, values["aft_chords"] * aircraft.geometry.cbar_m
    return with_load(aircraft, suite, "payload", load, aft)


def with_load(
    aircraft: Aircraft, suite: SensorSuite, name: str, load: float, aft: float, right: float = 0.0
) -> tuple[Aircraft, SensorSuite]:
    """Add a load in kg so many metres aft and right of the centre of gravity, as the amendment ``name``.

    It may be negative.
    """
    total = aircraft.mass.mass_kg + load
    mass = replace(aircraft.mass, mass_kg=total)
    aside = f" and {1000 * right:+.3g} mm right" if right else ""
    text = f"load of {load:.3g} kg {1000 * aft:+.3g} mm aft{aside} of the origin"
    amended = aircraft.amended(Amendment(name, text, added_load(aircraft, load, aft, right)))
    return replace(amended, mass=mass), left_behind(suite, load / total * aft, load / total * right)


EFFECT = Effect(
    name="payload",
    title="payload or fuel",
    place="mass",
    physics=(
        "A load away from the centre of gravity adds mass, shifts the centre of gravity and adds inertia at once. "
        "Forces accelerate the aircraft less, and its static stability changes with the shift."
    ),
    parameters=(
        Parameter("ratio", "1", 0.0, 1.0, (0.1,), none=0.0),
        Parameter("aft_chords", "chords", -2.0, 2.0, (0.5, -0.5)),
    ),
    amend=amend,
    mistaken_for="a mass error if it sits near the centre of gravity; a shift of the centre of gravity if it is light",
    separated_by="weighing on two scales",
    contains=("mass_error", "cg_shift"),
)
