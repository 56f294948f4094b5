"""Terms that the six coefficients may lack: of alpha, speed, sideslip, deflections, of wings that differ, of a stall.

Lift behind a separation point is that of K. Kirchhoff's flow past a plate as used by M. Goman, A. Khrabrov, J. Aircraft
31(5), 1994.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

from testbench.aircraft import Aircraft, Amendment, Increment, Insert, Memory
from testbench.aircraft.amend import Change
from testbench.aircraft.seams import component, control_path, corner, moving, product, prop, value
from testbench.core.constants import FT_M
from testbench.effects.base import Effect, Parameter, Values, added

ALPHA = "aero/alpha-rad"
_SYMBOLS = {"alpha": ALPHA, "beta": "aero/beta-rad", "alphadot": "aero/alphadot-rad_sec", "cbar/2V": "aero/ci2vel"}
CURVED = 0.1  # form error of what is no straight line in a state

# --- XML of terms -----------------------------------------------------------------------------------------------------


def force(coefficient: str, label: str, *terms: str) -> Increment:
    """Return the edit that adds the product of ``terms`` (XML) to a coefficient (CL, CD, CY, Cl, Cm, Cn)."""
    return Increment(coefficient, f"gap/{label}", terms)


def over_design_speed(aircraft: Aircraft) -> str:
    """Return the XML of V / V0 - 1, V0 the design speed."""
    relative = product(value(FT_M / aircraft.design_V_m_s), prop("velocities/vt-fps"))
    return f"<difference> {relative} {value(1.0)} </difference>"


def followed(label: str, term: str, time_s: float, rate_hz: float) -> tuple[tuple[Insert, ...], Memory]:
    """Return the edits that make ``gap/LABEL`` follow ``term`` with a first-order lag, and the state that it is.

    It takes the value of the frame before, one frame later than the aerodynamics do. While time stands still it is
    ``term`` plus ``gap/LABEL-ic``, with which a flight may begin away from rest.
    """
    a = math.exp(-1.0 / (rate_hz * time_s)) if time_s > 0.0 else 0.0
    name, start = f"gap/{label}", f"gap/{label}-ic"
    follow = f"<sum> {product(value(a), prop(name))} {product(value(1.0 - a), term)} </sum>"
    body = moving(follow, f"<sum> {term} {prop(start)} </sum>")
    declarations = (Insert("flight_control", f'<property value="0">{p}</property>', 0) for p in (name, start))
    channel = Insert("flight_control", f'<channel name="{name}-channel"> {component(name, body)} </channel>')
    return (*declarations, channel), Memory(label, name, start, corner(time_s), settles=True)


def _factor(symbols: str, x: float, aircraft: Aircraft) -> str:
    """Return the XML of a factor: "x", the size; "alpha"; "|dr|"; or "beta beta", their product."""
    out = []
    for symbol in symbols.split():
        if symbol == "x":
            out.append(value(x))
        elif symbol in _SYMBOLS:
            out.append(prop(_SYMBOLS[symbol]))
        else:
            deflection = prop(control_path(aircraft, symbol.strip("|")).servo)
            out.append(f"<abs> {deflection} </abs>" if "|" in symbol else deflection)
    return product(*out) if len(out) > 1 else out[0]


# --- laws -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Term:
    """The law that adds x times a product of states and deflections to a coefficient.

    It is a term of the Taylor series that a linear model breaks off (B. Etkin, L. D. Reid, Dynamics of Flight, 1996,
    section 4.11, from memory).
    """

    name: str  # of the effect
    coefficient: str  # CL, CD, CY, Cl, Cm or Cn
    factors: tuple[str, ...]  # "x", "alpha", "beta", "|dr|", ...; several in one are multiplied first
    text: str  # what it does, with a place for x
    label: str = ""  # of the function in a model of the testbench's own form, if not gap/NAME
    form_error: float = Effect.form_error  # see :class:`Effect`

    def __call__(self, aircraft: Aircraft, values: Values) -> Amendment:
        """Return the amendment; ModelError if the aircraft lacks a control of it."""
        (x,) = values.values()
        terms = tuple(_factor(f, x, aircraft) for f in self.factors)
        edit = Increment(self.coefficient, self.label or f"gap/{self.name.replace('_', '-')}", terms)
        return Amendment(self.name, self.text.format(x), (edit,))


def speed_effectiveness(aircraft: Aircraft, values: Values) -> Amendment:
    """Multiply the elevator's moment by 1 + k s + curve s^2 with s = V / V0 - 1, V0 the design speed."""
    over = over_design_speed(aircraft)
    factor = f"<sum> {value(values['k'])} {product(value(values['curve']), over)} </sum>"
    moment = product(value(aircraft.coefficient("Cm_de")), prop(control_path(aircraft, "de").servo))
    text = (
        f"elevator effectiveness changes by {values['k']:+.3g} times the relative change of speed, "
        f"{values['curve']:+.3g} times its square"
    )
    return Amendment("speed_effectiveness", text, (force("Cm", "speed-effectiveness", factor, over, moment),))


