"""Errors of sensors that grow with time, sideslip and place: read as formulas say, and found again at their size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from axes import believe, commands
from gap_fits import check_sizes, fits

from testbench.core.constants import DEG_RAD
from testbench.effects import EFFECTS, library
from testbench.questions.gap.effect_contract import recorded
from testbench.questions.gap.evidence.check import _without_believed
from testbench.questions.gap.search.point import Point
from testbench.sensors import Sensor, load_suite

TRUE = {
    "p_drift": {"drift_per_s": 0.1 * DEG_RAD},
    "q_drift": {"drift_per_s": -0.05 * DEG_RAD},
    "r_drift": {"drift_per_s": 0.03 * DEG_RAD},
    "V_drift": {"drift_per_s": -0.08},
    "V_sideslip": {"cp_beta2": 1.2},
    "V_position": {"right_m": -1.5},
    "V_lag": {"lag_s": 2.5},  # narrow tubes of a large aircraft
}
OF_PITOT = {"V_sideslip", "V_position"}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", TRUE)
def test_an_error_is_found_again_at_its_size_in_data_that_it_made(name):
    b = believe()
    effect = library(b.suite)[name]
    records = recorded(b.with_effect(effect, TRUE[name]), commands())
    start = Point.at(b, b, tuple(records))
    (found,) = fits(b, records, effect)
    assert found is not None
    assert found.chi2 < max(0.001 * start.chi2, 1.0)
    check_sizes(found, TRUE[name], 0.02)


def test_a_gyro_that_drifts_reads_a_straight_line_more():
    b, record = believe(), commands()[1]
    off = b.with_effect(library(b.suite)["p_drift"], TRUE["p_drift"]).predict(record) - b.predict(record)
    p = b.outputs.index("p")
    np.testing.assert_allclose(off[:, p], 0.1 * DEG_RAD * record.t_s, atol=1e-12)
    assert not np.any(np.delete(off, p, axis=1))


def test_a_pitot_beside_the_fuselage_reads_its_distance_times_the_yaw_rate_less():
    b, record = believe(), commands()[0]
    prompt = tuple(replace(s, lag_s=0.0, delay_s=0.0) for s in b.suite.sensors)
    b = replace(b, suite=replace(b.suite, sensors=prompt))
    effects, V = library(b.suite), b.outputs.index("V")
    flown = b.flown(record, ("p", "r", "alpha", "beta"))
    p, r, alpha, beta = flown.columns(("p", "r", "alpha", "beta")).T
    beside = b.with_effect(effects["V_position"], {"right_m": 2.0}).predict(record) - b.predict(record)
    assert np.ptp(r) > 0.1
    formula = 2.0 * (p * np.sin(alpha) - r * np.cos(alpha)) * np.cos(beta)
    np.testing.assert_allclose(beside[:, V], formula, atol=0.02 * np.ptp(2.0 * r))
    slips = b.with_effect(effects["V_sideslip"], {"cp_beta2": 1.0}).predict(record)[:, V] / b.predict(record)[:, V]
    np.testing.assert_allclose(slips**2, 1.0 - beta**2, atol=1e-9)


def test_drift_is_sought_in_gyros_and_airspeed_and_a_pitots_errors_where_a_pitot_is():
    b = believe()
    assert {n for n in library(b.suite) if n.endswith("_drift")} == {"p_drift", "q_drift", "r_drift", "V_drift"}
    assert set(library(b.suite)) >= OF_PITOT
    assert all(EFFECTS[n].lateral for n in OF_PITOT)
    sensors = tuple(Sensor("V", noise_std=0.2) if s.channel == "V" else s for s in b.suite.sensors)
    assert not OF_PITOT & set(library(replace(b.suite, sensors=sensors)))
    assert set(EFFECTS["V_drift"].parameters[0].unit) == set("m/s2")


def test_lengths_may_be_off_by_what_the_size_of_the_aircraft_allows():
    """A vane may sit 10 m from where it is thought to on an airliner, and not on an aircraft with a span of 1.3 m."""
    b = believe()
    geometry = replace(b.aircraft.geometry, b_m=30.0)
    large = library(b.suite, replace(b.aircraft, geometry=geometry))
    small = library(b.suite, b.aircraft)
    for name, most in {"az_position": 15.0, "thrust_line": 1.5}.items():
        assert [(p.low, p.high) for p in large[name].parameters] == [(-most, most)]
        assert small[name].parameters == EFFECTS[name].parameters
    assert large["cg_shift"].parameters == EFFECTS["cg_shift"].parameters  # told in chords


def test_no_suite_without_these_errors_reads_another_channel():
    for s in load_suite("eolo_full").sensors:
        assert not s.bias_rate
        assert s.channel != "V" or set(s.needs) == {"V", "alpha"}


def test_kinematics_see_the_record_without_the_drift_that_is_believed():
    b = believe()
    known = b.with_effect(library(b.suite)["r_drift"], TRUE["r_drift"])
    plain, drifting = (recorded(x, commands()[:1])[0] for x in (b, known))
    away = drifting["r"] - plain["r"]
    np.testing.assert_allclose(away, 0.03 * DEG_RAD * plain.t_s, atol=1e-12)
    np.testing.assert_allclose(
        _without_believed(known.suite, drifting)["r"], _without_believed(b.suite, plain)["r"], atol=1e-12
    )
