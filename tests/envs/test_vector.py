"""Copies that fly together against as many single environments: every output, all ends, modes, masks and refusals."""

import warnings
from functools import partial

import numpy as np
import pytest

from testbench.core.errors import LimitError, ScenarioError
from testbench.envs import register

gymnasium = pytest.importorskip("gymnasium", reason="the extra 'envs' is not installed")

from gymnasium.vector import AutoresetMode, SyncVectorEnv  # noqa: E402

from testbench.envs import vector  # noqa: E402
from testbench.envs.dynamics import why_alone  # noqa: E402
from testbench.envs.excitation import LEVELS, ExcitationDesign  # noqa: E402
from testbench.envs.vector import ExcitationDesigns  # noqa: E402
from testbench.flight.batch.check import Judged  # noqa: E402
from testbench.sensors import Sensor  # noqa: E402
from testbench.sensors.kinds import SurfacePosition  # noqa: E402

COPIES = 3
SUITE = """
title = "rates"
rate_hz = 20.0
sensor = [
{ channel = "p", unit = "deg/s", noise_std = 1.0, lag_s = 0.05, delay_s = 0.11, dropout = 0.2, part="x", source = "x" },
{ channel = "r", unit = "deg/s", noise_std = 0.2, rate_hz = 5.0, part = "x", source = "x" },
{ channel = "da", unit = "deg", noise_std = 0.2, part = "x", source = "x" },
{ channel = "dr", unit = "deg", noise_std = 0.2, part = "x", source = "x" },
]
"""
DESIGN = """
title = "two controls"
aircraft = "taurus"
suites = ["{suite}"]
controls = ["da", "dr"]
duration_s = 12.0
shortest_step_s = 0.25
condition = {{ V_m_s = 12.0, h_m = 100.0 }}
targets = {{ parameters = {{ L_p = 5.0, N_r = 5.0 }} }}
"""


def pair(mode=AutoresetMode.NEXT_STEP, **arguments):
    singles = SyncVectorEnv([partial(ExcitationDesign, **arguments)] * COPIES, autoreset_mode=mode)
    return singles, ExcitationDesigns(COPIES, autoreset_mode=mode, **arguments)


def same(truth, found):
    """Assert that infos are alike: keys, kinds and values."""
    assert set(truth) == set(found)
    for key, value in truth.items():
        if isinstance(value, dict):
            same(value, found[key])
        elif value.dtype == object:
            for a, b in zip(value, found[key], strict=True):
                if isinstance(a, np.ndarray):
                    np.testing.assert_allclose(b, a, rtol=0.0, atol=1e-7)
                else:
                    assert a == b
        else:
            assert value.dtype == found[key].dtype, key
            np.testing.assert_allclose(found[key], value, rtol=1e-9, atol=1e-9, err_msg=key)


def levels(envs, rng, size):
    space = envs.single_action_space
    if not isinstance(space, gymnasium.spaces.Box):
        return rng.integers(0, len(LEVELS) + 1, (COPIES, *space.shape))
    return rng.uniform(-size, size, (COPIES, *space.shape)).astype(np.float32)


def fly_both(singles, together, steps, size=0.9, hold=6):
    """Fly both and assert that they are alike; return how many flights were terminated and truncated."""
    rng, ends = np.random.default_rng(0), np.zeros(2, int)
    (a, ia), (b, ib) = singles.reset(seed=7), together.reset(seed=7)
    np.testing.assert_allclose(b, a, rtol=0.0, atol=1e-7)
    same(ia, ib)
    actions = levels(singles, rng, size)
    for k in range(steps):
        if k % hold == 0:
            actions = levels(singles, rng, size)
        one, all_ = singles.step(actions), together.step(actions)
        assert all_[0].dtype == one[0].dtype
        # float32 of units of a limit; a sample that lies between two quanta may be rounded either way, which is not met
        np.testing.assert_allclose(all_[0], one[0], rtol=0.0, atol=1e-7)
        np.testing.assert_allclose(all_[1], one[1], rtol=0.0, atol=1e-9)
        np.testing.assert_array_equal(all_[2], one[2])
        np.testing.assert_array_equal(all_[3], one[3])
        same(one[4], all_[4])
        ends += one[2].sum(), one[3].sum()
        if singles.metadata["autoreset_mode"] is AutoresetMode.DISABLED and (one[2] | one[3]).any():
            mask = one[2] | one[3]
            seeds = [None, 3, None]
            (a, ia), (b, ib) = (e.reset(seed=seeds, options={"reset_mask": mask.copy()}) for e in (singles, together))
            np.testing.assert_allclose(b, a, rtol=0.0, atol=1e-7)
            same(ia, ib)
    return ends


@pytest.mark.parametrize("dynamics", ["linear", "jsbsim"])
@pytest.mark.parametrize("task", ["taurus", "eolo"])
def test_each_copy_is_the_single_environment(task, dynamics):
    singles, together = pair(task=task, dynamics=dynamics)
    assert fly_both(singles, together, 130)[0] > 1
    for single, information in zip(singles.envs, together.information, strict=True):
        np.testing.assert_allclose(information, single.information, rtol=1e-9, atol=1e-9 * np.abs(information).max())


