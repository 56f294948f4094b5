"""A short period whose derivatives may vary, and its linear fit, for several files here."""

import numpy as np

import testbench as tb

RATE, FINE = 50.0, 10
TRUE = {"M_alpha": -12.0, "M_q": -4.0, "M_de": -20.0}


def pulses(size, t):
    u = np.zeros(t.size)
    for at, width, sign in (
        (1.0, 0.9, 1),
        (1.9, 0.6, -1),
        (2.5, 0.3, 1),
        (2.8, 0.3, -1),
        (7.0, 0.9, -1),
        (7.9, 0.6, 1),
    ):
        u[(t >= at) & (t < at + width)] = size * sign
    return u


def flown(size=0.12, bend=0.0, square=0.0, seed=1, noise=1.0, pressure=0.0, M_alpha=-12.0, shift=0.0):
    """Return 14 s of a short period whose derivatives are (1 + bend a + square a^2) of those at trim, a = alpha / 0.1.

    ``pressure`` is the amplitude of a swing of dynamic pressure that they follow; ``shift`` is added to M_alpha for
    every 0.1 rad, as by a neutral point that moves.
    """
    t = np.arange(round(14.0 * RATE * FINE)) / RATE / FINE
    u, x, y = pulses(size, t), np.zeros(2), np.zeros((t.size // FINE, 2))
    share = pressure * np.sin(0.6 * t)
    for k in range(t.size):
        if k % FINE == 0:
            y[k // FINE] = x
        a, q = x
        s = (1.0 + bend * a / 0.1 + square * (a / 0.1) ** 2) * (1.0 + share[k])
        M = s * ((M_alpha + shift * a / 0.1) * a - 4.0 * q - 20.0 * u[k])
        x = x + np.array([-2.0 * s * a + q - 0.2 * s * u[k], M]) / RATE / FINE
    rng = np.random.default_rng(seed)
    y = y + noise * np.array([1e-3, 2e-3]) * rng.standard_normal(y.shape)
    V = 50.0 * np.sqrt(1.0 + share[::FINE])
    columns = np.column_stack([y, u[::FINE], V - 50.0])
    trim = {"prepared": {"removed": {"V": 50.0}}}
    return tb.FlightRecord(t[::FINE], ("alpha", "q", "de", "V"), columns, "measured", provenance=trim)


def fitted(record):
    return tb.estimate("output_error", [record], ["de"], ["alpha", "q"], structure="short_period", held=["de"])
