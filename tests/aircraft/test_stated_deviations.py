"""An aircraft drawn by the deviations that it states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from believed_taurus import believed_taurus

from testbench.aircraft.believed import drawn, stated_deviations
from testbench.core.errors import ModelError
from testbench.flight import load_aircraft

STATED = {"Cm_alpha": 0.2, "CL_alpha": 0.05, "CD": 0.3}


@pytest.fixture(scope="module")
def mine(tmp_path_factory):
    return load_aircraft(believed_taurus(tmp_path_factory.mktemp("believed"), STATED))


def factors(aircraft, seed, index) -> dict[str, float]:
    (amendment,) = drawn(aircraft, seed, index).amendments
    return {change.name: change.factor for change in amendment.changes}


def test_draws_have_the_stated_moments_and_are_independent(mine):
    """2000 draws of one seed; five standard errors each: a false alarm has a probability below 1e-5."""
    n = 2000
    x = np.array([[factors(mine, 1, i)[name] for name in STATED] for i in range(n)])
    std = np.array(list(STATED.values()))
    assert np.all(np.abs(x.mean(axis=0) - 1.0) < 5.0 * std / np.sqrt(n))
    assert np.all(np.abs(x.std(axis=0) / std - 1.0) < 5.0 / np.sqrt(2 * n))
    assert np.all(np.abs(np.corrcoef(x.T)[np.triu_indices(3, 1)]) < 5.0 / np.sqrt(n))


def test_a_draw_does_not_depend_on_the_other_coefficients(mine):
    alone = replace(mine, uncertainty={"Cm_alpha": 0.2})
    assert factors(alone, 7, 3) == {"Cm_alpha": factors(mine, 7, 3)["Cm_alpha"]}
    assert factors(mine, 7, 3) == factors(mine, 7, 3)
    assert factors(mine, 7, 3) != factors(mine, 8, 3)


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({}, r"taurus must state how well its coefficients are known.*\[uncertainty\]; write that"),
        ({"Cm_alfa": 0.1}, r"must name coefficients of the model, got 'Cm_alfa'; did you mean 'Cm_alpha'"),
    ],
)
def test_what_cannot_be_drawn_is_refused(stated, words):
    with pytest.raises(ModelError, match=words):
        stated_deviations(replace(load_aircraft("taurus"), uncertainty=stated))


def test_a_relative_deviation_of_zero_is_refused(mine):
    value = mine.coefficient("Cm_alpha")
    nothing = replace(mine, xml=mine.xml.replace(f"{value:g}<", "0.0<"))
    assert nothing.coefficient("Cm_alpha") == 0.0
    with pytest.raises(ModelError, match=r"values that are not zero, got 'Cm_alpha'"):
        stated_deviations(nothing)
