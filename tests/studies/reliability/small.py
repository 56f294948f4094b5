"""Small cases of the commands that are killed: seconds each, through the code that large ones go through."""

from __future__ import annotations

PLAN = """
title = "One card"
aircraft = "taurus"
seed = 1
flown_by = "pilot"
speeds_m_s = [12.0]
heights_m = [100.0]
suite = "taurus_8hz"
uncertainty_percent = 15.0
limits = { speed_change_m_s = 4.0 }
timing = { turn_s = 45.0, overhead_s = 120.0 }
energy = { kind = "battery", capacity_Wh = 24.4, efficiency_percent = 45.0, source = "estimated" }

[[manoeuvre]]
name = "elevator doublet"
duration_s = 6.0
repeats = 2
[[manoeuvre.input]]
signal = "doublet"
control = "de"
amplitude_deg = 2.0
period_s = 2.0
pilot = { rise_s = 0.2, shortest_s = 1.0 }
"""
GAP = """
title = "Thrust above the centre of gravity"
aircraft = "taurus"
wings = "rigid"
suite = "taurus_8hz"
seed = 1
effects = ["thrust_line"]
condition = { V_m_s = 13.0, h_m = 100.0 }
hidden = { kind = "high_thrust", offset_m = 0.05 }

[[manoeuvre]]
name = "throttle doublet"
use = "identification"
duration_s = 5.0
input = [{ signal = "doublet", control = "thr", amplitude_percent = 15.0, period_s = 3.0 }]

[[manoeuvre]]
name = "elevator and throttle"
use = "validation"
duration_s = 5.0
input = [
  { signal = "doublet", control = "de", amplitude_deg = 1.5, period_s = 2.0 },
  { signal = "pulse", control = "thr", amplitude_percent = 15.0, width_s = 2.0, start_s = 2.5 },
]
"""
BLIND = ("--strata", "nothing=3", "--effects", "thrust_line")
"""Three cases, in which one effect is sought."""
