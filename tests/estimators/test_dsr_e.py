"""DSR_e: exact recovery, second implementations, consistency, and right or warned on flight-test inputs."""

import os
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat
from scipy.signal import chirp, cont2discrete

from testbench.errors import EstimationError
from testbench.estimators.dsr_e import estimate
from testbench.record import FlightRecord

G0 = 9.80665


def simulate(A, B, C, D, u, x0=None, w=None):
    x = np.zeros(len(A)) if x0 is None else np.array(x0, float)
    y = np.empty((len(u), len(C)))
    for k in range(len(u)):
        y[k] = C @ x + D @ u[k]
        x = A @ x + B @ u[k] + (0.0 if w is None else w[k])
    return y


def sampled(A, B, dt):
    n = len(A)
    return cont2discrete((A, B, np.eye(n), np.zeros((n, B.shape[1]))), dt)[:2]


def short_period(wn=3.0, zeta=0.617):
    """States alpha, q; wn = 3 rad/s and zeta = 0.617 unless told."""
    Za = -1.2
    Mq = -2.0 * zeta * wn - Za
    return np.array([[Za, 1.0], [Za * Mq - wn**2, Mq]]), np.array([[-0.1], [-8.0]])


def longitudinal():
    """States V, alpha, q, theta at 16 m/s: short period 4.5 rad/s and 0.75, phugoid 0.65 rad/s and 0.02.

    XV, ZV, M_alpha and Mq were solved for from these four figures with the other entries given.
    """
    A = np.array(
        [
            [-0.10632383, 4.0, 0.0, -G0],
            [-0.10096251, -3.5, 1.0, 0.0],
            [0.0, -8.64113787, -3.16967617, 0.0],
            [0.0, 0.0, 1.0, 0.0],
        ]
    )
    return A, np.array([[0.0], [-0.3], [-25.0], [0.0]])


def multistep_3211(dt, duration, step, amplitude, start=2.0):
    t = np.arange(0.0, duration - 1e-9, dt)
    edges = start + step * np.array([0.0, 3.0, 5.0, 6.0, 7.0])
    u = np.zeros(t.size)
    for begin, end, sign in zip(edges[:-1], edges[1:], (1, -1, 1, -1), strict=True):
        u[(t >= begin - 1e-9) & (t < end - 1e-9)] = sign * amplitude
    return u[:, None]


def flight_test_inputs(dt=0.02, duration=30.0):
    t = np.arange(0.0, duration - 1e-9, dt)
    rng = np.random.default_rng(0)

    def multisine(f):
        return np.cos(2 * np.pi * np.outer(t, f) - np.pi * np.arange(f.size) ** 2 / f.size).sum(axis=1)

    signals = {
        "3211": multistep_3211(dt, duration, 0.5, 1.0)[:, 0],
        "prbs": np.repeat(rng.choice([-1.0, 1.0], size=200), round(0.2 / dt))[: t.size],
        "sweep": chirp(t, 0.05, duration, 2.5),
        "multisine of 20 lines": multisine(np.linspace(0.1, 2.0, 20)),
        "multisine of 60 lines": multisine(np.arange(1, 61) / 30.0),
    }
    return {name: (0.05 * u / np.abs(u).max())[:, None] for name, u in signals.items()}


def record(dt, u, y, inputs, outputs, valid=None):
    return FlightRecord(np.arange(len(u)) * dt, (*inputs, *outputs), np.hstack([u, y]), "measured", valid=valid)


def poles_of(model):
    (poles,) = model.poles().values()
    return poles[np.lexsort((poles.imag, poles.real))]


def sort(s):
    s = np.asarray(s, complex)
    return s[np.lexsort((s.imag, s.real))]


