"""Score answers about the test split: figures against the truth and their stated errors, names by level."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from testbench.core.door import read_bytes
from testbench.core.errors import RecordError, nearest
from testbench.core.files import parsed
from testbench.core.proportion import proportion_interval
from testbench.questions.dataset.draws import right_names
from testbench.questions.dataset.open import open_dataset, truth_of

Rows = list[tuple[str, ...]]
_Z = 1.959963984540054  # of 95 %
_MOST_FAULTS = 5
_OF_FIGURES = (
    "level", "figure", "draws", "answered", "median error, %", "90 % below, %", "median error / std",
    "truth within 95 %", "interval, %",
)  # fmt: skip
_OF_NAMES = (
    "level", "cases", "answered", "right", "interval, %", "in set", "one of two", "wrong", "interval, %", "no gap",
    "unexplained",
)  # fmt: skip


VERDICTS = ("right", "in set", "one of two", "wrong", "wrong set", "none", "unexplained")
NO_GAP, UNEXPLAINED = "no gap", "unexplained"
"""Outcomes without a name: nothing is missing; something is, and no effect explains it."""


def score_predictions(
    folder: Path | str, predictions: Path | str, truth: Path | str | None = None
) -> tuple[tuple[str, ...], Rows, tuple[bool, ...]]:
    """Return the scores of a table of answers as heads, rows of texts, and which columns are numbers.

    Errors of figures are in percent of the rms of the truth over the draws of a level, as the truth may be near zero.
    A draw that is not answered counts in "draws" or "cases" only.

    Args:
        folder: of the data set.
        predictions: CSV with the columns draw, figure, value and perhaps std, or draw and said.
        truth: file with the labels of the test split, if it does not lie in the folder.

    Raises:
        RecordError: there is no data set, there are no labels, or the table breaks a law; with the file and its line.
        DatasetError: the data set is not complete.
    """
    flights = open_dataset(folder, "test", truth_of(folder, truth))
    path = Path(predictions)
    table = _table(path, ("draw",))
    naming = "said" in table and "effect" in flights
    _need(path, table, ("draw", "said") if naming else ("draw", "figure", "value"))
    draws = {int(d): i for i, d in reversed(list(enumerate(flights.draw.values)))}
    faults = _faults(table, draws)
    if naming:
        _refuse(path, faults)
        return _names(table, flights, draws)
    figures = [str(x) for x in flights.figure.values]
    faults += [
        (n, f"unknown figure '{f}'{nearest(str(f), figures)}") for n, f in _lines(table, "figure") if f not in figures
    ]
    for column in ("value", "std") if "std" in table else ("value",):
        wrong = ((n, x) for n, x in _lines(table, column) if not _is_number(x))
        faults += [(n, f"{column} must be a finite number, got '{x}'") for n, x in wrong]
    if "std" in table:
        faults += [
            (n, f"std >= 0 must hold, got {x}") for n, x in _lines(table, "std") if _is_number(x) and float(x) < 0.0
        ]
    twice = table.duplicated(["draw", "figure"])
    faults += [(int(k) + 2, "a figure of a draw must be answered once") for k in np.flatnonzero(twice)]
    _refuse(path, faults)
    return _figures(table, flights, draws, figures)


def _table(path: Path, needed: Sequence[str]) -> Any:
    import pandas as pd

    content = read_bytes(path, "table")
    with parsed(path, "a table of answers (CSV)"):
        table = pd.read_csv(io.BytesIO(content), dtype=str, keep_default_na=False, skipinitialspace=True)
    _need(path, table, needed)
    if not len(table):
        raise RecordError(f"'{path}' must hold answers, but it has no line below its heads")
    return table


def _need(path: Path, table: Any, needed: Sequence[str]) -> None:
    missing = [n for n in needed if n not in table]
    if missing:
        raise RecordError(
            f"'{path}' must have the columns {', '.join(needed)}, but it lacks {', '.join(missing)}; "
            f"got {', '.join(map(str, table.columns)) or 'none'}"
        )


def _lines(table: Any, column: str) -> list[tuple[int, str]]:
    """Return line number in the file and text of every entry of a column."""
    return [(k + 2, str(x).strip()) for k, x in enumerate(table[column])]


def _faults(table: Any, draws: dict[int, int]) -> list[tuple[int, str]]:
    out = []
    for n, text in _lines(table, "draw"):
        if not text.isdigit() or int(text) not in draws:
            out.append((n, f"draw must be one of the test split, got '{text}'"))
    return out


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False


def _refuse(path: Path, faults: list[tuple[int, str]]) -> None:
    if faults:
        some = "; ".join(f"line {n}: {fault}" for n, fault in sorted(faults)[:_MOST_FAULTS])
        more = f"; and {len(faults) - _MOST_FAULTS} more" if len(faults) > _MOST_FAULTS else ""
        raise RecordError(f"'{path}': {some}{more}")


def _figures(table: Any, flights: Any, draws: dict[int, int], figures: list[str]) -> Any:
    """Score figures: one row per level and figure that is answered."""
    levels, true = flights.level.values, flights.truth.values
    stated = "std" in table
    stds = table["std"] if stated else [np.nan] * len(table)
    found = {
        (int(d), f.strip()): (float(v), float(s))
        for d, f, v, s in zip(table["draw"], table["figure"], table["value"], stds, strict=True)
    }
    rows: Rows = []
    for code, level in enumerate(flights.level.attrs["names"]):
        of = {d: i for d, i in draws.items() if levels[i] == code}
        for figure in dict.fromkeys(table["figure"].str.strip()):
            column = true[:, figures.index(figure)]
            known = {d: float(column[i]) for d, i in of.items() if np.isfinite(column[i])}
            if not known:
                continue
            answered = [(x, *found[d, figure]) for d, x in known.items() if (d, figure) in found]
            rms = float(np.sqrt(np.mean(np.square(list(known.values())))))
            rows.append((level, figure, str(len(known)), str(len(answered)), *_errors(answered, rms, stated)))
    return _OF_FIGURES, rows, (False, False, *(True,) * 7)


def _errors(answered: list[tuple[float, float, float]], rms: float, stated: bool) -> tuple[str, ...]:
    """Return median and 90th percentile of errors over the rms of the truth, and how errors agree with stated ones."""
    if not answered:
        return ("",) * 5
    true, value, std = np.array(answered).T
    error = np.abs(value - true)
    out = [f"{100.0 * x / rms:.3g}" if rms > 0.0 else "" for x in (np.median(error), np.quantile(error, 0.9))]
    if not stated:
        return (*out, "", "", "")
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(error == 0.0, 0.0, error / std)
    inside = int(np.sum(error <= _Z * std))
    return (*out, f"{np.median(ratio):.3g}", f"{inside} of {len(error)}", _interval(inside, len(error)))


def _names(table: Any, flights: Any, draws: dict[int, int]) -> Any:
    """Score names: one row per level, with Wilson's intervals of right and of wrong names; a set counts by itself."""
    said = {int(d): s.strip() for d, s in zip(table["draw"], table["said"], strict=True)}
    levels, effect = flights.level.values, flights.effect.values
    kinds = flights.effect.attrs["names"]
    rows: Rows = []
    for code, stratum in enumerate(flights.level.attrs["names"]):
        of = {d: i for d, i in draws.items() if levels[i] == code}
        verdicts = []
        for d, i in of.items():
            if d in said:
                right = [right_names(kinds[k]) for k in effect[i] if k >= 0]
                verdicts.append(_verdict(right, said[d]))
        if not of:
            continue
        n = len(verdicts)
        right_n, wrong_n = verdicts.count("right"), verdicts.count("wrong") + verdicts.count("wrong set")
        rows.append(
            (
                stratum, str(len(of)), str(n), str(right_n), _interval(right_n, n), str(verdicts.count("in set")),
                str(verdicts.count("one of two")), str(wrong_n), _interval(wrong_n, n),
                str(verdicts.count("none")), str(verdicts.count("unexplained")),
            )
        )  # fmt: skip
    return _OF_NAMES, rows, (False, *(True,) * 10)