def test_the_end_of_the_record_truncates_and_the_next_flight_begins():
    assert fly_both(*pair(task="taurus", decision_s=2.0, dynamics="jsbsim"), 34, size=0.1)[1] == 2 * COPIES


@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.DISABLED])
def test_copies_begin_again_as_the_mode_says(mode):
    terminated, truncated = fly_both(*pair(mode, task="taurus", decision_s=1.0, dynamics="jsbsim"), 40, size=0.8)
    assert terminated > 0
    assert terminated + truncated > COPIES


@pytest.mark.parametrize("criterion", ["worst", "A", "E"])
def test_other_criteria_and_discrete_actions(criterion):
    fly_both(*pair(task="taurus", actions="discrete", criterion=criterion, near=0.3, decision_s=0.5), 40)


@pytest.mark.parametrize("actions", ["continuous", "discrete"])
def test_two_controls_and_sensors_that_lag_are_late_and_lose_samples(tmp_path, actions):
    suite, design = tmp_path / "lateral.toml", tmp_path / "lateral_design.toml"
    suite.write_text(SUITE)
    design.write_text(DESIGN.format(suite=suite))
    fly_both(*pair(task=str(design), actions=actions, dynamics="jsbsim"), 60, size=0.5)


def test_more_copies_than_a_block_holds():
    together = ExcitationDesigns(66, task="taurus", dynamics="jsbsim")
    single = ExcitationDesign("taurus", dynamics="jsbsim")
    observations, _ = together.reset(seed=0)
    alone, _ = single.reset(seed=65)
    for _ in range(8):
        observations, rewards, *_ = together.step(np.full((66, 1), 0.2, np.float32))
        alone, reward, *_ = single.step(np.full(1, 0.2, np.float32))
    np.testing.assert_allclose(observations[65], alone, rtol=0.0, atol=1e-7)
    assert rewards[65] == pytest.approx(reward, abs=1e-9)
    assert observations.shape == together.observation_space.shape


def test_gymnasium_makes_copies_that_fly_together():
    register()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        envs = gymnasium.make_vec("testbench/ExcitationDesign-taurus-discrete-v0", num_envs=2, dynamics="jsbsim")
    assert isinstance(envs, ExcitationDesigns)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    observations, _ = envs.reset(seed=1)
    assert envs.observation_space.contains(observations)
    assert envs.observation_space.contains(envs.step(envs.action_space.sample())[0])


def test_what_cannot_fly_together_flies_one_after_the_other_and_says_why(monkeypatch):
    monkeypatch.setattr(vector, "judged", lambda *_: Judged(None, "it has a made-up engine"))
    with pytest.warns(UserWarning, match=r"2 copies of taurus fly one after the other: it has a made-up engine\."):
        envs = vector.make(2, task="taurus", dynamics="jsbsim", autoreset_mode="SameStep")
    assert isinstance(envs, SyncVectorEnv)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert isinstance(vector.make(2, task="taurus"), ExcitationDesigns)  # the linear aircraft needs no batch


def test_sensors_that_need_a_flight_as_a_whole_are_known():
    good = Sensor("q", lag_s=0.1, delay_s=0.05)
    assert why_alone((good,)) == ""
    assert "'psi' takes a flight as a whole" in why_alone((good, Sensor("psi")))
    assert "'q' takes a flight" in why_alone((Sensor("q", recorder="other", clock_ppm=20.0),))
    assert why_alone((SurfacePosition("de"),)) == ""
    assert "'de' remembers" in why_alone((SurfacePosition("de", play=0.01),))


def test_faults_are_named():
    envs = ExcitationDesigns(2, task="taurus")
    with pytest.raises(LimitError, match="call reset"):
        envs.step(np.zeros((2, 1)))
    envs.reset(seed=0)
    for bad in (np.full((2, 1), 1.5), np.full((2, 1), np.nan)):
        with pytest.raises(LimitError, match="an action must hold 1 numbers"):
            envs.step(bad)
    with pytest.raises(LimitError, match="actions must have the shape"):
        envs.step(np.zeros(3))
    with pytest.raises(ScenarioError, match="no options but reset_mask, got wind"):
        envs.reset(options={"wind": 3})
    for mask in (np.zeros(2, bool), np.ones(3, bool), np.ones(2)):
        with pytest.raises(ScenarioError, match="reset_mask must be 2 truth values"):
            envs.reset(options={"reset_mask": mask})
    with pytest.raises(LimitError, match="as many seeds as copies"):
        envs.reset(seed=[1])
    with pytest.raises(LimitError, match="num_envs must be at least 1"):
        ExcitationDesigns(0)
    with pytest.raises(ScenarioError, match="render_mode must be None"):
        ExcitationDesigns(2, render_mode="rgb_array")
    discrete = ExcitationDesigns(2, task="taurus", actions="discrete")
    discrete.reset(seed=0)
    with pytest.raises(LimitError, match="an action must be 0"):
        discrete.step(np.array([0, 9]))
