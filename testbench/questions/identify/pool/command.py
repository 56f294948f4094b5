"""What the command ``testbench identify`` does with several logs, a prior, or every record by itself."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from testbench.core.errors import ScenarioError
from testbench.core.store import ResultFolder, folder_in
from testbench.page.labels import file_stem
from testbench.page.page import record_keeper
from testbench.page.terminal import console, stages
from testbench.questions.identify.page import identify_page
from testbench.questions.identify.pool.ask import agreed, identify_and_pool, parts_of
from testbench.questions.identify.pool.page import pool_page
from testbench.questions.identify.scenario import Pooling, RecordDescription


def settings_of(descriptions: Sequence[RecordDescription], several: bool, **given: object) -> Pooling | None:
    """Return how to pool, options before the tables [pool] of the descriptions; None if nothing is to be pooled.

    Args:
        descriptions: read.
        several: whether several logs were named; one log may have a description for each axis.
        given: key of [pool] -> value of an option; None or False if it was not given.

    Raises:
        ScenarioError: the tables do not agree; or an option is given that only pooling uses, and there is one log.
    """
    options = {key: value for key, value in given.items() if value not in (None, False)}
    asked = agreed(descriptions).model_copy(update=options)
    if several or asked.each or asked.prior is not None:
        return asked
    if options:
        raise ScenarioError(
            f"--{', --'.join(options)} pools several logs, got one; give more, or --each to pool its records"
        )
    return None


def show_pooled(
    descriptions: Sequence[RecordDescription], out: Path, data: Path | None, settings: Pooling, strict: bool
) -> None:
    """Identify and pool, write a page of every log and one of all of them, and show that."""
    names = [name for name, _ in parts_of(descriptions, settings.each)]
    with ExitStack() as ends, stages() as say:
        places = {name: ends.enter_context(ResultFolder(folder_in(out, name))) for name in names}
        folder = folder_in(out, file_stem(f"pooled_{'_'.join(names)}"))
        place = ends.enter_context(ResultFolder(folder))
        flights = identify_and_pool(
            descriptions,
            data,
            settings=settings,
            keep=lambda name: record_keeper(places[name]),
            progress=say,
            strict=strict,
        )
        say("write reports")
        for name, found in zip(flights.names, flights.found, strict=True):
            identify_page(found).write(places[name])
        page = pool_page(flights)
        page.write(place)
    page.show(console(), folder)
    for name in flights.names:
        console().print(f"Log {name}: {out / name}/report.html", soft_wrap=True, markup=False, highlight=False)
