"""What a rigid, whole airframe lacks: elastic modes of wings and tail, and parts that are gone.

Lost parts follow strip theory with an even load: a share s of a half span, from the tip inwards, carries s/2 of the
wing's lift and drag at (1 - s/2) b/2 from the middle, and (1 - (1 - s)^3) / 2 of its roll damping (B. Etkin, L. D.
Reid, Dynamics of Flight, 1996, chapter 3, from memory). What fin and tail do is read from the believed derivatives of
rudder and elevator: their lever from the ratio of moment to force, their lift slope from the damping that they give.
Shares of mass are those of a light aircraft (judged): a wing 12 %, fin and tail 1 % and 2 % of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from testbench.aircraft import Aircraft, Amendment, ElasticMode, Increment
from testbench.aircraft.seams import control_path, moved_centre, product, prop, scaled_mass, value
from testbench.core.errors import ModelError
from testbench.effects.aerodynamics import ALPHA, CURVED, force
from testbench.effects.base import Effect, Parameter, Values, added
from testbench.sensors import SensorSuite

# --- elastic modes ----------------------------------------------------------------------------------------------------

_BENDING_DAMPING = _TORSION_DAMPING = 0.02
_TAIL_DAMPING = 0.03
# Half a step from a start lies within the half-width of a resonance with that damping, which a descent sees.
_GRID_HZ = tuple(2.0 * 1.05**k for k in range(41))
_DENSITY_KG_M3 = 1.225  # sea level, ISO 2533
# Strip integrals of a parabolic bending shape phi = (2 y / b)^2 over a trapezoidal wing of taper 0.31 (the taper that
# makes S / b = 0.2115 m and cbar = 0.2311 m), per wing area: of c phi dy and of c phi^2 dy. Another plan form changes
# them by some 20 %, which mass_ratio takes up in part.
_TAPER_LOSS = 1.0 - 0.31
_SHAPE_1 = (1.0 / 3.0 - _TAPER_LOSS / 4.0) / (1.0 - _TAPER_LOSS / 2.0)
_SHAPE_2 = (1.0 / 5.0 - _TAPER_LOSS / 6.0) / (1.0 - _TAPER_LOSS / 2.0)
_ARM = 0.1  # the lift acts a tenth of the chord ahead of the elastic axis (estimate: quarter chord against 35 %)
# Radius of gyration of a section about its axis, in chords (estimate), of a wing of a third of the aircraft's mass.
_INERTIA = 0.25**2 / 3.0


def wing_bending(aircraft: Aircraft, values: Values) -> Amendment:
    """Add one bending mode as a modal state with quasi-steady strip aerodynamics."""
    slope = aircraft.coefficient("CL_alpha")
    twisted, plunging = slope * values["twist_rad"], -2.0 * slope * _SHAPE_1
    number = len(aircraft.elastic or ()) + 1
    mode = ElasticMode(
        name="wing bending found by the gap",
        f_hz=values["f_hz"],
        zeta=_BENDING_DAMPING,
        mass_kg_m2=values["mass_ratio"] * aircraft.mass.mass_kg * aircraft.geometry.cbar_m**2,
        symmetry="symmetric",
        force={"zero": aircraft.coefficient("CL0") * _SHAPE_1, "alpha": slope * _SHAPE_1},
        force_eta={number: slope * values["twist_rad"] * _SHAPE_1},
        force_etadot={number: -2.0 * slope * _SHAPE_2},
        effect_eta={"CL": twisted, "Cm": twisted * values["lever"]},
        effect_etadot={"CL": plunging, "Cm": plunging * values["lever"]},
    )
    text = f"symmetric wing bending mode at {values['f_hz']:.3g} Hz, generalised mass {mode.mass_kg_m2:.3g} kg m2"
    return Amendment("wing_bending", text, modes=(mode,))


def wing_torsion(aircraft: Aircraft, values: Values) -> Amendment:
    """Add one torsion mode; the modal coordinate is the twist of the tip, rad, nose up, with a linear shape."""
    slope, share = aircraft.coefficient("CL_alpha"), values["share"]
    number = len(aircraft.elastic or ()) + 1
    mode = ElasticMode(
        name="wing torsion found by the gap",
        f_hz=values["f_hz"],
        zeta=_TORSION_DAMPING,
        mass_kg_m2=_INERTIA / 3.0 * aircraft.mass.mass_kg * aircraft.geometry.cbar_m**2,
        symmetry="symmetric",
        force={"zero": aircraft.coefficient("CL0") * _ARM / 2.0, "alpha": slope * _ARM / 2.0},
        force_eta={number: slope * _ARM / 3.0},
        force_etadot={number: -slope / 24.0},
        effect_eta={"CL": slope * share, "Cm": slope * share * values["lever"]},
    )
    return Amendment("wing_torsion", f"symmetric wing torsion mode at {values['f_hz']:.3g} Hz", modes=(mode,))


def elevator_mode(aircraft: Aircraft, values: Values) -> Amendment:
    """Add eta'' + 2 zeta w eta' + w^2 eta = w^2 de (at design speed) and the moment Cm = Cm_eta eta."""
    w = 2.0 * math.pi * values["f_hz"]
    qbar = 0.5 * _DENSITY_KG_M3 * aircraft.design_V_m_s**2
    mode = ElasticMode(
        name="mode excited by the elevator, found by the gap",
        f_hz=values["f_hz"],
        zeta=_TAIL_DAMPING,
        mass_kg_m2=qbar * aircraft.geometry.S_m2 * aircraft.geometry.cbar_m / (w * w),
        symmetry="symmetric",
        force={"de": 1.0},
        effect_eta={"Cm": values["Cm_eta"]},
    )
    return Amendment("elevator_mode", f"mode at {values['f_hz']:.3g} Hz that the elevator excites", modes=(mode,))


