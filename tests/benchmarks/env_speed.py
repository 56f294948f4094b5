"""Steps per second of the environment, random commands, resets included; the law: 20 000 for the rigid linear aircraft.

Run with ``make benchmarks``. Seconds of processor time of one core, the best of several rounds, since machines are
shared. JSBSim's own limit is what the frames of a decision cost in its bare loop.
"""

from __future__ import annotations

import time

import numpy as np

from testbench.envs import AIRCRAFT
from testbench.envs.excitation import ExcitationDesign
from testbench.flight.executive import Executive
from testbench.flight.trim import place_at_trim

ROUNDS = 5


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
            env = ExcitationDesign(name, wings=wings)
            print(f"{name}, {wings}, linear: {steps_per_second(env, 5000, 0.3):.0f} steps/s")
        env = ExcitationDesign(name, dynamics="jsbsim")
        print(
            f"{name}, rigid, jsbsim, decisions of {env.decision_s:g} s: {steps_per_second(env, 300, 0.3):.0f} steps/s; "
            f"bare loop {bare_steps_per_second(env, 200):.0f}"
        )
