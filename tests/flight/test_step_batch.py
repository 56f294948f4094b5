"""Flights in pieces in a batch, each against JSBSim: begun again at any time, ended, near the ground, many blocks."""

import math
from dataclasses import replace

import numpy as np
import pytest
from side_by_side import by_itself

from testbench.core.errors import ChannelError, LimitError
from testbench.flight import FlightCondition, trim
from testbench.flight.batch import registers as r
from testbench.flight.batch.motion import turn_earth
from testbench.flight.batch.step import SteppedBatch
from testbench.flight.batch.vector import LANES, atan2
from testbench.flight.step import SteppedFlight

CHANNELS = ("V", "alpha", "beta", "q", "theta", "phi", "psi", "de", "h", "az")
CONTROLS = ("de", "da", "dr")
RATE_HZ = 40.0


def commands(trimmed, rng, flights):
    at = np.array([trimmed.controls[c] for c in CONTROLS])
    return at + rng.uniform(-0.03, 0.03, (flights, len(CONTROLS)))


def worst(rows, truth):
    """Greatest difference of two flights, of a channel's range, or of 0.1 SI units (10 m of height)."""
    gap = np.abs(rows - truth)
    psi = CHANNELS.index("psi")
    gap[:, psi] = np.minimum(gap[:, psi], np.abs(gap[:, psi] - 2.0 * np.pi))
    least = np.where(np.array(CHANNELS) == "h", 10.0, 0.1)
    return np.max(gap / np.maximum(np.ptp(truth, axis=0), least))


def test_flights_that_begin_again_at_any_time_are_those_of_jsbsim(taurus, taurus_trim):
    rng, pieces, rows = np.random.default_rng(1), 48, 10
    arguments = (taurus, taurus_trim, CONTROLS, CHANNELS, RATE_HZ)
    batch = SteppedBatch(*arguments, 3)
    alone = [SteppedFlight(*arguments) for _ in range(3)]
    flown = [[[]], [[]], [[]]], [[[]], [[]], [[]]]
    for k in range(pieces):
        which = np.array([k in (7, 31), k == 20, False])
        batch.reset(which)
        for i in np.flatnonzero(which):
            alone[i] = SteppedFlight(*arguments)
            np.testing.assert_allclose(batch.read()[i, :6], alone[i].read()[:6], rtol=0.0, atol=1e-11)
            for of in flown:
                of[i].append([])
        u = commands(taurus_trim, rng, 3)
        new = batch.advance(u, rows)
        for i in range(3):
            flown[0][i][-1].append(new[i])
            flown[1][i][-1].append(alone[i].advance(u[i], rows))
    assert list(batch.reasons) == ["", "", ""]
    for a, b in zip(*flown, strict=True):
        for rows_of, truth in zip(a, b, strict=True):
            assert worst(np.concatenate(rows_of), np.concatenate(truth)) < 1e-9


def test_a_flight_does_not_depend_on_the_clock_of_its_block_nor_on_the_others(taurus, taurus_trim):
    rng = np.random.default_rng(2)
    u = [commands(taurus_trim, rng, 2) for _ in range(6)]
    batch = SteppedBatch(taurus, taurus_trim, CONTROLS, CHANNELS, RATE_HZ, 2)
    first = [batch.advance(x, 10)[0] for x in u]
    batch.reset(np.array([True, False]))
    again = [batch.advance(np.stack([x[0], x[1] + 0.001]), 10)[0] for x in u]
    np.testing.assert_array_equal(first, again)
    many = SteppedBatch(taurus, taurus_trim, CONTROLS, CHANNELS, RATE_HZ, LANES + 3)
    last = [many.advance(np.tile(x[0], (LANES + 3, 1)), 10) for x in u]
    np.testing.assert_array_equal(first, [x[-1] for x in last])


def test_reset_returns_to_what_is_held(taurus, taurus_trim):
    rng = np.random.default_rng(3)
    batch = SteppedBatch(taurus, taurus_trim, CONTROLS, CHANNELS, RATE_HZ, 2)
    batch.advance(commands(taurus_trim, rng, 2), 10)
    batch.hold()
    there, u = batch.read(), commands(taurus_trim, rng, 1)
    np.testing.assert_array_equal(there[0], there[1])
    first = batch.advance(np.tile(u, (2, 1)), 10)
    batch.reset(np.array([False, True]))
    np.testing.assert_array_equal(batch.read()[1], there[0])
    np.testing.assert_array_equal(batch.advance(np.tile(u, (2, 1)), 10)[1], first[0])


