"""Files of all questions: which file a name means, of which kind a file is, and whether it is right."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Collection
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

from testbench.core.door import read_toml
from testbench.core.errors import RecordError, ScenarioError
from testbench.core.files import must_be_new, write_file, write_new
from testbench.core.paths import (
    AIRCRAFT,
    AIRCRAFT_MODELS,
    SCENARIOS,
    SENSOR_SUITES,
    STOCK,
    aircraft_names,
    find_scenario,
    not_found,
    suite_names,
)
from testbench.core.plugins import installed
from testbench.core.scenario.base import Asked
from testbench.core.schema import Strict, parse
from testbench.core.store import ResultFolder
from testbench.questions import BY_COMMAND, QUESTIONS, Question

Rows = list[tuple[str, ...]]
WITH_FILES = tuple(q for q in QUESTIONS if q.kind)
"""The questions that are asked in a file."""
SCHEMAS = "schemas"
"""Folder of the JSON schemas beside a file to edit."""
PROMISES = "promises"
"""Folder beside ``designs`` where `testbench design` writes what it promises of each."""
Kind = TypeVar("Kind", bound=Asked)
_NEAR = 0.8  # likeness of a misspelt key, as difflib counts it


def find(path: Path, command: str, law: str = "") -> Path:
    """Return the file that ``path`` means for ``command``: a file, or a packaged one with or without its folder.

    ``law`` is what the path must be, of a command that takes other things beside such files.

    Raises:
        RecordError: there is no such file; the message has the nearest name of a file here or a packaged one.
        ScenarioError: it is a file for another command.
    """
    question = BY_COMMAND[command]
    file = path if path.is_file() else find_scenario(Path(question.folder) / path)
    if not file.is_file():
        file = find_scenario(path)
    if not file.is_file():
        packaged = [p.stem for p in (SCENARIOS / question.folder).glob("*.toml")]
        usual = f"a {question.kind} must be a file or a packaged one"
        raise RecordError(f"{law or usual}, got {not_found(path, packaged, None if law else _may_be_asked)}")
    kinds = kinds_of(file)
    if question not in kinds:
        raise ScenarioError(f"{file} is a {kinds[0].kind}: use testbench {kinds[0].command}")
    return file


def promise_beside(scenario: Path) -> Path | None:
    """Return the file of what was promised of a designed scenario ``designs/NAME.toml``; None if there is none."""
    file = scenario.parent.parent / PROMISES / f"{scenario.stem}.json"
    return file if file.is_file() else None


def _may_be_asked(path: Path) -> bool:
    return path.is_dir() or path.suffix.lower() == ".toml"


def kinds_of(file: Path) -> list[Question]:
    """Return the questions to which a file may belong, in the order of the table; mostly there is one.

    A file belongs to the question that knows most of its keys; a misspelt key that is near one of the question's counts
    half. A file with none but common keys is taken for a scenario to run. A scenario to run may also be a comparison:
    both take the same keys, unless the file gives one that only a comparison has.

    Raises:
        RecordError, ScenarioError: the file cannot be read, is not TOML, is empty or has no key of any question.
    """
    content = read_toml(file)
    if not content:
        raise ScenarioError(f"{file} must say what is asked, but it is empty; `testbench list scenarios` has examples")
    scores = {q.command: _score(q.keys, content.keys()) for q in WITH_FILES}
    best = max(scores.values())
    if not best:
        raise ScenarioError(
            f"{file} must have the keys of a question, but no question has a key like {', '.join(content)}; "
            "`testbench list scenarios` has examples"
        )
    return [q for q in WITH_FILES if scores[q.command] == best]


def _score(known: Collection[str], given: Collection[str]) -> float:
    """Return how many of the given keys a kind of file knows, one that is near a key of it as a half."""
    strange = set(given) - set(known)
    near = sum(bool(get_close_matches(key, known, 1, _NEAR)) for key in strange)
    return len(given) - len(strange) + 0.5 * near


def kind_of(file: Path) -> str:
    """Return the kind of :func:`file_classes` that knows most keys of a TOML file.

    Of several it is a question's, else one whose laws the file keeps.

    Raises:
        RecordError, ScenarioError: the file cannot be read, or is not TOML.
    """
    content, classes = read_toml(file), file_classes()
    scores = {kind: _score(known.model_fields, content) for kind, known in classes.items()}
    best = [kind for kind, score in scores.items() if score == max(scores.values())]
    asked = {q.kind for q in WITH_FILES} & {*best}
    return best[0] if asked else next((k for k in best if not parse(classes[k], content, file)[1]), best[0])


def file_classes() -> dict[str, type[Strict]]:
    """Return kind of file -> the class of its keys: of every question, and of what a user brings."""
    from testbench.aircraft.geometry.schema import BesideAvl, GeometryFile
    from testbench.aircraft.model import AircraftFile
    from testbench.aircraft.strips.ground_test import GroundTestFile
    from testbench.core.project import Project
    from testbench.estimators.equations import Equations
    from testbench.logs.catalogue import Writer
    from testbench.pooling.prior import PriorFile
    from testbench.sensors.suite import SuiteFile, any_entry

    brought: dict[str, type[Strict]] = {
        "suite": SuiteFile,
        "sensor of a suite": any_entry(),
        "aircraft": AircraftFile,
        "geometry": GeometryFile,
    }
    brought |= {"masses beside AVL": BesideAvl, "ground test": GroundTestFile, "structure": Equations}
    brought |= {"prior": PriorFile, "project": Project, "writer": Writer}
    return {q.kind: q.file_class for q in WITH_FILES} | brought


def json_schemas() -> dict[str, dict[str, Any]]:
    """Return kind of file -> JSON schema of its keys; numbers have "unit", "minimum" and "maximum".

    No key of the file itself is required: a project may state it for all files of its folder.

    Example:
        >>> json_schemas()["design scenario"]["properties"]["duration_s"]["maximum"]
        36000.0
    """
    return {
        kind: {name: part for name, part in file_class.model_json_schema().items() if name != "required"}
        for kind, file_class in file_classes().items()
    }


def _schema_name(kind: str) -> str:
    return f"{kind.replace(' ', '_')}.json"


def schema_files(kinds: Collection[str]) -> dict[str, str]:
    """Return name -> text of the files of some kinds' JSON schemas."""
    schemas = json_schemas()
    return {_schema_name(kind): json.dumps(schemas[kind], indent=1) + "\n" for kind in kinds}


