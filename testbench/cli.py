"""The command line: the commands of all questions, check and list, and how an error becomes one message."""

from __future__ import annotations

import contextlib
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from testbench.core.door import READ
from testbench.core.errors import RecordError, Refusal, ScenarioError, TestbenchError, brief, given
from testbench.core.interrupts import ended_by_signals
from testbench.page.terminal import console, in_manner, manner, open_streams, print_rows
from testbench.questions import BY_COMMAND, QUESTIONS, Question
from testbench.questions.options import UsageError

_HELP = """Fly an identification experiment in simulation before the aircraft does.

A JSBSim aircraft is excited by an input, a sensor suite records it, estimators identify a model, and a report shows
whether this input and these sensors are good enough. With measured records it identifies derivatives, and it finds
what the simulation lacks.

**Start here**

{examples}

Exit status: 0 done, 1 a result is not what was written (results --verify), 2 bad input, 3 the computation cannot be
carried out (no trim, flight aborted, not identifiable, disk full), 130 interrupted, 143 ended by the system.
"""
NAMED = {
    "aircraft": ("aircraft",), "name": ("aircraft",), "suite": ("suite",), "things": ("scenario", "aircraft", "suite"),
    "scenario": ("scenario",), "campaign": ("scenario",), "case": ("scenario", "aircraft"), "source": ("scenario",),
    "description": ("scenario",), "descriptions": ("scenario",),
}  # fmt: skip
"""Parameter of a command -> families whose names a shell completes for it."""
_UNKNOWN = re.compile("No such command '([^']*)'")
_FITS = 30  # letters of an example beside which its words stand in 80 columns
_INTERRUPTED = 130
_PIPE_CLOSED = 141
"""What a shell says of a process that wrote to a pipe that nobody reads: 128 and the number of SIGPIPE."""


def _speak(context: typer.Context, parameter: typer.CallbackParam, given: bool) -> None:
    if given:
        context.with_resource(in_manner((parameter.name or "").removeprefix("as_")))


def _say_version(wanted: bool) -> None:
    if wanted:
        from testbench import __version__

        console().print(f"testbench {__version__}", highlight=False)
        raise typer.Exit


def _manners(
    quiet: Annotated[
        bool,
        typer.Option("--quiet", "-q", callback=_speak, expose_value=False, help="Answer in one sentence; no progress."),
    ] = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", callback=_speak, expose_value=False, help="Answer with every sentence.")
    ] = False,
    as_json: Annotated[
        bool,
        typer.Option(
            "--json", callback=_speak, expose_value=False, help="Print the result as JSON, as in the Python API."
        ),
    ] = False,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_say_version, is_eager=True, expose_value=False, help="Print the version."),
    ] = False,
) -> None:
    """Hold the options that every command takes: how it answers, and the version."""


class Everywhere(TyperGroup):
    """The group of all commands: gives each of them what every command has.

    These are the options of :func:`_manners`, and completion of the names of scenarios, aircraft and suites.
    """

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        holder = typer.Typer(add_completion=False)
        holder.command()(_manners)
        manners = typer.main.get_command(holder).params
        for command in _below(self):
            for parameter in command.params:
                if parameter.name in NAMED:
                    parameter._custom_shell_complete = _names
            command.params.extend(manners)


def _below(command: Any) -> Iterator[Any]:
    """Yield a command and all below it."""
    yield command
    for child in getattr(command, "commands", {}).values():
        yield from _below(child)


def _names(context: Any, parameter: Any, begun: str) -> list[str]:
    """Return what a shell may put in the place of a name that is begun: names that are known, files and folders."""
    from testbench.core import paths

    words = context.command_path.split()
    question = BY_COMMAND.get(words[1] if len(words) > 1 else "")
    folder = paths.SCENARIOS / (question.folder if question is not None else "")
    known: dict[str, Callable[[], Iterable[str]]] = {
        "scenario": lambda: (p.stem for p in folder.glob("*.toml")),
        "aircraft": lambda: (
            *(*paths.aircraft_names(), *paths.AIRCRAFT.own(Path())),
            *(f"{paths.STOCK}{name}" for name in paths.stock_names()),
            *paths.installed("aircraft"),
        ),
        "suite": lambda: (*paths.suite_names(), *paths.SENSOR_SUITES.own(Path()), *paths.installed("suites")),
    }
    names = {name for kind in NAMED[parameter.name] for name in known[kind]()}
    beside = (f"{p}/" if p.is_dir() else str(p) for p in Path().glob(f"{begun}*")) if not begun.startswith("/") else ()
    found = [name for name in (*sorted(names), *sorted(beside)) if name.startswith(begun)]
    return [name for name in found if begun.startswith(".") or not name.startswith(".")]


