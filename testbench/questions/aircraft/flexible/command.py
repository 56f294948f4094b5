"""The command ``testbench aircraft flexible``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.page.terminal import console, print_answer, print_table, stages


def flexible(
    name: Annotated[str, typer.Argument(help="Rigid aircraft: packaged, or a folder of your own.", show_default=False)],
    modes: Annotated[
        Path, typer.Argument(help="File of the ground vibration test, or of assumed modes.", show_default=False)
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder of the flexible aircraft; aircraft/NAME_flexible if not given."),
    ] = None,
) -> None:
    """Add the modes of a ground vibration test to an aircraft, and compute the onset of flutter.

    The shapes are coupled to the air by strips, scaled so that they give the aircraft's own derivatives. The aircraft
    is copied into a separate folder, which every other command accepts. Example: `testbench aircraft flexible taurus
    modes.toml -o aircraft/soft`, then `testbench aircraft soft`.
    """
    from testbench.questions.aircraft.flexible.answer import compared_table, constant_table, flexible_answer
    from testbench.questions.aircraft.flexible.ask import add_ground_test
    from testbench.questions.aircraft.page import elastic_table

    with stages() as say:
        found = add_ground_test(name, modes, out, say)
    screen = console()
    screen.print(found.made.aircraft.title, style="bold underline", markup=False)
    print_answer(screen, flexible_answer(found))
    for table in (elastic_table(found.survey), constant_table(found.made), compared_table(found.made)):
        screen.print()
        print_table(screen, table)
    screen.print()
    screen.print(f"Aircraft: {found.folder}", soft_wrap=True, markup=False)
    screen.print(f"Next: testbench aircraft {found.folder}", soft_wrap=True, markup=False)
