"""Mass, inertia and centre of gravity other than believed, at once or as fuel burns."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.seams import added_load, moved_centre, scaled_mass
from testbench.effects.base import POWER, Effect, Parameter, Values, left, ten_minutes_after
from testbench.sensors import Sensor, SensorSuite
from testbench.sensors.sensor import ACCELEROMETERS

_EXACT = 0.01  # form error: of a rigid body there is no other form


def left_behind(suite: SensorSuite, aft_m: float = 0.0, right_m: float = 0.0) -> SensorSuite:
    """Return the suite whose accelerometers stay in the airframe as the centre of gravity moves aft and right."""

    def beside(s: Sensor) -> Sensor:
        ahead, right, down = s.position_m
        return replace(s, position_m=(ahead + aft_m, right - right_m, down)) if s.channel in ACCELEROMETERS else s

    return replace(suite, sensors=tuple(beside(s) for s in suite.sensors))


def with_load(
    aircraft: Aircraft, suite: SensorSuite, name: str, load: float, aft: float, right: float = 0.0
) -> tuple[Aircraft, SensorSuite]:
    """Add a load in kg so many metres aft and right of the centre of gravity, as the amendment ``name``.

    It may be negative. Centre of gravity and inertia follow, accelerometers stay in the airframe.
    """
    total = aircraft.mass.mass_kg + load
    mass = replace(aircraft.mass, mass_kg=total)
    aside = f" and {1000 * right:+.3g} mm right" if right else ""
    text = f"load of {load:.3g} kg {1000 * aft:+.3g} mm aft{aside} of the origin"
    amended = aircraft.amended(Amendment(name, text, added_load(aircraft, load, aft, right)))
    return replace(amended, mass=mass), left_behind(suite, load / total * aft, load / total * right)


# --- laws -------------------------------------------------------------------------------------------------------------


def centre(name: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Move the centre of gravity aft or right; accelerometers stay where they are in the airframe."""
    aft = values.get("aft_chords", 0.0) * aircraft.geometry.cbar_m
    right = values.get("right_spans", 0.0) * aircraft.geometry.b_m
    way = f"{1000.0 * aft:+.3g} mm aft" if name == "cg_shift" else f"{1000.0 * right:+.3g} mm to the right"
    amendment = Amendment(name, f"centre of gravity {way}", moved_centre(aircraft, (aft, right, 0.0)))
    return aircraft.amended(amendment), left_behind(suite, aft, right)


def scaled(
    name: str, what: str, text: str, aircraft: Aircraft, suite: SensorSuite, values: Values
) -> tuple[Aircraft, SensorSuite]:
    """Multiply the mass, or one moment of inertia, and leave the others, as for a load at the centre of gravity."""
    factor = values["factor"]
    changes, mass = scaled_mass(aircraft, {what: factor})
    return replace(aircraft.amended(Amendment(name, text.format(factor), changes)), mass=mass), suite


