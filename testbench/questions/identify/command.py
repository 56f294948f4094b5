"""The command ``testbench identify``."""

from __future__ import annotations

from contextlib import ExitStack
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from testbench.page.terminal import console, stages
from testbench.questions.options import DataOption, OutOption, StrictOption, refuse, with_figures

if TYPE_CHECKING:
    from collections.abc import Sequence

    from testbench.questions.identify.amend.result import Amended
    from testbench.questions.identify.scenario import RecordDescription


class Trends(str, Enum):
    """Variables of a trend."""

    auto = "auto"
    none = "none"
    V = "V"
    qbar = "qbar"
    alpha = "alpha"


@with_figures
def command(
    context: typer.Context,
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
        str | None, typer.Option(help="Model of the aircraft that flew: derivatives before, coefficients, servos.")
    ] = None,
    strict: StrictOption = False,
    each: Annotated[bool, typer.Option("--each", help="Identify every record separately, then pool all.")] = False,
    prior: Annotated[
        str | None, typer.Option(help="Prior of the coefficients: aircraft, handbook, or a file (TOML, pooled.json).")
    ] = None,
    trend: Annotated[
        Trends | None,
        typer.Option(help="Variable with which pooled coefficients may vary linearly.", show_default="auto"),
    ] = None,
    method: Annotated[str | None, typer.Option(help="Estimator whose derivatives are pooled.")] = None,
    choose: Annotated[
        bool, typer.Option("--choose", help="Choose the estimated derivatives by the evidence of the records.")
    ] = False,
    again: Annotated[
        int | None,
        typer.Option(
            min=0,
            help=(
                "Number of simulated flights of the estimated model that are identified again, to check its errors; "
                "0: none."
            ),
            show_default="a second's",
        ),
    ] = None,
    amend: Annotated[
        str | None,
        typer.Option(
            help="Write the derivatives into a new aircraft, aircraft/NAME, and simulate the records with both."
        ),
    ] = None,
) -> None:
    """Identify models from recorded flights, with the same estimators, evaluation and report as a run.

    The description names the files, the channel and unit of each column, and the time segments to use; `testbench
    import LOG --out FOLDER` writes one, and FOLDER may be given in its place. A log is imported to OUT/LOG and
    identified at once. Several descriptions or logs of one aircraft are pooled into one set of nondimensional
    coefficients, with their trend over the condition and their information beyond a prior. Examples: `testbench
    identify records/attas_short_period`, `testbench identify flight.ulg`, `testbench identify day1.toml day2.toml
    day3.toml --prior aircraft`, `testbench identify flight.ulg --aircraft plane --amend plane_flown`.
    """
    from testbench.core.errors import TestbenchError
    from testbench.core.store import ResultFolder, folder_in
    from testbench.page.page import record_keeper
    from testbench.questions.identify.amend.ask import amend as write_amended
    from testbench.questions.identify.ask import identify
    from testbench.questions.identify.logs import descriptions_of
    from testbench.questions.identify.page import identify_page
    from testbench.questions.identify.pool.command import settings_of, show_pooled
    from testbench.questions.identify.scenario import RecordDescription

    asked: list[RecordDescription] = []
    for path in descriptions:
        for file in descriptions_of(path, out):
            loaded = RecordDescription.load(file)
            loaded = loaded if aircraft is None else loaded.changed(aircraft=aircraft)
            asked.append(loaded.choosing() if choose else loaded)
    given = {"each": each, "prior": prior, "trend": trend and trend.value, "method": method}
    settings = settings_of(asked, several=len(descriptions) > 1 and amend is None, **given)
    if settings is not None:
        refuse(context, "with --each or a prior, whose coefficients are pooled", "amend")
        show_pooled(asked, out, data, settings, strict)
        return
    if amend is not None:
        _check_amend(asked, amend)
    refused: TestbenchError | None = None
    amended: dict[str, Amended] = {}
    with ExitStack() as ends, stages() as say:
        places = [ends.enter_context(ResultFolder(folder_in(out, each.name))) for each in asked]
        found = [identify(d, data, record_keeper(at), say, strict, again) for d, at in zip(asked, places, strict=True)]
        if amend is not None:
            try:
                amended = write_amended(found, amend, say)
            except TestbenchError as error:  # the pages are written even where nothing can be amended
                refused = error
        say("write report")
        pages = [identify_page(result, amended.get(result.name)) for result in found]
        for page, place in zip(pages, places, strict=True):
            page.write(place)
    for page, place in zip(pages, places, strict=True):
        page.show(console(), place.path)
    if refused is not None:
        raise refused


def _check_amend(asked: Sequence[RecordDescription], name: str) -> None:
    """Refuse an amendment that could not be written, before anything is identified.

    Raises:
        ScenarioError: a description names no aircraft, or the name may not be taken.
        WriteError: an aircraft that the testbench did not write lies there.
    """
    from testbench.core.errors import ScenarioError
    from testbench.questions.identify.amend.ask import no_aircraft
    from testbench.questions.identify.amend.folder import folder_of

    for description in asked:
        if description.aircraft is None:
            raise ScenarioError(no_aircraft(str(description.file)))
        folder_of(name, description.aircraft)
