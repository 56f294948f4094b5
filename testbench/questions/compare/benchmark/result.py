"""What a benchmark found: one cell per data set, method and seed, and the scores of each data set and method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from testbench.core import bring
from testbench.core.door import sha256
from testbench.core.errors import EstimationError, nearest
from testbench.core.record import FloatArray
from testbench.estimators import METHODS, settings_of
from testbench.estimators.brought import OwnMethod, place, whole
from testbench.estimators.settings import Settings
from testbench.page.shown import Shown
from testbench.questions.compare.benchmark.sets import DataSet
from testbench.questions.side_by_side import Contest

ASKED: dict[str, Any] = {
    "order": 2,
    "past_horizon": 12,
    "future_horizon": 15,
    "poles": 2,
    "zeros": 1,
    "window_s": [6.0],
    "hold": "zoh",
    "structure": "short_period",
    "held": ["de"],
}
"""Setting -> value, for every method that has it. A new row of METHODS with such settings needs nothing here."""
_LISTS = {"srivc": ("poles", "zeros"), "transfer_function": ("zeros",)}


class Entry(NamedTuple):
    """A method in a benchmark: its name in tables, its settings, and the SHA-256 of its file if it was brought."""

    label: str
    settings: Settings
    told: dict[str, Any]


def entries(methods: Sequence[str] = ()) -> tuple[Entry, ...]:
    """Return the methods of a benchmark.

    Args:
        methods: names of METHODS, all of them if none is named; and estimators of one's own, FILE.py:NAME, on top.

    Raises:
        EstimationError: a name is not in the table.
        ScenarioError: a file is not there, or does not define the function.
    """
    own = [name for name in methods if ":" in name or name.endswith(".py")]
    named = [name for name in methods if name not in own]
    for name in named:
        if name not in METHODS:
            raise EstimationError(f"the method must be one of the table, got '{name}'{nearest(name, METHODS)}")
    out = [_packaged(name) for name in (named or METHODS)]
    return (*out, *(_own(name) for name in own))


def _packaged(name: str) -> Entry:
    lists = _LISTS.get(name, ())
    fields = METHODS[name].settings.model_fields
    given: Mapping[str, Any] = {k: [v] if k in lists else v for k, v in ASKED.items() if k in fields}
    settings = settings_of(name, dict(given))
    return Entry(name, settings, settings.model_dump(mode="json"))


def _own(name: str) -> Entry:
    settings = settings_of(whole(name, None), {})
    assert isinstance(settings, OwnMethod)
    path, attribute = place(settings.method)
    told = {"file": Path(path).name, "name": attribute, "sha256": sha256(path, "python")}
    return Entry(bring.short(settings.method), settings, told)


LEVEL = 1.959964  # of a 95 % interval, in standard errors


class Cell(NamedTuple):
    """One method on one flight."""

    # of wn (rad/s) and zeta, estimate minus truth or printed value; None if it failed
    errors: tuple[float, float] | None
    bound: tuple[float, float] | None  # Cramér-Rao bound of both; None for recorded flights
    truth: tuple[float, float]  # of both
    stated: Mapping[str, tuple[float, float]]  # figure -> (error, standard error that the method states)
    seconds: float  # of the processor, that it took
    reason: str = ""  # why it failed; "" if it did not


class Score(NamedTuple):
    """One method on one data set."""

    # data, method: their names
    data: str
    method: str
    flights: int  # that it was given, and ``failed`` of them without a model; ``reason`` of the first
    failed: int
    rms: float | None  # of the errors of wn and zeta, in bounds; None for recorded flights, or if it gave none
    relative: float | None  # rms of both errors over the true or printed values
    # share of the stated 95 % intervals that hold the truth, of ``intervals``; None if none is stated
    held: float | None
    intervals: int
    seconds: float  # of the processor, median
    reason: str


@dataclass(frozen=True, eq=False)
class Benchmark(Shown, page="testbench.questions.compare.benchmark.page:benchmark_page"):
    """A finished benchmark.

    Attributes:
        sha256: of the definitions of data, the settings of methods and the seeds; it names the benchmark.
        sets, methods, seeds: in the order of tables.
        absent: recorded flights that were not there.
        cells: (set, method) -> seed -> cell.
    """

    sha256: str
    sets: tuple[DataSet, ...]
    methods: tuple[Entry, ...]
    seeds: tuple[int, ...]
    absent: tuple[DataSet, ...]
    cells: Mapping[tuple[str, str], Mapping[int, Cell]] = field(default_factory=dict)

    def score(self, data: str, method: str) -> Score:
        """Return how a method fares on a data set."""
        cells = list(self.cells[data, method].values())
        found = [c for c in cells if c.errors is not None]
        stated = stated_errors(found)
        over = np.array([np.divide(c.errors or (), c.bound) for c in found if c.bound is not None])
        relative = np.array([np.divide(c.errors or (), c.truth) for c in found])
        return Score(
            data,
            method,
            len(cells),
            len(cells) - len(found),
            float(np.sqrt(np.mean(over**2))) if over.size else None,
            float(np.sqrt(np.mean(relative**2))) if relative.size else None,
            float(np.mean(np.abs(stated[:, 0]) <= LEVEL * stated[:, 1])) if stated.size else None,
            len(stated),
            float(np.median([c.seconds for c in cells])),
            next((c.reason for c in cells if c.errors is None), ""),
        )

    def contest(self) -> Contest:
        """Return the rms errors (sets, methods), by which methods are ranked.

        A method that gave no model for more than half of the flights of a set has NaN there, which ranks last.
        """
        rows = np.full((len(self.sets), len(self.methods)), np.nan)
        for i, data in enumerate(self.sets):
            for k, entry in enumerate(self.methods):
                s = self.score(data.name, entry.label)
                if 2 * s.failed <= s.flights and s.relative is not None:
                    rows[i, k] = s.relative if s.rms is None else s.rms
        return Contest("all data sets", "wn and zeta", "", tuple(m.label for m in self.methods), rows)

    def calibration(self) -> dict[str, FloatArray]:
        """Return method -> (n, 2) errors and stated standard errors over all simulated flights, where any is stated."""
        out = {}
        for entry in self.methods:
            cells = [c for d in self.sets if not d.records for c in self.cells[d.name, entry.label].values()]
            stated = stated_errors(cells)
            if len(stated) > 2:
                out[entry.label] = stated
        return out


def stated_errors(cells: Sequence[Cell]) -> FloatArray:
    """Return (error, stated standard error) of all figures of cells (n, 2), where the latter is a positive number."""
    pairs: list[Any] = [p for c in cells if c.errors is not None for p in c.stated.values()]
    found = np.array(pairs, float).reshape(-1, 2)
    return found[np.isfinite(found).all(axis=1) & (found[:, 1] > 0.0)]
