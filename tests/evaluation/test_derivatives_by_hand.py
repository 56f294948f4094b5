"""Derivatives, true parameters and the excited band against models that are built from numbers known beforehand.

What is known of an aircraft whose aileron and rudder move: its lateral-directional modes, and what excites them.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from testbench.core.record import FlightRecord
from testbench.evaluation.derivatives import Derivative, ParameterEstimate, dimensional_derivatives, true_parameters
from testbench.evaluation.modes import lateral_modes
from testbench.evaluation.truth import _possible, excited, excited_band, true_model
from testbench.flight import FlightCondition, LinearModel, fly, load_aircraft, trim
from testbench.flight.simulate import Manoeuvre
from testbench.inputs.signal import InputSignal
from testbench.sensors import load_suite

V, ALPHA = 20.0, 0.15
STATES = ("u", "w", "q", "theta", "v", "p", "r", "phi", "eta_1", "etadot_1")
INPUTS = ("de", "thr", "da", "dr")
LONGITUDINAL = ("V", "alpha", "q", "de", "thr")
LATERAL = ("beta", "p", "r", "da", "dr")
TRUE = {
    f"{axis}_{variable}": value
    for axes, variables in (("XZM", LONGITUDINAL), ("YLN", LATERAL))
    for axis, row in zip(axes, np.random.default_rng(8).normal(0.0, 5.0, (3, 5)), strict=True)
    for variable, value in zip(variables, row, strict=True)
}
MODE_RAD_S, LIFTED, PITCHED = 30.0, 40.0, -3.0  # a mode driven by alpha and de, which acts on Z and M


def motions() -> dict[str, np.ndarray]:
    """Return motion or control -> the change of (x, u), stability axes turned into body axes by the trim alpha."""
    c, s = np.cos(ALPHA), np.sin(ALPHA)
    out = {name: np.zeros(len(STATES) + len(INPUTS)) for name in (*LONGITUDINAL, *LATERAL)}
    out["V"][:2], out["alpha"][:2], out["beta"][4] = (c, s), (-V * s, V * c), V
    for name in ("q", "p", "r", *INPUTS):
        out[name][(STATES + INPUTS).index(name)] = 1.0
    return out


def built() -> LinearModel:
    """Return the linear model with the derivatives TRUE: forces of the stability axes, and the turning of the frame."""
    c, s = np.cos(ALPHA), np.sin(ALPHA)
    rows = np.zeros((len(STATES), len(STATES) + len(INPUTS)))
    inverse = np.linalg.pinv(np.array(list(motions().values())))
    for k, name in enumerate(motions()):
        f = {axis: TRUE.get(f"{axis}_{name}", 0.0) for axis in "XYZLMN"}
        rates = np.zeros(len(STATES))
        rates[:3] = (
            c * f["X"] - s * f["Z"] - V * s * (name == "q"),
            s * f["X"] + c * f["Z"] + V * c * (name == "q"),
            f["M"],
        )
        rates[4:7] = f["Y"] + V * s * (name == "p") - V * c * (name == "r"), f["L"], f["N"]
        rates[9] = LIFTED * {"alpha": 1.0, "de": 0.5}.get(name, 0.0)
        rows += np.outer(rates, inverse[:, k])
    rows[[0, 1, 2], 8] = -s * 7.0, c * 7.0, PITCHED  # Z and M of the mode
    rows[8, 9], rows[9, 8], rows[9, 9] = 1.0, -(MODE_RAD_S**2), -2.0
    n = len(STATES)
    return LinearModel(rows[:, :n], rows[:, n:], np.eye(n), np.zeros((n, 4)), STATES, INPUTS, STATES)


def test_the_derivatives_a_model_was_built_from_come_back() -> None:
    at = SimpleNamespace(condition=SimpleNamespace(V_m_s=V), alpha=ALPHA)
    found = {d.name: d for d in dimensional_derivatives(built(), at)}
    assert set(found) == {*TRUE, "Z_alpha/V", "Y_beta/V"}
    forces, drives = {"Z": 7.0, "M": PITCHED}, {"alpha": 1.0, "de": 0.5}
    deflection = LIFTED / MODE_RAD_S**2
    follows = {f"{a}_{n}": force * deflection * drive for a, force in forces.items() for n, drive in drives.items()}
    for name, value in TRUE.items():
        assert found[name].held == pytest.approx(value, rel=1e-9), name
        assert found[name].static == pytest.approx(value + follows.get(name, 0.0), rel=1e-9), name
    assert found["Z_alpha/V"].held == pytest.approx(TRUE["Z_alpha"] / V)
    assert found["Y_beta/V"].static == pytest.approx(TRUE["Y_beta"] / V)
    units = {
        "X_V": "1/s",
        "Z_alpha": "m/s²",
        "M_V": "1/(m s)",
        "M_q": "1/s",
        "Y_p": "m/s",
        "N_dr": "1/s²",
        "Z_alpha/V": "1/s",
    }
    assert {name: found[name].unit for name in units} == units


def test_true_parameters_are_held_or_static_and_per_airspeed_as_the_structure_has_them() -> None:
    derivatives = [Derivative("Z_de", "", "", 6.0, 4.0), Derivative("M_de", "", "", -9.0, -8.0),
                   Derivative("Z_alpha/V", "", "", 1.0, 1.0), Derivative("X_V", "", "", 3.0, None)]  # fmt: skip
    assert true_parameters("short_period", derivatives, 2.0) == {"Z_de": 2.0, "M_de": -8.0, "X_V": 3.0}
    assert true_parameters("longitudinal", derivatives, 2.0) == {"Z_de": 4.0, "M_de": -8.0, "X_V": 3.0}
    assert true_parameters("flexible", derivatives, 2.0) == {"Z_de": 6.0, "M_de": -9.0, "X_V": 3.0}
    assert true_parameters("a user's own", derivatives, 2.0) == {}


def test_an_error_is_counted_in_standard_errors() -> None:
    assert ParameterEstimate("a", 5.0, 0.5, 0.5, True, 4.0).deviations == pytest.approx(2.0)
    assert ParameterEstimate("a", 5.0, 0.0, 0.0, False, 4.0).deviations is None
    assert ParameterEstimate("a", 5.0, 0.5, 0.5, True, None).deviations is None


@pytest.mark.parametrize("floor", [0.01, 0.25])
def test_the_excited_band_ends_where_the_pulses_have_the_floor_of_their_density(floor: float) -> None:
    """A pulse of T s has the density sinc^2; two unlike records and two channels add up."""
    from scipy.optimize import brentq

    dt, rows = 0.01, 6000

    def record(length_s: float, channel: int, size: float) -> FlightRecord:
        u = np.zeros((rows, 2))
        u[100 : 100 + round(length_s / dt), channel] = size
        return FlightRecord(dt * np.arange(rows), ("de", "da"), u, "truth")

    pulses = [(2.0, 0, 1.0), (0.5, 1, 2.0)]
    omega = excited_band([record(*p) for p in pulses], ("de", "da"), floor)

    def density(w: float) -> float:
        return sum((size * np.sin(0.5 * w * T) / (0.5 * w)) ** 2 for T, _, size in pulses)

    assert omega.shape == (60,)
    assert np.allclose(np.diff(np.log(omega)), np.log(omega[-1] / omega[0]) / 59)
    assert omega[0] == pytest.approx(0.1)
    grid = np.geomspace(0.1, 0.8 * np.pi / dt, 400)
    wanted = grid[[density(w) >= floor * density(0.1) for w in grid]]
    assert omega[-1] == pytest.approx(wanted[-1])
    assert brentq(lambda w: density(w) - floor * density(0.1), *(wanted[-1] * np.array([0.999, 1.03]))) > omega[-1]


LATERAL_MODES = ["spiral", "Dutch roll", "roll"]


@pytest.fixture(scope="module")
def taurus():
    aircraft = load_aircraft("taurus")
    return aircraft, trim(aircraft, FlightCondition(14.0, 100.0))


def test_inputs_say_whose_modes_are_asked_for(taurus):
    longitudinal = list(true_model(*taurus).modes)
    assert list(true_model(*taurus, ("de_cmd", "thr")).modes) == longitudinal
    assert list(true_model(*taurus, ("da_cmd", "dr")).modes) == LATERAL_MODES
    assert list(true_model(*taurus, ("de", "da")).modes) == [*longitudinal, *LATERAL_MODES]


def test_lateral_modes_are_eigenvalues_of_their_motion(taurus):
    known = true_model(*taurus, ("da",))
    poles = np.linalg.eigvals(known.linear.lateral().A)
    assert all(np.min(np.abs(poles - s)) < 1e-9 for s in known.modes.values())
    assert known.modes["Dutch roll"].imag > 1.0
    assert known.modes["roll"].real < -5.0
    assert abs(known.modes["spiral"]) < 0.2


def test_roll_and_spiral_that_have_joined_are_one_pair(taurus):
    known = true_model(*taurus, ("da",))
    whole = known.linear
    i, p, phi = (whole.states.index(s) for s in ("v", "p", "phi"))
    A = whole.A.copy()
    A[p, p], A[p, phi], A[phi, i], A[i, phi] = -0.4, -1.0, 0.0, 0.0  # a roll that springs back
    modes = lateral_modes(replace(whole, A=A), {})
    assert set(modes) == {"Dutch roll", "lateral phugoid"}
    assert (
        0.8 < modes["lateral phugoid"].imag < 1.1
    )  # a spring of 1 rad/s2 per rad, with what sideslip and yaw do to roll


def test_an_aileron_excites_the_roll_and_an_elevator_does_not(taurus):
    aircraft, trimmed = taurus
    n = round(4.0 * trimmed.rate_hz)
    suites = [load_suite("eolo_gap_lateral")]
    for control, shown in (("da", {"roll": True}), ("de", {"short period": True})):
        u = np.zeros((n, 1))
        u[n // 8 : n // 4], u[n // 4 : n // 2] = 0.03, -0.015
        signal = InputSignal(np.arange(n) / trimmed.rate_hz, u, (control,))
        flown = fly(aircraft, trimmed, Manoeuvre("pulse", signal, 0.0), 120.0)
        found = excited(true_model(aircraft, trimmed, (control,)), flown, (control,), suites).excitation
        verdicts = {e.mode: e.excited for e in found}
        assert {name: verdicts[name] for name in shown} == shown
        assert ("roll" in verdicts) == (control == "da")


@pytest.mark.parametrize(
    ("name", "states", "modes"),
    [
        ("lateral_directional", ("beta", "p", "r", "phi"), LATERAL_MODES),
        ("roll_yaw_rates", ("p", "r"), ["roll"]),
        ("longitudinal", ("V", "alpha", "q", "theta"), ["phugoid", "short period"]),
        ("short_period", ("alpha", "q"), ["short period"]),
    ],
)
def test_a_structure_is_asked_for_the_modes_of_its_motion_alone(taurus, name, states, modes):
    known = true_model(*taurus, ("de", "da"))
    assert list(_possible(known, SimpleNamespace(name=name, states=states))) == modes
