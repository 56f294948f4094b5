"""The recorded flight through an aircraft: what flew it leaves no miss, whatever was measured and wherever it began."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from changed_flights import flown, steps

import testbench as tb
from testbench.estimators.prepare import prepare
from testbench.questions.identify.amend.ask import _without_servos, replays
from testbench.questions.identify.amend.folder import with_key

V, H = 15.0, 100.0
CONDITION = tb.FlightCondition(V, H)
OUTPUTS = ("V", "alpha", "q", "theta", "az")


def case_of(record, inputs, outputs=OUTPUTS, lever=(0.0, 0.0), held=False):
    model = SimpleNamespace(inputs=inputs, outputs=outputs, held=(held,) * len(inputs), values={})
    estimator = SimpleNamespace(accelerometer_m=lever, servo={}, delays_s={})
    return SimpleNamespace(identification=(record,), validation=(), model=model, estimator=estimator)


@pytest.fixture(scope="module")
def taurus():
    return tb.load_aircraft("taurus")


@pytest.fixture(scope="module")
def record(taurus):
    measured = replace(flown(taurus, V, H, {"de": steps(1.0, 0.3, 1.0)}, 6.0), kind="measured")
    return prepare(measured, bias="trim", trim_s=0.9)


def misses(record, case, aircraft):
    (replay,) = replays(case, [("flight", "identification")], aircraft, aircraft, CONDITION)
    assert replay.notes == ()
    size = np.std(replay.measured, axis=0)
    return np.sqrt(np.mean((replay.measured - replay.before) ** 2, axis=0)) / size


@pytest.mark.parametrize(("inputs", "held"), [(("de",), False), (("de_cmd",), True)])
def test_what_flew_the_record_follows_it(taurus, record, inputs, held):
    assert misses(record, case_of(record, inputs, held=held), taurus).max() < 0.02


def test_a_surface_taken_for_its_command_would_pass_the_servo_twice(taurus, record):
    twice = record.with_columns({"de_cmd": record["de"]})
    right = misses(record, case_of(record, ("de",)), taurus)
    assert misses(twice, case_of(twice, ("de_cmd",)), taurus)[2] > 10.0 * right[2]


def test_a_record_that_begins_in_mid_manoeuvre_is_followed(taurus, record):
    later = record.between(1.5, np.inf)
    assert misses(later, case_of(later, ("de",)), taurus).max() < 0.05


def test_constants_of_inputs_and_outputs_are_no_miss(taurus, record):
    shifted = record.with_columns({"de": record["de"] + 0.004, "q": record["q"] + 0.02, "V": record["V"] - 15.0})
    assert misses(shifted, case_of(shifted, ("de",)), taurus).max() < 0.05


def test_a_record_whose_equilibrium_nobody_removed_is_followed(taurus):
    raw = replace(flown(taurus, V, H, {"de": steps(1.0, 0.3, 1.0)}, 6.0), kind="measured")
    raw = prepare(raw, bias="none", trim_s=0.0)
    assert misses(raw, case_of(raw, ("de",)), taurus).max() < 0.05


def test_an_accelerometer_away_from_the_centre_of_gravity_feels_the_rotation(taurus, record):
    off = record.with_columns({"az": record["az"] - 0.3 * record["qdot"]})
    assert misses(off, case_of(off, ("de",), lever=(0.3, 0.0)), taurus)[4] < 0.02
    assert misses(off, case_of(off, ("de",)), taurus)[4] > 0.05


def test_an_aircraft_that_cannot_be_flown_there_is_said(taurus, record):
    slow = tb.FlightCondition(2.0, H)
    (replay,) = replays(case_of(record, ("de",)), [("flight", "identification")], taurus, taurus, slow)
    assert replay.before is None
    assert "cannot be flown there" in replay.notes[0]


@pytest.mark.parametrize(
    ("text", "table", "expected"),
    [
        ('model = "a.xml"\n[adapter]\nmodel = 1\n', "", 'model = "b"\n[adapter]\nmodel = 1\n'),
        ("x = 1\n[controls.de] # elevator\nthrow = 2\n[a]\n", "controls.de",
         'x = 1\n[controls.de] # elevator\nmodel = "b"\nthrow = 2\n[a]\n'),
        ("[uncertainty]\nmodel=3 # judged\n", "uncertainty", '[uncertainty]\nmodel = "b"\n'),
    ],
)  # fmt: skip
def test_a_key_of_a_file_gets_another_value_and_the_rest_stays(text, table, expected):
    assert with_key(text, table, "model", '"b"') == expected


def test_measured_surfaces_fly_without_the_control_law_that_moved_them():
    f16 = tb.load_aircraft("jsbsim:f16")
    assert f16.under_law
    assert not _without_servos(f16, ["da", "dr"]).under_law
    assert _without_servos(f16, []).under_law == f16.under_law, "commands were logged"
