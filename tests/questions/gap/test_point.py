"""A hypothesis, its tangents at the edge of what can be trimmed, and its re-tuning where linear predictions fail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from studies.blind.flights import condition, fly_truth, suite
from studies.blind.run import believe
from studies.blind.truth import Truth

from testbench.aircraft import Amendment, ScaleCoefficient
from testbench.core.errors import TrimError
from testbench.core.record import FlightRecord
from testbench.core.scenario.inputs import StandardMultistep
from testbench.flight import FlightCondition, load_aircraft
from testbench.inputs import build
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.effect_contract import recorded
from testbench.questions.gap.priors import PRIORS
from testbench.questions.gap.search.point import Point, retune
from testbench.sensors import load_suite


def least_factor_with_trim(believed, low=0.4, high=1.0):
    """The smallest factor of Cm_de, to 1e-3, with which the throw of the elevator holds the aircraft in trim."""
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        try:
            _ = believed.with_nuisances({"Cm_de": middle}).trimmed
            high = middle
        except TrimError:
            low = middle
    return high


def test_where_one_side_has_no_trim_the_tangent_is_taken_to_the_other():
    believed = believe("taurus")
    records = tuple(fly_truth("taurus", Truth(), "short", 11).values())[:1]
    least = least_factor_with_trim(believed)
    names = list(Point.at(believed, believed, records).priors)
    k = names.index("Cm_de")
    edge, inside = (
        Point.at(believed, believed, records, np.where(np.arange(len(names)) == k, least + above, 1.0))
        for above in (0.005, 0.025)
    )
    with pytest.raises(TrimError):
        _ = believed.with_nuisances({"Cm_de": least + 0.005 - 0.02}).trimmed
    one_sided, central = edge.tangents[:, k], inside.tangents[:, k]
    assert np.linalg.norm(one_sided - central) < 0.1 * np.linalg.norm(central)


def test_coefficients_that_an_unknown_motion_lets_go_are_flown_as_far_as_there_is_a_trim():
    believed = believe("taurus")
    records = tuple(fly_truth("taurus", Truth(), "short", 11).values())[:1]
    least = least_factor_with_trim(believed)
    wanted = 1.0 - 1.5 * (1.0 - least)  # half of the way there still flies
    beside = dict.fromkeys(believed.priors_of(records), 1.0) | {"Cm_de": wanted}
    with pytest.raises(TrimError):
        Point.at(believed, believed, records, np.array(list(beside.values())))
    point = Point.towards_unknown(believed, records, beside)
    assert point.by_name["Cm_de"] == pytest.approx(0.5 * (1.0 + wanted))
    assert np.all(np.isfinite(point.exact))


def test_re_tuning_finds_the_coefficients_of_an_aircraft_that_is_hardly_stable():
    """Cm_alpha of the F-16 is small, so that a linear prediction of 12 s goes far astray; flown tangents do not."""
    steps = StandardMultistep(signal="3211", control="de", amplitude_deg=2.0, step_s=0.5, start_s=0.5)
    u = build((steps,), 12.0, 50.0)
    command = FlightRecord(t_s=u.t_s, channels=("de_cmd",), data=u.u, kind="measured")
    suite = replace(load_suite("eolo_gap"), rate_hz=50.0)
    believed = Believed(
        load_aircraft("jsbsim:f16", commanded_at="surface"), suite, FlightCondition(150.0, 2500.0), 100.0
    )
    true = {"Cm_alpha": 0.8, "Cm_q": 0.97, "Cm_de": 0.956}
    tuned = retune(Point.at(believed, believed, recorded(believed.with_nuisances(true), (command,))))
    price = sum(((f - 1.0) / PRIORS[n]) ** 2 for n, f in true.items())
    assert tuned.chi2 < price + 0.1
    assert {n: tuned.by_name[n] for n in true} == pytest.approx(true, abs=0.02)


def test_a_coefficient_that_is_believed_to_be_nearly_zero_is_re_tuned_as_quickly_as_others():
    steps = StandardMultistep(signal="3211", control="da", amplitude_deg=2.0, step_s=0.5, start_s=0.5)
    u = build((steps,), 8.0, 50.0)
    command = FlightRecord(t_s=u.t_s, channels=("da_cmd",), data=u.u, kind="measured")
    aircraft = load_aircraft("taurus", "rigid")
    small = aircraft.amended(Amendment("small", "a small Cn_da", (ScaleCoefficient("Cn_da", 0.02),)))
    believed = Believed(small, suite(every_axis=True), condition("taurus"), 100.0)
    (record,) = recorded(believed.with_nuisances({"Cn_da": 60.0}), (command,))
    priors = {**believed.priors_of((record,)), "Cn_da": 40.0}
    tuned = retune(Point.at(believed, believed, (record,), None, priors))
    assert tuned.chi2 < (59.0 / 40.0) ** 2 + 0.1
    assert tuned.by_name["Cn_da"] == pytest.approx(60.0, rel=0.01)
