"""A simulated flight, written as PX4's and ArduPilot's logs, imported and identified as a user would.

Truth is the aircraft linearised where it flew. The study of many seeds: tests/studies/autopilot_logs.py.
"""

import numpy as np
import pytest
from flown_logs import IMU_M, LEAD_S, LOGS, PIECES, THROWS, fly, truth
from scipy.stats import binom

from testbench.estimators.structured import Servo
from testbench.questions.identify.ask import identify
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.importing.ask import import_log, write_import


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder, flown = tmp_path_factory.mktemp("flown"), fly(0)
    out = {}
    for kind, (name, make) in LOGS.items():
        (folder / name).write_bytes(make(0, flown))
        out[kind] = folder / name
    return flown, out


@pytest.mark.parametrize("kind", LOGS)
def test_the_log_of_a_flight_holds_what_was_flown(logs, kind):
    flown, paths = logs
    found = import_log(paths[kind], throw_rad=THROWS)
    assert found.rate_hz == 50.0
    assert found.log.warnings == ()
    assert [m.controls for m in found.search.manoeuvres] == [tuple(f"{c}_cmd" for c in p.steps) for p in PIECES]
    assert all(m.cut_s is not None for m in found.search.manoeuvres)
    az = next(c for c in found.channels if c.name == "az")
    assert "0.04, 0, -0.01 m forward, right, down" in az.said
    assert az.assumed == ""
    t0 = found.record.provenance["clock_zero_s"] - 12.5
    for name in ("de", "da", "dr"):
        x, piece = found.record[f"{name}_cmd"], flown[0]
        k = np.flatnonzero((found.record.t_s + t0 > piece.loop_s[0]) & (found.record.t_s + t0 < piece.loop_s[-1] - 0.1))
        asked = np.interp(found.record.t_s[k] + t0, piece.loop_s, piece.commands[name])
        assert np.max(np.abs(np.mean(x[k] - asked))) < 2e-4
    assert found.log.imu_m[0] == pytest.approx(IMU_M)


@pytest.mark.parametrize("kind", LOGS)
def test_the_delay_of_the_autopilots_own_filters_is_taken_out(logs, kind):
    """A Butterworth low pass of second order is late by sqrt(2) / (2 pi f): 5.6 ms at 40 Hz, 11.3 ms at 20 Hz."""
    flown, paths = logs
    found = import_log(paths[kind], throw_rad=THROWS)
    late = np.sqrt(2.0) / (2.0 * np.pi * (40.0 if kind == "px4" else 20.0))
    p = next(c for c in found.channels if c.name == "p")
    assert f"taken {1e3 * late:.1f} ms earlier" in p.said
    piece = flown[4]
    begins = found.record.t_s + found.record.provenance["clock_zero_s"] - 12.5
    moving = (begins > piece.t_s[0] + LEAD_S) & (begins < piece.t_s[0] + LEAD_S + 1.5)
    shifts = np.arange(-20e-3, 21e-3, 1e-3)
    misses = [
        np.std(found.record["p"][moving] - np.interp(begins[moving] - s, piece.t_s, piece.x["p"])) for s in shifts
    ]
    assert abs(shifts[int(np.argmin(misses))]) <= 2e-3


def test_the_servo_that_an_aircraft_states_is_what_is_believed_of_an_estimated_lag(logs):
    written = write_import(import_log(logs[1]["px4"], throw_rad=THROWS), logs[1]["px4"].parent / "believed")
    asked = RecordDescription.load(next(p for p in written if p.stem.endswith("lateral")))
    servos = {"da_cmd": Servo(lag_s=0.03, rate_limit_deg_s=150.0)}
    entry = asked.asked_of(servos).estimators[0]
    assert entry.start == {"tau_da": 0.03, "tau_dr": 0.05}
    assert entry.prior_std == pytest.approx({"tau_da": 0.006, "tau_dr": 0.03})
    assert entry.servo["da_cmd"].lag_s == entry.servo["da_cmd"].delay_s == "estimate"
    assert asked.believes(servos) == ("da_cmd",)


def test_the_libraries_read_the_logs_back(logs):
    pyulog, reader = pytest.importorskip("pyulog"), pytest.importorskip("pymavlink.DFReader")
    flown, paths = logs
    theirs = pyulog.ULog(str(paths["px4"]))
    ours = import_log(paths["px4"]).log.topics
    for data in theirs.data_list:
        if data.name in ours:
            column = next(iter(ours[data.name].columns))
            np.testing.assert_array_equal(ours[data.name].columns[column], data.data[column])
    assert theirs.initial_parameters["EKF2_IMU_POS_X"] == pytest.approx(IMU_M[0])
    log = reader.DFReader_binary(str(paths["ardupilot"]), zero_time_base=True)
    pulses = []
    while (message := log.recv_match(type=["RCOU"], strict=True)) is not None:
        pulses.append(message.C2)
    log.close()
    np.testing.assert_array_equal(import_log(paths["ardupilot"]).log.topics["RCOU"].columns["C2"], pulses)
    assert len(pulses) == sum(f.loop_s.size for f in flown)


def errors_of(path, axis: str) -> dict[str, float]:
    """Return derivative -> error in its standard errors."""
    written = write_import(import_log(path, throw_rad=THROWS), path.parent / path.suffix[1:])
    result = identify(RecordDescription.load(next(p for p in written if p.stem.endswith(axis))))
    known = truth()
    assert result.cases[0].model.status != "wrong"
    return {d.name: (d.value - known[d.name]) / d.std for d in result.derivatives if d.name in known}


@pytest.mark.slow
def test_derivatives_of_one_flight_hold_the_truth(logs):
    """False-alarm probability of 5 errors, for 7 normal estimates: 4e-6; the seed is fixed."""
    off = errors_of(logs[1]["px4"], "longitudinal")
    assert {"Z_alpha", "Z_q", "Z_de", "M_alpha", "M_q", "M_de", "tau_de"} <= off.keys()
    assert max(abs(z) for z in off.values()) < 5.0, off


@pytest.mark.slow
@pytest.mark.parametrize("kind", LOGS)
def test_intervals_of_twelve_flights_hold_the_truth(tmp_path, kind):
    """Pitch alone: 7 derivatives that must be held in 8 of 12 flights.

    False-alarm probability at a coverage of 0.95: 2e-4 for each, 1.3e-3 together if they were independent. A coverage
    of 0.8 passes mostly: this finds gross faults. Coverage itself is measured by the study.
    """
    name, make = LOGS[kind]
    held: dict[str, list[bool]] = {}
    for seed in range(12):
        path = tmp_path / f"{seed}" / name
        path.parent.mkdir()
        path.write_bytes(make(seed))
        for derivative, z in errors_of(path, "longitudinal").items():
            held.setdefault(derivative, []).append(abs(z) < 1.96)
    least = int(binom.ppf(1e-3, 12, 0.95))
    assert all(sum(found) >= least for found in held.values()), held
