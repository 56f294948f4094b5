"""The command ``testbench identify``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.page.terminal import console, stages
from testbench.questions.options import DataOption, OutOption, StrictOption


def command(
    description: Annotated[
        Path,
        typer.Argument(
            help="Description of recorded flights (TOML), or a log, whose manoeuvres are cut out and identified.",
            show_default=False,
        ),
    ],
    out: OutOption = Path("results"),
    data: DataOption = None,
    aircraft: Annotated[
        str | None, typer.Option(help="A model of what flew: derivatives before, coefficients, servos.")
    ] = None,
    strict: StrictOption = False,
) -> None:
    """Identify models from recorded flights, with the same estimators, evaluation and report as a run.

    The description names the files, the channel and unit of each column, and the time segments to use; `testbench
    import LOG --out FOLDER` writes one. Of a log itself, what import would write goes to OUT/LOG and
    is identified at once.
    Examples: `testbench identify records/attas_short_period`, `testbench identify flight.ulg`.
    """
    from testbench.page.write import record_keeper
    from testbench.questions.files import find
    from testbench.questions.identify.ask import identify
    from testbench.questions.identify.page import identify_page
    from testbench.questions.identify.scenario import RecordDescription

    files = _of_log(description, out) if description.is_file() and description.suffix.lower() != ".toml" else []
    for file in files or [find(description, "identify")]:
        loaded = RecordDescription.load(file)
        if aircraft is not None:
            loaded = loaded.changed(aircraft=aircraft)
        folder = out / loaded.name
        with stages() as say:
            result = identify(loaded, data, record_keeper(folder), say, strict)
            say("write report")
            page = identify_page(result)
            page.write(folder)
        page.show(console(), folder)


def _of_log(log: Path, out: Path) -> list[Path]:
    """Return the descriptions that import writes of a log.

    Raises:
        RecordError: the log cannot be read, or nothing in it can be identified.
    """
    from testbench.core.errors import RecordError
    from testbench.questions.importing.ask import import_log, write_import

    paths = write_import(import_log(log), out / log.stem)
    files = [path for path in paths if path.suffix == ".toml"]
    if not files:
        raise RecordError(
            f"'{log}' must hold a control that moves and what answers it, got none that can be identified; testbench "
            f"import {log} shows what it holds"
        )
    return files
