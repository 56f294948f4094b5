"""Errors of instruments from the kinematics: exact data, a second implementation, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import OdeSolution, solve_ivp
from scipy.optimize import least_squares

from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.errors import ChannelError, EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators import data_compatibility
from testbench.estimators.compatibility.fit import Problem, stretch
from testbench.estimators.data_compatibility import correct, estimate
from testbench.estimators.parametric.kinematics import kinematics

DT = 0.04
CHANNELS = ("V", "alpha", "beta", "phi", "theta", "psi", "h", "hdot", "Vg", "p", "q", "r", "ax", "ay", "az")


def equations(t: float, x: np.ndarray, inputs: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Rigid-body kinematics written by rotation matrix, apart from the structure under test."""
    p, q, r, *force = (np.interp(t, times, column) for column in inputs.T)
    phi, theta, psi = x[3:6]
    to_body = body_from_earth(phi, theta, psi)
    velocity = np.array(force) + to_body @ [0.0, 0.0, G0_M_S2] - np.cross([p, q, r], x[:3])
    rates = [
        p + np.tan(theta) * (q * np.sin(phi) + r * np.cos(phi)),
        q * np.cos(phi) - r * np.sin(phi),
        (q * np.sin(phi) + r * np.cos(phi)) / np.cos(theta),
    ]
    return np.array([*velocity, *rates, -(to_body.T @ x[:3])[2]])


def body_from_earth(phi: float, theta: float, psi: float) -> np.ndarray:
    c, s = np.cos, np.sin
    yaw = np.array([[c(psi), s(psi), 0.0], [-s(psi), c(psi), 0.0], [0.0, 0.0, 1.0]])
    pitch = np.array([[c(theta), 0.0, -s(theta)], [0.0, 1.0, 0.0], [s(theta), 0.0, c(theta)]])
    roll = np.array([[1.0, 0.0, 0.0], [0.0, c(phi), s(phi)], [0.0, -s(phi), c(phi)]])
    return roll @ pitch @ yaw


