"""Contract of every effect of the library, and what amended models do."""

from __future__ import annotations

import numpy as np
import pytest

from testbench.aircraft import load_aircraft
from testbench.flight import FlightCondition, linearise, trim
from testbench.gap.effects import EFFECTS
from testbench.sensors import load_suite

CONDITION = FlightCondition(16.0, 547.0)


@pytest.fixture(scope="module")
def believed():
    return load_aircraft("eolo", "rigid"), load_suite("eolo_gap")


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)
def test_an_effect_describes_itself_and_starts_within_its_bounds(effect):
    assert effect.physics.count(".") >= 2, "physics in two sentences"
    assert effect.separated_by
    for p in effect.parameters:
        assert all(p.low < s < p.high for s in p.starts), p.name


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)
def test_an_amended_aircraft_trims_and_differs_and_the_believed_one_is_untouched(effect, believed):
    aircraft, suite = believed
    before = aircraft.model_xml(500.0, 150.0, 16.0)
    amended, sensors = effect.amend(aircraft, suite, {p.name: p.starts[-1] for p in effect.parameters})
    assert aircraft.model_xml(500.0, 150.0, 16.0) == before
    assert (amended.model_xml(500.0, 150.0, 16.0), sensors) != (before, suite)
    assert np.max(np.abs(trim(amended, CONDITION).residual)) < 1e-9


def test_a_bending_mode_appears_among_the_poles(believed):
    aircraft, suite = believed
    values = {"f_hz": 9.0, "mass_ratio": 0.3, "twist_rad": 0.0, "lever": 0.0}
    amended, _ = EFFECTS["wing_bending"].amend(aircraft, suite, values)
    poles = linearise(amended, trim(amended, CONDITION)).poles()
    assert np.min(np.abs(np.abs(poles) - 2 * np.pi * 9.0)) < 0.05 * 2 * np.pi * 9.0


def test_a_thrust_line_above_the_cg_pitches_down_with_throttle(believed):
    aircraft, suite = believed
    amended, _ = EFFECTS["thrust_line"].amend(aircraft, suite, {"z_m": 0.05})
    models = [linearise(a, trim(a, CONDITION)) for a in (aircraft, amended)]
    q, thr = models[0].states.index("q"), models[0].inputs.index("thr")
    change = models[1].B[q, thr] - models[0].B[q, thr]
    thrust_per_throttle = 45.0 * (1.0 - 16.0 / 36.0)
    assert change == pytest.approx(-0.05 * thrust_per_throttle / aircraft.mass.Iyy, rel=1e-3)
