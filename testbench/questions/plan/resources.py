"""Times and energy: runs put into flights, each on one battery or tank."""

from __future__ import annotations

import math
from collections.abc import Sequence

from testbench.core.constants import G0_M_S2, PERCENT
from testbench.core.errors import ScenarioError
from testbench.flight import TrimmedFlight
from testbench.questions.plan.result import Card, FlightLeg, Run
from testbench.questions.plan.scenario import PlanScenario, Tow


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
