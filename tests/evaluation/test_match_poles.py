"""Poles are matched to modes by the shortest total distance."""

import numpy as np
import pytest

from testbench.evaluation.poles import damping, match_poles


def pole(wn, zeta):
    return complex(-zeta * wn, wn * np.sqrt(1.0 - zeta**2))


MODES = {"phugoid": pole(0.65, 0.02), "short period": pole(4.5, 0.75)}


def test_errors_of_frequency_and_damping():
    found = [pole(4.725, 0.70), pole(4.725, 0.70).conjugate(), pole(0.65, 0.05).conjugate(), pole(0.65, 0.05)]
    phugoid, short = match_poles(found, MODES, "V, q")
    assert (phugoid.name, short.name) == ("phugoid", "short period")
    assert phugoid.wn_error_percent == pytest.approx(0.0, abs=1e-9)
    assert phugoid.zeta_error == pytest.approx(0.03)
    assert short.wn_error_percent == pytest.approx(5.0)
    assert short.zeta_error == pytest.approx(-0.05)
    assert short.found == pytest.approx(pole(4.725, 0.70))
    assert short.true == MODES["short period"]
    assert short.outputs == "V, q"


def test_no_pole_stands_for_two_modes_and_a_far_one_for_none():
    found = [pole(0.66, 0.02), pole(80.0, 0.3)]
    phugoid, short = match_poles(found, MODES)
    assert phugoid.found == pytest.approx(found[0])
    assert short.found is None
    assert short.wn_error_percent is None
    assert short.zeta_error is None
    assert all(m.found is None for m in match_poles([], MODES))
    assert match_poles(found, {}) == []


def test_assignment_is_the_best_for_all_modes_together():
    # greedy by the first mode would take 1.2 for "a" (nearer than 0.8 in ratio) and leave 0.8 to "b"
    a, b = match_poles([complex(-0.8), complex(-1.2)], {"a": complex(-1.0), "b": complex(-1.5)})
    assert a.found == pytest.approx(-0.8)
    assert b.found == pytest.approx(-1.2)


def test_split_unstable_and_integrating_modes():
    split = match_poles([complex(-3.5), complex(-6.0)], {"short period": MODES["short period"]})[0]
    assert split.found == pytest.approx(-3.5)  # |ln(3.5 / 4.5)| < |ln(6 / 4.5)|
    assert split.zeta_error == pytest.approx(0.25)
    unstable = match_poles([pole(0.65, -0.01)], {"phugoid": MODES["phugoid"]})[0]
    assert unstable.zeta_error == pytest.approx(-0.03)
    lower = match_poles([pole(0.65, 0.02)], {"phugoid": MODES["phugoid"].conjugate()})[0]
    assert lower.wn_error_percent == pytest.approx(0.0, abs=1e-9)
    origin = match_poles([0j, complex(-1e-9)], {"heading": 0j})[0]
    assert origin.found is not None
    assert origin.wn_error_percent is None
    assert damping(0j) == 0.0
