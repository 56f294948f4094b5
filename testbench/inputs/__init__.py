"""The input signals, one file per family, and the sum of those in a manoeuvre."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from testbench.core.channels import CONTROLS
from testbench.core.door import NUMBER, require_room
from testbench.core.errors import ScenarioError
from testbench.core.record import FloatArray
from testbench.core.scenario.inputs import Input
from testbench.inputs import binary, multisine, multistep, sweep
from testbench.inputs.signal import InputSignal, band_share, energy_spectrum, frequency_below, total_energy

__all__ = ["FAMILIES", "InputSignal", "band_share", "build", "energy_spectrum", "frequency_below", "total_energy"]

FAMILIES: dict[str, tuple[Callable[[Any, float, float], FloatArray], str]] = {
    "step": (multistep.step, "one step that lasts until the end of the manoeuvre"),
    "pulse": (multistep.pulse, "one rectangular pulse"),
    "doublet": (multistep.doublet, "one or several doublets: up for half a period, down for the other half"),
    "3211": (multistep.standard_multistep, "the 3-2-1-1: steps of alternating sign that last 3, 2, 1 and 1 units"),
    "211": (multistep.standard_multistep, "the 2-1-1: steps of alternating sign that last 2, 1 and 1 units"),
    "123": (multistep.standard_multistep, "the 1-2-3: steps of alternating sign that last 1, 2 and 3 units"),
    "multistep": (multistep.multistep, "any sequence of signed steps"),
    "sweep": (sweep.sweep, "a sine of rising frequency, linear or exponential in time"),
    "multisine": (multisine.multisine, "harmonics with phases for the least peak; orthogonal ones on several controls"),
    "prbs": (binary.prbs, "a pseudo-random binary sequence of maximal length"),
    "gbn": (binary.binary_noise, "generalised binary noise: the sign changes with a given probability per step"),
}
"""Signal name in a scenario -> (function of the scenario's entry, duration in s and rate in Hz; what it is)."""


def build(inputs: Sequence[Input], duration_s: float, rate_hz: float) -> InputSignal:
    """Return the sum of the inputs of a manoeuvre, sampled at the simulation rate and held.

    The signal has ``duration_s * rate_hz`` samples, to the nearest one: sample k holds from k / rate to (k + 1) / rate,
    and the last one ends with the manoeuvre. Inputs on the same control add up. Controls stand in the order of
    :data:`testbench.core.channels.CONTROLS`, whatever the order of the inputs.

    Args:
        inputs: entries ``manoeuvre.input`` of a scenario, at least one.
        duration_s: duration of the manoeuvre after settling, s.
        rate_hz: simulation rate, Hz.

    Raises:
        ScenarioError: no input, a manoeuvre shorter than two samples, or an input that breaks a law of its family;
            the faults of all inputs are listed, each with its number.
        SizeError: the signal takes more memory than the limit of :mod:`testbench.core.door`.
    """
    if not inputs:
        raise ScenarioError("a manoeuvre must have at least one input, got none")
    names = tuple(name for name in CONTROLS if any(spec.control == name for spec in inputs))
    require_room(
        f"an input of {duration_s:g} s at {rate_hz:g} Hz",
        NUMBER * duration_s * rate_hz * (len(names) + 1),
        "shorten it (duration_s)",
    )
    if not (rate_hz > 0.0 and multistep.sample_count(duration_s, rate_hz) >= 2):
        raise ScenarioError(
            f"a manoeuvre must last at least 2 samples, got duration_s = {duration_s:g} at a rate of {rate_hz:g} Hz"
        )
    n = multistep.sample_count(duration_s, rate_hz)
    u = np.zeros((n, len(names)))
    faults: list[str] = []
    for i, spec in enumerate(inputs):
        function, _ = FAMILIES[spec.signal]
        try:
            u[:, names.index(spec.control)] += function(spec, duration_s, rate_hz)
        except ScenarioError as error:
            faults.extend(f"input[{i}] ({spec.signal} on {spec.control}): {fault}" for fault in error.faults)
    if faults:
        raise ScenarioError(faults)
    return InputSignal(np.arange(n) / rate_hz, u, names)
