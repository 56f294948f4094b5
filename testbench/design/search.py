"""The search for an input: screen every family, refine the best, design switching signals and line powers.

Everything is judged at its largest admissible amplitude as the linearised aircraft predicts it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from testbench.design.candidates import Candidate, candidates, sampled
from testbench.design.candidates import switching as switching_specs
from testbench.design.information import Criterion, Experiment, accuracy, cost
from testbench.design.prediction import Prediction
from testbench.design.switching import design_switching, switching
from testbench.design.targets import Targets
from testbench.errors import EstimationError, ScenarioError
from testbench.record import FloatArray
from testbench.scenario import Control, Input, Multisine

_REFINED = 3  # families whose free times are refined
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
_BLOCKS = 48  # most steps of a designed switching signal
_RANDOM_STARTS = 12
_POWER_ROUNDS = 60


@dataclass(frozen=True, eq=False)
class Problem:
    """What is to be designed.

    Attributes:
        experiment, prediction: the aircraft seen through its sensors, and its limits.
        targets: what is to be known.
        criterion: what is made small.
        controls: (m,) controls that move.
        duration_s: of the manoeuvre.
        start_s: undisturbed flight before the input.
        shortest_s: shortest step that can be flown.
        band_hz: band of the targets.
        by_hand: a pilot flies.
        seed: of random starts.
    """

    experiment: Experiment
    prediction: Prediction
    targets: Targets
    criterion: Criterion
    controls: tuple[Control, ...]
    duration_s: float
    start_s: float
    shortest_s: float
    band_hz: tuple[float, float]
    by_hand: bool
    seed: int = 0

    @property
    def rate_hz(self) -> float:
        """Rate of the inputs, Hz."""
        return 1.0 / self.experiment.dt_s


@dataclass(frozen=True, eq=False)
class Design:
    """One input at its largest admissible amplitude, and what it tells.

    Attributes:
        family, words: which signal.
        specs: scenario entries that fly it.
        u: (samples, m) what is commanded, deviation from trim.
        limit: the limit that binds.
        cost: the criterion, in wanted errors; 1 or less reaches them.
        errors: (t,) predicted standard errors of the targets.
        information: (k, k) Fisher information.
    """

    family: str
    words: str
    specs: tuple[Input, ...]
    u: FloatArray
    limit: str
    cost: float
    errors: FloatArray
    information: FloatArray

    @property
    def duration_s(self) -> float:
        """When the last input ends, counted from the clock of the inputs; set by whoever knows the rate."""
        moving = np.flatnonzero(np.any(self.u != 0.0, axis=1))
        return float(moving[-1] + 1) if moving.size else 0.0


class Screened(NamedTuple):
    """A candidate with its cost at the largest admissible amplitude, that factor and the limit that binds."""

    cost: float
    candidate: Candidate
    factor: float
    limit: str


def judge(problem: Problem, candidate: Candidate) -> Screened:
    """Return the cost of a candidate at its largest admissible amplitude."""
    factor, limit = problem.prediction.largest_factor(candidate.u)
    M = problem.experiment.information(candidate.u)
    return Screened(cost(M, problem.targets.gradient, problem.criterion) / factor, candidate, factor, limit)


def screen(problem: Problem, progress: Callable[[int], None] | None = None) -> list[Screened]:
    """Return every candidate of every family, best first."""
    out = []
    for count, candidate in enumerate(
        candidates(
            problem.controls,
            problem.duration_s,
            problem.shortest_s,
            problem.band_hz,
            problem.rate_hz,
            problem.by_hand,
            problem.start_s,
        )
    ):
        out.append(judge(problem, candidate))
        if progress is not None:
            progress(count + 1)
    if not out:
        raise EstimationError(
            f"no signal fits into duration_s = {problem.duration_s:g} with steps of at least {problem.shortest_s:g} s; "
            "lengthen the manoeuvre or shorten the shortest step"
        )
    return sorted(out, key=lambda s: s.cost)


def search(problem: Problem, progress: Callable[[str], None] | None = None) -> list[Design]:
    """Return the best of every family, the designed switching signal and the designed multisine, best first.

    Raises:
        EstimationError: no signal of any family fits, or none tells anything of some target.
    """
    say = progress or (lambda text: None)
    say("screen every family")
    ranked = screen(problem)
    best: dict[str, Screened] = {}
    for entry in ranked:
        best.setdefault(entry.candidate.family, entry)
    if not np.isfinite(ranked[0].cost):
        raise EstimationError(
            "no signal of any family tells all targets apart through these sensors; leave targets out, or add sensors "
            "or controls"
        )
    say("refine the best")
    for family in list(best)[:_REFINED]:
        best[family] = _refined(problem, best[family])
    designed = [_design(problem, entry) for entry in best.values() if np.isfinite(entry.cost)]
    say("design a switching signal")
    designed.append(_designed_switching(problem, ranked))
    if not problem.by_hand:
        say("design a multisine")
        designed += _designed_multisine(problem, best.get("multisine"))
    return sorted(designed, key=lambda d: d.cost)


def _design(problem: Problem, entry: Screened) -> Design:
    specs = entry.candidate.scaled(entry.factor)
    u = sampled(specs, problem.controls, problem.duration_s, problem.rate_hz)
    M = problem.experiment.information(u)
    return Design(
        entry.candidate.family,
        entry.candidate.words,
        specs,
        u,
        entry.limit,
        cost(M, problem.targets.gradient, problem.criterion),
        problem.targets.errors(accuracy(M).covariance),
        M,
    )


def rescaled(problem: Problem, design: Design, factor: float, limit: str) -> Design:
    """Return a design at ``factor`` times its amplitude, bound by another limit."""
    specs = Candidate(design.family, design.words, design.specs, design.u).scaled(factor)
    return _design(problem, Screened(0.0, Candidate(design.family, design.words, specs, design.u), 1.0, limit))


_TIMES = ("period_s", "step_s", "width_s")


def _refined(problem: Problem, entry: Screened) -> Screened:
    """Return the candidate with its one free time moved to the minimum between its neighbours (golden section)."""
    spec = entry.candidate.specs[0]
    key = next((k for k in _TIMES if hasattr(spec, k)), None)
    if key is None or isinstance(spec, Multisine) or hasattr(spec, "seed"):
        return entry
    centre = float(getattr(spec, key))
    tried = {centre: entry}

    def at(value: float) -> Screened:
        value = round(value * problem.rate_hz) / problem.rate_hz
        if value not in tried:
            specs = []
            for s in entry.candidate.specs:
                change = {key: value}
                if getattr(s, "spacing_s", None) is not None:
                    change["spacing_s"] = value
                specs.append(s.model_copy(update=change))
            try:
                u = sampled(specs, problem.controls, problem.duration_s, problem.rate_hz)
            except ScenarioError:
                return replace_cost(entry)
            words = entry.candidate.words.rsplit(" ", 2)[0] + f" {value:.4g} s"
            tried[value] = judge(problem, Candidate(entry.candidate.family, words, tuple(specs), u))
        return tried[value]

    low, high = max(0.75 * centre, _shortest(spec, problem)), 1.33 * centre
    for _ in range(14):
        a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        if at(a).cost < at(b).cost:
            high = b
        else:
            low = a
    return min(tried.values(), key=lambda s: s.cost)


def replace_cost(entry: Screened) -> Screened:
    """Return an entry that never wins: a signal that does not fit."""
    return entry._replace(cost=float("inf"))


def _shortest(spec: Input, problem: Problem) -> float:
    return problem.shortest_s * (2.0 if hasattr(spec, "period_s") else 1.0)


def _designed_switching(problem: Problem, ranked: Sequence[Screened]) -> Design:
    """Return the best switching signal with steps of the shortest holdable length, or longer if there were too many."""
    rate, m = problem.rate_hz, len(problem.controls)
    start = round(problem.start_s * rate)
    left = problem.experiment.samples * problem.experiment.stride - start
    step = max(round(problem.shortest_s * rate), 1)
    while left // step * m > _BLOCKS:
        step += max(1, step // 4)
    count = left // step
    form = switching(
        problem.experiment, problem.prediction, problem.targets.gradient, problem.criterion, step, start, count
    )
    starts = []
    middle = start + step // 2 + step * np.arange(count)
    for entry in ranked[:6]:
        starts.append(np.sign(np.round(entry.candidate.u[middle].T.ravel(), 9)))
    signs, _ = design_switching(form, starts, _RANDOM_STARTS, problem.seed)
    specs: tuple[Input, ...] = ()
    for i, control in enumerate(problem.controls):
        specs += switching_specs(signs[i * count : (i + 1) * count].tolist(), control, step / rate, start / rate)
    u = sampled(specs, problem.controls, problem.duration_s, rate)
    words = f"{len(specs)} multistep{'s' if len(specs) > 1 else ''} of {step / rate:.3g} s"
    return _design(problem, judge(problem, Candidate("designed switching", words, specs, u)))


def _designed_multisine(problem: Problem, best: Screened | None) -> list[Design]:
    """Return the best multisine with line powers shaped to the targets.

    Lines are worth, per unit of power, the trace of C^-1 weighted information; powers are multiplied by their worth
    until it is equal on all lines that remain (multiplicative algorithm: S. D. Silvey et al., Communications in
    Statistics A 7, 1978), for the A criterion of the targets.
    """
    if best is None or len(best.candidate.specs) != 1:
        return []
    spec = best.candidate.specs[0]
    assert isinstance(spec, Multisine)
    wide = spec.model_copy(update={"f_min_hz": 1.0 / spec.period_s, "f_max_hz": _highest(problem, spec)})
    from testbench.inputs.multisine import harmonics

    numbers = harmonics(wide)
    lines = []
    for number in numbers:
        t = (
            2.0
            * np.pi
            * number
            / spec.period_s
            * (np.arange(len(best.candidate.u)) / problem.rate_hz - problem.start_s)
        )
        u = np.where(t >= 0.0, np.cos(t), 0.0)[:, None]
        v = np.where(t >= 0.0, np.sin(t), 0.0)[:, None]
        lines.append(problem.experiment.information(u) + problem.experiment.information(v))
    K, G = np.stack(lines), problem.targets.gradient
    power = np.full(len(numbers), 1.0 / len(numbers))
    for _ in range(_POWER_ROUNDS):
        half = np.linalg.solve(np.einsum("l,lij->ij", power, K), G.T)
        worth = np.einsum("it,lij,jt->l", half, K, half)
        power = power * np.sqrt(worth)
        power /= power.sum()
    power = np.where(power > 1e-3 * power.max(), power, 0.0)
    shaped = wide.model_copy(update={"powers": tuple(np.round(power / power.max(), 4).tolist())})
    u = sampled([shaped], problem.controls, problem.duration_s, problem.rate_hz)
    words = f"{np.count_nonzero(power)} lines of {spec.period_s:.3g} s, powers shaped to the targets"
    return [_design(problem, judge(problem, Candidate("designed multisine", words, (shaped,), u)))]


def _highest(problem: Problem, spec: Multisine) -> float:
    """Return the highest frequency that the designed multisine may use, Hz."""
    return max(min(2.0 * problem.band_hz[1], problem.rate_hz / 10.0, 0.5 / problem.shortest_s), 2.0 / spec.period_s)
