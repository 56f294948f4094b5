"""What the commands of several questions share: arguments, options, and the refusal of those that would do nothing."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer
from typer.core import TyperGroup

if TYPE_CHECKING:
    from testbench.core.store import ResultFolder

ScenarioArgument = Annotated[
    Path, typer.Argument(help="Scenario file, or the name of a packaged one.", show_default=False)
]
OutOption = Annotated[Path, typer.Option("--out", "-o", help="Folder for results; each scenario gets its own in it.")]
DataOption = Annotated[
    Path | None, typer.Option(help="Folder with the data files, instead of the one in the description.")
]
AircraftOption = Annotated[str | None, typer.Option(help="Aircraft that flies, instead of the scenario's.")]
StrictOption = Annotated[bool, typer.Option("--strict", help="Refuse implausible values.")]
BeginningOption = Annotated[
    float, typer.Option(min=1.0, max=36000.0, help="With --changes: flight that is nominal at the beginning, s.")
]
SeedOption = Annotated[int | None, typer.Option("--seed", min=0, help="Seed, instead of the one in the scenario.")]

UsageError: Any = typer.BadParameter.__base__  # click's, of whichever click typer brings


class Wings(str, Enum):
    """Whether elastic modes move."""

    flexible = "flexible"
    rigid = "rigid"


class DrivenBy(str, Enum):
    """What tells how the controls moved."""

    command = "command"
    surface = "surface"
    both = "both"


class FlownBy(str, Enum):
    """What flies the flights of a question."""

    auto = "auto"
    jsbsim = "jsbsim"


SimulatorOption = Annotated[
    FlownBy,
    typer.Option("--simulator", help="jsbsim flies one flight after the other; auto flies many at once where it can."),
]


class Answering:
    """What a command answers into: its folder, what tells the stages, and the result, or its page, once it is found."""

    def __init__(self, place: ResultFolder, say: Callable[[str], None]) -> None:
        self.place, self.say = place, say
        self.found: Any = None


@contextmanager
def answering(out: Path, name: str, stage: str = "write report") -> Iterator[Answering]:
    """Give the folder ``name`` of ``out`` to the block; write the page of what it found there, and show it."""
    from testbench.core.store import ResultFolder, folder_in
    from testbench.page.page import Page
    from testbench.page.terminal import console, stages

    with ResultFolder(folder_in(out, name)) as place, stages() as say:
        answer = Answering(place, say)
        yield answer
        say(stage)
        page = answer.found if isinstance(answer.found, Page) else answer.found.page
        page.write(place)
    page.show(console(), place.path)


class ByDefault(TyperGroup):
    """A group of commands whose name may be followed by what the first of them takes.

    ``aircraft eolo`` is ``aircraft show eolo``.
    """

    default: ClassVar[str] = ""

    @classmethod
    def first(cls, name: str) -> type[ByDefault]:
        """Return the group whose first command has this name."""
        return type(cls.__name__, (cls,), {"default": name})

    def shell_complete(self, ctx: Any, incomplete: str) -> list[Any]:
        """Return the commands of the group, and what the first of them takes."""
        first = self.commands[self.default].params[0]
        return [*super().shell_complete(ctx, incomplete), *first.shell_complete(ctx, incomplete)]

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the first command before arguments that begin with no command of the group."""
        if args and args[0] not in {*self.commands, *ctx.help_option_names}:
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


class Columns(str, Enum):
    """How wide figures for a paper are."""

    single = "single"
    double = "double"


_ONLY_WITH_FIGURES = ("column", "style", "latex")
_FIGURES = {
    "figures": (
        Annotated[
            str | None,
            typer.Option(
                "--figures",
                help="Formats of figures/, of pdf, svg and png, with a comma between them: pdf,svg. Each figure has "
                "its data as CSV, and a Python program that redraws it.  [default: png, without data]",
                show_default=False,
            ),
        ],
        None,
    ),
    "column": (
        Annotated[Columns, typer.Option("--column", help="Width of --figures: 3.5 in or 7.16 in.")],
        Columns.double,
    ),
    "style": (
        Annotated[
            Path | None,
            typer.Option("--style", help="matplotlib style file (.mplstyle) for --figures.", show_default=False),
        ],
        None,
    ),
    "latex": (Annotated[bool, typer.Option("--latex", help="Set the text of --figures by LaTeX.")], False),
}


def with_figures(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command that writes a page the options of figures for a paper.

    They hold around the command, see :mod:`testbench.page.publish`, which needs to know nothing of them.
    """
    signature = inspect.signature(command, eval_str=True)
    own = list(signature.parameters.values())
    takes_context = any(p.annotation is typer.Context for p in own)
    keyword = inspect.Parameter.KEYWORD_ONLY
    more = [] if takes_context else [inspect.Parameter("context", keyword, annotation=typer.Context)]
    more += [inspect.Parameter(n, keyword, annotation=a, default=d) for n, (a, d) in _FIGURES.items()]

    @functools.wraps(command)
    def around(**given: Any) -> None:
        """Take out the options of figures and call the command."""
        from testbench.page.publish import published

        figures, column, style, latex = (given.pop(name) for name in _FIGURES)
        context = given["context"] if takes_context else given.pop("context")
        if figures is None:
            refuse(context, "without --figures", *_ONLY_WITH_FIGURES)
        with published(None if figures is None else _publication(context, figures, column, style, latex)):
            command(**given)

    around.__signature__ = signature.replace(parameters=[*own, *more])  # type: ignore[attr-defined]
    return around


def _publication(context: typer.Context, figures: str, column: Columns, style: Path | None, latex: bool) -> Any:
    from testbench.page.publish import FORMATS, Publication

    formats = tuple(dict.fromkeys(part.strip().lower() for part in figures.split(",")))
    bad = [name for name in formats if name not in FORMATS]
    if bad:
        raise UsageError(f"--figures must be of {', '.join(FORMATS)}, got '{bad[0]}'", ctx=context)
    return Publication(formats, column is Columns.double, style, latex)