def manoeuvre(duration_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rates and specific forces of a flight with bank, pitch and speed changes; states on the way at initial values."""
    t = np.arange(round(duration_s / DT) + 1) * DT
    phi = 0.5 * np.sin(0.9 * t)
    theta = 0.12 + 0.15 * np.sin(0.7 * t + 0.3)
    psi = 0.8 + 0.25 * t + 0.1 * np.sin(0.5 * t)
    alpha = 0.08 + 0.05 * np.sin(1.7 * t)
    beta, V = 0.06 * np.sin(1.3 * t), 20.0 + 3.0 * np.sin(0.4 * t)
    u, v, w = V * np.cos(alpha) * np.cos(beta), V * np.sin(beta), V * np.sin(alpha) * np.cos(beta)
    motion = {"phi": phi, "theta": theta, "psi": psi, "u": u, "v": v, "w": w}
    d = {n: np.gradient(x, t, edge_order=2) for n, x in motion.items()}
    p = d["phi"] - d["psi"] * np.sin(theta)
    q = d["theta"] * np.cos(phi) + d["psi"] * np.cos(theta) * np.sin(phi)
    r = -d["theta"] * np.sin(phi) + d["psi"] * np.cos(theta) * np.cos(phi)
    ax = d["u"] + q * w - r * v + G0_M_S2 * np.sin(theta)
    ay = d["v"] + r * u - p * w - G0_M_S2 * np.cos(theta) * np.sin(phi)
    az = d["w"] + p * v - q * u - G0_M_S2 * np.cos(theta) * np.cos(phi)
    return t, np.column_stack([p, q, r, ax, ay, az]), np.array([u[0], v[0], w[0], phi[0], theta[0], psi[0], 300.0])


def flown(duration_s: float):
    """Times, exact inputs, and the exact flight between them as a function of time.

    It is integrated from sample to sample, as the inputs have a kink at each.
    """
    t, inputs, x = manoeuvre(duration_s)
    times, steps = [t[0]], []
    for k in range(len(t) - 1):
        run = solve_ivp(
            equations, t[k : k + 2], x, method="DOP853", args=(inputs[k : k + 2], t[k : k + 2]), rtol=1e-10, atol=1e-10,
            first_step=t[k + 1] - t[k], dense_output=True,
        )  # fmt: skip
        x = run.y[:, -1]
        times.extend(run.t[1:])
        steps.extend(run.sol.interpolants)
    return t, inputs, OdeSolution(times, steps)


@pytest.fixture(scope="module")
def flight():
    return flown(12.0)


@pytest.fixture(scope="module")
def short_flight():
    return flown(5.0)


def read(flight, errors: dict[str, float] | None = None) -> FlightRecord:
    """What instruments with these errors read of the flight."""
    t, inputs, sol = flight
    errors = errors or {}
    wind = np.array([errors.get(f"wind_{axis}", 0.0) for axis in ("north", "east", "down")])

    def outputs(at: np.ndarray) -> dict[str, np.ndarray]:
        x = sol(np.clip(at, 0.0, t[-1]))
        u, v, w, phi, theta, psi, h = x
        V = np.sqrt(u**2 + v**2 + w**2)
        over_ground = np.array([body_from_earth(*a).T @ s for a, s in zip(x[3:6].T, x[:3].T, strict=True)]) + wind
        return {
            "V": V, "alpha": np.arctan2(w, u), "beta": np.arcsin(v / V), "phi": phi, "theta": theta,
            "psi": np.mod(psi, 2.0 * np.pi), "h": h - wind[2] * at, "hdot": -over_ground[:, 2],
            "Vg": np.hypot(over_ground[:, 0], over_ground[:, 1]),
        }  # fmt: skip

    true = {**outputs(t), **dict(zip(("p", "q", "r", "ax", "ay", "az"), inputs.T, strict=True))}
    columns = []
    for name in CHANNELS:
        delay = errors.get(f"{name}_delay", 0.0)
        x = outputs(t - delay)[name] if delay else true[name]
        columns.append(errors.get(f"{name}_scale", 1.0) * x + errors.get(f"{name}_bias", 0.0))
    return FlightRecord(t, CHANNELS, np.column_stack(columns), "measured")


SINGLE = {
    "p_bias": 0.01, "q_bias": -0.02, "r_bias": 0.01, "ax_bias": 0.3, "ay_bias": -0.2, "az_bias": 0.4,
    "alpha_scale": 1.1, "beta_scale": 0.9, "V_scale": 1.05, "alpha_bias": 0.02, "beta_bias": -0.01, "V_bias": 1.0,
    "alpha_delay": 0.1, "beta_delay": 0.07, "V_delay": -0.05, "wind_north": 4.0, "wind_east": -3.0, "wind_down": 0.5,
    "theta_scale": 0.97, "phi_scale": 1.04, "theta_bias": 0.02, "phi_bias": -0.01, "p_scale": 1.03, "q_scale": 0.98,
    "r_scale": 1.02,
}  # fmt: skip


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", SINGLE)
def test_a_single_error_in_exact_data_is_recovered(short_flight, name):
    result = estimate([read(short_flight, {name: SINGLE[name]})], only=[name])
    # 1e-6 of the error or 1e-7 in SI units (Runge-Kutta at 25 Hz). Delays interpolate between samples of a flight that
    # has kinks in its rates: 5e-6 s.
    assert result.values[name] == pytest.approx(SINGLE[name], rel=1e-6, abs=5e-6 if name.endswith("delay") else 1e-7)
    assert result.status != "good"


def test_several_errors_at_once_are_recovered_with_every_error_asked_for(flight):
    errors = {
        n: SINGLE[n] for n in ("p_bias", "q_bias", "az_bias", "alpha_scale", "beta_bias", "V_scale", "wind_north")
    }
    result = estimate([read(flight, errors)])
    assert set(errors) <= set(result.values)
    for name, value in result.values.items():
        none = 1.0 if name.endswith("_scale") else 0.0
        assert value == pytest.approx(errors.get(name, none), abs=1e-5)


def test_without_an_error_none_is_found_and_the_record_is_rebuilt(flight):
    record = read(flight)
    result = estimate([record])
    assert result.errors == ()
    assert correct(record, result) is record
    structure = result.structure
    from_truth = Problem(structure, [stretch(record, structure)], DT).residuals({}, [flight[2](0.0)])[0]
    rebuilt = result.reconstructed[0]
    for name in CHANNELS:  # Runge-Kutta at 25 Hz is all that is left: less than from the true initial state
        limit = np.max(np.abs(from_truth[:, structure.outputs.index(name)])) if name in structure.outputs else 1e-15
        assert limit < 3e-6
        # least squares may give a little of one channel, some 1e-10 rad, for more of others
        assert np.max(np.abs(rebuilt[name] - record[name])) < limit + 1e-9, name
    assert result.reconstructed[0].kind == "measured"
    assert "reconstructed" in result.reconstructed[0].provenance


def test_errors_are_taken_out(flight):
    errors = {n: SINGLE[n] for n in ("q_bias", "alpha_scale", "beta_bias", "V_delay")}
    result = estimate([read(flight, errors)], only=errors)
    corrected, true = correct(read(flight, errors), result), read(flight)
    for name in ("q", "alpha", "beta", "theta", "ax"):
        assert np.allclose(corrected[name], true[name], atol=1e-6)
    good = corrected.valid[:, corrected.channels.index("V")]
    assert 0 < np.sum(~good) <= 2  # 0.05 s at the ends
    assert np.allclose(corrected["V"][good], true["V"][good], atol=2e-3)  # lines between samples
    assert corrected.provenance["corrected"]["errors"].keys() == set(errors)


def test_accelerometers_off_the_centre_of_gravity_are_moved_there(flight):
    true = read(flight)
    omega = true.columns(("p", "q", "r"))
    rates = np.gradient(omega, true.t_s, axis=0)
    arm = (1.2, -0.3, 0.4)
    off = np.cross(rates, arm) + np.cross(omega, np.cross(omega, arm))
    moved = {n: true[n] + off[:, i] for i, n in enumerate(("ax", "ay", "az"))}
    record = true.with_columns({**moved, **dict(zip(("pdot", "qdot", "rdot"), rates.T, strict=True))})
    positions = dict.fromkeys(("ax", "ay", "az"), arm)
    there, elsewhere = estimate([record], positions_m=positions), estimate([record])
    assert there.errors == ()
    assert elsewhere.residual_after["alpha"] > 100.0 * there.residual_after["alpha"]
    biased = record.with_columns({"q": record["q"] + 0.02})
    result = estimate([biased], positions_m=positions, only=["q_bias"])
    # between samples the rates run linearly, but the lever arm's products of them do not: 1e-5
    assert result.values["q_bias"] == pytest.approx(0.02, rel=1e-5)
    corrected = correct(biased, result)
    assert all(np.allclose(corrected[n], true[n], atol=2e-6) for n in ("ax", "ay", "az", "q"))


def noisy(record: FlightRecord, seed: int, scale: float = 1.0) -> FlightRecord:
    std = {"V": 0.1, "h": 0.3, "hdot": 0.1, "Vg": 0.1, "ax": 0.03, "ay": 0.03, "az": 0.03}
    size = np.array([std.get(n, 0.05 * DEG_RAD if n in "pqr" else 0.2 * DEG_RAD) for n in record.channels])
    noise = np.random.default_rng(seed).standard_normal(record.data.shape)
    return FlightRecord(record.t_s, record.channels, record.data + scale * size * noise, "measured")


def test_a_second_implementation_agrees(flight):
    """Bias of q and scale of alpha with free initial states by scipy, same weights: the same minimum."""
    record = noisy(read(flight, {"q_bias": 0.01, "alpha_scale": 1.1}), 3).between(0.0, 6.0)
    names = ("q_bias", "alpha_scale")
    result = estimate([record], only=names)
    keep = slice(13, -8)  # the part of timed channels that counts: from 0.5 s to 0.3 s before the end
    inputs = record.columns(("p", "q", "r", "ax", "ay", "az"))

    def simulate(z: np.ndarray) -> np.ndarray:
        used = inputs - np.array([0.0, z[0], 0.0, 0.0, 0.0, 0.0])
        t = record.t_s - record.t_s[0]
        run = solve_ivp(equations, (0.0, t[-1]), [*z[2:8], 0.0], args=(used, t), t_eval=t, rtol=1e-6, max_step=DT)
        u, v, w, phi, theta, psi, _ = run.y
        V = np.sqrt(u**2 + v**2 + w**2)
        fits = {"alpha": z[1] * np.arctan2(w, u), "theta": theta, "V": V, "beta": np.arcsin(v / V), "phi": phi}
        parts = [(record[n] - y) / result.residual_after[n] for n, y in fits.items()]
        timed = [p[keep] if n in ("alpha", "V", "beta") else p for n, p in zip(fits, parts, strict=True)]
        heading = (np.unwrap(record["psi"]) - psi) / result.residual_after["psi"]
        return np.concatenate([*timed, heading])

    x0 = result.diagnostics["initial_states"][0]
    found = least_squares(simulate, [0.0, 1.0, *x0[:6]], x_scale=[0.01, 0.1, 1, 1, 1, 0.1, 0.1, 0.1], max_nfev=4)
    for i, name in enumerate(names):
        error = next(e for e in result.errors if e.name == name).standard_error
        # h, hdot and Vg, which the second one leaves out, move the estimates by less than their error
        assert found.x[i] == pytest.approx(result.values[name], abs=error)


def test_order_of_channels_and_of_records_changes_nothing(flight):
    record = noisy(read(flight, {"alpha_scale": 1.1}), 5)
    shuffled = record.select(tuple(reversed(record.channels)))
    parts = [record.between(0.0, 6.0), record.between(6.0, 13.0)]
    one, other = estimate([record]), estimate([shuffled])
    assert one.values == pytest.approx(other.values, rel=1e-9)
    there, back = estimate(parts), estimate(parts[::-1])
    assert there.values == pytest.approx(back.values, rel=1e-4)  # where the search ends: 1/1000 of an error
    assert len(there.reconstructed) == 2


def test_samples_that_are_not_valid_do_not_count(flight):
    record = noisy(read(flight, {"alpha_scale": 1.1}), 6)
    lost = np.random.default_rng(0).random(record.data.shape) < 0.1
    lost[0] = False
    spoilt = np.where(lost, 1e3, record.data)
    result = estimate([FlightRecord(record.t_s, record.channels, spoilt, "measured", ~lost)])
    assert set(result.values) == {"alpha_scale"}
    assert result.values["alpha_scale"] == pytest.approx(1.1, abs=0.02)


@pytest.mark.parametrize(
    ("channels", "motion"),
    [
        (("V", "alpha", "theta", "q", "ax", "az"), "longitudinal"),
        (("V", "alpha", "theta", "q", "az"), "vertical"),
        (("V", "alpha", "theta", "beta", "phi", "psi", "p", "q", "r", "ay"), "lateral"),
    ],
)
def test_the_motion_follows_from_the_channels(flight, channels, motion):
    assert kinematics(channels).motion == motion


def test_lateral_kinematics_find_lateral_errors(flight):
    channels = ("V", "alpha", "theta", "beta", "phi", "psi", "p", "q", "r", "ay")
    errors = {"p_bias": 0.01, "beta_scale": 0.9}
    result = estimate([read(flight, errors).select(channels)], only=errors)
    assert result.structure.motion == "lateral"
    # airspeed and angle of attack run linearly between samples here: 2e-5 of a value
    assert result.values == pytest.approx(errors, rel=1e-3)


def test_what_cannot_be_told_is_said(flight):
    result = estimate([noisy(read(flight), 1).between(0.0, 5.0)])
    assert result.not_identifiable
    assert all(reason.startswith(("shows as", "no output feels")) for reason in result.not_identifiable.values())
    assert not set(result.not_identifiable) & {e.name for e in result.tested}


def test_refusals_say_what_is_wrong(flight):
    record = read(flight)
    with pytest.raises(EstimationError, match="at least one record"):
        estimate([])
    with pytest.raises(EstimationError, match="kind 'truth'"):
        estimate([FlightRecord(record.t_s, record.channels, record.data, "truth")])
    with pytest.raises(ChannelError, match="one kind of motion"):
        estimate([record.select(("V", "q"))])
    with pytest.raises(ChannelError, match="'full' kinematics need p, r, ax"):
        estimate([record.select(("V", "alpha", "theta", "q", "az"))], motion="full")
    with pytest.raises(EstimationError, match="did you mean 'alpha_scale'"):
        estimate([record], only=["alpha_scal"])
    with pytest.raises(EstimationError, match=r"at least 3\.2 s"):
        estimate([record.between(0.0, 2.0)])
    with pytest.raises(EstimationError, match="false_alarm"):
        estimate([record], false_alarm=0.0)
    with pytest.raises(EstimationError, match="a position belongs to an accelerometer"):
        estimate([record], positions_m={"V": (1.0, 0.0, 0.0)})


def test_the_result_is_json(flight):
    import json

    result = estimate([noisy(read(flight, {"alpha_scale": 1.1}), 2)])
    text = json.dumps(result.to_dict())
    assert "angle-of-attack vane" in text
    assert data_compatibility.InstrumentError in {type(e) for e in result.errors}
