"""What every estimator must do, run over every member of METHODS."""

import pickle
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete

from testbench.errors import ChannelError, EstimationError
from testbench.estimators import METHODS, estimate
from testbench.estimators.model import IdentifiedModel
from testbench.record import FlightRecord
from testbench.scenario import DsrE, TransferFunctions

DT = 0.1
INPUTS = ("de",)
OUTPUTS = ("theta", "q", "alpha")
# alpha, q, theta: a short period of about 3.3 rad/s and a slow real root, both seen in every output
A_S = np.array([[-1.5, 1.0, -0.2], [-8.0, -2.2, 0.3], [0.2, 1.0, -0.3]])
B_S = np.array([[-0.1], [-8.0], [0.0]])
A, B = cont2discrete((A_S, B_S, np.eye(3), np.zeros((3, 1))), DT)[:2]
C = np.eye(3)[[2, 1, 0]]

SPECS = {
    "dsr_e": DsrE(method="dsr_e", past_horizon=8, future_horizon=6, order=3),
    "transfer_function": TransferFunctions(method="transfer_function", poles=3, zeros=(0, 1, 2)),
}
METHOD = pytest.mark.parametrize("method", list(METHODS))


def flight(seed, n=300, noise=0.0):
    rng = np.random.default_rng(seed)
    u = 0.05 * np.repeat(rng.standard_normal((n // 3 + 1, 1)), 3, axis=0)[:n]
    x, y = 0.1 * rng.standard_normal(3), np.empty((n, 3))
    for k in range(n):
        y[k] = C @ x
        x = A @ x + B @ u[k]
    y = y + noise * y.std(axis=0) * rng.standard_normal(y.shape)
    return FlightRecord(np.arange(n) * DT, (*INPUTS, *OUTPUTS), np.hstack([u, y]), "measured")


def run(method, records, outputs=OUTPUTS, validation=None):
    judges = [flight(99)] if validation is None else validation
    return estimate(SPECS[method], records, INPUTS, outputs, judges)


def response(omega):
    z = np.exp(1j * omega * DT)[:, None, None]
    return C @ np.linalg.solve(z * np.eye(3) - A, B.astype(complex))


def sort(s):
    s = np.asarray(s, complex)
    return s[np.lexsort((np.round(s.imag, 7), np.round(s.real, 7)))]


def same_poles(one, other, relative):
    assert one.keys() == other.keys()
    for name in one:
        a, b = sort(one[name]), sort(other[name])
        assert a.shape == b.shape
        assert np.all(np.abs(a - b) <= relative * np.abs(b).max())


def test_every_method_is_in_this_contract():
    assert set(SPECS) == set(METHODS)
    assert all(text and text == text.strip() for text in METHODS.values())


@METHOD
def test_exact_data_are_recovered(method):
    model = run(method, [flight(1), flight(2, n=200)])
    assert isinstance(model, IdentifiedModel)
    assert (model.method, model.inputs, model.outputs) == (method, INPUTS, OUTPUTS)
    assert model.dt_s == pytest.approx(DT)
    true = sort(np.linalg.eigvals(A_S))
    for poles in model.poles().values():
        assert np.abs(sort(poles) - true).max() < 1e-8
    omega = np.geomspace(0.05, 0.95 * np.pi / DT, 40)
    found, expected = model.frequency_response(omega), response(omega)
    assert found.shape == (40, 3, 1)
    assert np.all(np.abs(found - expected) < 1e-8 * np.abs(expected).max(axis=(0, 2))[:, None])
    unseen = flight(3)
    y = unseen.columns(OUTPUTS)
    assert np.abs(model.simulate(unseen) - y).max() < 1e-8 * np.abs(y).max()


@METHOD
def test_poles_are_named_by_the_outputs(method):
    names = list(run(method, [flight(1)]).poles())
    assert ", ".join(names) == ", ".join(OUTPUTS)


@METHOD
def test_the_order_of_records_does_not_matter(method):
    records = [flight(1, noise=0.05), flight(2, n=240, noise=0.05), flight(4, n=150, noise=0.05)]
    one, other = run(method, records), run(method, records[::-1])
    same_poles(one.poles(), other.poles(), 1e-9)
    omega = np.geomspace(0.1, 20.0, 20)
    a, b = one.frequency_response(omega), other.frequency_response(omega)
    assert np.abs(a - b).max() < 1e-9 * np.abs(a).max()


@METHOD
def test_two_records_are_not_one_record_glued_together(method):
    exact = [flight(1, n=90), flight(2, n=90)]
    split = run(method, exact)
    for poles in split.poles().values():
        assert np.abs(sort(poles) - sort(np.linalg.eigvals(A_S))).max() < 1e-8
    glued = FlightRecord(np.arange(180) * DT, exact[0].channels, np.vstack([r.data for r in exact]), "measured")
    wrong = run(method, [glued])
    assert any(np.abs(sort(p)[:1] - sort(np.linalg.eigvals(A_S))[:1]).max() > 1e-6 for p in wrong.poles().values())


@METHOD
def test_channels_in_another_order_change_nothing(method):
    r = flight(1, noise=0.05)
    model = run(method, [r])
    shuffled = r.select(("alpha", "de", "theta", "q"))
    again = run(method, [shuffled])
    same_poles(model.poles(), again.poles(), 1e-12)
    turned = run(method, [r], outputs=("q", "alpha", "theta"))
    omega = np.geomspace(0.1, 20.0, 20)
    a = model.frequency_response(omega)[:, [1, 2, 0]]
    assert np.abs(a - turned.frequency_response(omega)).max() < 1e-8 * np.abs(a).max()


@METHOD
@pytest.mark.parametrize("channel", ["de", "q"])
def test_units_do_not_matter(method, channel):
    def scaled(record):
        return record.with_columns({channel: 1000.0 * record[channel]})

    r, judge = flight(1, noise=0.05), flight(99)
    model = run(method, [r], validation=[judge])
    other = run(method, [scaled(r)], validation=[scaled(judge)])
    same_poles(model.poles(), other.poles(), 1e-6)
    factor = np.where(np.array(OUTPUTS) == channel, 1000.0, 1.0)[:, None] / (1000.0 if channel == "de" else 1.0)
    omega = np.geomspace(0.1, 20.0, 20)
    a, b = factor * model.frequency_response(omega), other.frequency_response(omega)
    assert np.all(np.abs(a - b) < 1e-6 * np.abs(a).max(axis=0))


@METHOD
def test_the_same_records_give_the_same_bytes(method):
    records = [flight(1, noise=0.05), flight(2, noise=0.05)]
    one, other = run(method, records), run(method, records)
    assert pickle.dumps(one.to_dict()) == pickle.dumps(other.to_dict())
    assert np.array_equal(one.simulate(records[0]), other.simulate(records[0]))


@METHOD
def test_a_model_survives_pickling_and_keeps_its_records_unchanged(method):
    r = flight(1, noise=0.05)
    before = r.data.tobytes()
    model = run(method, [r])
    assert r.data.tobytes() == before
    again = pickle.loads(pickle.dumps(model))
    assert np.array_equal(again.simulate(r), model.simulate(r))


@METHOD
def test_status_goes_with_advice(method):
    for noise in (0.0, 0.05, 3.0):
        model = run(method, [flight(1, noise=noise)])
        assert (model.status == "warning") == bool(model.advice)


@METHOD
def test_truth_is_refused(method):
    with pytest.raises(EstimationError, match="measured records only, got one of kind 'truth'"):
        run(method, [flight(1), replace(flight(2), kind="truth")])


@METHOD
def test_an_input_that_never_moves_is_refused(method):
    r = flight(1)
    with pytest.raises(EstimationError, match="input 'de' never moves"):
        run(method, [r.with_columns({"de": np.full(len(r), 0.02)})])


@METHOD
def test_too_little_data_are_refused(method):
    with pytest.raises(EstimationError, match="more data"):
        run(method, [flight(1, n=300).between(0.0, 1.4)])
    with pytest.raises(EstimationError, match="at least one record"):
        run(method, [])


@METHOD
def test_missing_channels_and_mixed_rates_are_refused(method):
    with pytest.raises(ChannelError, match="needs channel 'beta'"):
        estimate(SPECS[method], [flight(1)], INPUTS, ("q", "beta"), [])
    with pytest.raises(EstimationError, match="at least one output"):
        estimate(SPECS[method], [flight(1)], INPUTS, (), [])
    with pytest.raises(EstimationError, match="share one sample time"):
        run(method, [flight(1), flight(2).decimate(2)])


def test_unknown_method_is_refused():
    with pytest.raises(EstimationError, match="did you mean 'dsr_e'"):
        estimate(type("Spec", (), {"method": "dsr"})(), [flight(1)], INPUTS, OUTPUTS)


def test_importing_the_table_does_not_import_scipy():
    code = "import sys, testbench.estimators; print('scipy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