def write_schemas(folder: Path, kinds: Collection[str]) -> list[Path]:
    """Write the JSON schemas of some kinds of file into a folder beside what else is there; return the files.

    Raises:
        WriteError: the folder cannot be written to, or a file is there that the testbench did not write.
    """
    with ResultFolder(folder, adds=True) as place:
        return [folder / write_file(place.new / name, text).name for name, text in schema_files(kinds).items()]


def to_edit(text: str, kind: str) -> str:
    """Return the text of a TOML file for the user to edit, whose first line names its schema to editors.

    The line ``#:schema`` is taplo's, which editors use for TOML: it completes keys and marks what breaks their ranges.
    """
    return f"#:schema {SCHEMAS}/{_schema_name(kind)}\n{text}"


def write_to_edit(path: Path, text: str, kind: str, what: str) -> Path:
    """Write a new TOML file for the user to edit, and the schema that :func:`to_edit` names beside it; return it.

    Args:
        path: the file, which must not be there.
        text: of the file.
        kind: a key of :func:`file_classes`.
        what: it is, as the error says it: "a new plan".

    Raises:
        RecordError: the file is there.
        WriteError: it cannot be written.
    """
    must_be_new(path, what)  # the file that stops another try is the last one
    write_schemas(path.parent / SCHEMAS, [kind])
    return write_new(path, to_edit(text, kind), what)


def _packaged() -> list[str]:
    return [p.relative_to(SCENARIOS).with_suffix("").as_posix() for p in SCENARIOS.rglob("*.toml")]


def _question_of(kind: type[Asked]) -> Question:
    """Return the question whose files a class reads, told by its name, so that no other room is imported."""
    classes = {c.__name__ for c in kind.__mro__}
    return next(q for q in WITH_FILES if q.schema.partition(":")[2] in classes)


def read(given: Path | str, kind: type[Kind]) -> Kind:
    """Return a file of one question, given by path or by the name of a packaged one; see :func:`find`."""
    return kind.load(find(Path(given), _question_of(kind).command))


