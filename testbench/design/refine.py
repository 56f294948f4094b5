"""Inputs refined by information: free times, switching signals, line powers, and the shortest input that is enough.

A switching signal has every step at full amplitude or at rest. With steps of one length the response is a sum over
steps, so the information is a quadratic form in their signs: M = sum_i sum_j s_i s_j K_ij. The K are computed once;
changing one step then costs a few small matrix operations. The exchange visits all steps, keeps for each the sign that
lowers the cost most, and starts again until nothing changes (coordinate exchange: R. K. Meyer and C. J. Nachtsheim,
Technometrics 37, 1995; optimal square waves in flight test: E. A. Morelli and V. Klein, Journal of Aircraft 27(8),
1990). Over several aircraft the cost is that of the worst, at the amplitude that keeps the limits of all.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from testbench.core.errors import ScenarioError
from testbench.core.record import FloatArray
from testbench.core.scenario.inputs import Input, Multisine
from testbench.design.candidates import Candidate, switching_specs
from testbench.design.problem import Design, Problem, Screened, design_of, judge
from testbench.inputs.multisine import harmonics

BLOCKS = 48
"""Most steps of a designed switching signal, all controls together."""
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_ROUNDS = 10  # of the golden section
_TIMES = ("period_s", "step_s", "width_s")
_PASSES = 20  # most visits of all steps
_LEVELS = (1.0, -1.0, 0.0)
_RANDOM_STARTS = 6
_BISECTIONS = 6
_POWER_ROUNDS = 60
_LEAST_POWER = 1e-3  # of the largest, below which a line is left out


# --- free times -------------------------------------------------------------------------------------------------------


def refined(problem: Problem, entry: Screened) -> Screened:
    """Return the candidate with its one free time moved to the minimum between its neighbours (golden section)."""
    spec = entry.candidate.specs[0]
    key = next((k for k in _TIMES if hasattr(spec, k)), None)
    if key is None or isinstance(spec, Multisine) or hasattr(spec, "seed"):
        return entry
    centre = float(getattr(spec, key))
    tried = {centre: entry}

    def at(value: float) -> Screened:
        """Return the same signal with another time."""
        value = round(value, 3)
        if value not in tried:
            specs = []
            for s in entry.candidate.specs:
                change = {key: value}
                if getattr(s, "spacing_s", None) is not None:
                    change["spacing_s"] = value
                specs.append(s.model_copy(update=change))
            try:
                u = problem.sampled(specs)
            except ScenarioError:  # it does not fit, and so never wins
                return entry._replace(cost=float("inf"))
            words = entry.candidate.words.rsplit(" ", 2)[0] + f" {value:.4g} s"
            tried[value] = judge(problem, Candidate(entry.candidate.family, words, tuple(specs), u))
        return tried[value]

    shortest = problem.shortest_s * (2.0 if hasattr(spec, "period_s") else 1.0)
    low, high = max(0.75 * centre, shortest), 1.33 * centre
    for _ in range(_ROUNDS):
        a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        if at(a).cost < at(b).cost:
            high = b
        else:
            low = a
    return min(tried.values(), key=lambda s: s.cost)


# --- switching signals ------------------------------------------------------------------------------------------------


class Steps(NamedTuple):
    """When a switching signal may switch, in samples: length of a step, first sample, steps of a control, repeats."""

    step: int
    start: int
    blocks: int
    repeats: int = 1

    def signs_of(self, u: FloatArray) -> FloatArray:
        """Return the signs (b,) of an input (samples, m) in the middle of the steps, all of the first control first."""
        middle = self.start + self.step // 2 + self.step * np.arange(self.blocks)
        return np.asarray(np.sign(np.round(u[middle].T.ravel(), 9)))


@dataclass(frozen=True, eq=False)
class Switching:
    """The quadratic form of one problem for steps of one length, all steps of the first control first."""

    problem: Problem  #: with its criterion, its limits, and what earlier flights gave
    K: FloatArray  #: (b, b, k, k) information of pairs of blocks; a block is one step on one control
    #: (b, n, c) deviations of the limited channels that a block at unit amplitude makes, at the sensors' rate
    y: FloatArray

    @classmethod
    def of(cls, problem: Problem, steps: Steps) -> Switching:
        """Return the quadratic form for some steps, flown several times one after the other if they repeat."""
        experiment, m = problem.experiment, len(problem.experiment.structure.inputs)
        columns, moved = [], []
        for j in range(m):
            for i in range(steps.blocks):
                u = np.zeros((experiment.samples * experiment.stride, m))
                for r in range(steps.repeats):
                    begin = steps.start + (r * steps.blocks + i) * steps.step
                    u[begin : begin + steps.step, j] = 1.0
                columns.append(experiment.weighted(u))
                moved.append(problem.prediction.response(u)[:: experiment.stride])
        k, b = len(experiment.structure.parameters), len(columns)
        W = np.stack(columns, axis=1).reshape(-1, b * k)
        return cls(problem, (W.T @ W).reshape(b, k, b, k).transpose(0, 2, 1, 3), np.stack(moved))

    def at(self, signs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the information (k, k) and the deviations (n, c) of signs (b,) at unit amplitude."""
        return np.einsum("i,j,ijkl->kl", signs, signs, self.K), np.tensordot(signs, self.y, axes=1)


