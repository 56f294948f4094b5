"""Trims that a search asks JSBSim for begin at that of the aircraft as it was loaded, whatever was trimmed before."""

from __future__ import annotations

import pytest

from testbench.flight import FlightCondition, load_aircraft, trim
from testbench.flight.executive import Executive
from testbench.questions.gap import flights
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.flights import Flyer, trims
from testbench.sensors import load_suite

CONDITION = FlightCondition(50.0, 1000.0)
FACTORS = ({"Cm_alpha": 0.9}, {"CD": 1.1}, {"CL_alpha": 1.1})


@pytest.fixture(scope="module")
def flyers() -> list[Flyer]:
    """The Cessna, whose propeller JSBSim brings to rest, with a coefficient changed; and as it was loaded, last."""
    believed = Believed(load_aircraft("jsbsim:c172p"), load_suite("eolo_gap"), CONDITION, 100.0)
    changed = [believed.with_nuisances(f).aircraft for f in FACTORS]
    out = [Flyer.of(a, CONDITION, 100.0, "auto") for a in (*changed, believed.aircraft)]
    trims(out)  # judges whether a batch flies them, which trims them as well
    return out


@pytest.fixture
def nothing_known(monkeypatch):
    for name in ("_TRIMS", "_NEAR"):
        monkeypatch.setattr(flights, name, flights._Kept(8))


def test_a_trim_takes_few_evaluations_and_is_that_of_a_search_from_scratch(flyers, nothing_known, monkeypatch):
    trims(flyers[:1])  # that of the aircraft as it was loaded is known from here on
    count, evaluate = [0], Executive.evaluate
    monkeypatch.setattr(
        Executive, "evaluate", lambda self, *a, **k: count.__setitem__(0, count[0] + 1) or evaluate(self, *a, **k)
    )
    near = trims(flyers[1:3])
    after = count[0]
    for found, flyer in zip(near, flyers[1:3], strict=True):
        alone = trim(flyer.aircraft, flyer.condition, flyer.rate_hz)
        assert found.alpha == pytest.approx(alone.alpha, abs=1e-8)
        assert found.controls == pytest.approx(alone.controls, abs=1e-7)
    assert 2 * after < count[0] - after


def test_no_bit_of_a_trim_depends_on_what_was_trimmed_before(flyers, nothing_known, monkeypatch):
    forwards = trims(flyers)
    monkeypatch.setattr(flights, "_TRIMS", flights._Kept(8))
    monkeypatch.setattr(flights, "_NEAR", flights._Kept(8))
    backwards = [trims([f])[0] for f in flyers[::-1]][::-1]
    assert [x.controls for x in forwards] == [x.controls for x in backwards]
    assert [x.alpha for x in forwards] == [x.alpha for x in backwards]
