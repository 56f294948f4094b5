"""The command ``testbench compare benchmark``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from testbench.questions.options import answering, with_figures


@with_figures
def benchmark(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the benchmark.")] = Path("results/benchmark"),
    seeds: Annotated[int, typer.Option(min=1, help="Flights of each simulated data set.")] = 5,
    method: Annotated[
        list[str] | None,
        typer.Option(
            help="Own estimator FILE.py:NAME, in addition to the packaged ones. May be repeated.", show_default=False
        ),
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option(help="Packaged method, instead of all. May be repeated.", show_default=False)
    ] = None,
    data: Annotated[
        list[str] | None, typer.Option(help="Data set, instead of all. May be repeated.", show_default=False)
    ] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes. Default: one per processor.")] = None,
) -> None:
    """Compare methods of identification on packaged data sets with known truth, and on recorded flights.

    The same command continues an interrupted benchmark, and with more seeds or methods flies only the missing ones.
    Recorded flights are read from the folder TESTBENCH_FLIGHT_DATA. Examples: `testbench compare benchmark`, `testbench
    compare benchmark --method my_method.py:estimate`.
    """
    from testbench.questions.compare.benchmark.ask import benchmark as run

    try:
        with answering(out.parent, out.name) as a:
            a.found = run(
                a.place,
                seeds=seeds,
                sets=data or (),
                methods=(*(only or ()), *(method or ())),
                workers=workers,
                progress=a.say,
            )
    except KeyboardInterrupt:
        print("finished results are kept; the same command continues", file=sys.stderr)
        raise
