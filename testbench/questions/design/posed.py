"""The design problem of an aircraft as it is believed: by its model, or by that and what was flown before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import ceil
from typing import NamedTuple

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.errors import LimitError, located
from testbench.evaluation.envelope import Onset
from testbench.flight import LinearModel, TrimmedFlight, linearise
from testbench.information.fisher import accuracy
from testbench.information.modes import modes_of
from testbench.line import trim_for
from testbench.questions.design.build import limits_of, onsets_of, problem_of
from testbench.questions.design.known import AllKnown, Known, of_problem, with_values
from testbench.questions.design.limits import Limits
from testbench.questions.design.problem import Problem
from testbench.questions.design.scenario import DesignScenario
from testbench.questions.identify.pool.prior import Prior
from testbench.sensors import SensorSuite


class Posed(NamedTuple):
    """An aircraft at the condition of a design, and the design problem."""

    aircraft: Aircraft
    trimmed: TrimmedFlight
    linear: LinearModel
    onsets: tuple[Onset, ...]
    modes: Mapping[str, complex]
    limits: Limits
    problem: Problem


def pose(scenario: DesignScenario, aircraft: Aircraft, suite: SensorSuite) -> Posed:
    """Return the design problem of an aircraft."""
    where = scenario.file
    trimmed = trim_for(scenario, aircraft)
    with located(where, "condition"):
        linear = linearise(aircraft, trimmed)
        onsets = onsets_of(aircraft, scenario)
    modes = modes_of(linear, aircraft, scenario.plane)
    with located(where, "limits"):
        limits = limits_of(scenario, aircraft, trimmed, onsets)
        _check_rates(scenario, trimmed, suite)
        problem = problem_of(scenario, aircraft, trimmed, linear, modes, suite, limits, starts=True)
    return Posed(aircraft, trimmed, linear, onsets, modes, limits, problem)


def believe(scenario: DesignScenario, posed: Posed, suite: SensorSuite, flown: Prior) -> tuple[Posed, Known]:
    """Return the design problem at the values that earlier flights gave, with their information, and what is known.

    Raises:
        AllKnown: every target is known as well as wanted.
    """
    part, M = of_problem(flown, posed.problem)
    before = posed.problem.targets
    aircraft, notes = with_values(posed.aircraft, posed.trimmed, posed.problem.experiment.structure, part)
    posed = pose(scenario, aircraft, suite)
    names = posed.problem.targets.names
    if names == before.names:  # a mode may split, or join: wanted errors stay those of the scenario where they can
        values = before.values
    else:
        had = dict(zip(before.names, before.values.tolist(), strict=True))
        values = np.array([had.get(n, np.nan) for n in names])
    problem = replace(posed.problem, known=M)
    known = Known(part, problem.targets.errors(accuracy(M)), values, (*part.notes, *notes))
    if np.all(known.errors <= problem.targets.wanted):
        raise AllKnown(problem, known)
    return posed._replace(problem=problem), known


def _check_rates(scenario: DesignScenario, trimmed: TrimmedFlight, suite: SensorSuite) -> None:
    """Check that what is designed can be flown and sensed."""
    rate, wanted = trimmed.rate_hz, suite.rate_hz
    if scenario.realise and abs(rate / wanted - round(rate / wanted)) > 1e-9:
        raise LimitError(
            f"the rate of the suite {suite.name} must divide that of the simulation, {rate:g} Hz, got {wanted:g} Hz; "
            f"give [simulation] rate_hz = {ceil(rate / wanted) * wanted:g}"
        )
