"""Terms that the six coefficients may lack in sideslip and with aileron and rudder: one table, an effect per line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import product, prop, value
from testbench.aircraft.seams import control_path
from testbench.effects.aero import ALPHA, force
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite

BETA = "aero/beta-rad"
Variable = Callable[[Aircraft], str]


def _beta_cubed(aircraft: Aircraft) -> str:
    return product(*(prop(BETA),) * 3)


def _alpha_beta(aircraft: Aircraft) -> str:
    return product(prop(ALPHA), prop(BETA))


def _deflection(control: str, aircraft: Aircraft) -> str:
    return prop(control_path(aircraft, control).servo)


def _size_of(control: str, aircraft: Aircraft) -> str:
    return f"<abs> {_deflection(control, aircraft)} </abs>"


def _square_of(control: str, aircraft: Aircraft) -> str:
    return product(*(_deflection(control, aircraft),) * 2)


def _alpha_aileron(aircraft: Aircraft) -> str:
    return product(prop(ALPHA), _deflection("da", aircraft))


@dataclass(frozen=True)
class Term:
    """A term of a coefficient: a free number times a variable.

    Attributes:
        coefficient: CL, CD, CY, Cl, Cm or Cn.
        variable: aircraft -> XML of it.
        size: the number.
        text: how it is written, for people.
        words: title, place, physics, mistaken_for, separated_by.
    """

    coefficient: str
    variable: Variable
    size: Parameter
    text: str
    words: tuple[str, str, str, str, str]


def _size(name: str, most: float, start: float) -> Parameter:
    return Parameter(name, "1", -most, most, (start, -start), none=0.0)


TERMS: dict[str, Term] = {
    "cubic_weathercock": Term(
        "Cn",
        _beta_cubed,
        _size("Cn_beta3", 30.0, 1.0),
        "beta^3 in the yawing moment",
        (
            "weathercock stability that changes with sideslip",
            "fin",
            "The fin stalls, or comes out of the fuselage's wake, as sideslip grows. To first order of what is odd in "
            "sideslip, the yawing moment gets a term in its cube.",
            "another Cn_beta where all sideslips are of one size",
            "rudder inputs of two sizes, the larger one beyond 10 degrees of sideslip",
        ),
    ),
    "cubic_dihedral": Term(
        "Cl",
        _beta_cubed,
        _size("Cl_beta3", 30.0, 1.0),
        "beta^3 in the rolling moment",
        (
            "dihedral effect that changes with sideslip",
            "wing",
            "The windward wing stalls, or the fuselage shades the leeward one, as sideslip grows. To first order of "
            "what is odd in sideslip, the rolling moment gets a term in its cube.",
            "another Cl_beta where all sideslips are of one size",
            "rudder inputs of two sizes, the larger one beyond 10 degrees of sideslip",
        ),
    ),
    "dihedral_over_alpha": Term(
        "Cl",
        _alpha_beta,
        _size("Cl_beta_alpha", 10.0, 0.5),
        "alpha beta in the rolling moment",
        (
            "dihedral effect that changes with alpha",
            "wing",
            "A swept wing rolls away from sideslip in proportion to its lift, so that its dihedral effect grows with "
            "alpha. The rolling moment gets a term in alpha times sideslip.",
            "another Cl_beta at one speed",
            "the same rudder input at two speeds, or in a pull-up",
        ),
    ),
    "weathercock_over_alpha": Term(
        "Cn",
        _alpha_beta,
        _size("Cn_beta_alpha", 10.0, 0.5),
        "alpha beta in the yawing moment",
        (
            "weathercock stability that changes with alpha",
            "fin",
            "The wake of wing and fuselage reaches the fin as alpha grows. The yawing moment gets a term in alpha "
            "times sideslip.",
            "another Cn_beta at one speed",
            "the same rudder input at two speeds, or in a pull-up",
        ),
    ),
    "adverse_yaw_over_alpha": Term(
        "Cn",
        _alpha_aileron,
        _size("Cn_da_alpha", 5.0, 0.3),
        "alpha times aileron in the yawing moment",
        (
            "adverse yaw that changes with alpha",
            "aileron",
            "The aileron that goes down adds induced drag in proportion to the lift that the wing carries. The yawing "
            "moment gets a term in alpha times aileron.",
            "another Cn_da at one speed; an aileron-rudder interconnect",
            "the same aileron input at two speeds; a measured rudder deflection",
        ),
    ),
    "rudder_pitch": Term(
        "Cm",
        partial(_size_of, "dr"),
        _size("Cm_dr", 3.0, 0.1),
        "|rudder| in the pitching moment",
        (
            "pitching moment of the rudder",
            "rudder",
            "A rudder above or below the tail's plane changes the load on it, and one of a V tail pitches by itself, "
            "whichever way it turns. The pitching moment gets a term in the size of its deflection.",
            "a pitching moment due to sideslip; the square of the deflection where all inputs are of one size",
            "rudder inputs of two sizes and of both signs, with the pitch rate recorded",
        ),
    ),
    "rudder_pitch_square": Term(
        "Cm",
        partial(_square_of, "dr"),
        _size("Cm_dr2", 60.0, 2.0),
        "rudder^2 in the pitching moment",
        (
            "pitching moment of the rudder's square",
            "rudder",
            "The deflected rudder slows the air at the tail, and its drag acts above the centre of gravity. Both grow "
            "with the square of its deflection.",
            "a pitching moment in the size of the deflection where all inputs are of one size",
            "rudder inputs of two sizes and of both signs, with the pitch rate recorded",
        ),
    ),
    "aileron_pitch": Term(
        "Cm",
        partial(_size_of, "da"),
        _size("Cm_da", 3.0, 0.1),
        "|aileron| in the pitching moment",
        (
            "pitching moment of the ailerons",
            "aileron",
            "One aileron goes up further than the other goes down, or acts in another flow, so that their pitching "
            "moments do not cancel. The pitching moment gets a term in the size of the deflection.",
            "the square of the deflection where all inputs are of one size; spoilers that help in roll",
            "aileron inputs of two sizes and of both signs, with the pitch rate recorded",
        ),
    ),
    "aileron_pitch_square": Term(
        "Cm",
        partial(_square_of, "da"),
        _size("Cm_da2", 60.0, 2.0),
        "aileron^2 in the pitching moment",
        (
            "pitching moment of the ailerons' square",
            "aileron",
            "Deflected ailerons cost lift and add drag on both sides, which pitches the aircraft. Both grow with the "
            "square of the deflection.",
            "a pitching moment in the size of the deflection where all inputs are of one size",
            "aileron inputs of two sizes and of both signs, with the pitch rate recorded",
        ),
    ),
}


def amend(name: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add the term of that name."""
    term = TERMS[name]
    x = values[term.size.name]
    edit = force(term.coefficient, name.replace("_", "-"), value(x), term.variable(aircraft))
    return aircraft.amended(Amendment(name, f"{x:+.3g} {term.text} more", (edit,))), suite


def _effect(name: str, term: Term) -> Effect:
    title, place, physics, mistaken_for, separated_by = term.words
    return Effect(
        name=name,
        title=title,
        place=place,
        physics=physics,
        parameters=(term.size,),
        amend=partial(amend, name),
        mistaken_for=mistaken_for,
        separated_by=separated_by,
        flown=True,
        lateral=True,
    )


EFFECTS = tuple(_effect(name, term) for name, term in TERMS.items())
