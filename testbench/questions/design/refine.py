"""Inputs refined by information: free times, switching signals, line powers, and the shortest input that is enough."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil

import numpy as np

from testbench.core.errors import ScenarioError
from testbench.core.record import FloatArray
from testbench.core.scenario.inputs import Input, Multisine
from testbench.information.fisher import Experiment
from testbench.inputs.multisine import harmonics
from testbench.questions.design.candidates import Candidate, sampled
from testbench.questions.design.candidates import switching as switching_specs
from testbench.questions.design.prediction import Prediction
from testbench.questions.design.problem import Design, Problem, Screened, design_of, judge
from testbench.questions.design.switching import design_switching, switching

_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
_ROUNDS = 10  # of the golden section
BLOCKS = 48
"""Most steps of a designed switching signal, all controls together."""
_RANDOM_STARTS = 6
_POWER_ROUNDS = 60
_LEAST_POWER = 1e-3  # of the largest, below which a line is left out
_TIMES = ("period_s", "step_s", "width_s")
_BISECTIONS = 6


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
                u = sampled(specs, problem.controls, problem.duration_s, problem.rate_hz)
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


def designed_switching(problem: Problem, ranked: Sequence[Screened]) -> list[Design]:
    """Return the best switching signals: one without repetition, and one of short steps repeated if there is time.

    Steps have the shortest length that can be held, or are longer if there would be too many.
    """
    start, left, shortest = room(problem)
    most = max(BLOCKS // len(problem.controls), 1)
    step = shortest * ceil(left / shortest / most)
    out = [_switched(problem, ranked, problem.experiment, problem.prediction, step, start, left // step, 1)]
    if left // (most * shortest) >= 2:
        repeats = left // (most * shortest)
        out.append(_switched(problem, ranked, problem.experiment, problem.prediction, shortest, start, most, repeats))
    return [min(out, key=lambda d: d.cost)]


def minimum_time(problem: Problem, ranked: Sequence[Screened], wanted: float = 1.0) -> Design | None:
    """Return the shortest manoeuvre by a switching signal that brings the cost to ``wanted``; None: not in this time.

    The record ends with the manoeuvre. Its end is found by bisection over whole steps.
    """
    start, left, shortest = room(problem)
    stride, rate = problem.experiment.stride, problem.rate_hz
    most = max(BLOCKS // 2 // len(problem.controls), 1)
    found: Design | None = None
    low, high = 0, left // shortest
    for _ in range(_BISECTIONS):
        middle = high if found is None and high == left // shortest else (low + high + 1) // 2
        end = -(-(start + middle * shortest) // stride) * stride
        experiment, prediction = problem.experiment.until(end // stride), problem.prediction.until(end)
        step = shortest * ceil(middle / most)
        forms = [(step, middle * shortest // step, 1)]
        if middle > most:
            forms.append((shortest, most, middle // most))
        trials = [
            _switched(problem, ranked, experiment, prediction, step, start, count, repeats, end / rate)
            for step, count, repeats in forms
        ]
        trial = min(trials, key=lambda d: d.cost)
        if trial.cost <= wanted:
            found, high = trial, middle
        elif found is None:
            return None
        else:
            low = middle
        if high - low <= 1:
            break
    return found


def room(problem: Problem) -> tuple[int, int, int]:
    """Return in samples when the input starts, how much time is left from there, and the shortest step."""
    rate = problem.rate_hz
    start = round(problem.start_s * rate)
    left = problem.experiment.samples * problem.experiment.stride - start
    return start, left, max(ceil(problem.shortest_s * rate - 1e-6), 1)


def _switched(
    problem: Problem,
    ranked: Sequence[Screened],
    experiment: Experiment,
    prediction: Prediction,
    step: int,
    start: int,
    count: int,
    repeats: int,
    duration_s: float | None = None,
) -> Design:
    form = switching(
        experiment, prediction, problem.targets.gradient, problem.criterion, step, start, count, repeats, problem.known
    )
    starts = []
    middle = start + step // 2 + step * np.arange(count)
    for entry in ranked[:4]:
        starts.append(np.sign(np.round(entry.candidate.u[middle].T.ravel(), 9)))
    starts = [s for s in starts if np.any(s)]
    signs, _ = design_switching(form, starts, _RANDOM_STARTS, problem.seed)
    family = "designed switching" if duration_s is None else "shortest switching"
    return switched(problem, prediction, signs, (step, start, count, repeats), family, duration_s)


def switched(
    problem: Problem,
    prediction: Prediction,
    signs: FloatArray,
    steps: tuple[int, int, int, int],
    family: str,
    duration_s: float | None = None,
) -> Design:
    """Return a switching signal as a design at its largest admissible amplitude.

    Args:
        problem: of the design.
        prediction: the limits.
        signs: (b,) of all steps of the first control, then of the next one.
        steps: samples of a step, first sample, number of steps of a control, and how often they are flown.
        family: its name.
        duration_s: when the record ends; with the manoeuvre of the problem if not given.
    """
    (step, start, count, repeats), rate = steps, problem.rate_hz
    specs: tuple[Input, ...] = ()
    for i, control in enumerate(problem.controls):
        pattern = signs[i * count : (i + 1) * count].tolist() * repeats
        specs += switching_specs(pattern, control, step / rate, start / rate)
    u = sampled(specs, problem.controls, problem.duration_s, rate)
    moving = int(np.count_nonzero(signs))
    words = f"{moving} step{'s' if moving > 1 else ''} of {step / rate:.3g} s" + (
        f", {repeats} times" if repeats > 1 else ""
    )
    factor, limit = prediction.largest_factor(u)
    candidate = Candidate(family, words, specs, u)
    return design_of(problem, Screened(0.0, candidate, factor, limit), duration_s)


def lines_of(problem: Problem, spec: Multisine) -> tuple[Multisine, list[tuple[FloatArray, FloatArray]]]:
    """Return the widest multisine on the lines of another, and the cosine and sine (samples, 1) of each line."""
    wide = spec.model_copy(update={"f_min_hz": 1.0 / spec.period_s, "f_max_hz": _highest(problem, spec)})
    t = np.arange(round(problem.duration_s * problem.rate_hz)) / problem.rate_hz - problem.start_s
    phases = [2.0 * np.pi * number / spec.period_s * t for number in harmonics(wide)]
    waves = [tuple(np.where(t >= 0.0, f(p), 0.0)[:, None] for f in (np.cos, np.sin)) for p in phases]
    return wide, [(c, s) for c, s in waves]


def shaped(problem: Problem, wide: Multisine, power: FloatArray, family: str, words: str) -> Design:
    """Return a multisine with relative line powers (lines,) as a design; the least powers are left out."""
    power = np.where(power > _LEAST_POWER * power.max(), power, 0.0)
    spec = wide.model_copy(update={"powers": tuple(np.round(power / power.max(), 4).tolist())})
    u = sampled([spec], problem.controls, problem.duration_s, problem.rate_hz)
    words = f"{np.count_nonzero(power)} lines of {spec.period_s:.3g} s, {words}"
    return design_of(problem, judge(problem, Candidate(family, words, (spec,), u)))


def designed_multisine(problem: Problem, best: Screened | None) -> list[Design]:
    """Return the best multisine with line powers shaped to the targets.

    Power is counted in units of what a line alone may have inside the limits. The worth of a line is what a unit of its
    power adds to the A criterion of the targets. Powers are multiplied by the root of their worth until the worth is
    equal on all lines that remain (multiplicative algorithm: S. D. Silvey et al., Communications in Statistics A 7,
    1978).
    """
    if best is None or len(best.candidate.specs) != 1:
        return []
    spec = best.candidate.specs[0]
    assert isinstance(spec, Multisine)
    wide, waves = lines_of(problem, spec)
    lines, free = [], []
    for u, v in waves:
        free.append(problem.prediction.largest_factor(v)[0] ** 2)
        lines.append(free[-1] * (problem.experiment.information(u) + problem.experiment.information(v)))
    K, G = np.stack(lines), problem.targets.gradient
    known = np.zeros(K.shape[1:]) if problem.known is None else problem.known
    power = np.full(len(waves), 1.0 / len(waves))
    for _ in range(_POWER_ROUNDS):
        half = np.linalg.solve(np.einsum("l,lij->ij", power, K) + known, G.T)
        worth = np.einsum("it,lij,jt->l", half, K, half)
        power = power * np.sqrt(worth)
        power /= power.sum()
    return [shaped(problem, wide, power * np.array(free), "designed multisine", "powers shaped to the targets")]


def _highest(problem: Problem, spec: Multisine) -> float:
    """Return the highest frequency that the designed multisine may use, Hz."""
    return max(min(2.0 * problem.band_hz[1], problem.rate_hz / 10.0, 0.5 / problem.shortest_s), 2.0 / spec.period_s)
