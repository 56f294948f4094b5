"""A part of a wing, of the fin or of the tail that is gone: forces, moments, mass and inertia together.

Strip theory with an even load: a share s of a half span, from the tip inwards, carries s/2 of the wing's lift and drag
at (1 - s/2) b/2 from the middle, and (1 - (1 - s)^3) / 2 of its roll damping (B. Etkin, L. D. Reid, Dynamics of Flight,
1996, chapter 3, from memory). What fin and tail do is read from the believed derivatives of rudder and elevator: their
lever from the ratio of moment to force, their lift slope from the damping that they give. Shares of mass are those
of a light aircraft (judged): a wing 12 %, fin and tail 1 % and 2 % of it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from testbench.aircraft import Aircraft, Amendment, Increment
from testbench.aircraft.amend import Change
from testbench.aircraft.model import MassProperties
from testbench.aircraft.reroute import product, prop, value
from testbench.aircraft.seams import control_path, moved_centre, scaled_mass
from testbench.core.errors import ModelError
from testbench.effects.aero import ALPHA, force
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite

_WING_MASS, _FIN_MASS, _TAIL_MASS = 0.12, 0.01, 0.02
_P, _Q, _R = (f"velocities/{rate}-aero-rad_sec" for rate in "pqr")
_OVER_SPAN, _OVER_CHORD = "aero/bi2vel", "aero/ci2vel"
_DOWNWASH = 0.4  # of the tail's angle of attack that the wing takes away (judged)


def _sum(*terms: tuple[float, tuple[str, ...]]) -> str:
    products = " ".join(product(value(x), *(prop(p) for p in names)) for x, names in terms)
    return f"<sum> {products} {value(0.0)} </sum>"


def _arm(aircraft: Aircraft, moment: str, side: str) -> float:
    """Return the lever of a surface over the length of its moment, from the derivatives of its control.

    Raises:
        ModelError: the control makes no force.
    """
    along = aircraft.coefficient(side)
    if abs(along) < 1e-9:
        raise ModelError(f"{aircraft.name} must have a {side}, from which a lost surface is told, it has none")
    return abs(aircraft.coefficient(moment) / along)


def _wing(aircraft: Aircraft, share: float) -> tuple[tuple[Increment, ...], float, tuple[float, float, float]]:
    """Return what the right wing's lost share takes away (of the left one, if negative), its mass over that of the
    aircraft and its place (aft, right, up), m."""
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


def _fin(aircraft: Aircraft, share: float) -> tuple[tuple[Increment, ...], float, tuple[float, float, float]]:
    arm = _arm(aircraft, "Cn_dr", "CY_dr")
    damping = aircraft.coefficient("Cn_r")
    stiff = -damping / (2.0 * arm)  # Cn_r = -2 (l/b) Cn_beta of the fin
    rudder = control_path(aircraft, "dr").servo
    yaw = _sum((stiff, ("aero/beta-rad",)), (damping, (_R, _OVER_SPAN)), (aircraft.coefficient("Cn_dr"), (rudder,)))
    sideways = _sum(
        (-stiff / arm, ("aero/beta-rad",)),
        (-damping / arm, (_R, _OVER_SPAN)),
        (aircraft.coefficient("CY_dr"), (rudder,)),
    )
    edits = (force("Cn", "lost-fin-yaw", value(-share), yaw), force("CY", "lost-fin-side", value(-share), sideways))
    return edits, _FIN_MASS * share, (arm * aircraft.geometry.b_m, 0.0, 0.0)


def _tail(aircraft: Aircraft, share: float) -> tuple[tuple[Increment, ...], float, tuple[float, float, float]]:
    arm = _arm(aircraft, "Cm_de", "CL_de")
    damping = aircraft.coefficient("Cm_q")
    slope = -damping / (2.0 * arm * arm)  # of lift, referred to the wing's area: Cm_q = -2 (l/c)^2 of it
    elevator = control_path(aircraft, "de").servo
    alpha = slope * (1.0 - _DOWNWASH)
    pitch = _sum((-alpha * arm, (ALPHA,)), (damping, (_Q, _OVER_CHORD)), (aircraft.coefficient("Cm_de"), (elevator,)))
    lift = _sum((alpha, (ALPHA,)), (-damping / arm, (_Q, _OVER_CHORD)), (aircraft.coefficient("CL_de"), (elevator,)))
    edits = (force("Cm", "lost-tail-pitch", value(-share), pitch), force("CL", "lost-tail-lift", value(-share), lift))
    return edits, _TAIL_MASS * share, (arm * aircraft.geometry.cbar_m, 0.0, 0.0)


_CHECK = "look at {0}: something is broken off, dented or missing; then balance the aircraft on nose and tail"
_PARTS = {"lost_wing": _wing, "lost_fin": _fin, "lost_tail": _tail}


def amend(name: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Take the share of the surface away.

    Raises:
        ModelError: the believed derivatives do not tell what the surface does.
    """
    share = values["share"]
    edits, ratio, place = _PARTS[name](aircraft, share)
    changes, mass = _lighter(aircraft, ratio, place)
    text = f"{100.0 * abs(share):.3g} % of the {name.removeprefix('lost_')} lost"
    if name == "lost_wing":
        text = f"{100.0 * abs(share):.3g} % of the {'right' if share >= 0.0 else 'left'} wing lost, from its tip"
    return replace(aircraft.amended(Amendment(name, text, (*edits, *changes))), mass=mass), suite


