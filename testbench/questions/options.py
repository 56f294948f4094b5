"""What the commands of several questions share: arguments, options, and the refusal of those that would do nothing."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated, Any, ClassVar

import typer
from typer.core import TyperGroup

ScenarioArgument = Annotated[
    Path, typer.Argument(help="Scenario file, or the name of a packaged one.", show_default=False)
]
OutOption = Annotated[Path, typer.Option("--out", "-o", help="Folder for results; each scenario gets its own in it.")]
DataOption = Annotated[
    Path | None, typer.Option(help="Folder with the data files, instead of the one in the description.")
]
StrictOption = Annotated[bool, typer.Option("--strict", help="Refuse values that no flight has.")]
SeedOption = Annotated[int | None, typer.Option("--seed", min=0, help="Seed, instead of the one in the scenario.")]

UsageError: Any = typer.BadParameter.__base__  # click's, of whichever click typer brings


class Wings(str, Enum):
    """Whether elastic modes move."""

    flexible = "flexible"
    rigid = "rigid"


class FlownBy(str, Enum):
    """What flies the flights of a question."""

    auto = "auto"
    jsbsim = "jsbsim"


SimulatorOption = Annotated[
    FlownBy,
    typer.Option("--simulator", help="jsbsim flies one flight after the other; auto flies many at once where it can."),
]


class ByDefault(TyperGroup):
    """A group of commands whose name may be followed by what the first of them takes.

    ``aircraft eolo`` is ``aircraft show eolo``.
    """

    default: ClassVar[str] = ""

    @classmethod
    def first(cls, name: str) -> type[ByDefault]:
        """Return the group whose first command has this name."""
        return type(cls.__name__, (cls,), {"default": name})

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the first command before arguments that begin with no command of the group."""
        if args and args[0] not in {*self.commands, "--help"}:
            args = [self.default, *args]
        return super().parse_args(ctx, args)


def refuse(context: typer.Context, why: str, *parameters: str) -> None:
    """Refuse parameters of a command that were given and would do nothing.

    Args:
        context: of the command.
        why: ends the sentence "X has no use ...".
        parameters: names as the command's function has them.

    Raises:
        click.UsageError: names the first of them that was given.
    """
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if parameter.name in parameters and source is not None and source.name == "COMMANDLINE":
            name = next((o for o in parameter.opts if o.startswith("--")), (parameter.name or "").upper())
            raise UsageError(f"{name} has no use {why}", ctx=context)
