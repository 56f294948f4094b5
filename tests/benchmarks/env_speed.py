"""Steps per second of the environment, random commands, resets included; alone, and 64 copies together.

The laws: 20 000 for the rigid linear aircraft, 100 000 for 64 copies of the Taurus with all of JSBSim's equations. Run
with ``make benchmarks``. Seconds of processor time of one core, since machines are shared: the best of several rounds
of the linear aircraft and of the copies together. JSBSim's own limit is what the frames of a decision cost in its bare
loop; it and the single environment take turns within each round, and the median of the rounds' ratios is printed. A
reset loads the model and flies the undisturbed seconds before the first decision, so that the share of the steps alone
is given too. Steps in which a copy begins again are not counted, and their time is.
"""

import statistics
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from clock import since, some
from smallest import sized

from testbench.envs import AIRCRAFT
from testbench.envs.excitation import ExcitationDesign
from testbench.envs.vector import ExcitationDesigns
from testbench.flight.executive import Executive
from testbench.flight.trim import place_at_trim

ROUNDS = sized(5, 1)
COPIES = sized(64, 2)
PAIRS = sized(25, 1)
STEPS, TOGETHER = sized((5000, 300), (50, 5))


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
        best = min(best, since(start))
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
        best = min(best, since(start) / done)
    return 1.0 / best


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
        bare.append(since(start))
        resets, start = 0.0, time.process_time()
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                begun = time.process_time()
                env.reset()
                resets += since(begun)
        whole.append(since(start))
        alone.append(some(whole[-1] - resets))
    share, of_steps = (statistics.median(b / t for b, t in zip(bare, times, strict=True)) for times in (whole, alone))
    return (
        f"{steps / statistics.median(whole):.0f} steps/s; bare loop {steps / statistics.median(bare):.0f}, "
        f"share {share:.2f}, of the steps without resets {of_steps:.2f}"
    )


if __name__ == "__main__":
    for name in list(AIRCRAFT)[: sized(None, 1)]:
        for wings in ("rigid", "flexible"):
            alone = steps_per_second(ExcitationDesign(name, wings=wings), STEPS, 0.3)
            together = steps_per_second_together(ExcitationDesigns(COPIES, task=name, wings=wings), TOGETHER, 0.3)
            print(f"{name}, {wings}, linear: {alone:.0f} steps/s; {COPIES} copies {together:.0f}")
        env = ExcitationDesign(name, dynamics="jsbsim")
        words = against_jsbsim(env, env.steps, 0.3)
        together = steps_per_second_together(ExcitationDesigns(COPIES, task=name, dynamics="jsbsim"), TOGETHER, 0.3)
        print(f"{name}, rigid, jsbsim, decisions of {env.decision_s:g} s: {words}; {COPIES} copies {together:.0f}")
