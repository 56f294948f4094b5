"""Each step of a sensor's physics against its equation, one at a time; then their order."""

import zlib
from dataclasses import replace

import numpy as np
import pytest

from testbench.core.constants import DEG_RAD
from testbench.core.errors import ChannelError, RecordError, ScenarioError
from testbench.core.record import FlightRecord
from testbench.sensors import Sensor, SensorSuite
from testbench.sensors.sensor import first_order_lag, lever, whole_ratio

RATE_HZ = 100.0


def truth(channels: dict[str, np.ndarray], rate_hz: float = RATE_HZ, **keys: object) -> FlightRecord:
    n = len(next(iter(channels.values())))
    data = np.column_stack(list(channels.values()))
    return FlightRecord(np.arange(n) / rate_hz, tuple(channels), data, "truth", **keys)  # type: ignore[arg-type]


def suite(*sensors: Sensor, rate_hz: float = RATE_HZ, name: str = "bench") -> SensorSuite:
    return SensorSuite(name, "a suite", rate_hz, sensors)


def time(n: int = 1000) -> np.ndarray:
    return np.arange(n) / RATE_HZ


# the perfect sensor, and the record as a whole


def test_perfect_sensors_record_the_truth() -> None:
    flight = truth({"q": np.sin(time()), "V": 16.0 + np.cos(time())})
    got = suite(Sensor("V"), Sensor("q")).measure(flight, 0)
    assert got.kind == "measured"
    assert got.channels == ("V", "q")
    np.testing.assert_array_equal(got["q"], flight["q"])
    np.testing.assert_array_equal(got["V"], flight["V"])
    np.testing.assert_array_equal(got.t_s, flight.t_s)
    assert got.valid.all()


def test_provenance_and_outcome_are_carried_over() -> None:
    flight = truth({"q": np.zeros(5)}, provenance={"aircraft": "eolo"}, outcome="aborted", reason="alpha > 15 deg")
    got = suite(Sensor("q")).measure(flight, 7)
    assert dict(got.provenance) == {"suite": "bench", "seed": 7, "truth": {"aircraft": "eolo"}}
    assert (got.outcome, got.reason) == ("aborted", "alpha > 15 deg")


def test_only_truth_is_measured() -> None:
    flight = truth({"q": np.zeros(5)})
    bench = suite(Sensor("q"))
    with pytest.raises(RecordError, match="kind 'truth', got one of kind 'measured'"):
        bench.measure(bench.measure(flight, 0), 0)


def test_missing_channels_and_negative_seeds_are_refused() -> None:
    with pytest.raises(ChannelError, match="sensor suite 'bench' needs channel 'alpha'"):
        suite(Sensor("q"), Sensor("alpha")).measure(truth({"q": np.zeros(5)}), 0)
    with pytest.raises(ScenarioError, match="0 <= seed"):
        suite(Sensor("q")).measure(truth({"q": np.zeros(5)}), -1)


def test_nothing_is_mutated() -> None:
    flight = truth({"q": np.sin(time())})
    before = flight.data.copy()
    suite(Sensor("q", noise_std=1.0, bias=2.0, quantum=0.1, lag_s=0.1, delay_s=0.2, dropout=0.1)).measure(flight, 0)
    np.testing.assert_array_equal(flight.data, before)


# scale, lag, delay


def test_scale_multiplies_the_value() -> None:
    got = suite(Sensor("V", scale=1.05)).measure(truth({"V": np.full(10, 20.0)}), 0)
    np.testing.assert_allclose(got["V"], 21.0, rtol=1e-15)


def test_lag_follows_a_ramp_exactly() -> None:
    # x = t: y = t - tau (1 - exp(-t / tau)), exact for straight lines between samples
    tau, t = 0.07, time()
    np.testing.assert_allclose(first_order_lag(t, 1.0 / RATE_HZ, tau), t - tau * (1.0 - np.exp(-t / tau)), atol=1e-12)


