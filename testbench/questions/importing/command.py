"""The command ``testbench import``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.page.terminal import console, stages
from testbench.questions.options import refuse


def command(
    context: typer.Context,
    log: Annotated[
        Path,
        typer.Argument(
            help="PX4 ULog, ArduPilot .bin or .log, SIDPAC MAT, a table, or the description of one (.toml).",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder for the records and descriptions; without it nothing is written."),
    ] = None,
    rate: Annotated[float | None, typer.Option(help="Rate of the records, Hz.")] = None,
    throw: Annotated[
        list[str] | None, typer.Option(help="Deflection at full command, deg, e.g. de=20. Default: 25.")
    ] = None,
    lead: Annotated[float, typer.Option(help="Quiet flight to keep before each manoeuvre, s.")] = 2.0,
    tail: Annotated[float, typer.Option(help="Response to keep after each manoeuvre, s.")] = 5.0,
    describe: Annotated[
        Path | None,
        typer.Option(help="Write a description of a table to this new .toml file, to fill in.", show_default=False),
    ] = None,
    record: Annotated[
        str | None, typer.Option(help="Which record to read of a description that has several.", show_default=False)
    ] = None,
) -> None:
    """Show what a flight log holds, and with -o cut its manoeuvres into records ready for `testbench identify`.

    The command lists channels, rates, gaps and manoeuvres, and says what each conversion assumes. Example:
    `testbench import flight.ulg -o records --throw de=20`. A table whose columns have no names, or no times, needs a
    description: write one with `testbench import flight.mat --describe flight.toml`, fill it in, then run
    `testbench import flight.toml`.
    """
    if describe is not None:
        refuse(context, "with --describe, which cuts no records", "out", "rate", "throw", "lead", "tail", "record")
        from testbench.questions.importing.template import write_template

        path = write_template(log, describe)
        print(f"Written: {path}; fill it in, then: testbench import {path}")
        return
    from testbench.questions.importing.ask import import_log, parse_throws, write_import
    from testbench.questions.importing.page import print_import

    with stages() as say:
        say("read the log")
        found = import_log(log, rate, parse_throws(throw or []), lead, tail, record)
        paths = write_import(found, out) if out is not None else []
    print_import(found, console(), paths)
