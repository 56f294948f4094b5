"""The sweep's frequency, its energy and its laws."""

import numpy as np
import pytest

from testbench.core.constants import DEG_RAD
from testbench.core.errors import ScenarioError
from testbench.core.scenario.inputs import Sweep
from testbench.inputs import band_share, build
from testbench.inputs.sweep import sweep, swept_sine


def spec(**changes: object) -> Sweep:
    keys: dict = {"control": "de", "amplitude_deg": 2.0, "f_start_hz": 0.1, "f_end_hz": 5.0, "sweep_s": 40.0}
    return Sweep(signal="sweep", **(keys | changes))


@pytest.mark.parametrize("spacing", ["linear", "exponential"])
def test_frequency_follows_its_law(spacing: str) -> None:
    # zero crossings of sin(phi) are half a cycle apart: between two of them the mean frequency is 1 / (2 gap)
    tau = np.linspace(0.0, 40.0, 400_001)
    u = swept_sine(tau, 0.1, 5.0, 40.0, spacing)  # type: ignore[arg-type]
    down = np.flatnonzero((u[:-2] > 0.0) != (u[1:-1] > 0.0))
    crossing = tau[down] - u[down] * (tau[down + 1] - tau[down]) / (u[down + 1] - u[down])
    middle, frequency = 0.5 * (crossing[1:] + crossing[:-1]), 0.5 / np.diff(crossing)
    law = 0.1 + 4.9 * middle / 40.0 if spacing == "linear" else 0.1 * 50.0 ** (middle / 40.0)
    late = middle > 10.0  # early half cycles are long, the law's curvature over them is not small
    np.testing.assert_allclose(frequency[late], law[late], rtol=3e-3)


def test_linear_sweep_spreads_its_energy_evenly_over_frequency_and_exponential_over_octaves() -> None:
    rate = 100.0
    for spacing, bands in (("linear", [(1.0, 2.0), (3.0, 4.0)]), ("exponential", [(0.4, 0.8), (2.0, 4.0)])):
        u = sweep(spec(spacing=spacing, sweep_s=200.0), 200.0, rate)
        low, high = (band_share(u, 1.0 / rate, 2 * np.pi * a, 2 * np.pi * b)[0] for a, b in bands)
        # Fresnel ripples at the band edges: a few percent for 200 cycles or more
        assert low == pytest.approx(high, rel=0.05)


def test_sweep_is_sampled_exactly_from_its_own_start() -> None:
    made = build([spec(start_s=1.3)], 50.0, 100.0)
    t = made.t_s - 1.3
    expected = np.zeros(5000)
    expected[130:4130] = (
        2.0 * DEG_RAD * np.sin(2 * np.pi * 0.1 * 40.0 / np.log(50.0) * (50.0 ** (t[130:4130] / 40.0) - 1.0))
    )
    np.testing.assert_allclose(made.u[:, 0], expected, atol=1e-12)


def test_sweep_is_zero_before_and_after() -> None:
    u = build([spec(start_s=2.0)], 50.0, 100.0).u[:, 0]
    assert not u[:201].any()
    assert not u[4200:].any()
    assert u[201:4200].any()


@pytest.mark.parametrize("start_s", [0.56, 1.1, 1.12])
def test_sweep_gains_no_sample_to_the_last_digit(start_s: float) -> None:
    # start_s * 50 Hz falls just above a whole number: the sample at the end then seems to lie within the sweep
    u = build([spec(start_s=start_s, sweep_s=0.5)], 3.0, 50.0).u[:, 0]
    first = round(start_s * 50.0)
    assert u[first + 24] != 0.0
    assert not u[first + 25 :].any()


def test_fade_brings_both_ends_to_zero_and_leaves_the_middle() -> None:
    tau = np.arange(4000) / 100.0
    plain, faded = swept_sine(tau, 0.1, 5.03, 40.0), swept_sine(tau, 0.1, 5.03, 40.0, fade_s=2.0)
    np.testing.assert_array_equal(faded[200:3800], plain[200:3800])
    assert np.all(np.abs(faded) <= np.abs(plain))
    assert abs(faded[-1]) < 1e-3  # (1 - cos(pi 0.01 / 2)) / 2 = 6e-5 of the sine


def test_end_frequency_above_a_tenth_of_the_rate_is_refused() -> None:
    assert build([spec(f_end_hz=10.0)], 40.0, 100.0).u.any()
    with pytest.raises(ScenarioError, match=r"f_end_hz <= rate / 10 = 10 Hz .* got 12 Hz at 100 Hz.* 120 Hz or more"):
        build([spec(f_end_hz=12.0)], 40.0, 100.0)


def test_the_law_keeps_the_amplitude_of_the_fundamental() -> None:
    # held at 10 samples per cycle the fundamental keeps sinc(1/10) = 0.984
    n = 1000
    u = np.sin(2 * np.pi * np.arange(n) / 10.0)
    t = (np.arange(50 * n) + 0.5) / 50.0
    fundamental = 2.0 * abs(np.mean(np.repeat(u, 50) * np.exp(-2j * np.pi * t / 10.0)))
    assert fundamental == pytest.approx(np.sinc(0.1), abs=1e-4)
    assert fundamental > 0.98


def test_every_fault_of_a_sweep_is_reported() -> None:
    with pytest.raises(ScenarioError) as caught:
        build([spec(f_start_hz=30.0, f_end_hz=20.0, start_s=20.0)], 40.0, 100.0)
    assert len(caught.value.faults) == 3
    assert "0 < f_start_hz < f_end_hz" in str(caught.value)
    assert "got an end at 60 s" in str(caught.value)


def test_fade_may_not_exceed_half_the_sweep() -> None:
    with pytest.raises(ScenarioError, match="fade_s <= sweep_s / 2"):
        swept_sine(np.arange(10.0), 0.1, 1.0, 10.0, fade_s=6.0)
