"""A flight by steps against the same flight in one go.

What counts frames is made for one frame rate: at another it says by what factor its times are off.
"""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from structure_alone import uncoupled

import testbench as tb
from testbench.aircraft import Amendment, Insert, ScaleCoefficient
from testbench.core.constants import DEG_RAD
from testbench.core.errors import ChannelError, LimitError, ModelError
from testbench.core.record import FlightAborted
from testbench.effects import SERVOS
from testbench.flight import FlightCondition, Manoeuvre, fly, load_aircraft, trim
from testbench.flight.executive import Executive
from testbench.flight.step import SteppedFlight
from testbench.flight.trim import FrameRateWarning, place_at_trim
from testbench.inputs.signal import InputSignal
from testbench.sensors import load_suite


def doublet(
    rate_hz: float, amplitude_deg: float = 2.0, half_s: float = 0.5, duration_s: float = 5.0, control: str = "de"
) -> Manoeuvre:
    n = round(rate_hz * duration_s)
    u = np.zeros((n, 1))
    half = round(rate_hz * half_s)
    u[:half], u[half : 2 * half] = amplitude_deg * DEG_RAD, -amplitude_deg * DEG_RAD
    return Manoeuvre("doublet", InputSignal(np.arange(n) / rate_hz, u, (control,)), settle_s=1.0)


def test_undisturbed_flight_stays_in_trim(eolo, eolo_trim):
    rest = Manoeuvre("rest", InputSignal(np.arange(5000) / 500.0, np.zeros((5000, 1)), ("de",)), settle_s=0.0)
    record = fly(eolo, eolo_trim, rest, 100.0)
    for name in ("V", "alpha", "q", "theta", "eta_1", "eta_5"):
        assert np.ptp(record[name]) < 2e-5 * max(1.0, abs(record[name][0]))
    assert len(record) == 1001
    assert record.t_s[-1] == pytest.approx(10.0)


def test_the_same_flight_gives_the_same_bits_whatever_was_flown_before(eolo, eolo_trim):
    first = fly(eolo, eolo_trim, doublet(500.0), 100.0)
    fly(eolo, eolo_trim, doublet(500.0, 3.0), 100.0)
    again = fly(eolo, trim(eolo, eolo_trim.condition), doublet(500.0), 100.0)
    assert np.array_equal(first.data, again.data)


def test_signs_of_the_controls(eolo, eolo_trim):
    """Elevator down pitches down, aileron rolls right, rudder yaws left, throttle speeds up."""
    for control, channel, sign in (("de", "q", -1), ("da", "p", 1), ("dr", "r", -1)):
        record = fly(eolo, eolo_trim, doublet(500.0, control=control), 100.0)
        assert np.sign(record[channel][130]) == sign  # 0.3 s after the first step
    faster = doublet(500.0, amplitude_deg=6.0, control="thr", half_s=2.0)
    assert fly(eolo, eolo_trim, faster, 100.0)["V"][300] > 16.01


def test_the_servo_is_the_exact_first_order_lag(eolo, eolo_trim):
    record = fly(eolo, eolo_trim, doublet(500.0), 500.0)
    t, lag = record.t_s, 50.0
    rise = record["de"] - record["de"][0]
    inside = (t > 1.003) & (t < 1.49)
    # Commands are linear between frames, so the step begins half a frame before its first sample.
    exact = 2.0 * DEG_RAD * (1.0 - np.exp(-lag * (t[inside] - 1.0 + 0.001)))
    assert rise[inside] == pytest.approx(exact, rel=2e-3)
    assert record["de_cmd"][600] - record["de_cmd"][0] == pytest.approx(2.0 * DEG_RAD)


def test_the_servo_keeps_its_rate_limit():
    aircraft = load_aircraft("taurus")
    trimmed = trim(aircraft, FlightCondition(14.0, 100.0))
    record = fly(aircraft, trimmed, doublet(240.0, 4.0), 240.0)
    limit = 2.618 / 240.0
    assert np.max(np.abs(np.diff(record["de"]))) <= limit * (1 + 1e-9)
    assert np.max(np.abs(np.diff(record["de"]))) == pytest.approx(limit, rel=1e-9)  # a 8 deg reversal reaches it