def wake_lag(aircraft: Aircraft, values: Values) -> Amendment:
    """Add Cm_wake (alpha lagged - alpha): the downwash at the tail is that of an earlier alpha."""
    edits, wake = followed("wake", prop(ALPHA), values["time_s"], aircraft.rate_hz)
    late = f"<difference> {prop('gap/wake')} {prop(ALPHA)} </difference>"
    edit = force("Cm", "wake-lag", value(values["Cm_wake"]), late)
    text = f"downwash at the tail late by {values['time_s']:.3g} s"
    return Amendment("wake_lag", text, (*edits, edit), memories=(wake,), rate_hz=aircraft.rate_hz)


# --- laws: flow separation --------------------------------------------------------------------------------------------


def attached(alpha_rad: float, sharpness: float) -> str:
    """Return the XML of the separation point X = (1 - tanh(sharpness (alpha - alpha_s))) / 2, 1 where all is attached.

    Written as 1 / (1 + exp(2 sharpness (alpha - alpha_s))).
    """
    power = product(value(2.0 * sharpness), f"<difference> {prop(ALPHA)} {value(alpha_rad)} </difference>")
    bounded = f"<min> {power} {value(60.0)} </min>"
    return f"<quotient> {value(1.0)} <sum> {value(1.0)} <exp> {bounded} </exp> </sum> </quotient>"


def lost_lift(aircraft: Aircraft, X: str) -> str:
    """Return the XML of CL_alpha alpha ((1 + sqrt(X))^2 / 4 - 1), the lift that separation takes away."""
    root = f"<pow> {X} {value(0.5)} </pow>"
    kept = f"<product> {value(0.25)} <pow> <sum> {value(1.0)} {root} </sum> {value(2.0)} </pow> </product>"
    loss = f"<difference> {kept} {value(1.0)} </difference>"
    return product(value(aircraft.coefficient("CL_alpha")), prop(ALPHA), loss)


def won(size: float, X: str) -> str:
    """Return the XML of size (1 - X): the drag, or the moment, of separated flow."""
    return product(value(size), f"<difference> {value(1.0)} {X} </difference>")


def stall(aircraft: Aircraft, values: Values) -> Amendment:
    """Take away the lift that separation loses, see :func:`lost_lift`, and add the drag CD (1 - X)."""
    X = attached(values["alpha_rad"], values["sharpness"])
    text = f"flow separates about alpha = {values['alpha_rad']:.3g} rad, CD rises by {values['CD']:.3g} at most"
    edits = force("CL", "stall", lost_lift(aircraft, X)), force("CD", "stall-drag", won(values["CD"], X))
    return Amendment("stall", text, edits)


