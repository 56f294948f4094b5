"""Suite files: units at the edge, noise densities, and every fault at once.

Kinds, recorders, drift, price and mass in suite files, there and back.
"""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from testbench.core.constants import DEG_RAD
from testbench.core.errors import RecordError, ScenarioError
from testbench.core.paths import SUITES, suite_names
from testbench.questions.files import json_schemas
from testbench.sensors import KINDS, load_suite, noise_std, suite_table, suite_toml
from testbench.sensors.suite import kind_rows

HEAD = 'title = "t"\nrate_hz = 100.0\n'


def write(folder: Path, text: str, name: str = "mine.toml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def entry(**keys: object) -> str:
    base: dict = {"channel": "q", "unit": "deg/s", "part": "a gyro", "source": "estimate"} | keys
    return "[[sensor]]\n" + "".join(f"{k} = {v!r}\n".replace("'", '"') for k, v in base.items() if v is not None)


def faults(folder: Path, text: str) -> list[str]:
    path = write(folder, text)
    with pytest.raises(ScenarioError) as caught:
        load_suite(path)
    assert all(fault.startswith(f"{path}, ") for fault in caught.value.faults)
    return [fault.removeprefix(f"{path}, ") for fault in caught.value.faults]


def test_units_are_converted_at_the_edge(tmp_path: Path) -> None:
    text = HEAD + entry(
        noise_std=0.5, bias=-1.0, quantum=0.1, scale=1.02, lag_s=0.1, delay_s=0.2, dropout=0.1, rate_hz=50.0
    )
    text += entry(channel="az", unit="g", noise_std=0.01, position_m=[0.1, 0, -0.2])
    made = load_suite(write(tmp_path, text))
    q, az = made.sensors
    assert (made.name, made.title, made.rate_hz) == ("mine", "t", 100.0)
    np.testing.assert_allclose([q.noise_std, q.bias, q.quantum], np.array([0.5, -1.0, 0.1]) * DEG_RAD, rtol=1e-15)
    assert (q.scale, q.lag_s, q.delay_s, q.dropout, q.rate_hz) == (1.02, 0.1, 0.2, 0.1, 50.0)
    assert az.noise_std == pytest.approx(0.0980665, rel=1e-12)
    assert az.position_m == (0.1, 0.0, -0.2)
    assert (q.part, q.source) == ("a gyro", "estimate")


def test_noise_density_becomes_the_noise_of_one_sample(tmp_path: Path) -> None:
    text = HEAD + entry(noise_density=0.005)
    text += entry(channel="p", noise_density=0.005, rate_hz=4.0) + entry(
        channel="r", noise_density=0.005, bandwidth_hz=20.0
    )
    got = [s.noise_std / DEG_RAD for s in load_suite(write(tmp_path, text)).sensors]
    # std = density sqrt(bandwidth): half of 100 Hz, half of its own 4 Hz, the filter's 20 Hz
    np.testing.assert_allclose(got, 0.005 * np.sqrt([50.0, 2.0, 20.0]), rtol=1e-14)


def test_noise_density_is_the_density_of_the_sampled_noise() -> None:
    # the one-sided density of white samples is 2 std^2 / rate. The mean of n / 2 independent periodogram bins, each
    # exponential, has relative standard deviation 1 / sqrt(n / 2); 5 of them: false alarm 6e-7
    rate, density, n = 100.0, 0.03, 40_000
    x = noise_std(density, rate) * np.random.default_rng(8).standard_normal(n)
    periodogram = 2.0 / (rate * n) * np.abs(np.fft.rfft(x)[1:-1]) ** 2
    assert abs(periodogram.mean() / density**2 - 1.0) < 5.0 / np.sqrt(n / 2)


def test_every_fault_is_reported_at_once_with_its_key(tmp_path: Path) -> None:
    text = 'title = "t"\nrate_hz = 8.0\nnmae = 1\n'
    text += entry(noise_std=-1.0, source=None)  # sensor[0]
    text += entry(channel="alfa", unit="deg")  # sensor[1]
    text += entry(channel="theta", unit="m/s", nois_std=1.0)  # sensor[2]
    text += entry(channel="u", unit="m/s", rate_hz=5.0, position_m=[1, 0, 0])  # sensor[3]
    text += entry(channel="q", noise_std=1.0, noise_density=1.0)  # sensor[4]: twice q, and two noises
    text += entry(channel="h", unit="m", bandwidth_hz=1.0)  # sensor[5]
    got = faults(tmp_path, text)
    keys = {fault.split(":")[0] for fault in got}
    assert keys == {
        "nmae",
        "sensor[0].noise_std",
        "sensor[0].source",
        "sensor[1].channel",
        "sensor[2].unit",
        "sensor[2].nois_std",
        "sensor[3].rate_hz",
        "sensor[3].position_m",
        "sensor[4].channel",
        "sensor[4].noise_density",
        "sensor[5].bandwidth_hz",
    }
    assert len(got) == len(keys)
    said = "\n".join(got)
    assert "did you mean 'alpha'" in said
    assert "did you mean 'noise_std'" in said
    assert "measured in rad or deg, got unit 'm/s'" in said
    assert "nearest valid: 4 Hz or 8 Hz" in said


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ('rate_hz = 10.0\n[[sensor]]\nchannel = "q"\nunit = "rad/s"\npart = "p"\nsource = "s"\n', "title"),
        (HEAD, "sensor"),
        (HEAD + "sensor = []\n", "sensor"),
        (HEAD + "sensor = 3\n", "sensor"),
        ('title = "t"\nrate_hz = "fast"\n' + entry(), "rate_hz"),
        (HEAD + entry(channel=3), "sensor[0].channel"),
        (HEAD + entry(rate_hz="fast"), "sensor[0].rate_hz"),
        (HEAD + entry(rate_hz=0.0), "sensor[0].rate_hz"),
        (HEAD + entry(rate_hz=-2.0), "sensor[0].rate_hz"),
        (HEAD + entry(position_m=[1, 2]), "sensor[0].position_m"),
    ],
)
def test_a_fault_of_form_names_its_key(tmp_path: Path, text: str, key: str) -> None:
    got = faults(tmp_path, text)
    assert len(got) == 1
    assert got[0].startswith(key)


