"""Edges, levels and laws of the stepped inputs.

Steps flown by hand: ramps, scattered edges, and a shortest step.

Binary signals: every register runs through its whole period; binary noise switches as often as it says.
"""

import numpy as np
import pytest

from testbench.core.constants import DEG_RAD, PERCENT
from testbench.core.errors import ScenarioError
from testbench.core.scenario.inputs import BinaryNoise, Doublet, Multistep, Pilot, Prbs, Pulse, StandardMultistep, Step
from testbench.inputs import build
from testbench.inputs.binary import binary_noise, prbs, prbs_bits

DE = {"control": "de", "amplitude_deg": 2.0}


def levels(spec: object, duration_s: float = 20.0, rate_hz: float = 100.0) -> list[tuple[float, int]]:
    """Return the signal as runs (level in units of the amplitude, samples)."""
    u = build([spec], duration_s, rate_hz).u[:, 0] / (2.0 * DEG_RAD)  # type: ignore[list-item]
    edges = np.flatnonzero(np.diff(u)) + 1
    parts = np.split(u, edges)
    return [(round(float(part[0]), 12), part.size) for part in parts]


def test_step() -> None:
    assert levels(Step(signal="step", start_s=5.0, **DE)) == [(0.0, 500), (1.0, 1500)]


def test_pulse() -> None:
    assert levels(Pulse(signal="pulse", start_s=1.0, width_s=0.5, **DE)) == [(0.0, 100), (1.0, 50), (0.0, 1850)]


def test_doublet_is_up_then_down() -> None:
    spec = Doublet(signal="doublet", start_s=1.0, period_s=2.0, **DE)
    assert levels(spec) == [(0.0, 100), (1.0, 100), (-1.0, 100), (0.0, 1700)]


def test_doublets_repeat_every_two_periods_by_default() -> None:
    spec = Doublet(signal="doublet", start_s=1.0, period_s=2.0, repeats=3, **DE)
    pair = [(1.0, 100), (-1.0, 100)]
    assert levels(spec) == [(0.0, 100), *pair, (0.0, 200), *pair, (0.0, 200), *pair, (0.0, 900)]


def test_doublets_may_follow_without_a_gap() -> None:
    spec = Doublet(signal="doublet", start_s=0.0, period_s=2.0, repeats=2, spacing_s=2.0, **DE)
    assert levels(spec) == [(1.0, 100), (-1.0, 100), (1.0, 100), (-1.0, 100), (0.0, 1600)]


def test_doublets_may_not_overlap() -> None:
    spec = Doublet(signal="doublet", period_s=2.0, repeats=2, spacing_s=1.5, **DE)
    with pytest.raises(ScenarioError, match=r"spacing_s >= period_s must hold .* got 1\.5 and 2 s"):
        build([spec], 20.0, 100.0)


def test_as_many_doublets_as_the_manoeuvre_has_room_for() -> None:
    spec = Doublet(signal="doublet", period_s=0.02, repeats=2, spacing_s=0.02, **DE)
    assert levels(spec, 0.04) == [(1.0, 1), (-1.0, 1), (1.0, 1), (-1.0, 1)]
    with pytest.raises(ScenarioError, match=r"must end within duration_s = 0\.04 s .* got an end at 0\.1 s"):
        build([spec.model_copy(update={"repeats": 5})], 0.04, 100.0)
    with pytest.raises(ScenarioError, match=r"must end within duration_s = 1 s .* got an end at 399 s"):
        build([Doublet(signal="doublet", start_s=1.0, period_s=2.0, repeats=100, **DE)], 1.0, 10.0)


def test_3211() -> None:
    spec = StandardMultistep(signal="3211", start_s=1.0, step_s=0.8, **DE)
    assert levels(spec) == [(0.0, 100), (1.0, 240), (-1.0, 160), (1.0, 80), (-1.0, 80), (0.0, 1340)]


@pytest.mark.parametrize(("signal", "lengths"), [("3211", (3, -2, 1, -1)), ("211", (2, -1, 1)), ("123", (1, -2, 3))])
def test_a_name_gives_the_lengths_of_its_steps(signal: str, lengths: tuple[int, ...]) -> None:
    spec = StandardMultistep(signal=signal, step_s=0.5, **DE)
    runs = [(float(np.sign(p)), 50 * abs(p)) for p in lengths]
    assert levels(spec) == [*runs, (0.0, 2000 - 50 * sum(map(abs, lengths)))]


def test_multistep_with_the_3211_pattern_is_the_3211() -> None:
    pattern = Multistep(signal="multistep", start_s=1.0, step_s=0.37, pattern=(3, -2, 1, -1), **DE)
    assert levels(pattern) == levels(StandardMultistep(signal="3211", start_s=1.0, step_s=0.37, **DE))


