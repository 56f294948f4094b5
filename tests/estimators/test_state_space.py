"""StateSpaceModel: free runs against the plain recursion, unstable models, frequency response, export."""

import json

import numpy as np
import pytest

from testbench.core.errors import EstimationError, RecordError
from testbench.core.record import FlightRecord
from testbench.estimators.hankel import cholesky_factor, fold, triangle
from testbench.estimators.state_space import Series, StateSpaceModel, fit_inputs
from testbench.estimators.trajectories import Trajectories, carried

DT = 0.05


def model(A, **changes):
    n = len(A)
    rng = np.random.default_rng(5)
    settings = {
        "method": "dsr_e",
        "inputs": ("de", "thr"),
        "outputs": ("alpha", "q", "V"),
        "dt_s": DT,
        "A": A,
        "B": rng.standard_normal((n, 2)),
        "C": rng.standard_normal((3, n)) * [[1.0], [1.0], [100.0]],
        "D": rng.standard_normal((3, 2)),
    }
    return StateSpaceModel(**{**settings, **changes})


def stable():
    return np.array([[0.9, 0.3, 0.0, 0.0], [-0.3, 0.9, 0.1, 0.0], [0.0, 0.0, 0.7, 0.2], [0.0, 0.1, 0.0, -0.4]])


def recursion(m, u, x):
    y = np.empty((len(u), 3))
    for k in range(len(u)):
        y[k] = m.C @ x + m.D @ u[k]
        x = m.A @ x + m.B @ u[k]
    return y


def record(u, y, dt=DT, valid=None):
    return FlightRecord(
        np.arange(len(u)) * dt, ("de", "thr", "alpha", "q", "V"), np.hstack([u, y]), "measured", valid=valid
    )


@pytest.mark.parametrize(
    "A",
    [
        stable(),
        np.array([[1.0, 1.0], [0.0, 1.0]]),  # a double integrator: one Jordan block
        np.array([[0.95]]),
        np.array([[0.5, 1.0, 0.0], [0.0, 0.5, 1.0], [0.0, 0.0, 0.5]]),
    ],
)
def test_free_run_with_estimated_start_equals_the_recursion(A):
    rng = np.random.default_rng(1)
    m = model(A)
    u = rng.standard_normal((200, 2))
    y = recursion(m, u, rng.standard_normal(len(A)))
    error = np.abs(m.simulate(record(u, y)) - y).max(axis=0)
    assert np.all(error < 1e-10 * np.abs(y).max(axis=0))  # 200 steps of rounding


def test_start_is_a_least_squares_estimate_over_valid_samples_only():
    rng = np.random.default_rng(2)
    m = model(stable())
    u = rng.standard_normal((300, 2))
    y = recursion(m, u, np.array([1.0, -2.0, 0.5, 3.0]))
    valid = np.ones((300, 5), bool)
    valid[rng.random((300, 5)) < 0.3] = False
    valid[:, 4] = False  # one output never sampled: still predicted
    spoilt = np.where(valid[:, 2:], y, 1e6)
    assert np.abs(m.simulate(record(u, spoilt, valid=valid)) - y).max() < 1e-9 * np.abs(y).max()


def test_unstable_model_is_run_without_loss_of_digits():
    # growth 1.05^1000 = 1.5e21: the plain recursion from an estimated x0 would keep no digit
    rng = np.random.default_rng(3)
    A = np.array([[1.05, 0.2], [0.1, 0.8]])
    paths = Trajectories(A, 1000)
    f = rng.standard_normal((1000, 2, 1))
    x, free = paths.forced(f), paths.free()
    assert np.abs(x[1:] - np.einsum("ij,kjb->kib", A, x[:-1]) - f[:-1]).max() < 1e-12 * np.abs(x).max()
    assert np.abs(free[1:] - np.einsum("ij,kjb->kib", A, free[:-1])).max() < 1e-12
    assert np.abs(x).max() < 1e3
    assert np.linalg.matrix_rank(free.reshape(-1, 2)) == 2
    m = model(A)
    u = rng.standard_normal((1000, 2))
    y = m.simulate(record(u, rng.standard_normal((1000, 3))))
    assert np.all(np.isfinite(y))
    # the free run is a trajectory of the model: it is its own best prediction
    assert np.abs(m.simulate(record(u, y)) - y).max() < 1e-8 * np.abs(y).max()


def test_long_record_is_simulated_quickly():
    rng = np.random.default_rng(4)
    m = model(stable())
    u = rng.standard_normal((100_000, 2))
    y = m.simulate(record(u, np.zeros((100_000, 3)) + 1e-3))
    assert y.shape == (100_000, 3)
    expected = recursion(m, u[:400], np.zeros(4))
    assert np.abs(y[:400] - expected)[300:].max() < 1e-4 * np.abs(expected).max()  # the start decays as 0.95^k


