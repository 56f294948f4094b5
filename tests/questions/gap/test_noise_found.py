"""The noise that records show: its size and its colour, beside what the model lacks, and names that stand in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_flights import believe, measure
from scipy.signal import lfilter

from testbench.effects import EFFECTS
from testbench.questions.gap.evidence.noise_found import NoiseFound, find_noise
from testbench.questions.gap.workflow import GapSearch, find_gap

FEW = {n: EFFECTS[n] for n in ("actuator_lag", "alpha_scale", "q_scale", "mass_error")}


@pytest.fixture(scope="module")
def believed():
    return believe()


def noisy(believed, hidden, seed, size, colour):
    """Return records of an aircraft with a slow servo, if ``hidden``, in noise of another size and colour."""
    flies = believed.with_effect(EFFECTS["actuator_lag"], {"lag_rad_s": 6.0}) if hidden else believed
    sensors = tuple(replace(s, noise_std=1e-3 * s.noise_std) for s in flies.suite.sensors)
    rng, out = np.random.default_rng(seed), []
    for record in measure(replace(flies, suite=replace(flies.suite, sensors=sensors)), seed):
        noise = {
            n: size * std * np.sqrt(1.0 - colour**2) * lfilter([1.0], [1.0, -colour], rng.standard_normal(len(record)))
            for n, std in zip(believed.outputs, believed.noise_std, strict=True)
        }
        out.append(record.with_columns({n: record[n] + e for n, e in noise.items()}))
    return out


@pytest.mark.parametrize(("size", "colour"), [(0.7, 0.0), (1.3, 0.5)])
def test_size_and_colour_are_found_beside_what_acts(believed, size, colour):
    """Standard errors are some 0.02 of each: 0.1 is not exceeded by any of five channels but in one of 10^5.

    That the servo is slow need not be known: deflections that no command explains are no noise.
    """
    records = noisy(believed, True, 3, size, colour)
    before = find_noise(believed, records)
    found = find_noise(believed, records, model=believed.with_effect(EFFECTS["actuator_lag"], {"lag_rad_s": 6.0}))
    for n in believed.outputs:
        assert before.scales[n][0] == pytest.approx(size, rel=0.1), n
        assert found.scales[n][0] == pytest.approx(size, rel=0.1), n
        assert found.colour.get(n, 0.0) == pytest.approx(colour, abs=0.1), n
    assert ("correlated" in found.sentence) == (colour > 0.0)


def test_turbulence_is_no_noise():
    """Of a rms of 0.3 m/s, which moves q of a small aircraft by more than its noise does; errors as above."""
    believed = believe("taurus")
    records = measure(believed, 5, 0.3)
    still = measure(believed, 5)
    moved = [np.std(r["q"] - s["q"]) for r, s in zip(records, still, strict=True)]
    assert min(moved) > believed.suite.noise_std["q"]
    found = find_noise(believed, records)
    for n in believed.outputs:
        assert found.scales[n][0] == pytest.approx(1.0, rel=0.1), n
        assert abs(found.colour.get(n, 0.0)) < 0.1, n


def test_estimates_differ_by_more_than_their_errors_and_what_is_open_anyway():
    """Errors are 0.02 each; noise that was measured leaves 5 % open, three errors of a difference are 8 %."""
    one = NoiseFound({"q": (1.0, 0.02)}, {"q": 0.3})
    assert not one.differs(NoiseFound({"q": (1.07, 0.02)}, {"q": 0.35}))
    assert one.differs(NoiseFound({"q": (1.1, 0.02)}, {"q": 0.3}))
    assert one.differs(NoiseFound({"q": (1.0, 0.02)}, {"q": 0.5}))


@pytest.mark.parametrize("hidden", [pytest.param(True, marks=pytest.mark.slow), False])
def test_coloured_noise_is_neither_a_gap_nor_hides_one(believed, hidden):
    """White noise of the same size would be exceeded at low frequencies by half; the name is the whole story."""
    records = {str(i): r for i, r in enumerate(noisy(believed, hidden, 11, 1.2, 0.5))}
    found = find_gap(believed, records, {}, GapSearch(effects=FEW, noise="stated"))
    assert (found.naming.names, found.naming.outcome) == ((("actuator_lag",), "named") if hidden else ((), "no gap"))
    assert found.naming.weighed.unknown < 0.1
