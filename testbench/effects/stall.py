"""Flow separation of the wing: static, with hysteresis, with a pitching moment, on one wing first.

Lift is that of K. Kirchhoff's flow past a plate as used by M. Goman, A. Khrabrov, J. Aircraft 31(5), 1994.
"""

from __future__ import annotations

from functools import partial

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.amend import Change
from testbench.aircraft.seams import product, prop, value
from testbench.effects.aerodynamics import ALPHA, CURVED, followed, force
from testbench.effects.base import Effect, Parameter, Values, added


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


# --- laws -------------------------------------------------------------------------------------------------------------


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


# --- the table --------------------------------------------------------------------------------------------------------
# fmt: off

_BREAK = (
    Parameter("alpha_rad", "rad", 0.03, 0.6, (0.1, 0.14, 0.22)),
    Parameter("sharpness", "1/rad", 5.0, 80.0, (20.0,)),
)
_STALL = (*_BREAK, Parameter("CD", "1", -0.2, 0.5, (0.0,)))
EFFECTS = (
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
