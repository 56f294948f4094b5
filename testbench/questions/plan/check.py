"""What can be said of a flight plan before it is flown."""

from __future__ import annotations

import math

from testbench.aircraft import Aircraft
from testbench.core.errors import Faults, nearest
from testbench.core.scenario.air import LOWEST_M
from testbench.evaluation.modes import elastic_modes
from testbench.flight import load_aircraft
from testbench.information.aircraft_structure import parameter_names
from testbench.inputs import build
from testbench.questions.plan.response import limits_of
from testbench.questions.plan.scenario import PlanScenario
from testbench.questions.run.check import check_amplitude
from testbench.sensors import load_suite


def check(scenario: PlanScenario) -> list[str]:
    """Return every law of aircraft, suite and inputs that a plan breaks, in words, without flying it."""
    faults = Faults(scenario.file)
    attempt = faults.attempt
    aircraft = attempt("aircraft", load_aircraft, scenario.aircraft, scenario.wings)
    attempt("suite", load_suite, scenario.suite)
    if not isinstance(aircraft, Aircraft):
        return faults
    attempt("limits", limits_of, scenario.limits, aircraft, None)
    for key, channel in (("speeds_m_s", "V"), ("heights_m", "h")):
        low, high = aircraft.limits.get(channel, (-math.inf, math.inf))
        for i, value in enumerate(getattr(scenario, key)):
            if not low <= value <= high:
                faults.append(
                    f"{scenario.file}, {key}[{i}]: {low:g} <= {channel} <= {high:g} must hold for {aircraft.name}, got "
                    f"{value:g}"
                )
    for i, h in enumerate(scenario.heights_m):
        above = h - scenario.timing.field_m
        if above < (LOWEST_M if scenario.turbulence_rms_m_s else 0.0):
            faults.append(
                f"{scenario.file}, heights_m[{i}]: a height must lie above timing.field_m = "
                f"{scenario.timing.field_m:g}, in turbulence by {LOWEST_M:.3g} m, got {h:g}"
            )
    for i, spec in enumerate(scenario.manoeuvre):
        key = f"manoeuvre[{i}]"
        attempt(key, build, spec.input, spec.duration_s, aircraft.rate_hz)
        if scenario.flown_by == "autopilot":
            attempt(
                f"{key} at autopilot.period_ms", build, spec.input, spec.duration_s, 1e3 / scenario.autopilot.period_ms
            )
        for k, entry in enumerate(spec.input):
            unit = "amplitude_percent" if entry.control == "thr" else "amplitude_deg"
            attempt(f"{key}.input[{k}].{unit}", check_amplitude, aircraft, entry.control, entry.amplitude)
        known = parameter_names([*aircraft.controls], spec.plane, elastic_modes(aircraft, spec.plane))
        for where in ("accuracy_percent", "estimated"):
            for name in getattr(spec, where):
                if name not in known:
                    faults.append(
                        f"{scenario.file}, {key}.{where}: a parameter of the {spec.plane} motion of {aircraft.name} is "
                        f"needed, got '{name}'{nearest(name, known)}"
                    )
    return faults
