"""Commands of a log that move on between its samples: a stick is no number that is sent once for each of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from axes import believe

from testbench.core.record import FlightRecord
from testbench.effects import EFFECTS
from testbench.flight import Manoeuvre, fly, trim
from testbench.inputs.signal import InputSignal
from testbench.questions.gap.drive import drive_records
from testbench.questions.gap.evidence.commanded import BETWEEN, between_samples, moves_on
from testbench.questions.gap.workflow import GapSearch, find_gap

RATE_HZ = 25.0
T_S = np.arange(250) / RATE_HZ
STICK = 0.04 * np.sin(2.0 * np.pi * 0.7 * (T_S - 1.0)) * np.sin(np.pi * np.clip((T_S - 1.0) / 7.0, 0.0, 1.0)) ** 2
DOUBLET = 0.04 * ((T_S > 1.0) & (T_S < 2.0)) - 0.04 * ((T_S >= 2.0) & (T_S < 3.0))
STAIRS = np.repeat(STICK[::5], 5)  # sent five times a second
PULSE = 0.04 * (np.abs(T_S - 2.0) < 0.05)  # three samples


def record(de: np.ndarray) -> FlightRecord:
    return FlightRecord(t_s=T_S, channels=("de_cmd",), data=de[:, None], kind="measured")


@pytest.mark.parametrize(("command", "on"), [(STICK, True), (DOUBLET, False), (STAIRS, False), (PULSE, False)])
def test_what_goes_step_by_step_moves_on_and_what_jumps_is_held(command, on):
    said = between_samples(record(command))
    assert list(said.provenance.get(BETWEEN, ())) == (["de"] if on else [])
    assert np.all(moves_on(said, "de", command) == on)


def test_a_jump_of_a_stick_that_moves_is_one():
    """Taken in with a switch, say: only the samples beside it move on."""
    command = STICK + 0.2 * (T_S > 5.0)
    said = between_samples(record(command))
    (jump,) = np.flatnonzero(~moves_on(said, "de", command))
    assert T_S[jump] <= 5.0 < T_S[jump + 1]


def test_records_that_no_log_holds_are_as_they_were():
    """What the testbench measures says what was held; a record that was read once is not read again."""
    suite = believe().suite
    plain = {"a": record(STICK)}
    assert drive_records(suite, plain)["a"] is plain["a"]
    imported = {"a": replace(record(STICK), provenance={"sha256": "0"})}
    read = drive_records(suite, imported)
    assert read["a"].provenance[BETWEEN] == ["de"]
    assert drive_records(suite, read)["a"] is read["a"]


def test_a_slow_servo_behind_a_stick_has_its_own_lag():
    """Held from sample to sample, 20 ms late in the mean, it was 12.1 +- 0.7 rad/s for 8, and refuted.

    Two errors of four standard errors are exceeded once in 16 000 cases.
    """
    believed = believe()
    believed = replace(believed, suite=replace(believed.suite, rate_hz=RATE_HZ))
    slow = believed.with_effect(EFFECTS["actuator_lag"], {"lag_rad_s": 8.0}).aircraft
    trimmed = trim(slow, believed.condition, believed.rate_hz)
    t = np.arange(round(10.0 * believed.rate_hz)) / believed.rate_hz
    moves = np.where((t > 1.0) & (t < 7.0), np.sin(np.pi * np.clip((t - 1.0) / 6.0, 0.0, 1.0)), 0.0)
    records = {}
    for i, faster in enumerate((1.0, 2.0, 3.0)):
        stick = 0.04 * moves * np.sin(2.0 * np.pi * (0.8 * (t - 1.0) + faster * (t - 1.0) ** 2 / 12.0))
        truth = fly(slow, trimmed, Manoeuvre("stick", InputSignal(t, stick[:, None], ("de",)), 0.0), RATE_HZ)
        log = believed.suite.measure(truth, 10 + i)
        records[str(i)] = replace(log, provenance={**log.provenance, "sha256": str(i)})
    held_out = {"2": records.pop("2")}
    found = find_gap(believed, records, held_out, GapSearch(effects={"actuator_lag": EFFECTS["actuator_lag"]}))
    assert found.naming.names == ("actuator_lag",)
    fit = found.naming.best
    assert abs(fit.values["lag_rad_s"] - 8.0) < 4.0 * fit.errors["lag_rad_s"]
    assert fit.errors["lag_rad_s"] < 0.8  # the form of a lag is uncertain by 2 %