def test_deeper_faults_are_found_beside_a_fault_of_the_head(tmp_path: Path) -> None:
    got = faults(tmp_path, 'title = "t"\nrate_hz = -1.0\n' + entry(channel="alfa", unit="deg"))
    assert {fault.split(":")[0] for fault in got} == {"rate_hz", "sensor[0].channel"}


def test_names_and_files() -> None:
    with pytest.raises(ScenarioError, match="got 'eolo_alfa'; did you mean 'eolo_alpha'"):
        load_suite("eolo_alfa")
    with pytest.raises(RecordError, match=r"nowhere\.toml"):
        load_suite("nowhere.toml")


def test_suite_table_lists_all_packaged_suites() -> None:
    names = [made.name for made in suite_table()]
    assert names == sorted(names)
    assert {"eolo_no_alpha", "eolo_alpha", "eolo_gap", "taurus_8hz"} <= set(names)


BOOM = "[recorder.boom]\nclock_offset_s = 0.02\nclock_ppm = 30.0\n"


def write_sensors(folder: Path, *sensors: str, head: str = HEAD) -> Path:
    path = folder / "mine.toml"
    parts = [f'[[sensor]]\npart = "a part"\nsource = "estimate"\n{s}\n' for s in sensors]
    path.write_text(head + "".join(parts), encoding="utf-8")
    return path


def test_figures_of_a_kind_are_read_in_their_units(tmp_path: Path) -> None:
    path = write_sensors(
        tmp_path,
        'channel = "de"\nunit = "deg"\nkind = "surface_position"\nplay_deg = 0.5\nbias_walk = 0.1\ndrift_std = 0.2\n'
        "bias_rate = -0.4\n"
        "drift_time_s = 9.0\nprice_eur = 60.0\nmass_g = 25.0",
        'channel = "psi"\nunit = "deg"\nkind = "magnetic_heading"\ndeviation_deg = [1, 2.0, 0.0, -1.0]',
        'channel = "alpha"\nunit = "deg"\nkind = "flow_vane"\nupwash = 1.1\nposition_m = [0.7, 0, 0]\n'
        'recorder = "boom"',
        'channel = "q"\nunit = "deg/s"\nkind = "rate_gyro"\ncross_axis = [0.01, 0.0, 0.02]\ncutoff_hz = 20.0',
        'channel = "motor_speed"\nunit = "rpm"\nkind = "motor_speed"\nquantum = 60.0',
        head=HEAD + BOOM,
    )
    de, psi, alpha, q, motor = load_suite(path).sensors
    assert [type(s) for s in (de, psi, alpha, q)] == [
        KINDS[k] for k in ("surface_position", "magnetic_heading", "flow_vane", "rate_gyro")
    ]
    found = [de.play, de.bias_walk, de.drift_std, de.bias_rate]  # type: ignore[attr-defined]
    np.testing.assert_allclose(found, np.array([0.5, 0.1, 0.2, -0.4]) * DEG_RAD, rtol=1e-14)
    assert (de.drift_time_s, de.price_eur, de.mass_g) == (9.0, 60.0, 25.0)
    np.testing.assert_allclose(psi.deviation, np.array([1, 2, 0, -1]) * DEG_RAD, rtol=1e-14)  # type: ignore[attr-defined]
    assert (alpha.clock_offset_s, alpha.clock_ppm, alpha.recorder) == (0.02, 30.0, "boom")
    assert q.lag_s == pytest.approx(1.0 / (2.0 * np.pi * 20.0))
    assert motor.quantum == pytest.approx(2.0 * np.pi)