def hysteresis(aircraft: Aircraft, values: Values) -> Amendment:
    """Let the separation point follow its static value with a lag; lift and drag as in a static stall."""
    X, late = attached(values["alpha_rad"], values["sharpness"]), prop("gap/separation")
    edits, separation = followed("separation", X, values["time_s"], aircraft.rate_hz)
    lift = force("CL", "stall-hysteresis", lost_lift(aircraft, late))
    drag = force("CD", "stall-hysteresis-drag", won(values["CD"], late))
    text = (
        f"flow separates about alpha = {values['alpha_rad']:.3g} rad, late by {values['time_s']:.2g} s, CD rises by "
        f"{values['CD']:.3g} at most"
    )
    changes: tuple[Change, ...] = (*edits, lift, drag)
    return Amendment("stall_hysteresis", text, changes, memories=(separation,), rate_hz=aircraft.rate_hz)


def with_moment(name: str, coefficient: str, aircraft: Aircraft, values: Values) -> Amendment:
    """Take away the lift that separation loses, and add to Cm or Cl in proportion to what separated, C (1 - X)."""
    X, label = attached(values["alpha_rad"], values["sharpness"]), name.replace("_", "-")
    size = values[coefficient]
    edits = force("CL", f"{label}-lift", lost_lift(aircraft, X)), force(coefficient, label, won(size, X))
    text = f"flow separates about alpha = {values['alpha_rad']:.3g} rad, with a {coefficient} of {size:+.3g} at most"
    return Amendment(name, text, edits)


def _row(
    title: str, place: str, term: Term, size: Parameter, physics: str, mistaken_for: str, separated_by: str
) -> Effect:
    sideways = term.coefficient in ("CY", "Cl", "Cn") or any(n in f for f in term.factors for n in ("beta", "da", "dr"))
    return Effect(
        term.name, title, place, physics, (size,), partial(added, term), mistaken_for, separated_by,
        lateral=sideways, form_error=term.form_error,
    )  # fmt: skip


# --- the table --------------------------------------------------------------------------------------------------------
# fmt: off

