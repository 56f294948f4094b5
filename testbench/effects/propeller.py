"""What a propeller does besides pulling: torque, P-factor, gyroscopic moments.

B. Etkin, L. D. Reid, Dynamics of Flight, 3rd ed. 1996, section 4.8 (rotors); P-factor: F. Perkins, R. Hage, Airplane
Performance Stability and Control, 1949, section 8 (both from memory). Signs: a propeller that turns clockwise as seen
from behind; sizes of the other sign are those of one that turns the other way.
"""

from __future__ import annotations

from functools import partial

from testbench.aircraft import Aircraft, Amendment, Increment
from testbench.aircraft.reroute import product, prop, value
from testbench.core.constants import FT_M, SLUG_KG
from testbench.effects.aero import ALPHA, force, need_engine, thrust_coefficient
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite


def _torque(aircraft: Aircraft, values: Values) -> tuple[tuple[Increment, ...], str]:
    lever = values["lever_m"]
    edit = force("Cl", "propeller-torque", value(-lever / aircraft.geometry.b_m), thrust_coefficient(aircraft))
    return (edit,), f"the propeller's torque is {1000.0 * lever:+.3g} mm times thrust"


def _p_factor(aircraft: Aircraft, values: Values) -> tuple[tuple[Increment, ...], str]:
    lever = values["lever_m_rad"]
    terms = (value(-lever / aircraft.geometry.b_m), thrust_coefficient(aircraft), prop(ALPHA))
    return (force("Cn", "p-factor", *terms),), f"thrust acts {1000.0 * lever:+.3g} mm to the right per rad of alpha"


def _gyroscopic(aircraft: Aircraft, values: Values) -> tuple[tuple[Increment, ...], str]:
    """Return the reaction -omega x h = (0, -r h, q h) of a rotor along the body's x axis."""
    need_engine(aircraft)
    h = values["h_over_Izz_rad_s"] * aircraft.mass.Izz
    slug_ft2_s = h / (SLUG_KG * FT_M**2)

    def moment(coefficient: str, sign: float, length: str, rate: str) -> Increment:
        qbar = f"<max> {prop('aero/qbar-psf')} {value(1e-6)} </max>"
        below = product(qbar, prop("metrics/Sw-sqft"), prop(length))
        term = f"<quotient> {product(value(sign * slug_ft2_s), prop(rate))} {below} </quotient>"
        return force(coefficient, f"gyroscopic-{coefficient}", term)

    edits = (
        moment("Cm", -1.0, "metrics/cbarw-ft", "velocities/r-rad_sec"),
        moment("Cn", 1.0, "metrics/bw-ft", "velocities/q-rad_sec"),
    )
    return edits, f"rotor with an angular momentum of {h:+.3g} kg m2/s"


_MADE = {"propeller_torque": _torque, "p_factor": _p_factor, "gyroscopic": _gyroscopic}


def amend(name: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add what the propeller does.

    Raises:
        ModelError: nothing drives the aircraft.
    """
    edits, text = _MADE[name](aircraft, values)
    return aircraft.amended(Amendment(name, text, edits)), suite


EFFECTS = (
    Effect(
        name="propeller_torque",
        title="torque of the propeller",
        place="thrust",
        physics=(
            "The air turns the propeller back, and the aircraft with it, by a moment in proportion to thrust. The "
            "aircraft rolls when the throttle moves, and needs another aileron at another speed."
        ),
        parameters=(Parameter("lever_m", "m", -1.0, 1.0, (0.02, -0.02), none=0.0),),
        amend=partial(amend, "propeller_torque"),
        mistaken_for="an offset of the aileron, or a centre of gravity off the middle, where the throttle rests",
        separated_by="throttle steps with the ailerons at rest",
        lateral=True,
    ),
    Effect(
        name="p_factor",
        title="P-factor of the propeller",
        place="thrust",
        physics=(
            "The blade that goes down meets more air than the one that goes up when the nose is raised, and pulls "
            "more. Thrust moves sideways with alpha and yaws the aircraft in proportion to both."
        ),
        parameters=(Parameter("lever_m_rad", "m/rad", -5.0, 5.0, (0.2, -0.2), none=0.0),),
        amend=partial(amend, "p_factor"),
        mistaken_for="gyroscopic moments, in pull-ups; an offset of the rudder, at one speed and throttle",
        separated_by="pull-ups at two throttle settings",
        flown=True,
        lateral=True,
    ),
    Effect(
        name="gyroscopic",
        title="gyroscopic moments of the propeller",
        place="thrust",
        physics=(
            "A propeller that is turned with the aircraft answers by a moment across: pitching yaws, and yawing "
            "pitches. The moments are the rotor's angular momentum times the rate, whatever the speed."
        ),
        parameters=(Parameter("h_over_Izz_rad_s", "rad/s", -10.0, 10.0, (0.2, -0.2), none=0.0),),
        amend=partial(amend, "gyroscopic"),
        mistaken_for="P-factor, in pull-ups; a gyro that leans, which turns no aircraft",
        separated_by="yaw by rudder with the pitch rate recorded, at two throttle settings",
        lateral=True,
    ),
)
