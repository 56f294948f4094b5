"""A structural mode that the elevator excites and the pitching moment feels."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment, ElasticMode
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite

_DAMPING = 0.03
# Half a step from a start lies within the half-width of a resonance with that damping, which a descent sees.
_GRID_HZ = tuple(2.0 * 1.05**k for k in range(41))
_DENSITY_KG_M3 = 1.225  # sea level, ISO 2533


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add eta'' + 2 zeta w eta' + w^2 eta = w^2 de (at design speed) and the moment Cm = Cm_eta eta."""
    w = 2.0 * 3.141592653589793 * values["f_hz"]
    qbar = 0.5 * _DENSITY_KG_M3 * aircraft.design_V_m_s**2
    mode = ElasticMode(
        name="mode excited by the elevator, found by the gap",
        f_hz=values["f_hz"],
        zeta=_DAMPING,
        mass_kg_m2=qbar * aircraft.geometry.S_m2 * aircraft.geometry.cbar_m / (w * w),
        symmetry="symmetric",
        force={"de": 1.0},
        effect_eta={"Cm": values["Cm_eta"]},
    )
    text = f"mode at {values['f_hz']:.3g} Hz that the elevator excites"
    return aircraft.amended(Amendment("elevator_mode", text, modes=(mode,))), suite


EFFECT = Effect(
    name="elevator_mode",
    title="structural mode excited by the elevator",
    place="pitching moment",
    part="structure",
    physics=(
        "The elevator's load bends tail boom or fuselage, a lightly damped mode whose deflection turns the tail. "
        "The pitching moment due to the elevator rings at the mode's frequency."
    ),
    parameters=(
        Parameter("f_hz", "Hz", 1.5, 25.0, _GRID_HZ),
        Parameter("Cm_eta", "1", -2.0, 2.0, (0.1,), none=0.0),
    ),
    amend=amend,
    mistaken_for="a wing mode, which alpha excites too; an error of Cm_de far below the mode",
    separated_by="a sweep of the elevator through the mode beside a gust or a throttle step, which leave it at rest",
)