def test_lag_of_a_sine_has_the_gain_and_phase_of_its_transfer_function() -> None:
    tau, omega, t = 0.05, 8.0, time(2000)
    y = first_order_lag(np.sin(omega * t), 1.0 / RATE_HZ, tau)
    gain, phase = 1.0 / np.hypot(1.0, omega * tau), np.arctan(omega * tau)
    # after 20 tau the transient is gone; straight lines between samples cost (w dt)^2 / 12 = 5e-4 of the amplitude
    np.testing.assert_allclose(y[200:], gain * np.sin(omega * t[200:] - phase), atol=1e-3)


def test_lag_starts_in_steady_state_and_does_not_depend_on_the_log_rate() -> None:
    assert not np.any(first_order_lag(np.full(50, 3.0), 0.01, 0.2) - 3.0)
    # a ramp that ends at 1 s, on a sample of either grid
    fine = first_order_lag(np.minimum(np.arange(2000) * 0.001, 1.0), 0.001, 0.3)
    coarse = first_order_lag(np.minimum(np.arange(20) * 0.1, 1.0), 0.1, 0.3)
    np.testing.assert_allclose(coarse, fine[::100], atol=1e-12)


@pytest.mark.parametrize("lag_s", [1e-9, 1e-3, 1e4])
def test_lag_is_stable_for_extreme_time_constants(lag_s: float) -> None:
    x = np.concatenate([np.zeros(5), np.ones(995)])
    y = first_order_lag(x, 0.01, lag_s)
    assert np.all((y >= -1e-12) & (y <= 1.0 + 1e-12))
    assert np.all(np.diff(y) >= -1e-12)


def test_delay_of_whole_and_broken_samples() -> None:
    t = time()
    for delay in (0.05, 0.1234):
        got = suite(Sensor("q", delay_s=delay)).measure(truth({"q": 3.0 * t}), 0)
        np.testing.assert_allclose(got["q"], 3.0 * np.maximum(t - delay, 0.0), atol=1e-12)


# position


def test_accelerometer_ahead_of_the_centre_of_gravity() -> None:
    t = time()
    rotation = {"p": 0 * t, "q": np.sin(t), "r": 0 * t, "pdot": 0 * t, "qdot": np.cos(t), "rdot": 0 * t}
    flight = truth({"az": np.full(t.size, -9.81), "ax": 0 * t, **rotation})
    place = (0.3, 0.0, -0.1)
    got = suite(Sensor("az", position_m=place), Sensor("ax", position_m=place)).measure(flight, 0)
    # pitching motion: ax_P = ax + qdot z - q^2 x, az_P = az - qdot x - q^2 z
    np.testing.assert_allclose(got["az"], -9.81 - np.cos(t) * 0.3 + np.sin(t) ** 2 * 0.1, atol=1e-12)
    np.testing.assert_allclose(got["ax"], -np.cos(t) * 0.1 - np.sin(t) ** 2 * 0.3, atol=1e-12)


def test_lever_arm_is_the_acceleration_of_a_point_of_a_rigid_body() -> None:
    # a second way: turn the body by its attitude R(t), differentiate R r twice, and look at it in body axes
    h = 1e-4
    axis, r = np.array([0.3, -0.5, 0.8]), np.array([0.4, -0.2, 0.1])

    def turned(t: float) -> np.ndarray:
        k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]]) / np.linalg.norm(axis)
        angle = 0.7 * t + 0.4 * t**2
        return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k

    t = 0.6
    acceleration = turned(t).T @ ((turned(t + h) - 2.0 * turned(t) + turned(t - h)) @ r) / h**2
    unit = axis / np.linalg.norm(axis)
    omega, omegadot = unit * (0.7 + 0.8 * t), unit * 0.8
    rotation = np.array([[*omega, *omegadot]])
    np.testing.assert_allclose(lever(rotation, r)[0], acceleration, atol=1e-6)  # differences: h^2 and 1e-16 / h^2


def test_position_needs_the_rotation_in_the_truth() -> None:
    with pytest.raises(ChannelError, match="needs channel 'p'"):
        suite(Sensor("az", position_m=(0.1, 0.0, 0.0))).measure(truth({"az": np.zeros(5)}), 0)


# sampling rates


