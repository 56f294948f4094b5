"""Equation errors: nothing but noise where nothing is missing, and in proportion to what the missing moment follows."""

from __future__ import annotations

import numpy as np
import pytest
from gap_flights import believe, measure

from testbench.gap.effects import EFFECTS
from testbench.gap.forces import equation_errors, follows


@pytest.fixture(scope="module")
def believed():
    return believe()


def test_a_right_model_leaves_little_more_than_noise(believed):
    found = [equation_errors(believed, "m", r) for r in measure(believed, 5)]
    for one in found:
        assert set(one.errors) == {"CZ", "Cm"}
        for name, error in one.errors.items():
            # What is not linear in a motion of a few degrees adds to the noise, by less than as much again.
            assert error.std() < 2.0 * one.floor[name]


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