def application(questions: Sequence[Question] = QUESTIONS) -> typer.Typer:
    """Return the command line of some questions, in the order of their table, with check and list."""
    asked = [(f"{q.command} {q.example}".strip(), q.words) for q in questions]
    first = [("list scenarios", "what there is to start from"), *asked]
    first.append(("check my_scenario.toml", "every fault of a file at once"))
    examples = (f"{example:<{_FITS}} # {words}" if len(example) <= _FITS else example for example, words in first)
    out = typer.Typer(
        cls=Everywhere,
        context_settings={"help_option_names": ["-h", "--help"]},
        pretty_exceptions_enable=False,
        rich_markup_mode="markdown",
        help=_HELP.format(examples="\n".join(f"    testbench {example}" for example in examples)),
    )
    out.callback(invoke_without_command=True)(start)
    for question in questions:
        command = import_module(f"{question.package}.command").command
        if isinstance(command, typer.Typer):
            out.add_typer(command, name=question.command)
        else:
            out.command(question.command)(command)
    out.command()(check)
    out.command("list")(list_)
    out.command()(schema)
    return out


def start(context: typer.Context) -> None:
    """Take the options that stand before a command; without a command, say what may be wanted."""
    if context.invoked_subcommand is None:
        from testbench.questions.project.command import show_standing

        if not show_standing():
            overview()


def overview() -> None:
    """Say in twelve lines what may be wanted, and which command gives it."""
    print("Fly an identification experiment before the aircraft does.")
    wanted = [(q.want, f"{q.command} {q.example}".partition(" --")[0].strip()) for q in QUESTIONS if q.want]
    for want, example in [*wanted, ("check a file", "check my_scenario.toml")]:
        print(f"  {want:<20} testbench {example}")
    print("testbench list scenarios: examples; testbench -h: the rest")


class Kind(str, Enum):
    """What `testbench list` can list."""

    aircraft = "aircraft"
    inputs = "inputs"
    sensors = "sensors"
    estimators = "estimators"
    structures = "structures"
    scenarios = "scenarios"
    effects = "effects"


def check(
    things: Annotated[
        list[Path],
        typer.Argument(
            help="TOML files or names of any kind (`testbench schema` lists them), aircraft folders, FILE.py:NAME.",
            show_default=False,
        ),
    ],
) -> None:
    """Report every fault of files at once, with file, key, law and value; scenarios are not flown.

    An aircraft folder, a sensor suite, an estimator, a structure or an effect of your own is tested against the laws of
    its kind. Examples: `testbench check my_scenario.toml`, `testbench check aircraft/mine suites/my_suite.toml
    my_method.py:estimate`.
    """
    from testbench.questions.brought import laws_of
    from testbench.questions.files import check_and_notes

    faults: list[str] = []
    for thing in things:
        try:
            brought = laws_of(thing)
            if brought is None:
                kind, notes = check_and_notes(thing)
                console().print(f"{thing}: a valid {kind}", highlight=False)
                for note in notes:
                    console().print(f"note: {note}", highlight=False)
                continue
            kind, laws = brought
            for law in laws:
                console().print(f"{'passed' if law.holds else 'FAILED'}  {law.words}", highlight=False)
            broken = [f"{thing}: {law.sentence}" for law in laws if not law.holds]
            if not broken:
                console().print(f"{thing}: a valid {kind}, {len(laws)} laws kept", highlight=False)
            faults.extend(broken)
        except ScenarioError as error:
            faults.extend(error.faults)
        except Refusal as error:
            faults.append(str(error))
    if faults:
        raise ScenarioError(faults)


def list_(kind: Annotated[Kind, typer.Argument(help="What to list.", show_default=False)]) -> None:
    """List what a scenario may name: aircraft, inputs, sensors (suites), estimators, structures, scenarios, effects."""
    from testbench.questions.files import FAMILIES

    heads, *rows = FAMILIES[kind.value]()
    print_rows(console(), heads, rows)


def schema(
    kind: Annotated[str, typer.Argument(help="Kind of file, or the command that takes it; all if none.")] = "",
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder to write KIND.json to.", show_default=False)
    ] = None,
) -> None:
    """Print the JSON schema of a kind of TOML file: its keys with unit and range, for editors.

    What `testbench new` and `testbench plan new` write names its schema in the first line already. Examples:
    `testbench schema design`, `testbench schema -o schemas`.
    """
    from testbench.core.errors import nearest
    from testbench.questions.files import WITH_FILES, json_schemas, write_schemas

    schemas = json_schemas()
    by_command = {q.command: q.kind for q in WITH_FILES}
    kind = by_command.get(kind, kind.replace("_", " "))
    if kind and kind not in schemas:
        names = [*schemas, *by_command]
        raise UsageError(f"a schema must be of a kind of file, got '{kind}'{nearest(kind, names)}")
    if out is not None:
        for file in write_schemas(out, [kind] if kind else schemas):
            print(f"Written: {file}")
    elif kind:
        with contextlib.nullcontext() if manner().how == "json" else in_manner("json"):
            manner().content.update(schemas[kind])
    else:
        print_rows(console(), ["kind", "keys"], [[k, ", ".join(s.get("properties", ()))] for k, s in schemas.items()])