def test_suite_records_every_kth_row_of_the_truth() -> None:
    got = suite(Sensor("q"), rate_hz=8.0).measure(truth({"q": np.arange(121.0)}, 120.0), 0)
    np.testing.assert_array_equal(got["q"], np.arange(0.0, 121.0, 15.0))
    assert got.dt_s == pytest.approx(1.0 / 8.0, rel=1e-12)


def test_slow_sensor_holds_its_last_sample_and_says_so() -> None:
    got = suite(Sensor("q"), Sensor("u", rate_hz=25.0)).measure(truth({"q": np.arange(10.0), "u": np.arange(10.0)}), 0)
    np.testing.assert_array_equal(got["u"], [0, 0, 0, 0, 4, 4, 4, 4, 8, 8])
    np.testing.assert_array_equal(got.valid[:, 1], [1, 0, 0, 0, 1, 0, 0, 0, 1, 0])
    assert got.valid[:, 0].all()


def test_suite_rate_must_divide_the_log_rate() -> None:
    with pytest.raises(
        ScenarioError, match=r"got 100 Hz into 120 Hz; log the truth at 100 Hz or 200 Hz .* 60 Hz or 120 Hz"
    ):
        suite(Sensor("q")).measure(truth({"q": np.zeros(9)}, 120.0), 0)
    with pytest.raises(ScenarioError, match=r"got 100 Hz into 50 Hz; log the truth at 100 Hz"):
        suite(Sensor("q")).measure(truth({"q": np.zeros(9)}, 50.0), 0)


def test_sensor_rate_must_divide_the_suite_rate() -> None:
    with pytest.raises(
        ScenarioError, match=r"sensor\[1\]\.rate_hz: .* 8 Hz, got 5 Hz for 'u'; nearest valid: 4 Hz or 8 Hz"
    ):
        suite(Sensor("q"), Sensor("u", rate_hz=5.0), rate_hz=8.0)
    with pytest.raises(ScenarioError, match=r"got 0\.3 Hz for 'u'; nearest valid: 0\.296296 Hz or 0\.307692 Hz"):
        suite(Sensor("u", rate_hz=0.3), rate_hz=8.0)
    with pytest.raises(ScenarioError, match=r"got 20 Hz for 'u'; nearest valid: 8 Hz$"):
        suite(Sensor("u", rate_hz=20.0), rate_hz=8.0)


@pytest.mark.parametrize(
    ("fast", "slow", "whole"),
    [
        (120.0, 8.0, 15),
        (100.0, 100.0, 1),
        (100.00005, 10.0, 10),
        (100.1, 10.0, None),
        (50.0, 100.0, None),
        (30.0, 100.0, None),
    ],
)
def test_whole_ratio(fast: float, slow: float, whole: int | None) -> None:
    assert whole_ratio(fast, slow) == whole


# noise, bias, quantisation, dropout. Each tolerance is 5 standard deviations of its statistic: a false alarm has
# probability 6e-7, and the seeds are fixed

N = 20_000
FLAT = truth({"q": np.zeros(N), "theta": np.zeros(N), "V": np.full(N, 16.0)})


def test_noise_is_white_with_the_stated_mean_and_standard_deviation() -> None:
    noise = suite(Sensor("q", noise_std=0.02, bias=0.5)).measure(FLAT, 3)["q"]
    assert abs(noise.mean() - 0.5) < 5.0 * 0.02 / np.sqrt(N)
    assert abs(noise.std() / 0.02 - 1.0) < 5.0 / np.sqrt(2.0 * N)
    x = (noise - noise.mean()) / noise.std()
    for lag in (1, 2, 10):
        assert abs(np.mean(x[lag:] * x[:-lag])) < 5.0 / np.sqrt(N)
    # Gaussian: the kurtosis of N samples has standard deviation sqrt(24 / N)
    assert abs(np.mean(x**4) - 3.0) < 5.0 * np.sqrt(24.0 / N)


