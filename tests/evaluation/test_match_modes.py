"""Modes found without an input beside true ones: which stands for which, and how far two may lie apart."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from testbench.estimators.operational.result import OperationalMode
from testbench.evaluation.operational import TrueMode, match_modes, true_modes
from testbench.flight import LinearModel

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
