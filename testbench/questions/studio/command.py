"""The command ``testbench studio``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.page.terminal import stages


def command(
    aircraft: Annotated[
        list[str] | None, typer.Argument(help="Aircraft to offer; all of them if none is named.")
    ] = None,
    write: Annotated[
        Path | None, typer.Option(help="Write the page to this file instead of serving it.", show_default=False)
    ] = None,
    port: Annotated[int, typer.Option(help="Port on this machine; 0 for any that is free.")] = 8700,
) -> None:
    """Serve an interactive page: drag an input and see its spectrum, the response and the expected standard errors.

    The page is served on 127.0.0.1 only, until Ctrl-C. Example: `testbench studio eolo`.
    """
    from testbench.core.errors import RecordError
    from testbench.core.store import write_beside
    from testbench.page.serve import Answer, serving
    from testbench.questions.studio.ask import studio_models
    from testbench.questions.studio.page import studio_page

    if write is not None and write.is_dir():
        raise RecordError(f"the page must be written to a file, got the folder '{write}'; name a file in it")
    with stages() as say:
        page = studio_page(studio_models(aircraft or (), say))
    if write is not None:
        print(f"Written: {write_beside(write, page)}")
        return
    with serving({"/": Answer(page.encode())}.get, port) as server:
        server.until_ended()
