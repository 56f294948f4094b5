"""What the model lacks over time: nothing where it is right, and as much as a missing moment makes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from gap_flights import believe, measure

from testbench.effects import EFFECTS
from testbench.inference.unknown import rms_acceleration
from testbench.questions.gap.evidence.locate import Lacking, lacking
from testbench.questions.gap.name import unknown_motion


@pytest.fixture(scope="module")
def believed():
    return believe()


def looked_at(believed, record) -> Lacking:
    return lacking(believed, "m", record, unknown_motion(believed, record), believed.residuals(record))


def test_a_right_model_lacks_nothing(believed):
    """About 100 values a record: one of four standard errors is met once in 160 records."""
    for record in measure(believed, 5):
        found = looked_at(believed, record)
        for state, x in found.accelerations.items():
            assert np.all(np.abs(x) <= 4.0 * found.std[state] + 1e-12), state


def test_a_missing_damper_is_an_acceleration_against_the_pitch_rate(believed):
    damped = believed.with_effect(EFFECTS["pitch_damper"], {"gain_s": 0.15})
    x, y = [], []
    for record in measure(damped, 5):
        found = looked_at(believed, record)
        edges = np.searchsorted(record.t_s, found.t_s)
        q = record["q"] - record["q"][:50].mean()
        x += [float(np.mean(q[a:b])) for a, b in pairwise(edges)]
        y += found.accelerations["q"].tolist()
        assert found.kappa > 0.0
    assert np.corrcoef(x, y)[0, 1] < -0.9


def test_pulses_that_made_the_residual_are_found_to_within_their_errors(believed):
    """Some 400 values: the rms of their errors over what is stated lies within 0.85 and 1.15 but once in 10 000."""
    record, rng = measure(believed, 5)[0], np.random.default_rng(4)
    moved = unknown_motion(believed, record)
    u = 0.03 * rng.standard_normal(moved.shape[2])
    noise = rng.standard_normal(moved.shape[:2])
    found = lacking(believed, "m", record, moved, moved @ u + noise)
    assert found.kappa == pytest.approx(0.03, rel=0.01)
    there = believed.at(record)
    scale = [rms_acceleration(s, there.condition.V_m_s, record) for s in found.accelerations]
    true = (np.array(scale)[:, None] * u.reshape(len(scale), -1)).ravel()
    off = (np.concatenate(list(found.accelerations.values())) - true) / np.concatenate(list(found.std.values()))
    assert float(np.sqrt(np.mean(off**2))) == pytest.approx(1.0, abs=0.15)
