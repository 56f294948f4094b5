"""How many runs give a wanted accuracy: repeats = ceil((std / wanted)^2); and their times, energy and room."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.constants import DEG_RAD, G0_M_S2, PERCENT
from testbench.core.errors import EstimationError, ScenarioError
from testbench.core.record import FloatArray
from testbench.core.scenario.inputs import Input
from testbench.flight import TrimmedFlight
from testbench.information.aircraft_structure import AircraftStructure, seen_by
from testbench.information.fisher import Experiment, accuracy
from testbench.information.targets import needed_parameters
from testbench.questions.plan.result import Card, FlightLeg, Point, Reached, Run
from testbench.questions.plan.scenario import Airspace, PlannedManoeuvre, PlanScenario, Tow, commanded
from testbench.sensors import Sensor, SensorSuite

_FINE_HZ = 50.0  # the input is sampled at least this finely however slow the sensors are


def reach(
    aircraft: Aircraft,
    point: Point,
    spec: PlannedManoeuvre,
    inputs: Sequence[Input],
    suite: SensorSuite,
    period_ms: int | None = None,
) -> tuple[int, tuple[Reached, ...]]:
    """Return the repeats of a manoeuvre at a point, and the accuracy of every parameter of ``accuracy_percent``.

    The wanted parameters are estimated together with those of ``estimated``, and offsets of the sensors are unknown.
    Sensors of other motions or without noise are left out. With n runs of the same input the information is n times
    that of one. A script holds each command for ``period_ms``.

    Raises:
        EstimationError: no sensor of the suite shows this motion, or the linearised aircraft diverges.
    """
    wanted = {name: percent / 100.0 for name, percent in spec.accuracy_percent.items()}
    one = told_by_a_run(aircraft, point, spec, inputs, suite, period_ms)
    std = accuracy(one.information).std
    return repeats_for(one.names, std / np.maximum(np.abs(one.values), 1e-300), wanted, spec.most_repeats, spec.repeats)


class Told(NamedTuple):
    """What one run tells: parameters (k,) by name, their values, and their Fisher information (k, k)."""

    names: tuple[str, ...]
    values: FloatArray
    information: FloatArray


def told_by_a_run(
    aircraft: Aircraft,
    point: Point,
    spec: PlannedManoeuvre,
    inputs: Sequence[Input],
    suite: SensorSuite,
    period_ms: int | None = None,
    share: Mapping[str, float] | None = None,
) -> Told:
    """Return what one run of a manoeuvre at a point tells of the parameters that :func:`reach` estimates.

    Args:
        aircraft: as believed.
        point: of the plan.
        spec: the manoeuvre, with what is wanted of it.
        inputs: at the amplitude that is flown.
        suite: the sensors.
        period_ms: for which a script holds each command.
        share: name -> what the parameter is of the believed one, where that is known better; 1 if it is not named.

    Raises:
        EstimationError: no sensor of the suite shows this motion, or the linearised aircraft diverges.
    """
    wanted, plane = spec.accuracy_percent, spec.plane
    elastic = sorted({int(n.rsplit("_", 1)[0][1:]) for n in wanted if n[0] == "Q"} | _numbers(wanted))
    along = spec.estimated or needed_parameters(plane, spec.controls, plane == "longitudinal", elastic)
    free = tuple(dict.fromkeys((*along, *wanted)))
    noisy = [s for s in suite.sensing(point.model.outputs) if s.noise_std > 0.0 or s.quantum > 0.0]
    commands = point.model.commands(spec.controls)

    def structure_of(sensors: Sequence[Sensor]) -> AircraftStructure:
        return seen_by(sensors, aircraft, point.trimmed, point.model, plane, commands, free)

    sensors = tuple(s for s, moves in zip(noisy, structure_of(noisy).moved, strict=True) if moves) if noisy else ()
    if not sensors:
        raise EstimationError(
            f"suite '{suite.name}' has no sensor of the {plane} motion with noise of its own; give repeats instead of "
            "accuracy_percent, or another suite"
        )
    structure = structure_of(sensors)
    if share is not None:
        structure = structure.at(structure.true * np.array([share.get(name, 1.0) for name in free]))
    stride = max(1, math.ceil(_FINE_HZ / suite.rate_hz))
    rate = suite.rate_hz * stride
    samples = int((spec.settle_s + spec.duration_s) * suite.rate_hz)
    u = _sampled(spec, inputs, rate, samples * stride, period_ms)
    return Told(free, structure.true, Experiment(structure, sensors, 1.0 / rate, samples, stride).information(u))


def repeats_for(
    names: Sequence[str], relative: FloatArray, wanted: dict[str, float], most: int, given: int | None = None
) -> tuple[int, tuple[Reached, ...]]:
    """Return the repeats, at most ``most``, and their accuracy, from relative standard errors (k,) of one run.

    They are those ``given``, if any are.
    """
    one = {name: float(relative[list(names).index(name)]) for name in wanted}
    needed = {
        name: math.ceil((one[name] / wanted[name]) ** 2 - 1e-9) if math.isfinite(one[name]) else None for name in wanted
    }
    repeats = min(most, max(1, *(n for n in needed.values() if n is not None))) if any(needed.values()) else 1
    repeats = given or repeats
    found = tuple(
        Reached(name, wanted[name], one[name], one[name] / math.sqrt(repeats), needed[name]) for name in wanted
    )
    return repeats, found


def _numbers(names: Mapping[str, float]) -> set[int]:
    """Return the modes that frequencies, damping ratios and couplings of these names belong to."""
    out = set()
    for name in names:
        head, tail = name.rsplit("_", 1)
        if head in ("omega", "zeta"):
            out.add(int(tail))
        if tail.startswith("eta"):
            out.add(int(tail[3:]))
    return out


def _sampled(
    spec: PlannedManoeuvre, inputs: Sequence[Input], rate_hz: float, samples: int, period_ms: int | None
) -> FloatArray:
    """Return the input (samples, m) after its settling time, in the order of ``spec.controls``."""
    u = commanded(inputs, spec.duration_s, rate_hz, period_ms).columns(spec.controls)
    start = round(spec.settle_s * rate_hz)
    return np.pad(u, ((start, max(samples - start - len(u), 0)), (0, 0)))[:samples]


# --- times, energy and room -------------------------------------------------------------------------------------------


def level_power_W(scenario: PlanScenario, trimmed: TrimmedFlight, mass_kg: float) -> float:
    """Return the power drawn in steady flight, W.

    In level flight it is P = T V / efficiency + avionics with the thrust T of the trim; a glider pays with height,
    P = m g V sin(-gamma).
    """
    energy, condition = scenario.energy, trimmed.condition
    if isinstance(energy, Tow):
        return max(-mass_kg * G0_M_S2 * condition.V_m_s * math.sin(condition.gamma_rad), 0.0)
    efficiency = energy.efficiency_percent * PERCENT
    return max(trimmed.state.get("thrust", 0.0), 0.0) * trimmed.condition.V_m_s / efficiency + energy.avionics_W


def usable_J(scenario: PlanScenario, mass_kg: float) -> float:
    """Return the energy that a flight may use, J; of a glider, m g times the height from release to the lowest."""
    energy = scenario.energy
    if isinstance(energy, Tow):
        return mass_kg * G0_M_S2 * (energy.release_m - energy.lowest_m)
    return energy.usable_J


def schedule(
    scenario: PlanScenario, cards: Sequence[Card], mass_kg: float
) -> tuple[tuple[Run, ...], tuple[FlightLeg, ...]]:
    """Return the runs in order and the flights that they take.

    A flight begins with ``timing.overhead_s`` at the level power of its first point and the climb from the field,
    m g dh / efficiency (a glider is towed); a run takes its length and ``timing.turn_s``. The next flight begins when
    a run would take more than the usable energy.

    Raises:
        ScenarioError: a flight of one run takes more than the usable energy.
    """
    timing, energy, usable = scenario.timing, scenario.energy, usable_J(scenario, mass_kg)
    towed = isinstance(energy, Tow)
    efficiency = 1.0 if isinstance(energy, Tow) else energy.efficiency_percent * PERCENT
    runs: list[Run] = []
    flights: list[FlightLeg] = []
    faults: list[str] = []
    time = used = 0.0
    height, first = timing.field_m, 1

    def climb_J(to_m: float) -> float:
        """Return the energy of the climb from the present height."""
        return 0.0 if towed else mass_kg * G0_M_S2 * max(to_m - height, 0.0) / efficiency

    for card in cards:
        power = card.point.power_W
        for repeat in range(1, card.repeats + 1):
            length = card.length_s + timing.turn_s
            step = power * length + climb_J(card.point.h_m)
            if not runs or used + step > usable:
                if runs:
                    flights.append(FlightLeg(len(flights) + 1, first, len(runs), time, used, usable))
                height, first, time = timing.field_m, len(runs) + 1, timing.overhead_s
                used = 0.0 if towed else power * timing.overhead_s
                step = power * length + climb_J(card.point.h_m)
                if used + step > usable and repeat == 1:
                    faults.append(
                        f"{scenario.file}, energy: usable energy >= {(used + step) / 3600.0:.3g} Wh must hold for one "
                        f"flight with one run of {card.title}, got {usable / 3600.0:.3g} Wh; give more "
                        "capacity or shorten overhead and turns"
                    )
            start = time
            used, time, height = used + step, time + length, card.point.h_m
            runs.append(Run(len(runs) + 1, card, repeat, len(flights) + 1, start, used))
    if faults:
        raise ScenarioError(faults)
    if runs:
        flights.append(FlightLeg(len(flights) + 1, first, len(runs), time, used, usable))
    return tuple(runs), tuple(flights)


# --- the box in which a campaign stays --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Leg:
    """How the runs of a card lie in the box."""

    run_m: float  # way of one run over ground, the strongest wind from behind
    radius_m: float  # radius of the turn back through the air, V^2 / (g tan bank)
    runs: int  # that fit between the turns at both ends
    turns: int  # back, for all repeats of the card
    turn_s: float  # time of one turn of 180 degrees


def turn_back(V_m_s: float, space: Airspace) -> tuple[float, float]:
    """Return radius (m) and time (s) of a turn of 180 degrees: V^2 / (g tan bank), pi radius / V."""
    radius = V_m_s**2 / (G0_M_S2 * math.tan(space.bank_deg * DEG_RAD))
    return radius, math.pi * radius / V_m_s


def leg_of(card: Card, space: Airspace) -> Leg:
    """Return how the runs of a card lie in the box.

    The turn at the end of a leg takes its radius of the length, and the drift of the wind during half of it; two radii
    of the width.
    """
    V = card.point.V_m_s
    radius, turn_s = turn_back(V, space)
    run = (V + space.wind_m_s) * card.length_s
    free = space.length_m - 2.0 * (radius + 0.5 * space.wind_m_s * turn_s)
    fit = max(math.floor(free / run), 0)
    return Leg(run, radius, fit, math.ceil(card.repeats / fit) - 1 if fit and card.repeats else 0, turn_s)


def box_faults(scenario: PlanScenario, cards: Sequence[Card]) -> list[str]:
    """Return in words what does not fit into the box: a run, a turn, or the heights that a card's limits allow."""
    space = scenario.airspace
    if space is None:
        return []
    out = []
    for card in cards:
        if card.status == "refused":
            continue
        leg = leg_of(card, space)
        ends = 2.0 * (leg.radius_m + 0.5 * space.wind_m_s * leg.turn_s)
        if leg.runs < 1:
            out.append(
                f"{scenario.file}, airspace.length_m: length_m >= {math.ceil(leg.run_m + ends)} must hold for one run "
                f"of {card.title} ({leg.run_m:.0f} m over ground in {space.wind_m_s:g} m/s of wind, {ends:.0f} m for "
                f"the turns), got {space.length_m:g}; shorten the manoeuvre or its settling, or enlarge the box"
            )
        if 2.0 * leg.radius_m > space.width_m:
            out.append(
                f"{scenario.file}, airspace.width_m: width_m >= {math.ceil(2.0 * leg.radius_m)} must hold for a turn "
                f"at {card.point.V_m_s:g} m/s and {space.bank_deg:g} deg of bank, got {space.width_m:g}"
            )
        for limit in card.limits:
            if limit.channel == "h" and not (space.lowest_m <= limit.low and limit.high <= space.highest_m):
                out.append(
                    f"{scenario.file}, airspace: lowest_m <= {limit.low:g} and highest_m >= {limit.high:g} must hold "
                    f"for the heights that the limits of {card.title} allow, got {space.lowest_m:g} and "
                    f"{space.highest_m:g}; set limits.height_change_m, or enlarge the box"
                )
    return list(dict.fromkeys(out))


def fits(scenario: PlanScenario, cards: Sequence[Card]) -> None:
    """Refuse cards that do not fit into the box.

    Raises:
        ScenarioError: every run, turn and height that does not fit.
    """
    faults = box_faults(scenario, cards)
    if faults:
        raise ScenarioError(faults)
