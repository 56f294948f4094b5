"""Rows of input fits: modes in blocks against every state on its own, errors against those of the free run."""

import numpy as np
import pytest

from testbench.estimators import state_space
from testbench.estimators import state_space as driven_module
from testbench.estimators.state_space import DrivenModes, Series, fit_inputs, free_run, output_rows, released
from testbench.estimators.trajectories import Modes


def states(kind):
    if kind == "two pairs":
        return np.array(
            [[0.95, 0.1, 0.0, 0.0], [-0.1, 0.95, 0.0, 0.0], [0.0, 0.3, 0.99, 0.05], [0.0, 0.0, -0.05, 0.98]]
        )
    if kind == "real and a pair":
        return np.array([[0.9, 0.3, 0.0], [-0.3, 0.9, 0.1], [0.0, 0.1, -0.4]])
    return np.array([[1.05, 0.2, 0.0], [0.1, 0.8, 0.0], [0.0, 0.3, 0.9]])  # grows by 1e30 and more over the record


def data(kind, samples=3000, noise=0.1):
    rng = np.random.default_rng(3)
    A = states(kind)
    C = rng.standard_normal((2, len(A)))
    u = rng.standard_normal((samples, 2))
    y = rng.standard_normal((samples, 2)) if kind == "growing" else noise * rng.standard_normal((samples, 2))
    if kind != "growing":
        y = y + free_run(A, rng.standard_normal((len(A), 2)), C, np.ones((2, 2)), Series(u, y, np.ones(y.shape, bool)))
    return A, C, u, y


@pytest.mark.parametrize("kind", ["two pairs", "real and a pair", "growing"])
def test_signals_obey_their_recursion_over_blocks_and_chunks(kind):
    A, _, u, _ = data(kind, samples=700)
    signals = DrivenModes(A, Modes(A, 700), u)
    out = np.empty((signals.signals, 704))
    signals.write(0, 700, out)
    later = np.empty((signals.signals, 400))
    signals.write(304, 700, later)
    assert np.abs(later[:, :396] - out[:, 304:700]).max() < 1e-12 * np.abs(out[:, :700]).max()
    z = np.linalg.eig(A)[0]
    g = out[:, :700].reshape(len(A), 3, 700)
    at = 0
    for pole in z[z.imag >= 0.0]:
        w = g[at] - 1j * g[at + 1] if pole.imag > 0.0 else g[at]
        drive = np.vstack([np.zeros(700), u.T])
        error = w[:, 1:] - (pole if pole.imag else pole.real) * w[:, :-1] - drive[:, :-1]
        assert np.abs(error).max() < 1e-12 * max(np.abs(w).max(), 1.0)
        at += 2 if pole.imag > 0.0 else 1


@pytest.mark.parametrize("kind", ["two pairs", "real and a pair", "growing"])
@pytest.mark.parametrize("lead", [0, 2])
@pytest.mark.parametrize("masks", ["all", "one", "two"])
def test_rows_equal_those_of_every_state_on_its_own(kind, lead, masks):
    A, C, u, y = data(kind)
    valid = np.ones(y.shape, bool)
    rng = np.random.default_rng(4)
    if masks != "all":
        valid[rng.random(len(y)) < 0.2] = False
    if masks == "two":
        valid[rng.random(len(y)) < 0.1, 1] = False
    through = np.array([1])
    modes = Modes(A, len(u))
    fast = output_rows(A, C, modes, Series(u, y, valid), through, lead)
    plain = state_space._plain_rows(A, C, Series(u, y, valid), through, lead)
    # initial states count in other coordinates; what they leave of the rest is the same
    own = len(A) + 2 * lead
    left = [np.linalg.qr(np.vstack(rows), mode="r")[own:, own:] for rows in (fast, plain)]
    gram = [R.T @ R for R in left]
    assert np.abs(gram[0] - gram[1]).max() < 1e-10 * np.abs(gram[1]).max()
    norms = [[np.linalg.norm(R[:, -1]) for R in rows] for rows in (fast, plain)]
    assert norms[0] == pytest.approx(norms[1], rel=1e-12)


def test_exact_outputs_are_not_squared(monkeypatch):
    A, C, u, y = data("two pairs", noise=0.0)
    valid = np.ones(y.shape, bool)
    folded = []
    fold = driven_module.fold
    monkeypatch.setattr(driven_module, "fold", lambda R, rows: folded.append(1) or fold(R, rows))
    fit = fit_inputs(A, C, [Series(u, y, valid)], np.array([True, True]))
    assert folded
    assert np.sqrt(fit.error(fit.B, fit.D, np.array([True, True]))) < 1e-11 * np.linalg.norm(y)
    folded.clear()
    fit_inputs(A, C, [Series(u, y + 0.1 * np.random.default_rng(1).standard_normal(y.shape), valid)], np.ones(2, bool))
    assert not folded


def test_a_silent_input_moves_nothing():
    A, C, u, y = data("real and a pair")
    silent = np.hstack([u, np.zeros((len(u), 1))])
    valid = np.ones(y.shape, bool)
    fit = fit_inputs(A, C, [Series(silent, y, valid)], np.array([True, True, True]))
    other = fit_inputs(A, C, [Series(u, y, valid)], np.array([True, True]))
    assert np.abs(fit.B[:, :2] - other.B).max() < 1e-10
    assert np.abs(fit.B[:, 2]).max() < 1e-12  # of all B that leave the same error, the shortest
    assert np.abs(fit.D[:, 2]).max() < 1e-12


@pytest.mark.parametrize("kind", ["two pairs", "growing"])
@pytest.mark.parametrize("lead", [0, 1])
def test_free_run_errors_are_those_of_the_free_run(kind, lead):
    A, C, u, y = data(kind)
    y = y * [1.0, 30.0]  # outputs weigh by their size
    rng = np.random.default_rng(5)
    valid = rng.random(y.shape) > 0.1
    series = [Series(u[:2000], y[:2000], valid[:2000]), Series(u[2000:], y[2000:], valid[2000:])]
    every = np.array([True, True])
    fit = fit_inputs(A, C, series, every, lead)
    B, D = fit.B + 0.01 * rng.standard_normal(fit.B.shape), 0.9 * fit.D
    expected = np.zeros(2)
    for part in series:
        error = part.y - free_run(A, B, C, D, part, lead)
        expected += np.sum(error**2, axis=0, where=part.valid)
    assert fit.free_run_errors(B, D, every) == pytest.approx(expected, rel=1e-9)


def test_released_modes_are_powers_of_the_state_matrix():
    A, C, _, _ = data("two pairs")
    modes = Modes(A, 300)
    start = np.array([1.0, -2.0, 0.5, 3.0])
    y = released(A, C, modes, 300, start)
    x = np.linalg.lstsq(np.vstack([C @ np.linalg.matrix_power(A, k) for k in range(8)]), y[:8].ravel(), rcond=None)[0]
    for k in (0, 15, 16, 17, 299):
        assert np.abs(y[k] - C @ np.linalg.matrix_power(A, k) @ x).max() < 1e-11 * np.abs(y).max()
