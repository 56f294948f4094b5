"""Several equal sensors in one log: the best is read, or the one asked for, and the choice is said."""

import numpy as np
import pytest

from testbench.core.errors import RecordError
from testbench.logs.signals import Log, Rule, Topic, find_channels, scaled

T = np.arange(0.0, 20.0, 0.01)
RULES = tuple(Rule(n, "IMU", (c,), scaled(1.0), "") for n, c in (("p", "GyrX"), ("q", "GyrY"), ("az", "AccZ")))


def unit(number: int, seed: int = 0, **columns) -> Topic:
    """A healthy inertial unit of one flight, with its own noise and bias, but for the columns given."""
    rng = np.random.default_rng(seed + number)
    data = {
        "GyrX": 0.01 * rng.normal(size=T.size),
        "GyrY": 0.2 * np.sin(2.0 * T) + 0.01 * rng.normal(size=T.size) + 0.02 * number,
        "AccZ": -9.81 + 2.0 * np.sin(2.0 * T) + 0.1 * rng.normal(size=T.size) + 0.3 * number,
        "GH": np.ones(T.size),
        "AH": np.ones(T.size),
    }
    data.update({name: np.broadcast_to(np.asarray(x, float), T.shape) for name, x in columns.items()})
    return Topic(f"IMU#{number}" if number else "IMU", T, data)


def log_of(tmp_path, *units: Topic) -> Log:
    return Log(tmp_path / "f.bin", "test", {topic.name: topic for topic in units})


DEAD = {"GyrX": 0.0, "GyrY": 0.0, "AccZ": 0.0, "GH": 0.0, "AH": 0.0}
WILD = {"GyrY": 5.0 * np.sin(37.0 * T)}
SHORT = slice(0, 600)


def cut(topic: Topic) -> Topic:
    return Topic(topic.name, topic.t_s[SHORT], {name: column[SHORT] for name, column in topic.columns.items()})


@pytest.mark.parametrize(
    ("units", "taken", "why"),
    [
        ((unit(0), unit(1)), "IMU", ""),
        ((unit(0, **DEAD), unit(1)), "IMU#1", "IMU: zero throughout, GH is 0, not 1"),
        ((unit(0, GyrX=0.1, GyrY=0.1, AccZ=-9.8), unit(1)), "IMU#1", "IMU: constant throughout"),
        ((unit(0, AH=0.0), unit(1)), "IMU#1", "IMU: AH is 0, not 1"),
        ((unit(0, GyrY=np.nan, GyrX=np.nan, AccZ=np.nan), unit(1)), "IMU#1", "IMU: no numbers"),
        ((cut(unit(0)), unit(1)), "IMU#1", "IMU: 5.99 s of 20 s logged"),
        ((unit(0, **WILD), unit(1), unit(2)), "IMU#1", "IMU: differs from the others by"),
        ((unit(0), unit(1), unit(2)), "IMU", ""),
        ((unit(0, **DEAD), unit(1, AH=0.0), unit(2)), "IMU#2", "IMU#1: AH is 0"),
        ((unit(0, **DEAD), unit(1, AH=0.0)), "IMU#1", "IMU: zero throughout"),  # hurt beats dead
        ((unit(1),), "IMU#1", ""),
    ],
)
def test_the_best_unit_is_read_for_all_its_channels(tmp_path, units, taken, why):
    found = find_channels(log_of(tmp_path, *units), RULES)
    assert {c.source.split(".")[0] for c in found.channels} == {taken}
    assert [c.name for c in found.channels] == ["p", "q", "az"]
    said = "; ".join(choice.said for choice in found.choices)
    assert why in said
    assert (taken + " is read" in said) == (len(units) > 1)
    others = {topic.name for topic in units} - {taken}
    assert {p.source.split(".")[0] for p in found.passed} == others
    assert all(taken + " is read instead" in p.reason and "--imu" in p.reason for p in found.passed)


def test_the_unit_asked_for_is_read_even_if_it_is_worse(tmp_path):
    found = find_channels(log_of(tmp_path, unit(0), unit(1, AH=0.0)), RULES, sensors={"imu": 1})
    assert {c.source.split(".")[0] for c in found.channels} == {"IMU#1"}
    assert found.choices[0].said == "imu: IMU#1 is read, as asked, of IMU, IMU#1 (IMU#1: AH is 0, not 1)"


@pytest.mark.parametrize(
    ("second", "differs"),
    [
        (unit(1), ""),
        (unit(1, seed=5), ""),
        (unit(1, GyrY=0.2 * np.sin(2.0 * T) * 57.3), "GyrY"),
        (unit(1, GyrY=-0.2 * np.sin(2.0 * T)), "GyrY"),
        (unit(1, AccZ=-1.0 + 0.2 * np.sin(2.0 * T)), "AccZ"),
        (unit(1, GyrY=0.2 * np.sin(2.0 * (T - 0.3))), "GyrY"),
        (unit(1, AH=0.0, GyrY=9.0 * np.sin(2.0 * T)), ""),  # it is unhealthy, and that is said
    ],
)
def test_of_two_healthy_units_that_disagree_one_is_doubted(tmp_path, second, differs):
    found = find_channels(log_of(tmp_path, unit(0), second), RULES)
    doubt = found.choices[0].doubt
    assert (f"IMU and IMU#1 differ in {differs} by" in doubt) if differs else doubt == ""


@pytest.mark.parametrize(
    ("sensors", "law"),
    [
        ({"imu": 2}, r"instance of imu .* got 2; it holds 0, 1"),
        ({"gps": 0}, r"instance of gps .* got 0; it holds none"),
        ({"radar": 0}, r"one of imu, airspeed, gps, baro, ekf, got 'radar'"),
    ],
)
def test_a_unit_that_is_not_there_is_refused(tmp_path, sensors, law):
    with pytest.raises(RecordError, match=law):
        find_channels(log_of(tmp_path, unit(0), unit(1)), RULES, sensors=sensors)


def test_receivers_without_a_fix_and_lanes_of_a_filter(tmp_path):
    speed = 20.0 + np.sin(T)
    topics = {
        "GPS": Topic("GPS", T, {"Spd": speed, "Status": np.ones(T.size)}),
        "GPS#1": Topic("GPS#1", T, {"Spd": speed, "Status": np.full(T.size, 4.0)}),
        "XKF1": Topic("XKF1", T, {"PN": np.zeros(T.size)}),
        "XKF1#1": Topic("XKF1#1", T, {"PN": 20.0 * T}),
    }
    rules = (Rule("Vg", "GPS", ("Spd",), scaled(1.0), ""), Rule("north", "XKF1", ("PN",), scaled(1.0), ""))
    found = find_channels(Log(tmp_path / "f.bin", "test", topics), rules)
    assert [c.source for c in found.channels] == ["GPS#1.Spd", "XKF1#1.PN"]
    assert "gps: GPS#1 is read, the best of GPS, GPS#1 (GPS: Status is 1, not 3)" in [c.said for c in found.choices]
    again = find_channels(Log(tmp_path / "f.bin", "test", topics), rules, sensors={"gps": 0})
    assert again.channels[0].source == "GPS.Spd"
