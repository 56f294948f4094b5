"""A moment of inertia other than believed."""

from __future__ import annotations

from dataclasses import replace

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.seams import scaled_mass
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Multiply the moment of inertia in pitch."""
    factor = values["factor"]
    changes, mass = scaled_mass(aircraft, {"Iyy": factor})
    amendment = Amendment("inertia_error", f"Iyy {factor:.4g} times the believed one", changes)
    return replace(aircraft.amended(amendment), mass=mass), suite


EFFECT = Effect(
    name="inertia_error",
    title="moment of inertia other than believed",
    place="pitching moment",
    part="mass",
    physics=(
        "Masses lie further out or further in than believed. "
        "All moments turn the aircraft slower or faster by the same factor, and no force changes."
    ),
    parameters=(Parameter("factor", "1", 0.4, 2.5, (1.15, 0.85), none=1.0),),
    amend=amend,
    mistaken_for="errors of Cm_alpha, Cm_q and Cm_de by one common factor, exactly; only their priors speak against it",
    separated_by="swinging the aircraft on the ground",
)