def test_uncoupled_modes_ring_at_the_frequency_and_damping_of_the_ground_test():
    """Every mode alone, kicked through JSBSim's own functions; frequency and damping to 0.01 %."""
    eolo = load_aircraft("eolo")
    bare = replace(eolo, elastic=uncoupled(eolo.elastic))
    trimmed = trim(bare, FlightCondition(16.0, 547.0))
    fdm = Executive(bare, 500.0, trimmed.condition)
    place_at_trim(fdm, trimmed)
    for i in range(1, 9):
        fdm.set(f"modal/eta-{i}", 0.01 * i)
    nodes = [fdm.node(f"modal/{kind}-{i}") for kind in ("eta", "etadot") for i in range(1, 9)]
    states = []
    for _ in range(400):
        fdm.fdm.run()
        states.append([n.get_double_value() for n in nodes])
    x = np.array(states)
    for i, mode in enumerate(eolo.elastic.modes):
        own = x[:, [i, i + 8]]
        step = np.linalg.lstsq(own[:-1], own[1:], rcond=None)[0]
        s = np.log(np.linalg.eigvals(step).astype(complex)[0]) * 500.0
        assert abs(s) / (2 * np.pi) == pytest.approx(mode.f_hz, rel=1e-4)
        assert -s.real / abs(s) == pytest.approx(mode.zeta, rel=1e-4)


def test_modes_without_coupling_leave_the_rigid_motion_as_it_is():
    eolo = load_aircraft("eolo")
    bare = replace(eolo, elastic=uncoupled(eolo.elastic))
    rigid = eolo.with_rigid_wings()
    condition = FlightCondition(16.0, 547.0)
    flights = [
        fly(a, trim(a, condition), doublet(500.0), 100.0, ("V", "alpha", "q", "theta", "h")) for a in (bare, rigid)
    ]
    assert np.array_equal(flights[0].data, flights[1].data)


def test_halving_the_time_step_changes_little(eolo, eolo_trim):
    coarse = fly(eolo, eolo_trim, doublet(500.0), 50.0)
    fine = fly(eolo, trim(eolo, eolo_trim.condition, 1000.0), doublet(1000.0), 50.0)
    for name in ("V", "alpha", "q", "theta", "eta_1", "eta_5", "eta_7"):
        spread = np.std(fine[name])
        # The step of the command is a ramp over one frame (2 ms against 1 ms): half a millisecond of shift, the rest is
        # less.
        assert np.sqrt(np.mean((coarse[name] - fine[name]) ** 2)) < 0.02 * spread


def test_a_command_beyond_the_deflection_is_refused_and_not_clipped(eolo, eolo_trim):
    with pytest.raises(LimitError, match=r"-25 <= de <= 25 deg must hold for eolo, got 3\d\.\d+ deg"):
        fly(eolo, eolo_trim, doublet(500.0, 30.0), 100.0)


def test_a_log_rate_must_divide_the_simulation_rate(eolo, eolo_trim):
    with pytest.raises(
        LimitError, match=r"rate of 500 Hz, got 60 Hz; simulate at 540 Hz .*, or log at 55.5556 or 62.5 Hz"
    ):
        fly(eolo, eolo_trim, doublet(500.0), 60.0)


def test_a_signal_at_another_rate_is_refused(eolo, eolo_trim):
    with pytest.raises(LimitError, match="sampled at the simulation rate of 500 Hz, got 100 Hz"):
        fly(eolo, eolo_trim, doublet(100.0), 100.0)


def test_leaving_the_envelope_aborts_with_time_reason_and_record(eolo, eolo_trim):
    with pytest.raises(FlightAborted, match=r"left its limits at t = .* must hold, got") as caught:
        fly(eolo, eolo_trim, doublet(500.0, 20.0, half_s=2.0), 100.0)
    record = caught.value.record
    assert record is not None
    assert record.outcome == "aborted"
    assert 0.5 < caught.value.time_s < 6.0
    assert len(record) == pytest.approx(caught.value.time_s * 100.0)