def _lighter(
    aircraft: Aircraft, ratio: float, place: tuple[float, float, float]
) -> tuple[tuple[Change, ...], MassProperties]:
    """Return the changes that take a point mass away, and mass and inertia then, about the new centre of gravity."""
    M = aircraft.mass
    lost = ratio * M.mass_kg
    aft, right, _ = place
    shift = tuple(-ratio / (1.0 - ratio) * x for x in place)
    about = lost / (1.0 - ratio)  # lost mass about the old centre, and the rest about the new one
    factors = {
        "mass_kg": 1.0 - ratio,
        "Ixx": 1.0 - about * right**2 / M.Ixx,
        "Iyy": 1.0 - about * aft**2 / M.Iyy,
        "Izz": 1.0 - about * (aft**2 + right**2) / M.Izz,
    }
    if min(factors.values()) <= 0.0:
        raise ModelError(f"the part that is lost must weigh less than {aircraft.name} about each axis, it does not")
    changes, mass = scaled_mass(aircraft, factors)
    return (*changes, *moved_centre(replace(aircraft, mass=mass), shift)), mass


def _share(least: float, *starts: float) -> tuple[Parameter, ...]:
    return (Parameter("share", "1", least, 0.9, starts, none=0.0),)


EFFECTS = (
    Effect(
        name="lost_wing",
        title="part of a wing lost",
        place="wing",
        ground_check=_CHECK.format("both wings"),
        physics=(
            "The outer part of one wing is gone: its lift, drag and mass, and most of its roll damping. The aircraft "
            "rolls towards it in proportion to lift, rolls more easily, and carries less."
        ),
        parameters=_share(-0.9, 0.1, -0.1),
        amend=partial(amend, "lost_wing"),
        mistaken_for="a centre of gravity off the middle with errors of CL_alpha and Cl_p",
        separated_by="looking at it; pull-ups beside aileron inputs, which show lift and roll damping fall together",
        flown=True,
        lateral=True,
    ),
    Effect(
        name="lost_fin",
        title="part of the fin lost",
        place="fin",
        ground_check=_CHECK.format("fin and rudder"),
        physics=(
            "A part of fin and rudder is gone. Weathercock stability, yaw damping and rudder power fall by one share, "
            "and side force with them."
        ),
        parameters=_share(-0.5, 0.2, -0.1),
        amend=partial(amend, "lost_fin"),
        mistaken_for="errors of Cn_beta, Cn_r and Cn_dr together; only what exceeds their priors can be named",
        separated_by="looking at it",
        lateral=True,
    ),
    Effect(
        name="lost_tail",
        title="part of the tail lost",
        place="pitching moment",
        ground_check=_CHECK.format("tailplane and elevator"),
        physics=(
            "A part of tailplane and elevator is gone. Pitch stiffness, pitch damping and elevator power fall by one "
            "share, and the centre of gravity moves forward."
        ),
        parameters=_share(-0.5, 0.1, -0.1),
        amend=partial(amend, "lost_tail"),
        mistaken_for="errors of Cm_alpha, Cm_q and Cm_de together; only what exceeds their priors can be named",
        separated_by="looking at it",
    ),
)
