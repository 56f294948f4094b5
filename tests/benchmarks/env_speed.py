"""Steps per second of the environment, random commands, resets included; the law: 20 000 for the rigid linear aircraft.

Run with ``make benchmarks``. Seconds of processor time of one core, since machines are shared: the best of several
rounds of the linear aircraft. JSBSim's own limit is what the frames of a decision cost in its bare loop; the two take
turns within each round, and the median of the rounds' ratios is printed. A reset loads the model and flies the
undisturbed seconds before the first decision, so that the share of the steps alone is given too.
"""

from __future__ import annotations

import statistics
import time

import numpy as np

from testbench.envs import AIRCRAFT
from testbench.envs.excitation import ExcitationDesign
from testbench.flight.executive import Executive
from testbench.flight.trim import place_at_trim

ROUNDS = 5
PAIRS = 25


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


def against_jsbsim(env: ExcitationDesign, steps: int, size: float) -> str:
    """Return in words how many steps a second there are, and how many decisions the bare loop of JSBSim makes."""
    trimmed = env.task.trimmed
    frames = round(env.decision_s * trimmed.rate_hz) * steps
    actions = np.random.default_rng(0).uniform(-size, size, (steps, len(env.amplitude))).astype(np.float32)
    bare, alone, whole = [], [], []
    env.reset(seed=0)
    for _ in range(PAIRS):
        fdm = Executive(env.task.aircraft, trimmed.rate_hz, trimmed.condition)
        place_at_trim(fdm, trimmed)
        run = fdm.fdm.run
        start = time.process_time()
        for _ in range(frames):
            run()
        bare.append(time.process_time() - start)
        resets, start = 0.0, time.process_time()
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                begun = time.process_time()
                env.reset()
                resets += time.process_time() - begun
        whole.append(time.process_time() - start)
        alone.append(whole[-1] - resets)
    share, of_steps = (statistics.median(b / t for b, t in zip(bare, times, strict=True)) for times in (whole, alone))
    return (
        f"{steps / statistics.median(whole):.0f} steps/s; bare loop {steps / statistics.median(bare):.0f}, "
        f"share {share:.2f}, of the steps without resets {of_steps:.2f}"
    )


if __name__ == "__main__":
    for name in AIRCRAFT:
        for wings in ("rigid", "flexible"):
            env = ExcitationDesign(name, wings=wings)
            print(f"{name}, {wings}, linear: {steps_per_second(env, 5000, 0.3):.0f} steps/s")
        env = ExcitationDesign(name, dynamics="jsbsim")
        words = against_jsbsim(env, env.steps, 0.3)
        print(f"{name}, rigid, jsbsim, decisions of {env.decision_s:g} s: {words}")
