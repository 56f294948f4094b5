"""The inputs that an agent has to beat: random commands, the textbook doublet and 3-2-1-1, and the designed input.

    python -m testbench.envs.baselines --task taurus
    python -m testbench.envs.baselines --task eolo --agent results/envs/eolo_agent.zip --out results/envs/eolo.csv

The second command adds an agent that ``testbench.envs.train`` trained, and writes the table.

All but the random commands are known before the flight. They are scaled to the largest amplitude at which the linear
prediction uses no more than ``near`` of any limit (beyond that share nearing a limit costs), or to the amplitude of a
full action if that is less. Their one free time is the length of a step in whole decisions; the best is taken.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from testbench.core.errors import LimitError, TestbenchError
from testbench.core.record import FloatArray
from testbench.core.store import write_beside
from testbench.design.refine import Steps, Switching, designed_signs
from testbench.envs.train import TRUST, agent_actions
from testbench.information.fisher import cost
from testbench.inputs.multistep import PATTERNS

if TYPE_CHECKING:
    from testbench.envs.excitation import ExcitationDesign  # needs gymnasium, which --help does not

_DOUBLET = (1.0, -1.0)
_BLOCKS = 48  # most steps of the designed input, all controls together
_RANDOM_STARTS = 6
_MARGIN = 1e-6  # an amplitude exactly on the edge would count as nearing the limit, by rounding


@dataclass(frozen=True, eq=False)
class Plan:
    """A flight known before it: actions (steps, m) in amplitudes, and the cost that the linear aircraft predicts."""

    words: str
    actions: FloatArray
    cost: float


class Row(NamedTuple):
    """The results of one way to choose the commands; means over its flights.

    ``worst``: largest standard error of a target over the wanted one; ``use``: largest share of a limit; ``completed``:
    share of flights that broke none.
    """

    name: str
    words: str
    total: float
    cost: float
    worst: float
    use: float
    completed: float


def multistep_plan(env: ExcitationDesign, pattern: Sequence[float]) -> Plan:
    """Return the best multistep of a pattern over the length of its unit, in whole decisions.

    Several controls move one after the other in equal parts of the flight.

    Raises:
        LimitError: the flight is too short for the pattern.
    """
    m, units = len(env.amplitude), round(float(np.abs(pattern).sum()))
    part = env.steps // m
    plans = []
    for n in range(1, part // units + 1):
        one = np.concatenate([np.full(round(abs(p)) * n, np.sign(p)) for p in pattern])
        actions = np.zeros((env.steps, m))
        for j in range(m):
            actions[j * part : j * part + one.size, j] = one
        plans.append(_scaled(env, actions, f"unit {n * env.decision_s:g} s"))
    if not plans:
        raise LimitError(f"a pattern of {units} units needs as many decisions per control, got {part}")
    return min(plans, key=lambda p: p.cost)


def designed_plan(env: ExcitationDesign, starts: Sequence[Plan] = (), seed: int = 0) -> Plan:
    """Return the switching input of least cost: coordinate exchange over steps of whole decisions.

    Three forms cover the flight, by steps so long that there are no more than 48 in all, half as long again, and twice
    as long; the other repeats a sequence of decisions. See :mod:`testbench.design.refine`.

    Args:
        env: the environment.
        starts: plans to start from, beside random ones.
        seed: of the random starts.
    """
    problem, m = env.task.problem, len(env.amplitude)
    R = problem.experiment.stride * round(env.decision_s * problem.rate_hz / problem.experiment.stride)
    begin, most = round(problem.start_s * problem.rate_hz), max(_BLOCKS // m, 1)
    long = -(-env.steps // most)
    wider = [n for n in (long, long + long // 2, 2 * long) if n <= env.steps]
    forms = {*((n, env.steps // n, 1) for n in wider), (1, min(most, env.steps), max(env.steps // most, 1))}
    plans = []
    for n, count, repeats in sorted(forms):
        form = Switching.of(replace(problem, criterion=env.criterion), Steps(n * R, begin, count, repeats))
        points = [np.sign(p.actions[: n * count : n].T.ravel()) for p in starts]
        signs = designed_signs(form, points, _RANDOM_STARTS, seed)
        actions = np.zeros((env.steps, m))
        actions[: repeats * n * count] = np.tile(np.repeat(signs.reshape(m, count).T, n, axis=0), (repeats, 1))
        words = f"{count} steps of {n * env.decision_s:g} s" + (f", {repeats} times" if repeats > 1 else "")
        plans.append(_scaled(env, actions, words))
    return min(plans, key=lambda p: p.cost)


def random_plan(env: ExcitationDesign, seed: int) -> Plan:
    """Return random signs, drawn anew for each decision, inside the limits."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], (env.steps, len(env.amplitude)))
    return _scaled(env, signs, f"a sign per {env.decision_s:g} s")


