"""What every packaged sensor suite must do, and what those of the papers promise of each other."""

from __future__ import annotations

import numpy as np
import pytest

from testbench.core.channels import CHANNELS, station_channels
from testbench.core.paths import SUITES, suite_names
from testbench.core.record import FlightRecord
from testbench.sensors import KINDS, load_suite

SECONDS = 20.0
NAMES = (*CHANNELS, *station_channels(11, flexible=True))
MARKS = ("estimate", "from memory", "data sheet", "exact by construction")


def flight(rate_hz: float) -> FlightRecord:
    """Return a smooth truth with all channels, those of eleven wing stations too, logged at three times ``rate_hz``."""
    t = np.arange(round(3.0 * rate_hz * SECONDS) + 1) / (3.0 * rate_hz)
    data = np.column_stack([1.0 + 0.1 * np.sin(t * (0.5 + 0.05 * i) + i) for i in range(len(NAMES))])
    return FlightRecord(t, NAMES, data, "truth", provenance={"aircraft": "synthetic"})


@pytest.mark.parametrize("name", suite_names())
def test_suite(name: str) -> None:
    suite = load_suite(name)
    truth = flight(suite.rate_hz)
    record = suite.measure(truth, 1)
    assert suite.name == name
    assert suite.title
    assert record.kind == "measured"
    assert record.channels == suite.channels
    assert record.dt_s == pytest.approx(1.0 / suite.rate_hz, rel=1e-9)
    assert record.valid[0].all()
    assert record.provenance["truth"] == {"aircraft": "synthetic"}
    assert suite.measure(truth, 1).data.tobytes() == record.data.tobytes()
    for sensor, column in zip(suite.sensors, record.data.T, strict=True):
        exact = sensor.scale * sensor.feel({n: truth[n] for n in sensor.needs})[::3]
        # what is wrong with a sample: noise and drift (6 standard deviations, exceeded by one of 2000 samples with
        # probability 4e-6), bias, half a quantum, and the age of the value times the fastest slope, 0.1 rad/s times the
        # rates of its sines, twice as much where several channels meet; up to three values are lost in a row
        late = sensor.delay_s + abs(sensor.clock_offset_s) + 1e-6 * abs(sensor.clock_ppm) * SECONDS
        age = sensor.lag_s + late + (4.0 if sensor.dropout else 1.0) / (sensor.rate_hz or suite.rate_hz)
        drift = np.hypot(sensor.drift_std, sensor.bias_walk * np.sqrt(SECONDS))
        random = 6.0 * np.hypot(sensor.noise_std, drift)
        slope = np.abs(np.gradient(exact, 1.0 / suite.rate_hz)).max()
        bound = random + abs(sensor.bias) + 0.5 * sensor.quantum + 1.05 * slope * age
        assert np.abs(column - exact).max() <= bound
        noisy = sensor.noise_std > 0.0 or sensor.bias != 0.0 or sensor.quantum > 0.0
        assert noisy == bool(np.any(column != exact)), "a sensor with faults shows them"


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
    truth = flight(one.rate_hz)
    common = [n for n in one.channels if n in two.channels]
    assert {"V", "q", "theta"} <= set(common)
    a, b = one.measure(truth, 3), two.measure(truth, 3)
    assert a.columns(common).tobytes() == b.columns(common).tobytes()
    assert [s for s in one.sensors if s.channel in common] == [s for s in two.sensors if s.channel in common]


def test_gps_of_taurus_delivers_every_second_row() -> None:
    record = load_suite("taurus_8hz").measure(flight(8.0), 0)
    assert record.valid[:, record.channels.index("u")].tolist() == [i % 2 == 0 for i in range(len(record))]