# --- lost parts -------------------------------------------------------------------------------------------------------

_WING_MASS, _FIN_MASS, _TAIL_MASS = 0.12, 0.01, 0.02
_P, _Q, _R = (f"velocities/{rate}-aero-rad_sec" for rate in "pqr")
_OVER_SPAN, _OVER_CHORD = "aero/bi2vel", "aero/ci2vel"
_DOWNWASH = 0.4  # of the tail's angle of attack that the wing takes away (judged)
_Place = tuple[float, float, float]  # aft, right, up, m
_Lost = tuple[tuple[Increment, ...], float, _Place]  # what is taken away; its mass over that of the aircraft; its place


def _sum(*terms: tuple[float, tuple[str, ...]]) -> str:
    products = " ".join(product(value(x), *(prop(p) for p in names)) for x, names in terms)
    return f"<sum> {products} {value(0.0)} </sum>"


def _arm(aircraft: Aircraft, moment: str, side: str) -> float:
    """Return the lever of a surface over the length of its moment, from the derivatives of its control."""
    along = aircraft.coefficient(side)
    if abs(along) < 1e-9:
        raise ModelError(f"{aircraft.name} must have a {side}, from which a lost surface is told, it has none")
    return abs(aircraft.coefficient(moment) / along)


def lost_wing(aircraft: Aircraft, share: float) -> _Lost:
    """Return what the right wing's lost share takes away (of the left one, if negative)."""
    s, side = abs(share), (1.0 if share >= 0.0 else -1.0)
    area, lever = 0.5 * s, 0.5 * (1.0 - 0.5 * s)  # of the wing; over the span
    slope, zero = aircraft.coefficient("CL_alpha"), aircraft.coefficient("CL0")
    drag = aircraft.coefficient("CD")
    lift = _sum((slope, (ALPHA,)), (zero, ()))
    damping = -0.5 * (1.0 - (1.0 - s) ** 3) * aircraft.coefficient("Cl_p")
    edits = (
        force("CL", "lost-wing-lift", value(-area), lift),
        force("CD", "lost-wing-drag", value(-area * drag)),
        force("Cl", "lost-wing-roll", value(side * area * lever), lift),
        force("Cl", "lost-wing-damping", value(damping), prop(_P), prop(_OVER_SPAN)),
        force("Cn", "lost-wing-yaw", value(-side * area * lever * drag)),
    )
    return edits, 0.5 * _WING_MASS * s, (0.0, side * lever * aircraft.geometry.b_m, 0.0)


