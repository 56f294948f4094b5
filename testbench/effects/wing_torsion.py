"""A symmetric wing torsion mode that the model lacks."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment, ElasticMode
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite

_DAMPING = 0.02
# The lift acts a tenth of the chord ahead of the elastic axis (estimate: quarter chord against 35 %).
_ARM = 0.1
# Radius of gyration of a section about its axis, in chords (estimate), of a wing of a third of the aircraft's mass.
_INERTIA = 0.25**2 / 3.0


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add one torsion mode; the modal coordinate is the twist of the tip, rad, nose up, with a linear shape."""
    slope, share = aircraft.coefficient("CL_alpha"), values["share"]
    number = len(aircraft.elastic) + 1 if aircraft.elastic else 1
    mode = ElasticMode(
        name="wing torsion found by the gap",
        f_hz=values["f_hz"],
        zeta=_DAMPING,
        mass_kg_m2=_INERTIA / 3.0 * aircraft.mass.mass_kg * aircraft.geometry.cbar_m**2,
        symmetry="symmetric",
        force={"zero": aircraft.coefficient("CL0") * _ARM / 2.0, "alpha": slope * _ARM / 2.0},
        force_eta={number: slope * _ARM / 3.0},
        force_etadot={number: -slope / 24.0},
        effect_eta={"CL": slope * share, "Cm": slope * share * values["lever"]},
    )
    text = f"symmetric wing torsion mode at {values['f_hz']:.3g} Hz"
    return aircraft.amended(Amendment("wing_torsion", text, modes=(mode,))), suite


EFFECT = Effect(
    name="wing_torsion",
    title="symmetric wing torsion",
    place="lift",
    part="structure",
    physics=(
        "The lift twists the wing about its elastic axis and the twist adds to the angle of attack. "
        "The lift slope grows with dynamic pressure, and near the mode's frequency lift leads or lags alpha."
    ),
    parameters=(
        Parameter("f_hz", "Hz", 5.0, 40.0, (10.0, 20.0)),
        Parameter("share", "1", -1.0, 2.0, (0.5,), none=0.0),
        Parameter("lever", "1", -0.3, 0.3, (0.05,)),
    ),
    amend=amend,
    mistaken_for="a higher CL_alpha far below the mode; wing bending",
    separated_by="a sweep through the mode; accelerometers ahead of and behind the elastic axis",
)
