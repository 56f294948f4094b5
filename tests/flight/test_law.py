"""The model's own control law, between stick and surface: flown, linear, and left out."""

import numpy as np
import pytest
from scipy.linalg import expm

from testbench.aircraft.seams import with_servo
from testbench.core.errors import ModelError
from testbench.core.paths import stock_root
from testbench.evaluation.modes import frequency_and_damping, modes_by_law, spectrum
from testbench.flight import FlightCondition, Manoeuvre, fly, linearise, load_aircraft, trim
from testbench.flight.law import _realised
from testbench.flight.load import by_stick, stock
from testbench.inputs.signal import InputSignal
from testbench.questions.aircraft.adopt import write_adopted

DEG = np.pi / 180.0


@pytest.fixture(scope="module")
def a320():
    return load_aircraft("jsbsim:A320", commanded_at="stick")


@pytest.fixture(scope="module")
def trimmed(a320):
    return trim(a320, FlightCondition(a320.design_V_m_s, a320.design_h_m))


@pytest.fixture(scope="module")
def linear(a320, trimmed):
    return linearise(a320, trimmed)


def _pulse(trimmed, control, size, seconds):
    t = np.arange(round(seconds * trimmed.rate_hz)) / trimmed.rate_hz
    u = size * ((t >= 0.5) & (t < 1.0))
    return u, Manoeuvre(control, InputSignal(t, u[:, None], (control,)), 0.0)


def test_a_law_changes_no_trim_and_moves_nothing_where_nothing_moves(a320, trimmed):
    bare = trim(a320.commanded_at("surface"), trimmed.condition)
    assert dict(trimmed.controls) == pytest.approx(dict(bare.controls), abs=1e-12)
    _, still = _pulse(trimmed, "dr", 0.0, 5.0)
    flown = fly(a320, trimmed, still, 20.0)
    assert np.ptp(flown["dr"]) < 1e-8
    assert np.ptp(flown["phi"]) < 1e-5


def test_the_yaw_damper_is_what_its_file_says(linear):
    # Rudder sum: stick + 2 r - 5 beta, of a full throw of 25 deg at 0.01745 rad per degree.
    throw = 25.0 * 0.01745
    row = linear.A[linear.states.index("servo_dr")] / -linear.A[linear.states.index("servo_dr")].min()
    assert row[linear.states.index("r")] == pytest.approx(2.0 * throw, rel=1e-6)
    V = 150.0
    assert row[linear.states.index("v")] == pytest.approx(-5.0 * throw / V, rel=1e-3)
    assert linear.B[linear.states.index("servo_dr"), linear.inputs.index("dr_cmd")] > 0.0


def test_the_linear_model_flies_as_the_aircraft_with_its_law_does(a320, trimmed, linear):
    u, manoeuvre = _pulse(trimmed, "dr", 0.2 * DEG, 8.0)
    flown = fly(a320, trimmed, manoeuvre, trimmed.rate_hz)
    column = linear.B[:, [linear.inputs.index("dr_cmd")]]
    n = len(linear.states)
    step = expm(np.block([[linear.A, column], [np.zeros((1, n + 1))]]) / trimmed.rate_hz)
    x, states = np.zeros(n), []
    for command in u:
        states.append(x)
        x = step[:n, :n] @ x + step[:n, n] * command
    for channel, most in (("beta", 0.02), ("r", 0.04), ("phi", 0.02)):
        moved = flown[channel] - flown[channel][0]
        predicted = np.array(states) @ linear.C[linear.outputs.index(channel)]
        assert np.abs(moved[: len(u)] - predicted).max() < most * np.ptp(moved), channel


def test_both_linear_models_stand_in_one(a320, trimmed, linear):
    bare = linearise(a320.commanded_at("surface"), trimmed)
    np.testing.assert_allclose(linear.subsystem(bare.states).A, bare.A, atol=1e-9)
    closed = modes_by_law(linear, "lateral-directional", {})
    wn, zeta = frequency_and_damping(closed["Dutch roll"][0])
    assert zeta == pytest.approx(0.566, abs=0.01)
    alone = spectrum(linear, "lateral-directional", {}).poles
    assert min(frequency_and_damping(s)[1] for s in alone if abs(s.imag) > 0.1) == pytest.approx(0.088, abs=0.002)
    assert np.abs(linear.poles() - closed["Dutch roll"][0]).min() < 0.01 * wn


def test_a_servo_behind_the_law_delays_what_the_law_demands(a320, trimmed):
    slow, _ = with_servo(a320, "dr", 5.0)
    _, manoeuvre = _pulse(trimmed, "dr", 1.0 * DEG, 4.0)
    quick, late = (fly(x, trimmed, manoeuvre, 50.0) for x in (a320, slow))
    peak = [int(np.argmax(x["dr"])) for x in (quick, late)]
    assert peak[1] > peak[0] + 10
    assert np.abs(late["dr"]).max() < np.abs(quick["dr"]).max()


def test_step_responses_are_realised_exactly():
    rng = np.random.default_rng(3)
    rate, poles = 200.0, np.array([-0.7, -9.0])
    B, C, D = rng.normal(size=(2, 2)), rng.normal(size=(1, 2)), rng.normal(size=(1, 2))
    t = np.arange(-1, 599) / rate  # a response is sampled from its second frame on
    found = [
        (C * ((np.exp(np.outer(np.maximum(t, 0.0), poles)) - 1.0) / poles * B[:, k])).sum(axis=1)[:, None] + D[:, k]
        for k in range(2)
    ]
    A, Bm, Cm, Dm = _realised(found, rate)
    assert sorted(np.linalg.eigvals(A).real) == pytest.approx(sorted(poles), rel=1e-6)
    s = 2.0j
    wanted = C @ np.diag(1.0 / (s - poles)) @ B + D
    np.testing.assert_allclose(Cm @ np.linalg.solve(s * np.eye(len(A)) - A, Bm) + Dm, wanted, rtol=1e-6)


def test_an_adopted_aircraft_keeps_its_law_and_can_leave_it_out(tmp_path):
    folder = tmp_path / "a320"
    write_adopted(by_stick(stock("A320")), folder)
    text = (folder / "aircraft.toml").read_text()
    assert 'commanded_at = "stick"' in text
    assert load_aircraft(folder).under_law == ("de", "da", "dr")
    (folder / "aircraft.toml").write_text(text.replace('"stick"\n', '"surface"\n'))
    assert load_aircraft(folder).under_law == ()


def test_a_model_that_is_named_directly_flies_as_it_would_be_adopted():
    assert load_aircraft("jsbsim:A320").under_law == ("de", "da", "dr")
    assert load_aircraft(stock_root() / "aircraft" / "A320").under_law == ("de", "da", "dr")
    assert load_aircraft("jsbsim:A320", commanded_at="surface").under_law == ()
    assert load_aircraft("jsbsim:SGS").under_law == ()


def test_an_aircraft_without_a_law_has_no_stick_to_command():
    with pytest.raises(ModelError, match="must have a control law to be commanded at the stick"):
        load_aircraft("jsbsim:SGS", commanded_at="stick")
