"""Values that no flight has are questioned with the unit that makes sense; flights are not."""

import numpy as np
import pytest
from recorded import flight_data, shared
from writers import short_period

from testbench.core.constants import DEG_RAD, G0_M_S2, PSF_PA
from testbench.core.errors import RecordError
from testbench.core.paths import SCENARIOS
from testbench.core.record import FlightRecord
from testbench.logs.plausible import implausible, questions_of, signals_of
from testbench.logs.read import read_records
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.importing.ask import import_log

T = np.arange(0.0, 30.0, 0.02)


def flight(seed: int = 1) -> dict[str, np.ndarray]:
    """A flight with noise of instruments, in SI units."""
    rng = np.random.default_rng(seed)
    q, theta, az = short_period(T)
    phi = 0.4 * np.sin(0.8 * T)
    clean = {
        "V": 22.0 + 0.5 * np.sin(0.3 * T), "alpha": 0.06 + 0.5 * (theta - 0.1), "beta": 0.02 * np.sin(T),
        "p": 0.32 * np.cos(0.8 * T), "q": q, "r": 0.05 * np.sin(0.8 * T), "phi": phi, "theta": theta,
        "psi": 3.0 + 0.05 * T, "ax": 0.5 + 0 * T, "ay": 0 * T, "az": az, "h": 300.0 + T, "qbar": 270.0 + 0 * T,
    }  # fmt: skip
    size = {"V": 0.2, "h": 0.5, "qbar": 5.0, "ax": 0.1, "ay": 0.1, "az": 0.1, "psi": 0.002}
    out = {name: x + size.get(name, 0.003) * rng.normal(size=T.size) for name, x in clean.items()}
    de = np.where((T > 5) & (T < 6), -0.06, np.where((T >= 6) & (T < 7), 0.06, 0.0))
    return {**out, "de": de, "da": 0 * T, "thr": 0.4 + 0 * T}


def asked(channels: dict[str, np.ndarray], t: np.ndarray = T) -> dict[str, tuple[str, str]]:
    found = implausible({name: (t, x) for name, x in channels.items()})
    return {question.channel: (question.got, question.unit) for question in found}


def test_small_angles_in_degrees_are_questioned_where_no_unit_is_stated():
    # 0.9 deg of elevator, read as 52 deg, is what an aircraft can have; that nobody said so counts against it
    held = {name: (T, x) for name, x in flight().items()}
    held |= {"de": (T, 0.9 * np.sign(np.sin(T))), "alpha": (T, 1.2 * np.sin(T))}
    assert not {"de", "alpha"} & {q.channel for q in implausible(held)}
    found = {q.channel: q.unit for q in implausible(held, unstated=["de", "alpha", "beta"])}
    assert {n: found[n] for n in ("de", "alpha")} == {"de": "deg", "alpha": "deg"}
    assert "beta" not in found


@pytest.mark.parametrize("seed", range(20))
def test_a_flight_raises_no_question(seed):
    assert asked(flight(seed)) == {}


@pytest.mark.parametrize("drop", [(), ("theta", "phi"), ("q", "p")])
@pytest.mark.parametrize(
    ("channel", "factor", "unit"),
    [
        ("alpha", 1.0 / DEG_RAD, "deg"),
        ("theta", 1.0 / DEG_RAD, "deg"),
        ("q", 1.0 / DEG_RAD, "deg/s"),
        ("de", 1.0 / DEG_RAD, "deg"),
        ("az", 1.0 / G0_M_S2, "g"),
        ("qbar", 1.0 / PSF_PA, "psf"),
        ("qbar", 0.01, "hPa"),
        ("thr", 100.0, "%"),
        ("h", 1000.0, ""),
        ("V", 200.0, ""),
    ],
)
def test_a_wrong_unit_is_questioned_with_the_right_one(channel, factor, unit, drop):
    channels = {name: x for name, x in flight().items() if name == channel or name not in drop}
    channels[channel] = factor * channels[channel]
    found = asked(channels)
    assert list(found) == [channel]
    assert found[channel][1] == unit


def test_a_rate_in_degrees_is_seen_beside_its_angle_even_where_it_is_small():
    channels = flight()
    gentle = {"q": 0.05 * channels["q"], "theta": 0.1 + 0.05 * (channels["theta"] - 0.1)}
    assert asked(gentle) == {}
    got, unit = asked({**gentle, "q": gentle["q"] / DEG_RAD})["q"]
    assert unit == "deg/s"
    assert "times the value from theta" in got
    assert asked({**gentle, "theta": gentle["theta"] / DEG_RAD})["theta"][1] == "deg"


