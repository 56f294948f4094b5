"""The command ``testbench exercise``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.page.terminal import console

command = typer.Typer(no_args_is_help=True, help="Teaching exercises: records to study, answers to check.")


KeyOption = Annotated[
    Path | None,
    typer.Option(
        help="File with the teacher's own key. Default: TESTBENCH_EXERCISE_KEY, or else a public key.", dir_okay=False
    ),
]


@command.command("list")
def exercise_list() -> None:
    """List the exercises with level and time."""
    from testbench.questions.exercise.show import print_list

    print_list(console())


@command.command("start")
def exercise_start(
    name: Annotated[str, typer.Argument(help="Exercise; see `testbench exercise list`.", show_default=False)],
    student: Annotated[
        str, typer.Option(help="Name or number; each student gets a different truth.", show_default=False)
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="New folder; NAME_STUDENT if not given.", show_default=False)
    ] = None,
    key_file: KeyOption = None,
) -> None:
    """Write a student's own version: text, records, and a template for the answers.

    Example: `testbench exercise start short_period --student anna`. With a key of the teacher's own (--key-file), only
    its owner can check or compute the truth.
    """
    from testbench.questions.exercise.ask import start
    from testbench.questions.exercise.seal import read_key
    from testbench.questions.exercise.show import print_started

    print_started(start(name, student, read_key(key_file), out), console())


@command.command("check")
def exercise_check(
    folders: Annotated[
        list[Path], typer.Argument(help="Folder that `start` wrote, or several folders.", show_default=False)
    ],
    key_file: KeyOption = None,
) -> None:
    """Judge answers.toml: what is right, what is off by how much, and why. Exit status 1 if not all answers are right.

    Of several folders, one line each is printed. Example: `testbench exercise check short_period_anna`.
    """
    from testbench.questions.exercise.check import Result, check_class
    from testbench.questions.exercise.check import check as check_answers
    from testbench.questions.exercise.seal import read_key
    from testbench.questions.exercise.show import print_class, print_result

    key = read_key(key_file)
    if len(folders) == 1:
        result = check_answers(folders[0], key)
        print_result(result, console(), folders[0])
        passed = result.passed
    else:
        results = check_class(folders, key)
        print_class(results, console())
        passed = all(isinstance(r, Result) and r.passed for r in results.values())
    if not passed:
        raise typer.Exit(1)
