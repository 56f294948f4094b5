"""What every packaged sensor suite must do, and what those of the papers promise of each other."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.core.paths import SUITES, suite_names
from testbench.core.record import FlightRecord
from testbench.sensors import KINDS, Sensor, load_suite
from testbench.sensors.contract import SECONDS, suite_laws, synthetic_flight
from testbench.sensors.suite import SensorSuite

_FLIGHT = synthetic_flight(20.0)
SLOPE = np.abs(np.gradient(_FLIGHT["q"][::3], 0.05)).max()  # 1/s, the fastest of its pitch rate
MARKS = ("estimate", "from memory", "data sheet", "exact by construction")


@pytest.mark.parametrize("name", suite_names())
def test_suite(name: str) -> None:
    suite = load_suite(name)
    broken = [law.sentence for law in suite_laws(suite) if not law.holds]
    assert broken == []
    assert suite.name == name
    record = suite.measure(synthetic_flight(suite.rate_hz), 1)
    assert record.provenance["truth"] == {"aircraft": "synthetic"}


@pytest.mark.parametrize(
    ("change", "law"),
    [
        ({"bias": 0.01}, "a sensor with errors shows them"),
        ({"bias_rate": 0.01}, "a sensor with errors shows them"),
        ({"noise_std": 0.01}, "a sensor with errors shows them"),
        ({"quantum": 0.01}, "a sensor with errors shows them"),
        ({"scale": 1.2}, "figures lie near the truth"),
    ],
)
def test_a_suite_that_breaks_a_law_is_told_which(change: dict[str, float], law: str) -> None:
    suite = load_suite("eolo_alpha")
    exact = dict.fromkeys(
        ("noise_std", "quantum", "bias", "dropout", "lag_s", "delay_s", "bias_walk", "drift_std"), 0.0
    )
    honest = replace(suite.sensors[2], scale=1.0, **exact)
    behind = replace(suite, sensors=(*suite.sensors[:2], honest, *suite.sensors[3:]))

    class Lying(SensorSuite):
        def measure(self, truth: FlightRecord, seed: int) -> FlightRecord:
            """Measure as if there were no such error: the record does not show what the file announces."""
            return behind.measure(truth, seed)

    sensors = (*suite.sensors[:2], replace(honest, **change), *suite.sensors[3:])
    lying = Lying(suite.name, suite.title, suite.rate_hz, sensors)
    assert [broken for broken in suite_laws(lying) if not broken.holds and law in broken.words]


@pytest.mark.parametrize(
    ("figures", "allowed"),
    [  # six standard deviations of what is random, the bias, half a quantum, and 1.05 of the slope over the age
        ({"noise_std": 0.04}, 0.24),
        ({"noise_std": 0.03, "drift_std": 0.04, "drift_time_s": 1.0}, 0.3),
        ({"bias_walk": 0.01}, 0.06 * np.sqrt(SECONDS)),
        ({"bias": -0.2}, 0.2),
        ({"bias_rate": -0.01}, 0.01 * SECONDS),
        ({"quantum": 0.5}, 0.25),
        ({"lag_s": 0.3}, 1.05 * SLOPE * 0.3),
        ({"delay_s": 0.3}, 1.05 * SLOPE * 0.3),
        ({"recorder": "a", "clock_offset_s": -0.3}, 1.05 * SLOPE * 0.3),
        ({"recorder": "a", "clock_ppm": -1000.0}, 1.05 * SLOPE * 1e-3 * SECONDS),
        ({"rate_hz": 5.0}, 1.05 * SLOPE * 0.15),  # a sample more is in every age: 0.2 s here instead of 0.05 s
        ({"dropout": 0.1}, 1.05 * SLOPE * 0.15),  # four of the suite's own
    ],
)
def test_figures_may_lie_as_far_off_as_their_errors_allow_and_no_further(figures: dict, allowed: float) -> None:
    rate_hz = 20.0
    sensor = Sensor("q", **figures)
    bound = allowed + 1.05 * SLOPE / rate_hz

    def holds(off: float) -> bool:
        class Off(SensorSuite):
            def measure(self, truth: FlightRecord, seed: int) -> FlightRecord:
                """Measure the truth itself, but for one sample."""
                exact = SensorSuite("bench", "a suite", rate_hz, (Sensor("q"),)).measure(truth, seed)
                data = exact.data.copy()
                data[100] += off
                return FlightRecord(exact.t_s, ("q",), data, "measured")

        laws = suite_laws(Off("bench", "a suite", rate_hz, (sensor,)))
        return next(law.holds for law in laws if "figures lie near" in law.words)

    for sign in (-1.0, 1.0):
        assert holds(sign * 0.995 * bound)
        assert not holds(sign * 1.005 * bound)


def test_every_kind_is_in_a_suite_or_has_no_aircraft_to_sit_on() -> None:
    used = {s.KIND for name in suite_names() for s in load_suite(name).sensors}
    assert set(KINDS) - used == {"motor_speed"}  # no aircraft of the fleet has a propeller that turns


@pytest.mark.parametrize("name", [n for n in suite_names() if n.startswith(("eolo", "taurus"))])
def test_price_and_mass_are_known_and_marked_as_estimates(name: str) -> None:
    suite = load_suite(name)
    assert suite.price_eur is not None
    assert suite.mass_g is not None
    assert "price_eur and mass_g with mounting and cable: estimates" in (SUITES / f"{name}.toml").read_text("utf-8")


@pytest.mark.parametrize("name", suite_names())
def test_every_part_has_a_source_that_says_how_well_it_is_known(name: str) -> None:
    for sensor in load_suite(name).sensors:
        assert sensor.part.strip()
        assert any(mark in sensor.source for mark in MARKS), f"{name}, {sensor.channel}: {sensor.source}"


@pytest.mark.parametrize("name", suite_names())
def test_figures_are_those_of_an_instrument(name: str) -> None:
    for sensor in load_suite(name).sensors:
        assert sensor.scale == pytest.approx(1.0, abs=0.1)
        assert sensor.lag_s < 1.0
        assert sensor.delay_s < 1.0
        exact = "exact by construction" in sensor.source
        assert not exact or sensor.channel.endswith("_cmd"), "only the log of a command can be exact"
        assert exact == (sensor.noise_std + sensor.quantum == 0.0), "nothing else is perfect"


def test_channels_of_the_suites() -> None:
    assert load_suite("eolo_no_alpha").channels == ("V", "q", "theta", "de")
    assert load_suite("eolo_alpha").channels == ("V", "alpha", "q", "theta", "de")
    assert load_suite("eolo_gap").channels == ("V", "alpha", "q", "theta", "az", "de_cmd", "thr_cmd")
    assert load_suite("b1_no_alpha").channels == ("V", "q", "theta", "de")
    assert load_suite("b1_alpha").channels == ("V", "alpha", "q", "theta", "de")
    lateral = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "de", "da", "dr")
    assert load_suite("eolo_alpha_beta").channels == lateral
    assert load_suite("taurus_8hz").channels == ("theta", "q", "u", "h", "de_cmd")
    rates = {n: load_suite(n).rate_hz for n in suite_names()}
    assert [rates[n] for n in ("eolo_no_alpha", "eolo_alpha", "eolo_gap")] == [100, 100, 100]
    assert [rates[n] for n in ("b1_no_alpha", "b1_alpha", "taurus_8hz")] == [25, 25, 8]


@pytest.mark.parametrize(
    ("base", "other"),
    [
        ("eolo_no_alpha", "eolo_alpha"),
        ("eolo_no_alpha", "eolo_gap"),
        ("eolo_alpha", "eolo_alpha_beta"),
        ("eolo_no_beta", "eolo_alpha_beta"),
        ("b1_no_alpha", "b1_alpha"),
    ],
)
def test_common_sensors_of_the_suites_of_one_aircraft_record_the_same_bytes(base: str, other: str) -> None:
    one, two = load_suite(base), load_suite(other)
    truth = synthetic_flight(one.rate_hz)
    common = [n for n in one.channels if n in two.channels]
    assert {"V", "q", "theta"} <= set(common)
    a, b = one.measure(truth, 3), two.measure(truth, 3)
    assert a.columns(common).tobytes() == b.columns(common).tobytes()
    assert [s for s in one.sensors if s.channel in common] == [s for s in two.sensors if s.channel in common]


def test_gps_of_taurus_delivers_every_second_row() -> None:
    record = load_suite("taurus_8hz").measure(synthetic_flight(8.0), 0)
    assert record.valid[:, record.channels.index("u")].tolist() == [i % 2 == 0 for i in range(len(record))]
