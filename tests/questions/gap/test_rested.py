"""Commands that a sensor measured: their noise does not drive the model where they rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_flights import ELEVATOR, THROTTLE, believe, measure
from scipy.signal import lfilter

from testbench.estimators.regression.smoothing import noise_level
from testbench.questions.gap.drive import drive_records
from testbench.questions.gap.evidence.commanded import quiet_samples, rests, stilled
from testbench.questions.gap.new import suite_of_records

DT_S, NOISE = 0.02, 1e-3
T_S = np.arange(1500) * DT_S


def noisy(u, seed: int = 1):
    return u + NOISE * np.random.default_rng(seed).normal(size=T_S.size)


@pytest.mark.parametrize("seed", range(5))
def test_a_lever_at_rest_stands_still(seed):
    found = stilled(noisy(np.full(T_S.size, 0.65), seed), NOISE, DT_S)
    assert np.ptp(found) == 0.0
    assert found[0] == pytest.approx(0.65, abs=5.0 * NOISE / np.sqrt(T_S.size))


def test_a_step_stays_where_it_is_and_either_side_stands_still():
    level = 0.65 + np.where(T_S < 10.0, 0.0, 0.1)
    found = stilled(noisy(level), NOISE, DT_S)
    assert np.max(np.abs(found - level)) < 5.0 * NOISE / np.sqrt(500)
    assert np.unique(found).size == 2


def test_what_moves_is_as_it_was_measured():
    moves = (T_S > 5.0) & (T_S < 6.0)
    doublet = np.where(moves, np.where(T_S < 5.5, 0.05, -0.05), 0.0)
    measured = noisy(doublet)
    found = stilled(measured, NOISE, DT_S)
    assert np.array_equal(found[moves], measured[moves])
    assert np.max(np.abs(found - doublet)[~moves]) < 5.0 * NOISE


def test_a_lever_that_creeps_is_followed():
    """One per cent in half a minute: its own mean would be off by five times the noise at both ends."""
    slow = 0.65 + 0.01 * T_S / T_S[-1]
    found = stilled(noisy(slow), NOISE, DT_S)
    assert np.std(found - slow) < 0.25 * NOISE


@pytest.mark.parametrize("hand_s", [0.06, 0.2])
def test_a_hand_that_is_never_still_does_not_rest(hand_s):
    """Third differences show a seventh or less of what it moves, in no second of which it stays within that."""
    a, b = np.exp(-DT_S / 0.4), np.exp(-DT_S / hand_s)
    hand = lfilter([1.0 - b], [1.0, -b], lfilter([0.004 * np.sqrt(1.0 - a * a)], [1.0, -a], noisy(0.0 * T_S) / NOISE))
    assert list(rests(hand, noise_level(hand), DT_S)) == []
    assert np.array_equal(stilled(hand, noise_level(hand), DT_S), hand)


@pytest.fixture(scope="module")
def levers():
    """Flights whose throttle was measured, with a noise of twice what counts as motion."""
    flown = measure(believe(), 5, inputs=(ELEVATOR, THROTTLE), duration_s=8.0)
    rng = np.random.default_rng(3)
    return {
        str(i): r.with_columns({"thr_cmd": r["thr_cmd"] + 2e-3 * rng.normal(size=len(r))}) for i, r in enumerate(flown)
    }


def sensor(records):
    return next(s for s in suite_of_records("mine", "eolo", records)[0].sensors if s.channel == "thr_cmd")


def test_a_new_case_tells_what_was_measured_from_what_was_sent(levers):
    assert sensor(levers).noise_std == pytest.approx(2e-3, rel=0.1)
    assert "YOURS" in sensor(levers).source
    sent = {n: r.with_columns({"thr_cmd": np.round(r["thr_cmd"], 2)}) for n, r in levers.items()}
    assert sensor(sent).noise_std == 0.0


def test_quiet_flight_is_found_behind_the_noise_of_a_lever(levers):
    suite, _ = suite_of_records("mine", "eolo", levers)
    driving = drive_records(suite, levers)
    plain = measure(believe(), 5, inputs=(ELEVATOR, THROTTLE), duration_s=8.0)
    for record, sent in zip(driving.values(), plain, strict=True):
        assert quiet_samples(record) == pytest.approx(quiet_samples(sent), abs=1)
        assert np.std(record["thr_cmd"] - sent["thr_cmd"]) < 1e-3
    again = drive_records(suite, driving)
    assert all(again[n] is driving[n] for n in driving)
    exact = replace(
        suite, sensors=tuple(replace(s, noise_std=0.0) if "_cmd" in s.channel else s for s in suite.sensors)
    )
    assert all(drive_records(exact, levers)[n] is levers[n] for n in levers)


def test_a_throttle_that_is_recorded_in_place_of_its_command_stands_still_as_well(levers):
    """No sensor of the suite says how large its noise is: third differences do."""
    suite, _ = suite_of_records("mine", "eolo", levers)
    without = replace(suite, sensors=tuple(s for s in suite.sensors if s.channel != "thr_cmd"))
    positions = {
        n: replace(r, channels=tuple("thr" if c == "thr_cmd" else c for c in r.channels)) for n, r in levers.items()
    }
    still = next(iter(drive_records(without, positions).values()))["thr_cmd"]
    assert np.ptp(still) < 1e-3
    assert np.ptp(next(iter(levers.values()))["thr_cmd"]) > 8e-3