def worst_cost(
    problems: Sequence[Problem], M: Iterable[FloatArray], moved: Sequence[FloatArray], cut: float = np.inf
) -> float:
    """Return the worst criterion over problems at the largest factor that keeps the limits of all.

    Args:
        problems: one per aircraft.
        M: information of each, at unit amplitude; one after the other, as far as it is asked for.
        moved: deviations of its limited channels.
        cut: from which the worst need not be known.
    """
    factor = min(p.prediction.factor_of(y)[0] for p, y in zip(problems, moved, strict=True))
    worst = 0.0
    for p, m in zip(problems, M, strict=True):
        worst = max(worst, p.cost_of(m, factor))
        if worst >= cut:
            break
    return worst


def exchange(forms: Sequence[Switching], signs: FloatArray) -> tuple[FloatArray, float]:
    """Return signs (b,) that no change of a single step improves, and their cost: that of the worst aircraft."""
    s, problems = np.array(signs, float), [f.problem for f in forms]
    M, moved = (list(parts) for parts in zip(*(f.at(s) for f in forms), strict=True))
    best = worst_cost(problems, M, moved)
    for _ in range(_PASSES):
        changed = False
        for b in range(s.size):
            rows = [np.tensordot(s, f.K[b], axes=1) for f in forms]  # sum_j s_j K_bj
            for level in _LEVELS:
                step = level - s[b]
                if step == 0.0:
                    continue
                trial = [m + step * (r + r.T) + step**2 * f.K[b, b] for m, r, f in zip(M, rows, forms, strict=True)]
                there = [y + step * f.y[b] for y, f in zip(moved, forms, strict=True)]
                value = worst_cost(problems, trial, there, best)
                if value < best * (1.0 - 1e-9):
                    best, M, moved, changed = value, trial, there, True
                    s[b] = level
                    rows = [np.tensordot(s, f.K[b], axes=1) for f in forms]
        if not changed:
            break
    return s, best


def designed_signs(form: Switching, starts: Sequence[FloatArray], random_starts: int, seed: int) -> FloatArray:
    """Return the best signs (b,) over exchanges from given starts, those without any step left out, and random ones."""
    rng = np.random.default_rng(seed)
    points = [s for s in starts if np.any(s)] + [rng.choice([1.0, -1.0], len(form.K)) for _ in range(random_starts)]
    return min((exchange([form], point) for point in points), key=lambda pair: pair[1])[0]


