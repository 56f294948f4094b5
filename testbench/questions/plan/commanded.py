"""What is commanded in a planned manoeuvre: by hand as it is drawn, by a script sampled and held at its period."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from testbench.core.scenario.inputs import Input
from testbench.inputs import InputSignal, build


def commanded(inputs: Sequence[Input], duration_s: float, rate_hz: float, period_ms: int | None = None) -> InputSignal:
    """Return the commands at the rate of the simulator, deviations from trim, SI.

    Args:
        inputs: of the manoeuvre.
        duration_s: of the manoeuvre.
        rate_hz: of the simulator.
        period_ms: of the script that sends them: each value holds until the next one is sent; None for a pilot.

    Raises:
        ScenarioError: the inputs break a law, or cannot be sampled at the period.
    """
    if period_ms is None:
        return build(inputs, duration_s, rate_hz)
    sent = build(inputs, duration_s, 1e3 / period_ms)
    t = np.arange(round(duration_s * rate_hz)) / rate_hz
    row = np.minimum(np.floor(t * 1e3 / period_ms + 1e-6).astype(int), len(sent.u) - 1)
    return InputSignal(t, sent.u[row], sent.channels)
