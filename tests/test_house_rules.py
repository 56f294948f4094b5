"""The rules of the house, read off the code itself: who imports whom, what is documented, what tests assert."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from functools import cache
from pathlib import Path

import pytest
from filelock import FileLock

from testbench.core.files import kept_in

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "testbench"
SOURCES = sorted(PACKAGE.rglob("*.py"))
TESTS = sorted((ROOT / "tests").rglob("test_*.py"))

# Rooms by rank: a module imports only from lower ranks, and never from another room of its own rank.
RANKS = (
    {"core"},
    {"aircraft", "inputs", "sensors", "estimators", "logs"},
    {"flight"},
    {"effects"},
    {"inference"},
    {"evaluation"},
    {"information"},
    {"line"},
    {"design", "pooling"},
    {"page"},
    {"questions"},
    {"envs"},
    {"cli"},
    {"__main__"},
)
RANK = {room: rank for rank, rooms in enumerate(RANKS) for room in rooms}
# A question imports another only if it asks it.
ASKS = {
    "identify": {"run", "importing", "aircraft"},  # of a log what import writes; it amends what adopt writes
    "global_model": {"identify", "importing"},  # it reads what identify and import read, and amends as identify does
    "response": {"identify", "run"},
    "compatibility": {"identify"},
    "modes": {"identify"},
    "importing": {"identify"},
    "compare": {"run", "design", "identify"},  # a benchmark reads descriptions of recorded flights
    "campaign": {"run"},
    "design": {"run", "identify"},  # what was flown before, and the aircraft that has it
    "plan": {"design", "identify", "importing", "run"},
    "gap": {"compatibility", "identify", "run"},
    "live": {"identify", "importing", "plan"},  # servos as identify has them, logs as import reads them, a plan's cards
    "sitl": {"importing"},  # throws as import reads them
    "studio": {"design", "plan"},
    "reproduce": {"run", "plan"},
    "exercise": set(),
    "results": set(),
    "app": {"results", "campaign", "dataset", "design", "plan", "exercise"},  # shown while at work
    "dataset": {"campaign", "gap"},
    "project": set(),
}
ONLY_IN = {"jsbsim": "flight", "gymnasium": "envs", "matplotlib": "page"}


def room(path: Path) -> str:
    relative = path.relative_to(PACKAGE)
    return relative.parts[0].removesuffix(".py")


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(tree_of(path)))


def called_by(call: ast.Call) -> str:
    """The name that is called, dotted as far as it is one: what ``ast.unparse`` says, in a tenth of the time."""
    words, node = [], call.func
    while isinstance(node, ast.Attribute):
        words.append(node.attr)
        node = node.value
    return ".".join([node.id if isinstance(node, ast.Name) else "", *reversed(words)])


@cache
def imports(path: Path) -> list[tuple[str, int]]:
    """Modules that a file imports at run time; those under TYPE_CHECKING are for the type checker alone."""
    hidden = {
        id(node)
        for block in nodes_of(path)
        if isinstance(block, ast.If) and isinstance(block.test, ast.Name) and block.test.id == "TYPE_CHECKING"
        for node in ast.walk(block)
    }
    found = []
    for node in nodes_of(path):
        if id(node) in hidden:
            continue
        if isinstance(node, ast.Import):
            found += [(alias.name, node.lineno) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            found.append((node.module or "", node.lineno))
    return found


# Each rule is one test over all files, which lists what breaks it: a test for each file cost half a minute.


def misplaced_imports(path: Path) -> Iterator[str]:
    here = room(path)
    if here == "__init__":
        return  # the facade names everything, lazily
    for module, line in imports(path):
        place, top = f"{path.relative_to(ROOT)}:{line}", module.split(".")[0]
        if ONLY_IN.get(top, here) != here:
            yield f"{place}: {top} belongs in {ONLY_IN.get(top)}/"
        if top in ("dask", "distributed") and path.parent != PACKAGE / "questions" / "campaign":
            yield f"{place}: {top} belongs in campaign/"
        if path.name != {"numba": "compiled.py", "llvmlite": "machine.py"}.get(top, path.name):
            yield f"{place}: only compiled.py of envs/ and machine.py of flight/batch/ compile"
        if top != "testbench":
            continue
        there = [*module.split("."), "__init__"][1]
        if there not in (here, "__init__") and RANK[there] >= RANK[here]:
            yield f"{place}: {here} may not import {there}"


def test_imports_point_to_the_left():
    assert [fault for path in SOURCES for fault in misplaced_imports(path)] == []


def questions_not_asked(path: Path) -> Iterator[str]:
    parts = path.relative_to(PACKAGE / "questions").parts
    for module, line in imports(path) if len(parts) > 1 else ():
        words = module.split(".")
        other = words[:2] == ["testbench", "questions"] and len(words) > 3 and words[2] != parts[0]
        if other and words[2] not in ASKS.get(parts[0], ()):
            yield f"{path.relative_to(ROOT)}:{line}: {parts[0]} does not ask {words[2]}"


def test_a_question_imports_another_only_if_it_asks_it():
    rooms = [path for path in SOURCES if room(path) == "questions"]
    assert len(rooms) > 100
    assert [fault for path in rooms for fault in questions_not_asked(path)] == []


def test_the_hidden_truth_and_the_library_of_effects_share_no_code():
    """What the blind test hides is made by code of its own; what names an effect does not see how it was made."""
    gap, blind = PACKAGE / "questions" / "gap", ROOT / "tests" / "studies" / "blind"
    # What makes and draws the cases imports, of all this, its own modules and what flies a hidden truth.
    making = {"servos", "truth", "truths", "kinds", "flights", "cases"}
    own = {"studies.blind", *(f"studies.blind.{name}" for name in making)}
    flies = {"testbench.questions", "testbench.questions.hidden", "testbench.questions.gap.starts"}
    for name in making:
        found = {m for m, _ in imports(blind / f"{name}.py") if m.startswith(("testbench.", "studies."))}
        beyond = {m for m in found if m.startswith(("testbench.effects", "testbench.questions", "studies."))}
        assert beyond <= own | flies, name
    # In the package, a case makes its records; nothing else of the workflow knows what is hidden, or any test.
    for path in SOURCES:
        assert not {m for m, _ in imports(path) if m.split(".")[0] in ("tests", "studies")}, path.name
        if path.is_relative_to(gap) and path.name not in ("ask.py", "scenario.py"):
            assert "testbench.questions.hidden" not in {m for m, _ in imports(path)}, path.name
    naming = {m for m, _ in imports(blind / "run.py") if m.startswith("studies.") or m == "testbench.questions.hidden"}
    assert naming == {"studies.blind.flights"}, "what names a case sees conditions and sensors only"


def public(node: ast.AST) -> Iterator[ast.FunctionDef | ast.ClassDef]:
    """Functions and classes below a node, but for those within functions and within private classes."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, (ast.FunctionDef, ast.ClassDef)):
            shown = not child.name.startswith("_")
            if shown:
                yield child
            if shown and isinstance(child, ast.ClassDef):
                yield from public(child)
        elif isinstance(child, (ast.stmt, ast.ExceptHandler)):
            yield from public(child)