app = application()


def main() -> None:
    """Run the command line; turn every error raised on purpose into one message and an exit status."""
    # Before numpy is imported: for matrices this small, threads cost more than they give.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    warnings.showwarning = _say_warning
    open_streams()
    READ.clear()  # manifests list what this command reads
    given(sys.argv[1:])
    status, signals = _INTERRUPTED, list[int]()
    with contextlib.suppress(KeyboardInterrupt), ended_by_signals() as came:  # one may come as the block ends
        signals = came
        try:
            status = _status()
        except KeyboardInterrupt:
            status = _INTERRUPTED
    if status == _INTERRUPTED:
        by = f"ended by signal {signals[0]}" if signals else "interrupted"
        print(f"{by}; what was finished is kept, and no result is left half written", file=sys.stderr)
    if signals and status in (0, _INTERRUPTED):  # 0: by a server, which says so itself
        status = 128 + signals[0]
    try:
        sys.stdout.flush()
    except OSError as error:  # what is still buffered has nowhere to go
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            status = status or _unwritten(error)
        elif status == 0:  # whoever read has read enough
            status = _PIPE_CLOSED
    if status:
        sys.exit(status)


def _status() -> int:
    """Run a command and return its exit status; say what is wrong."""
    try:
        _need_folder()
        _settle_arguments()
        return app(prog_name="testbench", standalone_mode=False) or 0
    except SystemExit as end:  # by click, with 1, if standard output is a pipe that was closed
        from testbench.core.bring import ends_in_brought, said

        if ends_in_brought(end):
            print(f"error: a user's code must not end the program, got {brief(said(end))}", file=sys.stderr)
            return 3
        return _PIPE_CLOSED if end.code == 1 else int(end.code or 0)
    except UsageError as error:
        _say_usage(error)
        return 2
    except TestbenchError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_status
    except MemoryError as error:
        print(f"error: the memory of this machine does not suffice: {error or 'no more is given'}", file=sys.stderr)
        return 3
    except BrokenPipeError:
        return _PIPE_CLOSED
    except OSError as error:
        return _unwritten(error)
    except UnicodeEncodeError as error:
        named = f"the names of files must be ones that this system's {error.encoding} can write, got '{error.object}'"
        print(f"error: {brief(named)}; set PYTHONUTF8=1, or another locale than LC_ALL gives", file=sys.stderr)
        return 3


def _settle_arguments() -> None:
    """Put in place what a killed command left in a folder of results that this one names, before it looks there."""
    for word in sys.argv[1:]:
        if "=" in word or not word.startswith("-"):
            from testbench.core.store import settle  # takes longer to import than help alone

            settle(Path(word.partition("=")[2] or word))


def _need_folder() -> None:
    """Refuse to work where no working directory is, in which every relative path would lie."""
    try:
        os.getcwd()
    except OSError as error:
        raise RecordError("the working directory must exist, but it was removed; go to another folder") from error


def _unwritten(error: OSError) -> int:
    """Say what cannot be read or written; return the exit status."""
    what = brief(f"cannot read or write {error.filename or 'a file or standard output'}: {error.strerror or error}")
    print(f"error: {what}", file=sys.stderr)
    return 3


def _say_warning(message: Warning | str, category: type[Warning], *rest: Any, **more: Any) -> None:
    """Say what an aircraft was noted for when it was loaded; other warnings are for programmers."""
    if category.__module__.startswith("testbench."):
        print(f"note: {brief(str(message))}", file=sys.stderr)


def _elsewhere(error: Any, message: str) -> str:
    """Return where a command that is unknown here is one, such as `testbench aircraft adopt` for `testbench adopt`."""
    found = _UNKNOWN.match(message)
    if found is None or error.ctx is None:
        return ""
    commands, word = error.ctx.find_root().command.commands, found[1]
    paths = [f"testbench {word}"] if word in commands else []
    paths += [f"testbench {name} {word}" for name, c in commands.items() if word in getattr(c, "commands", ())]
    return f"; did you mean {' or '.join(f'`{path}`' for path in paths)}?" if paths else ""


def _say_usage(error: Any) -> None:
    """Say in one line what is wrong with a command."""
    if type(error).__name__ == "NoArgsIsHelpError":  # nothing but a group's name: its help has been printed
        return
    command = error.ctx.command_path if error.ctx is not None else "testbench"
    message = " ".join(error.format_message().split()).replace("Value error, ", "").rstrip(".")
    option = _UNKNOWN.match(message)
    if option is not None and any(f"--{option[1]}" in p.opts for p in error.ctx.command.get_params(error.ctx)):
        message = f"{option[0]}; did you mean `{command} --{option[1]}`?"
    else:
        message += _elsewhere(error, message)
    print(f"error: {brief(message)}; see `{command} --help`", file=sys.stderr)
