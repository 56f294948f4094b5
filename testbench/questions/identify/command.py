"""The command ``testbench identify``."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from testbench.page.terminal import console, stages
from testbench.questions.options import DataOption, OutOption, StrictOption


class Trends(str, Enum):
    """Variables of a trend."""

    auto = "auto"
    none = "none"
    V = "V"
    qbar = "qbar"
    alpha = "alpha"


def command(
    descriptions: Annotated[
        list[Path],
        typer.Argument(
            help="Description of recorded flights (TOML), or a log, whose manoeuvres are cut out and identified. "
            "Several are pooled.",
            show_default=False,
        ),
    ],
    out: OutOption = Path("results"),
    data: DataOption = None,
    aircraft: Annotated[
        str | None, typer.Option(help="A model of what flew: derivatives before, coefficients, servos.")
    ] = None,
    strict: StrictOption = False,
    each: Annotated[bool, typer.Option("--each", help="Every record by itself, then all pooled.")] = False,
    prior: Annotated[
        str | None, typer.Option(help="Believed before: aircraft, handbook, or a file (TOML, pooled.json).")
    ] = None,
    trend: Annotated[
        Trends | None, typer.Option(help="Variable that pooled coefficients may be linear in.", show_default="auto")
    ] = None,
    method: Annotated[str | None, typer.Option(help="Estimator whose derivatives are pooled.")] = None,
) -> None:
    """Identify models from recorded flights, with the same estimators, evaluation and report as a run.

    The description names the files, the channel and unit of each column, and the time segments to use; `testbench
    import LOG --out FOLDER` writes one. Of a log itself, what import would write goes to OUT/LOG and
    is identified at once. Several descriptions or logs of one aircraft are pooled into one set of nondimensional
    coefficients, with their trend over the condition and what they add to a prior.
    Examples: `testbench identify records/attas_short_period`, `testbench identify flight.ulg`, `testbench identify
    day1.toml day2.toml day3.toml --prior aircraft`.
    """
    from testbench.page.write import record_keeper
    from testbench.questions.files import find
    from testbench.questions.identify.ask import identify
    from testbench.questions.identify.page import identify_page
    from testbench.questions.identify.pool.command import settings_of, show_pooled
    from testbench.questions.identify.scenario import RecordDescription

    all_loaded = []
    for path in descriptions:
        files = _of_log(path, out) if path.is_file() and path.suffix.lower() != ".toml" else []
        for file in files or [find(path, "identify")]:
            loaded = RecordDescription.load(file)
            all_loaded.append(loaded if aircraft is None else loaded.changed(aircraft=aircraft))
    asked = {"each": each, "prior": prior, "trend": trend and trend.value, "method": method}
    settings = settings_of(all_loaded, several=len(descriptions) > 1, **asked)
    if settings is not None:
        show_pooled(all_loaded, out, data, settings, strict)
        return
    for loaded in all_loaded:
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
