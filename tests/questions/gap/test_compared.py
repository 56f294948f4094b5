"""What is compared, and with what: slow, drifting and heading sensors of a model that is right leave noise alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_flights import CONDITION, ELEVATOR, believe, measure
from scipy.stats import chi2

from testbench.core.errors import ScenarioError
from testbench.flight import load_aircraft
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.commanded import left_out, not_compared
from testbench.questions.gap.evidence.locate import locate, locate_regions, structure
from testbench.questions.gap.search.point import Point
from testbench.questions.gap.workflow import _shrink
from testbench.sensors import Sensor, SensorSuite, load_suite

EDGE = 1e-5  # probability that noise alone leaves each of the two sides


@pytest.fixture(scope="module")
def slow():
    """Airspeed and attitude at a tenth of the log's rate, as of a slow air data computer."""
    believed = believe()
    rates = {"V": 10.0, "theta": 10.0}
    sensors = tuple(replace(s, rate_hz=rates.get(s.channel)) for s in believed.suite.sensors)
    return replace(believed, suite=replace(believed.suite, sensors=sensors))


@pytest.fixture(scope="module")
def slow_records(slow):
    return measure(slow, 5)


@pytest.fixture(scope="module")
def full():
    """Every sensor of the large suite: GPS, heading, an attitude that drifts."""
    aircraft = load_aircraft("eolo", "flexible")
    return Believed(aircraft, load_suite("eolo_full"), CONDITION, aircraft.rate_hz)


def test_samples_that_were_not_taken_are_not_counted(slow, slow_records):
    point = Point.at(slow, slow, tuple(slow_records))
    taken = sum(int(np.count_nonzero(slow.taken(r))) for r in slow_records)
    assert point.samples == taken < 0.7 * point.exact.size
    assert chi2.isf(1.0 - EDGE, taken) < point.chi2 < chi2.isf(EDGE, taken)
    wrong = Point.at(slow, slow.with_nuisances({"Cm_de": 1.05}), tuple(slow_records))
    assert chi2.isf(EDGE, taken) < wrong.chi2 < point.exact.size  # judged by all samples it would pass for noise


def test_the_share_removed_counts_what_was_taken(slow, slow_records):
    shrink = _shrink(slow.with_nuisances({"Cm_de": 1.05}), slow, "m", slow_records[0])
    assert shrink.visible
    assert shrink.energy_after == pytest.approx(1.0, abs=0.45)  # 120 samples: 3.5 standard deviations are 0.45
    assert 0.7 < shrink.removed < 1.3


def test_maps_have_the_noise_of_slow_sensors_at_one(slow, slow_records):
    residuals, taken = zip(*((slow.residuals(r), slow.taken(r)) for r in slow_records), strict=True)
    found = locate("m", residuals[0], slow.outputs, 0.01, taken[0])
    assert found.by_time.mean(axis=0) == pytest.approx(1.0, abs=0.45)
    assert found.by_band[-1] == pytest.approx(1.0, abs=0.45)
    (alpha, *_) = locate_regions(slow_records, residuals, slow.outputs, taken)
    counts = np.nansum(alpha.samples)
    assert np.nansum(alpha.energy * alpha.samples[:, None], axis=0) / counts == pytest.approx(1.0, abs=0.6)
    tone = [np.where(t, 3.0 * np.sin(40.0 * r.t_s)[:, None], 0.0) for r, t in zip(slow_records, taken, strict=True)]
    told = structure(tone, slow.outputs, 0.01, 1e-3, taken)
    assert told is not None
    assert told.channel not in ("V", "theta")  # aliased, they are told of no band
    only = [t[:, [0]] for t in taken]
    assert structure([t[:, [0]] for t in tone], ("V",), 0.01, 1e-3, only) is None


def test_a_record_shorter_than_a_window_is_located():
    found = locate("m", np.ones((60, 2)), ("q", "V"), 0.01, np.ones((60, 2), bool))
    assert found.by_time.tolist() == [[1.0, 1.0]]
    assert found.window_s == pytest.approx(0.6)


def test_a_right_model_of_every_sensor_leaves_noise(full):
    """Heading and place need the wind, biases of attitude and height wander: none of it may look like a gap. What is
    kept of drift (less than a fifth of the noise) is in the noise.
    """
    (record,) = measure(full, 3, inputs=(ELEVATOR,))
    energy, taken = (full.residuals(record) ** 2).sum(axis=0), full.taken(record).sum(axis=0)
    for name, e, n in zip(full.outputs, energy, taken, strict=True):
        assert chi2.isf(1.0 - EDGE, n - 1) < e < chi2.isf(EDGE, n - 1), name
    assert set(left_out(full.suite)) == {
        "psi",
        "north",
        "east",
        "v_north",
        "v_east",
        "strain_wing_6",
        "theta",
        "phi",
        "h",
    }
    said = "not compared: theta, phi, h (the bias wanders by more than 0.2 times the noise within 20 s)"
    assert said in not_compared(full.suite)


def test_a_suite_with_nothing_to_compare_says_why():
    drifting = Sensor("theta", noise_std=0.01, drift_std=0.1, drift_time_s=10.0)
    suite = SensorSuite("s", "s", 100.0, (drifting, Sensor("de_cmd")))
    with pytest.raises(ScenarioError, match=r"not compared: theta \(the bias wanders by"):
        replace(believe(), suite=suite)


@pytest.mark.parametrize(
    "drift", [{"bias_walk": 0.02}, {"drift_std": 0.05, "drift_time_s": 7.0}, {"drift_std": 0.05, "drift_time_s": 300.0}]
)
def test_drift_over_a_flight_is_what_biases_wander_by(drift):
    """400 flights of 20 s: the mean of their variances scatters by 6 % where it is largest, that of a random walk."""
    sensor = Sensor("q", **drift)
    wandered = [np.var(sensor.sample(np.zeros(2000), seed, 0.01)[0]) for seed in range(400)]
    assert np.sqrt(np.mean(wandered)) == pytest.approx(sensor.drift_over(20.0), rel=0.15)
