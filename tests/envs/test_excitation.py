"""The environment: Gymnasium's own checker, rewards, ends, seeds, sensors, both dynamics, pictures, baselines."""

import math
import subprocess
import sys
import warnings
from dataclasses import replace

import numpy as np
import pytest

from testbench.core.errors import EstimationError, LimitError, ScenarioError
from testbench.envs import AIRCRAFT, DEFAULT, environment_names, register
from testbench.flight import Manoeuvre, fly
from testbench.inputs.signal import InputSignal

gymnasium = pytest.importorskip("gymnasium", reason="the extra 'envs' is not installed")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from testbench.envs.baselines import as_text, baselines, designed_plan, fly_plan, main, multistep_plan  # noqa: E402
from testbench.envs.excitation import LEVELS, ExcitationDesign  # noqa: E402
from testbench.envs.sensed import Display  # noqa: E402

LATERAL = """
title = "two controls"
aircraft = "taurus"
suites = ["{suite}"]
controls = ["da", "dr"]
duration_s = 12.0
shortest_step_s = 0.25
condition = {{ V_m_s = 12.0, h_m = 100.0 }}
targets = {{ parameters = {{ L_p = 5.0, N_r = 5.0 }} }}
"""
SENSOR = """
[[sensor]]
channel = "{c}"
unit = "{unit}"
noise_std = 0.2
part = "a sensor"
source = "made up for a test"
"""


@pytest.fixture(scope="module")
def env():
    return ExcitationDesign("eolo", render_mode="rgb_array")


@pytest.fixture(scope="module", autouse=True)
def _registered():
    register()


