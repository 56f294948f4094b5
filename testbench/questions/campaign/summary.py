"""What a campaign found: location and scatter of every figure, errors against truth, coverage, failures."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from testbench.core.proportion import proportion_interval
from testbench.core.record import FloatArray
from testbench.core.words import without_numbers
from testbench.flight.batch.jobs import Tally
from testbench.questions.campaign.scenario import Entry
from testbench.questions.campaign.store import Row

QUANTILES = (0.025, 0.25, 0.5, 0.75, 0.975)
Z95 = 1.959963984540054  # standard normal, two-sided 95 %
_GROW = 4096
TRUE = "true"
TOGETHER, ALONE = "batch", "jsbsim"
"""What a finished run says has flown it; behind the second stands why, if a batch was wanted."""
OUTPUTS = re.compile(r" \([^()]*\)(?= (?:wn|zeta))")  # whose poles: the truth is that of the aircraft


@dataclass(frozen=True)
class Figure:
    """One figure over the runs that are done."""

    name: str  # "SUITE, ESTIMATOR: FIGURE"
    # n, missing: runs that gave it, and done runs that did not (a mode that was not found, an infinite error)
    n: int
    missing: int
    # mean, std: over the runs, NaN where there are too few
    mean: float
    std: float
    mean_half: float  # half the width of the mean's 95 % confidence interval (normal)
    quantiles: tuple[float, ...]  # at QUANTILES


@dataclass(frozen=True)
class Accuracy:
    """One estimate against its true value, run by run."""

    name: str  # "SUITE, ESTIMATOR: FIGURE"
    # n, missing: runs with an estimate, and done runs without
    n: int
    missing: int
    true_mean: float  # mean of the true values
    # bias, bias_half: mean error and half its 95 % confidence interval
    bias: float
    bias_half: float
    scatter: float  # standard deviation of the errors
    rms: float  # root mean square of the errors
    stated: float  # root mean square of the standard errors that the estimator states; NaN if it states none
    # coverage, coverage_low, coverage_high: share of runs whose stated 95 % interval holds the truth, and the 95 %
    # interval of that share (Wilson 1927); NaN without stated errors
    coverage: float
    coverage_low: float
    coverage_high: float

    @property
    def biased(self) -> bool:
        """Whether the mean error differs from zero by more than its 95 % interval."""
        return bool(abs(self.bias) > self.bias_half)

    @property
    def near_zero(self) -> bool:
        """Whether the true value is smaller than the errors, so that percent of it say nothing."""
        return not abs(self.true_mean) > self.rms


@dataclass(frozen=True)
class Cause:
    """Runs that failed for one reason, whatever the numbers in it; ``example`` is the reason of run ``first``."""

    reason: str
    count: int
    first: int
    example: str


@dataclass(frozen=True)
class CellCause:
    """Runs in which one suite and estimator gave no model for one reason, whatever the numbers in it."""

    case: str
    cause: Cause


@dataclass(frozen=True, eq=False)
class Summary:
    """What the rows of a campaign say."""

    runs: FloatArray  # (n,) numbers of the finished runs
    done: NDArray[np.bool_]  # (n,) bool
    columns: dict[str, FloatArray]  # name of a figure -> (n,) values, NaN where there is none
    inputs: dict[str, tuple[Entry, ...]]  # varied key -> (n,) values as given
    # figures, accuracies, causes: in the order of their names; causes by number of runs
    figures: tuple[Figure, ...]
    accuracies: tuple[Accuracy, ...]
    causes: tuple[Cause, ...]
    tally: Tally  # by what the finished runs were flown; stores of earlier versions do not say
    # suites and estimators that gave no model in runs that are done, by number of runs
    cells: tuple[CellCause, ...] = ()

    @property
    def failed(self) -> int:
        """Number of runs that failed."""
        return int(self.runs.size - np.count_nonzero(self.done))


class _Columns:
    """Values by name as they come, row by row; memory is that of the numbers alone."""

    def __init__(self) -> None:
        self.size, self.room = 0, _GROW
        self._found: dict[str, dict[str, FloatArray]] = {}

    def add(self, group: str, values: dict[str, float | None]) -> None:
        """Take the values of one group (a case, or the truth) in the current row; None counts as missing."""
        known = self._found.setdefault(group, {})
        for name, value in values.items():
            if name not in known:
                known[name] = np.full(self.room, np.nan)
            if value is not None:
                known[name][self.size] = value

    def next_row(self) -> None:
        """Go on to the next row."""
        self.size += 1
        if self.size == self.room:
            self.room *= 2
            for known in self._found.values():
                for name, values in known.items():
                    known[name] = np.concatenate([values, np.full(values.size, np.nan)])

    def named(self) -> dict[str, FloatArray]:
        """Return "GROUP: NAME" -> values (n,), sorted by name."""
        found = {
            f"{group}: {name}": v[: self.size] for group, known in self._found.items() for name, v in known.items()
        }
        return dict(sorted(found.items()))


def summarise(rows: Iterable[Row]) -> Summary:
    """Return what finished runs found. The rows are in the order of their numbers and may come from an open store.

    Standard errors and intervals take runs as independent. Bias: mean of estimate - truth of the same run. Coverage:
    share of runs with |estimate - truth| <= 1.96 stated standard errors.
    """
    columns = _Columns()
    runs: list[int] = []
    done: list[bool] = []
    whole, cells = _Reasons(), _Reasons()
    inputs: dict[str, list[Entry]] = {}
    tally = Tally()
    for row in rows:
        runs.append(row.run)
        done.append(row.state == "done")
        for key, value in json.loads(row.inputs).items():
            inputs.setdefault(key, []).append(value)
        if row.results:
            found = json.loads(row.results)
            for case, figures in found["figures"].items():
                columns.add(case, figures)
            if "true" in found:
                columns.add(TRUE, found["true"])
            if "flown" in found:  # stores of earlier versions do not say
                if found["flown"] == TOGETHER:
                    tally.batch += 1
                else:
                    tally.by_jsbsim(found["flown"].removeprefix(ALONE).removeprefix(", as "))
            for case, reason in found.get("failed", {}).items():
                cells.add(case, row.run, reason)
        else:
            whole.add("", row.run, row.reason or "no reason given")
        columns.next_row()
    named, flown = columns.named(), np.array(done, bool)
    return Summary(
        np.array(runs, float),
        flown,
        named,
        {key: tuple(values) for key, values in inputs.items()},
        tuple(_figure(name, values[flown]) for name, values in named.items() if not _beside(name, named)),
        tuple(_accuracy(name, truth, named, flown) for name in named if (truth := truth_of(name, named))),
        tuple(cause for _, cause in whole.ordered()),
        tally,
        tuple(CellCause(case, cause) for case, cause in cells.ordered()),
    )


class _Reasons:
    """Counts reasons of failure, those that differ in numbers only together."""

    def __init__(self) -> None:
        self._found: dict[tuple[str, str], Cause] = {}

    def add(self, case: str, run: int, reason: str) -> None:
        """Count the reason of one run."""
        key = case, without_numbers(reason)
        before = self._found.get(key) or Cause(key[1], 0, run, reason)
        self._found[key] = replace(before, count=before.count + 1)

    def ordered(self) -> list[tuple[str, Cause]]:
        """Return case and cause, the most frequent first."""
        found = [(case, cause) for (case, _), cause in self._found.items()]
        return sorted(found, key=lambda item: (-item[1].count, item[0], item[1].reason))


def short_name(name: str, names: Sequence[str]) -> str:
    """Return the figure of a name, then its suite and estimator as far as the names differ in them."""
    case, _, figure = name.partition(": ")
    cases = [n.partition(": ")[0].split(", ", 1) for n in names]
    parts = [part for k, part in enumerate(case.split(", ", 1)) if len({c[k] for c in cases}) > 1]
    return f"{figure}; {', '.join(parts)}" if parts else figure


def truth_of(name: str, columns: Mapping[str, FloatArray]) -> str:
    """Return the column with the true values of an estimate's column, or "" if there is none."""
    if f"{name}, true" in columns:
        return f"{name}, true"
    group, _, figure = name.partition(": ")
    mode = f"{TRUE}: {OUTPUTS.sub('', figure)}"
    return mode if group != TRUE and mode in columns else ""