def load(what: Any) -> Any:
    """Return what a name or path means, read and checked; nothing is flown or identified.

    Args:
        what: a scenario of any question, an aircraft, a sensor suite, a structure, a ground vibration test, a record, a
            flight log, a data set, a folder of results, an identified model, or ``FILE.py:NAME``. A name that means
            several is taken for the first of these. Anything but a name or a path is returned as it is.

    Returns:
        A scenario, :class:`~testbench.Aircraft`, :class:`~testbench.SensorSuite`, the equations of a structure, a
        ground test, :class:`~testbench.FlightRecord`, :class:`~testbench.Imported`, the data set by xarray, the table
        of results by pandas, the matrices of a model, or what the Python file holds.

    Raises:
        ScenarioError: every fault of the file.
        RecordError: nothing has that name or lies at that path; the message has the nearest name.

    Example:
        >>> import testbench as tb
        >>> tb.load("compare/eolo_alpha").seeds
        16
        >>> tb.load("taurus").geometry.b_m
        1.27
    """
    from testbench.core import bring
    from testbench.questions.brought import found_at, place_of

    if not isinstance(what, (str, Path)):
        return what
    name, path = str(what), Path(what)
    found = found_at(path)
    if found is not None:
        return found.read()
    if bring.is_brought(name):
        return bring.load(*place_of(name))
    file = find_scenario(path)
    if file.is_file() and file.suffix.lower() == ".toml":
        return _checked(path)[1]
    if path.is_dir():
        return _of_folder(path)
    if path.is_file():
        return _of_file(path)
    for family, place in (
        (AIRCRAFT, "testbench.flight.load:load_aircraft"),
        (SENSOR_SUITES, "testbench.sensors.suite:load_suite"),
    ):
        if name.startswith(STOCK) or name in (*family.packaged(), *family.stock(), *family.own(Path())):
            module, reader = place.split(":")
            return getattr(import_module(module), reader)(name)
    below = [full for full in _packaged() if Path(full).name == name]
    if len(below) == 1:  # no other question has a file of that name
        return _checked(Path(below[0]))[1]
    known = [*_packaged(), *aircraft_names(), *suite_names()]
    got = not_found(path, known).partition("; packaged: ")[0]  # they are too many to be said
    raise RecordError(f"what is loaded must have a name or a path, got {got}")


def _of_folder(path: Path) -> Any:
    """Return the data set or the table of results that a folder holds."""
    from testbench.questions.dataset.open import open_dataset
    from testbench.questions.dataset.store import STORE
    from testbench.questions.tidy import read_results

    return open_dataset(path) if (path / STORE).is_file() else read_results(path)


def _of_file(path: Path) -> Any:
    """Return the record, the model or the log that a file holds."""
    from testbench.core.record import load_record
    from testbench.questions.export.ask import load_matrices
    from testbench.questions.importing.ask import import_log

    if path.suffix == ".json":
        return load_matrices(path)
    if path.suffix == ".nc":
        with contextlib.suppress(RecordError):  # NetCDF of another program is a log
            return load_record(path)
    return import_log(path)


def ask(what: Any, *more: Any, **options: Any) -> Any:
    """Return the answer to what a scenario asks; of an aircraft, its survey.

    Args:
        what: a scenario of any question or an aircraft, as itself, by name or by path.
        more: what the function of the question takes besides, such as the folder of a campaign or a data set.
        options: those of the function: :func:`~testbench.run`, :func:`~testbench.compare`, ...

    Raises:
        TestbenchError: as the function of the question does.

    Example:
        >>> import testbench as tb
        >>> tb.ask("taurus_doublet").name
        'taurus_doublet'
    """
    from testbench.aircraft import Aircraft

    asked = load(what)
    if isinstance(asked, Aircraft):
        question = BY_COMMAND["aircraft"]
    elif isinstance(asked, Asked):
        question = _question_of(type(asked))
    else:
        raise ScenarioError(f"what is asked must be a scenario or an aircraft, got a {type(asked).__name__}")
    return question.part(question.function)(what if isinstance(what, (str, Path)) else asked, *more, **options)


