"""What users bring: a function or a table in a Python file of their own, named ``FILE.py:NAME`` in a scenario.

Three steps, so that a scenario can be checked without running anybody's code: :func:`find` says which file is meant,
:func:`declared` reads what it defines without running it, :func:`load` runs it.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import os
import signal
import sys
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from testbench.core.door import read_text, sha256
from testbench.core.errors import EstimationError, RecordError, ScenarioError, TestbenchError, nearest
from testbench.core.interrupts import TimeUp, handled
from testbench.core.plugins import is_plugin
from testbench.core.plugins import place as plugin

MARK = ".py:"
"""The sign in the name of a user's file that packaged names do not have."""


_EXIT, _MODULE = os._exit, "brought_"


class _Unclosed:
    """A standard stream as a user's code has it: to close it does nothing, so that the command can go on to speak."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def close(self) -> None:
        """Leave it open."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


class BroughtCodeError(EstimationError):
    """An error of a user's code that is not one of the testbench, or its try to end the program: file and line."""


@contextmanager
def running(path: Path | None, law: str) -> Iterator[None]:
    """Run a user's code inside the block: whatever it raises, and an end of the program, is one line.

    An interrupt (Ctrl-C, or a signal of the system that ends the command) acts, also where the code takes it for an
    error; one that the code raises itself is an error of the code. ``os._exit`` is an error in this process; in those
    that the code starts it ends them. Standard streams that it closes or replaces are afterwards as they were.

    Args:
        path: the user's file, whose line is said; None if it is not known.
        law: what must hold, to begin the message.

    Raises:
        BroughtCodeError: law, kind, text and line of what was raised.
        TestbenchError, TimeUp: as they were raised.
        KeyboardInterrupt: by the user or the system.
    """
    came: list[BaseException] = []
    before, here = handled(), os.getpid()

    def interrupt(number: int, frame: Any) -> None:
        try:
            before[number](number, frame)
        except BaseException as error:
            came.append(error)
            raise

    def leave(status: int) -> NoReturn:
        if os.getpid() != here:
            _EXIT(status)
        raise SystemExit(f"os._exit({status})")

    for number in before:
        signal.signal(number, interrupt)
    os._exit = leave
    streams = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (s if isinstance(s, _Unclosed) else _Unclosed(s) for s in streams)
    try:
        yield
    except (TestbenchError, TimeUp):
        raise
    except BaseException as error:
        if not came:
            raise BroughtCodeError(f"{law}, got {said(error, path)}") from error
    finally:
        os._exit = _EXIT
        sys.stdout, sys.stderr = streams
        for number, handler in before.items():
            signal.signal(number, handler)
        if came:
            raise came[0]


def ends_in_brought(error: BaseException) -> bool:
    """Return whether an error was raised in, or through, a user's file."""
    return any(f.f_globals.get("__name__", "").startswith(_MODULE) for f, _ in traceback.walk_tb(error.__traceback__))


def is_brought(name: object) -> bool:
    """Say whether a name means something in a Python file: ``FILE.py:NAME``, or ``PACKAGE:NAME`` if it is installed."""
    return isinstance(name, str) and (MARK in name or is_plugin(name))


def short(name: str) -> str:
    """Return ``FILE.py:NAME`` or ``FILE.toml`` without its folders; other names as they are."""
    return name.rpartition("/")[2] if is_brought(name) or name.endswith(".toml") else name


def places(beside: Path | str | None, folder: str) -> tuple[Path, ...]:
    """Return the folders in which a name is looked for, in this order.

    The folder of the scenario, the folder of that name in it (``estimators/``, ``effects/``, ...), the working
    directory, and the folder of that name in it.

    Args:
        beside: the scenario's file; None if there is none.
        folder: name of the project folder for such things.
    """
    homes = [] if beside is None else [Path(beside).absolute().parent]
    homes.append(Path.cwd())
    found = [place for home in homes for place in (home, home / folder)]
    return tuple(dict.fromkeys(found))


def find_file(name: str | Path, beside: Path | str | None, folder: str) -> Path | None:
    """Return the absolute path of a file (or folder) in the first of :func:`places` that has it; None if none has."""
    return next((path.resolve() for path in (place / name for place in places(beside, folder)) if path.exists()), None)


def find(name: str, beside: Path | str | None, folder: str) -> tuple[Path, str]:
    """Return the file and the attribute that ``FILE.py:NAME`` or ``PACKAGE:NAME`` means.

    Args:
        name: as in the scenario; the file's part may be absolute.
        beside: the scenario's file; None if there is none.
        folder: name of the project folder for such things: "estimators", "effects", ...

    Raises:
        ScenarioError: the name has another form, or no such file lies in any of :func:`places`.
    """
    if is_plugin(name):
        return plugin(name, folder)
    given, _, attribute = name.rpartition(":")
    if not given.endswith(".py") or not attribute.isidentifier():
        raise ScenarioError(f"what is brought must be named as FILE.py:NAME, got '{name}'")
    path = find_file(given, beside, folder)
    if path is None or not path.is_file():
        there = places(beside, folder)
        others = {file.name for place in there for file in place.glob("*.py")}
        looked = ", ".join(dict.fromkeys(str(place) for place in there if place.is_dir()))
        hint = nearest(given, others) if others else ""
        raise ScenarioError(f"the file of '{name}' must exist, got no '{given}' in {looked}{hint}")
    return path, attribute


