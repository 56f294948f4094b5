"""What makes one wing other than the other: weight to one side, twist, lift, drag."""

from __future__ import annotations

from functools import partial

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import prop, value
from testbench.aircraft.seams import moved_centre
from testbench.effects.aero import ALPHA, force
from testbench.effects.base import Effect, Parameter, Values
from testbench.effects.cg_shift import left_behind
from testbench.effects.payload import with_load
from testbench.sensors import SensorSuite

_TERMS = {
    "wing_twist": ("Cl", "Cl0", ()),
    "asymmetric_lift": ("Cl", "Cl_alpha", (prop(ALPHA),)),
    "asymmetric_drag": ("Cn", "Cn0", ()),
}


def amend(name: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add the moment that the uneven wings make."""
    coefficient, size, terms = _TERMS[name]
    edit = force(coefficient, name.replace("_", "-"), value(values[size]), *terms)
    text = f"{coefficient} {values[size]:+.3g}{' alpha' if terms else ''} more, since the wings differ"
    return aircraft.amended(Amendment(name, text, (edit,))), suite


def amend_centre(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Move the centre of gravity to the right (positive) or left; accelerometers stay where they are in the airframe.

    Raises:
        ModelError: the model does not say where the centre of gravity is.
    """
    shift = values["right_spans"] * aircraft.geometry.b_m
    text = f"centre of gravity {1000.0 * shift:+.3g} mm to the right"
    amended = aircraft.amended(Amendment("lateral_cg", text, moved_centre(aircraft, (0.0, shift, 0.0))))
    return amended, left_behind(suite, right_m=shift)


def amend_load(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add a point mass to the right (positive) or left; centre of gravity and inertia follow, accelerometers stay."""
    load, right = values["ratio"] * aircraft.mass.mass_kg, values["right_spans"] * aircraft.geometry.b_m
    return with_load(aircraft, suite, "side_payload", load, 0.0, right)


EFFECTS = (
    Effect(
        name="lateral_cg",
        title="centre of gravity off the middle",
        place="mass",
        physics=(
            "Fuel, batteries or a load lie more on one side, so that lift acts beside the weight. The aircraft rolls "
            "in proportion to its lift: in pull-ups, in turns, and with every change of speed at one aileron."
        ),
        parameters=(Parameter("right_spans", "spans", -0.2, 0.2, (0.01, -0.01), none=0.0),),
        amend=amend_centre,
        mistaken_for="a twisted wing or an aileron offset at one speed without pull-ups; asymmetric lift",
        separated_by="weighing on both main wheels; pull-ups, which a twist does not feel",
        flown=True,
        lateral=True,
    ),
    Effect(
        name="side_payload",
        title="load under one wing",
        place="mass",
        physics=(
            "A load far out on one side adds mass and roll inertia and moves the centre of gravity towards it. The "
            "aircraft rolls in proportion to its lift, and answers the ailerons slower."
        ),
        parameters=(
            Parameter("ratio", "1", 0.0, 0.5, (0.06,), none=0.0),
            Parameter("right_spans", "spans", -0.5, 0.5, (0.25, -0.25)),
        ),
        amend=amend_load,
        mistaken_for="a centre of gravity off the middle, with errors of Cl_p and Cl_da, if it is light",
        separated_by="weighing on both main wheels; aileron inputs beside pull-ups",
        flown=True,
        lateral=True,
        contains=("lateral_cg", "mass_error"),
    ),
    Effect(
        name="asymmetric_lift",
        title="one wing with more lift slope",
        place="wing",
        physics=(
            "One wing lifts more per angle of attack than the other: another section, dirt, damage. The aircraft rolls "
            "in proportion to alpha."
        ),
        parameters=(Parameter("Cl_alpha", "1", -2.0, 2.0, (0.05, -0.05), none=0.0),),
        amend=partial(amend, "asymmetric_lift"),
        mistaken_for="a centre of gravity off the middle; a twisted wing at one alpha",
        separated_by="weighing on both main wheels; pull-ups at two speeds",
        flown=True,
        lateral=True,
    ),
    Effect(
        name="wing_twist",
        title="twisted wing",
        place="wing",
        physics=(
            "One wing is rigged or warped to a larger angle than the other. A rolling moment that grows with dynamic "
            "pressure alone is trimmed out by the aileron."
        ),
        parameters=(Parameter("Cl0", "1", -0.1, 0.1, (0.003, -0.003), none=0.0),),
        amend=partial(amend, "wing_twist"),
        mistaken_for="an offset of the aileron, exactly; it does not show where commands are deviations from trim",
        separated_by="a straight edge and a level on the ground; the absolute aileron at trim",
        lateral=True,
    ),
    Effect(
        name="asymmetric_drag",
        title="one wing with more drag",
        place="wing",
        physics=(
            "Something hangs on one wing, or a part of it is open. A yawing moment that grows with dynamic pressure "
            "alone is trimmed out by the rudder."
        ),
        parameters=(Parameter("Cn0", "1", -0.05, 0.05, (0.001, -0.001), none=0.0),),
        amend=partial(amend, "asymmetric_drag"),
        mistaken_for="an offset of the rudder, exactly; it does not show where commands are deviations from trim",
        separated_by="looking at the wings; the absolute rudder at trim",
        lateral=True,
    ),
)