def test_one_that_leaves_its_limits_ends_alone_and_says_why(taurus, taurus_trim):
    arguments = (taurus, taurus_trim, ("de",), CHANNELS, RATE_HZ)
    batch, alone = SteppedBatch(*arguments, 2), SteppedFlight(*arguments)
    u = np.array([[taurus.controls["de"].full], [taurus_trim.controls["de"]]])
    rows, truth = batch.advance(u, 400), alone.advance(u[0], 400)
    assert batch.reasons[0] == alone.reason != ""
    assert batch.reasons[1] == ""
    assert 0 < len(truth) < 400
    assert worst(rows[0, : len(truth)], truth) < 1e-9
    assert np.all(rows[0, len(truth) :] == rows[0, len(truth) - 1])
    still = batch.advance(np.full((2, 1), taurus_trim.controls["de"]), 5)
    assert np.all(still[0] == rows[0, -1])  # it stands still
    batch.reset(np.array([True, False]))
    assert batch.reasons[0] == ""
    assert worst(batch.advance(u, len(truth))[0], truth) < 1e-9


def test_one_that_comes_near_the_ground_is_flown_on_by_jsbsim(taurus):
    free = replace(taurus, limits={n: x for n, x in taurus.limits.items() if n != "h"})
    low = trim(free, FlightCondition(12.0, 5.0))
    arguments = (free, low, ("de",), CHANNELS, RATE_HZ)
    batch, alone = SteppedBatch(*arguments, 2), SteppedFlight(*arguments)
    at = low.controls["de"]
    u = [at, at + 0.02, at + 0.02, at + 0.02, at - 0.01, at]
    rows = [batch.advance(np.array([[at], [x]]), 20) for x in u]
    truth = [alone.advance(np.array([x]), 20) for x in u]
    assert len(batch._alone) == 1
    assert min(x[:, CHANNELS.index("h")].min() for x in truth) < 3.0 * taurus.geometry.b_m
    assert worst(np.concatenate([x[1] for x in rows]), np.concatenate(truth)) < 1e-9
    batch.reset(np.ones(2, bool))
    assert batch._alone == {}


def test_faults_are_named(taurus, taurus_trim):
    with pytest.raises(ChannelError, match="has no channel 'alfa'"):
        SteppedBatch(taurus, taurus_trim, ("de",), ("alfa",), RATE_HZ, 2)
    batch = SteppedBatch(taurus, taurus_trim, ("de",), CHANNELS, RATE_HZ, 2)
    for bad in (1.0, np.nan):
        with pytest.raises(LimitError, match=r"de <=.* in flight 1"):
            batch.advance(np.array([[taurus_trim.controls["de"]], [bad]]), 1)


def test_the_earth_s_angle_and_the_angles_of_the_flow_are_the_library_s():
    rng = np.random.default_rng(4)
    R, turn = np.zeros((r.COUNT, LANES)), by_itself(turn_earth)
    for angles in (np.linspace(0.0, 0.02, LANES), rng.uniform(0.0, 30.0, LANES), np.pi / 4 * np.arange(LANES)):
        R[r.EARTH_ANGLE] = angles
        turn(R)
        # beyond half a quarter turn, two hours and a half, its reduction rounds by the last bit of the angle
        np.testing.assert_allclose(R[r.COS_EARTH], np.cos(angles), rtol=0.0, atol=2e-16 * (1.0 + angles.max()))
        np.testing.assert_allclose(R[r.SIN_EARTH], np.sin(angles), rtol=0.0, atol=2e-16 * (1.0 + angles.max()))
    angle = by_itself(lambda rows: rows.__setitem__(0, atan2(rows[0], rows[1])))
    corners = [(1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (-1.0, 0.0), (1.0, 1.0), (0.0, 0.0)]
    for x, y in [*rng.standard_normal((500, 2)), *corners]:
        R[0], R[1] = y, x
        angle(R)
        assert R[0] == pytest.approx(np.full(LANES, math.atan2(y, x)), rel=5e-16, abs=0.0)
