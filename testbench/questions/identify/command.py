"""The command ``testbench identify``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.page.terminal import console, stages
from testbench.questions.options import DataOption, OutOption, StrictOption


def command(
    description: Annotated[Path, typer.Argument(help="Description of recorded flights (TOML).", show_default=False)],
    out: OutOption = Path("results"),
    data: DataOption = None,
    strict: StrictOption = False,
) -> None:
    """Identify models from recorded flights, with the same estimators, evaluation and report as a run.

    The description names the files, the channel and unit of each column, and the time segments to use. CSV, text, MAT,
    Parquet and NetCDF can be read. Example: `testbench identify records/attas_short_period`.
    """
    from testbench.page.write import record_keeper
    from testbench.questions.files import find
    from testbench.questions.identify.ask import identify
    from testbench.questions.identify.scenario import RecordDescription
    from testbench.questions.run.page import run_page

    loaded = RecordDescription.load(find(description, "identify"))
    folder = out / loaded.name
    with stages() as say:
        result = identify(loaded, data, record_keeper(folder), say, strict)
        say("write report")
        page = run_page(result)
        page.write(folder)
    page.show(console(), folder)