def test_a_drift_and_the_place_of_a_pitot_survive_their_own_text(tmp_path: Path) -> None:
    path = write_sensors(
        tmp_path,
        'channel = "V"\nunit = "m/s"\nkind = "pitot"\nstatic_cp_beta2 = 0.7\nposition_m = [0.2, -1.5, 0.0]\n'
        "bias_rate = 0.02",
        head=HEAD,
    )
    suite = load_suite(path)
    again = tmp_path / "again.toml"
    again.write_text(suite_toml(suite), encoding="utf-8")
    assert load_suite(again).sensors == suite.sensors
    V = suite.sensors[0]
    assert (V.bias_rate, V.position_m) == (0.02, (0.2, -1.5, 0.0))
    assert V.static_cp_beta2 == 0.7  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", suite_names())
def test_a_suite_survives_its_own_text(name: str, tmp_path: Path) -> None:
    suite = load_suite(name)
    path = tmp_path / f"{name}.toml"
    path.write_text(suite_toml(suite), encoding="utf-8")
    again = load_suite(path)
    assert suite_toml(again) == suite_toml(suite)
    assert [type(s) for s in again.sensors] == [type(s) for s in suite.sensors]
    for a, b in zip(again.sensors, suite.sensors, strict=True):
        for key, value in vars(b).items():
            if isinstance(value, tuple):
                np.testing.assert_allclose(getattr(a, key), value, rtol=1e-14)
            else:
                assert getattr(a, key) == (pytest.approx(value, rel=1e-14) if isinstance(value, float) else value)


def test_every_fault_of_a_kind_is_reported_with_the_nearest_name(tmp_path: Path) -> None:
    path = write_sensors(
        tmp_path,
        'channel = "alpha"\nunit = "deg"\nkind = "flow_vain"',
        'channel = "beta"\nunit = "deg"\nkind = "flow_vane"\nup_wash = 1.1',
        'channel = "V"\nunit = "m/s"\nkind = "pitot"\nrecorder = "bom"',
        'channel = "q"\nunit = "deg/s"\nkind = "rate_gyro"\nlag_s = 0.1\ncutoff_hz = 5.0\ncross_axis = [0.1, 0.1, 0.1]',
        'channel = "p"\nunit = "deg/s"\nupwash = 1.0',
        head=HEAD + BOOM,
    )
    with pytest.raises(ScenarioError) as caught:
        load_suite(path)
    text = [fault.removeprefix(f"{path}, ") for fault in caught.value.faults]
    assert text == [
        "sensor[0].kind: unknown kind of sensor 'flow_vain'; did you mean 'flow_vane'?",
        "sensor[1].up_wash: unknown key 'up_wash'; did you mean 'upwash'?",
        "sensor[2].recorder: it must name a table [recorder.NAME] of the file, got 'bom'; did you mean 'boom'?",
        "sensor[3].cutoff_hz: give either lag_s or cutoff_hz (lag_s = 1 / (2 pi cutoff_hz)), got both",
        "sensor[3].cross_axis: the share of its own axis must be 0 (that is its scale), got 0.1",
        text[5],
    ]
    assert text[5].startswith("sensor[4].upwash: unknown key 'upwash'")


def test_editors_know_the_keys_of_every_kind() -> None:
    """What a schema refuses is refused in a file too, and the other way round."""
    known = json_schemas()["suite"]["properties"]["sensor"]["items"]
    assert known["additionalProperties"] is False
    assert known["properties"]["kind"]["enum"] == [*KINDS]
    for name, _, keys, words in kind_rows():
        assert words.endswith(".")
        assert {key for key in keys.split(", ") if key} <= set(known["properties"])
        assert {"flow_vane": "upwash", "attitude": "mounting_deg", "gps": ""}.get(name, keys) == keys
    for suite in suite_names():
        tables = tomllib.loads((SUITES / f"{suite}.toml").read_text(encoding="utf-8"))["sensor"]
        assert {key for table in tables for key in table} <= set(known["properties"])
