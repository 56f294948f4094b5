"""Elastic modes in air that lags: the wake of R. T. Jones as states beside those of a linear model.

The circulatory lift of a section follows its incidence at the three-quarter chord by Theodorsen's function of the
reduced frequency (T. Theodorsen, NACA report 496, 1935). For a step that is Wagner's function, and R. T. Jones (NACA
report 681, 1940) gave it as phi = 1 - 0.165 exp(-0.0455 s) - 0.335 exp(-0.3 s), s the way flown in half chords b. Each
mode takes the circulatory part u of its generalised force through it,

    Q = (1 - 0.165 - 0.335) u + 0.165 y1 + 0.335 y2,    y' = p V/b (u - y),  p = 0.0455, 0.3,

b half the mean chord: two states for each mode. What follows the motion at once, the lift of a section that rotates
(``force_rotary``), does not lag. The apparent mass of the air is in frequencies and generalised masses that a test on
the ground finds. Flights in JSBSim are quasi-steady: this is for linear models.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from testbench.aircraft.elastic import ElasticModel
from testbench.core.record import FloatArray

LAGS = ((0.165, 0.0455), (0.335, 0.3))
UNSTEADY = 0.1
"""Reduced frequency w cbar/2V beyond which air is taken to lag."""


def reduced_frequency(elastic: ElasticModel, number: int, V_m_s: float) -> float:
    """Return w cbar/2V of a mode's natural frequency."""
    return elastic.modes[number - 1].omega_rad_s * elastic.cbar_m / (2.0 * V_m_s)


def with_wake(
    A: FloatArray, states: Sequence[str], elastic: ElasticModel, qbar_Pa: float, V_m_s: float, share: float = 1.0
) -> FloatArray:
    """Return A (n + 2 m, n + 2 m) of a linear model with the wake of its m modes; their states come last.

    Args:
        A: (n, n) of the quasi-steady model.
        states: (n,) names; eta_i and etadot_i of the modes.
        elastic: the modes.
        qbar_Pa: dynamic pressure of the model.
        V_m_s: its airspeed.
        share: of the lag that there is: 0 leaves the poles of ``A`` as they are.
    """
    numbers = [int(s.removeprefix("etadot_")) for s in states if s.startswith("etadot_")]
    n, gain = len(states), elastic.matrices(qbar_Pa, V_m_s)[2]
    out = np.zeros((n + 2 * len(numbers),) * 2)
    out[:n, :n] = A
    for k, i in enumerate(numbers):
        mode, row = elastic.modes[i - 1], states.index(f"etadot_{i}")
        at_once = {f"eta_{i}": -(mode.omega_rad_s**2), f"etadot_{i}": -2.0 * mode.zeta * mode.omega_rad_s}
        for j, c in mode.force_rotary.items():
            name = f"etadot_{j}"
            at_once[name] = at_once.get(name, 0.0) + float(gain[i - 1]) * c * elastic.cbar_m / (2.0 * V_m_s)
        u = A[row].copy()
        for name, value in at_once.items():
            if name in states:
                u[states.index(name)] -= value
        for lag, (a, p) in enumerate(LAGS):
            y = n + 2 * k + lag
            out[row, :n] -= share * a * u
            out[row, y] = share * a
            rate = p * 2.0 * V_m_s / elastic.cbar_m
            out[y, :n], out[y, y] = rate * u, -rate
    return out
