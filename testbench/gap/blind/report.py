"""Tables of the blind test: confusion, rates with Wilson intervals, sizes, and a page that reads them out."""

from __future__ import annotations

import csv
import statistics
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from testbench.gap.blind.cases import STRATA, Case
from testbench.gap.blind.score import FEWEST, Score, judge, rates, removed, set_size, sizes, wilson

WITHOUT = ", true effect taken out"


def write_report(
    folder: Path, cases: Sequence[Case], rows: Mapping[str, Mapping[str, Any]], digest: str, seed: int
) -> None:
    """Write cases.csv, confusion.csv, rates.csv, sizes.csv and README.md of the cases that have a row."""
    failed = [n for n, r in rows.items() if r["outcome"] == "failed"]
    scores = [
        judge(c, {**rows[c.name], "without": rows.get(c.name + WITHOUT)})
        for c in cases
        if c.name in rows and c.name not in failed
    ]
    _csv(
        folder / "cases.csv",
        ("case", "aircraft", "hidden", "right", "verdict", "said", "best", "share", "runner_up", "removed", "cpu_s"),
        (
            (
                s.case.name, s.case.aircraft, " + ".join(s.case.kinds), " + ".join("/".join(r) for r in s.case.right),
                s.verdict, s.named, s.row["best"], _number(s.row["share"]), s.row["runner_up"],
                _number(s.row["removed"]), f"{s.row['seconds']:.1f}",
            )
            for s in scores
        ),
    )  # fmt: skip
    table = Counter((_hidden(s), s.named) for s in scores if not s.case.turbulence_rms_m_s)
    _csv(folder / "confusion.csv", ("hidden", "said", "cases"), ((*k, n) for k, n in sorted(table.items())))
    found = rates(scores)
    _csv(
        folder / "rates.csv",
        ("rate", "count", "of", "value", "wilson_low", "wilson_high", "bar", "met"),
        (
            (
                r.name, r.count, r.of, _number(r.value if r.of else None), *(f"{x:.3f}" for x in wilson(r.count, r.of)),
                "" if r.bar is None else f"{'<=' if r.most else '>='} {r.bar:g}", r.met,
            )
            for r in found
        ),
    )  # fmt: skip
    compared = sizes(scores)
    _csv(
        folder / "sizes.csv",
        ("case", "hidden", "true", "estimate", "standard_error", "relative_error"),
        ((c, k, f"{t:.5g}", f"{x:.5g}", f"{e:.2g}", f"{(x - t) / abs(t):+.3f}") for c, k, t, x, e in compared),
    )
    (folder / "README.md").write_text(_page(scores, cases, failed, digest, seed), encoding="utf-8")


def _hidden(score: Score) -> str:
    kinds = " + ".join(score.case.kinds) or "nothing"
    return f"{kinds} (tiny)" if score.case.stratum in ("below detectability", "inseparable") else kinds


def _page(scores: Sequence[Score], cases: Sequence[Case], failed: Sequence[str], digest: str, seed: int) -> str:
    counts = Counter(s.case.stratum for s in scores)
    cpu = [s.row["seconds"] for s in scores]
    shares, compared = removed(scores), sizes(scores)
    lines = [
        "# Blind test of the gap workflow",
        "",
        "Made by `make blind-test` (`python -m testbench.gap.blind`, which resumes where it stopped; `--report` writes "
        "this page anew). Hidden truths are drawn from one seed by code of their own (`testbench/gap/blind/`), with "
        "every coefficient of the belief off by its prior; the workflow gets records of six manoeuvres, the believed "
        "aircraft and the believed sensors. The hash of the answers was written before the first case was named.",
        "",
        f"Seed {seed}. SHA-256 of answers.json without its last line break: `{digest}`.",
        "",
        f"{len(scores)} of {len(cases)} cases have been run"
        + (f", {len(failed)} more failed ({', '.join(failed)})" if failed else "")
        + f". Intervals are Wilson's, 95 %. Of fewer than {FEWEST} cases nothing is said of a bar, and a rate that "
        "keeps its bar is shown to keep it only where the interval does, too.",
        "",
        "| stratum | run | planned |",
        "|---|---|---|",
        *(f"| {name} | {counts.get(name, 0)} | {n} |" for name, n in STRATA.items()),
        "",
        "| rate | cases | value | interval | bar | met |",
        "|---|---|---|---|---|---|",
    ]
    for r in rates(scores):
        low, high = wilson(r.count, r.of)
        bar = "" if r.bar is None else f"{'≤' if r.most else '≥'} {100 * r.bar:g} %"
        value = f"{100 * r.value:.0f} %" if r.of else "not run"
        lines.append(
            f"| {r.name} | {r.count} of {r.of} | {value} | {100 * low:.0f} to {100 * high:.0f} % | {bar} | {r.met} |"
        )
    lines += [
        "",
        f"Mean number of names where any is given: {set_size(scores):.2f} (bar ≤ 1.3).",
        "",
        f"Share of the held-out excess removed where the name is right: median "
        f"{100 * statistics.median(shares):.1f} % of {len(shares)} cases (bar ≥ 90 %)."
        if shares
        else "No right name yet, hence no share of the held-out excess removed.",
        "",
        f"Size recovered, relative error: median magnitude "
        f"{100 * statistics.median(abs((x - t) / t) for _, _, t, x, _ in compared):.1f} % of {len(compared)} cases."
        if compared
        else "No sizes to compare yet.",
        "",
        f"Processor time of a case: median {statistics.median(cpu):.1f} s, largest {max(cpu):.1f} s (bar: 40 s)."
        if cpu
        else "",
        "",
        "`cases.csv`: every case; `confusion.csv`: what was hidden against what was said, in still air; `rates.csv`, "
        "`sizes.csv`: the tables above; `rows.jsonl`: all that the workflow said.",
        "",
    ]
    return "\n".join(lines)


def _number(x: float | None) -> str:
    return "" if x is None else f"{x:.3f}"


def _csv(file: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    with file.open("w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)