def test_sensors_are_independent_of_each_other_and_of_other_seeds() -> None:
    bench = suite(Sensor("q", noise_std=1.0), Sensor("theta", noise_std=1.0))
    one, two = bench.measure(FLAT, 0), bench.measure(FLAT, 1)
    for a, b in ((one["q"], one["theta"]), (one["q"], two["q"]), (one["theta"], two["q"])):
        assert abs(np.mean(a * b)) < 5.0 / np.sqrt(N)


def test_noise_is_drawn_by_channel_name_so_that_a_sensor_more_changes_no_other() -> None:
    q, theta, V = (Sensor(n, noise_std=0.1, dropout=0.2) for n in ("q", "theta", "V"))
    small, large = suite(q, theta).measure(FLAT, 5), suite(V, theta, q, name="other").measure(FLAT, 5)
    for name in ("q", "theta"):
        assert small[name].tobytes() == large[name].tobytes()
        np.testing.assert_array_equal(small.select([name]).valid, large.select([name]).valid)


def test_noise_comes_from_the_documented_seed_sequence() -> None:
    rng = np.random.default_rng(np.random.SeedSequence([11, zlib.crc32(b"q")]))
    got = suite(Sensor("q", noise_std=1.0)).measure(FLAT, 11)["q"]
    np.testing.assert_array_equal(got, rng.standard_normal(N))


def test_same_seed_same_bytes_and_a_shorter_flight_is_a_prefix() -> None:
    bench = suite(Sensor("q", noise_std=0.1, dropout=0.3, quantum=0.01))
    whole = bench.measure(FLAT, 9)
    assert bench.measure(FLAT, 9).data.tobytes() == whole.data.tobytes()
    part = bench.measure(FLAT.between(0.0, 10.0), 9)
    np.testing.assert_array_equal(part.data, whole.data[:1000])
    np.testing.assert_array_equal(part.valid, whole.valid[:1000])


def test_dropout_does_not_change_the_noise_of_what_arrives() -> None:
    lossless = Sensor("q", noise_std=0.1)
    with_losses = suite(replace(lossless, dropout=0.3)).measure(FLAT, 2)
    arrived = with_losses.valid[:, 0]
    np.testing.assert_array_equal(with_losses["q"][arrived], suite(lossless).measure(FLAT, 2)["q"][arrived])


def test_quantum() -> None:
    got = suite(Sensor("q", quantum=0.25)).measure(truth({"q": np.array([0.0, 0.1, 0.13, -0.2, 0.9])}), 0)
    np.testing.assert_array_equal(got["q"], [0.0, 0.0, 0.25, -0.25, 1.0])


def test_quantisation_error_is_uniform() -> None:
    ramp = truth({"q": np.linspace(0.0, 10.0, N)})
    error = suite(Sensor("q", quantum=0.1)).measure(ramp, 0)["q"] - ramp["q"]
    assert np.abs(error).max() <= 0.05 + 1e-12
    assert error.std() == pytest.approx(0.1 / np.sqrt(12.0), rel=1e-3)  # a ramp visits every phase: no chance in it


def test_dropout_has_its_probability_and_holds_the_last_sample() -> None:
    ramp = truth({"q": np.arange(1.0, N + 1.0)})
    got = suite(Sensor("q", dropout=0.2)).measure(ramp, 4)
    lost = ~got.valid[:, 0]
    assert abs(lost.mean() - 0.2) < 5.0 * np.sqrt(0.2 * 0.8 / N)
    assert not lost[0]
    last = np.maximum.accumulate(np.where(lost, 0.0, ramp["q"]))
    np.testing.assert_array_equal(got["q"], last)


def test_first_sample_always_arrives() -> None:
    bench = suite(Sensor("q", dropout=0.99), Sensor("V", dropout=0.99, rate_hz=50.0))
    for seed in range(20):  # by chance alone all 40 would arrive with probability 1e-80
        assert bench.measure(FLAT.between(0.0, 0.1), seed).valid[0].all()


def test_noise_of_a_slow_sensor_is_one_draw_per_own_sample() -> None:
    got = suite(Sensor("V", noise_std=1.0, rate_hz=50.0)).measure(FLAT, 0)
    np.testing.assert_array_equal(got["V"][::2], got["V"][1::2])
    assert abs(got["V"][::2].std() - 1.0) < 5.0 / np.sqrt(N)


