"""An error beyond what the estimator states is said with its reason in the description of a card."""

import numpy as np

from testbench.questions.design.promised import Promise
from testbench.questions.design.realise import Errors, Realised
from testbench.questions.plan.flown_card import beyond_stated


def promise(errors):
    one = np.ones(2)
    found = Errors(errors, np.ones_like(errors), ())
    realised = Realised(one, found, np.zeros(2, bool))
    return Promise(("M_q", "M_de"), 10.0 * one, np.nan * one, one, {}, 14.0, 100.0, "", realised)


def test_what_simulated_flights_add_is_told_with_its_size():
    errors = np.random.default_rng(1).standard_normal((40, 2))
    assert beyond_stated(promise(errors)) == ""
    told = beyond_stated(promise(errors * [1.0, 3.0] + [5.0, 0.0]))
    assert "those of M_q were off by" in told
    assert "those of M_de scattered by" in told
    assert "\n" not in told


def test_nothing_is_told_without_simulated_flights():
    assert beyond_stated(None) == ""
