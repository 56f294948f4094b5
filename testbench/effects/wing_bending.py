"""A symmetric wing bending mode that the model, with its wings held rigid, lacks."""

from __future__ import annotations

from collections.abc import Mapping

from testbench.aircraft import Aircraft, Amendment, ElasticMode
from testbench.effects.base import Effect, Parameter
from testbench.sensors import SensorSuite

# Strip integrals of a parabolic bending shape phi = (2 y / b)^2 over a trapezoidal wing of taper 0.31 (the taper that
# makes S / b = 0.2115 m and cbar = 0.2311 m), per wing area: of c phi dy and of c phi^2 dy. Another plan form changes
# them by some 20 %, which mass_ratio takes up in part.
_TAPER_LOSS = 1.0 - 0.31
_SHAPE_1 = (1.0 / 3.0 - _TAPER_LOSS / 4.0) / (1.0 - _TAPER_LOSS / 2.0)
_SHAPE_2 = (1.0 / 5.0 - _TAPER_LOSS / 6.0) / (1.0 - _TAPER_LOSS / 2.0)
_STRUCTURAL_DAMPING = 0.02


def amend(aircraft: Aircraft, suite: SensorSuite, values: Mapping[str, float]) -> tuple[Aircraft, SensorSuite]:
    """Add one bending mode as a modal state with quasi-steady strip aerodynamics."""
    slope = aircraft.coefficient("CL_alpha")
    twisted, plunging = slope * values["twist_rad"], -2.0 * slope * _SHAPE_1
    number = len(aircraft.elastic) + 1 if aircraft.elastic else 1
    mode = ElasticMode(
        name="wing bending found by the gap",
        f_hz=values["f_hz"],
        zeta=_STRUCTURAL_DAMPING,
        mass_kg_m2=values["mass_ratio"] * aircraft.mass.mass_kg * aircraft.geometry.cbar_m**2,
        symmetry="symmetric",
        force={"zero": aircraft.coefficient("CL0") * _SHAPE_1, "alpha": slope * _SHAPE_1},
        force_eta={number: slope * values["twist_rad"] * _SHAPE_1},
        force_etadot={number: -2.0 * slope * _SHAPE_2},
        effect_eta={"CL": twisted, "Cm": twisted * values["lever"]},
        effect_etadot={"CL": plunging, "Cm": plunging * values["lever"]},
    )
    text = f"symmetric wing bending mode at {values['f_hz']:.3g} Hz, generalised mass {mode.mass_kg_m2:.3g} kg m2"
    return aircraft.amended(Amendment("wing_bending", text, modes=(mode,))), suite


EFFECT = Effect(
    name="wing_bending",
    title="symmetric wing bending",
    place="lift",
    part="structure",
    physics=(
        "The wing bends, and twists a little, under its lift and springs back as a lightly damped mode. "
        "Its plunging takes lift away while it moves, its twist adds lift in proportion to its deflection."
    ),
    parameters=(
        Parameter("f_hz", "Hz", 1.5, 25.0, (3.0, 6.0, 12.0)),
        # Flight data tell stiffness (mass times frequency squared) far better than mass or frequency alone. The prior:
        # a wing of a third of the aircraft's mass, of which the first bending of a uniform cantilever moves a quarter.
        Parameter("mass_ratio", "1", 0.01, 0.5, (0.083,), prior=(0.083, 0.3)),
        Parameter("twist_rad", "rad", -0.5, 0.5, (0.03,)),
        # Chords by which the wing's lift acts ahead of the centre of gravity: with a small static margin the moment of
        # the lift that bending adds matters as much as the lift.
        Parameter("lever", "1", -0.3, 0.3, (0.05,)),
    ),
    amend=amend,
    mistaken_for="unsteady lift or errors of CL_alpha and Cm_q, below the mode",
    separated_by="a sweep through the mode, with an accelerometer",
)