# the order of the physics


def test_order_of_the_physics() -> None:
    # position before scale, scale before bias, lag and delay before sampling, noise before the quantum, hold at the end
    t = time(400)
    rotation = dict.fromkeys(("p", "q", "r", "pdot", "rdot"), 0 * t) | {"qdot": np.ones(400)}
    flight = truth({"az": -9.0 + t, **rotation})
    sensor = Sensor(
        "az",
        noise_std=0.05,
        bias=0.3,
        scale=1.1,
        lag_s=0.2,
        delay_s=0.033,
        quantum=0.1,
        rate_hz=25.0,
        dropout=0.1,
        position_m=(0.5, 0.0, 0.0),
    )
    got = suite(sensor).measure(flight, 6)
    at = np.maximum(t[::4] - 0.033, 0.0)
    clean = 1.1 * (-9.0 - 0.5) + 1.1 * (at - 0.2 * (1.0 - np.exp(-at / 0.2)))
    root = np.random.SeedSequence([6, zlib.crc32(b"az")])
    (losses,) = root.spawn(1)
    noisy = clean + 0.3 + 0.05 * np.random.default_rng(root).standard_normal(100)
    arrived = np.random.default_rng(losses).random(100) >= 0.1
    arrived[0] = True
    own = 0.1 * np.rint(noisy / 0.1)
    for i in range(1, 100):
        own[i] = own[i] if arrived[i] else own[i - 1]
    # the delayed value lies between two truth samples of a curved response: dt^2 / 8 / tau = 6e-5, far below the
    # quantum, but it could turn a sample over at the edge between two counts; none does with this seed
    np.testing.assert_allclose(got["az"], np.repeat(own, 4), atol=1e-12)
    np.testing.assert_array_equal(got.valid[::4, 0], arrived)
    assert not got.valid[1::4].any()


# heading


def test_heading_lags_through_north_and_is_recorded_from_0_to_2_pi() -> None:
    t = time()
    flight = truth({"psi": np.mod(350.0 * DEG_RAD + 0.2 * t, 2 * np.pi)})
    got = suite(Sensor("psi", lag_s=0.1, delay_s=0.05)).measure(flight, 0)["psi"]
    ramp = np.maximum(t - 0.05, 0.0)
    exact = 350.0 * DEG_RAD + 0.2 * (ramp - 0.1 * (1.0 - np.exp(-ramp / 0.1)))
    error = np.angle(np.exp(1j * (got - exact)))
    assert np.abs(error).max() < 2e-5  # straight lines between samples of the delayed response: 0.2 dt^2 / 8 / tau
    assert got.min() >= 0.0
    assert got.max() < 2 * np.pi


def test_heading_noise_at_north_wraps() -> None:
    flight = truth({"psi": np.zeros(1000)})
    got = suite(Sensor("psi", noise_std=1.0 * DEG_RAD)).measure(flight, 0)["psi"]
    assert np.all((got < 0.2) | (got > 2 * np.pi - 0.2))
    assert (got > np.pi).any()
    assert got.max() < 2 * np.pi


def test_a_heading_a_rounding_error_west_of_north_is_zero() -> None:
    got = Sensor("psi").sample(np.array([-1e-17, 0.0, 2.0 * np.pi, 6.0, -0.5, 7.0]), 0)[0]
    np.testing.assert_allclose(got, [0.0, 0.0, 0.0, 6.0, 2.0 * np.pi - 0.5, 7.0 - 2.0 * np.pi], atol=1e-12)
    assert got[0] == 0.0


