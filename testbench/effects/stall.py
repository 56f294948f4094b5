"""Flow separation of the wing: static stall."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import product, prop, value
from testbench.effects.aero import ALPHA, force
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Take away the lift that separation loses, see :func:`lost_lift`, and add the drag that it brings."""
    X = attached(values["alpha_rad"], values["sharpness"])
    lift, drag = force("CL", "stall", lost_lift(aircraft, X)), force("CD", "stall-drag", won_drag(values["CD"], X))
    text = f"flow separates about alpha = {values['alpha_rad']:.3g} rad, CD rises by {values['CD']:.3g} at most"
    return aircraft.amended(Amendment("stall", text, (lift, drag))), suite


def attached(alpha_rad: float, sharpness: float) -> str:
    """Return the XML of the separation point X = (1 - tanh(sharpness (alpha - alpha_s))) / 2, 1 where all is attached.

    K. Kirchhoff's flow past a plate as used by M. Goman, A. Khrabrov, J. Aircraft 31(5), 1994. Written as
    1 / (1 + exp(2 sharpness (alpha - alpha_s))).
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


def won_drag(CD: float, X: str) -> str:
    """Return the XML of CD (1 - X), the drag of separated flow."""
    return product(value(CD), f"<difference> {value(1.0)} {X} </difference>")


EFFECT = Effect(
    name="stall",
    title="stall (separation point)",
    place="lift",
    physics=(
        "Near the stall the flow separates from the trailing edge forwards: lift falls below the straight line and "
        "drag rises. The point of separation is a function of alpha alone."
    ),
    parameters=(
        Parameter("alpha_rad", "rad", 0.03, 0.6, (0.1, 0.14, 0.22)),
        Parameter("sharpness", "1/rad", 5.0, 80.0, (20.0,)),
        Parameter("CD", "1", -0.2, 0.5, (0.0,)),
    ),
    amend=amend,
    mistaken_for="a curved lift line, or a lower CL_alpha, as long as alpha stays in a narrow band",
    separated_by="a slow-down or pull-ups that take alpha beyond the break, and smaller ones that do not",
    flown=True,
)
