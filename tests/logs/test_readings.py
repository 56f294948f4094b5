"""Units, signs and axes that nobody stated, as the motion has them, with the probability of what is asked."""

import numpy as np
import pytest

from testbench.core.constants import DEG_RAD
from testbench.logs.readings import CERTAIN, readings
from testbench.logs.sidpac import Told
from testbench.questions.importing.ask import import_log

T = np.arange(0.0, 60.0, 0.02)


def flight(noise: float = 0.003, seed: int = 0) -> dict[str, np.ndarray]:
    """A flight that pitches, rolls and turns, an elevator that pitches it; kinematics hold; SI units."""
    rng = np.random.default_rng(seed)
    de = np.deg2rad(3.0) * np.sign(np.sin(1.3 * T)) * (np.sin(0.31 * T) > 0.0)
    q = np.zeros(T.size)
    for i in range(T.size - 1):
        q[i + 1] = q[i] + 0.02 * (-3.0 * q[i] - 12.0 * de[i])
    phi, psi = 0.3 * np.sin(0.5 * T), 0.0 * T
    p = 0.15 * np.cos(0.5 * T)
    theta, r = 0.05 + 0.0 * T, 0.0 * T
    for i in range(T.size - 1):
        r[i] = 9.81 / 20.0 * np.sin(phi[i])
        theta[i + 1] = theta[i] + 0.02 * (q[i] * np.cos(phi[i]) - r[i] * np.sin(phi[i]))
        psi[i + 1] = psi[i] + 0.02 * (q[i] * np.sin(phi[i]) + r[i] * np.cos(phi[i])) / np.cos(theta[i])
    clean = {
        "p": p,
        "q": q,
        "r": r,
        "phi": phi,
        "theta": theta,
        "psi": psi + 1.0,
        "az": -9.81 + 0.0 * T,
        "V": 20.0 + 0.0 * T,
    }
    size = {"az": 0.2, "V": 0.2}
    return {n: x + size.get(n, noise) * rng.standard_normal(T.size) for n, x in clean.items()} | {"de": de}


def found(channels, **how):
    signals = {name: (T, x) for name, x in channels.items()}
    return {r.channel: r for r in readings(signals, **how)}


def test_a_flight_in_si_units_is_read_as_it_is():
    channels = flight()
    assert found(channels) == {}
    assert found(channels, unstated=channels, axes=True) == {}
    assert found(channels, unstated=channels, doubtful=["de"], axes=True) == {}


def test_degrees_of_all_angles_are_certain_together():
    channels = flight()
    angles = ("p", "q", "r", "phi", "theta", "psi", "de")
    seen = found({n: x / DEG_RAD if n in angles else x for n, x in channels.items()}, unstated=channels)
    assert set(seen) == set(angles)
    assert all(r.unit in ("deg", "deg/s") and r.certain for r in seen.values())


def test_rates_of_one_table_are_in_one_unit_though_only_one_has_its_angle():
    channels = flight()
    held = {"q": channels["q"] / DEG_RAD, "theta": channels["theta"], "p": 0.1 * channels["p"] / DEG_RAD}
    seen = found(held, unstated=held)
    assert {n: r.unit for n, r in seen.items()} == {"q": "deg/s", "p": "deg/s"}
    assert seen["p"].certain


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_sign_of_a_control_that_custom_tells_is_that_of_the_motion(way):
    channels = flight()
    seen = found({**channels, "de": way * channels["de"]}, doubtful=["de"])
    assert set(seen) == ({"de"} if way < 0.0 else set())
    if seen:
        assert seen["de"].factor == -1.0
        assert seen["de"].certain


def test_what_hardly_moves_is_asked_with_its_probability_and_not_taken():
    channels = flight(noise=0.05)
    weak = {
        "de": -0.1 * channels["de"],
        "q": 0.1 * channels["q"] + 0.05 * np.random.default_rng(3).standard_normal(T.size),
    }
    for reading in found(weak, doubtful=["de"]).values():
        assert 0.5 < reading.probability < CERTAIN


def test_axes_forward_left_up_are_told_by_gravity_and_asked(tmp_path):
    channels = flight()
    turned = {n: -x if n in ("q", "r", "theta", "az") else x for n, x in channels.items() if n != "de"}
    seen = found(turned, unstated=turned, axes=True)
    assert seen["axes"].unit == "flu"
    rows = np.column_stack([T, *turned.values()])
    path = tmp_path / "flu.csv"
    np.savetxt(path, rows, "%.8f", ",", header=",".join(["time", *turned]), comments="")
    told = import_log(path, told=Told("flu"))
    np.testing.assert_allclose(told.record["q"], channels["q"], atol=1e-7)
    np.testing.assert_allclose(told.record["az"], channels["az"], atol=1e-7)
    assert told.asked == ()


def test_a_heading_that_turns_for_long_is_no_degrees():
    t = np.arange(0.0, 1200.0, 0.1)
    assert readings({"psi": (t, 0.2 * t), "V": (t, 20.0 + 0.0 * t)}) == ()