@pytest.mark.parametrize(
    ("channel", "worst", "shown"),
    [("q", 1e5 * DEG_RAD, "1e+05 deg/s"), ("alpha", 400.0 * DEG_RAD, "400 deg"), ("V", 3000.0, "3e+03 m/s")],
)
def test_a_few_wild_samples_are_called_damaged(channel, worst, shown):
    channels = flight()
    channels[channel][700:703] = worst
    (question,) = implausible({name: (T, x) for name, x in channels.items()})
    assert question.got == f"{shown} in 3 of {T.size} samples"
    assert "damaged" in question.means
    assert question.unit == ""


def test_speeds_that_cannot_fly():
    channels = flight()
    assert asked({**channels, "V": 0.3 + 0.001 * channels["V"]})["V"][0].endswith("m/s while the aircraft moves")
    standing = {name: x for name, x in channels.items() if name in ("V", "de")}
    rng = np.random.default_rng(2)
    for name in ("p", "q", "r"):
        standing[name] = 0.002 * rng.normal(size=T.size)
    assert asked({**standing, "V": 0.5 + 0.05 * rng.normal(size=T.size)}) == {}  # on the ground with wind


def test_a_page_of_zeros_and_a_sensor_that_sticks_are_found_and_rest_is_not():
    channels = flight()
    channels["az"][600:640] = 0.0
    got = asked(channels)
    assert list(got) == ["az"]
    assert got["az"][0] == "0 m/s2 from 12 to 12.78 s, in 40 samples without any change"
    channels = flight()
    channels["V"][600:800] = 25.0
    assert list(asked(channels)) == ["V"]
    channels["V"][:] = 22.0
    assert asked(channels)["V"][0] == "22 m/s throughout"
    coarse = {name: np.round(x, 2) for name, x in flight().items()}  # hundredths: values repeat
    coarse["q"][:200] = 0.0  # at rest before the flight
    assert asked(coarse) == {}
    stepped = {"de": flight()["de"], "V": np.repeat(flight()["V"][::50], 50)}  # held between slow samples
    assert asked(stepped) == {}


@pytest.mark.parametrize(("scale", "unit"), [(1e6, "us"), (1e3, "ms"), (1e9, "ns")])
def test_times_in_another_unit(scale, unit):
    assert asked({"q": flight()["q"]}, scale * T)["t"][1] == unit


def test_acceleration_that_counts_upwards():
    channels = flight()
    assert "level flight" in asked({**channels, "az": -channels["az"]})["az"][0]


def test_real_records_raise_no_question():
    folder = flight_data()
    described = sorted((SCENARIOS / "records").glob("*.toml"))
    assert len(described) == 4
    for path in described:
        for name, _, record in read_records(RecordDescription.load(path)):
            assert implausible(signals_of(record)) == (), f"{path.name} {name}"
    for name in ("twin_otter/totter_lon_020213f1_018.mat", "hfb320/hfb320_1_10_withHeader.asc"):
        assert import_log(folder / name).asked == (), name


@pytest.mark.parametrize("path", [p for p in shared("logs") if p.suffix == ".ulg"], ids=lambda p: p.stem)
def test_public_logs_raise_no_question(path):
    pytest.importorskip("pyulog", reason="needs the extra logs: pip install flight-testbench[logs]")
    assert import_log(path).asked == ()


def test_a_question_of_several_records_is_asked_once_and_strict_refuses(tmp_path):
    channels = flight()
    channels["alpha"] /= DEG_RAD
    record = FlightRecord(T, tuple(channels), np.column_stack(list(channels.values())), "measured")
    right = FlightRecord(T, ("q",), flight()["q"][:, None], "measured")
    file = tmp_path / "d.toml"
    (said,) = questions_of([("a", record), ("b", right), ("c", record)], file)
    assert said.startswith("in record 'a' (and in c), alpha: ")
    assert said.endswith(f"set unit = \"deg\" of channel alpha in '{file}'")
    with pytest.raises(RecordError, match=r"must be plausible \(strict\), got one that is not"):
        questions_of([("a", record)], file, strict=True)
    assert questions_of([("b", right)], file, strict=True) == ()


def test_samples_that_were_not_taken_do_not_count():
    x = flight()["alpha"].copy()
    valid = np.ones((T.size, 1), bool)
    x[500:600], valid[500:600] = x[499], False
    assert implausible(signals_of(FlightRecord(T, ("alpha",), x[:, None], "measured", valid))) == ()
