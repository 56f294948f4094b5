"""The page of a run: what is written into its folder, and what a terminal shows of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from testbench.page.html import Picture, render
from testbench.page.labels import file_stem, number, symbol, unique
from testbench.page.write import PAGE, _json_text, write_file, write_plates, write_tables
from testbench.questions.run.answer import answer_lines
from testbench.questions.run.labels import case_names, outputs_of

if TYPE_CHECKING:
    from rich.console import Console

    from testbench.questions.run.result import RunResult

_STYLES = {"lead": "bold", "finding": "", "doubt": "yellow"}


def print_result(result: RunResult, console: Console, folder: Path | str | None = None) -> None:
    """Print the answer, one table of validation MRSE (case by output), and where the files are.

    Args:
        result: what a run found.
        console: where to print.
        folder: what :func:`testbench.page.write_results` wrote to; None if nothing was written.
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
        from testbench.page.write import PAGE

        console.print()
        console.print(Text(f"Report: {Path(folder) / PAGE}"), soft_wrap=True)


def report_page(result: RunResult, pictures: list[Picture]) -> str:
    """Return the report of a run as one HTML page that fetches nothing."""
    from testbench.questions.run.answer import answer_lines
    from testbench.questions.run.flown_tables import flown_tables
    from testbench.questions.run.labels import case_names
    from testbench.questions.run.tables import result_tables

    return render(
        "questions/run/page.html.j2",
        result=result,
        simulated=result.truth is not None,
        answer=[(line.kind, line.text) for line in answer_lines(result)],
        flown=flown_tables(result),
        pictures=pictures,
        tables=result_tables(result),
        models=list(zip(case_names(result.cases), result.cases, strict=True)),
        provenance=provenance(result),
        source_name=result.source.file.name if result.source.file else "as given",
        source_text=source_text(result),
    )


def provenance(result: RunResult) -> list[tuple[str, str]]:
    """Return (what, value) of all that decides the figures: versions, seed, and what the records say of themselves."""
    from importlib.metadata import version

    from testbench import __version__

    out = [("flight-testbench", __version__)]
    packages = ("numpy", "scipy", *(("jsbsim",) if result.truth is not None else ()))
    out += [(name, version(name)) for name in packages]
    out.append(("seed", str(result.seed) if result.truth is not None else "none: recorded data"))
    for flight in result.flights:
        record = flight.truth if flight.truth is not None else next(iter(flight.measured.values()))
        said = ", ".join(f"{k} {v}" for k, v in sorted(record.provenance.items()) if v not in ([], "", None))
        out.append((f"record {flight.name}", said or "no provenance"))
    return out


def source_text(result: RunResult) -> str:
    """Return the scenario or description as it stands in its file, else as JSON."""
    if result.source.file is not None and result.source.file.is_file():
        return result.source.file.read_text(encoding="utf-8")
    return str(result.source.model_dump_json(indent=1))


def write_results(result: RunResult, folder: Path | str) -> list[Path]:
    """Write tables/*.csv and *.json, models/*.json, figures/*.png and report.html; return the paths, the page last.

    Every file appears complete or not at all: it is written under another name and renamed.

    Raises:
        RecordError: the folder cannot be written to.
    """
    from testbench.questions.run.figures import plates
    from testbench.questions.run.flown_tables import flown_tables
    from testbench.questions.run.page import report_page
    from testbench.questions.run.tables import result_tables

    folder = Path(folder)
    out: list[Path] = []
    out += write_tables([*flown_tables(result), *result_tables(result)], folder)
    for stem, case in zip(unique([file_stem(c.label) for c in result.cases]), result.cases, strict=True):
        out.append(write_file(folder / "models" / f"{file_stem(stem)}.json", _json_text(case.model.written())))
    paths, pictures = write_plates(plates(result), folder)
    out += paths
    out.append(write_file(folder / PAGE, report_page(result, pictures)))
    return out
