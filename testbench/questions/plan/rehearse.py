"""A campaign rehearsed: the runs of a plan flown in the simulator, in turbulence, and logged as the aircraft's log is.

One log per flight, with what the sensors of the plan read and what was commanded. `testbench plan close` takes it as it
takes a real one, so that the way from the card to derivatives can be tried before anybody flies.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.believed import drawn, with_priors
from testbench.core.errors import LimitError, RecordError, TrimError
from testbench.core.record import FlightAborted, FlightRecord
from testbench.core.scenario.air import LOWEST_M, AirSpec
from testbench.flight import FlightCondition, trim
from testbench.flight.air import air_of
from testbench.flight.batch.jobs import Job
from testbench.flight.simulate import Manoeuvre
from testbench.inputs import InputSignal
from testbench.line import truth_of
from testbench.questions.plan.response import scaled
from testbench.questions.plan.result import Plan, Run
from testbench.questions.plan.scenario import commanded

DRAWS = 20  # draws of an aircraft of which one must trim
QUIET_S = 3.0  # undisturbed flight before the settling time of every run
AFTER_S = 5.5  # flight with the controls at trim after every run, as import wants the response to end in


def rehearse(
    plan: Plan, aircraft: Aircraft | None = None, seed: int = 0, say: Callable[[str], None] = lambda text: None
) -> dict[int, FlightRecord]:
    """Return flight -> its log.

    Args:
        plan: with its runs.
        aircraft: what flies instead of the aircraft of the plan: one that is not as it is believed to be.
        seed: of turbulence and noise; every run has its own.
        say: called with a few words as each run begins.

    Raises:
        RecordError: the plan has no run.
        TestbenchError: an aircraft that does not trim there, or that leaves its limits before a run begins.
    """
    if not plan.runs:
        raise RecordError("a rehearsal needs a card that can be flown, but every card of the plan is refused")
    flown: dict[int, list[FlightRecord]] = {}
    for run in plan.runs:
        say(f"fly run {run.number} of {len(plan.runs)}")
        record = fly_run(plan, run, aircraft, seed + 1000 * run.number, say)
        flown.setdefault(run.flight, []).append(record)
    return {flight: _joined(parts) for flight, parts in flown.items()}


def as_drawn(plan: Plan, aircraft: Aircraft, seed: int, say: Callable[[str], None] = lambda text: None) -> Aircraft:
    """Return an aircraft drawn by its uncertainty, or by what handbooks reach: the first draw that trims as planned.

    Nobody takes one into the air that does not.

    Args:
        plan: whose speeds and heights are flown.
        aircraft: as believed.
        seed: of the draws.
        say: called with why a draw is left out.

    Raises:
        ModelError: the aircraft states a deviation that cannot be drawn.
        TrimError, LimitError: none of ``DRAWS`` draws trims at all speeds and heights.
    """
    believed, k = with_priors(aircraft), 0
    while True:
        other, k = drawn(believed, seed, k), k + 1
        try:
            for point in plan.points:
                trim(other, FlightCondition(point.V_m_s, point.h_m))
            return other
        except (TrimError, LimitError) as error:
            if k == DRAWS:
                raise
            say(f"draw again, as this aircraft cannot be flown: {error}")


def fly_run(
    plan: Plan, run: Run, other: Aircraft | None, seed: int, say: Callable[[str], None] = lambda text: None
) -> FlightRecord:
    """Return what is logged of one run: the sensors, and the commands that they do not read.

    Args:
        plan: of the run.
        run: that is flown, by the aircraft of the plan or by another one.
        other: what flies instead.
        seed: of turbulence and noise.
        say: called with why a run was broken off.

    Raises:
        TestbenchError: an aircraft that does not trim there, or that leaves its limits before the run begins.
    """
    card = run.card
    point, suite, scenario = card.point, plan.suite, plan.scenario
    rate = suite.rate_hz * math.ceil(point.trimmed.rate_hz / suite.rate_hz - 1e-9)  # the sensors' rate divides it
    aircraft, trimmed = other or plan.aircraft, point.trimmed
    if other is not None or rate != trimmed.rate_hz:
        trimmed = trim(aircraft, FlightCondition(point.V_m_s, point.h_m), rate)
    rms = scenario.turbulence_rms_m_s
    air = air_of(AirSpec(turbulence_rms_m_s=rms, height_m=max(point.h_m, LOWEST_M)), point.h_m, seed) if rms else None
    spec = card.spec
    given = commanded(scaled(spec.input, card.factor), spec.duration_s, rate, scenario.held_ms)

    def flown(after_s: float) -> FlightRecord:
        still = np.zeros((round(after_s * rate), given.u.shape[1]))
        u = np.vstack([given.u, still])
        signal = InputSignal(np.arange(len(u)) / rate, u, given.channels)
        manoeuvre = Manoeuvre(spec.name, signal, spec.settle_s + QUIET_S)
        return truth_of(Job(aircraft, trimmed, manoeuvre, rate, air=air))

    after_s = AFTER_S
    try:
        truth = flown(after_s)
    except FlightAborted:  # nobody would leave it alone as long
        after_s = 0.0
        try:
            truth = flown(after_s)
        except FlightAborted as error:  # the run is broken off at the limit, and the next one begins at trim
            if error.record is None or error.time_s <= spec.settle_s + QUIET_S:
                raise
            say(f"run {run.number} of {len(plan.runs)} is aborted: {error}")
            truth = error.record
    record = suite.measure(truth, seed)
    told = [f"{c}_cmd" for c in plan.aircraft.controls if f"{c}_cmd" in truth and f"{c}_cmd" not in record]
    rows = np.minimum(np.searchsorted(truth.t_s, record.t_s - 1e-9), len(truth) - 1)
    record = record.with_columns({name: truth[name][rows] for name in told})
    end_s = QUIET_S + card.length_s + after_s
    return record.between(0.0, end_s)  # without the sample at its end, which begins the next run


def _joined(parts: list[FlightRecord]) -> FlightRecord:
    """Return the runs of one flight one after the other."""
    rows, valid = np.concatenate([p.data for p in parts]), np.concatenate([p.valid for p in parts])
    t_s = parts[0].dt_s * np.arange(len(rows), dtype=float)
    return FlightRecord(t_s, parts[0].channels, rows, "measured", valid)
