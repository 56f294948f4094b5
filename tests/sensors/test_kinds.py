"""Each kind of instrument against its equation, and the effects that all of them share."""

import zlib
from dataclasses import replace

import numpy as np
import pytest

from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.errors import ChannelError, RecordError, ScenarioError
from testbench.core.record import FlightRecord
from testbench.sensors import KINDS, Sensor, SensorSuite
from testbench.sensors.sensor import ROTATION, lever

RATE_HZ = 100.0
RAMP = np.arange(2000) / RATE_HZ


def truth(channels: dict[str, np.ndarray]) -> FlightRecord:
    t = np.arange(len(next(iter(channels.values())))) / RATE_HZ
    return FlightRecord(t, tuple(channels), np.column_stack(list(channels.values())), "truth")


def measured(sensor: Sensor, channels: dict[str, np.ndarray], seed: int = 0) -> np.ndarray:
    record = SensorSuite("bench", "a suite", RATE_HZ, (sensor,)).measure(truth(channels), seed)
    return record[sensor.channel]


def moving(n: int = 400, seed: int = 1) -> dict[str, np.ndarray]:
    """Return smooth motion in all channels that instruments read."""
    rng, t = np.random.default_rng(seed), np.arange(n) / RATE_HZ
    names = ["u", "v", "w", "p", "q", "r", "pdot", "qdot", "rdot", "ax", "ay", "az", "psi", "h", "V", "alpha", "beta"]
    out = {k: 0.2 * np.sin(rng.uniform(0.5, 3.0) * t + rng.uniform(0.0, 6.0)) for k in names}
    out["u"] = out["u"] + 16.0
    out["V"] = np.sqrt(out["u"] ** 2 + out["v"] ** 2 + out["w"] ** 2)
    out["alpha"], out["beta"] = np.arctan2(out["w"], out["u"]), np.arcsin(out["v"] / out["V"])
    return out


# kinds


@pytest.mark.parametrize(("channel", "own", "others"), [("p", 0, ("q", "r")), ("az", 2, ("ax", "ay"))])
def test_triads_lean_towards_the_other_axes(channel: str, own: int, others: tuple[str, str]) -> None:
    kind = KINDS["rate_gyro" if channel == "p" else "accelerometer"]
    cross = [0.01, -0.02, 0.03]
    cross[own] = 0.0
    x = moving()
    shares = [c for k, c in enumerate(cross) if k != own]
    expected = x[channel] + shares[0] * x[others[0]] + shares[1] * x[others[1]]
    np.testing.assert_allclose(measured(kind(channel=channel, cross_axis=tuple(cross)), x), expected, atol=1e-14)


def test_a_leaning_accelerometer_feels_the_other_axes_where_it_sits() -> None:
    x, place = moving(), (0.4, -0.1, 0.2)
    arm = lever(np.column_stack([x[n] for n in ROTATION]), place)
    expected = x["az"] + arm[:, 2] + 0.05 * (x["ax"] + arm[:, 0])
    sensor = KINDS["accelerometer"](channel="az", position_m=place, cross_axis=(0.05, 0.0, 0.0))
    np.testing.assert_allclose(measured(sensor, x), expected, atol=1e-13)


def test_compass_deviation() -> None:
    x = {"psi": np.linspace(0.1, 6.1, 300)}
    B, C, D, E = (np.array([3.0, -2.0, 1.0, 0.5]) * DEG_RAD).tolist()
    got = measured(KINDS["magnetic_heading"](channel="psi", deviation=(B, C, D, E)), x)
    psi = x["psi"]
    error = B * np.sin(psi) + C * np.cos(psi) + D * np.sin(2 * psi) + E * np.cos(2 * psi)
    np.testing.assert_allclose(got, psi + error, atol=1e-13)


