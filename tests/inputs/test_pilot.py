"""Steps flown by hand: ramps, scattered edges, and a shortest step."""

import numpy as np
import pytest

from testbench.core.errors import ScenarioError
from testbench.core.scenario.inputs import Doublet, Pilot, Pulse, StandardMultistep
from testbench.inputs import build

DE = {"control": "de", "amplitude_deg": 1.0, "start_s": 1.0}
RATE = 100.0


def flown(pilot, **other):
    spec = StandardMultistep(signal="3211", step_s=1.0, pilot=pilot, **{**DE, **other})
    return build([spec], 12.0, RATE).u[:, 0] / spec.amplitude


def test_a_pilot_without_faults_flies_the_exact_steps():
    np.testing.assert_allclose(flown(Pilot()), flown(None), atol=1e-12)


def test_edges_are_ramps_that_begin_at_their_time():
    u = flown(Pilot(rise_s=0.5))
    t = np.arange(u.size) / RATE
    np.testing.assert_allclose(u[(t >= 1.0) & (t <= 1.5)], (t[(t >= 1.0) & (t <= 1.5)] - 1.0) / 0.5, atol=1e-9)
    np.testing.assert_allclose(u[(t > 1.5) & (t <= 4.0)], 1.0, atol=1e-12)
    np.testing.assert_allclose(u[(t >= 4.5) & (t <= 6.0)], -1.0, atol=1e-9)
    np.testing.assert_allclose(u[t >= 8.5], 0.0, atol=1e-9)


def test_jitter_moves_edges_by_its_size_and_is_the_same_for_the_same_seed():
    first = [np.flatnonzero(flown(Pilot(jitter_s=0.1, seed=s)) < 0.0)[0] / RATE - 4.0 for s in range(200)]
    # standard deviation of 200 deviates: 5 % of itself; 4 of those
    assert np.std(first) == pytest.approx(0.1, rel=0.2)
    np.testing.assert_array_equal(flown(Pilot(jitter_s=0.1, seed=3)), flown(Pilot(jitter_s=0.1, seed=3)))


@pytest.mark.parametrize("rise_s", [0.0, 0.25])
def test_every_edge_is_late_by_the_documented_draws_cut_off_at_four_tenths(rise_s):
    jitter = 0.3
    draws = jitter * np.random.default_rng(5).standard_normal(4)
    # of the edges at 4, 6, 7 and 8 s the shorter neighbouring steps last 2, 1, 1 and 1 s
    edges = [
        1.0,
        *(np.array([4.0, 6.0, 7.0, 8.0]) + np.clip(draws, *(np.array([[-0.4], [0.4]]) * [2.0, 1.0, 1.0, 1.0]))),
    ]
    t, expected = np.arange(1200) / RATE, np.zeros(1200)
    for edge, jump in zip(edges, (1.0, -2.0, 2.0, -2.0, 1.0), strict=True):
        expected += jump * (np.clip((t - edge) / rise_s, 0.0, 1.0) if rise_s else t - edge >= 0.0)
    np.testing.assert_allclose(flown(Pilot(jitter_s=jitter, seed=5, rise_s=rise_s)), expected, atol=1e-6)


def test_no_edge_changes_places_however_unsteady_the_pilot():
    for seed in range(50):
        u = flown(Pilot(jitter_s=5.0, seed=seed))
        assert np.count_nonzero(np.diff(u)) == 5, "3-2-1-1 has five edges"


def test_a_pause_between_doublets_stays_a_pause():
    spec = Doublet(signal="doublet", period_s=2.0, repeats=2, spacing_s=4.0, pilot=Pilot(), **DE)
    exact = spec.model_copy(update={"pilot": None})
    np.testing.assert_allclose(build([spec], 12.0, RATE).u, build([exact], 12.0, RATE).u, atol=1e-15)


def test_a_step_may_last_as_long_as_the_shortest_and_as_its_rise():
    u = flown(Pilot(shortest_s=1.0, rise_s=1.0))
    np.testing.assert_allclose(u[[100, 200, 400, 500, 700, 800, 900]], [0.0, 1.0, 1.0, -1.0, 1.0, -1.0, 0.0], atol=1e-6)


def test_steps_too_short_to_hold_are_refused():
    with pytest.raises(ScenarioError, match=r"at least 2 s .*shortest_s.*got 1 s from t = 6 s"):
        flown(Pilot(shortest_s=2.0))
    with pytest.raises(ScenarioError, match=r"at least 0.6 s"):
        build([Pulse(signal="pulse", width_s=0.5, pilot=Pilot(rise_s=0.6), **DE)], 12.0, RATE)
