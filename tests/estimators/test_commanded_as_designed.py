"""What was planned before a flight does not react to it: no feedback is sought in records that follow a card."""

from dataclasses import replace

import numpy as np
import pytest

import testbench as tb
from testbench.core.record import AS_DESIGNED, FlightRecord


@pytest.fixture(scope="module")
def fed_back():
    """A short period whose elevator follows a doublet and the pitch rate, with gusts: closed loop by its residuals."""
    rng, n, dt = np.random.default_rng(5), 1500, 0.02
    A, B = np.array([[-2.0, 0.96], [-12.0, -2.5]]), np.array([-0.1, -15.0])
    x, gust, rows = np.zeros(2), 0.0, []
    for k in range(n):
        gust += dt * (-gust / 0.5) + 0.02 * np.sqrt(dt) * rng.standard_normal()
        u = 0.05 * np.sign(np.sin(0.8 * k * dt)) + 0.5 * x[1]
        rows.append([*x, u])
        x = x + dt * (A @ x + B * u + np.array([2.0, 12.0]) * gust)
    data = np.array(rows) + np.array([5e-4, 5e-4, 0.0]) * rng.standard_normal((n, 3))
    return FlightRecord(t_s=dt * np.arange(n), channels=("alpha", "q", "de"), data=data, kind="measured")


def causes_of(record):
    model = tb.estimate("ssarx", [record], ("de",), ("alpha", "q"), order=2, past_horizon=15, future_horizon=15)
    return {c["code"] for c in tb.with_causes(model, [record]).diagnostics["causes"]}


def test_feedback_is_named_unless_the_commands_were_planned(fed_back):
    assert "closed_loop" in causes_of(fed_back)
    planned = replace(fed_back, provenance={AS_DESIGNED: 0.999})
    assert "closed_loop" not in causes_of(planned)
    assert "closed_loop" not in causes_of(replace(fed_back, provenance={"recorded": {AS_DESIGNED: 0.999}}))
    assert "closed_loop" in causes_of(replace(fed_back, provenance={AS_DESIGNED: 0.95}))
