"""Derivatives that vary over a flight: the columns against integration, and the truth at trim in the intervals."""

from dataclasses import replace

import numpy as np
import pytest
from varying import TRUE, fitted, flown

import testbench as tb
from testbench.core.advice import wrong
from testbench.estimators.parametric.response import Sampling, scheduled
from testbench.inference.form import FORM_STD, formed


def off(model):
    return {n: (model.values[n] - v) / model.standard_errors[n] for n, v in TRUE.items()}


def test_a_schedule_moves_outputs_as_integration_does():
    record = flown(noise=0.0)
    model, n = fitted(flown()), len(record)
    s = np.sin(0.9 * record.t_s)[:, None]
    i = model.structure.parameter_names.index("M_alpha")
    u = record["de"][:, None]
    found = scheduled(model.structure, model.params, [i], u, Sampling(record.dt_s, np.array([True])), np.zeros(2), s)[
        :, :, 0, 0
    ]

    def integrated(c):
        there, fine = model.structure.matrices(model.params), 20
        slope = (model.structure.matrices(model.params + 1e-6 * np.eye(model.params.size)[i]).A - there.A) / 1e-6
        x, y = np.zeros(2), np.zeros((n, 2))
        for k in range(n):
            y[k] = there.C @ x
            for j in range(fine):
                A = there.A + c * np.sin(0.9 * (record.t_s[k] + j * record.dt_s / fine)) * slope
                x = x + (A @ x + there.B[:, 0] * u[k, 0]) * record.dt_s / fine
        return y

    change = (integrated(0.01) - integrated(-0.01)) / 0.02
    assert np.max(np.abs(found - change)) < 0.02 * np.max(np.abs(change))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("bend", "square", "pressure"), [(0.15, 0.0, 0.0), (0.0, 0.15, 0.0), (0.0, 0.0, 0.1)])
def test_derivatives_at_trim_are_found_where_what_is_left_of_a_linear_model_is_no_noise(bend, square, pressure, seed):
    """Within four errors: false alarm of all 27 together 2e-3."""
    record = flown(bend=bend, square=square, pressure=pressure, seed=seed)
    linear = fitted(record)
    assert np.max(linear.diagnostics["whiteness_p"]) < 1e-6
    model = formed(linear, [record], FORM_STD, 50.0)
    assert max(map(abs, off(model).values())) < 4.0
    assert all(model.standard_errors[n] < 0.03 * abs(v) for n, v in TRUE.items())
    assert "form" in [a.code for a in model.advice]


def test_a_stability_that_is_a_small_difference_varies_by_what_cancels_in_it():
    record = flown(0.03, M_alpha=-0.6, shift=4.0)  # and not by a share of 0.6, which explains little
    linear = fitted(record)
    model = formed(linear, [record], FORM_STD, 50.0)
    assert abs(model.values["M_alpha"] + 0.6) < 3.0 * model.standard_errors["M_alpha"]
    assert model.standard_errors["M_alpha"] < 0.5 * linear.standard_errors["M_alpha"]


def test_a_linear_flight_keeps_its_derivatives_and_errors_grow_with_how_far_it_flew():
    grown = []
    for size in (0.02, 0.12):
        record = flown(size)
        linear = fitted(record)
        model = formed(linear, [record], FORM_STD, 50.0)
        assert max(map(abs, off(model).values())) < 4.0
        assert model.advice == linear.advice
        grown.append(model.standard_errors["M_q"] / linear.standard_errors["M_q"])
    assert 1.0 <= grown[0] < 1.1 < grown[1]


def test_without_a_prior_and_for_other_methods_nothing_changes():
    record = flown()
    linear = fitted(record)
    assert formed(linear, [record], {}, 50.0) is linear
    other = tb.estimate("equation_error", [record], ["de"], ["alpha", "q"], structure="short_period")
    assert formed(other, [record], FORM_STD, 50.0) is other


def test_what_is_wrong_for_another_reason_stays_wrong():
    record = flown()
    model = replace(fitted(record), advice=(wrong("on_bound", "a bound sets the value"),))
    assert [a.code for a in formed(model, [record], FORM_STD, 50.0).advice] == ["on_bound"]
