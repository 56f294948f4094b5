"""Two errors of one sensor, of which the first explains nearly all and leaves more than its form may."""

from __future__ import annotations

import numpy as np
from axes import believe, commands

from testbench.core.record import FlightRecord
from testbench.effects import library
from testbench.questions.gap.name import Sought, name_effect


def test_a_lag_and_a_delay_of_one_attitude_are_named_with_both_sizes():
    """The lag alone gains 97 % of what both do: the delay had to gain a twentieth of that, and nothing was named.

    Each size is off by four standard errors once in 16 000 cases. All axes, with fourteen coefficients: seven seconds.
    """
    believed = believe()
    known = library(believed.suite, believed.aircraft)
    late = believed.with_effect(known["phi_lag"], {"lag_s": 0.3}).with_effect(known["phi_delay"], {"delay_s": 0.085})
    rng = np.random.default_rng(1)
    flown = []
    for command in commands():
        read = late.predict(command)
        read = read + rng.normal(size=read.shape) * late.noise_std
        channels = (*command.channels, *late.outputs)
        flown.append(FlightRecord(command.t_s, channels, np.column_stack([command.data, read]), "measured"))
    few = {n: known[n] for n in ("phi_lag", "phi_delay", "phi_scale", "p_lag")}
    naming = name_effect(believed, flown[:2], Sought(few))
    assert naming.names[0] == "phi_lag + phi_delay", naming.sentence
    for name, true in (("phi_lag.lag_s", 0.3), ("phi_delay.delay_s", 0.085)):
        assert abs(naming.best.values[name] - true) < 4.0 * naming.best.errors[name]