@dataclass(frozen=True, eq=False)
class Declared:
    """What a Python file defines at its top level, as read from its text."""

    path: Path  # of the file
    names: frozenset[str]  # all that it defines, assigns or imports
    functions: Mapping[str, ast.FunctionDef]  # name -> definition
    classes: Mapping[str, ast.ClassDef]  # name -> definition
    values: Mapping[str, ast.expr]  # name -> what is assigned to it
    whole: bool  # False if the names may be more than those, as after ``from x import *``

    def need(self, attribute: str) -> None:
        """Check that the file defines a name.

        Raises:
            ScenarioError: it does not.
        """
        if self.whole and attribute not in self.names:
            public = [name for name in (*self.functions, *self.classes, *self.values) if not name.startswith("_")]
            raise ScenarioError(f"{self.path.name} must define '{attribute}'{nearest(attribute, public)}")


def declared(path: Path) -> Declared:
    """Read what a Python file defines, without running it.

    Raises:
        ScenarioError: it cannot be read, or is not Python; with the line.
    """
    try:
        tree = ast.parse(read_text(path, "python"), filename=str(path))
    except RecordError as error:
        raise ScenarioError(error.message) from error
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        line = f", line {error.lineno}" if isinstance(error, SyntaxError) and error.lineno else ""
        reason = error.msg if isinstance(error, SyntaxError) else str(error)
        raise ScenarioError(f"{path}{line}: must be Python, got: {reason}") from error
    functions, classes, values = {}, {}, {}
    names: set[str] = set()
    whole = True
    for node in _at_top(tree.body):
        if isinstance(node, ast.FunctionDef):
            functions[node.name] = node
        elif isinstance(node, ast.ClassDef):
            classes[node.name] = node
        elif isinstance(node, (ast.Import, ast.ImportFrom)):
            given = [alias.asname or alias.name.split(".")[0] for alias in node.names]
            whole = whole and "*" not in given
            names.update(given)
        elif isinstance(node, (ast.Assign, ast.AnnAssign)) and node.value is not None:
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                found = [n.id for n in ast.walk(target) if isinstance(n, ast.Name)]
                names.update(found)
                if isinstance(target, ast.Name):
                    values[target.id] = node.value
        elif isinstance(node, (ast.For, ast.While, ast.Match, ast.AsyncFunctionDef)):
            whole = False  # it may define what is not looked at here
    names.update(functions, classes)
    return Declared(path, frozenset(names), functions, classes, values, whole)


def _at_top(body: list[ast.stmt]) -> list[ast.stmt]:
    """Return the statements that run when the file is imported; both branches of an ``if``, all parts of a ``try``."""
    out: list[ast.stmt] = []
    for node in body:
        if isinstance(node, ast.If):
            out += _at_top([*node.body, *node.orelse])
        elif isinstance(node, ast.Try):
            out += _at_top([*node.body, *(s for h in node.handlers for s in h.body), *node.orelse, *node.finalbody])
        elif isinstance(node, ast.With):
            out += _at_top(node.body)
        else:
            out.append(node)
    return out


def whose(path: Path, attribute: str) -> dict[str, str]:
    """Return what a result says of a user's code: file, name and SHA-256, as JSON values."""
    return {"file": str(path), "name": attribute, "sha256": sha256(path, "python")}


def load(path: Path, attribute: str) -> Any:
    """Run a Python file, once per process while it is unchanged, and return one of its names.

    It may import its neighbours: its folder is searched last while it runs.

    Raises:
        ScenarioError: it cannot be run, with the line; or it lacks the name.
    """
    path = path.resolve()
    told = hashlib.sha256(f"{path}\0{sha256(path, 'python')}".encode()).hexdigest()[:12]
    name = f"{_MODULE}{path.stem}_{told}"
    module = sys.modules.get(name)
    if module is None:
        declared(path)  # says what is wrong with its syntax, with the line
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module  # before it runs: dataclasses and pickle look it up
        sys.path.append(str(path.parent))
        try:
            with running(path, f"{path.name} must run without an error"):
                spec.loader.exec_module(module)
        except BaseException as error:
            del sys.modules[name]
            if isinstance(error, BroughtCodeError):
                raise ScenarioError(error.message) from error.__cause__
            raise
        finally:
            sys.path.remove(str(path.parent))
    if not hasattr(module, attribute):
        own = declared(path)
        public = [n for n in (*own.functions, *own.classes, *own.values) if not n.startswith("_")]
        raise ScenarioError(f"{path.name} must define '{attribute}'{nearest(attribute, public)}")
    return getattr(module, attribute)


def said(error: BaseException, path: Path | None = None) -> str:
    """Return kind and text of an error raised in a user's file, and its last line there: one line, no traceback.

    Without a file it is the last line of any.
    """
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if path is None or Path(frame.filename) == path]
    path = Path(own[-1].filename) if own else path
    text = " ".join(str(error).split())
    line = f", line {own[-1].lineno}" if own else ""
    place = "" if path is None else f" ({path.name}{line})"
    return type(error).__name__ + (f": {text}" if text else "") + place