def undocumented(path: Path) -> Iterator[str]:
    tree = tree_of(path)
    if not ast.get_docstring(tree):
        yield f"{path.relative_to(ROOT)}: a module says what it holds"
    for node in public(tree):
        if not ast.get_docstring(node):
            yield f"{path.relative_to(ROOT)}:{node.lineno}: {node.name} has no docstring"


def test_everything_public_is_documented():
    assert [fault for path in SOURCES for fault in undocumented(path)] == []


MOST_PARAMETERS = 7
# Keywords of gym.make, which Gymnasium keeps as JSON; and the state of a followed flight.
MORE = {"envs/excitation.py: __init__", "questions/live/track.py: __init__"}


def without_an_object(path: Path) -> Iterator[str]:
    """Functions with more parameters than MOST_PARAMETERS, self apart; a command's are its options on the line."""
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.FunctionDef) and path.name != "command.py":
            names = [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
            if len(names) - (names[:1] in (["self"], ["cls"])) > MOST_PARAMETERS:
                yield f"{path.relative_to(PACKAGE).as_posix()}: {node.name}"


def test_a_function_with_many_parameters_takes_an_object():
    assert {fault for path in SOURCES for fault in without_an_object(path)} == MORE


def unable_to_fail(path: Path) -> Iterator[str]:
    tree, place = tree_of(path), path.relative_to(ROOT)
    helpers = {
        f.name
        for f in ast.walk(tree)
        if isinstance(f, ast.FunctionDef) and any(isinstance(n, ast.Assert) for n in ast.walk(f))
    }
    for node in ast.walk(tree):
        if not (isinstance(node, ast.FunctionDef) and node.name.startswith("test")):
            continue
        names = {
            n.attr if isinstance(n, ast.Attribute) else n.id
            for n in ast.walk(node)
            if isinstance(n, (ast.Attribute, ast.Name))
        }
        asserts = any(isinstance(n, ast.Assert) for n in ast.walk(node)) or names & (
            helpers | {"raises", "warns", "assert_allclose", "assert_array_equal"}
        )
        if not asserts:
            yield f"{place}:{node.lineno}: {node.name} cannot fail"
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr):
            call = called_by(node.value).split(".")[-1] if isinstance(node.value, ast.Call) else ""
            if isinstance(node.value, ast.Compare):
                yield f"{place}:{node.lineno}: a comparison without assert"
            if call in {"allclose", "isclose", "array_equal"}:
                yield f"{place}:{node.lineno}: {call} without assert"


