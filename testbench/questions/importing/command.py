"""The command ``testbench import``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from testbench.page.terminal import console, stages
from testbench.questions.options import BeginningOption, StrictOption, UsageError, refuse, with_figures

_NOT_TO_DESCRIBE = (
    "out", "rate", "throw", "unit", "axes", "lead", "tail", "cut", "record", "imu", "airspeed", "gps", "baro", "ekf",
    "strict", "changes", "beginning", "nominal",
)  # fmt: skip


def _sensor(words: str) -> Any:
    return typer.Option(min=0, help=f"Which {words} to read of several, from 0. Default: the best.", show_default=False)


@with_figures
def command(
    context: typer.Context,
    log: Annotated[
        Path,
        typer.Argument(
            help="PX4 ULog, ArduPilot .bin or .log, MAVLink .tlog, a recording of ROS, SIDPAC MAT, a table, or the "
            "description of one (.toml).",
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
    unit: Annotated[
        list[str] | None, typer.Option(help="Unit of a table's column, by its channel, e.g. alpha=deg.")
    ] = None,
    axes: Annotated[
        str | None, typer.Option(help="Axes of a table: frd or flu. Default: from gravity and the motion.")
    ] = None,
    lead: Annotated[float, typer.Option(help="Quiet flight to keep before each manoeuvre, s.")] = 2.0,
    tail: Annotated[float, typer.Option(help="Response to keep after each manoeuvre, s.")] = 5.0,
    cut: Annotated[
        list[str] | None,
        typer.Option(help=(
            "Cut here, START:END in s of the record, instead of at the manoeuvres found; may be repeated."
        ),
                     show_default=False),
    ] = None,
    describe: Annotated[
        Path | None,
        typer.Option(
            help="Write a description of a table to this new .toml file, to fill in; to writers/NAME.toml: that of all "
            "tables of its writer.",
            show_default=False,
        ),
    ] = None,
    record: Annotated[
        str | None,
        typer.Option(
            help="Which record to read of a description, or which flight of a blackbox, that has several.",
            show_default=False,
        ),
    ] = None,
    imu: Annotated[int | None, _sensor("inertial unit")] = None,
    airspeed: Annotated[int | None, _sensor("pitot tube")] = None,
    gps: Annotated[int | None, _sensor("receiver")] = None,
    baro: Annotated[int | None, _sensor("barometer")] = None,
    ekf: Annotated[int | None, _sensor("lane of the filter")] = None,
    changes: Annotated[
        bool, typer.Option("--changes", help="Say whether something has changed in flight, when and in which part.")
    ] = False,
    beginning: BeginningOption = 60.0,
    nominal: Annotated[
        list[Path] | None,
        typer.Option(help="With --changes: another log of the aircraft, in which nothing changed; may be repeated.",
                     show_default=False),
    ] = None,
    strict: StrictOption = False,
) -> None:  # fmt: skip
    """Show the contents of a flight log, and with -o cut its manoeuvres into records ready for `testbench identify`.

    The command lists channels, rates, gaps and manoeuvres, the assumptions of each conversion, the signals that were
    left out and why, and implausible values. Example: `testbench import flight.ulg -o records --throw de=20`. A table
    whose columns have no names, or no times, needs a description: write one with `testbench import flight.mat
    --describe flight.toml`, fill it in, then run `testbench import flight.toml`.
    """
    if describe is not None:
        refuse(context, "with --describe, which cuts no records", *_NOT_TO_DESCRIBE)
        from testbench.questions.importing.template import write_template

        path = write_template(log, describe)
        what = log if path.resolve().parent.name == "writers" else path
        print(f"Written: {path}; fill it in, then: testbench import {what}")
        return
    from contextlib import nullcontext
    from dataclasses import replace

    from testbench.core.store import PAGE, ResultFolder
    from testbench.logs.manoeuvres import Cutting
    from testbench.logs.sidpac import Told
    from testbench.questions.importing.ask import import_log, parse_cuts, parse_throws, parse_units, write_import
    from testbench.questions.importing.changes import watch_log
    from testbench.questions.importing.page import print_import

    if nominal and not changes:
        raise UsageError("--nominal tells --changes what to compare with: give both")
    with stages() as say, nullcontext() if out is None else ResultFolder(out) as place:
        say("read the log")
        given = {"imu": imu, "airspeed": airspeed, "gps": gps, "baro": baro, "ekf": ekf}
        sensors = {kind: number for kind, number in given.items() if number is not None}
        told, cutting = Told(axes, parse_units(unit or []), record), Cutting(lead, tail, parse_cuts(cut or []))
        throws = parse_throws(throw or [])
        found = import_log(log, rate, throws, sensors, told, cutting, strict)
        if changes:
            say("look for changes")
            others = [import_log(path, rate, throws, sensors, told) for path in nominal or []]
            found = replace(found, watch=watch_log(found, others, beginning))
        paths = [] if place is None else [*write_import(found, place), place.path / PAGE]
    print_import(found, console(), paths)