# laws of a sensor and a suite


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"channel": "alfa"}, "channel: .*did you mean 'alpha'"),
        ({"noise_std": -1.0}, "0 <= noise_std <= 1000 must hold, got -1"),
        ({"lag_s": -0.1}, "0 <= lag_s"),
        ({"delay_s": float("nan")}, "0 <= delay_s <= 60 must hold, got nan"),
        ({"quantum": -0.1}, "0 <= quantum"),
        ({"bias": float("inf")}, "bias: -1000 <= bias <= 1000 must hold, got inf"),
        ({"rate_hz": 0.0}, "1e-05 <= rate_hz <= 20000 must hold, got 0"),
        ({"dropout": 1.0}, "0 <= dropout < 1"),
        ({"position_m": (0.1, 0.0, 0.0)}, "ax, ay, az only, got one for 'q'"),
        ({"position_m": (0.1, 0.0)}, "three finite numbers"),
        ({"channel": "psi", "scale": 1.1}, "scale = 1 must hold for psi"),
    ],
)
def test_sensor_refuses(keys: dict, words: str) -> None:
    with pytest.raises(ScenarioError, match=words):
        Sensor(**({"channel": "q"} | keys))


def test_sensor_lists_every_fault() -> None:
    with pytest.raises(ScenarioError) as caught:
        Sensor("q", noise_std=-1.0, dropout=2.0, rate_hz=-5.0)
    assert [fault.split(":")[0] for fault in caught.value.faults] == ["noise_std", "rate_hz", "dropout"]


def test_suite_refuses_none_and_two_of_a_channel() -> None:
    with pytest.raises(ScenarioError, match="at least one sensor"):
        suite()
    with pytest.raises(ScenarioError, match=r"sensor\[2\]\.channel: .* got 'q' in sensor\[0\] too"):
        suite(Sensor("q"), Sensor("V"), Sensor("q"))
    with pytest.raises(ScenarioError, match="0 < rate_hz must hold, got 0"):
        suite(Sensor("q"), rate_hz=0.0)


def test_outputs_are_what_is_no_control() -> None:
    bench = suite(*(Sensor(n) for n in ("de", "V", "thr_cmd", "q", "de_cmd")))
    assert bench.outputs == ("V", "q")


# what a drift amounts to over a flight


@pytest.mark.parametrize("duration_s", [2.0, 20.0, 300.0])
def test_drift_of_a_gauss_markov_bias_is_the_integral_of_its_covariance(duration_s: float) -> None:
    # E[(b - mean b)^2] averaged over T = s^2 (1 - 1/T^2 int int exp(-|t - u| / T1)); the inner integral by hand once
    # more: int int = 2 int_0^T (T - tau) exp(-tau / T1) dtau, by quadrature
    std, time_s = 0.3, 15.0
    node, weight = np.polynomial.legendre.leggauss(60)
    tau = 0.5 * duration_s * (node + 1.0)
    double = 2.0 * np.sum(0.5 * duration_s * weight * (duration_s - tau) * np.exp(-tau / time_s))
    exact = std * np.sqrt(1.0 - double / duration_s**2)
    assert Sensor("q", drift_std=std, drift_time_s=time_s).drift_over(duration_s) == pytest.approx(exact, rel=1e-9)


def test_drift_of_a_random_walk_and_of_both() -> None:
    # E[(b - mean b)^2] averaged over T of a walk of variance w^2 t: w^2 (T / 2 - T / 3)
    walk = Sensor("q", bias_walk=0.02)
    assert walk.drift_over(24.0) == pytest.approx(0.02 * 2.0, rel=1e-12)
    wander = Sensor("q", drift_std=0.3, drift_time_s=15.0)
    both = Sensor("q", bias_walk=0.02, drift_std=0.3, drift_time_s=15.0)
    assert both.drift_over(24.0) == pytest.approx(np.hypot(walk.drift_over(24.0), wander.drift_over(24.0)), rel=1e-12)
    assert Sensor("q").drift_over(24.0) == 0.0


def test_noise_of_a_suite_counts_rounding() -> None:
    # the error of rounding is even over the quantum: its variance is quantum^2 / 12
    bench = suite(Sensor("q", noise_std=0.3, quantum=0.6), Sensor("V", quantum=0.6), Sensor("theta"))
    third = 0.6**2 / 12.0
    assert bench.noise_std == pytest.approx({"q": np.sqrt(0.09 + third), "V": np.sqrt(third), "theta": 0.0})
