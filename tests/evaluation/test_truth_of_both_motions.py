"""What is known of an aircraft whose aileron and rudder move: its lateral-directional modes, and what excites them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from testbench.evaluation.modes import lateral_modes
from testbench.evaluation.truth import _possible, excited, true_model
from testbench.flight import FlightCondition, fly, load_aircraft, trim
from testbench.flight.simulate import Manoeuvre
from testbench.inputs.signal import InputSignal
from testbench.sensors import load_suite

LATERAL = ["spiral", "Dutch roll", "roll"]


@pytest.fixture(scope="module")
def taurus():
    aircraft = load_aircraft("taurus")
    return aircraft, trim(aircraft, FlightCondition(14.0, 100.0))


def test_inputs_say_whose_modes_are_asked_for(taurus):
    longitudinal = list(true_model(*taurus).modes)
    assert list(true_model(*taurus, ("de_cmd", "thr")).modes) == longitudinal
    assert list(true_model(*taurus, ("da_cmd", "dr")).modes) == LATERAL
    assert list(true_model(*taurus, ("de", "da")).modes) == [*longitudinal, *LATERAL]


def test_lateral_modes_are_eigenvalues_of_their_motion(taurus):
    known = true_model(*taurus, ("da",))
    poles = np.linalg.eigvals(known.linear.lateral().A)
    assert all(np.min(np.abs(poles - s)) < 1e-9 for s in known.modes.values())
    assert known.modes["Dutch roll"].imag > 1.0
    assert known.modes["roll"].real < -5.0
    assert abs(known.modes["spiral"]) < 0.2


def test_roll_and_spiral_that_have_joined_are_one_pair(taurus):
    known = true_model(*taurus, ("da",))
    whole = known.linear
    i, p, phi = (whole.states.index(s) for s in ("v", "p", "phi"))
    A = whole.A.copy()
    A[p, p], A[p, phi], A[phi, i], A[i, phi] = -0.4, -1.0, 0.0, 0.0  # a roll that springs back
    modes = lateral_modes(replace(whole, A=A), {})
    assert set(modes) == {"Dutch roll", "lateral phugoid"}
    assert (
        0.8 < modes["lateral phugoid"].imag < 1.1
    )  # a spring of 1 rad/s2 per rad, with what sideslip and yaw do to roll


def test_an_aileron_excites_the_roll_and_an_elevator_does_not(taurus):
    aircraft, trimmed = taurus
    n = round(4.0 * trimmed.rate_hz)
    suites = [load_suite("eolo_gap_lateral")]
    for control, shown in (("da", {"roll": True}), ("de", {"short period": True})):
        u = np.zeros((n, 1))
        u[n // 8 : n // 4], u[n // 4 : n // 2] = 0.03, -0.015
        signal = InputSignal(np.arange(n) / trimmed.rate_hz, u, (control,))
        flown = fly(aircraft, trimmed, Manoeuvre("pulse", signal, 0.0), 120.0)
        found = excited(true_model(aircraft, trimmed, (control,)), flown, (control,), suites).excitation
        verdicts = {e.mode: e.excited for e in found}
        assert {name: verdicts[name] for name in shown} == shown
        assert ("roll" in verdicts) == (control == "da")


@pytest.mark.parametrize(
    ("name", "states", "modes"),
    [
        ("lateral_directional", ("beta", "p", "r", "phi"), LATERAL),
        ("roll_yaw_rates", ("p", "r"), ["roll"]),
        ("longitudinal", ("V", "alpha", "q", "theta"), ["phugoid", "short period"]),
        ("short_period", ("alpha", "q"), ["short period"]),
    ],
)
def test_a_structure_is_asked_for_the_modes_of_its_motion_alone(taurus, name, states, modes):
    known = true_model(*taurus, ("de", "da"))
    assert list(_possible(known, SimpleNamespace(name=name, states=states))) == modes
