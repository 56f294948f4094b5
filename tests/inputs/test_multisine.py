"""Multisines: lines where they should be, small peaks, orthogonal on several controls."""

import numpy as np
import pytest

from testbench.core.errors import ScenarioError
from testbench.core.scenario.inputs import Multisine
from testbench.inputs import build
from testbench.inputs.multisine import harmonics, multisine, phases


def spec(**other):
    keys = {"f_min_hz": 0.1, "f_max_hz": 2.0, "period_s": 10.0, "control": "de", "amplitude_deg": 2.0, **other}
    return Multisine(signal="multisine", **keys)


def test_energy_sits_on_the_harmonics_and_nowhere_else():
    u = multisine(spec(stride=3, first=1), 10.0, 100.0)
    lines = np.abs(np.fft.rfft(u))
    on = np.zeros(lines.size, bool)
    on[list(harmonics(spec(stride=3, first=1)))] = True
    assert harmonics(spec(stride=3, first=1)) == (2, 5, 8, 11, 14, 17, 20)
    assert lines[~on].max() < 1e-12 * lines[on].max()
    assert np.ptp(lines[on]) < 1e-10 * lines[on].max(), "equal power"


def test_powers_shape_the_lines():
    wanted = (4.0, 1.0, 0.0, 9.0)
    u = multisine(spec(f_max_hz=0.4, powers=wanted), 10.0, 100.0)
    lines = np.abs(np.fft.rfft(u))[1:5]
    np.testing.assert_allclose(lines / lines[1], np.sqrt(wanted), atol=1e-12)


def relative_peak_factor(u):
    """Return (max - min) / (2 sqrt(2) rms) of a signal (n,): 1 for a sine."""
    return float(np.ptp(u) / (2.0 * np.sqrt(2.0) * np.sqrt(np.mean(u**2))))


@pytest.mark.parametrize(("f_max", "period"), [(3.0, 4.0), (2.0, 10.0), (2.0, 30.0)])
def test_phases_bring_the_relative_peak_factor_to_that_of_a_sine(f_max, period):
    chosen = spec(f_max_hz=f_max, f_min_hz=1.0 / period, period_s=period)
    u = multisine(chosen, period, 200.0)
    numbers = np.array(harmonics(chosen))
    random = np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, numbers.size)
    t = 2.0 * np.pi * np.arange(u.size) / u.size
    by_chance = np.cos(np.outer(t, numbers) + random).sum(axis=1)
    # a sine has 1; Schroeder's phases alone give 1.1 to 1.2, random ones more
    assert relative_peak_factor(u) < 1.05 < relative_peak_factor(by_chance)
    assert abs(u[0]) < 1e-9 * np.abs(u).max(), "starts at zero"


def test_multisines_of_different_first_are_orthogonal():
    signals = build(
        [spec(stride=3, first=0), spec(stride=3, first=1, control="da"), spec(stride=3, first=2, control="dr")],
        10.0,
        100.0,
    )
    gram = signals.u.T @ signals.u
    size = np.sqrt(np.diag(gram))
    np.testing.assert_allclose(gram / np.outer(size, size), np.eye(3), atol=1e-12)


def test_periods_repeat():
    u = multisine(spec(periods=2), 25.0, 100.0)
    np.testing.assert_array_equal(u[:1000], u[1000:2000])
    assert not u[2000:].any()


def test_phases_are_the_same_each_time():
    phases.cache_clear()
    first = phases((1, 2, 3, 5)).tobytes()
    phases.cache_clear()
    assert phases((1, 2, 3, 5)).tobytes() == first


@pytest.mark.parametrize(
    ("change", "law"),
    [
        ({"f_min_hz": 0.11, "f_max_hz": 0.19}, "needs a harmonic"),
        ({"period_s": 10.003}, "whole number of samples at 100 Hz.*take 10 s"),
        ({"f_max_hz": 11.0}, "f_max_hz <= rate / 10"),
        ({"powers": (1.0, 2.0)}, "one entry per harmonic, 20, got 2"),
        ({"powers": (0.0,) * 20}, "at least one entry of powers"),
    ],
)
def test_laws(change, law):
    with pytest.raises(ScenarioError, match=law):
        multisine(spec(**change), 20.0, 100.0)
