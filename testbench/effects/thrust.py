"""Thrust other than believed, and what a propeller does besides pulling.

Torque and gyroscopic moments: B. Etkin, L. D. Reid, Dynamics of Flight, 3rd ed. 1996, section 4.8 (rotors); P-factor:
F. Perkins, R. Hage, Airplane Performance Stability and Control, 1949, section 8 (both from memory). Signs: a propeller
that turns clockwise as seen from behind; sizes of the other sign are those of one that turns the other way.
"""

from __future__ import annotations

from functools import partial

from testbench.aircraft import Aircraft, Amendment, Increment, Insert, SetText
from testbench.aircraft.amend import Change, Thrust, ThrustLine
from testbench.aircraft.seams import component, control_path, moving, product, prop, reroute, value
from testbench.core.constants import FT_M, SLUG_KG
from testbench.effects import linkage
from testbench.effects.aerodynamics import ALPHA, force, over_design_speed
from testbench.effects.base import GEARING, POWER, Effect, Parameter, Values, added, left, on_path, ten_minutes_after
from testbench.effects.servo import PLAY_CHECK, SHORTEST_S
from testbench.sensors import SensorSuite

_THRUST = "fcs/throttle-pos-norm"  # share of the static thrust, after all that stands between command and engine
_QBAR_S = product(f"<max> {prop('aero/qbar-psf')} {value(1e-6)} </max>", prop("metrics/Sw-sqft"))
_PROPELLER = 0.1  # form error of what a propeller and its slipstream do


def thrust_coefficient(aircraft: Aircraft) -> str:
    """Return the XML of T / (qbar S)."""
    control_path(aircraft, "thr")
    return f"<quotient> {prop(str(aircraft.source_of('thrust')[0]))} {_QBAR_S} </quotient>"


# --- laws: the engine -------------------------------------------------------------------------------------------------


def thrust_line(aircraft: Aircraft, values: Values) -> Amendment:
    """Move the thruster up (positive) or down from the centre of gravity; of a foreign model, from where it is."""
    control_path(aircraft, "thr")  # an aircraft without one has no engine
    z, above = values["z_m"], "the centre of gravity"
    edit: Change = SetText("propulsion/engine/thruster/location/z", z)
    if aircraft.adapter is not None:
        edit, above = ThrustLine(z), "the a-priori line"
    return Amendment("thrust_line", f"thrust line {1000 * z:+.1f} mm above {above}", (edit,))


def thrust_lag(aircraft: Aircraft, values: Values) -> Amendment:
    """Put a first-order lag, or two in series, behind the throttle command; exact for a command held from frame to
    frame."""
    throttle, lag = control_path(aircraft, "thr").command, values["lag_s"]
    if "second_lag_s" not in values:
        edit = reroute(throttle, "thrust-lag", moving(_lagged("gap/thrust-lag", throttle, lag), prop(throttle)))
        return Amendment("thrust_lag", f"thrust lags by {lag:.4g} s", (edit,))
    first, second = "gap/thrust-stages-first", "gap/thrust-stages"
    before = (("first", moving(_lagged(first, throttle, lag), prop(throttle))),)
    after = moving(_lagged(second, first, values["second_lag_s"]), prop(throttle))
    text = f"thrust lags by {lag:.4g} s and {values['second_lag_s']:.4g} s in series"
    return Amendment("second_order_thrust_lag", text, (reroute(throttle, "thrust-stages", after, before),))


def _lagged(name: str, command: str, lag_s: float) -> str:
    """Return the XML of a first-order lag behind ``command``, whose last value is that of the property ``name``."""
    decay = f"<exp> {product(value(-1.0 / max(lag_s, SHORTEST_S)), prop('simulation/dt'))} </exp>"
    past = f"<difference> {prop(name)} {prop(command)} </difference>"
    return f"<sum> {prop(command)} {product(decay, past)} </sum>"


def scaled(name: str, text: str, aircraft: Aircraft, values: Values) -> Amendment:
    """Multiply what the motor is told, to which thrust is proportional at every speed; of a foreign model, whose thrust
    may be any function of the throttle, multiply all forces and moments of the engines."""
    throttle, scale = control_path(aircraft, "thr").command, values["scale"]
    edit: Change = reroute(throttle, name.replace("_", "-"), product(value(scale), prop(throttle)))
    if aircraft.adapter is not None:
        edit = Thrust(value(scale - 1.0))
    return Amendment(name, f"throttle gives {scale:.4g} times the thrust{text}", (edit,))