_BREAK = (
    Parameter("alpha_rad", "rad", 0.03, 0.6, (0.1, 0.14, 0.22)),
    Parameter("sharpness", "1/rad", 5.0, 80.0, (20.0,)),
)
_STALL = (*_BREAK, Parameter("CD", "1", -0.2, 0.5, (0.0,)))
EFFECTS = (
    _row(
        "drag increment", "drag",
        Term("drag_increment", "CD", ("x",), "drag coefficient {:+.4g}", "aero/coefficient/CD_increment"),
        Parameter("CD", "1", -0.03, 0.3, (0.02, -0.01), none=0.0),
        "Something in the flow, such as an open door, a probe or a rough surface, adds drag at every angle of attack. "
        "Trim needs more throttle, and speed settles faster after a disturbance.",
        "an error of the drag polar, within its prior, or of thrust at trim",
        "glides or coast-downs at two speeds, where no thrust hides it"),
    _row(
        "pitching moment due to alpha-dot", "pitching moment",
        Term("alpha_dot", "Cm", ("alphadot", "cbar/2V", "x"),
             "Cm_alphadot {:+.4g} more", "gap/Cm_alphadot"),
        Parameter("Cm_alphadot", "1", -40.0, 20.0, (-4.0, 4.0), none=0.0),
        "The downwash of the wing takes time to reach the tail, so that the tail's moment lags behind alpha. To first "
        "order this is a moment in proportion to alpha-dot, which damps the short period like pitch rate.",
        "an error of Cm_q: in the short period q and alpha-dot are nearly the same",
        "manoeuvres in which pitch rate and alpha-dot part: throttle with elevator, or pull-ups held for long"),
    Effect(
        name="wake_lag", title="wake that reaches the tail late", place="pitching moment",
        physics="The downwash at the tail follows alpha with a lag, that of the wake's way to the tail or of its "
                "build-up. Slow motion has the damping of an alpha-dot term, fast motion does not.",
        parameters=(Parameter("time_s", "s", 0.005, 2.0, (0.3,)),
                    Parameter("Cm_wake", "1/rad", -4.0, 4.0, (0.3, -0.3), none=0.0)),
        amend=partial(added, wake_lag),
        mistaken_for="an alpha-dot term, where all motion is slow against the lag",
        separated_by="inputs beyond the lag's corner frequency",
        contains=("alpha_dot",)),
    _row(
        "curved lift line", "lift",
        Term("nonlinear_lift", "CL", ("x", "alpha", "alpha"), "lift with {:+.3g} alpha^2 more", form_error=CURVED),
        Parameter("CL_alpha2", "1", -40.0, 40.0, (-5.0, 5.0), none=0.0),
        "The lift line is not straight: camber, low Reynolds numbers or the fuselage bend it well below the stall. To "
        "first order lift gets a term in the square of alpha.",
        "another CL_alpha in a narrow band of alpha; the beginning of a stall",
        "a wide range of alpha on both sides of trim"),
    _row(
        "pitching moment curved over alpha", "pitching moment",
        Term("curved_moment", "Cm", ("x", "alpha", "alpha"),
             "pitching moment with {:+.3g} alpha^2 more", form_error=CURVED),
        Parameter("Cm_alpha2", "1", -10.0, 10.0, (-1.0, 1.0), none=0.0),
        "The tail leaves the wing's downwash, or fuselage and wing lose their linear moment, as alpha grows. To first "
        "order the moment gets a term in the square of alpha: stability changes with alpha.",
        "another Cm_alpha in a narrow band of alpha; a stall of the tail",
        "a wide range of alpha on both sides of trim"),
    Effect(
        name="speed_effectiveness", title="elevator effectiveness that depends on speed", place="pitching moment",
        physics="Compressibility, Reynolds number or a tail that twists under load changes the elevator's "
        "effectiveness with speed. Its moment then follows speed otherwise than the dynamic pressure does, along a "
        "line or a curve.",
        parameters=(Parameter("k", "1", -5.0, 5.0, (0.5, -0.5), none=0.0),
                    Parameter("curve", "1", -10.0, 10.0, (0.0,))),
        amend=partial(added, speed_effectiveness),
        mistaken_for="an error of Cm_de at one speed; slipstream, since thrust falls with speed",
        separated_by="the same elevator input at two speeds with the same throttle",
        form_error=CURVED),
    _row(
        "one wing with more lift slope", "wing",
        Term("asymmetric_lift", "Cl", ("x", "alpha"), "Cl {:+.3g} alpha more, since the wings differ"),
        Parameter("Cl_alpha", "1", -2.0, 2.0, (0.05, -0.05), none=0.0),
        "One wing lifts more per angle of attack than the other: another section, dirt, damage. The aircraft rolls in "
        "proportion to alpha.",
        "a centre of gravity off the middle; a twisted wing at one alpha",
        "weighing on both main wheels; pull-ups at two speeds"),
    _row(
        "twisted wing", "wing",
        Term("wing_twist", "Cl", ("x",), "Cl {:+.3g} more, since the wings differ"),
        Parameter("Cl0", "1", -0.1, 0.1, (0.003, -0.003), none=0.0),
        "One wing is rigged or warped to a larger angle than the other. A rolling moment that grows with dynamic "
        "pressure alone is trimmed out by the aileron.",
        "an offset of the aileron, exactly; it does not show where commands are deviations from trim",
        "a straight edge and a level on the ground; the absolute aileron at trim"),
    _row(
        "one wing with more drag", "wing",
        Term("asymmetric_drag", "Cn", ("x",), "Cn {:+.3g} more, since the wings differ"),
        Parameter("Cn0", "1", -0.05, 0.05, (0.001, -0.001), none=0.0),
        "Something hangs on one wing, or a part of it is open. A yawing moment that grows with dynamic pressure alone "
        "is trimmed out by the rudder.",
        "an offset of the rudder, exactly; it does not show where commands are deviations from trim",
        "looking at the wings; the absolute rudder at trim"),
    _row(
        "weathercock stability that changes with sideslip", "fin",
        Term("cubic_weathercock", "Cn", ("x", "beta beta beta"),
             "{:+.3g} beta^3 in the yawing moment more", form_error=CURVED),
        Parameter("Cn_beta3", "1", -30.0, 30.0, (1.0, -1.0), none=0.0),
        "The fin stalls, or comes out of the fuselage's wake, as sideslip grows. To first order of what is odd in "
        "sideslip, the yawing moment gets a term in its cube.",
        "another Cn_beta where all sideslips are of one size",
        "rudder inputs of two sizes, the larger one beyond 10 degrees of sideslip"),
    _row(
        "dihedral effect that changes with sideslip", "wing",
        Term("cubic_dihedral", "Cl", ("x", "beta beta beta"),
             "{:+.3g} beta^3 in the rolling moment more", form_error=CURVED),
        Parameter("Cl_beta3", "1", -30.0, 30.0, (1.0, -1.0), none=0.0),
        "The windward wing stalls, or the fuselage shades the leeward one, as sideslip grows. To first order of what "
        "is odd in sideslip, the rolling moment gets a term in its cube.",
        "another Cl_beta where all sideslips are of one size",
        "rudder inputs of two sizes, the larger one beyond 10 degrees of sideslip"),
    _row(
        "dihedral effect that changes with alpha", "wing",
        Term("dihedral_over_alpha", "Cl", ("x", "alpha beta"),
             "{:+.3g} alpha beta in the rolling moment more"),
        Parameter("Cl_beta_alpha", "1", -10.0, 10.0, (0.5, -0.5), none=0.0),
        "A swept wing rolls away from sideslip in proportion to its lift, so that its dihedral effect grows with "
        "alpha. The rolling moment gets a term in alpha times sideslip.",
        "another Cl_beta at one speed",
        "the same rudder input at two speeds, or in a pull-up"),
    _row(
        "weathercock stability that changes with alpha", "fin",
        Term("weathercock_over_alpha", "Cn", ("x", "alpha beta"),
             "{:+.3g} alpha beta in the yawing moment more"),
        Parameter("Cn_beta_alpha", "1", -10.0, 10.0, (0.5, -0.5), none=0.0),
        "The wake of wing and fuselage reaches the fin as alpha grows. The yawing moment gets a term in alpha times "
        "sideslip.",
        "another Cn_beta at one speed",
        "the same rudder input at two speeds, or in a pull-up"),
    _row(
        "adverse yaw that changes with alpha", "aileron",
        Term("adverse_yaw_over_alpha", "Cn", ("x", "alpha da"),
             "{:+.3g} alpha times aileron in the yawing moment more"),
        Parameter("Cn_da_alpha", "1", -5.0, 5.0, (0.3, -0.3), none=0.0),
        "The aileron that goes down adds induced drag in proportion to the lift that the wing carries. The yawing "
        "moment gets a term in alpha times aileron.",
        "another Cn_da at one speed; an aileron-rudder interconnect",
        "the same aileron input at two speeds; a measured rudder deflection"),
    _row(
        "pitching moment of the rudder", "rudder",
        Term("rudder_pitch", "Cm", ("x", "|dr|"), "{:+.3g} |rudder| in the pitching moment more", form_error=CURVED),
        Parameter("Cm_dr", "1", -3.0, 3.0, (0.1, -0.1), none=0.0),
        "A rudder above or below the tail's plane changes the load on it, and one of a V tail pitches by itself, "
        "whichever way it turns. The pitching moment gets a term in the size of its deflection.",
        "a pitching moment due to sideslip; the square of the deflection where all inputs are of one size",
        "rudder inputs of two sizes and of both signs, with the pitch rate recorded"),
    _row(
        "pitching moment of the rudder's square", "rudder",
        Term("rudder_pitch_square", "Cm", ("x", "dr dr"),
             "{:+.3g} rudder^2 in the pitching moment more", form_error=CURVED),
        Parameter("Cm_dr2", "1", -60.0, 60.0, (2.0, -2.0), none=0.0),
        "The deflected rudder slows the air at the tail, and its drag acts above the centre of gravity. Both grow with "
        "the square of its deflection.",
        "a pitching moment in the size of the deflection where all inputs are of one size",
        "rudder inputs of two sizes and of both signs, with the pitch rate recorded"),
    _row(
        "pitching moment of the ailerons", "aileron",
        Term("aileron_pitch", "Cm", ("x", "|da|"), "{:+.3g} |aileron| in the pitching moment more", form_error=CURVED),
        Parameter("Cm_da", "1", -3.0, 3.0, (0.1, -0.1), none=0.0),
        "One aileron goes up further than the other goes down, or acts in another flow, so that their pitching moments "
        "do not cancel. The pitching moment gets a term in the size of the deflection.",
        "the square of the deflection where all inputs are of one size; spoilers that help in roll",
        "aileron inputs of two sizes and of both signs, with the pitch rate recorded"),
    _row(
        "pitching moment of the ailerons' square", "aileron",
        Term("aileron_pitch_square", "Cm", ("x", "da da"),
             "{:+.3g} aileron^2 in the pitching moment more", form_error=CURVED),
        Parameter("Cm_da2", "1", -60.0, 60.0, (2.0, -2.0), none=0.0),
        "Deflected ailerons cost lift and add drag on both sides, which pitches the aircraft. Both grow with the "
        "square of the deflection.",
        "a pitching moment in the size of the deflection where all inputs are of one size",
        "aileron inputs of two sizes and of both signs, with the pitch rate recorded"),
    Effect(
        name="stall", title="stall (separation point)", place="lift",
        physics="Near the stall the flow separates from the trailing edge forwards: lift falls below the straight line "
        "and drag rises. The point of separation is a function of alpha alone.",
        parameters=_STALL, amend=partial(added, stall),
        mistaken_for="a curved lift line, or a lower CL_alpha, as long as alpha stays in a narrow band",
        separated_by="a slow-down or pull-ups that take alpha beyond the break, and smaller ones that do not",
        form_error=CURVED),
    Effect(
        name="stall_hysteresis", title="stall with hysteresis", place="lift",
        physics="The point of separation takes time to move, so that lift is higher while alpha rises than while it "
        "falls. Lift over alpha runs through loops that grow with the rate of alpha.",
        parameters=(*_STALL, Parameter("time_s", "s", 0.0, 1.0, (0.1,))), amend=partial(added, hysteresis),
        mistaken_for="a static stall, where alpha moves slowly",
        separated_by="pull-ups beyond the break at two rates",
        contains=("stall",), form_error=CURVED),
    Effect(
        name="asymmetric_stall", title="stall of one wing first", place="wing",
        physics="One wing separates before the other: another rigging, dirt, damage. The aircraft drops that wing by a "
        "rolling moment in proportion to what has separated.",
        parameters=(*_BREAK, Parameter("Cl", "1", -0.5, 0.5, (0.02, -0.02))),
        amend=partial(added, partial(with_moment, "asymmetric_stall", "Cl")),
        mistaken_for="one wing with more lift slope, as long as alpha stays below the break",
        separated_by="pull-ups beyond the break with the ailerons held",
        lateral=True, form_error=CURVED),
)
ON_REQUEST = (
    Effect(
        name="stall_moment", title="stall with a pitching moment", place="lift",
        physics="As the flow separates, the wing's lift moves aft and the downwash at the tail falls. The nose drops, "
        "or rises if the tips stall first, by a moment in proportion to what has separated.",
        parameters=(*_BREAK, Parameter("Cm", "1", -1.0, 1.0, (-0.05, 0.05))),
        amend=partial(added, partial(with_moment, "stall_moment", "Cm")),
        mistaken_for="a stall with a pitching moment curved over alpha, as long as alpha stays below the break",
        separated_by="pull-ups beyond the break, with the elevator held",
        form_error=CURVED),
)
"""A stall that pitches is a stall beside a curved moment: one more thing that longitudinal records may be taken for."""
