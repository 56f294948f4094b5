"""The command ``testbench new``, and what ``testbench`` alone says in the folder of a campaign."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.page.terminal import console


def command(
    name: Annotated[Path, typer.Argument(help="Folder of the campaign, a new one.", show_default=False)],
    aircraft: Annotated[str, typer.Option(help="What is to be flown: packaged, or of your own.", show_default=False)],
    sensors: Annotated[str, typer.Option(help="Its sensors: a packaged suite, or a file.", show_default=False)],
    speed: Annotated[
        list[float] | None,
        typer.Option("--speed", min=0.1, help="True airspeed, m/s; once or more. Default: the design speed.",
                     show_default=False),
    ] = None,
) -> None:  # fmt: skip
    """Begin a campaign: a folder with project.toml, which states what all questions share and records their results.

    A scenario in the folder needs only its own keys, and `testbench` alone prints the state of the campaign and the
    next command. Example: `testbench new my_project --aircraft taurus --sensors eolo_alpha`.
    """
    from testbench.questions.project.new import new_project

    for file in new_project(name, aircraft, sensors, speed or ()):
        print(f"Written: {file}")
    print(f"Next: cd {name}, then testbench")


def show_standing() -> bool:
    """Print where the campaign of the working directory stands; return whether it is one."""
    from testbench.core.project import project_here
    from testbench.questions.project.standing import standing

    project = project_here()
    if project is None:
        return False
    for line in standing(project):
        console().print(line, soft_wrap=True, markup=False, highlight=False)
    return True