def test_multistep_takes_fractions_and_repeated_signs() -> None:
    spec = Multistep(signal="multistep", step_s=1.0, pattern=(-1.5, 0.5, 0.25), **DE)
    assert levels(spec) == [(-1.0, 150), (1.0, 75), (0.0, 1775)]


def test_throttle_amplitude_is_in_fractions() -> None:
    made = build([Pulse(signal="pulse", control="thr", amplitude_percent=20.0, width_s=1.0)], 2.0, 50.0)
    assert made.u.max() == pytest.approx(20.0 * PERCENT, rel=1e-15)


def test_edges_round_to_the_nearest_sample_without_adding_up() -> None:
    # 0.37 s steps at 8 Hz: edges at 2.96 k samples; rounding each length by itself would give 3 k
    spec = Multistep(signal="multistep", step_s=0.37, pattern=(1, -1) * 10, **DE)
    runs = levels(spec, 8.0, 8.0)
    edges = np.cumsum([n for _, n in runs])[:20]
    np.testing.assert_array_equal(edges, np.rint(2.96 * np.arange(1, 21)))


def test_an_edge_halfway_goes_to_the_later_sample_in_spite_of_the_last_digit() -> None:
    # 1.005 s * 100 Hz is 100.49999999999999 in floating point
    assert levels(Pulse(signal="pulse", start_s=1.005, width_s=1.0, **DE))[0] == (0.0, 101)
    assert levels(Pulse(signal="pulse", start_s=0.005, width_s=1.0, **DE))[0] == (0.0, 1)


def test_a_step_of_one_sample_is_the_shortest() -> None:
    assert levels(Pulse(signal="pulse", width_s=0.01, **DE))[0] == (1.0, 1)
    with pytest.raises(ScenarioError, match=r"at least one sample \(0\.01 s at 100 Hz\), got 0\.009 s"):
        build([Pulse(signal="pulse", width_s=0.009, **DE)], 20.0, 100.0)


@pytest.mark.parametrize(
    "spec",
    [
        Pulse(signal="pulse", start_s=9.0, width_s=2.0, **DE),
        Doublet(signal="doublet", start_s=1.0, period_s=2.0, repeats=3, **DE),
        StandardMultistep(signal="3211", start_s=4.0, step_s=1.0, **DE),
        Multistep(signal="multistep", start_s=0.0, step_s=1.0, pattern=(11.0,), **DE),
    ],
)
def test_an_input_may_not_end_after_its_manoeuvre(spec: object) -> None:
    with pytest.raises(ScenarioError, match=r"must end within duration_s = 10 s .* got an end at 11 s"):
        build([spec], 10.0, 100.0)  # type: ignore[list-item]


def test_an_input_may_end_with_its_manoeuvre() -> None:
    # 0.1 + 0.2 > 0.3 in floating point: the last digit must not be an error
    assert levels(Pulse(signal="pulse", start_s=0.1, width_s=0.2, **DE), 0.3) == [(0.0, 10), (1.0, 20)]


def test_a_step_needs_a_sample_of_the_manoeuvre() -> None:
    with pytest.raises(ScenarioError, match=r"start_s <= 9\.99 s.* got 12 s"):
        build([Step(signal="step", start_s=12.0, **DE)], 10.0, 100.0)


BY_HAND = {"control": "de", "amplitude_deg": 1.0, "start_s": 1.0}
RATE = 100.0


def flown(pilot, **other):
    spec = StandardMultistep(signal="3211", step_s=1.0, pilot=pilot, **{**BY_HAND, **other})
    return build([spec], 12.0, RATE).u[:, 0] / spec.amplitude


def test_a_pilot_without_faults_flies_the_exact_steps():
    np.testing.assert_allclose(flown(Pilot()), flown(None), atol=1e-12)


def test_edges_are_ramps_that_begin_at_their_time():
    u = flown(Pilot(rise_s=0.5))
    t = np.arange(u.size) / RATE
    np.testing.assert_allclose(u[(t >= 1.0) & (t <= 1.5)], (t[(t >= 1.0) & (t <= 1.5)] - 1.0) / 0.5, atol=1e-9)
    np.testing.assert_allclose(u[(t > 1.5) & (t <= 4.0)], 1.0, atol=1e-12)
    np.testing.assert_allclose(u[(t >= 4.5) & (t <= 6.0)], -1.0, atol=1e-9)
    np.testing.assert_allclose(u[t >= 8.5], 0.0, atol=1e-9)


def test_jitter_moves_edges_by_its_size_and_is_the_same_for_the_same_seed():
    first = [np.flatnonzero(flown(Pilot(jitter_s=0.1, seed=s)) < 0.0)[0] / RATE - 4.0 for s in range(200)]
    # standard deviation of 200 deviates: 5 % of itself; 4 of those
    assert np.std(first) == pytest.approx(0.1, rel=0.2)
    np.testing.assert_array_equal(flown(Pilot(jitter_s=0.1, seed=3)), flown(Pilot(jitter_s=0.1, seed=3)))


