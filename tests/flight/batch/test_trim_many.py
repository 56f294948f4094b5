"""Trims of a batch against the same trims by JSBSim.

Linear models by the batch are those that JSBSim's own differences give, bending and lag of the air included.
"""

import numpy as np
import pytest

import testbench as tb
from testbench.core.errors import TrimError
from testbench.core.processes import processes
from testbench.flight import TrimmedFlight, linearise
from testbench.flight.air import Air
from testbench.flight.batch.linear import linearise_many
from testbench.flight.batch.trim import trim_many
from testbench.questions.campaign.draws import change_aircraft


@pytest.mark.parametrize(("name", "V", "h"), [("taurus", 13.0, 100.0), ("eolo", 16.0, 547.0), ("b1", 200.0, 3000.0)])
def test_trims_are_those_of_jsbsim(name: str, V: float, h: float) -> None:
    aircraft = tb.load_aircraft(name)
    varied = [change_aircraft(aircraft, {"aircraft.mass_percent": x}) for x in (-2.0, 1.0)]
    conditions = [tb.FlightCondition(V, h), tb.FlightCondition(1.05 * V, h)]
    for found, a, c in zip(trim_many(varied, conditions), varied, conditions, strict=True):
        assert isinstance(found, TrimmedFlight)
        truth = tb.trim(a, c)
        assert np.max(np.abs(found.residual)) < 1e-9
        for control, value in truth.controls.items():
            assert found.controls[control] == pytest.approx(value, abs=1e-8)
        assert found.alpha == pytest.approx(truth.alpha, abs=1e-9)
        for channel in ("V", "alpha", "q", "az", "ax", "thrust", "qbar", "h"):
            assert found.state[channel] == pytest.approx(truth.state[channel], rel=1e-7, abs=1e-7), channel


def test_a_steady_wind_is_trimmed_in() -> None:
    aircraft, air = tb.load_aircraft("taurus"), Air(wind_north_m_s=-4.0, wind_east_m_s=2.0)
    condition = tb.FlightCondition(13.0, 100.0)
    (found,) = trim_many([aircraft], [condition], airs=[air])
    assert isinstance(found, TrimmedFlight)
    truth = tb.trim(aircraft, condition, air=air)
    assert found.state["Vg"] == pytest.approx(truth.state["Vg"], abs=1e-9)
    assert found.controls["dr"] == pytest.approx(truth.controls["dr"], abs=1e-8)


def test_no_bit_depends_on_what_is_trimmed_beside() -> None:
    aircraft = tb.load_aircraft("taurus")
    varied = [change_aircraft(aircraft, {"aircraft.mass_percent": 0.1 * k}) for k in range(70)]
    condition = tb.FlightCondition(13.0, 100.0)
    together = trim_many(varied, [condition] * 70)
    for k in (0, 69):
        (alone,) = trim_many([varied[k]], [condition])
        other = together[k]
        assert isinstance(alone, TrimmedFlight)
        assert isinstance(other, TrimmedFlight)
        assert alone.alpha == other.alpha
        assert alone.controls == other.controls
        assert alone.state == other.state


def test_what_has_no_trim_says_why_and_leaves_the_others() -> None:
    aircraft = tb.load_aircraft("taurus")
    fast, slow = trim_many([aircraft] * 2, [tb.FlightCondition(13.0, 100.0), tb.FlightCondition(6.0, 100.0)])
    assert isinstance(fast, TrimmedFlight)
    assert isinstance(slow, TrimError)
    with pytest.raises(TrimError) as caught:
        tb.trim(aircraft, tb.FlightCondition(6.0, 100.0))
    assert slow.message == caught.value.message


def test_what_jsbsim_trims_and_linearises_is_the_same_in_one_process_and_in_two(taurus) -> None:
    """Governed propellers are not flown in batches: each trim of a search is JSBSim's, on all processes."""
    conditions = [tb.FlightCondition(V, 100.0) for V in (11.0, 1.0, 12.0, 13.0)]  # 1 m/s: none
    aircraft = [taurus] * len(conditions)
    alone = trim_many(aircraft, conditions, simulator="jsbsim")
    with processes(2):
        shared = trim_many(aircraft, conditions, simulator="jsbsim")
    assert [isinstance(x, TrimError) for x in shared] == [False, True, False, False]
    able = [i for i in range(len(conditions)) if i != 1]
    assert [shared[i].controls for i in able] == [alone[i].controls for i in able]
    assert str(shared[1]) == str(alone[1])
    trims = [alone[i] for i in able]
    one = linearise_many([taurus] * 3, trims, simulator="jsbsim")
    with processes(2):
        two = linearise_many([taurus] * 3, trims, simulator="jsbsim")
    assert all(np.array_equal(a.A, b.A) and np.array_equal(a.D, b.D) for a, b in zip(one, two, strict=True))


def test_an_elastic_aircraft_is_linearised_in_a_block_as_by_jsbsim(eolo, eolo_trim):
    (model,) = linearise_many([eolo], [eolo_trim], "batch")
    alone = linearise(eolo, eolo_trim)
    assert (model.states, model.inputs, model.outputs) == (alone.states, alone.inputs, alone.outputs)
    assert sum(name.startswith("eta_") for name in model.states) == len(eolo.elastic.modes)
    for matrix in "ABCD":
        got, right = getattr(model, matrix), getattr(alone, matrix)
        np.testing.assert_allclose(got, right, rtol=0.0, atol=1e-8 * (1.0 + np.max(np.abs(right))))
