"""The air in which a design expects to be flown."""

from __future__ import annotations

from testbench.aircraft import Aircraft
from testbench.core.scenario.air import LOWEST_M, AirSpec
from testbench.questions.design.scenario import DesignScenario

LIGHT_KG = 25.0
"""Mass below which light turbulence is expected if a scenario does not say."""
LIGHT_RMS_M_S = 0.3
"""Vertical rms of that turbulence: a tenth of a wind of 3 m/s at 20 ft (MIL-F-8785C), a calm morning."""


def expected_air(scenario: DesignScenario, aircraft: Aircraft) -> AirSpec:
    """Return the air that a scenario expects: as given, else light turbulence for a light aircraft, else still."""
    if "air" in scenario.model_fields_set or aircraft.mass.mass_kg >= LIGHT_KG:
        return scenario.air
    height = None if scenario.condition.h_m >= LOWEST_M else LOWEST_M
    return AirSpec(turbulence_rms_m_s=LIGHT_RMS_M_S, height_m=height)