def _scaled(env: ExcitationDesign, actions: FloatArray, words: str) -> Plan:
    """Return signs or levels as a plan at the largest admissible amplitude."""
    problem = env.task.problem
    stride = problem.experiment.stride
    R = stride * round(env.decision_s * problem.rate_hz / stride)
    u = np.zeros((problem.experiment.samples * stride, actions.shape[1]))
    begin = round(problem.start_s * problem.rate_hz)
    u[begin : begin + R * len(actions)] = np.repeat(actions * env.amplitude, R, axis=0)
    factor, _ = problem.prediction.largest_factor(u)
    factor = min(env.near * (1.0 - _MARGIN) * factor, 1.0 / float(np.abs(actions).max()))
    M = factor**2 * problem.experiment.information(u)
    return Plan(words, factor * actions, cost(M, problem.targets.gradient, env.criterion))


def fly_plan(env: ExcitationDesign, actions: FloatArray, seed: int) -> tuple[float, dict[str, Any]]:
    """Fly actions (steps, m) to the end or a broken limit; return the sum of rewards and the last ``info``."""
    _, info = env.reset(seed=seed)
    total = 0.0
    for action in actions:
        _, reward, terminated, truncated, info = env.step(action)
        total += reward
        if terminated or truncated:
            break
    return total, info


def baselines(
    env: ExcitationDesign,
    seed: int = 0,
    flights: int = 10,
    agent: Path | None = None,
    settings: Mapping[str, Any] | None = None,
    trust: bool = False,
) -> list[Row]:
    """Fly every baseline in a continuous environment and return what each earned, the best last.

    Args:
        env: the environment, with continuous actions.
        seed: of the sensors, of the random commands and of the design.
        flights: of each random baseline, and of the agent.
        agent: file of a trained agent, to fly beside them.
        settings: what the environment was made with; needed for the agent, whose own decisions are longer.
        trust: load the whole file of the agent, which runs code of it; else the numbers of its policy only.

    Raises:
        RecordError: there is no such agent, or it is one of another task.
    """
    rng = np.random.default_rng(seed)
    doublet, multistep = multistep_plan(env, _DOUBLET), multistep_plan(env, PATTERNS["3211"])
    noise = [rng.uniform(-1.0, 1.0, (env.steps, len(env.amplitude))) for _ in range(flights)]
    binary = [random_plan(env, seed + i) for i in range(flights)]
    designed = designed_plan(env, (doublet, multistep), seed)
    ways = [
        ("random", "any command, as an agent begins", noise),
        ("random binary", binary[0].words, [p.actions for p in binary]),
        ("doublet", doublet.words, [doublet.actions]),
        ("3-2-1-1", multistep.words, [multistep.actions]),
        ("designed", designed.words, [designed.actions]),
    ]
    if agent is not None:
        flown_by = [agent_actions(env, agent, seed + i, settings or {"task": "eolo"}, trust) for i in range(flights)]
        ways.append(("trained agent", f"a command per {flown_by[0][0]:g} s", [actions for _, actions in flown_by]))
    rows = []
    for name, words, plans in ways:
        flown = [fly_plan(env, actions, seed + i) for i, actions in enumerate(plans)]
        infos = [info for _, info in flown]
        rows.append(
            Row(
                name,
                words,
                float(np.mean([total for total, _ in flown])),
                float(np.mean([i["cost"] for i in infos])),
                float(np.mean([max(i["errors"].values()) for i in infos])),
                float(np.mean([i["largest_use"] for i in infos])),
                float(np.mean([not i["limit"] for i in infos])),
            )
        )
    return sorted(rows, key=lambda r: r.total)


