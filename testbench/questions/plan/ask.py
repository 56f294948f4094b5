"""A plan made from its scenario: points in order, margins and predicted damping, cards flown, runs and flights."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.blas import on_one_thread
from testbench.core.channels import CONTROLS
from testbench.core.errors import LimitError, Refusal, ScenarioError, located
from testbench.core.named import Named, obtain
from testbench.design.ensemble import Flier
from testbench.evaluation.envelope import Envelope, Onset, fly_envelope
from testbench.flight import load_aircraft
from testbench.flight.batch.jobs import Simulator
from testbench.page.words import counted
from testbench.questions.plan.bounds import GIVEN, bounds_at
from testbench.questions.plan.repeats import fits, level_power_W, reach, schedule
from testbench.questions.plan.response import (
    Task,
    Together,
    Within,
    bands_of,
    expected_band,
    fly_within,
    limits_of,
    roughness,
    scaled,
)
from testbench.questions.plan.result import Card, Cleared, Limit, ModeAt, Plan, Point, Reached, Status
from testbench.questions.plan.scenario import PlannedManoeuvre, PlanScenario
from testbench.sensors import SensorSuite, load_suite

Survey = Callable[[Aircraft, Sequence[float], float], Envelope]
"""The function that finds trims and modes over speed: :func:`testbench.evaluation.envelope.fly_envelope`."""

_BEYOND = 1.6  # the onset is looked for up to this multiple of the fastest planned speed
_BEYOND_SPEEDS = 12


@on_one_thread
def make_plan(
    scenario: Named[PlanScenario],
    survey: Survey = fly_envelope,
    progress: Callable[[str], None] | None = None,
    simulator: Simulator = "auto",
    cleared: Cleared | None = None,
) -> Plan:
    """Return the plan of a scenario: the build-up, every card flown in the simulator, runs, times and flights.

    Args:
        scenario: of :meth:`PlanScenario.load`.
        survey: finds trims, linear models and modes over speed at one height.
        progress: called with a few words as each stage begins.
        simulator: "jsbsim" flies one card after the other; "auto" flies many at once, where the model has been found
            equal to JSBSim.
        cleared: what flights of its slower points told of flutter.

    Raises:
        ScenarioError: every point that cannot be trimmed or lies above the onset less the margin, and what else can
            only be known by computing.

    Example:
        >>> import testbench as tb
        >>> plan = tb.make_plan(tb.load("plan/taurus_63"))  # doctest: +SKIP
        >>> len(plan.cards)  # doctest: +SKIP
    """
    scenario = obtain(PlanScenario, scenario)
    say = progress or (lambda text: None)
    aircraft = load_aircraft(scenario.aircraft, scenario.wings)
    suite = load_suite(scenario.suite)
    say("trim, linearise and follow the modes over speed")
    envelopes = []
    for h in scenario.heights_m:
        with located(scenario.file, "heights_m"):
            envelopes.append(survey(aircraft, _speeds(scenario, aircraft), h))
    faults = [f for envelope in envelopes for f in _point_faults(scenario, envelope)]
    if faults:
        raise ScenarioError(faults)
    points = _points(scenario, envelopes)
    tasks, keys = [], []
    for point in points:
        for i, spec in enumerate(scenario.manoeuvre):
            if _wanted(spec, point):
                onset = point.onset.V_m_s if point.onset is not None and not scenario.allow_above_onset else None
                bounds = bounds_at(scenario.limits, aircraft, point, scenario.timing.field_m, onset)
                tasks.append(Task(point, spec, limits_of(bounds.limits, aircraft, onset), bounds.sources))
                keys.append(f"manoeuvre[{i}]")
    together = Together(aircraft, Flier(simulator), scenario.held_ms)
    say(f"fly {counted(len(tasks), 'card')}")
    within = fly_within(together, tasks, scenario.scale)
    rough = roughness(together, scenario, tasks)
    cards: list[Card] = []
    for task, key, flown, air in zip(tasks, keys, within, rough, strict=True):
        say(f"expect the response to {task.spec.name} at {task.point.label}")
        with located(scenario.file, key):
            if isinstance(flown, Refusal):
                raise flown
            if isinstance(air, Refusal):
                raise air
            cards.append(_card(scenario, aircraft, suite, task, flown, air, len(cards) + 1))
    fits(scenario, cards)
    runs, flights = schedule(scenario, cards, aircraft.mass.mass_kg)
    tally = together.flier.tally
    return Plan(scenario, aircraft, suite, tuple(envelopes), points, tuple(cards), runs, flights, tally, cleared)


def _wanted(spec: PlannedManoeuvre, point: Point) -> bool:
    return (not spec.speeds_m_s or point.V_m_s in spec.speeds_m_s) and (
        not spec.heights_m or point.h_m in spec.heights_m
    )


def _speeds(scenario: PlanScenario, aircraft: Aircraft) -> list[float]:
    """Return the planned speeds, and further ones beyond them that the onset is looked for at."""
    planned = sorted(scenario.speeds_m_s)
    flown = aircraft.flown_modes()
    if flown is None or not len(flown):
        return planned
    top = min(_BEYOND * planned[-1], aircraft.limits.get("V", (0.0, math.inf))[1])
    between = [0.5 * (a + b) for a, b in pairwise(planned) if b - a > 1.5]
    beyond = np.linspace(planned[-1], max(top, planned[-1]), _BEYOND_SPEEDS + 1)[1:].tolist()
    return [*planned, *between, *(round(v, 6) for v in beyond)]


def first_onset(envelope: Envelope) -> Onset | None:
    """Return the slowest onset of an elastic instability, or None if there is none."""
    found = [o for o in map(envelope.onset, envelope.elastic) if o.V_m_s is not None]
    return min(found, key=lambda o: o.V_m_s or 0.0) if found else None


def _point_faults(scenario: PlanScenario, envelope: Envelope) -> list[str]:
    """Return the planned speeds that cannot be trimmed, or lie above the onset less the margin, in words."""
    out = []
    refused = {u.V_m_s: u.reason for u in envelope.untrimmed}
    onset = first_onset(envelope)
    for i, V in enumerate(scenario.speeds_m_s):
        key = f"{scenario.file}, speeds_m_s[{i}]"
        if V in refused:
            out.append(f"{key}: {refused[V]}")
        if onset is None or onset.V_m_s is None or scenario.allow_above_onset:
            continue
        most = onset.V_m_s * (1.0 - scenario.onset_margin_percent / 100.0)
        if most < V:
            out.append(
                f"{key}: V <= {most:.4g} m/s must hold at {envelope.h_m:g} m ({onset.sentence}, less a margin of "
                f"{scenario.onset_margin_percent:g} %), got {V:g}; leave the speed out, or set allow_above_onset = true"
            )
    return out


def _points(scenario: PlanScenario, envelopes: Sequence[Envelope]) -> tuple[Point, ...]:
    """Return the points from slow to fast; at one speed from high to low, by which dynamic pressure rises."""
    by_height = {e.h_m: e for e in envelopes}
    speeds = sorted(scenario.speeds_m_s)
    used = [
        (V, h)
        for V in speeds
        for h in sorted(by_height, reverse=True)
        if any(
            (not m.speeds_m_s or V in m.speeds_m_s) and (not m.heights_m or h in m.heights_m)
            for m in scenario.manoeuvre
        )
    ]
    out: list[Point] = []
    for V, h in used:
        envelope = by_height[h]
        k = envelope.nearest(V)
        later = [v for v, height in used if v > V and height == h]
        following = later[0] if later else None
        out.append(
            Point(
                len(out) + 1,
                V,
                h,
                envelope.trims[k],
                envelope.models[k],
                level_power_W(scenario, envelope.trims[k], envelope.aircraft.mass.mass_kg),
                first_onset(envelope),
                _modes_at(envelope, k, following),
                following,
            )
        )
    return tuple(out)


def _modes_at(envelope: Envelope, k: int, following: float | None) -> tuple[ModeAt, ...]:
    """Return the modes at speed ``k``."""
    out = []
    for name in envelope.motion:
        f, zeta = envelope.history(name)
        later = None if following is None else float(np.nanmin(zeta[envelope.nearest(following)]))
        here = float(np.nanmin(zeta[k]))
        out.append(ModeAt(name, name in envelope.elastic, float(np.nanmax(f[k])), here, later))
    return tuple(out)


def _card(
    scenario: PlanScenario,
    aircraft: Aircraft,
    suite: SensorSuite,
    task: Task,
    within: Within,
    rough: Mapping[str, float],
    number: int,
) -> Card:
    """Return the card of one manoeuvre at one point that was flown in the simulator."""
    point, spec = task.point, task.spec
    factor, flown, met = within
    status: Status = "refused" if factor == 0.0 else "fly" if factor == 1.0 else "scaled"
    band = expected_band(scenario, aircraft, suite, point, spec, flown, rough)
    reached: tuple[Reached, ...] = ()
    repeats = spec.repeats or 1
    if status == "refused":
        repeats = 0
    elif spec.accuracy_percent:
        repeats, reached = reach(aircraft, point, spec, scaled(spec.input, factor), suite, scenario.held_ms)
    try:
        bands = bands_of(task.limits, point, spec.controls)
        stops = {c: GIVEN if c in scenario.limits.deflection_deg else f"stops of {aircraft.name}" for c in CONTROLS}
        shown = tuple(Limit(n, low, high, {**stops, **task.sources}[n]) for n, (low, high) in bands.items())
    except LimitError:  # trim lies outside: the card is refused, and says so
        shown = ()
    record = dataclasses.replace(flown.record, provenance={})
    return Card(number, point, spec, status, factor, met, flown.signal, record, band, shown, repeats, reached)
