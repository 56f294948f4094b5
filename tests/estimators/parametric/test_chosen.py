"""Which parameters records ask for: those that made them, and no others; what is held is said."""

import numpy as np
import pytest
from scipy.signal import cont2discrete

import testbench as tb
from testbench.core.errors import ScenarioError
from testbench.core.record import FlightRecord
from testbench.questions.identify.scenario import RecordDescription

STEPS = ((2.0, 2.9, 1), (2.9, 3.5, -1), (3.5, 3.8, 1), (3.8, 4.1, -1), (9.0, 9.8, -1), (9.8, 10.4, 1), (13.0, 13.6, 1))
NOISE = (0.002, 0.003)


def flight(seed, Z_q=0.0, Z_de=0.0):
    """Return 20 s of a short period at 50 Hz, driven by an elevator that is held; noise of 0.1 deg and 0.2 deg/s."""
    A, B, dt = np.array([[-1.2, 1.0 + Z_q], [-9.0, -2.2]]), np.array([[Z_de], [-8.0]]), 0.02
    t = np.arange(1000) * dt
    u = sum(s * 0.05 * ((t >= b - 1e-9) & (t < e - 1e-9)) for b, e, s in STEPS)
    Ad, Bd, *_ = cont2discrete((A, B, np.eye(2), np.zeros((2, 1))), dt)
    x = np.zeros((t.size, 2))
    for k in range(t.size - 1):
        x[k + 1] = Ad @ x[k] + Bd[:, 0] * u[k]
    data = np.column_stack([x + NOISE * np.random.default_rng(seed).standard_normal(x.shape), u])
    return FlightRecord(t, ("alpha", "q", "de"), data, "measured")


def chosen(record, method="output_error", **settings):
    given = {"structure": "short_period", "choose": True, **settings}
    return tb.estimate(method, [record], ["de"], ["alpha", "q"], **given)


def held(model):
    return {n for n, free in zip(model.structure.parameter_names, model.structure.free, strict=True) if not free}


@pytest.mark.parametrize("method", [pytest.param("output_error", marks=pytest.mark.slow), "equation_error"])
def test_what_made_the_record_stays_and_what_did_not_is_held_at_zero(method):
    for seed in range(6):
        both = chosen(flight(seed), method)
        assert held(both) == {"Z_q", "Z_de"}
        assert both.values["Z_de"] == 0.0
        assert held(chosen(flight(seed, Z_de=-0.3), method)) == {"Z_q"}


@pytest.mark.parametrize(("flights", "most"), [(4, 1), pytest.param(12, 2, marks=pytest.mark.slow)])
def test_one_flight_in_hundreds_keeps_what_it_should_not(flights, most):
    """z^2 beyond log N has a probability of 1 % for 1000 samples: more than 1 of 8, or 2 of 24, by 2 in 1000."""
    kept = sum(len({"Z_q", "Z_de"} - held(chosen(flight(10 + k)))) for k in range(flights))
    assert kept <= most


def test_fewer_parameters_are_known_better_and_the_choice_is_said():
    record = flight(1)
    few, every = chosen(record), chosen(record, choose=False)
    assert few.standard_errors["Z_alpha"] < every.standard_errors["Z_alpha"]
    for name, truth in {"Z_alpha": -1.2, "M_alpha": -9.0, "M_q": -2.2, "M_de": -8.0}.items():
        assert abs(few.values[name] - truth) < 4.0 * few.standard_errors[name]
    (said,) = [a for a in few.advice if a.code == "structure_chosen"]
    assert "Z_q = 0" in said
    assert "Z_de = 0" in said


def test_what_is_held_is_held_at_its_start_and_what_is_fixed_is_not_chosen_among():
    model = chosen(flight(2, Z_de=-0.3), start={"Z_de": -0.3, "M_q": -2.2}, fixed=("M_q",))
    assert {"Z_de", "M_q"} <= held(model)
    assert model.values["Z_de"] == -0.3
    assert "M_q" not in next(a for a in model.advice if a.code == "structure_chosen")


def test_a_description_without_a_structure_has_nothing_to_choose():
    description = RecordDescription.load("attas_full").choosing()
    assert all(e.choose for e in description.identification.estimators if hasattr(e, "structure"))
    with pytest.raises(
        ScenarioError, match=r"attas_short_period\.toml: an estimator that fits a structure must be among"
    ):
        RecordDescription.load("attas_short_period").choosing()
