"""Flights that several files here share: short ones of the rigid EOLO, in still or moving air, without any effect."""

from __future__ import annotations

import numpy as np

from testbench.core.record import FlightRecord
from testbench.core.scenario.inputs import Doublet, StandardMultistep
from testbench.flight import FlightCondition, Manoeuvre, fly, load_aircraft, trim
from testbench.flight.air import Air, turbulence_rms
from testbench.inputs import build
from testbench.inputs.signal import InputSignal
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.name import Sought, name_effect
from testbench.sensors import load_suite

CONDITION = FlightCondition(16.0, 547.0)
ELEVATOR = StandardMultistep(signal="3211", control="de", amplitude_deg=2.0, step_s=0.4)
THROTTLE = Doublet(signal="doublet", control="thr", amplitude_percent=15.0, period_s=4.0)


def believe(wings: str = "rigid") -> Believed:
    """Return the EOLO and its gap suite at 16 m/s."""
    aircraft = load_aircraft("eolo", wings)
    return Believed(aircraft, load_suite("eolo_gap"), CONDITION, aircraft.rate_hz)


def measure(
    truth: Believed, seed: int, rms_m_s: float = 0.0, inputs=(ELEVATOR, THROTTLE), duration_s: float = 12.0
) -> list[FlightRecord]:
    """Fly one manoeuvre per input with ``truth`` in turbulence of a vertical rms, and measure it with its sensors."""
    trimmed = trim(truth.aircraft, truth.condition, truth.rate_hz)
    records = []
    for i, spec in enumerate(inputs):
        coarse = build((spec,), duration_s, truth.suite.rate_hz)
        u = np.repeat(coarse.u, round(truth.rate_hz / truth.suite.rate_hz), axis=0)
        signal = InputSignal(np.arange(len(u)) / truth.rate_hz, u, coarse.channels)
        air = Air(turbulence_rms_m_s=turbulence_rms(rms_m_s, CONDITION.h_m), seed=seed + i) if rms_m_s else None
        flown = fly(truth.aircraft, trimmed, Manoeuvre(f"m{i}", signal, 2.0), truth.suite.rate_hz, None, air)
        records.append(truth.suite.measure(flown, seed + i))
    return records


def among(effects, pairs=False):
    """Return a search among ``effects`` only, to be patched in place of ``workflow.name_effect``; all if None."""
    return lambda believed, records, what, say=None: name_effect(
        believed, records, Sought(effects, pairs=pairs and what.pairs, source=what.source), say
    )