def room(problem: Problem) -> tuple[int, int, int]:
    """Return in samples when the input starts, how much time is left from there, and the shortest step."""
    rate = problem.rate_hz
    start = round(problem.start_s * rate)
    left = problem.experiment.samples * problem.experiment.stride - start
    return start, left, max(math.ceil(problem.shortest_s * rate - 1e-6), 1)


def steps_of(problem: Problem) -> Steps:
    """Return the shortest steps that can be held, or longer ones if there would be too many."""
    start, left, shortest = room(problem)
    step = shortest * math.ceil(left / shortest / max(BLOCKS // len(problem.controls), 1))
    return Steps(step, start, left // step)


def designed_switching(problem: Problem, ranked: Sequence[Screened]) -> list[Design]:
    """Return the best switching signal: without repetition, or of short steps repeated if there is time."""
    start, left, shortest = room(problem)
    most = max(BLOCKS // len(problem.controls), 1)
    out = [_switched(problem, ranked, steps_of(problem))]
    if (repeats := left // (most * shortest)) >= 2:
        out.append(_switched(problem, ranked, Steps(shortest, start, most, repeats)))
    return [min(out, key=lambda d: d.cost)]


def minimum_time(problem: Problem, ranked: Sequence[Screened], wanted: float = 1.0) -> Design | None:
    """Return the shortest manoeuvre by a switching signal that brings the cost to ``wanted``; None: not in this time.

    The record ends with the manoeuvre. Its end is found by bisection over whole steps.
    """
    start, left, shortest = room(problem)
    stride = problem.experiment.stride
    most = max(BLOCKS // 2 // len(problem.controls), 1)
    found: Design | None = None
    low, high = 0, left // shortest
    for _ in range(_BISECTIONS):
        middle = high if found is None and high == left // shortest else (low + high + 1) // 2
        end = -(-(start + middle * shortest) // stride) * stride
        step = shortest * math.ceil(middle / most)
        forms = [Steps(step, start, middle * shortest // step)]
        if middle > most:
            forms.append(Steps(shortest, start, most, middle // most))
        trial = min((_switched(problem, ranked, form, end) for form in forms), key=lambda d: d.cost)
        if trial.cost <= wanted:
            found, high = trial, middle
        elif found is None:
            return None
        else:
            low = middle
        if high - low <= 1:
            break
    return found


def _switched(problem: Problem, ranked: Sequence[Screened], steps: Steps, end: int | None = None) -> Design:
    """Return the best switching signal of some steps; the record ends after ``end`` samples, or with the manoeuvre."""
    short = problem
    if end is not None:
        experiment = problem.experiment.until(end // problem.experiment.stride)
        short = replace(problem, experiment=experiment, prediction=problem.prediction.until(end))
    starts = [steps.signs_of(entry.candidate.u) for entry in ranked[:4]]
    signs = designed_signs(Switching.of(short, steps), starts, _RANDOM_STARTS, problem.seed)
    return switched(problem, signs, steps, "designed switching" if end is None else "shortest switching", end)


def switched(problem: Problem, signs: FloatArray, steps: Steps, family: str, end: int | None = None) -> Design:
    """Return a switching signal as a design at its largest admissible amplitude.

    Args:
        problem: of the design.
        signs: (b,) of all steps of the first control, then of the next one.
        steps: when it may switch.
        family: its name.
        end: sample with which the record ends; with the manoeuvre of the problem if not given.
    """
    rate = problem.rate_hz
    specs: tuple[Input, ...] = ()
    for i, control in enumerate(problem.controls):
        pattern = signs[i * steps.blocks : (i + 1) * steps.blocks].tolist() * steps.repeats
        specs += switching_specs(pattern, control, steps.step / rate, steps.start / rate)
    u = problem.sampled(specs)
    moving = int(np.count_nonzero(signs))
    words = f"{moving} step{'s' if moving > 1 else ''} of {steps.step / rate:.3g} s"
    words += f", {steps.repeats} times" if steps.repeats > 1 else ""
    prediction = problem.prediction if end is None else problem.prediction.until(end)
    entry = Screened(0.0, Candidate(family, words, specs, u), *prediction.largest_factor(u))
    return design_of(problem, entry, None if end is None else end / rate)


# --- line powers ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Lines:
    """The widest multisine on the lines of another, and what a unit of power on each of its lines tells.

    Power is counted in units of what a line alone may have inside the limits of all problems.
    """

    problem: Problem  #: of the believed aircraft
    wide: Multisine  #: the multisine
    free: FloatArray  #: (lines,) the unit of power of each
    K: tuple[FloatArray, ...]  #: per problem (lines, k, k), the information of a unit of power on each line

    @classmethod
    def of(cls, problem: Problem, spec: Multisine, over: Sequence[Problem]) -> Lines:
        """Return the lines of a multisine, for one aircraft or several."""
        top = min(2.0 * problem.band_hz[1], problem.rate_hz / 10.0, 0.5 / problem.shortest_s)
        wide = spec.model_copy(update={"f_min_hz": 1.0 / spec.period_s, "f_max_hz": max(top, 2.0 / spec.period_s)})
        t = np.arange(round(problem.duration_s * problem.rate_hz)) / problem.rate_hz - problem.start_s
        phases = [2.0 * np.pi * number / spec.period_s * t for number in harmonics(wide)]
        waves = [[np.where(t >= 0.0, f(p), 0.0)[:, None] for f in (np.cos, np.sin)] for p in phases]
        free = np.array([min(p.prediction.largest_factor(v)[0] for p in over) ** 2 for _, v in waves])
        K = [
            np.stack([f * sum(p.experiment.information(w) for w in wave) for f, wave in zip(free, waves, strict=True)])
            for p in over
        ]
        return cls(problem, wide, free, tuple(K))

    def half(self, i: int, p: Problem, power: FloatArray) -> FloatArray:
        """Return M^-1 G' (k, t) of problem ``i`` at line powers (lines,), G the targets in wanted errors."""
        M = np.einsum("l,lij->ij", power, self.K[i]) + (0.0 if p.known is None else p.known)
        return np.asarray(np.linalg.solve(M, p.targets.gradient.T))

    def design(self, power: FloatArray, family: str, words: str) -> Design:
        """Return the multisine with line powers (lines,) as a design; the least powers are left out."""
        problem, spec, power = self.problem, self.wide, power * self.free
        power = np.where(power > _LEAST_POWER * power.max(), power, 0.0)
        spec = spec.model_copy(update={"powers": tuple(np.round(power / power.max(), 4).tolist())})
        words = f"{np.count_nonzero(power)} lines of {spec.period_s:.3g} s, {words}"
        return design_of(problem, judge(problem, Candidate(family, words, (spec,), problem.sampled([spec]))))


def designed_multisine(problem: Problem, best: Screened | None) -> list[Design]:
    """Return the best multisine with line powers shaped to the targets.

    The worth of a line is what a unit of its power adds to the A criterion of the targets. Powers are multiplied by the
    root of their worth until the worth is equal on all lines that remain (multiplicative algorithm: S. D. Silvey et
    al., Communications in Statistics A 7, 1978).
    """
    if best is None or len(best.candidate.specs) != 1:
        return []
    spec = best.candidate.specs[0]
    assert isinstance(spec, Multisine)
    lines = Lines.of(problem, spec, [problem])
    power = np.full(lines.free.size, 1.0 / lines.free.size)
    for _ in range(_POWER_ROUNDS):
        half = lines.half(0, problem, power)
        power = power * np.sqrt(np.einsum("it,lij,jt->l", half, lines.K[0], half))
        power /= power.sum()
    return [lines.design(power, "designed multisine", "powers shaped to the targets")]