def turn(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return the matrix of Euler angles, from the axes that are turned to the new ones."""
    (sr, sp, sy), (cr, cp, cy) = np.sin([roll, pitch, yaw]), np.cos([roll, pitch, yaw])
    about_x = np.array([[1, 0, 0], [0, cr, sr], [0, -sr, cr]])
    about_y = np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])
    about_z = np.array([[cy, sy, 0], [-sy, cy, 0], [0, 0, 1]])
    return about_x @ about_y @ about_z


def test_an_attitude_unit_that_is_turned_shows_the_angles_of_its_own_axes() -> None:
    rng, mounting = np.random.default_rng(5), (0.02, -0.03, 0.3)
    x = {"phi": rng.uniform(-3.1, 3.1, 200), "theta": rng.uniform(-1.5, 1.5, 200)}
    seen = [turn(*mounting) @ turn(phi, theta, 0.7) for phi, theta in zip(x["phi"], x["theta"], strict=True)]
    phi, theta = (measured(KINDS["attitude"](channel=name, mounting=mounting), x) for name in ("phi", "theta"))
    np.testing.assert_allclose(theta, [-np.arcsin(R[0, 2]) for R in seen], atol=1e-12)
    np.testing.assert_allclose(phi, [np.arctan2(R[1, 2], R[2, 2]) for R in seen], atol=1e-12)
    straight = KINDS["attitude"](channel="theta")
    assert straight.needs == ("theta",)
    np.testing.assert_array_equal(measured(straight, {"theta": x["theta"]}), x["theta"])
    with pytest.raises(ScenarioError, match=r"mounting_deg: roll, pitch and yaw below 0\.5 rad"):
        KINDS["attitude"](channel="phi", mounting=(0.0, 0.6, 0.0))


def test_static_port_in_the_flow_shifts_altitude_and_airspeed() -> None:
    x = moving()
    h = measured(KINDS["barometer"](channel="h", static_cp=-0.05), x)
    np.testing.assert_allclose(h, x["h"] + 0.05 * x["V"] ** 2 / (2.0 * G0_M_S2), rtol=1e-13)
    V = measured(KINDS["pitot"](channel="V", static_cp=-0.05, static_cp_alpha=0.3), x)
    np.testing.assert_allclose(V**2, x["V"] ** 2 * (1.05 - 0.3 * x["alpha"]), rtol=1e-13)


def test_pitot_without_a_pressure_difference_is_refused() -> None:
    x = moving() | {"alpha": np.full(400, 0.3)}
    with pytest.raises(RecordError, match=r"static_cp_alpha alpha < 1 must hold all through a flight, got 1\.2"):
        measured(KINDS["pitot"](channel="V", static_cp_alpha=4.0), x)


def test_static_ports_err_alike_in_sideslip_to_either_side() -> None:
    x, pitot = moving(), KINDS["pitot"](channel="V", static_cp=-0.02, static_cp_alpha=0.1, static_cp_beta2=0.8)
    assert set(pitot.needs) == {"V", "alpha", "beta"}
    expected = x["V"] ** 2 * (1.02 - 0.1 * x["alpha"] - 0.8 * x["beta"] ** 2)
    np.testing.assert_allclose(measured(pitot, x) ** 2, expected, rtol=1e-13)
    np.testing.assert_array_equal(measured(pitot, x | {"beta": -x["beta"]}), measured(pitot, x))
    with pytest.raises(RecordError, match=r"static_cp_beta2 beta\^2 < 1 must hold all through a flight, got 1\.25"):
        measured(KINDS["pitot"](channel="V", static_cp_beta2=5.0), x | {"beta": np.full(400, 0.5)})


def test_a_pitot_on_the_inner_wing_of_a_turn_is_slower_and_one_below_a_pull_up_faster() -> None:
    level = {n: np.zeros(50) for n in "vwpqr"} | {"u": np.full(50, 16.0), "V": np.full(50, 16.0)}
    right, below = (KINDS["pitot"](channel="V", position_m=at) for at in ((0.0, 2.0, 0.0), (0.0, 0.0, 0.5)))
    np.testing.assert_allclose(measured(right, level | {"r": np.full(50, 0.2)}), 16.0 - 0.4, rtol=1e-12)
    np.testing.assert_allclose(measured(below, level | {"q": np.full(50, 0.4)}), 16.0 + 0.2, rtol=1e-12)


def test_a_pitot_shows_the_speed_of_its_place() -> None:
    x, place = moving(), np.array([0.7, -1.5, 0.2])
    flow = np.column_stack([x[k] for k in "uvw"]) + np.cross(np.column_stack([x[k] for k in "pqr"]), place)
    speed = np.linalg.norm(flow, axis=1)
    at = {"position_m": tuple(place)}
    np.testing.assert_allclose(measured(KINDS["pitot"](channel="V", **at), x), speed, rtol=1e-13)
    x["qbar"] = 0.6 * x["V"] ** 2
    np.testing.assert_allclose(measured(KINDS["pitot"](channel="qbar", **at), x), 0.6 * speed**2, rtol=1e-13)


def test_vane_on_a_boom_reads_the_flow_where_it_sits() -> None:
    # the velocity of the vane through the air, (u, v, w) + omega x r, and its angles
    x, place = moving(), np.array([0.7, 0.1, -0.05])
    flow = np.column_stack([x[k] for k in "uvw"]) + np.cross(np.column_stack([x[k] for k in "pqr"]), place)
    alpha = measured(KINDS["flow_vane"](channel="alpha", position_m=tuple(place), upwash=1.1), x)
    np.testing.assert_allclose(alpha, 1.1 * np.arctan2(flow[:, 2], flow[:, 0]), atol=1e-13)
    beta = measured(KINDS["flow_vane"](channel="beta", position_m=tuple(place)), x)
    turned = np.arctan2(flow[:, 1], flow[:, 0]) - np.arctan2(x["v"], x["u"])
    np.testing.assert_allclose(beta, x["beta"] + turned, atol=1e-13)
    # the textbook's small angles: x q / V off alpha, x r / V on beta; second order terms are 0.02^2
    np.testing.assert_allclose(alpha / 1.1 - x["alpha"], (-0.7 * x["q"] + 0.1 * x["p"]) / x["V"], atol=5e-4)


def test_vane_that_is_calibrated_records_the_channel_itself() -> None:
    x = moving()
    assert measured(KINDS["flow_vane"](channel="alpha"), x).tobytes() == x["alpha"].tobytes()


def test_play_of_a_linkage_is_a_hysteresis() -> None:
    x = {"de": np.array([0.0, 0.4, 1.0, 2.0, 1.8, 1.2, 0.9, -1.0, -0.9])}
    got = measured(KINDS["surface_position"](channel="de", play=1.0), x)
    np.testing.assert_allclose(got, [0.0, 0.0, 0.5, 1.5, 1.5, 1.5, 1.4, -0.5, -0.5], atol=1e-14)


def test_aircraft_without_a_propeller_have_no_motor_speed(eolo, eolo_trim) -> None:
    from testbench.flight import Manoeuvre, fly
    from testbench.inputs.signal import InputSignal

    signal = InputSignal(np.arange(50) / 500.0, np.zeros((50, 1)), ("de",))
    record = fly(eolo, eolo_trim, Manoeuvre("rest", signal, 0.0), RATE_HZ)
    assert {"north", "east"} <= set(record.channels)
    tachometer = SensorSuite("bench", "a suite", RATE_HZ, (KINDS["motor_speed"](channel="motor_speed"),))
    with pytest.raises(ChannelError, match="needs channel 'motor_speed'"):
        tachometer.measure(record, 0)


def test_gps_sees_how_far_the_aircraft_has_flown(eolo, eolo_trim) -> None:
    from testbench.flight import Manoeuvre, fly
    from testbench.inputs.signal import InputSignal

    signal = InputSignal(np.arange(1000) / 500.0, np.zeros((1000, 1)), ("de",))
    record = fly(eolo, eolo_trim, Manoeuvre("rest", signal, 0.0), RATE_HZ)
    # 2 s at 16 m/s heading north in still air; the trim drifts by some 1e-6, the earth bends by 1e-5
    np.testing.assert_allclose(record["north"], 16.0 * record.t_s, atol=2e-3)
    np.testing.assert_allclose(record["east"], 0.0, atol=1e-3)
    np.testing.assert_allclose(record["v_north"], 16.0, atol=2e-3)
    np.testing.assert_allclose(np.hypot(record["v_north"], record["v_east"]), record["Vg"], rtol=1e-9)
    gps = KINDS["gps"](channel="north", rate_hz=10.0, delay_s=0.2)
    got = SensorSuite("bench", "a suite", RATE_HZ, (gps,)).measure(record, 0)
    assert got["north"][-1] == pytest.approx(16.0 * 1.8, abs=0.01)
    assert got.valid[:, 0].sum() == 21


@pytest.mark.parametrize("name", KINDS)
def test_weights_are_the_derivatives_of_what_is_felt(name: str) -> None:
    figures = {
        "rate_gyro": {"channel": "q", "cross_axis": (0.01, 0.0, 0.02)},
        "accelerometer": {"channel": "az", "position_m": (0.3, 0.1, -0.2), "cross_axis": (0.02, 0.0, 0.0)},
        "magnetic_heading": {"channel": "psi", "deviation": (0.05, 0.02, 0.01, 0.0)},
        "attitude": {"channel": "theta", "mounting": (0.02, -0.05, 0.1)},
        "barometer": {"channel": "h", "static_cp": -0.04},
        "pitot": {
            "channel": "V",
            "static_cp": -0.03,
            "static_cp_alpha": 0.2,
            "static_cp_beta2": 0.3,
            "position_m": (0.3, 0.5, 0.1),
        },
        "gps": {"channel": "Vg", "rate_hz": 10.0, "delay_s": 0.1},
        "flow_vane": {"channel": "alpha", "position_m": (0.7, 0.0, 0.1), "upwash": 1.05},
        "strain_gauge": {"channel": "strain_wing_3"},
        "surface_position": {"channel": "de", "play": 0.01},
        "command_log": {"channel": "de_cmd"},
        "motor_speed": {"channel": "motor_speed"},
    }[name]
    sensor = KINDS[name](**figures)
    rng = np.random.default_rng(3)
    trim = {n: 0.1 * rng.standard_normal() for n in sensor.needs} | {n: 16.0 for n in ("u", "V") if n in sensor.needs}
    weights = sensor.weights(trim)
    step = {n: 1e-4 * rng.standard_normal() for n in sensor.needs}
    both = {n: np.array([trim[n], trim[n] + step[n]]) for n in sensor.needs}
    if name != "surface_position":  # play does not move for a step this small
        change = np.diff(sensor.feel(both))[0]
        # second order: 1e-8 times derivatives of order 1
        assert sum(weights[n] * step[n] for n in weights) == pytest.approx(change, abs=5e-8)
    assert weights[sensor.channel] == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(
    ("kind", "keys", "words"),
    [
        ("rate_gyro", {"channel": "az"}, "a sensor of kind rate_gyro measures p, q, r; got 'az'"),
        ("rate_gyro", {"channel": "q", "position_m": (1.0, 0.0, 0.0)}, "no channel of this kind only, got one for 'q'"),
        ("rate_gyro", {"channel": "q", "cross_axis": (0.0, 0.1, 0.0)}, "share of its own axis must be 0"),
        ("accelerometer", {"channel": "ax", "cross_axis": (0.0, 1.5, 0.0)}, "three shares between -1 and 1"),
        ("accelerometer", {"channel": "az_wing_1", "position_m": (0.1, 0.0, 0.0)}, "ax, ay, az only"),
        ("magnetic_heading", {"channel": "psi", "deviation": (0.3, 0.3, 0.0, 0.0)}, "less than 0.5 rad"),
        ("barometer", {"channel": "hdot", "static_cp": 0.1}, "modelled for h only"),
        ("rate_gyro", {"channel": "q", "cross_axis": (0.1, 0.0)}, "three shares between -1 and 1"),
        ("rate_gyro", {"channel": "q", "cross_axis": (1.0, 0.0, 0.0)}, "three shares between -1 and 1"),
        ("rate_gyro", {"channel": "q", "cross_axis": (0.0, 0.0, float("nan"))}, "three shares between -1 and 1"),
        ("surface_position", {"channel": "thr", "play": 0.1}, "a throttle has no play"),
        ("pitot", {"channel": "V", "static_cp": 1.0}, "-1 < static_cp < 1 must hold, got 1"),
        ("pitot", {"channel": "V", "static_cp_beta2": float("inf")}, "static_cp_beta2: a finite number is needed"),
        ("gps", {"channel": "Vg"}, "rate_hz: a receiver has a rate of its own"),
        ("flow_vane", {"channel": "alpha", "upwash": 0.0}, "0 < upwash < 5"),
        ("surface_position", {"channel": "de", "play": -1.0}, "0 <= play_deg"),
        ("strain_gauge", {"channel": "az_wing_1"}, "got 'az_wing_1'"),
        ("command_log", {"channel": "de"}, "got 'de'"),
    ],
)
def test_kind_refuses(kind: str, keys: dict, words: str) -> None:
    with pytest.raises(ScenarioError, match=words):
        KINDS[kind](**keys)


# effects that all kinds share


def test_clock_of_a_recorder() -> None:
    x = {"q": 3.0 * RAMP}
    sensor = Sensor("q", delay_s=0.1, recorder="boom", clock_offset_s=0.05, clock_ppm=1000.0)
    late = 0.15 + 1e-3 * RAMP
    np.testing.assert_allclose(measured(sensor, x), 3.0 * np.maximum(RAMP - late, 0.0), atol=1e-12)
    early = replace(sensor, delay_s=0.0, clock_offset_s=-0.2, clock_ppm=0.0)  # stamps too low: samples from later
    np.testing.assert_allclose(measured(early, x), 3.0 * np.minimum(RAMP + 0.2, RAMP[-1]), atol=1e-12)


def test_sensors_of_one_recorder_share_its_clock() -> None:
    sensors = (Sensor("q", recorder="a", clock_offset_s=0.1), Sensor("p", recorder="a"))
    with pytest.raises(ScenarioError, match=r"sensor\[1\]\.recorder: the sensors of recorder 'a' must share one clock"):
        SensorSuite("bench", "a suite", RATE_HZ, sensors)


def test_a_steady_drift_counts_from_the_first_sample_and_is_neither_scaled_nor_late() -> None:
    """0.1 deg/s, after 10 s, is 1 deg; a flight whose clock begins later drifts the same."""
    rate = 0.1 * DEG_RAD
    drifting = Sensor("q", bias_rate=rate, bias=0.2, scale=1.1, lag_s=0.1, delay_s=0.2)
    x = moving(2000)
    off = measured(drifting, x) - measured(replace(drifting, bias_rate=0.0), x)
    np.testing.assert_allclose(off, rate * RAMP, atol=1e-14)
    assert off[1000] == pytest.approx(1.0 * DEG_RAD)
    whole = truth(x)
    later = replace(whole, t_s=whole.t_s + 50.0)
    np.testing.assert_allclose(drifting.respond(later), drifting.respond(whole), atol=1e-9)


def test_a_slow_sensor_holds_its_drift_between_samples_and_what_is_certain_keeps_it() -> None:
    sensor = Sensor("q", bias_rate=0.3, rate_hz=10.0, noise_std=0.5, bias=2.0, bias_walk=0.1)
    suite = SensorSuite("bench", "a suite", RATE_HZ, (sensor,))
    got = suite.without_errors().measure(truth({"q": np.zeros(2000)}), 3)["q"]
    np.testing.assert_allclose(got, 0.3 * np.floor(RAMP * 10.0 + 1e-9) / 10.0, atol=1e-12)


def test_a_sensor_without_the_later_figures_has_the_text_that_it_had() -> None:
    """Keys of stored results are made of that text."""
    pitot = KINDS["pitot"](channel="V", static_cp=-0.03)
    assert repr(pitot).startswith("Pitot(channel='V', noise_std=0.0, bias=0.0, scale=1.0,")
    assert repr(pitot).endswith("price_eur=None, mass_g=None, static_cp=-0.03, static_cp_alpha=0.0)")
    changed = repr(replace(pitot, bias_rate=0.01, static_cp_beta2=2.0))
    assert "bias_rate=0.01" in changed
    assert "static_cp_beta2=2.0" in changed


# statistics of drift. Over many seeds; each tolerance is 5 standard deviations of its statistic: false alarm 6e-7,
# and the seeds are fixed

SEEDS = 400


def drifts(sensor: Sensor, n: int) -> np.ndarray:
    x = np.zeros(n)
    return np.array([sensor.sample(x, seed, 1.0 / RATE_HZ)[0] for seed in range(SEEDS)])


def test_random_walk_grows_with_the_square_root_of_time() -> None:
    walks = drifts(Sensor("q", bias_walk=0.3), 401)
    assert not np.any(walks[:, 0])
    for k in (100, 400):
        # the standard deviation of n normal samples scatters by 1 / sqrt(2 n)
        expected = 0.3 * np.sqrt(k / RATE_HZ)
        assert abs(walks[:, k].std() / expected - 1.0) < 5.0 / np.sqrt(2.0 * SEEDS)


def test_gauss_markov_drift_is_steady_and_forgets() -> None:
    T, n = 0.5, 101
    b = drifts(Sensor("q", drift_std=0.2, drift_time_s=T), n)
    for k in (0, n - 1):
        assert abs(b[:, k].std() / 0.2 - 1.0) < 5.0 / np.sqrt(2.0 * SEEDS)
    expected = np.exp(-(n - 1) / RATE_HZ / T)
    found = np.mean(b[:, 0] * b[:, -1]) / 0.04
    assert abs(found - expected) < 5.0 * np.sqrt((1.0 + expected**2) / SEEDS)


def test_drift_changes_neither_noise_nor_losses_and_a_shorter_flight_is_a_prefix() -> None:
    plain = Sensor("q", noise_std=0.1, dropout=0.2)
    drifting = replace(plain, drift_std=0.05, drift_time_s=3.0, bias_walk=0.01)
    x = np.zeros(500)
    (a, lost), (b, also_lost) = plain.sample(x, 4, 0.01), drifting.sample(x, 4, 0.01)
    np.testing.assert_array_equal(lost, also_lost)
    alone = replace(drifting, noise_std=0.0).sample(x, 4, 0.01)[0]
    np.testing.assert_allclose(b - a, alone, atol=1e-14)
    np.testing.assert_array_equal(drifting.sample(x[:200], 4, 0.01)[0], b[:200])
    first = np.random.default_rng(np.random.SeedSequence([4, zlib.crc32(b"q")])).standard_normal(500)
    np.testing.assert_allclose(a, 0.1 * first, atol=1e-15)


def test_drift_is_the_documented_recursion_on_the_documented_draws() -> None:
    T, dt, s, walk, n = 0.7, 0.02, 0.2, 0.05, 60
    seeds = np.random.SeedSequence([4, zlib.crc32(b"q")], spawn_key=(1,))
    w = np.random.default_rng(seeds).standard_normal((n, 2))
    steady, wandered, a = [s * w[0, 0]], [0.0], np.exp(-dt / T)
    for k in range(1, n):
        steady.append(a * steady[-1] + s * np.sqrt(1.0 - a**2) * w[k, 0])
        wandered.append(wandered[-1] + walk * np.sqrt(dt) * w[k, 1])
    sensor = Sensor("q", drift_std=s, drift_time_s=T, bias_walk=walk, bias=1.0)
    expected = 1.0 + np.array(steady) + np.array(wandered)
    np.testing.assert_allclose(sensor.sample(np.zeros(n), 4, dt)[0], expected, atol=1e-13)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"drift_std": 0.1}, "drift_std and drift_time_s go together"),
        ({"drift_std": 0.1, "drift_time_s": -1.0}, "0 < drift_time_s"),
        ({"bias_walk": -1.0}, "0 <= bias_walk"),
        ({"bias_rate": float("nan")}, "-1000 <= bias_rate <= 1000 must hold, got nan"),
        ({"clock_offset_s": 0.1}, "name the recorder"),
        ({"recorder": "a", "clock_ppm": 1e6}, "|clock_ppm| <= 10000"),
        ({"price_eur": -1.0}, "0 <= price_eur"),
    ],
)
def test_sensor_refuses(keys: dict, words: str) -> None:
    with pytest.raises(ScenarioError, match=words.replace("|", r"\|")):
        Sensor("q", **keys)


def test_suite_without_errors_shows_what_is_felt() -> None:
    x = moving()
    sensor = KINDS["flow_vane"](
        channel="alpha", position_m=(0.7, 0.0, 0.0), upwash=1.1, noise_std=0.1, bias=1.0, quantum=0.1, dropout=0.2,
        drift_std=0.1, drift_time_s=5.0, bias_walk=0.1, lag_s=0.05, bias_rate=0.01,
    )  # fmt: skip
    clean = SensorSuite("bench", "a suite", RATE_HZ, (sensor,)).without_errors()
    np.testing.assert_array_equal(clean.measure(truth(x), 0)["alpha"], sensor.respond(truth(x)))


def test_price_and_mass_of_a_suite_need_those_of_every_sensor() -> None:
    a, b = Sensor("q", price_eur=10.0, mass_g=2.0), Sensor("p", price_eur=5.0)
    both = SensorSuite("bench", "a suite", RATE_HZ, (a, b))
    assert (both.price_eur, both.mass_g) == (15.0, None)
