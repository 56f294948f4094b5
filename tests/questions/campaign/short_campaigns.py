"""The campaign of the tests: short flights of a small aircraft."""

SHORT = """
title = "Short flights"
seed = 5
{head}
[vary]
"condition.V_m_s" = {{ kind = "normal", mean = 13.0, std = 0.3 }}
"coefficient.Cm_alpha" = {{ kind = "lognormal", median = 1.0, sigma = 0.1 }}
"sensor.q.scale" = {{ kind = "uniform", low = 0.98, high = 1.02 }}
{vary}
[scenario]
title = "Taurus, 6 s"
aircraft = "taurus"
suites = ["taurus_8hz"]
condition = {{ V_m_s = 13.0, h_m = 100.0 }}
simulation = {{ log_rate_hz = 40.0 }}
[[scenario.manoeuvre]]
name = "doublet"
use = "split"
duration_s = 5.0
settle_s = 1.0
input = [{{ signal = "doublet", control = "de", amplitude_deg = 1.5, period_s = 1.5, repeats = 2, spacing_s = 2.5 }}]
[scenario.identification]
inputs = ["de_cmd"]
outputs = ["theta", "q"]
estimators = [{{ method = "transfer_function", poles = 2, zeros = [0, 1] }}]
"""