def lost_fin(aircraft: Aircraft, share: float) -> _Lost:
    """Return what the lost share of fin and rudder takes away: Cn_r = -2 (l/b) Cn_beta of the fin."""
    arm = _arm(aircraft, "Cn_dr", "CY_dr")
    damping = aircraft.coefficient("Cn_r")
    stiff = -damping / (2.0 * arm)
    rudder = control_path(aircraft, "dr").servo
    yaw = _sum((stiff, ("aero/beta-rad",)), (damping, (_R, _OVER_SPAN)), (aircraft.coefficient("Cn_dr"), (rudder,)))
    sideways = _sum(
        (-stiff / arm, ("aero/beta-rad",)),
        (-damping / arm, (_R, _OVER_SPAN)),
        (aircraft.coefficient("CY_dr"), (rudder,)),
    )
    edits = (force("Cn", "lost-fin-yaw", value(-share), yaw), force("CY", "lost-fin-side", value(-share), sideways))
    return edits, _FIN_MASS * share, (arm * aircraft.geometry.b_m, 0.0, 0.0)


def lost_tail(aircraft: Aircraft, share: float) -> _Lost:
    """Return what the lost share of tailplane and elevator takes away: Cm_q = -2 (l/c)^2 of its lift slope."""
    arm = _arm(aircraft, "Cm_de", "CL_de")
    damping = aircraft.coefficient("Cm_q")
    slope = -damping / (2.0 * arm * arm)  # of lift, referred to the wing's area
    elevator = control_path(aircraft, "de").servo
    alpha = slope * (1.0 - _DOWNWASH)
    pitch = _sum((-alpha * arm, (ALPHA,)), (damping, (_Q, _OVER_CHORD)), (aircraft.coefficient("Cm_de"), (elevator,)))
    lift = _sum((alpha, (ALPHA,)), (-damping / arm, (_Q, _OVER_CHORD)), (aircraft.coefficient("CL_de"), (elevator,)))
    edits = (force("Cm", "lost-tail-pitch", value(-share), pitch), force("CL", "lost-tail-lift", value(-share), lift))
    return edits, _TAIL_MASS * share, (arm * aircraft.geometry.cbar_m, 0.0, 0.0)


def lose(
    surface: Callable[[Aircraft, float], _Lost], aircraft: Aircraft, suite: SensorSuite, values: Values
) -> tuple[Aircraft, SensorSuite]:
    """Take the share of the surface away."""
    name, share = surface.__name__, values["share"]
    edits, ratio, place = surface(aircraft, share)
    M, (aft, right, _) = aircraft.mass, place
    about = ratio * M.mass_kg / (1.0 - ratio)  # lost mass about the old centre, and the rest about the new one
    factors = {
        "mass_kg": 1.0 - ratio,
        "Ixx": 1.0 - about * right**2 / M.Ixx,
        "Iyy": 1.0 - about * aft**2 / M.Iyy,
        "Izz": 1.0 - about * (aft**2 + right**2) / M.Izz,
    }
    if min(factors.values()) <= 0.0:
        raise ModelError(f"the part that is lost must weigh less than {aircraft.name} about each axis, it does not")
    scaled, mass = scaled_mass(aircraft, factors)
    shift = tuple(-ratio / (1.0 - ratio) * x for x in place)
    changes = (*scaled, *moved_centre(replace(aircraft, mass=mass), shift))
    text = f"{100.0 * abs(share):.3g} % of the {name.removeprefix('lost_')} lost"
    if name == "lost_wing":
        text = f"{100.0 * abs(share):.3g} % of the {'right' if share >= 0.0 else 'left'} wing lost, from its tip"
    return replace(aircraft.amended(Amendment(name, text, (*edits, *changes))), mass=mass), suite


# --- the table --------------------------------------------------------------------------------------------------------
# fmt: off

