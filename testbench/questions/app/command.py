"""The command ``testbench app``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    folder: Annotated[Path, typer.Argument(help="Folder to work in, such as that of a campaign.")] = Path(),
    port: Annotated[int, typer.Option(help="Port on this machine; 0 for any that is free.")] = 8700,
) -> None:
    """Work in a browser: inspect logs, run questions and watch their progress, compare all results.

    Logs go to logs/ and results to results/ in the folder; every step shows the command that does the same in a
    terminal. The page is served on 127.0.0.1 only, at an address that cannot be guessed, until Ctrl-C. Example:
    `testbench app my_project`.
    """
    from testbench.page.serve import serving
    from testbench.questions.app.ask import Workbench

    with Workbench(folder) as bench, serving(bench.answer, port, bench.take) as server:
        server.until_ended(bench.home)