def faded(aircraft: Aircraft, suite: SensorSuite, values: Values, at_s: float) -> tuple[Aircraft, SensorSuite]:
    """Multiply the thrust by what is left of it."""
    text = f" {at_s:.4g} s after take-off"
    return aircraft.amended(scaled("thrust_fade", text, aircraft, {"scale": left(values, at_s)})), suite


def thrust_lapse(aircraft: Aircraft, values: Values) -> Amendment:
    """Multiply thrust by scale - k (V / V0 - 1), V0 the design speed."""
    control_path(aircraft, "thr")  # an aircraft without one has no engine
    scale, k = values["scale"], values["k"]
    factor = f"<difference> {value(scale)} {product(value(k), over_design_speed(aircraft))} </difference>"
    lapse = component(_THRUST, product(factor, prop(_THRUST)))
    edit: Change = Insert("flight_control", f'<channel name="gap/thrust-lapse"> {lapse} </channel>')
    if aircraft.adapter is not None:
        edit = Thrust(f"<difference> {factor} {value(1.0)} </difference>")
    text = (
        f"thrust {scale:.4g} times the a-priori thrust at design speed, less {k:.3g} times the relative rise of speed"
    )
    return Amendment("thrust_lapse", text, (edit,))


# --- laws: the propeller ----------------------------------------------------------------------------------------------


def slipstream(name: str, aircraft: Aircraft, values: Values) -> Amendment:
    """Add k T / (qbar S) times the moment of the elevator plus a share of that of pitch rate."""
    k, share = values["k"], values.get("damping_share", 1.0)
    of_elevator = product(value(aircraft.coefficient("Cm_de")), prop(control_path(aircraft, "de").servo))
    cm_q = value(share * aircraft.coefficient("Cm_q"))
    of_rate = product(cm_q, prop("velocities/q-aero-rad_sec"), prop("aero/ci2vel"))
    blown = value(k), thrust_coefficient(aircraft), f"<sum> {of_elevator} {of_rate} </sum>"
    text = f"slipstream on the tail, k = {k:.3g}"
    if name == "elevator_slipstream":
        text = f"slipstream on the elevator, k = {k:.3g}, and {share:.2g} of it on the tail's damping"
    return Amendment(name, text, (force("Cm", name.replace("_", "-"), *blown),))


def torque(aircraft: Aircraft, values: Values) -> Amendment:
    """Add the rolling moment -lever T."""
    lever = values["lever_m"]
    edit = force("Cl", "propeller-torque", value(-lever / aircraft.geometry.b_m), thrust_coefficient(aircraft))
    text = f"the propeller's torque is {1000.0 * lever:+.3g} mm times thrust"
    return Amendment("propeller_torque", text, (edit,))


def p_factor(aircraft: Aircraft, values: Values) -> Amendment:
    """Add the yawing moment -lever alpha T."""
    lever = values["lever_m_rad"]
    terms = (value(-lever / aircraft.geometry.b_m), thrust_coefficient(aircraft), prop(ALPHA))
    text = f"thrust acts {1000.0 * lever:+.3g} mm to the right per rad of alpha"
    return Amendment("p_factor", text, (force("Cn", "p-factor", *terms),))


def gyroscopic(aircraft: Aircraft, values: Values) -> Amendment:
    """Add the reaction -omega x h = (0, -r h, q h) of a rotor along the body's x axis."""
    control_path(aircraft, "thr")  # an aircraft without one has no engine
    h = values["h_over_Izz_rad_s"] * aircraft.mass.Izz
    slug_ft2_s = h / (SLUG_KG * FT_M**2)

    def moment(coefficient: str, sign: float, length: str, rate: str) -> Increment:
        term = (
            f"<quotient> {product(value(sign * slug_ft2_s), prop(rate))} {product(_QBAR_S, prop(length))} </quotient>"
        )
        return force(coefficient, f"gyroscopic-{coefficient}", term)

    edits = (
        moment("Cm", -1.0, "metrics/cbarw-ft", "velocities/r-rad_sec"),
        moment("Cn", 1.0, "metrics/bw-ft", "velocities/q-rad_sec"),
    )
    return Amendment("gyroscopic", f"rotor with an angular momentum of {h:+.3g} kg m2/s", edits)


