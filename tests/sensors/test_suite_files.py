"""Kinds, recorders, drift, price and mass in suite files, there and back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from testbench.core.constants import DEG_RAD
from testbench.core.errors import ScenarioError
from testbench.core.paths import suite_names
from testbench.sensors import KINDS, load_suite, suite_toml

HEAD = 'title = "t"\nrate_hz = 100.0\n'
BOOM = "[recorder.boom]\nclock_offset_s = 0.02\nclock_ppm = 30.0\n"


def write(folder: Path, *sensors: str, head: str = HEAD) -> Path:
    path = folder / "mine.toml"
    parts = [f'[[sensor]]\npart = "a part"\nsource = "estimate"\n{s}\n' for s in sensors]
    path.write_text(head + "".join(parts), encoding="utf-8")
    return path


def test_figures_of_a_kind_are_read_in_their_units(tmp_path: Path) -> None:
    path = write(
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
    path = write(
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
    path = write(
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