def check_file(path: Path) -> str:
    """Check a file of any question; return which kind it is.

    Raises:
        ScenarioError: every fault of the file.
        RecordError: the file cannot be read.
    """
    return _checked(path)[0].kind


def check_and_notes(path: Path) -> tuple[str, list[str]]:
    """Check a file as :func:`check_file` does; return which kind it is, and what is to be known of it."""
    question, asked = _checked(path)
    return question.kind, asked.notes()


def _checked(path: Path) -> tuple[Question, Asked]:
    file = find_scenario(path)
    if not file.is_file():
        got = not_found(path, _packaged(), _may_be_asked)
        raise RecordError(f"a scenario must be a file or a packaged one, got {got}")
    question = kinds_of(file)[0]
    return question, question.file_class.load(file)


# --- what there is ----------------------------------------------------------------------------------------------------


def _plugged(kind: str) -> Rows:
    """Return the names that installed packages bring, with the version of each package and where it keeps them."""
    return [(n, f"of {e.dist.name} {e.dist.version}: {e.value}") for n, e in installed(kind).items() if e.dist]


def aircraft() -> Rows:
    """Return the packaged aircraft; the first row holds the heads, as in all tables here."""
    return [("aircraft", "what it is"), *((n, _title(n)) for n in aircraft_names()), *_plugged("aircraft")]


def _title(name: str) -> str:
    return str(read_toml(AIRCRAFT_MODELS / name / "aircraft.toml", "aircraft").get("title", ""))


def inputs() -> Rows:
    """Return the families of signals."""
    from testbench.inputs import FAMILIES

    return [("signal", "what it is"), *((n, text) for n, (_, text) in FAMILIES.items())]


def sensors() -> Rows:
    """Return the packaged sensor suites, and the kinds of instruments with the keys that only each of them has."""
    from testbench.sensors import load_suite
    from testbench.sensors.suite import kind_rows

    suites = {n: load_suite(n) for n in (*suite_names(), *installed("suites"))}
    return [
        ("suite or kind", "rate", "channels", "what it is"),
        *((n, f"{s.rate_hz:g} Hz", ", ".join(s.channels), s.title) for n, s in suites.items()),
        *((n, "kind", reads, f"{words} Keys: {keys}" if keys else words) for n, reads, keys, words in kind_rows()),
    ]


def estimators() -> Rows:
    """Return the methods of estimation, what each needs and gives."""
    from testbench.estimators import METHODS, Method

    def words(method: Method) -> str:
        needs = f"; needs: {', '.join(method.needs)}" if method.needs else ""
        return f"{method.words}{needs}; gives: {', '.join(method.gives)}"

    return [
        ("method", "what it is, what it needs, what it gives"),
        *((n, words(m)) for n, m in METHODS.items()),
        *_plugged("estimators"),
    ]


def structures() -> Rows:
    """Return the packaged model structures, and examples of equations as text."""
    from testbench.estimators.equations import read_equations
    from testbench.estimators.parametric.structures import STRUCTURES

    texts = sorted((SCENARIOS / "structures").glob("*.toml"))
    return [
        ("structure", "what it is"),
        *((name, family.description) for name, family in STRUCTURES.items()),
        *((f"structures/{path.name}", read_equations(path).title) for path in texts),
    ]


def scenarios() -> Rows:
    """Return the packaged files of all questions."""
    rows: Rows = [("scenario", "command", "title")]
    for question in WITH_FILES:
        for path in sorted((SCENARIOS / question.folder).glob("*.toml")):
            name = f"{question.folder}/{path.stem}".lstrip("/")
            rows.append((name, question.command, str(read_toml(path).get("title", ""))))
    return rows


def effects() -> Rows:
    """Return the effects that the gap workflow can name."""
    from testbench.effects import EFFECTS, OTHER_SERVOS

    beside = "weighed where an effect in its path comes near, or by name"
    further = ((n, f"({beside}) {e.physics}") for n, e in OTHER_SERVOS.items())
    return [("effect", "physics"), *((n, e.physics) for n, e in EFFECTS.items()), *further, *_plugged("effects")]


FAMILIES: dict[str, Callable[[], Rows]] = {
    f.__name__: f for f in (aircraft, inputs, sensors, estimators, structures, scenarios, effects)
}
"""What `testbench list` can list."""
