"""An aircraft drawn by the deviations that it states."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from believed_taurus import believed_taurus
from scipy.signal import lsim

from testbench.aircraft.airframe import mode_at, wing_acceleration, wing_strain
from testbench.aircraft.believed import drawn, stated_deviations
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


FOLDER = Path(__file__).resolve().parents[2] / "aircraft_models" / "taurus"


@pytest.fixture(scope="module")
def derive():
    spec = importlib.util.spec_from_file_location("derive_taurus", FOLDER / "derive.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_file_holds_the_thrust_law_that_the_script_derives(derive):
    text = (FOLDER / "taurus.xml").read_text(encoding="utf-8")
    assert text == derive.amended_xml(), "run aircraft_models/taurus/derive.py --write"


def test_the_propeller_balances_the_motor(derive):
    """At rest the closed form: n from P = CP0 rho n^3 D^5, thrust = CT0 rho n^2 D^4."""
    power = np.polyval(derive.POWER_W, 0.7)
    n = (power / (derive.CP[-1] * derive.DENSITY_KG_M3 * derive.DIAMETER_M**5)) ** (1 / 3)
    assert derive.thrust(0.7, 0.0) == pytest.approx(derive.CT[-1] * derive.DENSITY_KG_M3 * n**2 * derive.DIAMETER_M**4)
    assert derive.thrust(0.7, 12.0) < derive.thrust(0.7, 6.0)


@pytest.mark.parametrize("V", [10.0, 12.0, 15.0, 18.0])
def test_thrust_at_trim_is_that_of_motor_and_propeller(derive, V):
    """Throttle found by trim, put into motor and propeller, gives the thrust that the simulator reports, to the fit."""
    trimmed = trim(load_aircraft("taurus"), FlightCondition(V, 100.0))
    assert trimmed.state["thrust"] == pytest.approx(derive.thrust(trimmed.controls["thr"], V), abs=0.15)


def test_geometry_is_that_of_table_1():
    taurus = load_aircraft("taurus")
    inch = 0.0254
    assert taurus.geometry.S_m2 == pytest.approx(435 * inch**2, rel=1e-3)
    assert taurus.geometry.b_m == pytest.approx(50 * inch)
    assert taurus.geometry.cbar_m == pytest.approx(taurus.geometry.S_m2 / taurus.geometry.b_m, rel=1e-3)
    assert taurus.controls["de"].full == pytest.approx(np.radians(12.5))
    assert taurus.controls["dr"].full == pytest.approx(np.radians(25.0))