def test_every_test_asserts():
    assert [fault for path in TESTS for fault in unable_to_fail(path)] == []


def test_nothing_is_left_unfinished():
    marks = ("TODO", "FIXME", "XXX", "NotImplementedError")
    texts = {path: path.read_text(encoding="utf-8") for path in SOURCES}
    assert [f"{path.relative_to(ROOT)}: {mark}" for path, text in texts.items() for mark in marks if mark in text] == []


# Text that lands in a file of another language: these modules keep a user's words from becoming code there.
LAYER = ("core.escape", "core.toml_text", "page.tables", "page.html", "page.page", "page.latex", "page.publish")
_CODE = re.compile(r".+\.(py|lua|xml|html|csv|tex|sh|mk|md|toml)$", re.DOTALL)
_LINE = re.compile(r"\s*(#+ |-- |\| |<!--|<\?xml|<!DOCTYPE|<html|#!)")
_NUMBER = re.compile(r"[^s]*[defgx%]")
NO_USERS_WORDS = {
    "aircraft/geometry/build.py": "names the files whose texts describe.py and model_xml.py make",
    "questions/exercise/catalogue": "texts of the package's own, with numbers",
    "questions/importing/page.py": "looks for a remark in a description",
}
"""Modules that write such files without LAYER, and why nothing of a user's is in them."""


