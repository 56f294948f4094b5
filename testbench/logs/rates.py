"""Whether a log is dense enough in time to identify from, and what to set if it is not."""

from __future__ import annotations

from collections.abc import Iterable

from testbench.logs.clocks import usual_step
from testbench.logs.signals import Log, Rule

SAMPLES = 25.0
"""Samples in a period of the fastest motion of interest (Morelli and Klein, Aircraft System Identification, 2nd ed.,
sec. 9.2.4)."""
FASTEST_HZ = 2.0
"""The fastest rigid motion of interest: short period and Dutch roll of small aircraft lie below it."""
_ENOUGH = 0.8  # of that rate: loggers jitter
_LOOKED_AT = ("p", "q", "r", "az", "theta", "phi", "de_cmd", "da_cmd", "dr_cmd")


def too_slow(log: Log, rules: Iterable[Rule], better: str) -> list[str]:
    """Return a sentence on the channels that were logged too slowly, with the settings that log faster; else none.

    A channel is too slow below 40 Hz: 25 samples in a period of 2 Hz, less a fifth.
    """
    rates: dict[str, float] = {}
    for rule in rules:
        topic = log.topics.get(log.preferred.get(rule.topic, (rule.topic,))[0])
        usable = topic is not None and topic.t_s.size > 1 and set(rule.fields) <= set(topic.columns)
        if topic is not None and usable and rule.channel in _LOOKED_AT and rule.channel not in rates:
            rates[rule.channel] = 1.0 / usual_step(topic.t_s)
    slow = {name: rate for name, rate in rates.items() if rate < _ENOUGH * SAMPLES * FASTEST_HZ}
    if not slow:
        return []
    told = ", ".join(f"{name} {rate:.3g} Hz" for name, rate in slow.items())
    reach = min(slow.values()) / SAMPLES
    return [
        f"logged slowly: {told}. With {SAMPLES:g} samples in a period, motion above {reach:.2g} Hz is not well "
        f"resolved; a short period needs {SAMPLES * FASTEST_HZ:g} Hz. To log faster set {better}"
    ]
