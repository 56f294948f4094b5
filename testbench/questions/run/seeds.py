"""The same experiment over many seeds of noise: errors of every model with intervals, and what a suite surely buys."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.errors import Refusal
from testbench.core.processes import cores, processes, spread
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.cells import FailedCell
from testbench.estimators.identification import estimator_name
from testbench.estimators.subspace.tail import without_other_horizons
from testbench.evaluation.statistics import CONFIDENCE, LEAST_PAIRS, Interval, holm, mean_interval, paired
from testbench.line import Case, Report, identify_and_judge

if TYPE_CHECKING:
    from testbench.questions.run.ask import Prepared
    from testbench.questions.run.scenario import Scenario

Key = tuple[str, str]
"""Suite and estimator."""
_PREDICTION = "prediction"


@dataclass(frozen=True)
class Gain:
    """What another suite changes in one error of one estimator, seed by seed."""

    estimator: str  # its name
    quantity: str  # whose error
    suite: str  # compared with the first one
    # before, after: mean error through the first suite and through this one, with its interval, %
    before: Interval
    after: Interval
    # of such differences by chance, corrected for all questions that were asked (Holm); None: too few pairs
    p: float | None

    @property
    def sure(self) -> bool:
        """Return whether the difference is more than chance, at 5 % for all questions together."""
        return self.p is not None and self.p < 1.0 - CONFIDENCE


@dataclass(frozen=True)
class Repeats:
    """Errors over seeds."""

    count: int  # seeds, that of the scenario among them
    # (suite, estimator) -> quantity -> errors (count,), %: of a mode's pole |found - true| / |true|, of a parameter
    # |found - true| / |true|, of the prediction the mean MRSE on validation data over the outputs that all suites
    # sense. NaN where a seed gave none.
    errors: Mapping[Key, Mapping[str, FloatArray]]

    @property
    def quantities(self) -> list[str]:
        """What was found at least twice by some model, in the order of the models."""
        found = [(q, e) for series in self.errors.values() for q, e in series.items()]
        names = list(dict.fromkeys(q for q, e in found if np.isfinite(e).sum() > 1))
        return sorted(names, key=lambda q: q.startswith(_PREDICTION))

    def mean(self, key: Key, quantity: str) -> Interval | None:
        """Return the mean error with its 95 % interval; None if less than two seeds gave one."""
        e = self.errors.get(key, {}).get(quantity, np.empty(0))
        e = e[np.isfinite(e)]
        return mean_interval(e) if e.size > 1 else None

    def most(self, key: Key, quantity: str) -> tuple[float, float]:
        """Return the errors between which nine of ten seeds lie."""
        low, high = np.nanpercentile(self.errors[key][quantity], [5.0, 95.0])
        return float(low), float(high)

    def found(self, key: Key, quantity: str) -> int:
        """Return how many seeds gave an error."""
        return int(np.isfinite(self.errors.get(key, {}).get(quantity, np.empty(0))).sum())

    def gains(self) -> list[Gain]:
        """Return what every suite but the first changes, where enough seeds gave an error through both."""
        suites = list(dict.fromkeys(suite for suite, _ in self.errors))
        out, chances = [], []
        for suite, estimator in self.errors:
            base = suites[0], estimator
            if suite == suites[0] or base not in self.errors:
                continue
            for quantity in self.quantities:
                before, after = self.mean(base, quantity), self.mean((suite, estimator), quantity)
                if before is None or after is None:
                    continue
                differences = self.errors[base][quantity] - self.errors[suite, estimator][quantity]
                differences = differences[np.isfinite(differences)]
                p = paired(differences, "wilcoxon").p if differences.size >= LEAST_PAIRS else None
                out.append(Gain(estimator, quantity, suite, before, after, None))
                chances.append(p)
        corrected = iter(holm([p for p in chances if p is not None]))
        return [g if p is None else replace(g, p=next(corrected)) for g, p in zip(out, chances, strict=True)]


def repeat(
    scenario: Scenario, ready: Prepared, flown: Sequence[FlightRecord], seed: int, first: Sequence[Case], say: Report
) -> Repeats:
    """Repeat an experiment with the scenario's number of seeds; the first of them has been flown and identified.

    In still air all seeds share the flights of the first one, and only the noise of the sensors differs. In turbulence
    every seed has flights of its own, flown together where the model has been found equal to JSBSim.

    Args:
        scenario: its ``seeds`` says how often.
        ready: with the truth that models are judged against.
        flown: truth of each manoeuvre of the first seed.
        seed: of the first.
        first: its cases.
        say: called with a few words.

    Raises:
        TestbenchError: a flight of some seed leaves the limits of the aircraft.
    """
    others = [int(np.random.SeedSequence([seed, k]).generate_state(1)[0]) for k in range(1, scenario.seeds)]
    flights = _flights(scenario, ready, tuple(flown), others, say)
    say(f"repeat with {len(others)} more seeds")
    outputs = [o for o in first[0].model.outputs if all(o in case.model.outputs for case in first)]
    with processes(cores()), without_other_horizons():
        tasks = [
            partial(_one, scenario, replace(ready, flown=f), s, outputs) for s, f in zip(others, flights, strict=True)
        ]
        count = len(others)
        found = [_errors(first, outputs), *spread(tasks, lambda done: say(f"repeat with {done} of {count} more seeds"))]
    keys = list(dict.fromkeys(key for one in found for key in one))
    errors: dict[Key, dict[str, FloatArray]] = {}
    for key in keys:
        names = dict.fromkeys(q for one in found for q in one.get(key, {}))
        errors[key] = {q: np.array([one.get(key, {}).get(q, np.nan) for one in found]) for q in names}
    return Repeats(len(found), errors)


def _flights(
    scenario: Scenario, ready: Prepared, first: tuple[FlightRecord, ...], seeds: Sequence[int], say: Report
) -> list[tuple[FlightRecord, ...]]:
    """Return the true records of every seed: those of the first in still air, else flown together."""
    if not scenario.air.turbulence_rms_m_s > 0.0:
        return [first] * len(seeds)
    from testbench.flight.batch.fly import fly_jobs
    from testbench.questions.run.ask import wanted_flights

    say(f"fly {len(seeds)} more seeds")
    jobs = [job for s in seeds for job in wanted_flights(scenario, ready, s)]
    records: list[FlightRecord] = []
    for flown in fly_jobs(jobs, "auto"):
        if not isinstance(flown, FlightRecord):
            raise flown
        records.append(flown)
    n = len(scenario.manoeuvre)
    return [tuple(records[i : i + n]) for i in range(0, len(records), n)]


def _one(scenario: Scenario, ready: Prepared, seed: int, outputs: Sequence[str]) -> dict[Key, dict[str, float]]:
    """Measure, identify and judge one seed; a seed of which nothing comes is an empty row."""
    from testbench.questions.run.ask import fly_all

    quiet: Report = lambda text: None  # noqa: E731
    flights = fly_all(scenario, ready, seed, None, quiet)
    failed = list[FailedCell]()
    try:
        cases = identify_and_judge(flights, scenario, truth=ready.truth, failed=failed)
    except Refusal:
        return {}
    return _errors(cases, outputs)


def _errors(cases: Sequence[Case], outputs: Sequence[str]) -> dict[Key, dict[str, float]]:
    """Return the errors of one seed, %: prediction of the shared outputs, poles of the modes, parameters."""
    out: dict[Key, dict[str, float]] = {}
    for case in cases:
        e = case.evaluation
        mine = out.setdefault((case.suite, estimator_name(case.estimator)), {})
        sets = len({match.outputs for match in e.poles})
        for match in e.poles:
            if match.found is not None:
                of = f" ({match.outputs})" if sets > 1 else ""
                mine[f"{match.name}{of}"] = 100.0 * abs(match.found - match.true) / abs(match.true)
        for p in e.parameters:
            if p.free and p.true:
                mine[p.name] = 100.0 * abs(p.value - p.true) / abs(p.true)
        if outputs:
            places = [case.model.outputs.index(o) for o in outputs]
            mine[f"{_PREDICTION} of {', '.join(outputs)}"] = float(np.mean(e.validation.mrse_percent[places]))
    return out