def payload(name: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add a point mass aft, or to the right; see :func:`with_load`."""
    load = values["ratio"] * aircraft.mass.mass_kg
    aft = values.get("aft_chords", 0.0) * aircraft.geometry.cbar_m
    return with_load(aircraft, suite, name, load, aft, values.get("right_spans", 0.0) * aircraft.geometry.b_m)


def burnt(aircraft: Aircraft, suite: SensorSuite, values: Values, at_s: float) -> tuple[Aircraft, SensorSuite]:
    """Multiply the mass by what is left of it; the moments of inertia stay, as for a tank at the centre of gravity."""
    text = f"mass {{:.4g}} times the a-priori value {at_s:.4g} s after take-off"
    return scaled("fuel_burn", "mass_kg", text, aircraft, suite, {"factor": left(values, at_s)})


def drained(aircraft: Aircraft, suite: SensorSuite, values: Values, at_s: float) -> tuple[Aircraft, SensorSuite]:
    """Take what is burnt out of a tank: mass, centre of gravity and inertia together."""
    kg = (left(values, at_s) - 1.0) * aircraft.mass.mass_kg
    aft_m = values["aft_chords"] * aircraft.geometry.cbar_m
    return with_load(aircraft, suite, "tank_burn", kg, aft_m) if kg else (aircraft, suite)


# --- the table --------------------------------------------------------------------------------------------------------
# fmt: off

_BURNT_PER_MIN = Parameter("per_min", "1/min", -0.005, 0.05, (0.004,), none=0.0)
EFFECTS = (
    Effect(
        name="cg_shift", title="shift of the centre of gravity", place="pitching moment", part="mass",
        physics="The centre of gravity lies further aft or forward than in the model, so that lift acts with another "
                "arm. Static stability changes by the shift times the lift slope, and accelerometers have another "
                "distance from it.",
        parameters=(Parameter("aft_chords", "chords", -0.3, 0.3, (0.02, -0.02), none=0.0),),
        amend=partial(centre, "cg_shift"),
        mistaken_for="errors of Cm_alpha and Cm0 together; only what exceeds their priors can be named",
        separated_by="weighing, or a ballast moved by a known distance between two flights",
        form_error=_EXACT),
    Effect(
        name="mass_error", title="mass other than in the model", place="mass",
        physics="The aircraft carries more or less than in the model near its centre of gravity. Lift and thrust "
                "accelerate it less or more, and trim at the same speed needs another angle of attack.",
        parameters=(Parameter("factor", "1", 0.5, 2.0, (1.1, 0.9), none=1.0),),
        amend=partial(scaled, "mass_error", "mass_kg", "mass {:.4g} times the a-priori value"),
        mistaken_for="an error of CL_alpha, of thrust or of the accelerometer's scale",
        separated_by="weighing; or throttle steps beside elevator inputs, which thrust over mass and lift over mass "
        "share",
        form_error=_EXACT),
    Effect(
        name="inertia_error", title="moment of inertia other than in the model", place="pitching moment", part="mass",
        physics="Masses lie further out or further in than in the model. All moments turn the aircraft slower or "
                "faster by the same factor, and no force changes.",
        parameters=(Parameter("factor", "1", 0.4, 2.5, (1.15, 0.85), none=1.0),),
        amend=partial(scaled, "inertia_error", "Iyy", "Iyy {:.4g} times the a-priori value"),
        mistaken_for="errors of Cm_alpha, Cm_q and Cm_de by one common factor, exactly; only their priors speak "
        "against it",
        separated_by="swinging the aircraft on the ground",
        form_error=_EXACT),
    Effect(
        name="payload", title="payload or fuel", place="mass",
        physics="A load away from the centre of gravity adds mass, shifts the centre of gravity and adds inertia at "
        "once. Forces accelerate the aircraft less, and its static stability changes with the shift.",
        parameters=(Parameter("ratio", "1", 0.0, 1.0, (0.1,), none=0.0),
                    Parameter("aft_chords", "chords", -2.0, 2.0, (0.5, -0.5))),
        amend=partial(payload, "payload"),
        mistaken_for="a mass error if it sits near the centre of gravity; a shift of the centre of gravity if it is "
        "light",
        separated_by="weighing on two scales",
        contains=("mass_error", "cg_shift"), form_error=_EXACT),
    Effect(
        name="lateral_cg", title="centre of gravity off the middle", place="mass",
        physics="Fuel, batteries or a load lie more on one side, so that lift acts beside the weight. The aircraft "
        "rolls in proportion to its lift: in pull-ups, in turns, and with every change of speed at one aileron.",
        parameters=(Parameter("right_spans", "spans", -0.2, 0.2, (0.01, -0.01), none=0.0),),
        amend=partial(centre, "lateral_cg"),
        mistaken_for="a twisted wing or an aileron offset at one speed without pull-ups; asymmetric lift",
        separated_by="weighing on both main wheels; pull-ups, to which a twist does not respond",
        lateral=True, form_error=_EXACT),
    Effect(
        name="side_payload", title="load under one wing", place="mass",
        physics="A load far out on one side adds mass and roll inertia and moves the centre of gravity towards it. "
                "The aircraft rolls in proportion to its lift, and responds to the ailerons more slowly.",
        parameters=(Parameter("ratio", "1", 0.0, 0.5, (0.06,), none=0.0),
                    Parameter("right_spans", "spans", -0.5, 0.5, (0.25, -0.25))),
        amend=partial(payload, "side_payload"),
        mistaken_for="a centre of gravity off the middle, with errors of Cl_p and Cl_da, if it is light",
        separated_by="weighing on both main wheels; aileron inputs beside pull-ups",
        lateral=True, contains=("lateral_cg", "mass_error"), form_error=_EXACT),
    Effect(
        name="fuel_burn", title="mass that falls during the flight", place="mass",
        physics="The a-priori mass does not include the fuel that burns. Forces accelerate the aircraft more in later "
                "records than in earlier ones, by a share that grows with the time after take-off.",
        parameters=(_BURNT_PER_MIN,), amend=partial(ten_minutes_after, burnt), over_time=burnt,
        mistaken_for="a mass other than in the model, where all records were flown at about one time",
        separated_by="the same manoeuvre at the beginning and at the end of the flight; weighing after landing"),
    Effect(
        name="tank_burn", title="fuel that burns from a tank away from the centre of gravity", place="mass",
        physics="A tank ahead of or behind the centre of gravity empties. Later records show a lighter aircraft, whose "
        "centre of gravity has moved away from the tank: forces accelerate it more, and its static stability and the "
        "elevator at trim change by shares that grow with the time after take-off.",
        parameters=(_BURNT_PER_MIN, Parameter("aft_chords", "chords", -2.0, 2.0, (0.1, -0.1))),
        amend=partial(ten_minutes_after, drained), over_time=drained,
        mistaken_for="fuel that burns at the centre of gravity, where the tank is near it; mass and thrust that fall "
        "together",
        separated_by="weighing on two scales before and after the flight; the elevator at trim, early and late",
        contains=("fuel_burn",)),
    Effect(
        name="uneven_fuel_burn", title="mass that falls during the flight, faster early or late", place="mass",
        physics="Fuel burns faster in the climb than later. The aircraft is lighter from record to record, not in "
        "proportion to the time after take-off but by a share that grows as a power of it.",
        parameters=(_BURNT_PER_MIN, POWER), amend=partial(ten_minutes_after, burnt), over_time=burnt,
        mistaken_for="fuel that burns steadily, where records were flown at two times only",
        separated_by="the same manoeuvre at three times of the flight and more; the fuel flow",
        contains=("fuel_burn",)),
)
