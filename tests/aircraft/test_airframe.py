from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lsim

from testbench.aircraft.airframe import mode_at, wing_acceleration, wing_strain
from testbench.core.errors import ModelError
from testbench.flight import FlightCondition, Manoeuvre, fly, linearise, load_aircraft, trim
from testbench.inputs.signal import InputSignal


@pytest.fixture(scope="module")
def flight(eolo, eolo_trim):
    n = 2000
    u = np.zeros((n, 2))
    u[:100, 0], u[100:200, 0] = 0.05, -0.05
    u[600:700, 1], u[700:800, 1] = 0.1, -0.1
    signal = InputSignal(np.arange(n) / 500.0, u, ("de", "da"))
    return fly(eolo, eolo_trim, Manoeuvre("kick", signal, settle_s=0.5), 500.0)


def test_at_the_stations_the_shapes_are_those_of_the_file(eolo):
    for k, y in enumerate(eolo.elastic.stations_m):
        expected = [m.shape.bend_m[k] for m in eolo.elastic.modes]
        assert mode_at(eolo.elastic, "bend_m", y) == pytest.approx(expected, abs=1e-12)


def test_tip_deflection_of_one_chord_is_one_unit_of_a_bending_mode(eolo):
    tip = mode_at(eolo.elastic, "bend_m", 2.0)
    for i in (0, 2, 6, 7):
        assert tip[i] == pytest.approx(eolo.geometry.cbar_m, rel=1e-4)  # the file carries five digits


def test_a_flight_records_what_its_wing_stations_feel(eolo, flight):
    for i, s in enumerate(eolo.wing_stations, 1):
        expected = wing_acceleration(flight, eolo.elastic, s.y_m, s.x_m)
        np.testing.assert_array_equal(flight[f"az_wing_{i}"], expected)
        np.testing.assert_array_equal(flight[f"strain_wing_{i}"], wing_strain(flight, eolo.elastic, s.y_m, s.height_m))


def test_only_the_stations_asked_for_are_recorded(eolo, eolo_trim):
    signal = InputSignal(np.arange(100) / 500.0, np.full((100, 1), 0.01), ("de",))
    manoeuvre = Manoeuvre("short", signal, settle_s=0.0)
    some = fly(eolo, eolo_trim, manoeuvre, 100.0, channels=("q", "az_wing_2"))
    assert some.channels == ("q", "az_wing_2")
    np.testing.assert_array_equal(some["az_wing_2"], fly(eolo, eolo_trim, manoeuvre, 100.0)["az_wing_2"])
    rigid = eolo.with_rigid_wings()
    flown = fly(rigid, trim(rigid, FlightCondition(16.0, 547.0)), manoeuvre, 100.0)
    assert "az_wing_11" in flown
    assert "strain_wing_1" not in flown


def test_the_linear_model_moves_the_stations_as_the_flight_does(eolo, eolo_trim):
    n, dt = 1000, 1.0 / 500.0
    u = np.zeros((n, 1))
    u[:100], u[100:200] = 0.005, -0.005
    flown = fly(eolo, eolo_trim, Manoeuvre("kick", InputSignal(np.arange(n) * dt, u, ("de",)), 0.0), 500.0)
    linear = linearise(eolo, eolo_trim)
    for name in ("az_wing_1", "az_wing_9", "strain_wing_6"):
        row, column = linear.outputs.index(name), linear.inputs.index("de_cmd")
        system = (linear.A, linear.B[:, [column]], linear.C[[row]], linear.D[row, column][None, None])
        y = lsim(system, u[:, 0], np.arange(n) * dt)[1]
        moved = flown[name][:n] - flown[name][0]
        # a doublet of 0.3 deg: what is left is the lag of a held command and the aircraft's nonlinearity
        np.testing.assert_allclose(y, moved, atol=0.02 * np.abs(moved).max())


def test_curvature_is_the_second_derivative_of_the_shape(eolo):
    """By differences of the interpolated first bending, which err by 1 % of the curvature at the root."""
    h, root = 0.05, mode_at(eolo.elastic, "curvature_1_m", 0.0)[0]
    for y in (0.3, 0.7, 1.1, 1.5):
        bend = [mode_at(eolo.elastic, "bend_m", y + k * h)[0] for k in (-1, 0, 1)]
        curvature = mode_at(eolo.elastic, "curvature_1_m", y)[0]
        assert (bend[0] - 2 * bend[1] + bend[2]) / h**2 == pytest.approx(curvature, abs=0.01 * root)


def test_the_accelerometer_reads_the_second_derivative_of_the_displacement(eolo, flight):
    """Wing station less CG against the modal displacement, differentiated twice, and the rates."""
    y, dt = -1.8, flight.dt_s
    up = flight.columns(f"eta_{i}" for i in range(1, 9)) @ mode_at(eolo.elastic, "bend_m", y)
    by_hand = -np.gradient(np.gradient(up, dt), dt) + y * flight["pdot"] + flight["r"] * flight["q"] * y
    read = wing_acceleration(flight, eolo.elastic, y) - flight["az"]
    inner = slice(5, -5)
    steps = np.zeros(len(flight), bool)
    for t in (0.5, 0.7, 0.9, 1.7, 1.9, 2.1):  # differences over the corners of the input are no derivative
        steps |= np.abs(flight.t_s - t) < 0.03
    keep = ~steps[inner]
    error = (read - by_hand)[inner][keep]
    assert np.std(error) < 0.02 * np.std(read[inner][keep])


def test_rigid_wings_move_with_the_body(flight):
    still = wing_acceleration(flight, None, 0.0)
    assert np.array_equal(still, flight["az"])
    turned = wing_acceleration(flight, None, 1.5, 0.2)
    expected = flight["az"] + 1.5 * flight["pdot"] - 0.2 * flight["qdot"]
    expected = expected + flight["r"] * (0.2 * flight["p"] + 1.5 * flight["q"])
    assert turned == pytest.approx(expected)


def test_lift_compresses_the_upper_skin_and_asymmetric_modes_strain_both_sides_opposite(eolo, flight):
    strain = wing_strain(flight, eolo.elastic, 0.1, 0.01)
    assert strain[0] < 0.0
    left, right = (wing_strain(flight, eolo.elastic, y, 0.01) for y in (-0.8, 0.8))
    before_aileron = flight.t_s < 1.6
    assert left[before_aileron] == pytest.approx(right[before_aileron], abs=1e-9)
    assert np.max(np.abs(left - right)) > 1e-6


def test_a_station_beyond_the_tip_and_a_mode_without_shape_are_refused(eolo, flight):
    with pytest.raises(ModelError, match=r"0 to 2 m\), got y = 2.5 m"):
        wing_acceleration(flight, eolo.elastic, 2.5)
    taurus = load_aircraft("taurus")
    record = fly(
        taurus,
        trim(taurus, FlightCondition(12.0, 100.0)),
        Manoeuvre("rest", InputSignal(np.arange(240) / 240.0, np.zeros((240, 1)), ("de",)), 0.0),
        24.0,
    )
    assert wing_acceleration(record, taurus.elastic, 0.5) == pytest.approx(record["az"], abs=1e-6)
