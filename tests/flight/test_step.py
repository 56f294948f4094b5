"""A flight by steps against the same flight in one go."""

import numpy as np
import pytest

from testbench.core.errors import ChannelError, LimitError
from testbench.flight import Manoeuvre, fly
from testbench.flight.step import SteppedFlight
from testbench.inputs.signal import InputSignal

CHANNELS = ("V", "alpha", "q", "theta", "de")


def test_a_flight_by_steps_is_the_flight_in_one_go_one_frame_late(taurus, taurus_trim):
    rate = taurus_trim.rate_hz
    steps = np.array([0.02, -0.03, 0.0, 0.05, 0.05])
    held = np.repeat(steps, round(0.25 * rate))
    late = np.concatenate([[0.0], held[:-1]])
    signal = InputSignal(np.arange(late.size) / rate, late[:, None], ("de",))
    whole = fly(taurus, taurus_trim, Manoeuvre("steps", signal, settle_s=0.0), 40.0, CHANNELS)
    flight = SteppedFlight(taurus, taurus_trim, ("de",), CHANNELS, 40.0)
    at = taurus_trim.controls["de"]
    rows = [flight.read()[None], *(flight.advance(np.array([at + u]), 10) for u in steps)]
    np.testing.assert_array_equal(np.concatenate(rows), whole.data)
    assert flight.reason == ""


def test_a_flight_that_leaves_the_limits_ends_and_says_why(taurus, taurus_trim):
    flight = SteppedFlight(taurus, taurus_trim, ("de",), CHANNELS, 40.0)
    rows = flight.advance(np.array([taurus.controls["de"].full]), 400)
    assert 0 < len(rows) < 400
    assert np.all(np.isfinite(rows))
    assert "must hold" in flight.reason
    with pytest.raises(LimitError, match="ended cannot go on"):
        flight.advance(np.array([0.0]), 1)


def test_faults_are_named(taurus, taurus_trim):
    with pytest.raises(ChannelError, match="has no channel 'alfa'"):
        SteppedFlight(taurus, taurus_trim, ("de",), ("alfa",), 40.0)
    with pytest.raises(LimitError, match="must divide"):
        SteppedFlight(taurus, taurus_trim, ("de",), CHANNELS, 37.0)
    flight = SteppedFlight(taurus, taurus_trim, ("de",), CHANNELS, 40.0)
    for bad in (1.0, np.nan):
        with pytest.raises(LimitError, match="de <="):
            flight.advance(np.array([bad]), 1)
