"""Run the blind test: ``python -m studies.blind``. Resumes: cases that have a row are not run again."""

import argparse
import json
import os
import time
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: two workers with two threads each are far slower

from smallest import results, sized
from studies.blind.cases import COUNTS, SHORT, WITHOUT, Case, draw, opened, seal
from studies.blind.report import write_report
from studies.blind.rows import leave_with, run_case

SEED = 20261210
RESULTS = Path(__file__).resolve().parents[3] / "results" / "gap"
"""Where the committed rows are; the verdict of a case reads what they say of parts."""


def main(arguments: list[str] | None = None) -> int:
    """Seal the answers, run the cases that have no row yet, and write the summary."""
    parser = argparse.ArgumentParser(prog="python -m studies.blind", description=__doc__)
    parser.add_argument("--out", type=Path, default=results("gap"), help="folder of rows and summary")
    parser.add_argument("--seed", type=int, default=SEED, help="of the cases")
    parser.add_argument("--minutes", type=float, default=None, help="start no case after so many minutes")
    parser.add_argument("--workers", type=int, default=1, help="processes that run cases at once")
    parser.add_argument("--cases", type=int, default=sized(None, 1), help="run so many cases at most")
    parser.add_argument(
        "--strata",
        type=_strata,
        default=sized(COUNTS, {"nothing": 1}),
        metavar="NAME=COUNT,...",
        help="cases of each stratum, in place of all",
    )
    parser.add_argument(
        "--effects",
        type=lambda text: tuple(text.split(",")),
        default=(),
        help="search these alone: a trial of the study",
    )
    parser.add_argument(
        "--report", action="store_true", help="write the summary of the rows that are there, run nothing"
    )
    asked = parser.parse_args(arguments)
    asked.out.mkdir(parents=True, exist_ok=True)
    rows_file = asked.out / "rows.jsonl"
    cases, digest = _sealed(asked.out, asked.seed, asked.strata)
    done = _read(rows_file)
    stop = None if asked.minutes is None else time.monotonic() + 60.0 * asked.minutes
    if not asked.report:
        due = [partial(run_case, c, v, only=asked.effects) for c, v in _in_turn(cases) if c.name + v not in done][
            : asked.cases
        ]
        for row in _kept(rows_file, _rows(due, asked.workers, stop)):
            done[row["case"]] = row
            print(f"{len(done)} {row['case']}: {row['outcome']} {' | '.join(row['names'])}", flush=True)
    write_report(asked.out, cases, done, digest, asked.seed)
    print(f"summary: {asked.out / 'README.md'}")
    return 0


def _kept(file: Path, rows: Iterable[dict[str, Any]]) -> Generator[dict[str, Any], None, None]:
    """Yield rows once each of them stands in a file."""
    with file.open("a", encoding="utf-8") as out:
        for row in rows:
            out.write(json.dumps(row) + "\n")
            out.flush()
            yield row


def _rows(
    due: Sequence[Callable[[], dict[str, Any]]], workers: int, stop: float | None
) -> Generator[dict[str, Any], None, None]:
    """Yield the rows of cases as they are done; no case is begun after the time ``stop``."""
    if workers == 1:
        for run in due:
            if stop is not None and time.monotonic() > stop:
                return
            yield run()
        return
    waiting = list(reversed(due))
    running: set[Future[dict[str, Any]]] = set()
    context = get_context("spawn")
    with ProcessPoolExecutor(workers, context, initializer=leave_with, initargs=(os.getpid(),)) as pool:
        while waiting or running:
            late = stop is not None and time.monotonic() > stop
            while waiting and not late and len(running) < workers:
                running.add(pool.submit(waiting.pop()))
            if not running:
                return
            ready, running = wait(running, return_when=FIRST_COMPLETED)
            for future in ready:
                yield future.result()


def _in_turn(cases: tuple[Case, ...]) -> list[tuple[Case, str]]:
    """Return what is run, in order: each case, and of those with one effect half at once and half at the end without
    that effect in the library; then those with one effect or none once more on two manoeuvres.
    """
    first: list[tuple[Case, str]] = []
    last: list[tuple[Case, str]] = []
    for case in cases:
        first.append((case, ""))
        if case.stratum in ("library form", "other form"):
            odd = int(case.name.split()[-1]) % 2 == 1
            (first if odd is (case.stratum == "library form") else last).append((case, WITHOUT))
    return first + last + [(c, SHORT) for c in cases if c.stratum in ("library form", "other form", "nothing")]


def _strata(text: str) -> dict[str, int]:
    """Return stratum -> number of cases of a text "nothing=2,turbulence=1"."""
    counts = {name: int(count) for name, _, count in (part.partition("=") for part in text.split(","))}
    if unknown := counts.keys() - COUNTS.keys():
        raise argparse.ArgumentTypeError(f"strata must be of {', '.join(COUNTS)}, got {', '.join(sorted(unknown))}")
    return counts


def _sealed(folder: Path, seed: int, strata: Mapping[str, int] | None = None) -> tuple[tuple[Case, ...], str]:
    """Return the cases and the hash of their answers; drawn and sealed once, before anything is named."""
    answers_file, seal_file = folder / "answers.json", folder / "sealed.sha256"
    if answers_file.exists() and seal_file.exists():
        text = answers_file.read_text(encoding="utf-8").removesuffix("\n")
        cases, (again, digest) = opened(text), seal(opened(text))
        if again != text or seal_file.read_text(encoding="utf-8") != _seal_line(digest, seed):
            raise SystemExit(
                f"the answers of a blind test must be those sealed for seed {seed}, {seal_file} holds another hash or "
                "seed; give another --out, or remove that folder to begin anew"
            )
        return cases, digest
    cases = draw(seed, COUNTS if strata is None else strata)
    text, digest = seal(cases)
    seal_file.write_text(_seal_line(digest, seed), encoding="utf-8")
    answers_file.write_text(text + "\n", encoding="utf-8")
    return cases, digest


def _seal_line(digest: str, seed: int) -> str:
    return f"{digest}  answers.json without its last line break, seed {seed}\n"


def _read(file: Path) -> dict[str, dict[str, Any]]:
    if not file.exists():
        return {}
    rows = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines() if line.strip()]
    return {r["case"]: r for r in rows}


if __name__ == "__main__":
    raise SystemExit(main())
