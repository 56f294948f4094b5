"""Held inputs are recognised, smooth ones are not; and what a held input does to srivc and output error."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from testbench.core.record import FlightRecord
from testbench.estimators import estimate
from testbench.estimators.hold import held, recognised

FINE = 1000.0  # Hz, of what moves between the samples


def record(u: np.ndarray, dt: float, name: str = "de", **more: np.ndarray) -> FlightRecord:
    columns = {name: u, **more}
    return FlightRecord(np.arange(len(u)) * dt, tuple(columns), np.column_stack(list(columns.values())), "measured")


def steps(t: np.ndarray, start: float, width: float, pattern=(3, 2, 1, 1)) -> np.ndarray:
    u, sign = np.zeros_like(t), 1.0
    for n in pattern:
        u[(t >= start - 1e-9) & (t < start + n * width - 1e-9)] = 0.05 * sign
        start, sign = start + n * width, -sign
    return u


def lagged(u: np.ndarray, tau: float) -> np.ndarray:
    f = np.exp(-1.0 / FINE / tau)
    return lfilter([0.0, 1.0 - f], [1.0, -f], u)


def limited(u: np.ndarray, rate: float) -> np.ndarray:
    y = np.zeros_like(u)
    for k in range(len(u) - 1):
        y[k + 1] = y[k] + np.clip(u[k] - y[k], -rate / FINE, rate / FINE)
    return y


def hand(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    u, x, k = np.zeros_like(t), 0.0, 0
    while k < len(t):
        n, m, new = int(rng.uniform(0.3, 2) * FINE), int(rng.uniform(0.15, 0.6) * FINE), 0.05 * rng.normal()
        s = np.linspace(0.0, 1.0, m)
        part = np.r_[x + (new - x) * (3 * s**2 - 2 * s**3), np.full(n, new)][: len(t) - k]
        u[k : k + len(part)] = part
        k, x = k + m + n, new
    return u


def smooth(kind: str, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """A smooth input as a logger samples it: any rate, with or without noise, rounded or not."""
    t = np.arange(round(rng.uniform(8, 30) * FINE)) / FINE
    width = rng.uniform(0.2, 0.8)
    u = {
        "multisine": lambda: sum(0.01 * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in np.linspace(0.1, 2, 9)),
        "sweep": lambda: 0.05 * np.sin(2 * np.pi * (0.2 * t + 0.9 * t**2 / t[-1])),
        "hand": lambda: hand(t, rng),
        "doublet through a servo": lambda: lagged(steps(t, 2.0, width, (1, 1)), rng.choice([0.05, 0.1, 0.2])),
        "rate limit": lambda: limited(steps(t, 2.0, width), np.radians(60.0 * rng.uniform(0.3, 1.0))),
        "slow ramp": lambda: np.interp(t, [0, 3, 5, 30], [0, 0, 0.05, 0.05]),
    }[kind]()
    stride = int(FINE / rng.choice([25, 50, 100, 200]))
    u = u[int(rng.integers(stride)) :: stride]
    u = u + rng.choice([0.0, 1e-4, 1e-3]) * np.ptp(u) * rng.normal(size=len(u))
    quantum = rng.choice([0.0, 1 / 50, 1 / 200]) * np.ptp(u)
    return (np.round(u / quantum) * quantum if quantum else u), stride / FINE


def stepped(kind: str, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """An input that is held from sample to sample, with or without a sensor's noise."""
    rate = rng.choice([25.0, 50.0, 100.0])
    t = np.arange(round(rng.uniform(12, 30) * rate)) / rate
    width = max(2, round(rng.uniform(0.15, 0.8) * rate)) / rate
    u = {
        "doublet": lambda: steps(t, 2.0, width, (1, 1)),
        "3-2-1-1": lambda: steps(t, 2.0, width),
        "binary": lambda: np.repeat(rng.choice([-0.05, 0.05], t.size), int(rng.integers(2, 10)))[: t.size],
        "levels": lambda: np.repeat(0.05 * rng.normal(size=t.size), int(rng.integers(4, 10)))[: t.size],
    }[kind]()
    return u + rng.choice([0.0, 1e-4, 1e-3]) * np.ptp(u) * rng.normal(size=u.size), 1.0 / rate


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", ["multisine", "sweep", "hand", "doublet through a servo", "rate limit", "slow ramp"])
def test_smooth_inputs_are_not_called_held(kind):
    # 0 of 1800 draws of these kinds in a longer study: below 0.2 % with 95 % confidence; 30 draws here
    rng = np.random.default_rng(11)
    drawn = [smooth(kind, rng) for _ in range(30)]
    assert not any(recognised([record(u, dt)], "de") for u, dt in drawn)


