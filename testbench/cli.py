"""The command line: the commands of all questions, check and list, and how an error becomes one message."""

from __future__ import annotations

import os
import sys
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

from testbench.core.bring import is_brought, short
from testbench.core.errors import ScenarioError, TestbenchError
from testbench.page.terminal import console
from testbench.questions import QUESTIONS
from testbench.questions.options import UsageError

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
_INTERRUPTED = 130

for _question in QUESTIONS:  # they stand in the help in the order of the table
    _command = import_module(f"{_question.package}.command").command
    if isinstance(_command, typer.Typer):
        app.add_typer(_command, name=_question.command)
    else:
        app.command(_question.command)(_command)


class Kind(str, Enum):
    """What `testbench list` can list."""

    aircraft = "aircraft"
    inputs = "inputs"
    sensors = "sensors"
    estimators = "estimators"
    scenarios = "scenarios"
    effects = "effects"


@app.command()
def check(
    scenarios: Annotated[list[Path], typer.Argument(help="Scenario files or names.", show_default=False)],
) -> None:
    """Report every fault of scenario files at once, with file, key, law and value, without flying.

    Of an own estimator or structure, FILE.py:NAME, try every law that it must keep.
    """
    from testbench.questions.files import check_file

    faults: list[str] = []
    for scenario in scenarios:
        try:
            if is_brought(str(scenario)):
                faults += _try_laws(str(scenario))
                continue
            kind = check_file(scenario)
            console().print(f"{scenario}: a valid {kind}", highlight=False)
        except ScenarioError as error:
            faults.extend(error.faults)
        except TestbenchError as error:
            faults.append(str(error))
    if faults:
        raise ScenarioError(faults)


def _try_laws(name: str) -> list[str]:
    """Print each law that what is brought must keep, and whether it does; return those that are broken."""
    from testbench.estimators.contract import tried

    broken = []
    for law, failed in tried(name):
        print(f"{'FAILED' if failed else 'passed'}  {law}" + (f": {failed}" if failed else ""), flush=True)
        broken += [f"{short(name)}, {law}: {failed}"] if failed else []
    return broken


@app.command("list")
def list_(kind: Annotated[Kind, typer.Argument(help="What to list.", show_default=False)]) -> None:
    """List what a scenario may name: aircraft, inputs, sensors (suites), estimators, scenarios, effects."""
    from rich.table import Table

    from testbench.questions.catalogue import FAMILIES

    table = Table(box=None, pad_edge=False)
    rows = FAMILIES[kind.value]()
    for head in rows[0]:
        table.add_column(head, overflow="fold")
    for row in rows[1:]:
        table.add_row(*row)
    console().print(table)


def main() -> None:
    """Run the command line; turn every error raised on purpose into one message and an exit status."""
    # Before numpy is imported: for matrices this small, threads cost more than they give.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        status = app(prog_name="testbench", standalone_mode=False)
    except UsageError as error:
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
