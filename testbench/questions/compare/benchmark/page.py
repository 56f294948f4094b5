"""The page of a benchmark: one table of scores, ranks with the critical difference, calibration, how to cite it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.page.page import COMPUTED, Page
from testbench.page.tables import Column, Table, Value
from testbench.page.words import counted, listed
from testbench.questions.side_by_side import calibration_plates, rank_plates, rank_table

if TYPE_CHECKING:
    from testbench.questions.compare.benchmark.result import Benchmark

OVER = "the sets of the benchmark"
_TRUE = 0.95


def benchmark_page(found: Benchmark) -> Page:
    """Return the page of a benchmark."""
    contests = [found.contest()] if len(found.methods) > 1 else []
    ranked = [c for c in contests if c.ranked is not None]
    return Page(
        kicker="Benchmark of identification",
        title=f"{len(found.methods)} methods on {len(found.sets)} data sets",
        question="Which method finds frequency and damping of the short period, and which stated errors are correct?",
        answer=[("lead", _lead(found)), *(("doubt", text) for text in _doubts(found)), ("note", citation(found))],
        tables=[score_table(found), summary_table(found), *([rank_table(ranked, OVER)] if ranked else [])],
        plates=[*rank_plates(ranked, OVER), *calibration_plates(found.calibration())],
        packages=COMPUTED,
        asked=[("data", listed([f"{d.name} ({d.words})" for d in found.sets]))],
        provenance=[
            ("SHA-256 of the benchmark", found.sha256),
            ("seeds", f"{found.seeds[0]} to {found.seeds[-1]}"),
            ("processor time", f"{_seconds(found):.0f} s"),
        ],
        terminal=[summary_table(found)],
        notes=[citation(found)],
    )


def citation(found: Benchmark) -> str:
    """Return how a paper cites the benchmark."""
    from testbench import __version__

    seeds = counted(len(found.seeds), "seed")
    return (
        f"to cite it: flight-testbench {__version__}, testbench compare benchmark, {seeds}, SHA-256 {found.sha256}; "
        "the hash is taken over the definition of the data, the settings of the methods and the seeds"
    )


def _seconds(found: Benchmark) -> float:
    return sum(c.seconds for cells in found.cells.values() for c in cells.values())


def _lead(found: Benchmark) -> str:
    contest = found.contest()
    if len(found.methods) < 2 or contest.ranked is None:
        best = min(
            found.methods,
            key=lambda e: np.nan_to_num(np.nanmean(contest.errors[:, found.methods.index(e)]), nan=np.inf),
        )
        return f"{best.label} has the smallest errors; three data sets and two methods are needed to rank them"
    r = contest.ranked
    first = int(np.argmin(r.mean))
    alike = int(np.sum(r.mean - r.mean[first] < r.critical)) - 1
    rest = len(contest.methods) - 1
    others = "the other method" if rest == 1 else f"the other {rest} methods"
    said = f"{alike} of {others} {'differ' if alike > 1 else 'differs'} from it by no more than chance"
    if not alike:
        said = f"{others} {'differ' if rest > 1 else 'differs'} from it significantly"
    elif rest == 1:
        said = f"{others} differs from it by no more than chance"
    return f"{contest.methods[first]} ranks first, {r.mean[first]:.1f} in the mean of {r.blocks} data sets; {said}"


def _doubts(found: Benchmark) -> list[str]:
    out = []
    if found.absent:
        names = listed([d.name for d in found.absent])
        out.append(
            f"the recorded flights {names} are not there and left out; set TESTBENCH_FLIGHT_DATA to their folder. The "
            "hash is that of the data sets that ran"
        )
    failed = sum(c.errors is None for cells in found.cells.values() for c in cells.values())
    if failed:
        out.append(f"{failed} of {sum(map(len, found.cells.values()))} cells gave no model; the table says why")
    return out


def score_table(found: Benchmark) -> Table:
    """Return one row for each data set and method."""
    columns = (
        Column("set", "data set", get="data"),
        Column("method", "method"),
        Column("rms", "rms error", "bounds", digits=3),
        Column("relative", "rms error", "%", digits=3, get=lambda s: s.relative and 100.0 * s.relative),
        Column("held", "truth held", "%", digits=3, get=lambda s: s.held and 100.0 * s.held),
        *(Column(key, key) for key in ("intervals", "flights", "failed")),
        Column("seconds", "time", "s", digits=2),
        Column("reason", "first reason of failure"),
    )
    scores = [found.score(data.name, entry.label) for data in found.sets for entry in found.methods]
    return Table.of(
        "benchmark", f"Scores of benchmark {found.sha256[:12]}", _caption(found), columns, scores, wide=True
    )


def _caption(found: Benchmark) -> str:
    return (
        "Errors of natural frequency and damping ratio of the short period: of the pole nearest to the true one, in "
        "units of the Cramér-Rao bound of that flight, which assumes that noise, gusts and all but the five "
        "derivatives are known; and relative to the truth. Recorded flights have printed results in place of the "
        "truth, and neither bound nor intervals. Coverage: share of the stated 95 % intervals, of derivatives or else "
        "of frequency and damping, that contain the truth. Time: of the processor, median. SHA-256 of the benchmark: "
        f"{found.sha256}."
    )


def summary_table(found: Benchmark) -> Table:
    """Return one row per method, over all data sets, in the order of the ranks."""
    contest = found.contest()
    r = contest.ranked if len(found.methods) > 1 else None
    rows: list[tuple[Value, ...]] = []
    order = range(len(found.methods)) if r is None else np.argsort(r.mean, kind="stable").tolist()
    known = found.calibration()
    for k in order:
        label = found.methods[k].label
        cells = [c for d in found.sets for c in found.cells[d.name, label].values()]
        stated = known.get(label)
        held = None if stated is None else 100.0 * float(np.mean(np.abs(stated[:, 0]) <= 1.959964 * stated[:, 1]))
        simulated = [contest.errors[i, k] for i, d in enumerate(found.sets) if not d.records]
        median = float(np.median(np.nan_to_num(simulated, nan=np.inf))) if simulated else np.inf
        rows.append(
            (
                label,
                None if r is None else float(r.mean[k]),
                median if np.isfinite(median) else None,
                held,
                sum(c.errors is None for c in cells),
                float(sum(c.seconds for c in cells)),
            )
        )
    columns = (
        Column("method", "method"),
        Column("rank", "mean rank", decimals=2),
        Column("rms", "rms error, median of the sets", "bounds", digits=3),
        Column("held", "truth held", "%", digits=3),
        Column("failed", "failed"),
        Column("seconds", "time in all", "s", digits=2),
    )
    caption = (
        "Over all data sets; a set for which a method gave no model for more than half of the flights ranks it last. "
        f"Coverage is {100 * _TRUE:g} % if stated errors are correct; sets that violate the assumptions of a method "
        "are included."
    )
    return Table("methods", "Methods over all data sets", caption, columns, tuple(rows))