# --- the table --------------------------------------------------------------------------------------------------------
# fmt: off

_PER_MIN = Parameter("per_min", "1/min", -0.02, 0.2, (0.01,), none=0.0)
_LAG = Parameter("lag_s", "s", 0.0, 5.0, (0.3, 1.0), none=0.0)
_BLOWN = Parameter("k", "1", -5.0, 30.0, (3.0, -1.0), none=0.0)
EFFECTS = (
    Effect(
        name="thrust_line", title="thrust line off the centre of gravity", place="thrust",
        physics="Thrust acts above or below the centre of gravity and pitches the aircraft with every change of "
        "throttle. Since thrust falls with airspeed, it also adds a pitching moment due to speed.",
        parameters=(Parameter("z_m", "m", -0.2, 0.2, (0.02, -0.02), none=0.0, of_span=0.05),),
        amend=partial(added, thrust_line),
        mistaken_for="a CG shift or a speed derivative of Cm, without throttle motion",
        separated_by="throttle steps, which single it out"),
    Effect(
        name="thrust_lag", title="lag of the thrust", place="thrust",
        physics="Motor, propeller and speed controller take time to follow the throttle. Thrust answers a step of the "
        "throttle as a first-order lag, and elevator inputs show nothing of it.",
        parameters=(_LAG,), amend=partial(added, thrust_lag),
        mistaken_for="a delay of the throttle where it moves slowly; a lag of the airspeed sensor with throttle alone",
        separated_by="throttle steps, with an accelerometer along x or speed changes by elevator beside them",
        form_error=0.02),
    Effect(
        name="second_order_thrust_lag", title="lag of the thrust in two stages", place="thrust",
        physics="The speed controller follows the throttle late and the propeller, or the spool, follows the "
        "controller. Thrust answers a step of the throttle with no slope at first, as two first-order lags in series "
        "do.",
        parameters=(_LAG, Parameter("second_lag_s", "s", 0.0, 5.0, (0.1, 0.3), none=0.0)),
        amend=partial(added, thrust_lag),
        mistaken_for="a lag of one stage and a delay of the throttle",
        separated_by="throttle steps, with an accelerometer along x",
        contains=("thrust_lag",)),
    Effect(
        name="thrust_scale", title="scale of the thrust", place="thrust",
        physics="Motor, battery and propeller give more or less thrust than on the bench. The same throttle step "
                "changes speed and climb by a multiple of the predicted one, and trim needs another throttle for the "
                "same thrust.",
        parameters=(Parameter("scale", "1", 0.3, 3.0, (0.8, 1.3), none=1.0),),
        amend=partial(added, partial(scaled, "thrust_scale", "")),
        mistaken_for="a mass error in throttle steps alone; a scale error of the airspeed sensor",
        separated_by=(
            "elevator manoeuvres in addition to the throttle steps, which depend on the mass and not on the thrust"
        ),
        form_error=0.01),
    Effect(
        name="throttle_scale",  # a scale of the thrust only where thrust is proportional to the throttle
        title="scale of the throttle's linkage", place="thrust",
        physics="The linkage moves the engine's lever by a multiple of the command. Every throttle step has more or "
                "less effect than predicted; the linkage is rigged at the throttle of trim, so the working point of "
                "the engine is unchanged.",
        parameters=(Parameter("scale", "1", 0.2, 3.0, (0.8, 1.3), none=1.0),),
        amend=partial(on_path, linkage.scaled, "thr"),
        mistaken_for="a scale of the thrust, which also changes the throttle of trim, and so the working point of the "
                     "engine",
        separated_by="the throttle at trim, read at the engine; throttle steps from two airspeeds",
        upstream=GEARING, ground_check=PLAY_CHECK,
        own_form="thrust_scale", form_error=0.01),
    Effect(
        name="thrust_lapse", title="thrust that changes with speed", place="thrust",
        physics="A propeller of another pitch or diameter unloads at another speed, so its thrust falls with airspeed "
                "by more or less than predicted. Speed settles faster or slower after a disturbance, the more so the "
                "higher the throttle.",
        parameters=(Parameter("scale", "1", 0.3, 3.0, (1.0,)), Parameter("k", "1", -2.0, 3.0, (0.5, -0.3), none=0.0)),
        amend=partial(added, thrust_lapse),
        mistaken_for="drag that changes with speed, at one throttle; a mass error in throttle steps alone",
        separated_by="the same elevator input at two throttle settings, and glides",
        contains=("thrust_scale",), form_error=_PROPELLER),
    Effect(
        name="slipstream", title="slipstream on the tail", place="thrust",
        physics="The propeller's slipstream raises the dynamic pressure at the tail in proportion to thrust. Elevator "
        "power and pitch damping grow with throttle and fall with airspeed.",
        parameters=(_BLOWN,), amend=partial(added, partial(slipstream, "slipstream")),
        mistaken_for="a thrust line off the centre of gravity, where throttle moves and the elevator rests",
        separated_by=("the same elevator input at two throttle settings, and throttle steps with the elevator at trim"),
        form_error=_PROPELLER),
    Effect(
        name="elevator_slipstream", title="slipstream on the elevator", place="thrust",
        physics="The contracted slipstream covers the elevator and only part of the tail. Elevator power grows with "
        "throttle, pitch damping by less.",
        parameters=(_BLOWN, Parameter("damping_share", "1", 0.0, 1.0, (0.3,))),
        amend=partial(added, partial(slipstream, "elevator_slipstream")),
        mistaken_for="a slipstream on the whole tail, where the aircraft pitches slowly",
        separated_by="doublets as fast as the short period at two throttle settings",
        contains=("slipstream",), form_error=_PROPELLER),
    Effect(
        name="thrust_fade", title="thrust that falls during the flight", place="thrust",
        physics="The battery empties, and its voltage falls. The same throttle gives less thrust in later records than "
        "in earlier ones, by a share that grows with the time after take-off.",
        parameters=(_PER_MIN,), amend=partial(ten_minutes_after, faded), over_time=faded,
        mistaken_for="a scale of the thrust, where all records were flown at about one time",
        separated_by="the same throttle step at the beginning and at the end of the flight; the battery's voltage"),
    Effect(
        name="uneven_thrust_fade", title="thrust that falls during the flight, faster early or late", place="thrust",
        physics="The voltage of a battery falls at first, holds, and drops when it is nearly empty. Thrust falls from "
        "record to record, not in proportion to the time after take-off but as a power of it.",
        parameters=(_PER_MIN, POWER), amend=partial(ten_minutes_after, faded), over_time=faded,
        mistaken_for="thrust that falls steadily, where records were flown at two times only",
        separated_by="the same throttle step at three times of the flight and more; the battery's voltage",
        contains=("thrust_fade",)),
    Effect(
        name="propeller_torque", title="torque of the propeller", place="thrust",
        physics="The air turns the propeller back, and the aircraft with it, by a moment in proportion to thrust. The "
        "aircraft rolls when the throttle moves, and needs another aileron at another speed.",
        parameters=(Parameter("lever_m", "m", -1.0, 1.0, (0.02, -0.02), none=0.0),), amend=partial(added, torque),
        mistaken_for="an offset of the aileron, or a centre of gravity off the middle, where the throttle rests",
        separated_by="throttle steps with the ailerons at rest",
        lateral=True, form_error=_PROPELLER),
    Effect(
        name="p_factor", title="P-factor of the propeller", place="thrust",
        physics="The blade that goes down meets more air than the one that goes up when the nose is raised, and pulls "
        "more. Thrust moves sideways with alpha and yaws the aircraft in proportion to both.",
        parameters=(Parameter("lever_m_rad", "m/rad", -5.0, 5.0, (0.2, -0.2), none=0.0),),
        amend=partial(added, p_factor),
        mistaken_for="gyroscopic moments, in pull-ups; an offset of the rudder, at one speed and throttle",
        separated_by="pull-ups at two throttle settings",
        lateral=True, form_error=_PROPELLER),
    Effect(
        name="gyroscopic", title="gyroscopic moments of the propeller", place="thrust",
        physics="A propeller that is turned with the aircraft causes a moment about the perpendicular axis: pitching "
                "yaws, and yawing pitches. The moments are the rotor's angular momentum times the rate, whatever the "
                "speed.",
        parameters=(Parameter("h_over_Izz_rad_s", "rad/s", -10.0, 10.0, (0.2, -0.2), none=0.0),),
        amend=partial(added, gyroscopic),
        mistaken_for="P-factor, in pull-ups; a misaligned gyro, which turns no aircraft",
        separated_by="yaw by rudder with the pitch rate recorded, at two throttle settings",
        lateral=True, form_error=_PROPELLER),
)