# Chords by which the lift of a mode acts ahead of the centre of gravity: with a small static margin its moment matters
# as much as the lift.
_LEVER = Parameter("lever", "1", -0.3, 0.3, (0.05,))
_CHECK = "look at {0}: something is broken off, dented or missing; then balance the aircraft on nose and tail"
EFFECTS = (
    Effect(
        name="wing_bending", title="symmetric wing bending", place="lift", part="structure",
        physics="The wing bends, and twists a little, under its lift and springs back as a lightly damped mode. Its "
        "plunging takes lift away while it moves, its twist adds lift in proportion to its deflection.",
        parameters=(
            Parameter("f_hz", "Hz", 1.5, 25.0, (3.0, 6.0, 12.0)),
            # Flight data tell stiffness (mass times frequency squared) far better than mass or frequency alone. The
            # prior: a wing of a third of the aircraft's mass, of which the first bending of a uniform cantilever moves
            # a quarter.
            Parameter("mass_ratio", "1", 0.01, 0.5, (0.083,), prior=(0.083, 0.3)),
            Parameter("twist_rad", "rad", -0.5, 0.5, (0.03,)),
            _LEVER,
        ),
        amend=partial(added, wing_bending),
        mistaken_for="unsteady lift or errors of CL_alpha and Cm_q, below the mode",
        separated_by="a sweep through the mode, with an accelerometer"),
    Effect(
        name="wing_torsion", title="symmetric wing torsion", place="lift", part="structure",
        physics="The lift twists the wing about its elastic axis and the twist adds to the angle of attack. The lift "
        "slope grows with dynamic pressure, and near the mode's frequency lift leads or lags alpha.",
        parameters=(Parameter("f_hz", "Hz", 5.0, 40.0, (10.0, 20.0)),
                    Parameter("share", "1", -1.0, 2.0, (0.5,), none=0.0),
                    _LEVER),
        amend=partial(added, wing_torsion),
        mistaken_for="a higher CL_alpha far below the mode; wing bending",
        separated_by="a sweep through the mode; accelerometers ahead of and behind the elastic axis"),
    Effect(
        name="elevator_mode", title="structural mode excited by the elevator", place="pitching moment",
        part="structure",
        physics="The elevator's load bends tail boom or fuselage, a lightly damped mode whose deflection turns the "
        "tail. The pitching moment due to the elevator rings at the mode's frequency.",
        parameters=(Parameter("f_hz", "Hz", 1.5, 25.0, _GRID_HZ),
                    Parameter("Cm_eta", "1", -2.0, 2.0, (0.1,), none=0.0)),
        amend=partial(added, elevator_mode),
        mistaken_for="a wing mode, which alpha excites too; an error of Cm_de far below the mode",
        separated_by="a sweep of the elevator through the mode beside a gust or a throttle step, which leave it at "
        "rest"),
    Effect(
        name="lost_wing", title="part of a wing lost", place="wing", ground_check=_CHECK.format("both wings"),
        physics="The outer part of one wing is gone: its lift, drag and mass, and most of its roll damping. The "
        "aircraft rolls towards it in proportion to lift, rolls more easily, and carries less.",
        parameters=(Parameter("share", "1", -0.9, 0.9, (0.1, -0.1), none=0.0),), amend=partial(lose, lost_wing),
        mistaken_for="a centre of gravity off the middle with errors of CL_alpha and Cl_p",
        separated_by="looking at it; pull-ups beside aileron inputs, which show lift and roll damping fall together",
        lateral=True, form_error=CURVED),
    Effect(
        name="lost_fin", title="part of the fin lost", place="fin", ground_check=_CHECK.format("fin and rudder"),
        physics="A part of fin and rudder is gone. Weathercock stability, yaw damping and rudder power fall by one "
        "share, and side force with them.",
        parameters=(Parameter("share", "1", -0.5, 0.9, (0.2, -0.1), none=0.0),), amend=partial(lose, lost_fin),
        mistaken_for="errors of Cn_beta, Cn_r and Cn_dr together; only what exceeds their priors can be named",
        separated_by="looking at it",
        lateral=True, form_error=CURVED),
)
ON_REQUEST = (
    Effect(
        name="lost_tail", title="part of the tail lost", place="pitching moment",
        ground_check=_CHECK.format("tailplane and elevator"),
        physics="A part of tailplane and elevator is gone. Pitch stiffness, pitch damping and elevator power fall by "
        "one share, and the centre of gravity moves forward.",
        parameters=(Parameter("share", "1", -0.5, 0.9, (0.1, -0.1), none=0.0),), amend=partial(lose, lost_tail),
        mistaken_for="errors of Cm_alpha, Cm_q and Cm_de together; only what exceeds their priors can be named",
        separated_by="looking at it",
        form_error=CURVED),
)
"""A lost part of the tail is what errors of three coefficients are: longitudinal records could hardly tell them."""
