"""A lateral specific force in g, or counted to the left, is questioned by the motion; flights are not."""

import numpy as np
import pytest

from testbench.core.constants import G0_M_S2
from testbench.logs.plausible import implausible

T = np.arange(0.0, 20.0, 0.02)
NAMES = ("V", "alpha", "beta", "p", "r", "phi", "theta", "ay")


def flight(seed: int = 0, V: float = 22.0, size: float = 1.0) -> dict[str, np.ndarray]:
    """A Dutch roll in a turn, consistent as a flight is, with noise of instruments; SI units."""
    rng = np.random.default_rng(seed)
    beta, betadot = size * 0.05 * np.sin(2.0 * T), size * 0.1 * np.cos(2.0 * T)
    ay, phi, p = -60.0 * beta * (V / 100.0), size * 0.2 * np.sin(0.7 * T), size * 0.14 * np.cos(0.7 * T)
    alpha, theta = 0.06, 0.08
    r = (ay + G0_M_S2 * np.sin(phi) * np.cos(theta)) / V - betadot + p * np.sin(alpha)
    clean = {"V": V, "alpha": alpha, "beta": beta, "p": p, "r": r / np.cos(alpha), "phi": phi, "theta": theta, "ay": ay}
    noise = {"V": 0.2, "ay": 0.1}
    return {name: clean[name] + noise.get(name, 0.003) * rng.normal(size=T.size) for name in NAMES}


def asked(channels: dict[str, np.ndarray]) -> list[tuple[str, str]]:
    return [(q.channel, q.unit) for q in implausible({name: (T, x) for name, x in channels.items()})]


@pytest.mark.parametrize("V", [22.0, 80.0, 220.0])
@pytest.mark.parametrize("size", [0.1, 1.0])
@pytest.mark.parametrize("seed", range(5))
def test_a_flight_raises_no_question(seed, V, size):
    assert asked(flight(seed, V, size)) == []


@pytest.mark.parametrize("V", [22.0, 80.0, 220.0])
@pytest.mark.parametrize(("factor", "unit"), [(1.0 / G0_M_S2, "g"), (-1.0, ""), (-1.0 / G0_M_S2, "g")])
def test_another_unit_or_sign_is_questioned(V, factor, unit):
    whole = flight(V=V)
    assert asked({**whole, "ay": factor * whole["ay"]}) == [("ay", unit)]


def test_a_lateral_accelerometer_far_from_the_centre_of_gravity_is_no_other_unit():
    whole = flight()
    moved = whole["ay"] + 1.0 * np.gradient(whole["r"], T)  # m ahead
    assert asked({**whole, "ay": moved}) == []


def test_without_sideslip_nothing_is_said():
    whole = flight()
    turned = {**whole, "ay": -whole["ay"]}
    del turned["beta"]
    assert asked(turned) == []
