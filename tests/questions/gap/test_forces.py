"""Equation errors: nothing but noise where nothing is missing, and in proportion to what the missing moment follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_flights import believe, measure

from testbench.effects import EFFECTS
from testbench.questions.gap.evidence.forces import equation_errors, follows


@pytest.fixture(scope="module")
def believed():
    return believe()


@pytest.mark.parametrize("placed", [False, True], ids=["at the centre of gravity", "ahead of it, with upwash"])
def test_a_right_model_leaves_noise(believed, placed):
    """Two seconds of quiet flight, smoothed over 0.25 s, tell the floor to some 20 %; with what sensors ahead of the
    centre of gravity and curvature add, errors were more than twice the floor.
    """
    errors = {"az": {"position_m": (0.15, 0.0, 0.02)}, "alpha": {"position_m": (0.75, 0.0, 0.0), "scale": 1.2}}
    sensors = tuple(replace(s, **errors.get(s.channel, {})) for s in believed.suite.sensors)
    model = replace(believed, suite=replace(believed.suite, sensors=sensors)) if placed else believed
    for record in measure(model, 5):
        one = equation_errors(model, "m", record)
        assert set(one.errors) == {"CZ", "Cm"}
        for name, error in one.errors.items():
            assert error.std() < 1.6 * one.floor[name]


def test_a_missing_damper_shows_as_a_moment_that_follows_pitch_rate_and_of_its_size(believed):
    gain = 0.15
    damped = believed.with_effect(EFFECTS["pitch_damper"], {"gain_s": gain})
    found = [equation_errors(believed, "m", r) for r in measure(damped, 5)]
    shares = follows(found)
    assert max(shares["Cm"], key=shares["Cm"].get) == "q"
    assert shares["Cm"]["q"] > 0.5
    assert shares["CZ"]["q"] < shares["Cm"]["q"]
    y = np.concatenate([f.errors["Cm"] for f in found])
    q = np.concatenate([f.motion["q"] for f in found])
    # Cm_de times the gain; the servo's lag of 0.02 s and what is not linear take a tenth.
    assert (q @ y) / (q @ q) == pytest.approx(gain * believed.aircraft.coefficient("Cm_de"), rel=0.15)


def test_a_record_without_the_motion_has_no_equation_error(believed):
    record = measure(believed, 5)[0].select(["V", "q", "de_cmd"])
    assert equation_errors(believed, "m", record) is None
