"""The command ``testbench export``."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer


class Export(str, Enum):
    """Formats that records and models are exported to."""

    control = "control"
    csv = "csv"
    json = "json"
    jsbsim = "jsbsim"
    mat = "mat"
    netcdf = "netcdf"
    parquet = "parquet"


def command(
    file: Annotated[
        Path, typer.Argument(help="Record (NetCDF) or model (models/*.json of a run).", show_default=False)
    ],
    to: Annotated[Export, typer.Option(help="Format.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to write. Default: beside the one exported.")
    ] = None,
) -> None:
    """Write a record (csv, mat, netcdf, parquet) or a model (these, control, json, jsbsim) for other programs.

    Samples of a record that were not taken are left empty. A model becomes its matrices, a Python module with a
    python-control system, or a system of filters for JSBSim. Examples:
    `testbench export results/eolo_alpha/records/x.nc --to csv`,
    `testbench export results/eolo_alpha/models/x.json --to jsbsim`.
    """
    if file.suffix.lower() == ".json":
        from testbench.core.store import write_beside
        from testbench.questions.export.ask import SUFFIXES, export_model
        from testbench.questions.export.matrices import load_matrices

        model = load_matrices(file)
        where = out or file.with_name(file.stem + SUFFIXES[to.value])
        print(f"Written: {write_beside(where, lambda path: export_model(model, to.value, path))}")
        return
    from testbench.questions.export.ask import export_record

    print(f"Written: {export_record(file, to.value, out)}")
