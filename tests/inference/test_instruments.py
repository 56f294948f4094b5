"""Instruments compared by kinematics: which of them errs, by how much, and none where all are sound."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord
from testbench.inference.instruments import KINDS, Agreement, agreement, every_error, without_errors
from testbench.sensors.sensor import first_order_lag

FINE_S, STEP = 0.004, 5
NOISE = {"V": 0.1, "alpha": 0.0017, "q": 0.0026, "theta": 0.0014, "az": 0.05, "ax": 0.05, "h": 0.1}
QUANTUM = {"V": 0.1, "alpha": 0.0017, "q": 0.0009, "theta": 0.0009, "az": 0.02, "h": 0.1}
G = 9.80665


@cache
def motion() -> dict[str, np.ndarray]:
    """A rigid body in symmetric flight at 15 m/s, and exactly what ideal instruments read of it: no aerodynamics."""
    t = np.arange(0.0, 16.0, FINE_S)

    def of(function, order=0):
        out = function(t)
        for _ in range(order):
            out = np.gradient(out, FINE_S, edge_order=2)
        return out

    theta = of(lambda t: 0.08 + 0.12 * np.sin(2.2 * t) * np.exp(-(((t - 5.0) / 3.0) ** 2)) + 0.05 * np.sin(0.5 * t))
    alpha = of(
        lambda t: 0.09 + 0.06 * np.sin(2.2 * t + 0.9) * np.exp(-(((t - 5.0) / 3.0) ** 2)) + 0.01 * np.sin(6.0 * t)
    )
    V = 15.0 + 0.8 * np.sin(0.5 * t + 1.0)
    u, w, q = V * np.cos(alpha), V * np.sin(alpha), np.gradient(theta, FINE_S, edge_order=2)
    udot, wdot = (np.gradient(x, FINE_S, edge_order=2) for x in (u, w))
    h = 300.0 + np.cumsum(V * np.sin(theta - alpha)) * FINE_S
    return {
        "t": t, "V": V, "alpha": alpha, "theta": theta, "q": q, "qdot": np.gradient(q, FINE_S, edge_order=2), "h": h,
        "ax": udot + G * np.sin(theta) + q * w, "az": wdot - G * np.cos(theta) - q * u,
    }  # fmt: skip


def record(seed: int, fault: str = "", size: float = 0.0, level: float = 1.0, channels=tuple(NOISE)) -> FlightRecord:
    """What instruments with noise, and one with an error, read of the motion; every third draw is quantised."""
    true, rng, columns = dict(motion()), np.random.default_rng(seed), []
    of, _, kind = fault.rpartition("_")
    if kind == "place":
        true[of] = true[of] - size * true["qdot"]
    for c in channels:
        y = true[c]
        if c == of and kind == "lag":
            y = first_order_lag(y, FINE_S, size)
        y = np.interp(true["t"] - (size if (c, kind) == (of, "late") else 0.0), true["t"], y)[::STEP]
        y = y * (1.0 + (size if (c, kind) == (of, "scale") else 0.0))
        y = y + level * NOISE[c] * rng.standard_normal(y.size)
        columns.append(np.round(y / QUANTUM[c]) * QUANTUM[c] if seed % 3 == 2 and c in QUANTUM else y)
    return FlightRecord(true["t"][::STEP], tuple(channels), np.column_stack(columns), "measured")


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("fault", "size"),
    [
        ("q_scale", -0.15), ("q_scale", 0.15), ("q_late", 0.04), ("alpha_lag", 0.1), ("alpha_scale", -0.3),
        ("theta_lag", 0.1), ("V_scale", -0.2),
    ],
)  # fmt: skip
def test_the_instrument_that_errs_is_named_and_its_error_is_known(fault, size):
    found = agreement([record(4, fault, size)])
    assert found.p_agree < 0.1
    assert found.fault is not None
    assert found.fault.name == fault
    assert abs(found.fault.estimate - size) < 4.0 * found.fault.std
    assert found.fault.std < 0.25 * abs(size)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("level", [0.7, 1.0, 1.4])
def test_sound_instruments_agree_whatever_their_noise(level):
    for seed in (1, 2):
        found = agreement([record(seed, level=level)])
        assert found.p_agree > 0.5, seed
        assert found.fault is None


def test_probabilities_are_those_of_all_that_may_be_true():
    found = agreement([record(1, "q_scale", -0.15)])
    assert found.p_agree + found.p_unknown + sum(f.probability for f in found.faults) == pytest.approx(1.0)
    assert sum(found.by_instrument.values()) == pytest.approx(sum(f.probability for f in found.faults))
    assert all(f.kind in KINDS for f in found.faults)


def test_what_is_taken_out_is_gone():
    for fault, size in (("q_scale", -0.15), ("q_late", 0.04), ("alpha_lag", 0.1)):
        found = agreement([without_errors(record(3, fault, size), {fault: size})])
        assert found.p_agree > 0.5, fault
    moved = without_errors(record(3, "az_place", 0.25), {"az_place": 0.25})
    ahead = record(3, "az_place", 0.25)
    true = motion()["az"][::STEP]
    assert np.std(moved["az"] - true) < 0.75 * np.std(ahead["az"] - true)


def test_two_channels_tell_that_they_differ_and_not_which_of_them_errs():
    found = agreement([record(1, "q_scale", -0.15, channels=("q", "theta"))])
    assert found.contradicted
    assert found.fault is None
    assert set(found.by_instrument) == {"q", "theta"}


def test_channels_that_do_not_bind_one_another_contradict_nothing():
    found = agreement([record(0, channels=("q", "V"))])
    assert isinstance(found, Agreement)
    assert (found.compared, found.contradicted, found.faults) == ((), False, ())


def test_something_that_is_no_single_error_is_unknown():
    whole = record(0)
    drifting = whole["theta"] + 0.15 * np.sin(1.1 * whole.t_s) ** 3 * (whole.t_s > 8.0)
    found = agreement([whole.with_columns({"theta": drifting})])
    assert found.contradicted
    assert found.p_unknown > 0.5


def biased(seed: int, errors: dict[str, float], level: float = 0.5) -> FlightRecord:
    """What instruments with several biases and scales read of the motion."""
    columns = dict(zip((r := record(seed, level=level)).channels, r.data.T, strict=True))
    for name, size in errors.items():
        c, kind = name.rsplit("_", 1)
        columns[c] = columns[c] + size if kind == "bias" else (1.0 + size) * columns[c]
    return r.with_columns(columns)


@pytest.mark.sampled(6)
@pytest.mark.parametrize(
    "errors",
    [
        {"q_bias": 0.01}, {"az_bias": -0.2}, {"alpha_scale": 0.2}, {"theta_scale": -0.1}, {"V_scale": 0.08},
        {"q_bias": -0.02, "az_bias": 0.3, "alpha_scale": -0.15},
    ],
)  # fmt: skip
def test_errors_are_found_together_and_none_beside_them(errors):
    for seed in (1, 4):
        every = every_error([biased(seed, errors)], G)
        assert set(every.found) == set(errors)
        for name, (size, std) in every.found.items():
            assert abs(size - errors[name]) < max(4.0 * std, 0.05 * abs(errors[name]))
        assert not set(every.told) & set(every.lost)
        assert not every_error([without_errors(biased(seed, errors), every.sizes)], G).found


@pytest.mark.slow
def test_intervals_of_errors_hold_as_often_as_they_say():
    errors, held = {"q_bias": 0.01, "az_bias": 0.3, "alpha_scale": 0.15}, []
    for seed in (0, 1, 3, 4, 6, 7):
        told = every_error([biased(seed, errors, 1.0)], G).told
        held += [abs(told[n][0] - x) < 1.96 * told[n][1] for n, x in errors.items()]
    assert sum(held) >= 14  # of 18: fewer by chance in 1 of 600 sets, were they independent


def test_noise_that_is_summed_is_in_the_intervals():
    channels, rng = ("q", "theta"), np.random.default_rng(0)
    quiet = record(1, channels=channels)
    found = every_error([quiet.with_columns({"q": quiet["q"] + 0.02 * rng.standard_normal(len(quiet))})], G)
    # Of a constant that is seen through its integral alone, noise of the rate itself leaves s / sqrt(n).
    assert found.told["q_bias"][1] == pytest.approx(0.02 / np.sqrt(len(quiet)), rel=0.2)


def test_an_attitude_that_an_accelerometer_cannot_be_told_from_is_said():
    true = record(4, channels=("V", "alpha", "theta", "az", "ax"))
    every = every_error([true.with_columns({"ax": true["ax"] - 0.25})], G)
    assert set(every.found) == {"ax_bias"}
    size, std = every.rivals["ax_bias"]["theta_bias"]
    assert size == pytest.approx(0.25 / G, rel=0.1)
    assert std < 0.1 * size


def test_no_error_is_found_in_sound_instruments():
    for seed in (0, 1, 2, 3):
        assert not every_error([record(seed)], G).found, seed


def test_a_speed_over_ground_tells_the_wind():
    true, wind = record(1), (4.0, -3.0)
    t = true.t_s
    psi = 0.4 * t  # a circle without bank: the speed over ground is compared with nothing that turns
    ahead = true["V"] * np.cos(true["theta"] - true["alpha"])
    Vg = np.hypot(ahead * np.cos(psi) + wind[0], ahead * np.sin(psi) + wind[1])
    rng = np.random.default_rng(5)
    noise = 0.1 * rng.standard_normal((2, t.size)) * [[1.0], [0.02]]
    told = true.with_columns({"psi": psi + noise[1], "r": np.full(t.size, 0.4), "Vg": Vg + noise[0]})
    every = every_error([told], G)
    for name, size in zip(("north_bias", "east_bias"), wind, strict=True):
        assert every.found[name][0] == pytest.approx(size, abs=0.2)


def test_what_kinematics_cannot_say_is_refused_or_nothing():
    assert every_error([record(0, channels=("q", "V"))]) is None
    for gravity in (0.0, -9.8, np.nan, np.inf):
        with pytest.raises(EstimationError, match="gravity must be > 0"):
            every_error([record(0)], gravity)
