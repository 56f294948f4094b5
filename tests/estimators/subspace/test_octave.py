"""MOESP and N4SID against SLICOT's (GNU Octave, control package), on the same data; stored results."""

import json
from functools import cache

import numpy as np
import pytest

from testbench.core.record import FlightRecord
from testbench.estimators.settings import Subspace
from testbench.estimators.subspace.family import PREDICTORS, PROJECTIONS, estimate
from tests.reference.octave_subspace import CASES, HORIZON, STORED, data


@cache
def poles_z(name, method, seed=None):
    u, y = data(name)
    if seed is not None:  # another draw of the noise
        A, B, C, noise = CASES[name]
        x, clean = np.zeros(len(A)), np.empty_like(y)
        for k in range(len(u)):
            clean[k] = C @ x
            x = A @ x + B @ u[k]
        y = clean + noise * clean.std(axis=0) * np.random.default_rng(seed).standard_normal(y.shape)
    inputs, outputs = ("de", "da")[: u.shape[1]], ("alpha", "q", "p")[: y.shape[1]]
    r = FlightRecord(np.arange(len(u)) * 1.0, (*inputs, *outputs), np.hstack([u, y]), "measured")
    model = estimate(
        [r],
        inputs,
        outputs,
        Subspace(
            method=method,
            past_horizon=HORIZON,
            future_horizon=HORIZON,
            order=len(CASES[name][0]),
            direct_feedthrough=True,
        ),
    )
    return np.sort_complex(np.linalg.eigvals(model.A).astype(complex))


def stored(name, oracle):
    pairs = np.array(json.loads(STORED.read_text(encoding="utf-8"))[f"{name}_{oracle}"])
    return np.sort_complex(pairs[:, 0] + 1j * pairs[:, 1])


@pytest.mark.parametrize("oracle", ["moen4", "n4sid"])
@pytest.mark.parametrize("name", ["second_exact", "fourth_exact"])
@pytest.mark.parametrize("method", [*PROJECTIONS, *PREDICTORS])
def test_exact_data_give_the_same_poles(oracle, name, method):
    expected = stored(name, oracle)
    assert np.abs(expected - np.sort_complex(np.linalg.eigvals(CASES[name][0]).astype(complex))).max() < 1e-9
    assert np.abs(poles_z(name, method) - expected).max() < 1e-6


@pytest.mark.sampled(3)
@pytest.mark.parametrize("oracle", ["moen4", "n4sid"])
@pytest.mark.parametrize("name", ["second_noisy", "fourth_noisy"])
@pytest.mark.parametrize("method", [*PROJECTIONS, *PREDICTORS])
def test_noisy_data_give_the_same_poles_within_the_scatter(oracle, name, method):
    # The scatter is that of the method itself over six other draws of the noise. Two methods on one draw share most of
    # their error; three deviations between them is therefore wide.
    true = np.sort_complex(np.linalg.eigvals(CASES[name][0]).astype(complex))
    scatter = np.sqrt(np.mean([np.abs(poles_z(name, method, seed) - true) ** 2 for seed in range(6)], axis=0))
    assert scatter.max() < 0.01
    assert np.all(np.abs(poles_z(name, method) - stored(name, oracle)) < 3.0 * scatter)