def as_text(rows: Sequence[Row]) -> str:
    """Return the table as text."""
    head = ("input", "return, nats", "cost", "worst error", "largest use", "completed", "")
    body = [
        (r.name, f"{r.total:.3f}", f"{r.cost:.3g}", f"{r.worst:.3g}", f"{r.use:.2f}", f"{r.completed:.0%}", r.words)
        for r in rows
    ]
    wide = [max(len(line[i]) for line in (head, *body)) for i in range(len(head))]
    lines = []
    for line in (head, *body):
        cells = [line[0].ljust(wide[0]), *(c.rjust(w) for c, w in zip(line[1:-1], wide[1:-1], strict=True)), line[-1]]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)


def as_csv(rows: Sequence[Row]) -> str:
    """Return the table as CSV, 4 significant digits."""
    lines = ["input,return_nats,cost,worst_error_over_wanted,largest_use_of_a_limit,completed,words"]
    for r in rows:
        numbers = ",".join(f"{x:.4g}" for x in (r.total, r.cost, r.worst, r.use, r.completed))
        lines.append(f'{r.name},{numbers},"{r.words}"')
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table of one task, and write it if asked to."""
    parser = argparse.ArgumentParser(prog="python -m testbench.envs.baselines", description="What an agent must beat.")
    parser.add_argument("--task", default="eolo", help="aircraft, or path of a design scenario")
    parser.add_argument("--wings", default="rigid", choices=("rigid", "flexible"))
    parser.add_argument("--dynamics", default="linear", choices=("linear", "jsbsim"))
    parser.add_argument("--criterion", default="D", choices=("D", "worst", "A", "E"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--flights", type=int, default=10, help="of each random input, and of the agent")
    parser.add_argument("--agent", type=Path, default=None, help="file of an agent trained by testbench.envs.train")
    parser.add_argument("--trust", action="store_true", help=TRUST)
    parser.add_argument("--out", type=Path, default=None, help="file for the table (CSV)")
    given = parser.parse_args(arguments)
    settings = {n: getattr(given, n) for n in ("task", "wings", "dynamics", "criterion")}
    try:
        _print(settings, given)
    except TestbenchError as error:
        raise SystemExit(f"error: {error}") from error


def _print(settings: Mapping[str, Any], given: argparse.Namespace) -> None:
    if given.flights < 1:
        raise LimitError(f"flights must be at least 1, got {given.flights}")
    if given.seed < 0:
        raise LimitError(f"a seed must be at least 0, got {given.seed}")
    from testbench.envs.excitation import ExcitationDesign

    env = ExcitationDesign(**settings)
    aircraft, steps = env.task.aircraft.name, env.steps
    print(f"{aircraft}: {steps} decisions of {env.decision_s:g} s, {given.dynamics} dynamics, cost {given.criterion}")
    if given.agent is not None:
        what = "all of it, which runs its code (--trust)" if given.trust else "the numbers of its policy only"
        print(f"agent {given.agent}: loads {what}")
    rows = baselines(env, given.seed, given.flights, given.agent, settings, given.trust)
    print(as_text(rows))
    if given.out is not None:
        print(f"Written: {write_beside(given.out, as_csv(rows))}")


if __name__ == "__main__":
    main()
