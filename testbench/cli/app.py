"""The application, what its commands share, and how an error becomes one message and an exit status."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer

from testbench.errors import TestbenchError

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    help="""Fly an identification experiment in simulation before the aircraft does.

A JSBSim aircraft is excited by an input, a sensor suite records it, estimators identify a model, and the report says
whether this input and these sensors would have been good enough. Turned round, with measured records, it finds what the
simulation lacks.

**Start here**

    testbench list scenarios
    testbench run eolo_alpha              # simulate, identify, report in results/eolo_alpha/report.html
    testbench check my_scenario.toml      # every fault of a file at once, without flying
    testbench identify my_records.toml    # the same line for recorded flights
    testbench import flight.ulg -o my_log # what a flight log holds, its manoeuvres as records
    testbench compatibility my_records.toml # do the instruments agree with each other?
    testbench response my_records.toml    # frequency responses with coherence and random error
    testbench modes eolo_turbulence       # modes from the wing's accelerometers alone, no input
    testbench gap flexible_wings          # find, name and add what the simulation lacks
    testbench design eolo_short_period    # which input tells what is wanted, inside the limits
    testbench compare eolo_alpha          # what each sensor buys, by simulation and by information
    testbench plan eolo_envelope          # a campaign with flight cards to print
    testbench campaign run taurus_scatter # a scenario many times, over distributions of anything in it
    testbench aircraft eolo               # trims, modes over speed, derivatives of an aircraft
    testbench studio                      # drag an input in a browser, see what it would tell
    testbench reproduce all               # the papers' tables and figures, printed and ours
    testbench exercise list               # teaching exercises, each student with an aircraft of their own

Exit status: 0 done, 2 bad input, 3 the computation cannot be carried out (no trim, flight aborted, not identifiable).
""",
)

ScenarioArgument = Annotated[
    Path, typer.Argument(help="Scenario file, or the name of a packaged one.", show_default=False)
]
OutOption = Annotated[Path, typer.Option("--out", "-o", help="Folder that gets one folder of results per scenario.")]
SeedOption = Annotated[int | None, typer.Option("--seed", min=0, help="Replaces the seed of the scenario.")]

_UsageError: Any = typer.BadParameter.__base__  # click's, of whichever click typer brings
_INTERRUPTED = 130


class Wings(str, Enum):
    """Whether elastic modes move."""

    flexible = "flexible"
    rigid = "rigid"


def console() -> Any:
    """Return a console on standard output."""
    from rich.console import Console

    return Console()


@contextmanager
def stages() -> Iterator[Callable[[str], None]]:
    """Show the stage that is running: a spinner with the time elapsed on a terminal, plain lines elsewhere."""
    from rich.console import Console

    screen = Console(stderr=True)
    if not screen.is_terminal:
        yield lambda text: print(f"... {text}", file=sys.stderr, flush=True)
        return
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    with Progress(
        SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=screen, transient=True
    ) as progress:
        task = progress.add_task("start", total=None)
        yield lambda text: progress.update(task, description=text)


def refuse(context: typer.Context, why: str, *parameters: str) -> None:
    """Refuse parameters of a command that were given and that nothing would heed.

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
            raise _UsageError(f"{name} has no use {why}", ctx=context)


def main() -> None:
    """Run the command line; turn every error raised on purpose into one message and an exit status."""
    # Before numpy is imported: for matrices this small, threads cost more than they give.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        status = app(prog_name="testbench", standalone_mode=False)
    except _UsageError as error:
        _say_usage(error)
        sys.exit(2)
    except TestbenchError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(error.exit_status)
    except OSError as error:
        print(f"error: cannot read or write {error.filename or 'a file'}: {error.strerror or error}", file=sys.stderr)
        sys.exit(3)
    if status == _INTERRUPTED:
        print("interrupted; what was written so far is kept", file=sys.stderr)
    if status:
        sys.exit(status)


def _say_usage(error: Any) -> None:
    """Say in one line what is wrong with a command."""
    if type(error).__name__ == "NoArgsIsHelpError":  # nothing but a group's name: its help has been printed
        return
    command = error.ctx.command_path if error.ctx is not None else "testbench"
    message = " ".join(error.format_message().split()).replace("Value error, ", "").rstrip(".")
    print(f"error: {message}; see `{command} --help`", file=sys.stderr)
