"""What the file of a ground vibration test may say: frequencies, damping, masses, shapes, plan form."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from testbench.aircraft.outline import Surface
from testbench.core.schema import NonNegative, Positive, Strict

Fraction = Annotated[float, Field(gt=0.0, lt=1.0)]
Numbers = Annotated[tuple[float, ...], Field(strict=False)]
Evidence = Literal["measured", "computed", "assumed"]


class ModeEntry(Strict):
    """One mode.

    Attributes:
        name: for people.
        f_hz, zeta: natural frequency and damping ratio without air.
        symmetry: whether the left wing does the same as the right one, or the opposite.
        mass_kg_m2: generalised mass, that of the shape as it is given.
        csv: file with columns y_m, bend_m, twist_rad and, if known, curvature_1_m, one row per station.
        bend_m, twist_rad, curvature_1_m: the same at ``stations_m`` of the file: displacement of the elastic axis of
            the right wing (up), twist (nose up), second derivative of the displacement.
        tail_up_m, tail_pitch_rad: of the horizontal tail (up, nose up), for symmetric modes.
        tail_side_m, tail_roll_rad, tail_yaw_rad: of the tail (right, right side down, nose right), for asymmetric ones.
        unit: what one unit of the coordinate is that flies: "largest" makes the largest of tip deflection (in chords),
            tip twist, tail deflection (in chords) and tail rotation (in rad) one; "given" leaves the shape as it is.
    """

    name: Annotated[str, Field(min_length=1)]
    f_hz: Positive
    zeta: Fraction
    symmetry: Literal["symmetric", "asymmetric"]
    mass_kg_m2: Positive | None = None
    csv: str | None = None
    bend_m: Numbers | None = None
    twist_rad: Numbers | None = None
    curvature_1_m: Numbers | None = None
    tail_up_m: float = 0.0
    tail_pitch_rad: float = 0.0
    tail_side_m: float = 0.0
    tail_roll_rad: float = 0.0
    tail_yaw_rad: float = 0.0
    unit: Literal["largest", "given"] = "largest"


class Aileron(Strict):
    """Where the ailerons lie on each half of the wing, and d alpha / d da there, if it is known."""

    inner_m: NonNegative
    outer_m: Positive
    effectiveness: float | None = None


class StripSettings(Strict):
    """What is known of the strips; all else is taken from the aircraft's own derivatives, or estimated.

    Attributes:
        elastic_axis: behind the leading edge, in chords.
        lift_slope_1_rad, tail_lift_slope_1_rad, fin_lift_slope_1_rad: of wing, tail and fin.
        downwash: d epsilon / d alpha at the tail.
        elevator_effectiveness, rudder_effectiveness: angle of flow per deflection.
        fin_height_m: centre of the fin above the centre of gravity.
        aileron: place and effectiveness.
        dihedral_deg: of the wing.
        CL: lift coefficient at the design condition.
        zero_lift_deg: angle of attack of the wing at zero alpha of the aircraft, from zero lift.
        section_thickness: of the wing, in chords; gives the height of strain gauges.
        own_derivatives: false: take nothing from the aircraft's own derivatives.
    """

    elastic_axis: Fraction | None = None
    lift_slope_1_rad: Positive | None = None
    tail_lift_slope_1_rad: Positive | None = None
    fin_lift_slope_1_rad: Positive | None = None
    downwash: Annotated[float, Field(ge=0.0, lt=1.0)] | None = None
    elevator_effectiveness: float | None = None
    rudder_effectiveness: float | None = None
    fin_height_m: float | None = None
    aileron: Aileron | None = None
    dihedral_deg: float | None = None
    CL: float | None = None
    zero_lift_deg: float | None = None
    section_thickness: Fraction | None = None
    own_derivatives: bool = True


class MassEntry(Strict):
    """Where the mass sits, from which generalised masses follow.

    Attributes:
        evidence: what these numbers are.
        wing_kg: both sides, if its distribution is not known: the mass per length then goes with the chord squared.
        stations_m, wing_kg_per_m: the distribution along the right wing, linear between stations.
        centre_of_mass: of a section, behind the leading edge, in chords.
        gyration: radius of gyration of a section about its centre of mass, in chords.
        tail_kg: tail, moving with the end of the boom.
        tail_roll_inertia_kg_m2: about the boom.
        tail_mass_height_m: of its centre of mass above the boom.
    """

    evidence: Evidence
    wing_kg: Positive | None = None
    stations_m: Numbers | None = None
    wing_kg_per_m: Numbers | None = None
    centre_of_mass: Fraction
    gyration: Fraction
    tail_kg: NonNegative = 0.0
    tail_roll_inertia_kg_m2: NonNegative = 0.0
    tail_mass_height_m: float = 0.0


class GroundTestFile(Strict):
    """The file.

    Attributes:
        title: of the flexible aircraft.
        source: where the numbers come from, in a sentence.
        evidence: what frequencies, damping and shapes are.
        normalisation: "mass" if the generalised mass of every shape is 1 kg m2, "given" if ``mass_kg_m2`` says it.
        stations_m: y along the right wing of the shapes that stand in this file.
        shapes: one CSV file with columns y_m, bend_m_1, twist_rad_1, bend_m_2, ... for all modes by number.
        mode: the modes, in order of frequency.
        wing, tail, fin: plan forms; those of the aircraft's drawing if not given.
        strips: what is known of the aerodynamics of the strips.
        mass: where the mass sits.
    """

    title: str | None = None
    source: Annotated[str, Field(min_length=1)]
    evidence: Evidence
    normalisation: Literal["given", "mass"]
    stations_m: Numbers | None = None
    shapes: str | None = None
    mode: Annotated[tuple[ModeEntry, ...], Field(strict=False, min_length=1)]
    wing: Surface | None = None
    tail: Surface | None = None
    fin: Surface | None = None
    strips: StripSettings = StripSettings()
    mass: MassEntry | None = None
