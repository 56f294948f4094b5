"""The command ``testbench results``."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from testbench.page.terminal import console
from testbench.questions.options import refuse


def command(
    context: typer.Context,
    folder: Annotated[Path, typer.Argument(help="Folder of results, or the first of two results.")] = Path("results"),
    other: Annotated[
        Path | None, typer.Argument(help="A second result, for comparison with the first.", show_default=False)
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for the page of two results. Default: FIRST_and_SECOND.")
    ] = None,
    verify: Annotated[
        bool, typer.Option("--verify", help="Verify that the files of one result are unchanged.")
    ] = False,
) -> None:
    """List the results of a folder with titles, answers and dates; or show one result, or compare two.

    For one result the command lists its provenance: command, versions, inputs, files. With --verify it lists the files
    that have changed and the changes that a repetition would make, and ends with 1 if the result has changed. Examples:
    `testbench results`, which the board of `testbench app` shows with their pages; `testbench results results/a
    --verify`; `testbench results results/a results/b` compares two.
    """
    from testbench.core.store import manifest_of
    from testbench.page.terminal import print_rows
    from testbench.page.words import sentence
    from testbench.questions.results.ask import compare_results, list_results, verify_results
    from testbench.questions.results.page import compared_page, made_from, states, verdict

    if other is not None:
        refuse(context, "where two results are compared", "verify")
        page = compared_page(compare_results(folder, other))
        target = out or folder.resolve().parent / f"{folder.resolve().name}_and_{other.resolve().name}"
        page.write(target)
        page.show(console(), target)
        return
    refuse(context, "without a second result", "out")
    if verify:
        verified = verify_results(folder)
        print_rows(console(), ("file", "state"), states(verified))
        for text in verdict(verified):
            console().print(sentence(text), soft_wrap=True, markup=False, highlight=False)
        if verified.manifest.command:
            print(f"The same command again: {shlex.join(verified.manifest.command)}")
        raise typer.Exit(0 if verified.whole else 1)
    made = manifest_of(folder) if folder.is_dir() else None
    if made is not None:
        print_rows(console(), ("what", "name", "bytes", "SHA-256"), made_from(made), (False, False, True, False))
        return
    rows = [(r.title, r.answer, f"{r.written:%Y-%m-%d %H:%M}") for r in list_results(folder)]
    print_rows(console(), ("result", "answer", "written"), rows)
