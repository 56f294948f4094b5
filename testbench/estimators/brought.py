"""Users' estimators and structures: their file is found, checked as text, and called with care."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationInfo

from testbench.core import bring
from testbench.core.errors import Refusal, ScenarioError, nearest
from testbench.core.paths import find_scenario
from testbench.estimators.equations import read_equations

FOLDER = "estimators"
"""Folder of a project in which estimators and structures are looked for."""


_STATUS = "; leave status out: it follows from advice"


def located(name: str, info: ValidationInfo) -> str:
    """Return ``FILE.py:NAME`` with the absolute path of its file, found from the scenario that is being read.

    Raises:
        ValueError: there is no such file; pydantic adds the key.
    """
    beside = (info.context or {}).get("file")
    try:
        path, attribute = bring.find(name, beside, FOLDER)
    except ScenarioError as error:
        raise ValueError("; ".join(error.faults)) from error
    return f"{path}:{attribute}"


def is_text(name: object) -> bool:
    """Say whether a structure's name means equations in a TOML file: ``FILE.toml``."""
    return isinstance(name, str) and name.endswith(".toml")


def text_file(name: str, beside: Path | str | None) -> Path:
    """Return the file that ``FILE.toml`` means: one's own, else a packaged one such as ``structures/engine.toml``.

    Args:
        name: as in the scenario.
        beside: the scenario's file; None if there is none.

    Raises:
        ScenarioError: there is no such file.
    """
    found = bring.find_file(name, beside, FOLDER)
    if found is None:
        packaged = find_scenario(name).resolve()
        found = packaged if packaged.is_file() else None
    if found is None or not found.is_file():
        there = bring.places(beside, FOLDER)
        others = {file.name for place in there for file in place.glob("*.toml")}
        looked = ", ".join(str(place) for place in there if place.is_dir())
        raise ScenarioError(f"the file of a structure must exist, got no '{name}' in {looked}{nearest(name, others)}")
    return found


def whole(name: str, beside: Path | str | None) -> str:
    """Return a name of what is brought with the absolute path of its file; packaged names as they are.

    Raises:
        ScenarioError: there is no such file.
    """
    if is_text(name):
        return str(text_file(name, beside))
    return ":".join(map(str, bring.find(name, beside, FOLDER))) if bring.is_brought(name) else name


def written(name: str, info: ValidationInfo) -> str:
    """Return the absolute path of a structure's equations, which have been read and checked.

    Raises:
        ValueError: there is no such file, or its equations break a law; pydantic adds the key.
    """
    try:
        path = text_file(name, (info.context or {}).get("file"))
        read_equations(path)
    except Refusal as error:
        raise ValueError("; ".join(getattr(error, "faults", (str(error),)))) from error
    return str(path)


def structure(name: str, info: ValidationInfo) -> str:
    """Return the name of a brought structure with the absolute path of its file, whose text has been checked.

    Raises:
        ValueError: there is no such file, or no function (inputs, outputs, trim) in it; pydantic adds the key.
    """
    found = located(name, info)
    path, attribute = place(found)
    try:
        file = bring.declared(path)
        file.need(attribute)
    except ScenarioError as error:
        raise ValueError("; ".join(error.faults)) from error
    function = file.functions.get(attribute)
    wrong = function and wrong_arguments(function, ("inputs", "outputs", "trim"), (), path)
    if wrong:
        raise ValueError(wrong)
    return found


def place(name: str) -> tuple[Path, str]:
    """Return path and attribute of a name whose file has been found."""
    path, _, attribute = name.rpartition(":")
    return Path(path), attribute


def wrong_arguments(function: ast.FunctionDef, first: Sequence[str], more: Sequence[str], path: Path) -> str | None:
    """Return what is wrong with the arguments of a function, as its text shows them; None if nothing is.

    Args:
        function: its definition.
        first: what it gets by position.
        more: what it may take by name.
        path: of its file.
    """
    a = function.args
    placed = [arg.arg for arg in (*a.posonlyargs, *a.args)]
    needed = placed[: len(placed) - len(a.defaults)][len(first) :]
    needed += [arg.arg for arg, default in zip(a.kwonlyargs, a.kw_defaults, strict=True) if default is None]
    if (len(placed) >= len(first) or a.vararg is not None) and set(needed) <= set(more):
        return None
    wanted = ", ".join([*first, *more])
    return f"{function.name} of {path.name} must take ({wanted}), got ({', '.join(placed)})"


def guarded(path: Path, label: str, what: str, function: Any, *arguments: Any, **named: Any) -> Any:
    """Call a user's function; turn an error that is not one of the testbench into one sentence.

    Raises:
        BroughtCodeError: with kind, text and line of the error.
        TestbenchError: as it was raised.
    """
    try:
        with bring.running(path, f"{label} must return {what}"):
            return function(*arguments, **named)
    except bring.BroughtCodeError as error:
        if isinstance(error.__cause__, TypeError) and "argument 'status'" in error.message:
            raise bring.BroughtCodeError(f"{error.message}{_STATUS}") from error.__cause__
        raise
