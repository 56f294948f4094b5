"""The gap workflow on real flights of aileron and rudder: 30 s each, with a sideslip that was read late.

Values as in real_aircraft.py. As a real record is no draw from a known distribution, what these tests assert was
measured once.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from real_aircraft import (
    ATTAS_H,
    ATTAS_LATE_S,
    ATTAS_LATERAL,
    ATTAS_SIDE,
    ATTAS_V,
    attas,
    attas_lateral_record,
    believe,
    quiet_noise,
    side_force,
)
from recorded import flight_data

from testbench.aircraft import Amendment, SetProperty
from testbench.aircraft.seams import control_path
from testbench.flight import FlightCondition, linearise, trim
from testbench.questions.gap.evidence.check import check_instruments
from testbench.questions.gap.workflow import GapSearch, find_gap

RECORDS = ("1 aileron", "1 rudder", "2 aileron", "2 rudder")
COEFFICIENTS = {"Lp": "Cl_p", "Lda": "Cl_da", "Lb": "Cl_beta", "Nb": "Cn_beta", "Ndr": "Cn_dr", "Nr": "Cn_r"}
# What the first two records ask for beside an unknown motion, as multiples of what is printed, and the standard error:
# what is left is far from white, and the motion that no coefficient explains is a tenth of what flies.
MEASURED = {
    "Lp": (1.15, 0.04),
    "Lda": (1.03, 0.03),
    "Lb": (1.05, 0.03),
    "Nb": (0.957, 0.008),
    "Ndr": (0.93, 0.03),
    "Nr": (0.60, 0.13),
}


def fly(folder, factors=None, names=RECORDS, effects=None, late_s=ATTAS_LATE_S):
    """Return what the workflow finds in the first two of ``names``, the others held out."""
    data = flight_data()
    records = {n: attas_lateral_record(data, n) for n in names}
    used = {n: records.pop(n) for n in names[:2]}
    aircraft, (first, *_) = attas(folder / "attas", factors), used.values()
    believed = believe(aircraft, first, quiet_noise(list(used.values())), ATTAS_V, ATTAS_H, {"beta": late_s})
    return find_gap(believed, used, records, GapSearch(effects=effects, noise="stated"))


def test_the_aircraft_has_the_derivatives_that_are_believed(tmp_path):
    aircraft = attas(tmp_path / "attas")
    model = linearise(aircraft, trim(aircraft, FlightCondition(ATTAS_V, ATTAS_H)))
    for letter, rate in (("L", "p"), ("N", "r")):
        row = model.states.index(rate)
        for short, state in (("b", "v"), ("p", "p"), ("r", "r")):
            per = ATTAS_V if state == "v" else 1.0
            flown = model.A[row, model.states.index(state)] * per
            assert flown == pytest.approx(ATTAS_LATERAL[letter + short], rel=0.003), letter + short
        for control in ("da", "dr"):
            flown = model.B[row, model.inputs.index(control)]
            assert flown == pytest.approx(ATTAS_LATERAL[letter + control], rel=0.003), letter + control


def test_side_force_is_what_one_record_says():
    assert side_force(attas_lateral_record(flight_data(), "1 rudder")) == pytest.approx(ATTAS_SIDE, rel=0.01)


@pytest.mark.parametrize("name", [RECORDS[0], *(pytest.param(n, marks=pytest.mark.slow) for n in RECORDS[1:])])
def test_kinematics_say_the_same_of_the_instruments_in_each_record(tmp_path, name):
    """Without any aerodynamics: the attitude lags behind gyros and accelerometers by a tenth of a second."""
    record = attas_lateral_record(flight_data(), name, everything=True)
    believed = believe(attas(tmp_path / "attas"), record, quiet_noise([record]), ATTAS_V, ATTAS_H)
    found = check_instruments(believed.suite, [record])
    assert found.fault.name == "theta_lag"
    assert found.fault.estimate == pytest.approx(0.1, abs=0.015)


@pytest.mark.slow
@pytest.mark.parametrize("effects", [{}, None], ids=["no effect", "whole library"])
def test_no_derivative_is_accused_where_the_late_sideslip_is_known(tmp_path, effects):
    found = fly(tmp_path, effects=effects)
    assert found.naming.outcome in ("unexplained", "partial")
    assert found.naming.coefficients == ()
    check_measured(found, {})


def check_measured(found, factors):
    """Each coefficient is what the records ask for, whatever is believed of it and of the others."""
    for printed, measured in MEASURED.items():
        value, error = found.naming.measured[COEFFICIENTS[printed]]
        factor = factors.get(printed, 1.0)
        assert value * factor == pytest.approx(measured[0], abs=2.0 * measured[1]), printed
        assert error * factor == pytest.approx(measured[1], rel=0.5), printed


@pytest.mark.slow
def test_surfaces_drive_a_model_whose_servos_are_none_of_the_aircraft_s(tmp_path):
    """What was recorded are surfaces. As commands of servos of 12 rad/s they leave 14 times as much,

    in units of noise that is estimated beside them."""
    data, aircraft = flight_data(), attas(tmp_path / "attas")
    paths = [control_path(aircraft, c) for c in ("da", "dr")]
    changes = [SetProperty(str(n), v) for p in paths for n, v in ((p.lag, 12.0), (p.rate_limit, 0.5))]
    slow = aircraft.amended(Amendment("servos", "servos that the aircraft does not have", tuple(changes)))
    by_command = {n: attas_lateral_record(data, n) for n in RECORDS}
    names = {"da_cmd": "da", "dr_cmd": "dr"}
    by_surface = {n: replace(r, channels=tuple(names.get(c, c) for c in r.channels)) for n, r in by_command.items()}
    noise = quiet_noise([by_command[n] for n in RECORDS[:2]]) | {"da": 1e-4, "dr": 1e-4}
    left = {}
    for what, records in (("command", by_command), ("surface", by_surface)):
        used, held = ({n: records[n] for n in some} for some in (RECORDS[:2], RECORDS[2:]))
        believed = believe(slow, used[RECORDS[0]], noise, ATTAS_V, ATTAS_H, {"beta": ATTAS_LATE_S})
        found = find_gap(believed, used, held, GapSearch(effects={}, noise="stated"))
        left[what] = found.naming.chi2_tuned
        assert found.naming.outcome in ("unexplained", "partial")
    assert ["is not recorded" in p.why for p in found.paths] == [True, True]
    assert left["command"] > 10.0 * left["surface"]
    for printed, (factor, other) in MEASURED.items():
        value, error = found.naming.measured[COEFFICIENTS[printed]]
        assert abs(value - factor) < 2.0 * np.hypot(error, other), printed


@pytest.mark.slow
def test_yaw_damping_is_accused_where_the_late_sideslip_is_not_known(tmp_path):
    """As printed Nr is what late sideslip makes of it: 2.7 times what flies, and the record says so."""
    printed = {"Nr": -0.4856 / ATTAS_LATERAL["Nr"], "Lr": 1.0293 / ATTAS_LATERAL["Lr"]}
    found = fly(tmp_path, printed, effects={}, late_s=0.0)
    assert "Cn_r" in found.sentences[0]
    assert "Cn_r" in found.naming.off
    value, error = found.naming.measured["Cn_r"]
    assert value + 2.0 * error < 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("printed", "factor"), [*((n, f) for n in ("Lp", "Lda", "Nb", "Ndr") for f in (0.7, 1.4)), ("Lb", 0.6), ("Nr", 2.0)]
)
def test_a_falsified_lateral_derivative_is_found_and_no_other_one_is_named(tmp_path, printed, factor):
    found = fly(tmp_path, {printed: factor}, effects={})
    wrong = COEFFICIENTS[printed]
    assert found.naming.outcome in ("unexplained", "partial")
    assert found.naming.names in ((), (wrong,)), found.naming.sentence
    check_measured(found, {printed: factor})


@pytest.mark.slow
@pytest.mark.parametrize(("printed", "factor"), [("Lp", 0.7), ("Nb", 1.4)])
def test_a_falsified_lateral_derivative_is_found_beside_all_that_is_known(tmp_path, printed, factor):
    found = fly(tmp_path, {printed: factor})
    assert COEFFICIENTS[printed] in found.naming.sentence
    assert COEFFICIENTS[printed] in found.naming.off


@pytest.mark.slow
@pytest.mark.parametrize(("printed", "factor"), [("Lb", 1.5), ("Nr", 0.4)])
def test_what_priors_allow_is_no_accusation(tmp_path, printed, factor):
    """2.3 and 3 times the believed deviation off, or less than four of its own errors."""
    found = fly(tmp_path, {printed: factor}, effects={})
    assert found.naming.coefficients == ()
    check_measured(found, {printed: factor})
