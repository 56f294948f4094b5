from dataclasses import replace

import numpy as np
import pytest

from testbench.core.constants import G0_M_S2
from testbench.core.errors import TrimError
from testbench.core.paths import aircraft_names
from testbench.flight import FlightCondition, Manoeuvre, fly, load_aircraft, trim
from testbench.flight.trim import horizon_rates
from testbench.inputs.signal import InputSignal


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


@pytest.mark.parametrize("name", aircraft_names())
def test_a_minute_without_input_stays_at_trim(name):
    """Measured 3e-6 m/s and 1e-4 m at 200 m/s, 2e-9 m/s and 1e-6 m at 16 m/s; without the rate of the horizon 0.12 m/s.

    What remains is Coriolis force growing with latitude.
    """
    aircraft = load_aircraft(name)
    trimmed = trim(aircraft, FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))
    rate = trimmed.rate_hz
    n = round(60.0 * rate)
    still = Manoeuvre("still", InputSignal(np.arange(n) / rate, np.zeros((n, 1)), ("de",)), settle_s=0.0)
    record = fly(aircraft, trimmed, still, 10.0, ("V", "alpha", "q", "theta", "phi", "h"))
    V = trimmed.condition.V_m_s
    assert record["q"] == pytest.approx(-V / (6335439.0 + trimmed.condition.h_m), rel=1e-3)  # no part of a phugoid
    assert record["V"] == pytest.approx(V, rel=1e-7)
    assert record["h"] == pytest.approx(trimmed.condition.h_m, rel=1e-6)
    for angle in ("alpha", "theta", "phi"):
        assert record[angle] == pytest.approx(record[angle][0], rel=0.0, abs=5e-6)


def test_horizon_rates_turn_with_the_velocity_over_the_ground():
    """Worked out by hand: north gives pitch, east gives roll about the north, both split by the attitude."""
    north = horizon_rates(0.0, 0.0, 0.0, np.array([100.0, 0.0, 0.0]))
    assert north == pytest.approx([0.0, -100.0 / 6335439.0, 0.0], rel=1e-12)
    still_ground = horizon_rates(0.0, 0.0, 0.0, np.array([100.0, 0.0, 0.0]), (-100.0, 0.0, 0.0))
    assert still_ground == pytest.approx([0.0, 0.0, 0.0], abs=1e-20)
    nose_up = horizon_rates(0.0, 0.3, 0.0, 100.0 * np.array([np.cos(0.3), 0.0, np.sin(0.3)]), (0.0, 50.0, 0.0))
    east = 50.0 / 6378137.0
    assert nose_up == pytest.approx([east * np.cos(0.3), -100.0 / 6335439.0, east * np.sin(0.3)], rel=1e-12)


@pytest.mark.parametrize(("V", "what"), [(8.0, "alpha"), (28.5, "thr = .* %"), (60.0, "outside the flight envelope")])
def test_a_speed_that_cannot_be_flown_is_refused_with_the_reason(eolo, V, what):
    with pytest.raises(TrimError, match=what):
        trim(eolo, FlightCondition(V, 547.0))


@pytest.mark.parametrize("missing", ["da", "dr"])
def test_sideslip_takes_the_place_of_a_missing_aileron_or_rudder(taurus, missing):
    without = replace(taurus, controls={n: c for n, c in taurus.controls.items() if n != missing})
    trimmed = trim(without, FlightCondition(16.0, 100.0))
    assert trimmed.beta != 0.0
    assert np.max(np.abs(trimmed.residual)) < 1e-9  # six equations, six unknowns
    assert abs(trimmed.beta) < 1e-3  # the turning Earth is all that asks for it
