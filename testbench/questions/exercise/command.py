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

    Example: `testbench exercise start short_period --student anna`. With the teacher's own key (--key-file), only its
    owner can check or compute the truth.
    """
    from testbench.questions.exercise.ask import start
    from testbench.questions.exercise.seal import read_key
    from testbench.questions.exercise.show import print_started

    print_started(start(name, student, read_key(key_file), out), console())


@command.command("roster")
def exercise_roster(
    students: Annotated[
        str, typer.Argument(help="Number of students, or a file with one name a line.", show_default=False)
    ],
    exercise: Annotated[
        list[str] | None,
        typer.Option(
            help="Exercise of the course; may be repeated. Default: those that the class has, all for a new one.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the class.")] = Path("class"),
    key_file: KeyOption = None,
) -> None:
    """Write the folders of a class: each student's own version of each exercise, and a key that only you have.

    Examples: `testbench exercise roster 25`, or with `--exercise doublet_length --exercise short_period` behind it.
    Hand out what is in class/students; keep class/key.txt. Students who join later are added by the same command.
    """
    from testbench.questions.exercise.roster import HANDED_OUT, exercises_of, make_roster, students_of

    found = make_roster(students_of(students), exercise or exercises_of(out), out, key_file)
    left = f", {len(found.kept)} were there already" if found.kept else ""
    console().print(f"{len(found.begun)} folders written to {out / HANDED_OUT}{left}", highlight=False, soft_wrap=True)
    for path in found.restored:
        console().print(f"Missing, and written again: {path}", highlight=False, soft_wrap=True)
    console().print(f"Hand out: {out / HANDED_OUT}", highlight=False, soft_wrap=True)
    console().print(f"Keep:     {found.key_file}", highlight=False, soft_wrap=True)
    console().print(f"Marks:    testbench exercise marks {out}", highlight=False, soft_wrap=True)


@command.command("marks")
def exercise_marks(
    places: Annotated[
        list[Path], typer.Argument(help="Folder of a class, or folders that were handed in.", show_default=False)
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Table; marks.csv in the first folder if not given.")
    ] = None,
    key_file: KeyOption = None,
) -> None:
    """Collect the answers of a class into one table: the number of right answers, and the mistakes of each student.

    Example: `testbench exercise marks class`. The key is that of --key-file, else key.txt in the first folder.
    """
    from testbench.core.store import write_beside
    from testbench.questions.exercise.check import check_class
    from testbench.questions.exercise.roster import KEY, MARKS, folders_of, marks_text
    from testbench.questions.exercise.seal import read_key
    from testbench.questions.exercise.show import print_class

    own = places[0] / KEY
    key = read_key(key_file or (own if own.is_file() else None))
    results = check_class(folders_of(places), key)
    text = marks_text(results)
    table = write_beside(out or places[0] / MARKS, text)  # first: a reader may stop
    print_class(results, console())
    console().print(f"Table: {table}", highlight=False, soft_wrap=True)


@command.command("check")
def exercise_check(
    folders: Annotated[
        list[Path], typer.Argument(help="Folder that `start` wrote, or several folders.", show_default=False)
    ],
    key_file: KeyOption = None,
) -> None:
    """Judge answers.toml: right answers, the errors of others, and their causes. Exit status 1 if not all are right.

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