def test_fit_inputs_recovers_B_and_D_from_records_with_different_starts():
    rng = np.random.default_rng(6)
    m = model(stable())
    series = []
    for n in (60, 90):
        u = rng.standard_normal((n, 2))
        y = recursion(m, u, rng.standard_normal(4))
        series.append(Series(u, y, rng.random(y.shape) > 0.1))
    fit = fit_inputs(m.A, m.C, series, np.array([True, True]))
    assert np.abs(fit.B - m.B).max() < 1e-10
    assert np.abs(fit.D - m.D).max() < 1e-10
    every = np.array([True, True])
    assert fit.error(fit.B, fit.D, every) < 1e-16 < fit.error(1.1 * fit.B, fit.D, every)
    with pytest.raises(EstimationError, match="at least 14 samples"):
        fit_inputs(m.A, m.C, [Series(u[:5], y[:5], np.ones((5, 3), bool))], every)


def test_frequency_response_and_poles_equal_those_of_python_control():
    m = model(stable())
    omega = np.geomspace(0.1, np.pi / DT, 50)
    system = m.to_control()
    expected = np.moveaxis(system(np.exp(1j * omega * DT)), 2, 0)
    assert np.abs(m.frequency_response(omega) - expected).max() < 1e-10 * np.abs(expected).max()
    assert system.input_labels == ["de", "thr"]
    assert system.output_labels == ["alpha", "q", "V"]
    assert system.dt == DT
    (name, poles), *rest = m.poles().items()
    assert not rest
    assert name == "alpha, q, V"
    z = np.linalg.eigvals(stable())
    kept = z[~((np.abs(z.imag) < 1e-9) & (z.real <= 0.0))]  # z = -0.4 has no continuous counterpart
    assert kept.size == 3
    assert np.allclose(np.sort_complex(np.exp(poles * DT)), np.sort_complex(kept), rtol=1e-12)


def test_frequencies_above_nyquist_and_on_a_pole_are_refused():
    m = model(np.array([[1.0]]))
    with pytest.raises(EstimationError, match="Nyquist frequency"):
        m.frequency_response(np.array([64.0]))
    with pytest.raises(EstimationError, match="infinite at a pole"):
        m.frequency_response(np.array([0.0, 1.0]))


def test_to_dict_is_json_and_complete():
    m = model(stable(), settings={"order": None}, advice=("careful",))
    back = json.loads(json.dumps(m.to_dict()))
    assert np.array_equal(np.array(back["A"]), m.A)
    assert back["outputs"] == ["alpha", "q", "V"]
    assert back["status"] == "doubt"
    assert back["advice"] == [{"severity": "doubt", "code": "own", "sentence": "careful"}]
    assert back["settings"] == {"order": None}
    assert np.array_equal(np.array(back["K"]), np.zeros((4, 3)))


def test_wrong_shapes_and_sample_times_are_refused():
    with pytest.raises(EstimationError, match=r"B must be finite and of shape \(4, 2\)"):
        model(stable(), B=np.zeros((4, 3)))
    with pytest.raises(EstimationError, match="A must be finite"):
        model(np.array([[np.nan]]))
    with pytest.raises(RecordError, match="share their sample time"):
        model(stable()).simulate(record(np.ones((9, 2)), np.ones((9, 3)), dt=0.1))


def test_matrices_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        model(stable()).A[0, 0] = 1.0


@pytest.mark.parametrize("kind", ["independent", "a zero column", "dependent"])
def test_many_rows_fold_into_the_triangle_of_their_qr_decomposition(kind):
    rng = np.random.default_rng(4)
    rows = rng.standard_normal((2000, 5)) * [1.0, 1e4, 1e-5, 1.0, 3.0]
    if kind == "a zero column":
        rows[:, 3] = 0.0
    elif kind == "dependent":  # a Gram matrix would leave 1e-8 of the last column, QR leaves rounding
        rows[:, 4] = rows[:, 0] + rows[:, 3]
        assert cholesky_factor(rows.T @ rows) is None
    R = np.linalg.qr(rng.standard_normal((9, 5)), mode="r")
    one, other = fold(R, rows), triangle(R, rows)
    size = np.linalg.norm(other, axis=0)
    gram = [(r / np.where(size > 0.0, size, 1.0)).T @ (r / np.where(size > 0.0, size, 1.0)) for r in (one, other)]
    assert np.abs(gram[0] - gram[1]).max() < 1e-12
    if kind == "dependent":
        last = fold(np.zeros((0, 5)), rows)[-1, -1]
        assert abs(last) < 1e-12 * size[-1]


@pytest.mark.parametrize("samples", [1, 2, 3, 5, 100, 121, 122])
def test_stretches_carried_side_by_side_are_the_recursion_sample_by_sample(samples):
    rng = np.random.default_rng(samples)
    transition, force = 0.4 * rng.standard_normal((samples, 3, 3)), rng.standard_normal((samples, 3, 2))
    x = rng.standard_normal((3, 2))
    for k, row in enumerate(carried(transition, force, x)):
        assert row == pytest.approx(x, abs=1e-12)
        x = transition[k] @ x + force[k]
