"""Steps per second of the environment, random commands, resets included; alone, and 64 copies together.

The laws: 20 000 for the rigid linear aircraft, 100 000 for 64 copies of the Taurus with all of JSBSim's equations. Run
with ``make benchmarks``. Seconds of processor time of one core, the best of several rounds, since machines are shared.
JSBSim's own limit is what the frames of a decision cost in its bare loop. Steps in which a copy begins again are not
counted, and their time is.
"""

from __future__ import annotations

import time

import numpy as np

from testbench.envs import AIRCRAFT
from testbench.envs.excitation import ExcitationDesign
from testbench.envs.vector import ExcitationDesigns
from testbench.flight.executive import Executive
from testbench.flight.trim import place_at_trim

ROUNDS = 5
COPIES = 64


def steps_per_second(env: ExcitationDesign, steps: int, size: float) -> float:
    """Return the best of the rounds."""
    rng = np.random.default_rng(0)
    actions = [a.astype(np.float32) for a in rng.uniform(-size, size, (1000, len(env.amplitude)))]
    env.reset(seed=0)
    best = np.inf
    for _ in range(ROUNDS):
        start = time.process_time()
        for k in range(steps):
            _, _, terminated, truncated, _ = env.step(actions[k % 1000])
            if terminated or truncated:
                env.reset()
        best = min(best, time.process_time() - start)
    return steps / best


def steps_per_second_together(envs: ExcitationDesigns, steps: int, size: float) -> float:
    """Return the best of the rounds, steps of all copies."""
    rng = np.random.default_rng(0)
    actions = rng.uniform(-size, size, (200, envs.num_envs, len(envs.amplitude))).astype(np.float32)
    envs.reset(seed=0)
    best, over = np.inf, np.zeros(envs.num_envs, bool)
    for _ in range(ROUNDS):
        start, done = time.process_time(), 0
        for k in range(steps):
            done += int(np.count_nonzero(~over))
            _, _, terminated, truncated, _ = envs.step(actions[k % 200])
            over = terminated | truncated
        best = min(best, (time.process_time() - start) / done)
    return 1.0 / best


def bare_steps_per_second(env: ExcitationDesign, steps: int) -> float:
    """Return how many decisions a second the bare loop of JSBSim makes."""
    trimmed = env.task.trimmed
    frames = round(env.decision_s * trimmed.rate_hz) * steps
    best = np.inf
    for _ in range(ROUNDS):
        fdm = Executive(env.task.aircraft, trimmed.rate_hz, trimmed.condition)
        place_at_trim(fdm, trimmed)
        run = fdm.fdm.run
        start = time.process_time()
        for _ in range(frames):
            run()
        best = min(best, time.process_time() - start)
    return steps / best


if __name__ == "__main__":
    for name in AIRCRAFT:
        for wings in ("rigid", "flexible"):
            alone = steps_per_second(ExcitationDesign(name, wings=wings), 5000, 0.3)
            together = steps_per_second_together(ExcitationDesigns(COPIES, task=name, wings=wings), 400, 0.3)
            print(f"{name}, {wings}, linear: {alone:.0f} steps/s; {COPIES} copies {together:.0f}")
        env = ExcitationDesign(name, dynamics="jsbsim")
        alone, bare = steps_per_second(env, 300, 0.3), bare_steps_per_second(env, 200)
        together = steps_per_second_together(ExcitationDesigns(COPIES, task=name, dynamics="jsbsim"), 300, 0.3)
        print(
            f"{name}, rigid, jsbsim, decisions of {env.decision_s:g} s: {alone:.0f} steps/s; bare loop {bare:.0f}; "
            f"{COPIES} copies {together:.0f}, {together / alone:.0f}x, {together / bare:.0f}x the bare loop"
        )