def pole_error(model, A):
    """Largest relative error of a pole against the eigenvalues of the continuous A; inf if their number differs."""
    found, true = poles_of(model), sort(np.linalg.eigvals(A))
    if found.size != true.size:
        return np.inf
    return float(np.min([np.max(np.abs(p - true) / np.abs(true)) for p in (found, sort(found.conj()))]))


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
        past_horizon=6,
        future_horizon=6,
        order=order,
        direct_feedthrough=direct,
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
        past_horizon=6,
        future_horizon=6,
        order=4,
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
        past_horizon=20,
        future_horizon=20,
        order=2,
    )
    second = np.log(sort(_textbook(u, y, 20, 20, 2, weighted=True))) / dt
    # same data, other weights of the outputs: they differ by a part of the scatter, which is 0.3 % here
    assert np.abs(poles_of(model) - sort(second)).max() < 0.01 * 3.0


# --- noise ------------------------------------------------------------------------------------------------------------


def _innovations_system():
    A = np.array([[0.9, 0.2], [-0.2, 0.85]])
    return A, np.array([[0.2], [1.0]]), np.eye(2), np.array([[0.5, 0.1], [0.0, 0.3]])


def _innovations_record(n, rng):
    A, B, C, K = _innovations_system()
    u = np.repeat(rng.choice([-1.0, 1.0], size=(n // 5 + 1, 1)), 5, axis=0)[:n]
    e = 0.3 * rng.standard_normal((n, 2))
    y = simulate(A, B, C, np.zeros((2, 1)), u, w=e @ K.T) + e
    return record(0.1, u, y, ("de",), ("alpha", "q"))


def test_scatter_shrinks_with_the_number_of_samples():
    # A consistent estimate's root mean square error falls by 4 from 500 to 8000 samples. From 40 and 12 records, with
    # at least as many degrees of freedom, a ratio outside 2 to 8 has a probability below 1e-2; the seed is fixed.
    z = sort(np.linalg.eigvals(_innovations_system()[0]))
    error = {}
    for n, count in ((500, 40), (8000, 12)):
        rng = np.random.default_rng(0)
        errors = []
        for _ in range(count):
            r = _innovations_record(n, rng)
            model = estimate([r], ("de",), ("alpha", "q"), past_horizon=10, future_horizon=5, order=2)
            errors.append(np.abs(sort(np.linalg.eigvals(model.A)) - z))
        error[n] = float(np.sqrt(np.mean(np.square(errors))))
    assert 2.0 < error[500] / error[8000] < 8.0
    assert error[8000] < 0.0015


def test_innovations_gain_and_deviation_are_consistent():
    A, B, C, K = _innovations_system()
    model = estimate(
        [_innovations_record(20_000, np.random.default_rng(8))],
        ("de",),
        ("alpha", "q"),
        past_horizon=10,
        future_horizon=5,
        order=2,
    )
    # C A^k K and C A^k B do not depend on the basis of the state; sampling error of a gain ~ 1/sqrt(20000) = 0.7 %,
    # so 0.05 is some 7 of them
    for k in range(4):
        power, found = np.linalg.matrix_power(A, k), np.linalg.matrix_power(model.A, k)
        assert np.abs(model.C @ found @ model.K - C @ power @ K).max() < 0.05
        assert np.abs(model.C @ found @ model.B - C @ power @ B).max() < 0.05
    assert model.diagnostics["innovations_std"] == pytest.approx([0.3, 0.3], rel=0.03)


@pytest.mark.parametrize("name", list(flight_test_inputs()))
@pytest.mark.parametrize("block", [10, 20])
def test_right_on_flight_test_inputs_where_other_codes_fail_in_silence(name, block):
    # Short period of 3 rad/s, 50 Hz, 30 s, 5 % noise, order 2. Over 20 seeds the pole's root mean square error is at
    # most 1.3 % and its largest 2.6 % (multisine of 20 lines, block 10): 4 % is three deviations, the seed is fixed.
    dt = 0.02
    A, B = sampled(*short_period(), dt)
    u = flight_test_inputs()[name]
    y = simulate(A, B, np.eye(2), np.zeros((2, 1)), u)
    y = y + 0.05 * y.std(axis=0) * np.random.default_rng(block).standard_normal(y.shape)
    model = estimate(
        [record(dt, u, y, ("de",), ("alpha", "q"))],
        ("de",),
        ("alpha", "q"),
        past_horizon=block,
        future_horizon=block,
        order=2,
    )
    assert pole_error(model, short_period()[0]) < 0.04
    excited = name in ("3211", "prbs")
    assert (model.status == "good") is excited
    assert any("do not excite" in sentence for sentence in model.advice) is not excited


@pytest.mark.parametrize("name", list(flight_test_inputs()))
@pytest.mark.parametrize("output", ["alpha", "q"])
@pytest.mark.parametrize("block", [10, 20, 50])
def test_one_output_is_right_or_warned(name, output, block):
    dt = 0.02
    A, B = sampled(*short_period(), dt)
    u = flight_test_inputs()[name]
    y = simulate(A, B, np.eye(2), np.zeros((2, 1)), u)
    y = y + 0.05 * y.std(axis=0) * np.random.default_rng(3).standard_normal(y.shape)
    model = estimate(
        [record(dt, u, y, ("de",), ("alpha", "q"))],
        ("de",),
        (output,),
        past_horizon=block,
        future_horizon=block,
        order=2,
    )
    assert model.status == "warning" or pole_error(model, short_period()[0]) < 0.05


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


def _aircraft_record(seed, dt=0.01):
    A, B = sampled(*longitudinal(), dt)
    u = multistep_3211(dt, 25.0, 0.4, np.radians(4.0))
    noise = np.array([0.2, np.radians(0.2), np.radians(0.3), np.radians(0.3)])
    y = simulate(A, B, np.eye(4), np.zeros((4, 1)), u)
    y = y + noise * np.random.default_rng(seed).standard_normal(y.shape)
    return record(dt, u, y, ("de",), ("V", "alpha", "q", "theta"))


@pytest.mark.parametrize("seed", [0, 1])
def test_short_future_horizon_at_a_high_rate_hides_the_short_period_without_alpha(seed):
    # the EOLO paper's horizons J = 200, L = 4 at 100 Hz: 0.04 s cannot show a mode of 4.5 rad/s in V, q and theta
    flown = _aircraft_record(seed)
    short = estimate([flown], ("de",), ("V", "q", "theta"), past_horizon=200, future_horizon=4, order=4)
    assert pole_error(short, longitudinal()[0]) > 0.3
    assert short.status == "warning"
    assert any("above the noise floor" in s for s in short.advice)
    automatic = estimate([flown], ("de",), ("V", "q", "theta"), past_horizon=200, future_horizon=4)
    assert automatic.order == 3
    assert automatic.status == "warning"
    # the largest error of 10 seeds is 2.3 % without alpha and 2.7 % with it
    longer = estimate([flown], ("de",), ("V", "q", "theta"), past_horizon=80, future_horizon=50)
    assert longer.order == 4
    assert pole_error(longer, longitudinal()[0]) < 0.08
    alpha = estimate([flown], ("de",), ("V", "alpha", "q", "theta"), past_horizon=50, future_horizon=50)
    assert alpha.order == 4
    assert alpha.status == "good"
    assert pole_error(alpha, longitudinal()[0]) < 0.05


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
    model = estimate([spoilt], ("de",), ("alpha", "q"), past_horizon=8, future_horizon=6)
    assert model.order == 2
    assert pole_error(model, short_period()[0]) < 1e-8
    assert model.diagnostics["columns"] == 600 - 8 - 10 - 9 * 3
    valid[::5, 1] = False
    with pytest.raises(EstimationError, match=r"dropped for invalid samples.*slowest sensor"):
        estimate(
            [record(dt, u, y, ("de",), ("alpha", "q"), valid=valid)],
            ("de",),
            ("alpha", "q"),
            past_horizon=8,
            future_horizon=6,
        )


def test_too_little_data_and_wrong_settings_are_refused():
    rng = np.random.default_rng(5)
    r = record(0.1, rng.standard_normal((60, 1)), rng.standard_normal((60, 2)), ("de",), ("alpha", "q"))
    with pytest.raises(EstimationError, match="past_horizon = 20 gives 60 unknowns per output, got 40 columns"):
        estimate([r], ("de",), ("alpha", "q"), past_horizon=20, future_horizon=3)
    with pytest.raises(EstimationError, match="future_horizon = 10 gives 50 rows, got 46 columns"):
        estimate([r], ("de",), ("alpha", "q"), past_horizon=5, future_horizon=10)
    with pytest.raises(EstimationError, match="past_horizon >= 1 and future_horizon >= 2"):
        estimate([r], ("de",), ("alpha", "q"), past_horizon=5, future_horizon=1)
    with pytest.raises(EstimationError, match="= 4 must hold, got 5"):
        estimate([r], ("de",), ("alpha", "q"), past_horizon=5, future_horizon=3, order=5)
    still = record(0.1, rng.standard_normal((60, 1)), np.zeros((60, 2)), ("de",), ("alpha", "q"))
    with pytest.raises(EstimationError, match="channel 'alpha' must move"):
        estimate([still], ("de",), ("alpha", "q"), past_horizon=5, future_horizon=3)


def test_near_interpolation_and_pure_noise_are_warned_or_refused():
    rng = np.random.default_rng(6)
    noise = record(0.1, rng.standard_normal((2000, 1)), rng.standard_normal((2000, 2)), ("de",), ("alpha", "q"))
    # the largest singular value of noise alone, over 300 seeds: 0.84 +- 0.10 floors, 1.24 at most; 2 are needed
    with pytest.raises(EstimationError, match="no state stands out of the noise"):
        estimate([noise], ("de",), ("alpha", "q"), past_horizon=10, future_horizon=5)
    forced = estimate([noise], ("de",), ("alpha", "q"), past_horizon=10, future_horizon=5, order=2)
    assert forced.status == "warning"
    assert any("do not use it to predict" in s for s in forced.advice)
    tight = _innovations_record(200, rng)
    model = estimate([tight], ("de",), ("alpha", "q"), past_horizon=40, future_horizon=5, order=2)
    assert any("nearly interpolates: 120 unknowns per output from 160 columns" in s for s in model.advice)


def test_long_records_need_no_gigabytes():
    rng = np.random.default_rng(7)
    long = _innovations_record(100_000, rng)
    tracemalloc.start()
    model = estimate([long], ("de",), ("alpha", "q"), past_horizon=60, future_horizon=10, order=2)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # the whole past alone would take 100 000 x 180 doubles = 144 MB, twice that with its projection
    assert peak < 200e6
    assert np.abs(sort(np.linalg.eigvals(model.A)) - sort(np.linalg.eigvals(_innovations_system()[0]))).max() < 0.005


# --- flight -----------------------------------------------------------------------------------------------------------


def _attas():
    root = Path(os.environ.get("TESTBENCH_FLIGHT_DATA", Path(__file__).parents[2].parent / "shared" / "flight_data"))
    records = []
    for name in ("fAttasElv1", "fAttasElv2"):
        file = root / "attas" / f"{name}.mat"
        if not file.is_file():
            pytest.skip(f"{file} is missing; set TESTBENCH_FLIGHT_DATA to the folder of the flight data")
        table = loadmat(file)[name]
        data = np.radians(table[:, [21, 12, 7]])  # columns 22, 13 and 8, counted from 1
        records.append(FlightRecord(table[:, 0], ("de", "alpha", "q"), data - data.mean(axis=0), "measured"))
    return records


@pytest.mark.parametrize(("J", "L"), [(5, 5), (10, 10), (20, 20), (30, 30), (60, 60)])
def test_attas_short_period(J, L):
    """Jategaonkar's output-error result for both elevator records is wn 2.53 rad/s and zeta 0.493."""
    model = estimate(_attas(), ("de",), ("alpha", "q"), past_horizon=J, future_horizon=L, order=2)
    pole = poles_of(model)[-1]
    assert abs(pole) == pytest.approx(2.53, rel=0.05)
    assert -pole.real / abs(pole) == pytest.approx(0.493, abs=0.08)
    assert np.all(model.diagnostics["output_error_percent"] < 10.0)


def test_attas_order_is_found():
    assert estimate(_attas(), ("de",), ("alpha", "q"), past_horizon=20, future_horizon=20).order == 2
