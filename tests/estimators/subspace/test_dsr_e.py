"""DSR_e: exact recovery, agreement with a second implementation, and data that it must refuse or warn of."""

import tracemalloc

import numpy as np
import pytest
from dsr_e_systems import (
    flight_test_inputs,
    innovations_record,
    innovations_system,
    longitudinal,
    pole_error,
    poles_of,
    record,
    sampled,
    short_period,
    simulate,
    sort,
)

from testbench.core.errors import EstimationError
from testbench.estimators.hankel import BlockHankel
from testbench.estimators.settings import DsrE
from testbench.estimators.subspace.dsr_e import estimate


def response(A, B, C, D, omega, dt):
    z = np.exp(1j * omega * dt)[:, None, None]
    return C @ np.linalg.solve(z * np.eye(len(A)) - A, B.astype(complex)) + D


# --- exact data -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("direct", [False, True])
@pytest.mark.parametrize("order", [4, None])
def test_exact_data_give_the_exact_model(direct, order):
    rng = np.random.default_rng(1)
    dt = 0.05
    A, B = sampled(longitudinal()[0], np.hstack([longitudinal()[1], [[3.0], [0.0], [0.0], [0.0]]]), dt)
    C = np.eye(4)[:3]
    D = rng.standard_normal((3, 2)) if direct else np.zeros((3, 2))
    records = []
    for n in (300, 200):
        u = np.repeat(rng.standard_normal((n // 4, 2)), 4, axis=0)
        y = simulate(A, B, C, D, u, x0=rng.standard_normal(4))
        records.append(record(dt, u, y, ("de", "thr"), ("V", "alpha", "q")))
    model = estimate(
        records,
        ("de", "thr"),
        ("V", "alpha", "q"),
        DsrE(past_horizon=6, future_horizon=6, order=order, direct_feedthrough=direct),
    )
    assert model.order == 4
    assert model.status == "good"
    assert pole_error(model, longitudinal()[0]) < 1e-8
    omega = np.geomspace(0.1, 0.9 * np.pi / dt, 40)
    true = response(A, B, C, D, omega, dt)
    scale = np.abs(true).max(axis=(0, 2))[:, None]
    assert np.max(np.abs(model.frequency_response(omega) - true) / scale) < 1e-8
    assert np.all(model.K == 0.0)
    for r in records:
        y = r.columns(("V", "alpha", "q"))
        assert np.abs(model.simulate(r) - y).max() < 1e-8 * np.abs(y).max()


# --- a second implementation ------------------------------------------------------------------------------------------


def _hankel(z, start, rows, columns):
    return np.vstack([z[start + i : start + i + columns].T for i in range(rows)])


def _textbook(u, y, J, L, n, weighted):
    """DSR_e with explicit projections, after its description: poles z of one record.

    weighted: Di Ruscio's Z_{J|L} and A from A~ Z_{J|L} = Z_{J+1|L}; else the oblique projection and N4SID's states.
    """
    m, columns = u.shape[1], len(u) - J
    W = np.vstack([_hankel(u, 0, J, columns), _hankel(y, 0, J, columns)])
    Y = y[J:].T
    yd = Y @ np.linalg.pinv(W, rcond=1e-10) @ W
    e = Y - yd
    noisy = np.linalg.norm(e) > 1e-9 * np.linalg.norm(Y)
    v = np.vstack([u[J:].T, e]).T if noisy else u[J:]
    yd = yd.T
    columns = len(v) - L - 1
    if weighted:
        U = _hankel(v, 0, L + 1, columns)
        Z = _hankel(yd, 0, L + 1, columns)
        Z = Z - Z @ np.linalg.pinv(U, rcond=1e-10) @ U
        p = y.shape[1]
        U1 = np.linalg.svd(Z[:-p], full_matrices=False)[0][:, :n]
        return np.linalg.eigvals(U1.T @ Z[p:] @ np.linalg.pinv(U1.T @ Z[:-p]))
    W = W[:, : len(v)]

    def oblique(start, rows):
        U, past = _hankel(v, start, rows, columns), W[:, start : start + columns]
        Yf = _hankel(yd, start, rows, columns)
        clear = np.eye(columns) - np.linalg.pinv(U, rcond=1e-10) @ U
        return Yf @ clear @ np.linalg.pinv(past @ clear, rcond=1e-10) @ past

    P = oblique(0, L)
    left, s, _ = np.linalg.svd(P, full_matrices=False)
    O_L = left[:, :n] * np.sqrt(s[:n])
    X = np.linalg.pinv(O_L) @ P
    following = np.linalg.pinv(O_L[: -y.shape[1]]) @ oblique(1, L - 1)
    both = np.vstack([X, v[:columns].T])
    assert both.shape[0] == n + m + (y.shape[1] if noisy else 0)
    return np.linalg.eigvals((following @ np.linalg.pinv(both, rcond=1e-12))[:, :n])


@pytest.mark.parametrize("weighted", [True, False])
def test_explicit_projections_agree_on_exact_data(weighted):
    rng = np.random.default_rng(2)
    dt = 0.1
    A, B = sampled(*longitudinal(), dt)
    u = np.repeat(rng.standard_normal((100, 1)), 3, axis=0)
    y = simulate(A, B, np.eye(4)[:3], np.zeros((3, 1)), u, x0=rng.standard_normal(4))
    model = estimate(
        [record(dt, u, y, ("de",), ("V", "alpha", "q"))],
        ("de",),
        ("V", "alpha", "q"),
        DsrE(past_horizon=6, future_horizon=6, order=4),
    )
    second = _textbook(u, y / y.std(axis=0), 6, 6, 4, weighted)
    assert np.allclose(sort(np.linalg.eigvals(model.A)), sort(second), rtol=0.0, atol=1e-8)
    assert np.allclose(sort(second), sort(np.linalg.eigvals(A)), rtol=0.0, atol=1e-8)


def test_explicit_projections_agree_on_noisy_data_within_the_noise():
    dt = 0.02
    A, B = sampled(*short_period(), dt)
    u = flight_test_inputs()["prbs"]
    y = simulate(A, B, np.eye(2), np.zeros((2, 1)), u)
    y = y / y.std(axis=0) + 0.05 * np.random.default_rng(3).standard_normal(y.shape)
    model = estimate(
        [record(dt, u, y, ("de",), ("alpha", "q"))],
        ("de",),
        ("alpha", "q"),
        DsrE(past_horizon=20, future_horizon=20, order=2),
    )
    second = np.log(sort(_textbook(u, y, 20, 20, 2, weighted=True))) / dt
    # same data, other weights of the outputs: they differ by a part of the scatter, which is 0.3 % here
    assert np.abs(poles_of(model) - sort(second)).max() < 0.01 * 3.0


def test_unweighted_oblique_projection_fails_on_a_sweep():
    # the reason for the weight: the same data, the same projections, no weight
    dt = 0.02
    A, B = sampled(*short_period(), dt)
    u = flight_test_inputs()["sweep"]
    y = simulate(A, B, np.eye(2), np.zeros((2, 1)), u)
    y = y / y.std(axis=0) + 0.05 * np.random.default_rng(10).standard_normal(y.shape)
    plain = np.log(_textbook(u, y, 10, 10, 2, weighted=False).astype(complex)) / dt
    weighted = np.log(_textbook(u, y, 10, 10, 2, weighted=True).astype(complex)) / dt
    true = sort(np.linalg.eigvals(short_period()[0]))
    assert np.abs(sort(plain) - true).max() > 3.0
    assert np.abs(sort(weighted) - true).max() < 0.2


# --- data -------------------------------------------------------------------------------------------------------------


def test_invalid_samples_do_not_touch_the_estimate():
    rng = np.random.default_rng(4)
    dt = 0.05
    A, B = sampled(*short_period(), dt)
    u = np.repeat(rng.standard_normal((150, 1)), 4, axis=0)
    y = simulate(A, B, np.eye(2), np.zeros((2, 1)), u)
    valid = np.ones((600, 3), bool)
    valid[[60, 61, 180, 300, 470], [1, 1, 2, 2, 1]] = False
    spoilt = record(dt, u, np.where(valid[:, 1:], y, 1e4), ("de",), ("alpha", "q"), valid=valid)
    model = estimate([spoilt], ("de",), ("alpha", "q"), DsrE(past_horizon=8, future_horizon=6))
    assert model.order == 2
    assert pole_error(model, short_period()[0]) < 1e-8
    assert model.diagnostics["columns"] == 600 - 8 - 10 - 9 * 3
    valid[::5, 1] = False
    with pytest.raises(EstimationError, match=r"dropped for invalid samples.*slowest sensor"):
        estimate(
            [record(dt, u, y, ("de",), ("alpha", "q"), valid=valid)],
            ("de",),
            ("alpha", "q"),
            DsrE(past_horizon=8, future_horizon=6),
        )


def test_too_little_data_and_wrong_settings_are_refused():
    rng = np.random.default_rng(5)
    r = record(0.1, rng.standard_normal((60, 1)), rng.standard_normal((60, 2)), ("de",), ("alpha", "q"))
    with pytest.raises(EstimationError, match="past_horizon = 20 gives 60 unknowns per output, got 40 columns"):
        estimate([r], ("de",), ("alpha", "q"), DsrE(past_horizon=20, future_horizon=3))
    with pytest.raises(EstimationError, match="future_horizon = 10 gives 50 rows, got 46 columns"):
        estimate([r], ("de",), ("alpha", "q"), DsrE(past_horizon=5, future_horizon=10))
    with pytest.raises(EstimationError, match="future_horizon: must be greater than or equal to 2, got 1"):
        estimate([r], ("de",), ("alpha", "q"), DsrE(past_horizon=5, future_horizon=1))
    with pytest.raises(EstimationError, match="= 4 must hold, got 5"):
        estimate([r], ("de",), ("alpha", "q"), DsrE(past_horizon=5, future_horizon=3, order=5))
    still = record(0.1, rng.standard_normal((60, 1)), np.zeros((60, 2)), ("de",), ("alpha", "q"))
    with pytest.raises(EstimationError, match="channel 'alpha' must move"):
        estimate([still], ("de",), ("alpha", "q"), DsrE(past_horizon=5, future_horizon=3))


def test_near_interpolation_and_pure_noise_are_warned_or_refused():
    rng = np.random.default_rng(6)
    noise = record(0.1, rng.standard_normal((2000, 1)), rng.standard_normal((2000, 2)), ("de",), ("alpha", "q"))
    # the largest singular value of noise alone, over 300 seeds: 0.84 +- 0.10 floors, 1.24 at most; 2 are needed
    with pytest.raises(EstimationError, match="no state exceeds the noise"):
        estimate([noise], ("de",), ("alpha", "q"), DsrE(past_horizon=10, future_horizon=5))
    forced = estimate([noise], ("de",), ("alpha", "q"), DsrE(past_horizon=10, future_horizon=5, order=2))
    assert forced.status != "good"
    assert any("do not use it to predict" in s for s in forced.advice)
    tight = innovations_record(200, rng)
    model = estimate([tight], ("de",), ("alpha", "q"), DsrE(past_horizon=40, future_horizon=5, order=2))
    assert any("nearly interpolates: 120 unknowns per output from 160 columns" in s for s in model.advice)


def test_long_records_need_no_gigabytes():
    rng = np.random.default_rng(7)
    long = innovations_record(100_000, rng)
    tracemalloc.start()
    model = estimate([long], ("de",), ("alpha", "q"), DsrE(past_horizon=60, future_horizon=10, order=2))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # 19 MB; the whole past alone would take 100 000 x 180 doubles = 144 MB, twice that with its projection
    assert peak < 8 * long.data.nbytes
    assert np.abs(sort(np.linalg.eigvals(model.A)) - sort(np.linalg.eigvals(innovations_system()[0]))).max() < 0.005


@pytest.mark.parametrize(
    ("direct", "offset", "variant"),
    [(False, "none", "original"), (True, "trend", "original"), (False, "none", "eolo"), (False, "trend", "eolo")],
)
def test_long_records_take_all_steps_from_one_gram_matrix_with_the_same_result(monkeypatch, direct, offset, variant):
    r = innovations_record(4000, np.random.default_rng(3))
    settings = {"past_horizon": 10, "future_horizon": 6, "order": 2, "offset": offset}
    settings |= {"direct_feedthrough": direct, "variant": variant}
    short = estimate([r], ("de",), ("alpha", "q"), DsrE(**settings))
    calls = []
    monkeypatch.setattr(BlockHankel, "quick", lambda *a: calls.append(a))  # None: not possible
    long = estimate([r], ("de",), ("alpha", "q"), DsrE(**settings))
    assert calls
    assert np.abs(poles_of(short) - poles_of(long)).max() < 1e-8
    a, b = (m.diagnostics["singular_values"] for m in (short, long))
    assert a == pytest.approx(b, rel=1e-6)
    assert short.diagnostics["columns_step_2"] == long.diagnostics["columns_step_2"]
    assert short.advice == long.advice
    for name in ("pole_shift_past", "pole_shift_future", "output_error_percent", "output_error_deterministic_B"):
        assert short.diagnostics[name] == pytest.approx(long.diagnostics[name], rel=1e-7)
    if offset == "none":
        y = r.columns(("alpha", "q"))
        percent = 100.0 * np.linalg.norm(y - long.simulate(r), axis=0) / np.linalg.norm(y, axis=0)
        assert long.diagnostics["output_error_percent"] == pytest.approx(percent, rel=1e-9)
