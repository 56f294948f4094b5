"""The command ``testbench results``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.page.terminal import console
from testbench.questions.options import refuse


def command(
    context: typer.Context,
    folder: Annotated[Path, typer.Argument(help="Folder of results, or the first of two results.")] = Path("results"),
    other: Annotated[
        Path | None, typer.Argument(help="A second result, to set beside the first.", show_default=False)
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder for the page of two results. Default: FIRST_and_SECOND."),
    ] = None,
    serve: Annotated[bool, typer.Option("--serve", help="Serve the index on 127.0.0.1 until Ctrl-C.")] = False,
    port: Annotated[int, typer.Option(help="Port on this machine; 0 for any that is free.")] = 8701,
) -> None:
    """Write an index of a folder of results, with titles, answers and dates; or set two results side by side.

    Examples: `testbench results` writes results/index.html; `testbench results --serve` serves it;
    `testbench results results/a results/b` compares two.
    """
    from testbench.core.files import write_file
    from testbench.page.serve import HOST, serving
    from testbench.page.terminal import print_rows
    from testbench.questions.results.ask import compare_results, list_results
    from testbench.questions.results.page import INDEX, compared_page, files_of, index_html

    if other is not None:
        refuse(context, "where two results are compared", "serve", "port")
        page = compared_page(compare_results(folder, other))
        target = out or folder.resolve().parent / f"{folder.resolve().name}_and_{other.resolve().name}"
        page.write(target)
        page.show(console(), target)
        return
    refuse(context, "without a second result", "out")
    if not serve:
        refuse(context, "without --serve", "port")
    found = list_results(folder)
    if serve:
        with serving(files_of(folder, lambda: index_html(list_results(folder), folder)), port) as server:
            print(f"Open http://{HOST}:{server.server_port}/ in a browser; Ctrl-C ends.", flush=True)
            try:
                server.serve_forever()
            except KeyboardInterrupt:
                print("Ended.")
        return
    written = write_file(folder / INDEX, index_html(found, folder))  # first: who reads what is printed may stop
    rows = [(r.title, r.answer, f"{r.written:%Y-%m-%d %H:%M}") for r in found]
    print_rows(console(), ("result", "answer", "written"), rows)
    print(f"Written: {written}")
