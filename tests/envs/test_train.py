"""Trained agents beside the baselines: flown at their own decisions, refused if they do not fit, trained if asked."""

import base64
import json
import sys
import zipfile
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="the extra 'envs' is not installed")

from testbench.core.errors import MissingPackage, RecordError
from testbench.envs.baselines import as_csv, baselines, fly_plan
from testbench.envs.baselines import main as compare
from testbench.envs.excitation import ExcitationDesign
from testbench.envs.train import agent_actions, main, train


def stand_in(task, decision_s, size=0.2):
    """A library whose agents move the elevator up and down in turn."""
    env = ExcitationDesign(task, decision_s=decision_s)
    turns = iter(range(10**6))
    agent = SimpleNamespace(
        observation_space=env.observation_space,
        action_space=env.action_space,
        decision_s=decision_s,
        task=task,
        predict=lambda seen, deterministic: (np.array([size * (-1.0) ** next(turns)]), None),
    )
    agent.policy = SimpleNamespace(load_state_dict=lambda numbers: agent.__dict__.update(numbers=numbers))

    class PPO:
        """Made of settings it is the agent; loaded whole it would run what its file says."""

        def __new__(cls, *given, **settings):
            return agent

        @staticmethod
        def load(file, device):
            raise AssertionError("the file was unpickled")

    return SimpleNamespace(PPO=PPO, agent=agent)


def numbers_only(file, map_location, weights_only):
    """In place of torch.load."""
    assert weights_only
    return file.read()


@pytest.fixture(autouse=True)
def torch(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(load=numbers_only))


@pytest.fixture
def file(tmp_path):
    return written(tmp_path / "agent.zip", "taurus", 0.75)


def written(path, task, decision_s):
    """An agent's file as the library writes it, with a pickle among its settings that would end this process."""
    evil = base64.b64encode(b"cos\n_exit\n(I7\ntR.").decode()
    told = {"task": task, "decision_s": decision_s, "policy_class": {":type:": "x", ":serialized:": evil}}
    with zipfile.ZipFile(path, "w") as entries:
        entries.writestr("data", json.dumps(told))
        entries.writestr("policy.pth", b"numbers")
    return path


def test_an_agent_s_slow_commands_are_flown_by_the_task_s_own_decisions(monkeypatch, file):
    monkeypatch.setitem(sys.modules, "stable_baselines3", stand_in("taurus", 0.75))
    env = ExcitationDesign("taurus")
    held, actions = agent_actions(env, file, 3, {"task": "taurus"})
    assert held == 0.75
    assert actions.shape == (env.steps, 1)
    np.testing.assert_array_equal(actions[:9, 0], np.repeat([0.2, -0.2, 0.2], 3))
    assert fly_plan(env, actions, 3)[1]["limit"] == ""


def test_a_file_is_unpickled_only_if_it_is_trusted(monkeypatch, file):
    library = stand_in("taurus", 0.75)
    monkeypatch.setitem(sys.modules, "stable_baselines3", library)
    env = ExcitationDesign("taurus")
    agent_actions(env, file, 3, {"task": "taurus"})
    assert library.agent.numbers == b"numbers"
    with pytest.raises(RecordError, match="the file was unpickled"):
        agent_actions(env, file, 3, {"task": "taurus"}, trust=True)


def test_the_agent_is_a_row_of_the_table(monkeypatch, file):
    monkeypatch.setitem(sys.modules, "stable_baselines3", stand_in("taurus", 0.75))
    rows = baselines(ExcitationDesign("taurus"), 0, 1, file, {"task": "taurus"})
    assert {"trained agent", "random", "designed"} <= {r.name for r in rows}
    lines = as_csv(rows).splitlines()
    assert len(lines) == 7
    assert all(line.count('"') == 2 for line in lines[1:])


def test_agents_of_another_task_and_files_that_are_none_are_refused(monkeypatch, file, tmp_path):
    monkeypatch.setitem(sys.modules, "stable_baselines3", stand_in("eolo", 0.4))
    env = ExcitationDesign("taurus")
    with pytest.raises(RecordError, match="for task taurus and these settings, got one for eolo"):
        agent_actions(env, written(tmp_path / "eolo.zip", "eolo", 0.4), 0, {"task": "taurus"})
    (tmp_path / "text.zip").write_bytes(b"an agent")
    with pytest.raises(RecordError, match=r"must be an agent that testbench\.envs\.train wrote"):
        agent_actions(env, tmp_path / "text.zip", 0, {"task": "taurus"})
    with pytest.raises(RecordError, match=r"a readable file of an agent .* got: No such file"):
        agent_actions(env, tmp_path / "none.zip", 0, {"task": "taurus"})


def test_without_the_extra_one_line_says_how_to_install_it(monkeypatch, file, capsys):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(MissingPackage, match=r"pip install '.*\[rl\]'"):
        agent_actions(ExcitationDesign("taurus"), file, 0, {"task": "taurus"})
    with pytest.raises(SystemExit, match=r"^error: .*\[rl\]"):
        main(["--task", "taurus", "--out", str(file)])


@pytest.mark.parametrize(
    ("arguments", "law"),
    [(["--task", "concorde"], "a task must be one of"), (["--flights", "0"], "flights must be at least 1")],
)
def test_faults_are_one_line(arguments, law):
    with pytest.raises(SystemExit, match=f"^error: .*{law}"):
        compare(arguments)


@pytest.mark.slow
def test_the_same_seed_trains_the_same_agent_and_it_flies(tmp_path):
    pytest.importorskip("stable_baselines3", reason="the extra 'rl' is not installed")
    env = ExcitationDesign("taurus")
    flown = []
    for name in ("a.zip", "b.zip"):
        path = train("taurus", 4096, 1, tmp_path / name)
        flown.append(agent_actions(env, path, 0, {"task": "taurus"})[1])
    np.testing.assert_array_equal(*flown)