def _pattern(node: ast.AST) -> str:
    """A text as the code has it, with x for each value put in; what is no text is ""."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else ""
    if isinstance(node, ast.JoinedStr):
        return "".join(_pattern(part) if isinstance(part, ast.Constant) else "x" for part in node.values)
    return ""


def _free_values(node: ast.AST) -> bool:
    """Whether a text takes in a value that is neither written as a number nor as a literal of Python."""
    values = [part for part in getattr(node, "values", ()) if isinstance(part, ast.FormattedValue)]
    numbers = [v for v in values if v.format_spec and _NUMBER.fullmatch(_pattern(v.format_spec))]
    return len(values) > len(numbers) + sum(v.conversion == ord("r") for v in values)


def writers(path: Path) -> Iterator[int]:
    """Lines where a module names a file of another language to write, or makes a line of its text with values in it."""
    for node in nodes_of(path):
        named: list[ast.AST | None] = []
        if isinstance(node, ast.Call):
            function = called_by(node).split(".")[-1]
            where = {"write_file": node.args[:1], "write_text": [node.func], "open": [*node.args[:1], node.func]}
            writes = function != "open" or any(_pattern(a)[:1] in ("w", "a", "x") for a in node.args)
            named = [n for given in where.get(function, ()) if writes for n in ast.walk(given)]
        elif isinstance(node, ast.Dict):
            named = [*node.keys]
        elif isinstance(node, (ast.DictComp, ast.Subscript)):
            named = [node.key if isinstance(node, ast.DictComp) else node.slice]
        line = isinstance(node, ast.JoinedStr) and _LINE.match(_pattern(node)) and _free_values(node)
        if line or any(n is not None and _CODE.fullmatch(_pattern(n)) for n in named):
            yield node.lineno


def unescaped(path: Path) -> list[str]:
    place = path.relative_to(PACKAGE).as_posix()
    safe = any(module.removeprefix("testbench.").startswith(LAYER) for module, _ in imports(path))
    if safe or place.startswith(tuple(NO_USERS_WORDS)):
        return []
    return [f"{place}:{line}: text for another language goes through core/escape" for line in sorted(writers(path))]


def test_whoever_writes_another_language_escapes():
    assert [fault for path in SOURCES for fault in unescaped(path)] == []
    for place in NO_USERS_WORDS:  # an exception that is none any more goes
        found = [path for path in SOURCES if path.relative_to(PACKAGE).as_posix().startswith(place)]
        assert any(line for path in found for line in writers(path)), place


_TURNED = re.compile(r"(?i)\b(?:black|white|dark)\b(?! noise|-box| box)")


def turned_colours(path: Path) -> list[str]:
    """Sentences of a module of figures that name a colour which a page in dark turns round."""
    if not re.search(r"\bPlate\b|\bplate\(", path.read_text(encoding="utf-8")):
        return []
    notes = {id(node.value) for node in nodes_of(path) if isinstance(node, ast.Expr)}  # docstrings
    return [
        f"{path.name}: {node.value}"
        for node in nodes_of(path)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in notes
        if len(node.value.split()) > 2 and _TURNED.search(node.value)
    ]


def test_captions_name_no_colour_that_dark_pages_turn_round():
    """A black line is a light one on a dark page; say what it is like instead: full, upright, without colour."""
    assert [text for path in SOURCES for text in turned_colours(path)] == []


# What a module of a question or environment may write but into the ``new`` of a ResultFolder, and why that is safe.
WRITERS = {
    "handed the path of write_beside": {"questions/export/ask.py"},
    "a file of the user's own, as they asked for": {
        "questions/exercise/answers.py", "questions/plan/verdicts.py",
        "questions/app/ask.py",
    },
    "handed the folder that a page or a result is made in": {
        "questions/plan/page.py", "questions/plan/flown_card.py", "questions/reproduce/page.py",
        "questions/campaign/tidy.py", "questions/exercise/ask.py", "questions/exercise/roster.py",
        "questions/aircraft/flexible/ask.py", "questions/dataset/store.py",
    },
    "a live file of a ResultFolder": {
        "questions/campaign/ask.py", "questions/campaign/store.py", "questions/compare/benchmark/ask.py",
        "questions/gap/again.py", "questions/gap/command.py", "questions/live/command.py",
    },
    "a folder for temporary files": {"questions/exercise/catalogue/wrong_sign.py", "questions/export/aircraft.py"},
}  # fmt: skip
_WRITES = frozenset({
    "mkdir", "makedirs", "write_text", "write_bytes", "write_file", "touch", "copytree", "copyfile", "unlink", "rmdir",
    "rmtree",
})  # fmt: skip


def writing(path: Path) -> Iterator[int]:
    """Yield the lines at which a module writes or deletes files, but for those within the ``new`` of a result."""
    for node in nodes_of(path):
        if not isinstance(node, ast.Call):
            continue
        name = called_by(node).split(".")[-1]
        if name not in _WRITES | {"open"}:
            continue
        first = ast.unparse(node.args[0]) if node.args else ""
        modes = [a.value for a in node.args[:2] if isinstance(a, ast.Constant) and isinstance(a.value, str)]
        opens = name == "open" and any(set(mode) <= set("rwaxbt+") and set(mode) & set("wax+") for mode in modes)
        if (opens or name in _WRITES) and not re.match(r"(\w+\.)?new /", first):
            yield node.lineno


TOLD = {  # who says every error, passes it on, or raises it again
    *(
        "core/errors.py",
        "core/files.py",
        "core/bring.py",
        "core/store.py",
        "cli.py",
        "envs/baselines.py",
        "envs/train.py",
    ),
    *("questions/campaign/store.py", "questions/campaign/flying.py", "questions/identify/command.py"),
    "questions/app/ask.py",
    "estimators/cells.py",
}


def taking_every_error(path: Path) -> Iterator[int]:
    """Lines where any error of the testbench is taken, a full disk too, as what cannot fly or be estimated is."""
    for node in ast.walk(tree_of(path)):
        taken: list[ast.AST] = []
        if isinstance(node, ast.ExceptHandler) and node.type is not None:
            taken = [node.type]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
            name = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
            taken = [*node.args] if name == "suppress" else []
        names = {n.id for each in taken for n in ast.walk(each) if isinstance(n, ast.Name)}
        if names & {"TestbenchError", "WriteError", "DiskError"}:
            yield getattr(node, "lineno", 0)


def test_a_full_disk_is_no_fault_of_what_flies_or_is_estimated():
    studies = [*(ROOT / "tests" / "studies").rglob("*.py"), *(ROOT / "tests" / "benchmarks").rglob("*.py")]
    asked = [p for p in SOURCES if p.relative_to(PACKAGE).as_posix() not in TOLD]
    found = [f"{path.relative_to(ROOT)}:{n}" for path in [*asked, *studies] for n in taking_every_error(path)]
    assert found == [], "what becomes a row is caught as a Refusal"


def test_questions_write_through_one_store_or_one_file_that_is_named():
    allowed = {name for names in WRITERS.values() for name in names}
    found = {
        path.relative_to(PACKAGE).as_posix(): lines
        for path in SOURCES
        if room(path) in ("questions", "envs") and (lines := list(writing(path)))
    }
    assert {name: lines for name, lines in found.items() if name not in allowed} == {}
    assert allowed - found.keys() == set()


def test_the_rules_find_what_breaks_them(tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], "ROOT", tmp_path)
    monkeypatch.setattr(sys.modules[__name__], "PACKAGE", tmp_path)
    path = tmp_path / "sensors" / "gyro.py"
    path.parent.mkdir()
    path.write_text(
        "import jsbsim, numba, dask, matplotlib\nfrom testbench.line import x\n"
        "def seen(): pass\ndef test_nothing():\n    1 == 2\n    isclose(1, 2)\n",
        encoding="utf-8",
    )
    assert len(list(misplaced_imports(path))) == 5
    assert [fault.split(": ", 1)[1] for fault in undocumented(path)] == [
        "a module says what it holds", "seen has no docstring", "test_nothing has no docstring"]  # fmt: skip
    assert [fault.split(":")[1] for fault in unable_to_fail(path)] == ["4", "5", "6"]
    path = path.with_name("many.py")
    path.write_text(
        "def f(self, a, b, c, d, *, e, g, h): pass\ndef k(a, b, c, d, e, g, h, i): pass\n", encoding="utf-8"
    )
    assert list(without_an_object(path)) == ["sensors/many.py: k"]
    path = path.with_name("writer.py")
    lines = (
        'write_file(folder / f"{name}.lua", x)', 'files = {"a/b.py": x}', 'files[f"{n}.toml"] = x',
        '(folder / "x.sh").write_text(x)', 'y = f"# {name}"', 'y = f"<!-- {name} -->"', 'y = f"# {n:.3g}, {name!r}"',
        'y = {".csv": 1}',
    )  # fmt: skip
    path.write_text("\n".join(lines), encoding="utf-8")
    assert [int(fault.split(":")[1]) for fault in unescaped(path)] == [1, 2, 3, 4, 5, 6]
    other = tmp_path / "ask.py"
    lines = ("out.mkdir()", "open(f, 'w')", "write_file(place.new / 'a', '')", "shutil.rmtree(out)")
    other.write_text("\n".join(lines), encoding="utf-8")
    assert list(writing(other)) == [1, 2, 4]


def test_names_in_the_schema_are_those_of_the_families():
    from typing import get_args

    from testbench.core.scenario.inputs import Input
    from testbench.estimators import METHODS
    from testbench.inputs import FAMILIES

    def tags(union: object, key: str) -> set[str]:
        classes = get_args(get_args(union)[0])
        return {tag for c in classes for tag in get_args(c.model_fields[key].annotation)}

    assert tags(Input, "signal") == set(FAMILIES)
    for name, row in METHODS.items():
        assert name in get_args(row.settings.model_fields["method"].annotation)


# mypy looks for garbage every 200 000 objects, which is a quarter of its time: here every three million, and 0.9 GB.
MYPY = """
import gc
tune = gc.set_threshold
gc.set_threshold = lambda _, *later: tune(3_000_000, *later)
from mypy.__main__ import console_entry
console_entry()
"""


@pytest.mark.parametrize(
    "command",
    [
        pytest.param(["-m", "ruff", "check", "."], id="ruff check ."),
        pytest.param(["-m", "ruff", "format", "--check", "."], id="ruff format --check ."),
        pytest.param(["-c", MYPY], id="mypy"),
    ],
)
def test_lint_format_and_types(command):
    """mypy keeps what it knows of each file, by its content, for all checkouts of a user; one at a time writes it."""
    kept = kept_in("mypy")
    with suppress(OSError):  # a home that is read-only keeps nothing
        if kept is not None:
            kept.mkdir(parents=True, exist_ok=True)
    around = None if kept is None or not kept.is_dir() else {"MYPY_CACHE_DIR": str(kept), **os.environ}
    with FileLock(f"{kept}.lock") if MYPY in command and around else nullcontext():
        done = subprocess.run(
            [sys.executable, *command], cwd=ROOT, env=around, capture_output=True, text=True, check=False
        )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]


def test_no_two_test_modules_share_a_name():
    """pytest imports them as top-level modules: of two with one name the second is not collected, or is the first."""
    folders = {path.parent.name for path in (ROOT / "tests").rglob("__init__.py")}
    names = sorted(
        path.stem
        for path in (ROOT / "tests").rglob("*.py")
        if path.name not in ("__init__.py", "conftest.py") and not (path.parent / "__init__.py").exists()
    )
    assert [name for name in names if names.count(name) > 1 or name in folders] == []


# Who reads a file of a user's without the door, and why: what is named here opens files of the package itself or of the
# system, or writes.
READS_ITSELF = {
    "core/door.py": "it is the door",
    "core/store.py": "hashes of what it lists, and the system's table of locks",
    "core/files.py": "sources of the package",
    "core/lazily.py": "the stub of the package",
    "page/html.py": "templates",
    "page/terminal.py": "the null device in the place of a stream that is closed",
    "flight/batch/machine.py": "code that it has made",
    "questions/studio/page/__init__.py": "parts of its page",
    "questions/export/aircraft.py": "the functions of FMI, and the library that it has just compiled",
    "questions/plan/injection/scripts.py": "the body of the script",
    "questions/exercise/ask.py": "texts of the catalogue",
    "questions/reproduce/page.py": "a picture in memory",
    "estimators/cells.py": "the null device",
    "questions/campaign/flying.py": "a record that it has just written",
    "core/errors.py": "what pip says of this installation",
    "questions/campaign/workers.py": "a scheduler, no file",
}
_READERS = re.compile(
    r"(\.read_text|\.read_bytes|\bgenfromtxt|\bnp\.load|\bjson\.load|\btomllib\.load|\bparse|\bloadmat|\bopen)$"
)
_BY_LIBRARY = re.compile(
    r"(read_csv|loadtxt|ZipFile|read_parquet|fromfile|memmap|sqlite3\.connect|open_dataset|ParquetFile|h5py\.File)$"
)


def reads_itself(path: Path) -> Iterator[str]:
    """Calls that open a file to read it; a module whose library opens one asks the door first."""
    if path.relative_to(PACKAGE).as_posix() in READS_ITSELF:
        return
    asks = any(module == "testbench.core.door" for module, _ in imports(path))
    for node in nodes_of(path):
        name = called_by(node) if isinstance(node, ast.Call) else ""
        if not (_READERS.search(name) or (_BY_LIBRARY.search(name) and not asks)):
            continue
        modes = [str(a.value) for a in node.args if isinstance(a, ast.Constant)]
        if name.endswith("open") and (
            name in ("os.open", "Store.open") or any(m[:1] in ("w", "a") or "+" in m for m in modes)
        ):
            continue  # to write
        if name.endswith("parse") and not name.startswith(("ET.", "ElementTree.", "etree.")):
            continue
        yield f"{path.relative_to(ROOT)}:{node.lineno}: {name} reads a file without testbench.core.door"


def test_every_file_of_a_user_comes_in_by_the_door():
    assert [fault for path in SOURCES for fault in reads_itself(path)] == []
    assert all((PACKAGE / name).is_file() for name in READS_ITSELF)
