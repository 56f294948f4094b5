"""Formulas inside the estimators one by one: each against a value worked out another way."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import cont2discrete

from testbench.estimators.equations import DEEPEST, ExpressionError, tree
from testbench.estimators.frequency.equivalent import sampled_response
from testbench.estimators.frequency.response import _conditioned
from testbench.estimators.operational.result import OperationalMode
from testbench.estimators.parametric.accuracy import own_poles
from testbench.estimators.parametric.servo import _Link
from testbench.estimators.residuals import LAG_SHARE, _score_over_gaps, corrected_covariance
from testbench.estimators.subspace.data import Stretch
from testbench.estimators.subspace.dsr_e import shortage
from testbench.estimators.subspace.family import _strides
from testbench.estimators.subspace.projections import factorise
from testbench.inference.terms import hat

RNG = np.random.default_rng(21)


@pytest.mark.parametrize("i", range(4))
def test_hats_over_the_past_add_up_to_a_straight_line_between_knots(i):
    knots, u = [0, 2, 5, 9], RNG.normal(size=40)
    out = hat(u, knots, i)
    weights = np.interp(np.arange(40.0), knots, np.eye(4)[i], right=0.0)
    expected = [sum(weights[lag] * u[k - lag] for lag in range(k + 1)) for k in range(40)]
    np.testing.assert_allclose(out, expected, atol=1e-12)


@pytest.mark.parametrize("n", [23, 40])
def test_the_score_over_gaps_is_the_double_sum_of_its_definition(n):
    p, k = 2, 3
    W, R = RNG.normal(size=(n, p, k)), RNG.normal(size=(n, p, p))
    R[0] = R[0] + R[0].T
    lag = n // LAG_SHARE
    expected = np.zeros((k, k))
    for i in range(n):
        for j in range(max(0, i - lag), min(n, i + lag + 1)):
            between = R[j - i] if j >= i else R[i - j].T
            expected += W[i].T @ between @ W[j]
    found = _score_over_gaps(W, R)
    close = [np.allclose(found, e, atol=1e-9) for e in (expected, expected.T)]  # which of two lags comes first
    assert any(close)


def test_a_covariance_between_two_scores_is_a_sandwich_without_negative_variances():
    A, B = RNG.normal(size=(2, 4, 4))
    plain, score = A @ A.T, B @ B.T
    plain[3], plain[:, 3] = 0.0, 0.0
    found = corrected_covariance(plain, score)
    np.testing.assert_allclose(found, plain @ score @ plain, rtol=1e-6, atol=1e-9 * np.abs(found).max())
    assert np.all(
        np.linalg.eigvalsh(corrected_covariance(plain, score - 3.0 * np.eye(4))) > -1e-9 * np.abs(found).max()
    )


def test_own_poles_are_those_before_the_followers():
    A = np.diag([-1.0, -2.0, -30.0, -40.0, -50.0])
    structure = SimpleNamespace(states=("w", "q", "s1", "s2", "s3"), followers=("s1", "s2", "s3"))
    model = SimpleNamespace(linear=lambda: SimpleNamespace(A=A), structure=structure)
    assert sorted(own_poles(model).real) == [-2.0, -1.0]


@pytest.mark.parametrize("kind", ["none", "lag", "second order"])
@pytest.mark.parametrize("delay", [False, True])
def test_a_servo_has_the_response_of_its_kind_behind_its_delay(kind, delay):
    tau, T, wn, zeta = 0.05, 0.04, 25.0, 0.7
    servo = SimpleNamespace(
        wn_rad_s=wn if kind == "second order" else None, zeta=zeta if kind == "second order" else None
    )
    link = _Link(0, "de", servo, 0 if kind == "lag" else None, 1 if delay else None)
    rates, surface = link.rows(np.array([tau, T]))
    n = len(link.states)
    assert len(rates) == n
    rows = np.array(rates).reshape(n, n + 1)
    A, B, C, D = rows[:, :n], rows[:, n], np.asarray(surface)[:n], np.asarray(surface)[n]
    for w in (0.5, 5.0, 30.0):
        s = 1j * w
        expected = {
            "none": 1.0,
            "lag": 1.0 / (tau * s + 1.0),
            "second order": wn**2 / (s**2 + 2 * zeta * wn * s + wn**2),
        }[kind]
        if delay:  # the second-order Pade approximation
            expected *= (1.0 - T * s / 2.0 + (T * s) ** 2 / 12.0) / (1.0 + T * s / 2.0 + (T * s) ** 2 / 12.0)
        assert D + C @ np.linalg.solve(s * np.eye(n) - A, B) == pytest.approx(expected)


@pytest.mark.parametrize("delay", [0.0, 0.02, 0.013, 0.047])
@pytest.mark.parametrize("unit", [1.0, 3.0])
def test_a_sampled_response_is_that_of_the_held_system_delayed(delay, unit):
    dt, a, b = 0.02, np.array([1.0, 2.4, 9.0]), np.array([0.3, 1.0, 4.0])
    w = np.array([0.5, 3.0, 40.0])
    whole = int(delay / dt + 1e-9)
    late = delay - whole * dt
    z = np.exp(1j * w * dt)
    A, B, C, D, _ = cont2discrete((np.array([[0.0, 1.0], [-9.0, -2.4]]), np.array([[0.0], [1.0]]),
                                   np.array([[4.0 - 0.3 * 9.0, 1.0 - 0.3 * 2.4]]), np.array([[0.3]])), dt)  # fmt: skip
    fine = 2000 if late > 1e-9 else 0
    if fine:  # the command changes ``late`` after each sample: the state is carried over both parts
        parts = [cont2discrete((np.array([[0.0, 1.0], [-9.0, -2.4]]), np.array([[0.0], [1.0]]), C, D), t)[:2]
                 for t in (dt - late, late)]  # fmt: skip
        (A1, B1), (A2, B2) = parts
        found = [C @ np.linalg.solve(x * np.eye(2) - A1 @ A2, B1 + A1 @ B2 / x) + 0.3 / x for x in z]
    else:
        found = [C @ np.linalg.solve(x * np.eye(2) - A, B) + D for x in z]
    expected = np.array(found).ravel() * z**-whole
    np.testing.assert_allclose(sampled_response(b, a, 1j * w, dt, delay, unit), expected, rtol=1e-9)


def test_responses_and_coherences_of_two_inputs_are_those_of_the_spectra():
    k, m = 5, 2
    L = RNG.normal(size=(k, m, m)) + 1j * RNG.normal(size=(k, m, m))
    Suu = L @ np.conj(L).transpose(0, 2, 1)
    H, noise = RNG.normal(size=(k, m)) + 1j * RNG.normal(size=(k, m)), 1.0 + RNG.random(k)
    S = np.zeros((k, 3, 3), complex)
    S[:, :2, :2] = Suu
    S[:, :2, 2] = (Suu @ H[:, :, None])[:, :, 0]
    S[:, 2, :2] = np.conj(S[:, :2, 2])
    driven = np.real(np.einsum("km,kmn,kn->k", np.conj(H), Suu, H))
    S[:, 2, 2] = driven + noise
    found, multiple, partial = _conditioned(S, m)
    np.testing.assert_allclose(found, H)
    np.testing.assert_allclose(multiple, driven / (driven + noise))
    for j, other in ((0, 1), (1, 0)):
        own = np.abs(H[:, j]) ** 2 * np.real(Suu[:, j, j] - np.abs(Suu[:, 0, 1]) ** 2 / Suu[:, other, other])
        np.testing.assert_allclose(partial[:, j], own / (own + noise))


@pytest.mark.parametrize(
    ("N", "past", "future", "short"),
    [
        # two inputs, three outputs; step 1 has N - past columns and past (2 + 3) + 3 rows
        (100, 4, 2, None),
        (26, 4, 2, (22, 23)),
        # step 2 has N - past - future + 1 columns and future (2 + 2 x 3) rows
        (60, 4, 6, None),
        (56, 4, 6, (47, 48)),
    ],
)
def test_too_few_columns_are_told_of_the_step_that_has_them(N, past, future, short):
    assert shortage([np.ones(N, bool)], 2, 3, past, future) == short


def test_strides_are_tried_from_the_longest_down_unless_one_is_given(monkeypatch):
    from testbench.estimators.subspace import family

    monkeypatch.setattr(family, "automatic_stride", lambda stretches, dt_s: 4)
    full = SimpleNamespace(exact=False, excitation=0.0)
    given = SimpleNamespace(decimate="auto", closed_loop=False)
    assert _strides([], full, given, 0.02) == [4, 3, 2, 1]
    assert _strides([], full, SimpleNamespace(decimate=3, closed_loop=False), 0.02) == [3]
    assert _strides([], SimpleNamespace(exact=True, excitation=0.0), given, 0.02) == [1]
    monkeypatch.setattr(family, "automatic_stride", lambda stretches, dt_s: 1)
    assert _strides([], full, given, 0.02) == [1]


def test_frequency_and_damping_of_a_mode_are_those_of_its_pole():
    mode = OperationalMode(-0.3 + 6.0j, 0.0, 0.0, 0.0, np.ones(1), np.ones(1), ())
    assert mode.frequency_hz == pytest.approx(np.hypot(0.3, 6.0) / (2.0 * np.pi))
    assert mode.damping == pytest.approx(0.3 / np.hypot(0.3, 6.0))


def test_an_expression_may_have_as_many_terms_as_is_said():
    tree("a" + "+a" * (DEEPEST - 1))
    with pytest.raises(ExpressionError, match=f"at most {DEEPEST} terms"):
        tree("a" + "+a" * (DEEPEST + 1))


@pytest.mark.parametrize(("H", "excited"), [(6, True), (7, False)])
def test_three_sines_excite_six_successive_samples_and_no_seventh(H, excited):
    """n sines are persistently exciting of order 2 n: one sample more is a combination of the others."""
    t = np.arange(400.0)
    u = np.sum([np.sin(w * t + w) for w in (0.4, 1.1, 2.0)], axis=0)[:, None]
    all_of_it = np.ones((t.size, 1), bool)
    stretch = Stretch(u, np.random.default_rng(3).normal(size=(t.size, 1)), all_of_it, all_of_it)
    found = factorise([stretch], 3, H, False, 0, "this method")
    assert (found.excitation > 1e-3) is excited
    assert excited or found.excitation < 1e-12