def test_a_flight_that_begins_outside_of_the_limits_is_not_blamed_on_its_input(eolo, eolo_trim):
    narrow = replace(eolo, limits={**eolo.limits, "V": (8.0, 15.0)})  # trimmed at 16 m/s
    with pytest.raises(FlightAborted) as caught:
        fly(narrow, eolo_trim, doublet(500.0), 100.0)
    assert "is outside of its limits where manoeuvre" in str(caught.value)
    assert "8 <= V <= 15 must hold, got 16" in str(caught.value)
    assert "amplitude" not in str(caught.value)


def test_a_model_that_ceases_to_be_finite_aborts():
    bad = (
        '<function name="aero/bad"><quotient><value>1</value><difference>'
        "<property>simulation/sim-time-sec</property><value>0.5</value>"
        "</difference></quotient></function>"
    )
    aircraft = load_aircraft("taurus").amended(
        Amendment("bad", "1/0 at 0.5 s", (Insert("aerodynamics/axis[@name='PITCH']", bad),))
    )
    unstable = aircraft.amended(Amendment("unstable", "nose-up", (ScaleCoefficient("Cm_alpha", -20.0),)))
    trimmed = trim(load_aircraft("taurus"), FlightCondition(14.0, 100.0))
    with pytest.raises(FlightAborted, match=r"must hold, got|ceased to be a finite number"):
        fly(unstable, trimmed, doublet(240.0, 1.0), 24.0)


def test_jsbsim_refusing_a_model_is_one_clear_error():
    broken = load_aircraft("taurus").amended(
        Amendment(
            "broken",
            "undefined property",
            (
                Insert(
                    "aerodynamics/axis[@name='PITCH']",
                    '<function name="aero/x"><property>no/such</property></function>',
                ),
            ),
        )
    )
    with pytest.raises(ModelError, match="JSBSim refuses the model of taurus"):
        trim(broken, FlightCondition(14.0, 100.0))


def test_reading_or_writing_an_unknown_property_is_an_error(eolo, eolo_trim):
    fdm = Executive(eolo, 500.0, eolo_trim.condition)
    with pytest.raises(ModelError, match="fcs/elevator-cmd-nrm"):
        fdm.set("fcs/elevator-cmd-nrm", 0.5)
    with pytest.raises(ModelError, match="velocities/q-rad"):
        fdm.get("velocities/q-rad")


def test_jsbsim_prints_nothing(eolo, capfd):
    trim(eolo, FlightCondition(17.0, 547.0))
    assert capfd.readouterr() == ("", "")


def test_an_input_that_starts_at_once_is_flown(eolo, eolo_trim):
    step = Manoeuvre("step", InputSignal(np.arange(500) / 500.0, np.full((500, 1), 0.01), ("de",)), settle_s=0.0)
    record = fly(eolo, eolo_trim, step, 100.0)
    assert record["de_cmd"][1:] - eolo_trim.controls["de"] == pytest.approx(0.01)
    assert record["de_cmd"][0] == pytest.approx(eolo_trim.controls["de"])


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


CONDITION = tb.FlightCondition(V_m_s=14.0, h_m=100.0)


def late(aircraft, delay_s=0.1):
    return SERVOS["delay", "de"].amend(aircraft, load_suite("eolo_gap"), {"delay_s": delay_s})[0]


def test_a_delay_flown_at_another_rate_is_warned_of():
    aircraft = tb.load_aircraft("taurus")
    rate = aircraft.rate_hz
    with pytest.warns(
        FrameRateWarning, match=rf"counts frames of {rate:g} Hz and is flown at {2 * rate:g} Hz.* 0.5 times"
    ):
        tb.trim(late(aircraft), CONDITION, 2.0 * rate)


def test_at_its_own_rate_nothing_is_said():
    aircraft = tb.load_aircraft("taurus")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tb.trim(late(aircraft), CONDITION)
        tb.trim(aircraft, CONDITION, 2.0 * aircraft.rate_hz)
        fast = replace(aircraft, rate_hz=2.0 * aircraft.rate_hz)
        assert tb.trim(late(fast), CONDITION, fast.rate_hz).rate_hz == 2.0 * aircraft.rate_hz
