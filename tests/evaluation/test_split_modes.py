"""A mode that has split into two real roots: its names, its frequency, and what is said of it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from testbench.estimators.settings import DsrE
from testbench.evaluation.excitation import excitation
from testbench.evaluation.modes import frequency_of, roots_of
from testbench.evaluation.poles import match_poles
from testbench.flight.linear_model import LinearModel
from testbench.questions.run.findings import alpha_findings

SPLIT = {"phugoid": -0.003 + 0.5j, "short period, slow root": -1.6 + 0j, "short period, fast root": -7.3 + 0j}


def test_roots_of_a_mode_go_by_its_name():
    assert list(roots_of(SPLIT, "short period")) == ["short period, slow root", "short period, fast root"]
    assert roots_of(SPLIT, "phugoid") == {"phugoid": SPLIT["phugoid"]}
    assert frequency_of(SPLIT, "short period") == pytest.approx(np.sqrt(1.6 * 7.3))
    assert frequency_of({"short period": 3.0 + 4.0j}, "short period") == pytest.approx(5.0)
    assert frequency_of(SPLIT, "Dutch roll") is None


def case(outputs, found):
    evaluation = SimpleNamespace(
        poles=match_poles(found, SPLIT, ", ".join(outputs)),
        validation=SimpleNamespace(mrse_percent=np.full(len(outputs), 10.0)),
    )
    estimator = DsrE(method="dsr_e", order=4, past_horizon=20, future_horizon=4)
    return SimpleNamespace(estimator=estimator, model=SimpleNamespace(outputs=outputs), evaluation=evaluation)


def test_what_alpha_bought_is_said_root_by_root():
    without, with_alpha = case(("q",), [0.5j, -1.9]), case(("q", "alpha"), [0.5j, -1.7, -7.0])
    (text,) = alpha_findings([without, with_alpha])
    assert "the slow root of its short period is -1.90 1/s without alpha, -1.70 1/s with alpha (true -1.60 1/s)" in text
    assert "the fast root of its short period is not found without alpha, -7.00 1/s with alpha (true -7.30" in text
    (text,) = alpha_findings([without, case(("q", "alpha"), [0.5j, -1.7])])
    assert "the fast root of its short period is not found, with or without alpha (true -7.30 1/s)" in text


def test_the_band_of_a_real_root_is_that_of_a_lag():
    """Response to a short pulse of area 1: y = exp(s t), half power at |s|, all of the pulse's energy spread evenly."""
    s, dt, T = -2.0, 0.01, 20.0
    u = np.zeros((int(T / dt), 1))
    u[0] = 1.0 / dt
    one = np.ones((1, 1))
    model = LinearModel(s * one, one, one, 0.0 * one, ("x",), ("de",), ("q",))
    (found,) = excitation(model, {"lag": complex(s)}, ["de"], u, dt, {"q": 0.1}, dt, T)
    low, high = found.band_rad_s
    assert (low, high) == pytest.approx((0.05 * 2.0, 2.0))
    energy = (np.arctan(high / 2.0) - np.arctan(low / 2.0)) / 2.0 / np.pi
    noise = 0.1**2 * T * dt * (high - low) / np.pi
    assert found.snr_db["q"] == pytest.approx(10.0 * np.log10(energy / noise), abs=0.01)
    assert "lag (real, -2.00 1/s) is excited" in found.sentence