def _beside(name: str, columns: Mapping[str, FloatArray]) -> bool:
    """Say whether a column is the truth or the standard error that belongs to another one."""
    head, _, tail = name.rpartition(", ")
    return name.startswith(f"{TRUE}: ") or (tail in {"true", "std"} and head in columns)


def _figure(name: str, values: FloatArray) -> Figure:
    have = values[np.isfinite(values)]
    n = have.size
    mean, std = _moments(have)
    quantiles = np.quantile(have, QUANTILES).tolist() if n else [math.nan] * len(QUANTILES)
    return Figure(name, n, values.size - n, mean, std, _half(std, n), tuple(quantiles))


def _moments(values: FloatArray) -> tuple[float, float]:
    mean = float(np.mean(values)) if values.size else math.nan
    return mean, float(np.std(values, ddof=1)) if values.size > 1 else math.nan


def _half(std: float, n: int) -> float:
    return Z95 * std / math.sqrt(n) if n else math.nan


def _accuracy(name: str, truth: str, columns: Mapping[str, FloatArray], done: NDArray[np.bool_]) -> Accuracy:
    found, true = columns[name][done], columns[truth][done]
    have = np.isfinite(found) & np.isfinite(true)
    error, n = (found - true)[have], int(np.count_nonzero(have))
    bias, scatter = _moments(error)
    stated, share, low, high = math.nan, math.nan, math.nan, math.nan
    if f"{name}, std" in columns and n:
        std = columns[f"{name}, std"][done][have]
        known = np.isfinite(std) & (std > 0.0)
        if known.any():
            stated = float(np.sqrt(np.mean(std[known] ** 2)))
            inside = np.abs(error[known]) <= Z95 * std[known]
            hits, of = int(np.count_nonzero(inside)), int(np.count_nonzero(known))
            share, (low, high) = hits / of, proportion_interval(hits, of)
    true_mean = float(np.mean(true[have])) if n else math.nan
    rms = float(np.sqrt(np.mean(error**2))) if n else math.nan
    half = _half(scatter, n)
    return Accuracy(name, n, found.size - n, true_mean, bias, half, scatter, rms, stated, share, low, high)