@pytest.mark.parametrize("rise_s", [0.0, 0.25])
def test_every_edge_is_late_by_the_documented_draws_cut_off_at_four_tenths(rise_s):
    jitter = 0.3
    draws = jitter * np.random.default_rng(5).standard_normal(4)
    # of the edges at 4, 6, 7 and 8 s the shorter neighbouring steps last 2, 1, 1 and 1 s
    edges = [
        1.0,
        *(np.array([4.0, 6.0, 7.0, 8.0]) + np.clip(draws, *(np.array([[-0.4], [0.4]]) * [2.0, 1.0, 1.0, 1.0]))),
    ]
    t, expected = np.arange(1200) / RATE, np.zeros(1200)
    for edge, jump in zip(edges, (1.0, -2.0, 2.0, -2.0, 1.0), strict=True):
        expected += jump * (np.clip((t - edge) / rise_s, 0.0, 1.0) if rise_s else t - edge >= 0.0)
    np.testing.assert_allclose(flown(Pilot(jitter_s=jitter, seed=5, rise_s=rise_s)), expected, atol=1e-6)


def test_no_edge_changes_places_however_unsteady_the_pilot():
    for seed in range(50):
        u = flown(Pilot(jitter_s=5.0, seed=seed))
        assert np.count_nonzero(np.diff(u)) == 5, "3-2-1-1 has five edges"


def test_a_pause_between_doublets_stays_a_pause():
    spec = Doublet(signal="doublet", period_s=2.0, repeats=2, spacing_s=4.0, pilot=Pilot(), **BY_HAND)
    exact = spec.model_copy(update={"pilot": None})
    np.testing.assert_allclose(build([spec], 12.0, RATE).u, build([exact], 12.0, RATE).u, atol=1e-15)


def test_a_step_may_last_as_long_as_the_shortest_and_as_its_rise():
    u = flown(Pilot(shortest_s=1.0, rise_s=1.0))
    np.testing.assert_allclose(u[[100, 200, 400, 500, 700, 800, 900]], [0.0, 1.0, 1.0, -1.0, 1.0, -1.0, 0.0], atol=1e-6)


def test_steps_too_short_to_hold_are_refused():
    with pytest.raises(ScenarioError, match=r"at least 2 s .*shortest_s.*got 1 s from t = 6 s"):
        flown(Pilot(shortest_s=2.0))
    with pytest.raises(ScenarioError, match=r"at least 0.6 s"):
        build([Pulse(signal="pulse", width_s=0.5, pilot=Pilot(rise_s=0.6), **BY_HAND)], 12.0, RATE)


@pytest.mark.parametrize("register", range(2, 17))
def test_a_sequence_has_maximal_length_and_the_correlation_of_one(register):
    length = 2**register - 1
    bits = prbs_bits(register, 1, 2 * length)
    np.testing.assert_array_equal(bits[:length], bits[length:])
    spectrum = np.fft.rfft(bits[:length])
    correlation = np.fft.irfft(np.abs(spectrum) ** 2, length) / length
    assert correlation[0] == pytest.approx(1.0)
    np.testing.assert_allclose(correlation[1:], -1.0 / length, atol=1e-10)  # so no shorter period fits into it


def test_prbs_is_clocked():
    spec = Prbs(signal="prbs", step_s=0.2, prbs_s=4.1, bits=5, seed=3, **DE)
    u = prbs(spec, 10.0, 50.0) / spec.amplitude
    np.testing.assert_array_equal(u[:200].reshape(20, 10), np.repeat(prbs_bits(5, 3, 20)[:, None], 10, axis=1))
    assert not u[200:].any(), "4.1 s hold 20 whole steps"


def test_binary_noise_switches_with_its_probability():
    spec = BinaryNoise(signal="gbn", step_s=0.1, gbn_s=1000.0, switching=0.3, seed=5, **DE)
    bits = (binary_noise(spec, 1000.0, 10.0) / spec.amplitude)[:10000]
    assert set(bits) == {-1.0, 1.0}
    switches = np.count_nonzero(np.diff(bits))
    # binomial, 9999 draws of 0.3: 4 standard deviations are 183; false alarm 6e-5
    assert abs(switches - 0.3 * 9999) < 183
    again = binary_noise(spec, 1000.0, 10.0)
    np.testing.assert_array_equal(again[:10000] / spec.amplitude, bits)


def test_laws():
    with pytest.raises(ScenarioError, match="not empty, got 32"):
        prbs_bits(5, 32, 10)
    with pytest.raises(ScenarioError, match="prbs_s >= step_s"):
        build([Prbs(signal="prbs", step_s=2.0, prbs_s=1.0, **DE)], 10.0, 50.0)
    with pytest.raises(ScenarioError, match="at least one sample"):
        build([BinaryNoise(signal="gbn", step_s=0.01, gbn_s=1.0, **DE)], 10.0, 50.0)
