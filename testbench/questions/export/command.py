"""The command ``testbench export``."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from testbench.questions.options import ByDefault, UsageError, Wings

command = typer.Typer(
    cls=ByDefault.first("file"),
    no_args_is_help=True,
    help="Write a record, an identified model or an aircraft for other programs.",
)


class Target(str, Enum):
    """What an aircraft is written as."""

    c = "c"
    fmu2 = "fmu2"
    fmu3 = "fmu3"
    jsbsim = "jsbsim"


@command.command("file")
def export_file(
    file: Annotated[
        Path, typer.Argument(help="Record (NetCDF) or model (models/*.json of a run).", show_default=False)
    ],
    to: Annotated[
        str,
        typer.Option(
            help="csv, mat, netcdf, parquet; of a model also control, json, jsbsim; of a record also mcap, and "
            "PACKAGE:NAME, a writer that an installed package brings.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to write. Default: beside the one exported.")
    ] = None,
) -> None:
    """Write a record (csv, mat, mcap, netcdf, parquet) or a model (also control, json, jsbsim) for other programs.

    Samples of a record that were not taken are left empty. A model becomes its matrices, a Python module with a
    python-control system, or a system of filters for JSBSim. Examples:
    `testbench export results/eolo_alpha/records/x.nc --to csv`,
    `testbench export results/eolo_alpha/models/x.json --to jsbsim`.
    """
    if file.suffix.lower() == ".json":
        from testbench.core.errors import nearest
        from testbench.core.store import write_beside
        from testbench.questions.export.ask import SUFFIXES, export_model, load_matrices

        if to not in SUFFIXES:
            raise UsageError(f"--to must be a format of models, got '{to}'{nearest(to, SUFFIXES)}")
        model = load_matrices(file)
        where = out or file.with_name(file.stem + SUFFIXES[to])
        print(f"Written: {write_beside(where, lambda path: export_model(model, to, path))}")
        return
    from testbench.questions.export.ask import export_record

    print(f"Written: {export_record(file, to, out)}")


@command.command("aircraft")
def aircraft_command(
    name: Annotated[
        str,
        typer.Argument(
            help="Packaged aircraft, a JSBSim model (XML file, folder, or one that comes with JSBSim: jsbsim:c172p), "
            "or a folder of your own.",
            show_default=False,
        ),
    ],
    to: Annotated[Target, typer.Option(help="What for.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder; the aircraft gets its own in it.")] = Path(
        "exports"
    ),
    wings: Annotated[
        Wings, typer.Option(help="Whether the elastic modes move (flexible) or are held (rigid).")
    ] = Wings.flexible,
    speed: Annotated[
        float | None, typer.Option("--speed", min=0.1, help="Where it begins, m/s; else the design speed.")
    ] = None,
    height: Annotated[
        float | None, typer.Option("--height", help="Where it begins, m above sea level; else the design height.")
    ] = None,
) -> None:
    """Write an aircraft as C code, as an FMU, or as a plain JSBSim model; it begins at a trim.

    c: one header and one source in C99 that need nothing else. fmu2, fmu3: a unit for co-simulation, for Simulink,
    OpenModelica or Dymola, with its source, and compiled for this machine if it has a C compiler. jsbsim: a model that
    stock JSBSim loads. The written files contain licence and sources of the model. Example: `testbench export aircraft
    taurus --to c`.
    """
    from testbench.flight import FlightCondition, load_aircraft
    from testbench.questions.export.aircraft import export_aircraft

    loaded = load_aircraft(name, wings.value)
    V, h = (
        given if given is not None else own
        for given, own in ((speed, loaded.design_V_m_s), (height, loaded.design_h_m))
    )
    for path in export_aircraft(loaded, to.value, out, FlightCondition(V, h)):
        print(f"Written: {path}")