@pytest.mark.parametrize("kind", ["doublet", "3-2-1-1", "binary", "levels"])
def test_inputs_that_step_from_sample_to_sample_are_recognised(kind):
    rng = np.random.default_rng(12)
    drawn = [stepped(kind, rng) for _ in range(30)]
    assert sum(recognised([record(u, dt)], "de") for u, dt in drawn) >= 28


def test_spikes_gaps_one_step_and_nothing_are_not_held():
    still, spike = np.zeros(200), np.zeros(200)
    spike[[50, 120]] = 0.1
    one = np.r_[np.zeros(100), np.full(100, 0.1)]
    for u in (still, spike, one):
        assert not recognised([record(u, 0.02)], "de")
    t = np.arange(500) * 0.02
    u = 0.05 * np.sin(t)
    gaps = record(u, 0.02)
    valid = np.ones((500, 1), bool)
    valid[100:110] = False
    frozen = np.array(gaps.data)
    frozen[100:110] = frozen[99]
    assert not recognised([FlightRecord(gaps.t_s, gaps.channels, frozen, "measured", valid)], "de")


def test_what_is_asked_for_counts_and_commands_are_held():
    u = steps(np.arange(500) * 0.02, 2.0, 0.3)
    flight = record(u, 0.02, da=np.sin(np.arange(500)), de_cmd=u)
    assert held(("de", "da", "de_cmd"), (None, None, None), [flight]) == ((True, False, True), ("de",))
    assert held(("de", "da", "de_cmd"), (False, True, False), [flight]) == ((False, True, False), ())


def held_flight() -> tuple[FlightRecord, np.ndarray]:
    """A short period, its input held for ten samples, with 2 % of noise; and its poles."""
    A, B = np.array([[-1.2, 0.97], [-8.0, -2.0]]), np.array([[-0.1], [-9.0]])
    F, G, *_ = cont2discrete((A, B, np.eye(2), np.zeros((2, 1))), 0.02)
    rng = np.random.default_rng(1)
    u = np.repeat(rng.choice([-0.05, 0.05], 150), 10)
    x = np.zeros((u.size + 1, 2))
    for k, value in enumerate(u):
        x[k + 1] = F @ x[k] + G[:, 0] * value
    y = x[:-1] + 0.02 * x.std(axis=0) * rng.standard_normal((u.size, 2))
    return record(u, 0.02, alpha=y[:, 0], q=y[:, 1]), np.linalg.eigvals(A)


def test_srivc_finds_the_poles_of_a_held_input_by_default():
    flight, poles = held_flight()
    model = estimate("srivc", [flight], ["de"], ["q"], poles=(2,), zeros=(0, 1))
    found = model.poles()["q"]
    assert np.max(np.abs(np.sort_complex(found) - np.sort_complex(poles))) < 0.01 * abs(poles[0])
    assert "recognised" in model.settings["held"]
    assert model.settings["hold"] == {"de": "zoh"}


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    "method", ["output_error", pytest.param("filter_error", marks=pytest.mark.slow), "equation_error", "ekf"]
)
def test_structures_take_a_held_input_as_held(method):
    flight, _ = held_flight()
    model = estimate(method, [flight], ["de"], ["alpha", "q"], structure="short_period")
    assert model.held == (True,)
    assert model.settings["held"].startswith("de (recognised")
    assert model.values["M_de"] == pytest.approx(-9.0, rel=0.025)
    linear = estimate(method, [flight], ["de"], ["alpha", "q"], structure="short_period", held=())
    assert linear.held == (False,)
    assert "held" not in linear.settings
