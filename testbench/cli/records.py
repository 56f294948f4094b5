"""Commands for recorded flights: import, export, compatibility, response, modes."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from testbench.cli.app import OutOption, SeedOption, app, console, refuse, stages
from testbench.errors import RecordError

DESCRIPTION = "description of recorded flights"


class Export(str, Enum):
    """Formats that records and models are exported to."""

    control = "control"
    csv = "csv"
    json = "json"
    jsbsim = "jsbsim"
    mat = "mat"
    netcdf = "netcdf"
    parquet = "parquet"


@app.command("import")
def import_(
    context: typer.Context,
    log: Annotated[
        Path,
        typer.Argument(
            help="PX4 ULog, ArduPilot .bin or .log, SIDPAC MAT, a table, or the description of one (.toml).",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for the records and descriptions; else only look.")
    ] = None,
    rate: Annotated[float | None, typer.Option(help="Rate of the records, Hz.")] = None,
    throw: Annotated[
        list[str] | None, typer.Option(help="Deflection at full command in deg, e.g. de=20; 25 if not given.")
    ] = None,
    lead: Annotated[float, typer.Option(help="Quiet flight to keep before each manoeuvre, s.")] = 2.0,
    tail: Annotated[float, typer.Option(help="Response to keep after each manoeuvre, s.")] = 5.0,
    describe: Annotated[
        Path | None,
        typer.Option(help="Write a description of a table to this new .toml file, to fill in.", show_default=False),
    ] = None,
    record: Annotated[
        str | None, typer.Option(help="Which record of a description that has several.", show_default=False)
    ] = None,
) -> None:
    """Show what a flight log holds, and with -o cut its manoeuvres into records ready for `testbench identify`.

    Channels, rates, gaps and manoeuvres are listed, each conversion and what it assumes is said. Example:
    `testbench import flight.ulg -o records --throw de=20`. A table whose columns have no names, or no times, must be
    described first: `testbench import flight.mat --describe flight.toml`, fill in, `testbench import flight.toml`.
    """
    if describe is not None:
        refuse(context, "with --describe, which cuts no records", "out", "rate", "throw", "lead", "tail", "record")
        from testbench.logs.template import write_template

        path = write_template(log, describe)
        print(f"Written: {path}; fill it in, then: testbench import {path}")
        return
    from testbench.logs.importing import import_log, parse_throws, write_import
    from testbench.report.imported import print_import

    with stages() as say:
        say("read the log")
        found = import_log(log, rate, parse_throws(throw or []), lead, tail, record)
        paths = write_import(found, out) if out is not None else []
    print_import(found, console(), paths)


@app.command()
def export(
    file: Annotated[
        Path, typer.Argument(help="Record (NetCDF), or model (models/*.json of a run).", show_default=False)
    ],
    to: Annotated[Export, typer.Option(help="Format.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="File; by default beside the one exported.")] = None,
) -> None:
    """Write a record (csv, mat, netcdf, parquet) or a model (these, control, json, jsbsim) for other programs.

    Samples of a record that were not taken are left empty. A model becomes its matrices, a Python module with a
    python-control system, or a system of filters for JSBSim. Examples:
    `testbench export results/eolo_alpha/records/x.nc --to csv`,
    `testbench export results/eolo_alpha/models/x.json --to jsbsim`.
    """
    if file.suffix.lower() == ".json":
        from testbench.report.export import SUFFIXES, export_model, load_matrices

        path = out or file.with_name(file.stem + SUFFIXES[to.value])
        print(f"Written: {export_model(load_matrices(file), to.value, path)}")
        return
    from testbench.report.export import export_record

    print(f"Written: {export_record(file, to.value, out)}")


@app.command()
def compatibility(
    description: Annotated[Path, typer.Argument(help="Description of recorded flights (TOML).", show_default=False)],
    out: OutOption = Path("results"),
    data: Annotated[
        Path | None, typer.Option(help="Folder with the data files; replaces the one in the description.")
    ] = None,
    gravity: Annotated[float, typer.Option(help="Gravity where it was flown, m/s2.")] = 9.80665,
) -> None:
    """Ask whether the instruments of recorded flights agree with each other, and which of them err by how much.

    Rates and accelerations are integrated and compared with airspeed, flow angles, attitude and height; bias, scale,
    lag or delay are estimated where the data tell them. The corrected records are written. Example:
    `testbench compatibility records/attas_full`.
    """
    from testbench.checks import find
    from testbench.estimators import data_compatibility
    from testbench.logs import load_description, read_records
    from testbench.report.compatibility import print_compatibility, write_compatibility

    described = load_description(find(description, "identify"))
    folder = out / f"{described.name}_compatibility"
    with stages() as say:
        say("read records")
        records = {name: record for name, _, record in read_records(described, data)}
        say("estimate the errors of the instruments")
        result = data_compatibility.estimate(list(records.values()), gravity_m_s2=gravity)
        say("write report")
        write_compatibility(result, records, described, folder)
    print_compatibility(result, console(), folder)


@app.command()
def response(
    description: Annotated[Path, typer.Argument(help="Description of recorded flights (TOML).", show_default=False)],
    window: Annotated[
        list[float], typer.Option(help="Length of the windows, s; several are combined (composite windowing).")
    ] = [10.0],  # noqa: B006 (typer reads it, nothing changes it)
    out: OutOption = Path("results"),
    data: Annotated[
        Path | None, typer.Option(help="Folder with the data files; replaces the one in the description.")
    ] = None,
) -> None:
    """Estimate the frequency responses of recorded flights with coherence and random error.

    All records of the description are taken together, inputs and outputs as it names them. Sweeps and multisines are
    what it is for. Example: `testbench response records/attas_short_period --window 5 --window 12`.
    """
    from testbench.checks import find
    from testbench.logs import load_description, read_records
    from testbench.pipeline import frequency_responses
    from testbench.report.response import print_response, write_response

    described = load_description(find(description, "identify"))
    folder = out / f"{described.name}_response"
    with stages() as say:
        say("read records")
        records = [record for _, _, record in read_records(described, data)]
        say("estimate frequency responses")
        found = frequency_responses(described, records, window)
        say("write report")
        write_response(found, described, folder)
    print_response(found, console(), folder)


@app.command()
def modes(
    context: typer.Context,
    source: Annotated[
        list[Path],
        typer.Argument(
            help="Records (NetCDF), a description of recorded flights, or a scenario of flight in turbulence (TOML).",
            show_default=False,
        ),
    ],
    channels: Annotated[
        list[str] | None, typer.Option(help="Channel to find modes in; give it several times. All of the wing if none.")
    ] = None,
    references: Annotated[
        list[str] | None, typer.Option(help="Channel that all are correlated with; every one if none is given.")
    ] = None,
    band: Annotated[
        tuple[float, float] | None, typer.Option(help="Lowest and highest frequency, Hz.", show_default=False)
    ] = None,
    order: Annotated[int | None, typer.Option(help="Largest number of states, even; 40 if not given.")] = None,
    out: OutOption = Path("results"),
    data: Annotated[
        Path | None, typer.Option(help="Folder with the data files; replaces the one in the description.")
    ] = None,
    seed: SeedOption = None,
) -> None:
    """Find modes from outputs alone, such as the accelerometers of a wing in turbulence, without any input.

    Frequencies, damping ratios and shapes with their errors and a stabilisation diagram; where the flight is simulated,
    beside the modes of the linearised aircraft. Examples: `testbench modes eolo_turbulence`,
    `testbench modes flown/*.nc --band 2 40 --channels az_wing_1 --channels az_wing_11`.
    """
    from testbench.checks import find, kind_of
    from testbench.operational import fly_modes, load_modes, read_modes, search_for
    from testbench.paths import find_scenario
    from testbench.report import record_keeper
    from testbench.report.operational import print_modes, write_modes

    asked = {"channels": channels, "references": references, "band_hz": band, "order": order}
    given = {key: value for key, value in asked.items() if value}
    with stages() as say:
        scenario = find_scenario(source[0])
        own = source[0].suffix.lower() != ".nc"
        if own and not (scenario.is_file() and kind_of(scenario) == DESCRIPTION):
            if len(source) > 1:
                raise RecordError(f"scenarios and descriptions must be given one at a time, got {len(source)} files")
            refuse(context, "with a scenario, which makes its own flights", "data")
            loaded = load_modes(find(source[0], "modes"))
            folder = out / f"{loaded.name}_modes"
            result = fly_modes(loaded, search_for(given, loaded.modes), seed, record_keeper(folder), say)
        else:
            refuse(context, "with measured records, in which the noise is", "seed")
            say("read records")
            result = read_modes(source, search_for(given), data, say)
            folder = out / f"{result.name}_modes"
        say("write report")
        write_modes(result, folder)
    print_modes(result, console(), folder)
