"""Clocks of loggers: uneven steps that recur are no gaps, samples that were lost are.

Which samples of a clock with wrong times are kept: against every possible choice, and by its stated limits.
"""

from itertools import combinations

import numpy as np
import pytest

from testbench.core.errors import RecordError, SizeError
from testbench.logs import resampling
from testbench.logs.clocks import gaps, usual_step
from testbench.logs.resampling import common_rate, resample
from testbench.logs.signals import Mapped, increasing

DURATION_S = 40.0


def clock(name: str) -> np.ndarray:
    """Times of a logger without losses, some 4000 to 16000 samples; fixed seeds."""
    rng = np.random.default_rng(3)
    n = 50_000
    steps = {
        "even": np.full(n, 0.0025),
        "two step": np.tile([0.0025, 0.0025, 0.005], n // 3),
        "jitter of 0.3 steps": 0.0025 + 0.0025 * np.diff(rng.uniform(-0.3, 0.3, n + 1)),
        "alternating": np.tile([0.002, 0.006], n // 2),
        "every twentieth doubled": np.tile([*np.full(19, 0.0025), 0.005], n // 20),
        "every hundredth doubled": np.tile([*np.full(99, 0.0025), 0.005], n // 100),
        "bursts of five": np.tile([0.001, 0.001, 0.001, 0.001, 0.016], n // 5),
        "bursts of forty": np.tile([*np.full(39, 0.0005), 0.0205], n // 40),
        "rate drifts from 400 to 130 Hz": np.linspace(0.0025, 0.0075, 8000),
        "rate changes from 400 to 100 Hz": np.r_[np.full(8000, 0.0025), np.full(2000, 0.01)],
        "thinned from 820 Hz, uneven": 0.00122 * np.diff(np.ceil(np.arange(n) * 2.87)),
    }[name]
    t = 3.0 + np.r_[0.0, np.cumsum(steps)]
    return t[t < 3.0 + DURATION_S]


LOSSLESS = (
    "even", "two step", "jitter of 0.3 steps", "alternating", "every twentieth doubled", "every hundredth doubled",
    "bursts of five", "bursts of forty", "rate drifts from 400 to 130 Hz", "rate changes from 400 to 100 Hz",
    "thinned from 820 Hz, uneven",
)  # fmt: skip


def logged(t: np.ndarray, name: str = "q") -> Mapped:
    return Mapped(name, t, 0.1 * np.sin(2.0 * np.pi * 0.7 * (t - 3.0)), "", "")


@pytest.mark.parametrize(
    ("rate_hz", "samples", "expected"), [(400, 20_000, 400), (400, 600_000, 50), (20, 600_000, 20)]
)
def test_a_long_log_of_one_clock_is_put_to_50_hz(rate_hz, samples, expected):
    t = np.arange(samples) / rate_hz
    assert common_rate([logged(t), logged(t, "p")]) == expected


@pytest.mark.parametrize(("late", "expected"), [(0.009, 400.0), (0.011, 50.0)])
def test_a_clock_is_even_up_to_a_hundredth_of_its_step(late, expected):
    """One sample that comes later than that, and the log is put to the default rate: its clock is not its record's."""
    t = 0.0025 * np.arange(2000.0)
    t[1000] += 0.0025 * late
    assert common_rate([logged(t), logged(t, "p")]) == expected


@pytest.mark.parametrize("name", LOSSLESS)
def test_a_clock_without_losses_gives_a_record_without_gaps(name):
    t = clock(name)
    rate = common_rate([logged(t)])
    record = resample([logged(t)], min(rate, 50.0), {})
    assert record.valid.mean() > 0.99
    error = np.abs(record["q"] - 0.1 * np.sin(2.0 * np.pi * 0.7 * record.t_s))[record.valid[:, 0]]
    assert error.max() < 2e-4  # 0.2 % of the amplitude; bursts leave 16 to 20 ms to be bridged


@pytest.mark.parametrize("name", [n for n in LOSSLESS if "hundredth" not in n])
def test_a_clock_without_losses_has_no_gaps(name):
    assert gaps(clock(name)).size == 0


@pytest.mark.parametrize("name", LOSSLESS)
def test_a_true_gap_stays_a_gap(name):
    t = clock(name)
    kept = t[(t < 20.0) | (t > 20.4)]
    c = logged(kept)
    found = [(a, b) for a, b in c.gaps if a < 20.1 < b]
    assert len(found) == 1
    record = resample([c], 50.0, {})
    inside = (record.t_s > 17.03) & (record.t_s < 17.37)
    assert not record.valid[inside].any()
    assert np.ptp(record["q"][inside]) == 0.0  # held, not bridged
    assert record.valid[~((record.t_s > 16.9) & (record.t_s < 17.5))].mean() > 0.99


def test_outages_that_recur_stay_gaps():
    t = clock("even")
    c = logged(t[(t % 2.0) > 0.3])  # a card that is flushed every two seconds loses 0.3 s each time
    assert len(c.gaps) == 20
    assert resample([c], 50.0, {}).valid.mean() == pytest.approx(0.85, abs=0.02)


def test_samples_dropped_at_random_are_bridged_where_the_record_is_slower_and_marked_where_it_is_not():
    t = clock("even")
    keep = np.random.default_rng(5).random(t.size) > 0.05
    c = logged(t[keep])
    assert resample([c], 50.0, {}).valid.mean() > 0.99  # a step of 5 to 10 ms is none of the record's 20 ms
    own = resample([c], 400.0, {}).valid.mean()
    assert 0.93 < own < 0.97  # 5 % were lost
    assert c.rate_hz == pytest.approx(400.0, rel=0.01)


def test_the_rate_is_the_mean_outside_gaps():
    t = clock("two step")
    assert usual_step(t) == pytest.approx(1.0 / 300.0, rel=1e-3)
    assert usual_step(t[(t < 20.0) | (t > 25.0)]) == pytest.approx(1.0 / 300.0, rel=1e-3)


def test_what_would_fold_down_is_filtered_at_the_finest_step_of_the_clock():
    t = clock("two step")
    for frequency, left in ((55.0, 1e-3), (70.0, 1e-3), (80.0, 0.05)):  # at 50 Hz they would look like 5 to 20 Hz
        fast = Mapped("q", t, np.sin(2.0 * np.pi * frequency * t), "", "")
        record = resample([fast], 50.0, {})
        assert np.abs(record["q"][50:-50]).max() < left  # 80 Hz has 2.5 samples of the thin part of the clock


@pytest.mark.parametrize("step_s", [1e-310, 1e-12])
def test_times_that_hardly_move_are_damaged(step_s):
    with pytest.raises(RecordError, match=r"must run on by at least 1e-09 s a sample.*damaged"):
        common_rate([logged(step_s * np.arange(50.0))])


def test_a_channel_that_counts_too_finely_for_its_length_is_refused():
    t = np.cumsum(np.tile([1e-12, 1e-12, 1e-12, 1.0], 300))
    with pytest.raises(SizeError, match="damaged"):
        resample([logged(t)], 0.1, {})


def test_a_held_command_keeps_the_area_of_its_steps_on_any_clock():
    """Straight lines between samples would spread a step over two of them."""
    rng = np.random.default_rng(3)
    for rate in (50.0, 120.0):
        t = np.arange(0.0, 6.0, 1.0 / rate) + rng.uniform(0.0, 2e-3, round(6.0 * rate))
        x = np.where((t > 2.0) & (t < 3.1), 1.0, 0.0)
        held = Mapped("de_cmd", t, x, "", "")
        record = resample([held], 50.0, {}, held=["de_cmd"])
        area = np.sum(x[:-1] * np.diff(t))
        assert np.sum(record["de_cmd"]) / 50.0 == pytest.approx(area, abs=1e-9)
        assert np.count_nonzero((record["de_cmd"] > 0.0) & (record["de_cmd"] < 1.0)) <= 2


def test_a_held_command_on_the_clock_of_the_record_is_kept_to_the_last_digit():
    t = np.arange(200) / 50.0
    x = np.where((t > 1.0) & (t < 2.0), 0.1, 0.3)
    record = resample([Mapped("de_cmd", t, x, "", "")], 50.0, {}, held=["de_cmd"])
    assert np.array_equal(record["de_cmd"], x)


def longest(t: np.ndarray) -> int:
    """Return the length of the longest increasing subsequence: every choice is tried."""
    sizes = range(t.size, 0, -1)
    return next(n for n in sizes if any(np.all(np.diff(t[list(c)]) > 0.0) for c in combinations(range(t.size), n)))


@pytest.mark.parametrize("seed", range(30))
def test_as_many_samples_are_kept_as_can_increase(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 10))
    t = np.arange(float(n))
    wrong = rng.choice(n, 2, replace=False)  # two are no clock that was set back
    t[wrong] = rng.integers(0, n, 2) + rng.choice([0.0, 0.5], 2)
    kept = increasing(t)
    assert np.all(np.diff(kept) > 0)
    assert np.all(np.diff(t[kept]) > 0.0)
    assert kept.size == longest(t)


def test_the_first_and_the_last_sample_are_kept_where_they_are_right():
    t = np.array([0.0, 1.0, 9.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0])
    assert increasing(t).tolist() == [0, 1, 3, 4, 5, 6, 7, 8, 9, 10]
    assert increasing(np.array([0.0, 1.0, 1.0, 2.0, np.nan, 3.0])).size == 4


@pytest.mark.parametrize("back", [-50.0, 30.0])
def test_of_a_clock_that_was_set_back_the_longest_stretch_is_kept(back):
    t = np.concatenate([100.0 + np.arange(40.0), 100.0 + back + np.arange(60.0)])
    assert increasing(t).tolist() == (list(range(40, 100)))
    assert increasing(t[::-1].copy()[::-1][:90]).tolist() == list(range(40, 90))


@pytest.mark.parametrize(("times_the_span", "kept"), [(1.9, True), (2.1, False)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_time_is_far_off_beyond_twice_the_span_from_its_middle(times_the_span, kept, sign):
    t = np.arange(0.0, 1001.0)
    low, high = np.quantile(t, [0.01, 0.99])  # one sample more moves them by less than a hundredth of the span
    far = 0.5 * (low + high) + sign * times_the_span * (high - low)
    whole = np.append(t, far) if sign > 0 else np.insert(t, 0, far)
    assert (increasing(whole).size == 1002) == kept


def test_a_spline_of_blocks_is_that_of_the_whole(monkeypatch):
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.9, 1.1, 3000))
    x, at = np.sin(0.01 * t) + 0.1 * rng.standard_normal(t.size), np.linspace(t[0] - 1.0, t[-1] + 1.0, 5001)
    whole = resampling._between(t, x, at, False)
    monkeypatch.setattr(resampling, "_BLOCK", 700)
    np.testing.assert_allclose(resampling._between(t, x, at, False), whole, atol=1e-14)
