from __future__ import annotations

import numpy as np
import pytest

from testbench.constants import G0_M_S2
from testbench.errors import TrimError
from testbench.flight import FlightCondition, trim


@pytest.mark.parametrize("name", ["eolo", "taurus"])
def test_forces_and_moments_balance(name, request):
    trimmed = request.getfixturevalue(f"{name}_trim")
    assert np.max(np.abs(trimmed.residual)) < 1e-9
    assert trimmed.state["V"] == pytest.approx(trimmed.condition.V_m_s, rel=1e-12)
    assert trimmed.state["h"] == pytest.approx(trimmed.condition.h_m, rel=1e-9)
    # An accelerometer at rest in level flight reads gravity. Height and the turning Earth change it by some 0.3 %.
    assert np.hypot(trimmed.state["ax"], trimmed.state["az"]) == pytest.approx(G0_M_S2, rel=5e-3)
    assert trimmed.theta == trimmed.alpha


def test_climb_points_the_flight_path_up(eolo):
    trimmed = trim(eolo, FlightCondition(16.0, 547.0, gamma_rad=0.05))
    assert trimmed.theta - trimmed.alpha == pytest.approx(0.05)
    assert trimmed.state["hdot"] == pytest.approx(16.0 * np.sin(0.05), rel=1e-6)


def test_elastic_modes_rest_in_static_equilibrium(eolo, eolo_trim):
    K, _, gain = eolo.elastic.matrices(eolo_trim.state["qbar"], 16.0)
    alpha, de = eolo_trim.state["alpha"], eolo_trim.state["de"]
    force = np.array(
        [
            m.force.get("zero", 0) + m.force.get("alpha", 0) * alpha + m.force.get("de", 0) * de
            for m in eolo.elastic.modes
        ]
    )
    eta = np.linalg.solve(K, gain * force)
    assert [eolo_trim.state[f"eta_{i}"] for i in range(1, 9)] == pytest.approx(eta, rel=1e-6, abs=1e-9)
    assert all(abs(eolo_trim.state[f"etaddot_{i}"]) < 1e-9 for i in range(1, 9))


@pytest.mark.parametrize(("V", "what"), [(8.0, "alpha"), (28.5, "thr = .* %"), (60.0, "outside the flight envelope")])
def test_a_speed_that_cannot_be_flown_is_refused_with_the_reason(eolo, V, what):
    with pytest.raises(TrimError, match=what):
        trim(eolo, FlightCondition(V, 547.0))
