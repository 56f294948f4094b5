"""Derivatives that vary over a flight: the columns against integration, and the truth at trim in the intervals."""

from dataclasses import replace

import numpy as np
import pytest

import testbench as tb
from testbench.core.advice import wrong
from testbench.estimators.parametric.response import scheduled
from testbench.inference.form import FORM_STD, formed

RATE, FINE = 50.0, 10
TRUE = {"M_alpha": -12.0, "M_q": -4.0, "M_de": -20.0}


def pulses(size, t):
    u = np.zeros(t.size)
    for at, width, sign in (
        (1.0, 0.9, 1),
        (1.9, 0.6, -1),
        (2.5, 0.3, 1),
        (2.8, 0.3, -1),
        (7.0, 0.9, -1),
        (7.9, 0.6, 1),
    ):
        u[(t >= at) & (t < at + width)] = size * sign
    return u


def flown(size=0.12, bend=0.0, square=0.0, seed=1, noise=1.0, pressure=0.0):
    """Return 14 s of a short period whose derivatives are (1 + bend a + square a^2) of those at trim, a = alpha / 0.1.

    ``pressure`` is the amplitude of a swing of dynamic pressure that they follow.
    """
    t = np.arange(round(14.0 * RATE * FINE)) / RATE / FINE
    u, x, y = pulses(size, t), np.zeros(2), np.zeros((t.size // FINE, 2))
    share = pressure * np.sin(0.6 * t)
    for k in range(t.size):
        if k % FINE == 0:
            y[k // FINE] = x
        a, q = x
        s = (1.0 + bend * a / 0.1 + square * (a / 0.1) ** 2) * (1.0 + share[k])
        x = x + np.array([-2.0 * s * a + q - 0.2 * s * u[k], s * (-12.0 * a - 4.0 * q - 20.0 * u[k])]) / RATE / FINE
    rng = np.random.default_rng(seed)
    y = y + noise * np.array([1e-3, 2e-3]) * rng.standard_normal(y.shape)
    V = 50.0 * np.sqrt(1.0 + share[::FINE])
    columns = np.column_stack([y, u[::FINE], V - 50.0])
    trim = {"prepared": {"removed": {"V": 50.0}}}
    return tb.FlightRecord(t[::FINE], ("alpha", "q", "de", "V"), columns, "measured", provenance=trim)


def fitted(record):
    return tb.estimate("output_error", [record], ["de"], ["alpha", "q"], structure="short_period", held=["de"])


def off(model):
    return {n: (model.values[n] - v) / model.standard_errors[n] for n, v in TRUE.items()}


def test_a_schedule_moves_outputs_as_integration_does():
    record = flown(noise=0.0)
    model, n = fitted(flown()), len(record)
    s = np.sin(0.9 * record.t_s)[:, None]
    i = model.structure.parameter_names.index("M_alpha")
    u = record["de"][:, None]
    found = scheduled(model.structure, model.params, [i], u, record.dt_s, np.array([True]), np.zeros(2), s)[:, :, 0, 0]

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
