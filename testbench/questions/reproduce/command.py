"""The command ``testbench reproduce``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.page.terminal import console, stages
from testbench.questions.options import OutOption, with_figures


@with_figures
def command(
    what: Annotated[str, typer.Argument(help="taurus, eolo, b1 or all.")] = "all", out: OutOption = Path("results")
) -> None:
    """Reproduce the papers' figures and tables, and compare every printed number with ours.

    Writes tables, figures and one page, index.html, into `reproduction`, or `reproduction_NAME` for one aircraft alone.
    Example: `testbench reproduce taurus`.
    """
    from testbench.core.store import ResultFolder, folder_in
    from testbench.questions.reproduce.ask import chosen, reproduce
    from testbench.questions.reproduce.page import PAGE, print_reproduction, write_reproduction

    chosen(what)
    folder = folder_in(out, "reproduction" if what == "all" else f"reproduction_{what}")
    with ResultFolder(folder) as place, stages() as say:
        place.check(PAGE)
        chapters = reproduce(what, say)
        say("write page")
        write_reproduction(chapters, place)
    print_reproduction(chapters, console(), folder)