def _verdict(right: list[tuple[str, ...]], said: str) -> str:
    if said in (NO_GAP, UNEXPLAINED):
        return verdict(right, said, ())
    return verdict(right, "named", [name.strip() for name in said.split("|")])


def _interval(k: int, n: int) -> str:
    low, high = proportion_interval(k, n)
    return f"{100.0 * low:.0f} to {100.0 * high:.0f}"


def verdict(right: Sequence[Sequence[str]], outcome: str, names: Sequence[str]) -> str:
    """Return the verdict on one answer, one of :data:`VERDICTS`.

    Of two effects at once both must be named for "right". Where nothing is hidden, or nothing that the library holds,
    any name is wrong, and so is a set. Where one effect has several right names, several of them together are right,
    too: a vane of second order is a lag and a delay.

    Args:
        right: for each hidden effect, the names that are right; none for an effect that the library does not hold.
        outcome: "no gap", "unexplained", or anything else if names are given.
        names: that were said; effects that act together are joined by " + ".
    """
    if outcome in (NO_GAP, UNEXPLAINED):
        return "none" if outcome == NO_GAP else "unexplained"
    known = [r for r in right if r]
    fits = [_fitting(name, known) for name in names]
    if not known or not any(fits):
        return "wrong" if len(names) == 1 else "wrong set"
    if len(names) > 1:
        return "in set" if max(fits) == len(known) else "wrong set"
    if not set(names[0].split(" + ")) <= set().union(*known):
        return "wrong"
    return "right" if fits[0] == len(known) else "one of two"


def _fitting(name: str, right: Sequence[Sequence[str]]) -> int:
    """Return how many of the hidden effects the parts of a name stand for."""
    parts, found = name.split(" + "), 0
    for names in right:
        match = next((p for p in parts if p in names), None)
        if match is not None:
            parts.remove(match)
            found += 1
    return found
