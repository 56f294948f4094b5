"""Poles are matched to modes by the shortest total distance.

Modes found without an input beside true ones: which stands for which, and how far two may lie apart.

A mode that has split into two real roots: its names, its frequency, and what is said of it.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from testbench.estimators.operational.result import OperationalMode
from testbench.estimators.settings import DsrE
from testbench.evaluation.excitation import excitation
from testbench.evaluation.modes import damping, frequency_of, match_poles, roots_of
from testbench.evaluation.operational import TrueMode, match_modes, true_modes
from testbench.flight import LinearModel
from testbench.questions.run.result import alpha_findings


def pole(wn, zeta):
    return complex(-zeta * wn, wn * np.sqrt(1.0 - zeta**2))


MODES = {"phugoid": pole(0.65, 0.02), "short period": pole(4.5, 0.75)}


def test_errors_of_frequency_and_damping():
    found = [pole(4.725, 0.70), pole(4.725, 0.70).conjugate(), pole(0.65, 0.05).conjugate(), pole(0.65, 0.05)]
    phugoid, short = match_poles(found, MODES, "V, q")
    assert (phugoid.name, short.name) == ("phugoid", "short period")
    assert phugoid.wn_error_percent == pytest.approx(0.0, abs=1e-9)
    assert phugoid.zeta_error == pytest.approx(0.03)
    assert short.wn_error_percent == pytest.approx(5.0)
    assert short.zeta_error == pytest.approx(-0.05)
    assert short.found == pytest.approx(pole(4.725, 0.70))
    assert short.true == MODES["short period"]
    assert short.outputs == "V, q"


def test_no_pole_stands_for_two_modes_and_a_far_one_for_none():
    found = [pole(0.66, 0.02), pole(80.0, 0.3)]
    phugoid, short = match_poles(found, MODES)
    assert phugoid.found == pytest.approx(found[0])
    assert short.found is None
    assert short.wn_error_percent is None
    assert short.zeta_error is None
    assert all(m.found is None for m in match_poles([], MODES))
    assert match_poles(found, {}) == []


def test_assignment_is_the_best_for_all_modes_together():
    # greedy by the first mode would take 1.2 for "a" (nearer than 0.8 in ratio) and leave 0.8 to "b"
    a, b = match_poles([complex(-0.8), complex(-1.2)], {"a": complex(-1.0), "b": complex(-1.5)})
    assert a.found == pytest.approx(-0.8)
    assert b.found == pytest.approx(-1.2)


def test_split_unstable_and_integrating_modes():
    split = match_poles([complex(-3.5), complex(-6.0)], {"short period": MODES["short period"]})[0]
    assert split.found == pytest.approx(-3.5)  # |ln(3.5 / 4.5)| < |ln(6 / 4.5)|
    assert split.zeta_error == pytest.approx(0.25)
    unstable = match_poles([pole(0.65, -0.01)], {"phugoid": MODES["phugoid"]})[0]
    assert unstable.zeta_error == pytest.approx(-0.03)
    lower = match_poles([pole(0.65, 0.02)], {"phugoid": MODES["phugoid"].conjugate()})[0]
    assert lower.wn_error_percent == pytest.approx(0.0, abs=1e-9)
    origin = match_poles([0j, complex(-1e-9)], {"heading": 0j})[0]
    assert origin.found is not None
    assert origin.wn_error_percent is None
    assert damping(0j) == 0.0


SCALE = np.array([2.0, 0.1, 5.0])
SHAPES = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0].T.astype(complex)


def found(pole: complex, scaled: np.ndarray) -> OperationalMode:
    return OperationalMode(pole, 0.0, 0.0, 0.0, scaled * SCALE, scaled, (4,))


def true(name: str, pole: complex, scaled: np.ndarray) -> TrueMode:
    return TrueMode(name, pole, scaled * SCALE)


def matches(modes: list[OperationalMode], truth: list[TrueMode]) -> list[tuple[str | None, int | None]]:
    result = SimpleNamespace(modes=tuple(modes), scale=SCALE)
    return [(m.true.name if m.true else None, m.index) for m in match_modes(result, truth)]


def test_shapes_decide_between_close_poles_and_are_compared_as_the_result_scales_them() -> None:
    truth = [true("a", -0.1 + 3.0j, SHAPES[0]), true("b", -0.1 + 3.1j, SHAPES[1])]
    modes = [found(-0.1 + 3.0j, SHAPES[1]), found(-0.1 + 3.1j, SHAPES[0]), found(-0.2 + 9.0j, SHAPES[2])]
    pairs = match_modes(SimpleNamespace(modes=tuple(modes), scale=SCALE), truth)
    assert [(m.true.name if m.true else None, m.index) for m in pairs] == [("a", 1), ("b", 0), (None, 2)]
    assert [m.mac for m in pairs] == [pytest.approx(1.0), pytest.approx(1.0), None]
    assert pairs[0].found is modes[1]


def test_the_distance_counts_frequency_damping_and_shape_up_to_six_tenths() -> None:
    one = [true("a", -0.1 + 3.0j, SHAPES[0])]
    for apart in (0.59, 0.61):
        near = apart < 0.6
        by_frequency = found(np.exp(apart) * one[0].pole, SHAPES[0])
        turned = np.sqrt(1.0 - apart) * SHAPES[0] + np.sqrt(apart) * SHAPES[1]
        by_shape = found(one[0].pole, turned)
        by_both = found(
            np.exp(0.5 * apart) * one[0].pole, np.sqrt(1 - 0.5 * apart) * SHAPES[0] + np.sqrt(0.5 * apart) * SHAPES[1]
        )
        for mode in (by_frequency, by_shape, by_both):
            assert (("a", 0) in matches([mode], one)) == near
            if not near:
                assert set(matches([mode], one)) == {("a", None), (None, 0)}
    assert matches([], one) == [("a", None)]
    assert matches([by_shape], []) == [(None, 0)]


def test_true_modes_are_the_oscillations_of_both_motions_with_their_shapes_at_the_sensors() -> None:
    states = ("u", "w", "q", "theta", "v", "p", "r", "phi")
    A = np.zeros((8, 8))
    for (i, j), wn, zeta in (((0, 3), 0.5, 0.05), ((1, 2), 4.0, 0.5), ((4, 6), 2.0, 0.1)):
        A[np.ix_([i, j], [i, j])] = [[0.0, 1.0], [-(wn**2), -2.0 * zeta * wn]]
    A[5, 5], A[7, 7] = -8.0, -0.01
    C = np.random.default_rng(3).normal(size=(3, 8))
    linear = LinearModel(A, np.zeros((8, 1)), C, np.zeros((3, 1)), states, ("de",), ("q", "az", "p"))
    modes = true_modes(linear, {}, {}, ("p", "q"))
    assert [m.name for m in modes] == ["phugoid", "Dutch roll", "short period"]
    for mode, (i, j), wn, zeta in zip(modes, ((0, 3), (4, 6), (1, 2)), (0.5, 2.0, 4.0), (0.05, 0.1, 0.5), strict=True):
        assert mode.pole == pytest.approx(wn * complex(-zeta, np.sqrt(1.0 - zeta**2)))
        shape = C[[2, 0]][:, i] + mode.pole * C[[2, 0]][:, j]
        assert mode.shape[1] / mode.shape[0] == pytest.approx(shape[1] / shape[0])


SPLIT = {"phugoid": -0.003 + 0.5j, "short period, slow root": -1.6 + 0j, "short period, fast root": -7.3 + 0j}


def test_roots_of_a_mode_go_by_its_name():
    assert list(roots_of(SPLIT, "short period")) == ["short period, slow root", "short period, fast root"]
    assert roots_of(SPLIT, "phugoid") == {"phugoid": SPLIT["phugoid"]}
    assert frequency_of(SPLIT, "short period") == pytest.approx(np.sqrt(1.6 * 7.3))
    assert frequency_of({"short period": 3.0 + 4.0j}, "short period") == pytest.approx(5.0)
    assert frequency_of(SPLIT, "Dutch roll") is None


def case(outputs, found):
    evaluation = SimpleNamespace(
        poles=match_poles(found, SPLIT, ", ".join(outputs)),
        validation=SimpleNamespace(mrse_percent=np.full(len(outputs), 10.0)),
    )
    estimator = DsrE(method="dsr_e", order=4, past_horizon=20, future_horizon=4)
    return SimpleNamespace(estimator=estimator, model=SimpleNamespace(outputs=outputs), evaluation=evaluation)


def test_what_alpha_bought_is_said_root_by_root():
    without, with_alpha = case(("q",), [0.5j, -1.9]), case(("q", "alpha"), [0.5j, -1.7, -7.0])
    (text,) = alpha_findings([without, with_alpha])
    assert "the slow root of its short period is -1.90 1/s without alpha, -1.70 1/s with alpha (true -1.60 1/s)" in text
    assert "the fast root of its short period is not found without alpha, -7.00 1/s with alpha (true -7.30" in text
    (text,) = alpha_findings([without, case(("q", "alpha"), [0.5j, -1.7])])
    assert "the fast root of its short period is not found, with or without alpha (true -7.30 1/s)" in text


def test_the_band_of_a_real_root_is_that_of_a_lag():
    """Response to a short pulse of area 1: y = exp(s t), half power at |s|, all of the pulse's energy spread evenly."""
    s, dt, T = -2.0, 0.01, 20.0
    u = np.zeros((int(T / dt), 1))
    u[0] = 1.0 / dt
    one = np.ones((1, 1))
    model = LinearModel(s * one, one, one, 0.0 * one, ("x",), ("de",), ("q",))
    (found,) = excitation(model, {"lag": complex(s)}, ["de"], u, dt, {"q": (0.1, dt)}, T)
    low, high = found.band_rad_s
    assert (low, high) == pytest.approx((0.05 * 2.0, 2.0))
    energy = (np.arctan(high / 2.0) - np.arctan(low / 2.0)) / 2.0 / np.pi
    noise = 0.1**2 * T * dt * (high - low) / np.pi
    assert found.snr_db["q"] == pytest.approx(10.0 * np.log10(energy / noise), abs=0.01)
    assert "lag (real, -2.00 1/s) is excited" in found.sentence
