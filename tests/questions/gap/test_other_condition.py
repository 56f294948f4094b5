"""An airspeed, and air, other than the condition says: what was believed of the flight is wrong, not the aircraft."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import pytest
from gap_fits import fits
from gap_flights import CONDITION, ELEVATOR, THROTTLE, believe, measure

from testbench.core.atmosphere import air_density, height_of_density
from testbench.core.scenario.inputs import Doublet
from testbench.effects import EFFECTS
from testbench.questions.gap.ask import GapResult
from testbench.questions.gap.effect_contract import CONDITION as AT
from testbench.questions.gap.effect_contract import believed, commands, recorded
from testbench.questions.gap.export import amended_files
from testbench.questions.gap.search.point import Point
from testbench.questions.gap.starts import Start, marked
from testbench.questions.gap.workflow import find_gap

SIZE = {"air_density": "over_believed", "airspeed_flown": "over_read"}
FASTER = replace(AT, V_m_s=19.0)


def misread(truth, factor):
    """Sensors whose airspeed reads so many times too little."""
    suite = truth.suite
    sensors = (replace(s, scale=s.scale / factor) if s.channel == "V" else s for s in suite.sensors)
    return replace(truth, suite=replace(suite, sensors=tuple(sensors)))


@pytest.mark.parametrize("h_m", [-300.0, 0.0, 547.0, 9000.0])
def test_a_density_belongs_to_one_height(h_m):
    assert height_of_density(air_density(h_m)) == pytest.approx(h_m, abs=1e-6)


@pytest.mark.parametrize(
    ("name", "factor", "others"),
    [
        ("air_density", 0.93, ("mass_error", "drag_increment")),
        pytest.param("airspeed_flown", 1.06, ("V_scale", "air_density"), marks=pytest.mark.slow),  # ten seconds
    ],
)
def test_what_all_records_were_flown_in_is_found_over_two_speeds(name, factor, others):
    b, effect = believed(), EFFECTS[name]
    flown = tuple(marked(c, Start(at)) for at in (AT, FASTER) for c in commands())
    records = recorded(b.with_effect(effect, {SIZE[name]: factor}), flown)
    records = tuple(marked(r, Start(at)) for r, at in zip(records, (AT,) * 3 + (FASTER,) * 3, strict=True))
    start = Point.at(b, b, tuple(records))
    (found,) = fits(b, records, effect)
    assert found.values[SIZE[name]] == pytest.approx(factor, abs=found.errors[SIZE[name]])  # priors draw, and no noise
    assert found.chi2 < 0.02 * start.chi2
    for other in others:
        (instead,) = fits(b, records, EFFECTS[other])
        assert instead is None or instead.chi2 > 3.0 * found.chi2


def test_every_record_is_flown_where_it_says_and_no_farther():
    b = believed().with_effect(EFFECTS["airspeed_flown"], {"over_read": 1.1})
    assert b.condition.V_m_s == pytest.approx(1.1 * AT.V_m_s)
    record = commands()[0]
    assert b.at(record) is b
    for at in (AT, FASTER, b.condition):  # the last is a place that a record may name, too
        there = b.at(marked(record, Start(at)))
        assert there.condition.V_m_s == pytest.approx(1.1 * at.V_m_s)
        assert there.at(marked(record, Start(at))) is there
    both = b.with_effect(EFFECTS["air_density"], {"over_believed": 0.9}).at(marked(record, Start(FASTER)))
    assert both.condition.qbar_Pa == pytest.approx(0.9 * 1.1**2 * FASTER.qbar_Pa)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "factor", "condition"),
    [
        ("air_density", 0.8, replace(CONDITION, h_m=height_of_density(0.8 * air_density(CONDITION.h_m)))),
        ("airspeed_flown", 1.07, replace(CONDITION, V_m_s=1.07 * CONDITION.V_m_s)),
    ],
)
def test_a_hot_day_and_a_misread_airspeed_are_named_with_their_sizes(name, factor, condition):
    truth = replace(believe(), condition=condition)
    truth = misread(truth, factor) if name == "airspeed_flown" else truth
    inputs = (ELEVATOR, THROTTLE, Doublet(signal="doublet", control="de", amplitude_deg=2.5, period_s=1.2))
    *naming, held = measure(truth, 71, inputs=inputs)
    finding = find_gap(believe(), {f"m{i}": r for i, r in enumerate(naming)}, {"held": held})
    assert finding.naming.names == (name,), finding.naming.sentence
    best = finding.naming.best
    assert best.values[SIZE[name]] == pytest.approx(factor, abs=4.0 * best.errors[SIZE[name]])
    assert not finding.naming.coefficients
    written = amended_files(GapResult("case", "title", "question", "eolo", {}, finding, 0, None))
    flown = tomllib.loads(written["condition.toml"])["condition"]
    assert flown["V_m_s"] == pytest.approx(condition.V_m_s, rel=0.02)
    assert flown["h_m"] == pytest.approx(condition.h_m, abs=500.0)
