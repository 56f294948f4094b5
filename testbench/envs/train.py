"""Train an agent on a task: proximal policy optimisation of stable-baselines3 (the extra ``rl``), on one core.

    python -m testbench.envs.train --task eolo --out results/envs/eolo_agent.zip
    python -m testbench.envs.baselines --task eolo --agent results/envs/eolo_agent.zip

J. Schulman et al., Proximal Policy Optimization Algorithms, arXiv:1707.06347, 2017. Exploration is a smooth function
of what is seen, redrawn every 4 choices (A. Raffin, J. Kober, F. Stulp, Smooth Exploration for Robotic Reinforcement
Learning, CoRL 2021), and a choice is held for several decisions of the task: a command drawn anew at each hardly moves
an aircraft. Settings are choices, not results.
"""

from __future__ import annotations

import argparse
import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.door import checked, open_file
from testbench.core.errors import LimitError, MissingPackage, RecordError, TestbenchError, missing
from testbench.core.files import parsed, reason_of
from testbench.core.record import FloatArray
from testbench.core.store import ResultFolder, write_beside

if TYPE_CHECKING:
    from testbench.envs.excitation import ExcitationDesign  # needs gymnasium, which --help does not

NEEDS_RL = ("trained agents need stable-baselines3", "rl")
TRUST = "load the whole agent, which runs code of its file: only of one that you trained yourself"
"""What it means to trust an agent's file."""
_COPIES = 8
_LARGEST = 100e6  # bytes of an entry of an agent's file
_SETTINGS: dict[str, Any] = {
    "n_steps": 512,
    "batch_size": 512,
    "n_epochs": 8,
    "learning_rate": 3e-4,
    "gamma": 0.999,
    "gae_lambda": 0.95,
    "use_sde": True,
    "sde_sample_freq": 4,
    "policy_kwargs": {"log_std_init": -1.0, "net_arch": [64, 64], "squash_output": True},
}


def train(task: str, steps: int, seed: int, out: Path, hold: int = 6, **settings: Any) -> Path:
    """Train an agent in the continuous environment of ``task`` for ``steps`` choices and write it; return the file.

    Args:
        task: aircraft, or path of a design scenario.
        steps: choices, of 8 copies of the environment together.
        seed: of the agent and the sensors: the same one gives the same agent on the same machine.
        out: file (.zip).
        hold: decisions of the task that each choice is held for.
        settings: of the environment, see :class:`testbench.envs.excitation.ExcitationDesign`.

    Raises:
        MissingPackage: stable-baselines3 or Gymnasium is not installed.
        WriteError: the file cannot be written.
        LimitError: there is no step, the seed is below 0, or a choice is held for less than one decision or longer
            than the flight.
    """
    for name, value, least in (("steps", steps, 1), ("seed", seed, 0), ("hold", hold, 1)):
        if value < least:
            raise LimitError(f"{name} must be at least {least}, got {value}")
    try:
        import torch
        from stable_baselines3 import PPO
        from stable_baselines3.common.vec_env import DummyVecEnv
    except ImportError as error:
        raise MissingPackage(missing(*NEEDS_RL)) from error
    from testbench.envs.excitation import ExcitationDesign

    place = ResultFolder(out.parent, adds=True)  # before hours of work
    try:
        place.check(out.name)
    finally:
        place.leave()
    torch.set_num_threads(1)
    decision_s = hold * ExcitationDesign(task, **settings).decision_s
    copies = DummyVecEnv([lambda: ExcitationDesign(task, decision_s=decision_s, **settings) for _ in range(_COPIES)])
    agent = PPO("MlpPolicy", copies, seed=seed, device="cpu", **_SETTINGS)
    agent.learn(steps)
    agent.task, agent.decision_s = task, decision_s  # kept with the agent in its file
    whole = io.BytesIO()
    agent.save(whole)
    return write_beside(out, whole.getvalue())