def pulse(env, size=0.3, steps=6):
    actions = np.zeros((env.steps, len(env.amplitude)))
    actions[2 : 2 + steps], actions[2 + steps : 2 + 2 * steps] = size, -size
    return actions


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", environment_names())
def test_every_environment_passes_the_checker(name):
    made = gymnasium.make(name, disable_env_checker=True, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(made.unwrapped)
    assert made.observation_space.contains(made.reset(seed=0)[0])


def test_registering_twice_does_no_harm_and_names_every_aircraft():
    assert register() == register()
    assert len(environment_names()) == 1 + 2 * len(AIRCRAFT)
    assert DEFAULT in gymnasium.registry


def test_nothing_heavy_is_imported_before_it_is_needed():
    code = (
        "import sys, testbench.cli, testbench.envs; print([m for m in ('gymnasium', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_gains_add_up_and_the_record_s_end_truncates(env):
    _, first = env.reset(seed=1)
    total, ends = 0.0, []
    for action in pulse(env):
        _, reward, terminated, truncated, info = env.step(action)
        total += reward
        ends.append((terminated, truncated))
        assert info["use"] < env.near
    assert ends[:-1] == [(False, False)] * (env.steps - 1)
    assert ends[-1] == (False, True)
    assert total == pytest.approx(math.log(first["cost"] / info["cost"]), rel=1e-12)
    assert info["limit"] == ""
    with pytest.raises(LimitError, match="call reset"):
        env.step(np.zeros(1))


def test_same_seed_same_episode_and_chance_lies_in_the_sensors_alone(env):
    def flight(seed):
        observations, rewards = [env.reset(seed=seed)[0]], []
        for action in pulse(env)[:40]:
            observation, reward, *_ = env.step(action)
            observations.append(observation)
            rewards.append(reward)
        return np.array(observations), rewards

    (a, ra), (b, rb), (c, rc) = flight(5), flight(5), flight(6)
    np.testing.assert_array_equal(a, b)
    assert ra == rb == rc
    assert not np.array_equal(a, c)


def test_a_broken_limit_terminates_at_its_price(env):
    env.reset(seed=0)
    count = -1
    terminated = False
    while not terminated:
        count += 1
        _, reward, terminated, truncated, info = env.step(np.ones(1))
    assert not truncated
    assert 0 < count < env.steps - 1
    assert reward == -5.0
    assert info["use"] > 1.0
    assert info["limit"] in env.task.problem.prediction.names
    assert len(env.commands) == count + 1


def test_nearing_a_limit_costs_what_is_written(env):
    dear, free = (ExcitationDesign("eolo", near=0.15, near_cost=w) for w in (2.0, 0.0))
    dear.reset(seed=0)
    free.reset(seed=0)
    met = 0
    for action in pulse(env, 0.5, 8)[:60]:
        r, r0 = dear.step(action)[1], free.step(action)
        over = max(0.0, (r0[4]["use"] - 0.15) / 0.85)
        met += over > 0.0
        assert r == pytest.approx(r0[1] - 2.0 * over**2, abs=1e-12)
    assert met > 3


def test_discrete_actions_hold_and_step():
    env = ExcitationDesign("eolo", actions="discrete")
    env.reset(seed=0)
    for action in (0, 4, 0, 2, 3, 0):
        env.step(action)
    levels = np.array([0.0, LEVELS[3], LEVELS[3], LEVELS[1], LEVELS[2], LEVELS[2]])
    np.testing.assert_array_equal(env.commands[:, 0], levels * env.amplitude[0])
    for bad in (-1, len(LEVELS) + 1, 1.5):
        with pytest.raises(LimitError, match="an action must be"):
            env.step(bad)


def test_two_controls_have_an_action_each(tmp_path):
    suite = tmp_path / "lateral.toml"
    suite.write_text(
        'title = "rates"\nrate_hz = 20.0\n'
        + "".join(SENSOR.format(c=c, unit="deg/s") for c in ("p", "r"))
        + "".join(SENSOR.format(c=c, unit="deg") for c in ("da", "dr"))
    )
    file = tmp_path / "lateral_design.toml"
    file.write_text(LATERAL.format(suite=suite))
    env = ExcitationDesign(str(file), actions="discrete")
    env.reset(seed=0)
    assert env.action_space == gymnasium.spaces.MultiDiscrete([len(LEVELS) + 1] * 2)
    env.step(np.array([4, 2]))
    np.testing.assert_array_equal(env.commands[0], np.array([LEVELS[3], LEVELS[1]]) * env.amplitude)
    continuous = ExcitationDesign(str(file))
    assert continuous.action_space.shape == (2,)
    assert designed_plan(continuous).cost < multistep_plan(continuous, (1.0, -1.0)).cost


@pytest.mark.parametrize("bad", [np.array([1.5]), np.array([np.nan]), np.zeros(2)])
def test_actions_outside_their_space_are_refused(env, bad):
    env.reset(seed=0)
    with pytest.raises(LimitError, match="an action must hold"):
        env.step(bad)


def test_undisturbed_sensors_show_trim_with_their_noise(env):
    env.reset(seed=2)
    y = env.episode().y
    suite = env.task.suite
    for i, sensor in enumerate(s for s in suite.sensors if s.channel in suite.outputs):
        at = env.task.trimmed.state[sensor.channel] + sensor.bias
        sigma = suite.noise_std[sensor.channel]
        # means and standard deviations of 200 samples: beyond 5 standard errors with probability 6e-7 each
        assert abs(y[:, i].mean() - at) < 5.0 * sigma / math.sqrt(len(y))
        assert abs(y[:, i].std() / sigma - 1.0) < 5.0 / math.sqrt(2.0 * len(y))
        np.testing.assert_allclose(y[:, i] / sensor.quantum, np.rint(y[:, i] / sensor.quantum), atol=1e-6)


def test_a_slow_sensor_is_held_between_its_samples():
    env = ExcitationDesign("taurus")
    env.reset(seed=0)
    for _ in range(20):
        env.step(env.action_space.sample() * 0.3)
    episode = env.episode()
    u = episode.y[:, episode.channels.index("u")]
    theta = episode.y[:, episode.channels.index("theta")]
    np.testing.assert_array_equal(u[0::2], u[1::2])
    assert np.mean(theta[0::2] == theta[1::2]) < 0.2


def test_jsbsim_is_sensed_as_the_suite_senses_a_flight():
    env = ExcitationDesign("eolo", dynamics="jsbsim")
    task, rate = env.task, env.task.trimmed.rate_hz
    env.reset(seed=11)
    actions = pulse(env)[:40]
    for action in actions:
        env.step(action)
    held = np.repeat(actions[:, 0] * env.amplitude[0], round(env.decision_s * rate))
    late = np.concatenate([[0.0], held[:-1]])  # see SteppedFlight
    signal = InputSignal(np.arange(late.size) / rate, late[:, None], ("de",))
    truth = fly(task.aircraft, task.trimmed, Manoeuvre("same", signal, task.problem.start_s), 100.0)
    seed = int(np.random.Generator(np.random.PCG64(np.random.SeedSequence(11))).integers(2**31))
    measured = task.suite.measure(truth, seed)
    episode = env.episode()
    wanted = measured.columns(episode.channels)[: len(episode.y)]
    np.testing.assert_allclose(episode.y, wanted, rtol=0.0, atol=1e-9)


def test_both_dynamics_agree_in_small_motion_and_on_information():
    shown, information = [], []
    for dynamics in ("linear", "jsbsim"):
        env = ExcitationDesign("eolo", dynamics=dynamics)
        env.reset(seed=3)
        for action in pulse(env, 0.05)[:40]:
            assert env.step(action)[4]["use"] < 0.2
        shown.append(env.episode().y)
        information.append(env.information)
    # products of one matrix with all its rows, and with those of sensitivities alone: sums in another order
    np.testing.assert_allclose(*information, rtol=1e-14)
    sigma = env.task.problem.experiment.sigma
    # 0.25 deg of elevator: they differ by a frame of the servo, and by a quantum where they round apart
    assert np.all(np.abs(shown[0] - shown[1]).mean(axis=0) < 0.1 * sigma)


def test_jsbsim_beyond_the_limits_terminates():
    env = ExcitationDesign("eolo", dynamics="jsbsim")
    env.reset(seed=0)
    for _ in range(env.steps):
        observation, _, terminated, _, info = env.step(np.ones(1))
        if terminated:
            break
    assert terminated
    assert info["limit"]
    assert env.observation_space.contains(observation)


def test_the_picture_shows_the_flight(env):
    env.reset(seed=0)
    before = env.render()
    for action in pulse(env)[:30]:
        env.step(action)
    after = env.render()
    assert after.shape == before.shape
    assert after.dtype == np.uint8
    assert np.mean(np.any(after != before, axis=2)) > 0.02
    np.testing.assert_array_equal(after, env.render())
    silent = ExcitationDesign("eolo")
    silent.reset(seed=0)
    assert silent.render() is None


def test_environments_fly_side_by_side():
    envs = gymnasium.make_vec(DEFAULT, num_envs=3, vectorization_mode="sync", task="taurus")
    observations, _ = envs.reset(seed=7)
    for _ in range(5):
        observations, rewards, *_ = envs.step(np.full((3, 1), 0.2, np.float32))
    assert observations.shape[0] == rewards.size == 3
    assert not np.array_equal(observations[0], observations[1])  # seeds 7, 8, 9
    single = ExcitationDesign("taurus")
    single.reset(seed=8)
    for _ in range(5):
        alone, *_ = single.step(np.full(1, 0.2, np.float32))
    np.testing.assert_array_equal(alone, observations[1])
    envs.close()


def test_the_designed_input_beats_the_textbook_and_keeps_clear_of_limits(env):
    rows = {r.name: r for r in baselines(env, seed=0, flights=2)}
    assert rows["designed"].total > max(rows["doublet"].total, rows["3-2-1-1"].total) > rows["random"].total
    for name in ("random binary", "doublet", "3-2-1-1", "designed"):
        assert rows[name].use < env.near
        assert rows[name].completed == 1.0
    assert len(as_text(list(rows.values())).splitlines()) == 6


def test_a_plan_earns_what_it_predicts(env):
    plan = multistep_plan(env, (3.0, -2.0, 1.0, -1.0))
    _, info = fly_plan(env, plan.actions, 0)
    assert info["cost"] == pytest.approx(plan.cost, rel=0.01)  # the prior of 100 % adds next to nothing
    quick = ExcitationDesign("eolo", decision_s=0.6)
    np.testing.assert_array_equal(designed_plan(quick, seed=4).actions, designed_plan(quick, seed=4).actions)


def test_the_table_is_printed(capsys):
    main(["--task", "taurus", "--flights", "1", "--criterion", "worst"])
    out = capsys.readouterr().out
    assert out.startswith("taurus: 112 decisions of 0.25 s")
    assert all(name in out for name in ("random", "doublet", "3-2-1-1", "designed"))


@pytest.mark.parametrize(
    ("arguments", "error", "law"),
    [
        ({"task": "concorde"}, ScenarioError, "a task must be one of"),
        ({"actions": "fuzzy"}, ScenarioError, "actions must be one of"),
        ({"criterion": "F"}, ScenarioError, "criterion must be one of"),
        ({"near": 1.0}, ScenarioError, "0 < near < 1"),
        ({"breach_cost": -1.0}, ScenarioError, "0 <= breach_cost"),
        ({"render_mode": "human"}, ScenarioError, "render_mode must be one of"),
        ({"decision_s": 0.015}, LimitError, "decision_s must be a whole number"),
        ({"decision_s": 50.0}, LimitError, "at least one decision"),
        ({"stack": 0}, LimitError, "1 <= stack"),
        ({"prior": -1.0}, EstimationError, "prior > 0"),
    ],
)
def test_faults_are_named(arguments, error, law):
    with pytest.raises(error, match=law):
        ExcitationDesign(**arguments)


def test_reset_takes_no_options(env):
    with pytest.raises(ScenarioError, match="takes no options"):
        env.reset(options={"wind": 3})


def test_a_sensor_that_drifts_does_so_from_the_beginning_of_an_episode():
    task = ExcitationDesign("eolo").task
    experiment = task.problem.experiment
    drawn = []
    for rate in (0.0, 0.02):
        first, *rest = experiment.sensors
        changed = replace(experiment, sensors=(replace(first, bias_rate=rate), *rest))
        there = replace(task, problem=replace(task.problem, experiment=changed))
        drawn.append(Display(there, 50.0, 200).draw(3).error)
    np.testing.assert_allclose((drawn[1] - drawn[0])[:, 0], 0.02 * np.arange(200) / 50.0, atol=1e-14)
    np.testing.assert_array_equal(drawn[0][:, 1:], drawn[1][:, 1:])
