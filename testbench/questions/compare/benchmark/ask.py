"""Run every method on every data set; what is finished is kept, cell by cell."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from testbench.core.door import read_text
from testbench.core.errors import RecordError, Refusal, ScenarioError, nearest
from testbench.core.files import not_written
from testbench.core.processes import cores, processes, spread
from testbench.core.store import ResultFolder
from testbench.estimators import estimate
from testbench.estimators.cells import contained, need_numbers
from testbench.estimators.continuous import ContinuousTransferModel
from testbench.estimators.model import IdentifiedModel
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.state_space import StateSpaceModel
from testbench.questions.compare.benchmark.flights import INPUTS, OUTPUTS
from testbench.questions.compare.benchmark.result import Benchmark, Cell, Entry, entries
from testbench.questions.compare.benchmark.sets import FIRST_SEED, SETS, Flown, definition, flown, sha256

KEPT = "cells.jsonl"
"""File in the folder of a benchmark: one line for each cell that is finished."""
SEEDS = 5
Report = Callable[[str], None]


def benchmark(
    folder: Path | str | ResultFolder,
    *,
    seeds: int = SEEDS,
    sets: Sequence[str] = (),
    methods: Sequence[str] = (),
    limit_s: float = 120.0,
    workers: int | None = None,
    progress: Report | None = None,
) -> Benchmark:
    """Run methods on the packaged data sets; the same call goes on with one that was interrupted.

    Args:
        folder: where finished cells are kept, or one that is being written. More seeds, sets or methods later fly only
            what is missing.
        seeds: flights of each simulated data set.
        sets: names of :data:`~.sets.SETS`; all of them if empty. Recorded flights that are absent are left out.
        methods: names of METHODS, all of them if none is named; and beside them estimators of your own, FILE.py:NAME.
        limit_s: that a method may take for one flight, s.
        workers: processes; one per processor if not given.
        progress: called with a few words as each data set and seed begins.

    Raises:
        ScenarioError: a data set that there is not, or an own estimator that breaks a law.
        EstimationError: a method that there is not.
        RecordError: no data set is there.
        WriteError: the folder cannot be written to.

    Example:
        >>> import testbench as tb
        >>> tb.benchmark("my_benchmark", seeds=2, sets=["clean"], methods=["output_error"]).sha256  # doctest: +SKIP
    """
    if not isinstance(folder, ResultFolder):
        given: dict[str, Any] = {"seeds": seeds, "sets": sets, "methods": methods, "limit_s": limit_s}
        with ResultFolder(folder, adds=True) as place:
            return benchmark(place, workers=workers, progress=progress, **given)
    say = progress or (lambda text: None)
    wrong = [name for name in sets if name not in SETS]
    if wrong:
        raise ScenarioError([f"a data set must be one of the benchmark, got '{n}'{nearest(n, SETS)}" for n in wrong])
    asked = [SETS[name] for name in dict.fromkeys(sets or SETS)]
    run = entries(methods)
    defined = {data.name: definition(data) for data in asked}
    there = tuple(data for data in asked if defined[data.name] is not None)
    if not there:
        raise RecordError(
            "a benchmark needs a data set, got only recorded flights that are not there; set TESTBENCH_FLIGHT_DATA to "
            "their folder, or name a simulated one"
        )
    numbers = tuple(range(FIRST_SEED, FIRST_SEED + seeds))
    name = sha256({"data": [defined[d.name] for d in there], "methods": [e.told for e in run], "seeds": numbers})
    kept = Kept(folder.live(KEPT))
    cells: dict[tuple[str, str], dict[int, Cell]] = {(d.name, e.label): {} for d in there for e in run}
    with processes(workers or cores()):
        for i, seed in enumerate(numbers):
            for data in there:
                if data.records and i:
                    continue
                say(f"flight {i + 1} of {seeds}: {data.name}")
                keys = {e.label: sha256([defined[data.name], e.told, seed, limit_s]) for e in run}
                missing = [e for e in run if keys[e.label] not in kept.cells]
                if missing:
                    flight = flown(data, seed)
                    found = spread([partial(_cell, flight, e, limit_s) for e in missing])
                    for e, cell in zip(missing, found, strict=True):
                        kept.add(keys[e.label], cell, data.name, e.label, seed)
                for label, key in keys.items():
                    cells[data.name, label][seed] = kept.cells[key]
    return Benchmark(name, there, run, numbers, tuple(d for d in asked if d not in there), cells)


def _cell(flight: Flown, entry: Entry, limit_s: float) -> Cell:
    """Return what a method finds in one flight; whatever goes wrong is a reason."""
    truth = (float(flight.truth[0]), float(flight.truth[1]))
    limit = None if flight.bound is None else (float(flight.bound[0]), float(flight.bound[1]))
    began = time.process_time()
    try:
        with contained(entry.label, limit_s):
            model = estimate(entry.settings, [flight.record], INPUTS, OUTPUTS, [flight.unseen])
            pole = _nearest(need_numbers(model).poles(), truth)
            stated = _stated(model, flight, pole)
    except Refusal as error:
        return Cell(None, limit, truth, {}, time.process_time() - began, error.message)
    if pole is None:
        none = "it must give a pole, got none that has a continuous counterpart"
        return Cell(None, limit, truth, {}, time.process_time() - began, none)
    wn, zeta = abs(pole), -pole.real / abs(pole)
    return Cell((wn - truth[0], zeta - truth[1]), limit, truth, stated, time.process_time() - began)


def _nearest(poles: Mapping[str, Any], truth: tuple[float, float]) -> complex | None:
    """Return the pole nearest to the true one, of all outputs."""
    found = np.concatenate([np.zeros(0, complex), *(np.ravel(s) for s in poles.values())])
    found = found[np.abs(found) > 0.0]
    target = truth[0] * complex(-truth[1], np.sqrt(1.0 - truth[1] ** 2))
    return complex(found[np.argmin(np.abs(found - target))]) if found.size else None


def _stated(model: IdentifiedModel, flight: Flown, pole: complex | None) -> dict[str, tuple[float, float]]:
    """Return (error, standard error) of the derivatives if the model has them, else of wn and zeta of its pole."""
    if flight.bound is None or pole is None:
        return {}
    if isinstance(model, ParametricModel):
        values, errors = model.values, model.standard_errors
        return {k: (values[k] - true, errors[k]) for k, true in flight.derivatives.items() if k in values}
    stated: list[tuple[complex, float, float, float, float]] = []  # pole, wn, its error, zeta, its error
    if isinstance(model, ContinuousTransferModel):
        stated = [(m[0], m[1], m[3], m[2], m[4]) for of in model.modes().values() for m in of]
    elif isinstance(model, StateSpaceModel):
        accuracy = model.diagnostics.get("pole_accuracy", ())
        stated = [(m.pole, m.wn_rad_s, m.wn_std, m.zeta, m.zeta_std) for m in accuracy]
    if not stated:
        return {}
    _, wn, wn_error, zeta, zeta_error = min(stated, key=lambda m: abs(m[0] - complex(pole.real, abs(pole.imag))))
    return {"wn": (wn - flight.truth[0], wn_error), "zeta": (zeta - flight.truth[1], zeta_error)}


class Kept:
    """The cells that are finished, by the hash of all that decides them."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.cells: dict[str, Cell] = {}
        text = read_text(path, "journal") if path.is_file() else ""
        self._before = "" if text.endswith("\n") or not text else "\n"  # after a line that was cut off
        for line in text.splitlines():
            with suppress(ValueError, KeyError, TypeError, OverflowError):  # a line that was cut off is flown again
                row = json.loads(line)
                pairs = {k: (float(e), float(s)) for k, (e, s) in row["stated"].items()}
                errors, bound = (tuple(row[k]) if row[k] else None for k in ("errors", "bound"))
                self.cells[row["key"]] = Cell(
                    errors, bound, tuple(row["truth"]), pairs, row["seconds"], row["reason"]
                )  # fmt: skip

    def add(self, key: str, cell: Cell, data: str, method: str, seed: int) -> None:
        """Keep one more.

        Raises:
            WriteError: the file cannot be written to.
        """
        self.cells[key] = cell
        row = {"key": key, "set": data, "method": method, "seed": seed, **cell._asdict()}
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(self._before + json.dumps(row) + "\n")
            self._before = ""
        except OSError as error:
            raise not_written(self.path, error) from error
