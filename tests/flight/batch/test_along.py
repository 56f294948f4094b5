"""Forces along a given motion: those of the very flight that the motion is of, and what differs where it does."""

from dataclasses import replace

import numpy as np
import pytest

import testbench as tb
from testbench.aircraft import Amendment, ScaleCoefficient
from testbench.core.constants import FT_M, LBF_N
from testbench.core.errors import LimitError
from testbench.flight import fly, trim
from testbench.flight.batch import along
from testbench.flight.batch.along import GivenMotion, Lane, forces_along
from testbench.flight.batch.check import every_control, judged
from testbench.flight.executive import ACCELERATIONS, Executive
from testbench.flight.simulate import commands
from testbench.flight.trim import place_at_trim

_PROPERTIES = (*(f"forces/fb{axis}-aero-lbs" for axis in "xyz"), *(f"moments/{axis}-aero-lbsft" for axis in "lmn"))


def flown(name: str, share: float = 0.005):
    """Fly every control of an aircraft by JSBSim itself, and log forces and the accelerations of the frame before."""
    aircraft = tb.load_aircraft(name)
    trimmed = trim(aircraft, tb.FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))
    manoeuvre = every_control(aircraft, trimmed, share)
    record = fly(aircraft, trimmed, manoeuvre, trimmed.rate_hz)
    fdm = Executive(aircraft, trimmed.rate_hz, trimmed.condition)
    place_at_trim(fdm, trimmed)
    u, at_trim = commands(aircraft, trimmed, manoeuvre), [trimmed.controls[n] for n in manoeuvre.signal.channels]
    rows, rates = [], []
    for k in range(len(record)):
        if k:
            if np.any(u[k] != (u[k - 1] if k > 1 else at_trim)):
                fdm.command(dict(zip(manoeuvre.signal.channels, u[k], strict=True)))
            rates.append([fdm.get(n) * factor for n, factor in ACCELERATIONS[:3]])
            fdm.fdm.run()
        else:
            rates.append([0.0, 0.0, 0.0])
        rows.append([fdm.get(n) for n in _PROPERTIES])
        assert fdm.get("velocities/q-rad_sec") == pytest.approx(record["q"][k], abs=1e-12)
    motion = {n: record[n] for n in ("h", "phi", "theta", "V", "alpha", "beta", "p", "q", "r")}
    motion |= dict(zip(("udot", "vdot", "wdot"), np.array(rates).T, strict=True))
    given = dict(zip(manoeuvre.signal.channels, u[: len(record)].T, strict=True))
    forces = np.array(rows) * np.array([LBF_N] * 3 + [LBF_N * FT_M] * 3)
    return aircraft, trimmed, record, GivenMotion(trimmed.rate_hz, motion, given), forces


@pytest.mark.parametrize("name", ["taurus", "c172p", "f16"])
def test_forces_along_a_flight_are_the_properties_of_jsbsim(name):
    aircraft, trimmed, record, given, forces = flown(name)
    (found,) = forces_along([Lane(aircraft, trimmed, given)], ["de"])
    both = np.hstack([found.aero_force, found.aero_moment])
    settled = slice(2, None)
    for ours, theirs in zip(both.T, forces.T, strict=True):
        assert np.max(np.abs(ours - theirs)[settled]) < 1e-9 * max(np.ptp(theirs), 1.0)
    for i, n in enumerate(("pdot", "qdot", "rdot")):  # no heading is given: the Earth turns about another axis
        assert np.max(np.abs(found.rotation[settled, i] - record[n][settled])) < 1e-5 * max(np.ptp(record[n]), 0.1)
    for i, n in enumerate(("ax", "ay", "az")):
        gap = np.abs(found.acceleration[settled, i] - record[n][settled])
        assert np.max(gap) < 1e-7 * np.max(
            np.abs(record[n])
        )  # a channel is divided by the mass in kg, which is rounded
    assert np.max(np.abs(found.channels["de"] - record["de"])[settled]) < 1e-12


def test_samples_of_slow_motion_are_right_although_commands_jump_between_them():
    """A tenth of the rate: what the band below holds of forces is the same from every fourth sample."""
    aircraft, trimmed, _, given, _ = flown("taurus")
    held = {n: np.repeat(x[::4], 4)[: len(x)] for n, x in given.commands.items()}
    given = replace(given, commands=held)
    few = GivenMotion(
        given.rate_hz / 4.0,
        {n: x[::4] for n, x in given.motion.items()},
        {n: x[::4] for n, x in given.commands.items()},
    )
    (every,) = forces_along([Lane(aircraft, trimmed, given)])
    (some,) = forces_along([Lane(aircraft, trimmed, few)])
    half = np.hanning(61) / np.hanning(61).sum()
    a = np.convolve(every.rotation[:, 1], np.hanning(241) / np.hanning(241).sum(), "same")[::4]
    b = np.convolve(some.rotation[:, 1], half, "same")
    assert np.max(np.abs(a - b)[50:-50]) < 3e-3 * np.ptp(a)


def test_a_model_that_lacks_damping_lacks_its_moment():
    aircraft, trimmed, record, given, _ = flown("taurus")
    less = aircraft.amended(Amendment("less", "", (ScaleCoefficient("Cm_q", 0.5),)))
    whole, part = forces_along([Lane(aircraft, trimmed, given), Lane(less, trimmed, given)])
    lacking = (whole.aero_moment - part.aero_moment)[:, 1] / (whole.qbar_Pa * aircraft.geometry.S_m2)
    c = aircraft.geometry.cbar_m
    expected = 0.5 * aircraft.coefficient("Cm_q") * record["q"] * c / (2.0 * record["V"]) * c
    assert np.max(np.abs(lacking - expected)) < 1e-9


def test_a_model_that_the_batch_does_not_fly_is_refused(monkeypatch):
    aircraft, trimmed, _, given, _ = flown("taurus", 0.002)
    found = judged(aircraft, trimmed)
    monkeypatch.setattr(along, "judged", lambda a, t: replace(found, model=None, reason="it has a sail"))
    with pytest.raises(LimitError, match="cannot be evaluated in a batch: it has a sail"):
        forces_along([Lane(aircraft, trimmed, given)])