def read_agent(file: Path) -> tuple[str, float, io.BytesIO]:
    """Return the task of an agent, how long it holds a choice, s, and the file of its policy's numbers; no code runs.

    Raises:
        RecordError: it is no agent that :func:`train` wrote.
    """
    with (
        open_file(file, "agent") as whole,
        parsed(file, "an agent that testbench.envs.train wrote"),
        zipfile.ZipFile(whole) as entries,
    ):
        if max(entries.getinfo(name).file_size for name in ("data", "policy.pth")) > _LARGEST:
            raise RecordError(f"entries of an agent must be at most {_LARGEST:g} bytes, got more in '{file}'")
        told = json.loads(entries.read("data"))
        return str(told["task"]), float(told["decision_s"]), io.BytesIO(entries.read("policy.pth"))


def agent_actions(
    env: ExcitationDesign, file: Path, seed: int, settings: Mapping[str, Any], trust: bool = False
) -> tuple[float, FloatArray]:
    """Return how long the agent in ``file`` holds a choice, s, and its actions (steps, m) in one flight.

    It chooses without exploration, from what the sensors show at its own, slower, decisions; the actions are those of
    ``env``, which was made with ``settings``. Of the file its policy's numbers are read, into a policy of the settings
    that :func:`train` uses, and no code runs, unless ``trust``: then all of it is loaded, which runs what pickles in it
    say.

    Raises:
        MissingPackage: stable-baselines3 or Gymnasium is not installed.
        RecordError: the file holds no agent for this environment.
    """
    try:
        import torch
        from stable_baselines3 import PPO
    except ImportError as error:
        raise MissingPackage(missing(*NEEDS_RL)) from error
    from testbench.envs.excitation import ExcitationDesign

    if trust:
        with parsed(checked(file, "agent"), "an agent that testbench.envs.train wrote"):
            agent = PPO.load(file, device="cpu")
        task, decision_s = getattr(agent, "task", None), getattr(agent, "decision_s", env.decision_s)
    else:
        task, decision_s, numbers = read_agent(file)
    fault = f"the agent in '{file}' must be one for task {settings['task']} and these settings, got one for {task}"
    if task != settings["task"]:
        raise RecordError(fault)
    slow = ExcitationDesign(**{**settings, "decision_s": decision_s})
    if not trust:
        agent = PPO("MlpPolicy", slow, device="cpu", **_SETTINGS)
        try:
            agent.policy.load_state_dict(torch.load(numbers, map_location="cpu", weights_only=True))
        except Exception as error:  # torch raises of many kinds at what is no table of numbers of these shapes
            raise RecordError(f"{fault}, or a damaged one: {reason_of(error)}") from error
    elif (agent.observation_space, agent.action_space) != (env.observation_space, env.action_space):
        raise RecordError(fault)
    seen, _ = slow.reset(seed=seed)
    actions = []
    over = False
    while not over:
        action, _ = agent.predict(seen, deterministic=True)
        seen, _, terminated, truncated, _ = slow.step(action)
        actions.append(action)
        over = terminated or truncated
    out = np.zeros((env.steps, len(env.amplitude)))
    held = np.repeat(np.array(actions, float), round(slow.decision_s / env.decision_s), axis=0)
    out[: len(held)] = held
    return slow.decision_s, out


def main(arguments: Sequence[str] | None = None) -> None:
    """Train one agent."""
    parser = argparse.ArgumentParser(prog="python -m testbench.envs.train", description="Train an agent on a task.")
    parser.add_argument("--task", default="eolo", help="aircraft, or path of a design scenario")
    parser.add_argument("--steps", type=int, default=150_000, help="choices to train for")
    parser.add_argument("--hold", type=int, default=6, help="decisions of the task that a choice is held for")
    parser.add_argument("--criterion", default="D", choices=("D", "worst", "A", "E"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=None, help="file; results/envs/TASK_agent.zip if not given")
    given = parser.parse_args(arguments)
    out = given.out or Path("results") / "envs" / f"{Path(given.task).stem}_agent.zip"
    try:
        print(f"Written: {train(given.task, given.steps, given.seed, out, given.hold, criterion=given.criterion)}")
    except TestbenchError as error:
        raise SystemExit(f"error: {error}") from error


if __name__ == "__main__":
    main()
