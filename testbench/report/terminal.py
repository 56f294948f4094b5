"""A run in a few lines of a terminal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from testbench.report.answer import answer_lines
from testbench.report.labels import case_names, number, outputs_of, symbol

if TYPE_CHECKING:
    from rich.console import Console

    from testbench.results import RunResult

_STYLES = {"lead": "bold", "finding": "", "doubt": "yellow"}


def print_result(result: RunResult, console: Console, folder: Path | str | None = None) -> None:
    """Print the answer, one table of validation MRSE (case by output), and where the files are.

    Args:
        result: what a run found.
        console: where to print.
        folder: what :func:`testbench.report.write_results` wrote to; None if nothing was written.
    """
    from rich.table import Table
    from rich.text import Text

    console.print(Text(result.title, style="bold underline"))
    answer = Table.grid(padding=(0, 1))
    for line in answer_lines(result):
        answer.add_row("-", Text(line.text, style=_STYLES[line.kind]))
    console.print(answer)
    outputs = outputs_of(result.cases)
    table = Table(
        title="MRSE on the validation records, %", title_justify="left", title_style="", box=None, pad_edge=False
    )
    table.add_column("model")
    for output in outputs:
        table.add_column(symbol(output), justify="right")
    table.add_column("mean", justify="right")
    for name, case in zip(case_names(result.cases), result.cases, strict=True):
        scores = case.evaluation.validation
        cells = [
            number(float(scores.mrse_percent[case.model.outputs.index(o)])) if o in case.model.outputs else "–"
            for o in outputs
        ]
        table.add_row(Text(name), *cells, number(float(scores.mrse_mean)))
    console.print()
    console.print(table)
    if folder is not None:
        from testbench.report.write import PAGE

        console.print()
        console.print(Text(f"Report: {Path(folder) / PAGE}"), soft_wrap=True)
