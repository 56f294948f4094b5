"""What a design does if the aircraft is not the believed one: its fast mode lies 30 % lower or higher.

Cm_alpha, or Cn_beta, is changed about the trim until the natural frequency of the short period, or of the Dutch roll,
is that many times the believed one; the trim stays. The same commands are then predicted, flown and identified by the
same estimator, which still believes the first aircraft.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from testbench.aircraft import Aircraft
from testbench.aircraft.amend import Amendment, Increment
from testbench.core.errors import EstimationError, Refusal
from testbench.core.record import FloatArray
from testbench.evaluation.modes import roots_of
from testbench.flight import LinearModel, TrimmedFlight, linearise
from testbench.information.modes import modes_of
from testbench.line import trim_for
from testbench.questions.design.build import problem_of
from testbench.questions.design.flown import Envelope, Tightest, fly_all
from testbench.questions.design.limits import Limits
from testbench.questions.design.problem import Design, seen_in
from testbench.questions.design.realise import Errors, Range
from testbench.questions.design.scenario import DesignScenario

FACTORS = (0.7, 1.3)
"""Natural frequency over the believed one."""
_MODE = {
    "longitudinal": ("short period", "Cm", "alpha", -1.0, ("q", "w")),
    "lateral": ("Dutch roll", "Cn", "beta", 1.0, ("r", "v")),
}  # mode, coefficient, its angle, the sign that stiffens, and where the stiffness stands in A
_STEP = 0.02  # 1/rad, by which the slope of wn^2 is found
_TRIES, _NEAR = 6, 0.01


@dataclass(frozen=True, eq=False)
class Elsewhere:
    """The same commands with one aircraft that is not believed.

    Attributes:
        factor: natural frequency over the believed one.
        what: in words: the mode, and the coefficient with its factor.
        predicted: (t,) standard errors by information there.
        values: (t,) true values there.
        found: errors of the believed estimator over flights.
        tightest: the limit that one flight in still air uses most.
        breach: the first that it breaks; "" if none.
        why_not: why nothing can be said; "" otherwise.
    """

    factor: float
    what: str
    predicted: FloatArray | None = None
    values: FloatArray | None = None
    found: Errors | None = None
    tightest: Tightest | None = None
    breach: str = ""
    why_not: str = ""


def elsewhere(
    scenario: DesignScenario,
    range_: Range,
    envelope_limits: Limits,
    design: Design,
    n: int,
    say: Callable[[str], None],
) -> tuple[Elsewhere, ...]:
    """Return what a design does where its fast mode lies elsewhere.

    Args:
        scenario: of the design.
        range_: where the believed aircraft flies.
        envelope_limits: the limits.
        design: its commands stay as they are.
        n: flights of each aircraft.
        say: called with a few words as each stage begins.
    """
    out = []
    mode, coefficient, angle, *_ = _MODE[scenario.plane]
    for factor in FACTORS:
        what = f"{mode} at {factor:g} times its frequency"
        say(f"fly it with the {what}")
        try:
            aircraft, more = _with_mode(scenario, range_, factor)
            one = _flown(scenario, range_, envelope_limits, design, n, aircraft, factor)
            out.append(replace(one, what=f"{what}, {coefficient}_{angle} {more:+.3g}"))
        except Refusal as error:
            out.append(Elsewhere(factor, what, why_not=error.message))
    return tuple(out)


def _flown(
    scenario: DesignScenario,
    range_: Range,
    limits: Limits,
    design: Design,
    n: int,
    aircraft: Aircraft,
    factor: float,
) -> Elsewhere:
    believed = range_.targets
    whole = [m for m in scenario.targets.modes if f"wn of {m}" in believed.names]
    trimmed = trim_for(scenario, aircraft)
    linear = linearise(aircraft, trimmed)
    modes = modes_of(linear, aircraft, scenario.plane)
    problem = problem_of(scenario, aircraft, trimmed, linear, modes, range_.suite, limits, whole, starts=True)
    if problem.targets.names != believed.names:
        raise EstimationError("its modes have other names")
    there = replace(range_, aircraft=aircraft, trimmed=trimmed, problem=problem, targets=problem.targets)
    envelope = Envelope.of(limits, problem)
    seen = seen_in(problem, design)
    ((_, broken, tightest),) = fly_all(aircraft, trimmed, [design], envelope, range_.simulator, range_.tally)
    found = there.errors(design, 0, n)
    return Elsewhere(factor, "", seen.errors, problem.targets.values, found, tightest, broken[0] if broken else "")


def stiffness_words(scenario: DesignScenario) -> str:
    """Return in words what :func:`softer_and_stiffer` changes."""
    _, coefficient, angle, *_ = _MODE[scenario.plane]
    return f"{' and '.join(f'{factor:g}' for factor in FACTORS)} times its {coefficient}_{angle}"


def softer_and_stiffer(scenario: DesignScenario, range_: Range) -> list[tuple[Aircraft, TrimmedFlight]]:
    """Return the aircraft with 0.7 and 1.3 times the believed static stability, each trimmed; those that there are.

    These are two standard deviations of the 15 % by which ``plan`` lets derivatives be uncertain unless told otherwise.
    M_alpha, or N_beta, is linear in the coefficient that is changed about the trim.
    """
    out = []
    try:
        now, moved = (
            _stiffness(scenario, linearise(aircraft, trim_for(scenario, aircraft)))
            for aircraft in (range_.aircraft, _with_more(scenario, range_, _STEP))
        )
        slope = (moved - now) / _STEP
        for factor in FACTORS if slope != 0.0 else ():
            aircraft = _with_more(scenario, range_, (factor - 1.0) * now / slope)
            out.append((aircraft, trim_for(scenario, aircraft)))
    except Refusal:  # a model that cannot be amended has no margin of this kind
        return []
    return out


def _stiffness(scenario: DesignScenario, linear: LinearModel) -> float:
    """Return M_alpha, or N_beta, per unit of speed (1/(m s)); positive where it returns the aircraft to its trim."""
    *_, stiffens, (row, column) = _MODE[scenario.plane]
    return stiffens * float(linear.A[linear.states.index(row), linear.states.index(column)])


def _with_more(scenario: DesignScenario, range_: Range, more: float) -> Aircraft:
    """Return the believed aircraft with ``more`` (1/rad) of the coefficient that makes it stiff, about the trim."""
    if more == 0.0:
        return range_.aircraft
    _, coefficient, angle, *_ = _MODE[scenario.plane]
    at_trim = range_.trimmed.alpha if angle == "alpha" else range_.trimmed.state.get("beta", 0.0)
    about = f"<difference><property>aero/{angle}-rad</property><value>{float(at_trim)!r}</value></difference>"
    change = Increment(coefficient, f"aero/coefficient/{coefficient}_model_error", (f"<value>{more!r}</value>", about))
    return range_.aircraft.amended(Amendment("model error", f"another {coefficient}_{angle}", (change,)))


def _with_mode(scenario: DesignScenario, range_: Range, factor: float) -> tuple[Aircraft, float]:
    """Return the aircraft whose mode has ``factor`` times its frequency, and what was added to the coefficient, 1/rad.

    The square of the frequency is nearly linear in the coefficient; the secant method finds the rest.

    Raises:
        EstimationError: the mode has no frequency, or nothing gives the wanted one but an aircraft without static
            stability: a mode that is damped as much as it is stiff.
        TestbenchError: the aircraft cannot be changed or trimmed so.
    """
    mode, coefficient, angle, stiffens, _ = _MODE[scenario.plane]

    def at(more: float) -> tuple[Aircraft, float, bool]:
        one = _with_more(scenario, range_, more)
        linear = linearise(one, trim_for(scenario, one))
        found = modes_of(linear, one, scenario.plane)
        square = math.nan
        if any(name.startswith(mode) for name in found):
            roots = list(roots_of(found, mode).values())
            square = (roots[0] * (roots[1] if len(roots) == 2 else roots[0].conjugate())).real
        if not square > 0.0:
            raise EstimationError(f"the {mode} has no frequency")
        return one, square, _stiffness(scenario, linear) > 0.0

    _, now, was_stiff = at(0.0)
    wanted = now * factor**2
    old, more = (0.0, now), math.copysign(_STEP, stiffens * (factor - 1.0))
    for _ in range(_TRIES):
        one, square, stiff = at(more)
        if abs(math.sqrt(square / wanted) - 1.0) < _NEAR:
            if was_stiff and not stiff:
                raise EstimationError(
                    f"damping makes most of its frequency, so that this takes {coefficient}_{angle} {more:+.3g}, an "
                    "aircraft without static stability"
                )
            return one, more
        slope = (square - old[1]) / (more - old[0])
        if slope == 0.0:
            break
        old, more = (more, square), more + (wanted - square) / slope
    raise EstimationError(f"no {coefficient}_{angle} was found that gives the {mode} {factor:g} times its frequency")
