"""Targets of other parameters, where they are known in closed form, and which samples of a simulated record count."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from testbench.estimators.parametric import output_error
from testbench.information import monte_carlo
from testbench.information.targets import Targets, targets


def matrices(p):
    """A mode of frequency p[0] and damping ratio p[1] beside one of 20 rad/s and 0.02 that stays."""
    A = np.zeros((4, 4), np.result_type(p, float))
    A[0, 1] = A[2, 3] = 1.0
    A[1, 0], A[1, 1] = -(p[0] ** 2), -2.0 * p[1] * p[0]
    A[3, 2], A[3, 3] = -400.0, -0.8
    return SimpleNamespace(A=A)


STRUCTURE = SimpleNamespace(matrices=matrices, parameter_names=("w", "z"))


@pytest.mark.parametrize("zeta", [0.4, 0.98, 1.2])
def test_targets_and_slopes_of_other_parameters(zeta):
    """The mode that is followed may have split into two real roots; the other mode may not be taken for it."""
    near = (-3.0 + 1.0j) if zeta < 1.0 else (-5.6 + 0.0j, -1.6 + 0.0j)
    modes = {"short period": near}
    aim = Targets(("zeta of short period", "w", "wn of short period"), None, None, None, modes)
    p = np.array([3.0, zeta])
    np.testing.assert_allclose(aim.at(STRUCTURE, p), [zeta, 3.0, 3.0], rtol=1e-12)
    np.testing.assert_allclose(aim.slopes(STRUCTURE, p), [[0.0, 1.0], [1.0, 0.0], [1.0, 0.0]], atol=1e-7)
    np.testing.assert_allclose(aim.slopes(STRUCTURE, p, [1]), [[0.0, 1.0], [0.0, 0.0], [0.0, 0.0]], atol=1e-7)


def test_a_mode_that_splits_into_a_root_that_grows_has_no_frequency():
    aim = Targets(("wn of m", "zeta of m"), None, None, None, {"m": (-2.0 + 0.0j, 1.0 + 0.0j)})
    grows = SimpleNamespace(matrices=lambda p: SimpleNamespace(A=np.diag([-2.0, 1.0])), parameter_names=())
    assert np.isnan(aim.at(grows, np.zeros(0))).all()


def test_a_real_root_is_a_frequency_without_a_damping_ratio():
    def of(p):
        A = np.zeros((*np.shape(p)[:-1], 2, 2), np.result_type(p))
        A[..., 0, 0], A[..., 1, 1] = p[..., 0], -3.0
        return SimpleNamespace(A=A)

    one = SimpleNamespace(
        matrices=of,
        parameter_names=("a",), parameters=("a",), true=np.array([-0.5]), A0=np.diag([-0.5, -3.0]),
    )  # fmt: skip
    found = targets(one, {"a": 0.1}, {"subsidence": -0.5 + 0.0j}, (0.02, 0.03))
    assert found.names == ("a", "wn of subsidence")
    np.testing.assert_allclose(found.values, [-0.5, 0.5])
    np.testing.assert_allclose(found.wanted, [0.05, 0.01])
    np.testing.assert_allclose(found.jacobian, [[1.0], [-1.0]])
    np.testing.assert_allclose(found.gradient, [[20.0], [-100.0]])


def test_simulated_records_hold_the_samples_that_each_sensor_gives(monkeypatch):
    seen = []

    def estimate(records, structure, **settings):
        seen.append((records[0], settings))
        return SimpleNamespace(params=np.array([float(len(seen))]))

    monkeypatch.setattr(output_error, "estimate", estimate)
    y = np.arange(24.0).reshape(12, 2)
    monkeypatch.setattr(monte_carlo, "respond", lambda *args: SimpleNamespace(y=y))
    structure = SimpleNamespace(true=None, states=("q",), parameters=("a",), inputs=("de",), outputs=("alpha", "q"))
    sensors = (SimpleNamespace(rate_hz=10.0), SimpleNamespace(rate_hz=None))
    experiment = SimpleNamespace(
        structure=structure, samples=12, sensors=sensors, dt_s=0.02, sigma=np.array([0.0, 0.5])
    )
    u = np.linspace(0.0, 1.0, 12)[:, None]
    found = monte_carlo.estimates(experiment, u, 2, 7)
    assert found.tolist() == [[1.0], [2.0]]
    (first, settings), (second, _) = seen
    assert np.flatnonzero(first.valid[:, 1]).tolist() == [0, 5, 10]
    assert first.valid[:, [0, 2]].all()
    np.testing.assert_allclose(first.t_s, 0.02 * np.arange(12))
    np.testing.assert_array_equal(first["alpha"], y[:, 0])
    noise = np.random.default_rng(7).standard_normal((2, 12, 2))[:, :, 1]
    np.testing.assert_allclose([first["q"], second["q"]], y[:, 1] + 0.5 * noise)
    assert settings == {"initial_states": "zero", "output_biases": ("alpha", "q"), "held": ("de",)}
