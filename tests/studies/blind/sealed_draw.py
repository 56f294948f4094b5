"""What sealed draws of the blind test that run case by case have in common: sealing, going on, rows, rates and page."""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from studies.blind.__main__ import _kept, _read, _seal_line
from studies.blind.cases import Case, opened, seal
from studies.blind.flights import told
from studies.blind.run import believe, named

from testbench.core.proportion import proportion_interval

Rates = Sequence[tuple[str, str, int, int]]
"""Stratum, rate, count, of."""


def run_case(case: Case) -> dict[str, Any]:
    """Return what the workflow says of one case of another draw than the main one, as JSON values."""
    draw = case.row.draw
    records, held_out = (told(draw, case.aircraft, which, case.fly(which)) for which in ("rich", "held_out"))
    return {"case": case.name, **named(believe(case.aircraft, draw=draw), records, held_out, case.without)}


@dataclass(frozen=True)
class Draw:
    """A sealed draw.

    Attributes:
        name: of the module that runs it, and of the folder of its rows in results/gap.
        seed: of its cases.
        drawn: makes them.
        rates: of cases and rows.
        page: likewise, as text.
        run_case: returns the row of one.
    """

    name: str
    seed: int
    drawn: Callable[[], tuple[Case, ...]]
    rates: Callable[[Sequence[Case], Mapping[str, Any]], Rates]
    page: Callable[[Sequence[Case], Mapping[str, Any]], str]
    run_case: Callable[[Case], dict[str, Any]] = run_case

    def run(self, arguments: list[str] | None = None) -> int:
        """Seal the answers, run the cases that have no row yet, and write rates and page."""
        parser = argparse.ArgumentParser(prog=f"python -m studies.blind.{self.name}")
        out = Path("results/gap") / self.name
        parser.add_argument("--out", type=Path, default=out, help="folder of rows and rates")
        parser.add_argument("--minutes", type=float, default=None, help="start no case after so many minutes")
        asked = parser.parse_args(arguments)
        asked.out.mkdir(parents=True, exist_ok=True)
        cases = self._sealed(asked.out)
        rows_file = asked.out / "rows.jsonl"
        rows = _read(rows_file)
        stop = None if asked.minutes is None else time.monotonic() + 60.0 * asked.minutes
        due = (self.run_case(c) for c in cases if c.name not in rows and (stop is None or time.monotonic() < stop))
        for one in _kept(rows_file, due):
            rows[one["case"]] = one
            print(f"{len(rows)} {one['case']}: {one['outcome']} {' | '.join(one['names'])}", flush=True)
        with (asked.out / "rates.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["stratum", "rate", "count", "of", "low", "high"])
            for stratum, rate, count, of in self.rates(cases, rows):
                if of:
                    writer.writerow([stratum, rate, count, of, *(f"{x:.3f}" for x in proportion_interval(count, of))])
        (asked.out / "README.md").write_text(self.page(cases, rows), encoding="utf-8")
        return 0

    def _sealed(self, out: Path) -> tuple[Case, ...]:
        """Return the cases, sealed before any is run.

        Raises:
            SystemExit: the answers are not those that were sealed.
        """
        answers, sealed = out / "answers.json", out / "sealed.sha256"
        if not answers.exists():
            text, digest = seal(self.drawn())
            sealed.write_text(_seal_line(digest, self.seed), encoding="utf-8")
            answers.write_text(text + "\n", encoding="utf-8")
        cases = opened(answers.read_text(encoding="utf-8").removesuffix("\n"))
        if sealed.read_text(encoding="utf-8") != _seal_line(seal(cases)[1], self.seed):
            raise SystemExit(f"the answers must be those that were sealed, {sealed} holds another hash")
        return cases


def counted(cases: Sequence[Case], run: Sequence[tuple[Case, Any]], strata: Mapping[str, int]) -> list[str]:
    """Return the lines of a page that say how many cases of each stratum were run, and the head of its rates."""
    return [
        f"**{len(run)} of {len(cases)} planned cases have been run**, in the order in which they were drawn. "
        "Intervals are Wilson's, 95 %.",
        "",
        "| stratum | run | planned |",
        "|---|---|---|",
        *(f"| {s} | {sum(c.stratum == s for c, _ in run)} | {n} |" for s, n in strata.items()),
        "",
    ]


def rated(rates: Rates, rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the lines of a page that hold rates with their intervals, and what a case takes."""
    out = ["| stratum | rate | cases | interval |", "|---|---|---|---|"]
    for stratum, rate, count, of in rates:
        if of:
            low, high = proportion_interval(count, of)
            out.append(f"| {stratum} | {rate} | {count} of {of} | {100 * low:.0f} to {100 * high:.0f} % |")
    seconds = np.array([r["seconds"] for r in rows if "seconds" in r])
    if seconds.size:
        middle, most = (float(np.quantile(seconds, q)) for q in (0.5, 0.95))
        took = f"median {middle:.0f} s, 95 % below {most:.0f} s, longest {seconds.max():.0f} s"
        out += ["", f"Processor time of a case: {took}."]
    return out
