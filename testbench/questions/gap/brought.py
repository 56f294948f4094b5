"""Effects that users bring: named ``FILE.py:NAME``, found in their project, read without being run, run with care."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from testbench.aircraft import Aircraft
from testbench.core import bring
from testbench.core.door import sha256
from testbench.core.errors import ScenarioError, nearest
from testbench.effects import Effect, catalogue, left_out, library
from testbench.page.words import grouped
from testbench.sensors import SensorSuite

FOLDER = "effects"  # folder of a project in which effects are looked for


@dataclass(frozen=True)
class Guarded:
    """A function of a user's effect, whose errors name the line of the file that they come from."""

    function: Callable[..., Any]
    path: Path
    what: str

    def __call__(self, *arguments: Any) -> Any:
        """Call it."""
        with bring.running(self.path, f"{self.what} must work"):
            return self.function(*arguments)


@dataclass(frozen=True, eq=False)
class Choice:
    """The effects that are searched."""

    effects: Mapping[str, Effect]  # by name
    notes: tuple[str, ...] = ()  # whose code runs beside the library's, a sentence for each file


def choose(
    suite: SensorSuite,
    only: Sequence[str] | None = None,
    more: Sequence[str] = (),
    beside: Path | None = None,
    aircraft: Aircraft | None = None,
) -> Choice:
    """Return the library of a suite, or ``only`` some effects, and ``more``; the files of those that are brought run.

    Args:
        suite: as believed; its sensors' errors are in the library.
        only: names of the library, or ``FILE.py:NAME``, that take the place of the whole library.
        more: the same, searched beside those.
        beside: the scenario's file; names are looked for from its folder, and from the working directory.
        aircraft: as believed; effects that it cannot have are left out, which the notes say.

    Raises:
        ScenarioError: a name is not known, or not that of an effect; a file cannot be run; two effects share a name.
    """
    known = library(suite)
    chosen = dict(known) if only is None else {}
    notes = []
    for name in (*(only or ()), *more):
        if not bring.is_brought(name):
            chosen[name] = _packaged(name, catalogue(suite))
            continue
        path, attribute = bring.find(name, beside, FOLDER)
        effect = load_effect(path, attribute)
        if effect.name in {**catalogue(suite), **chosen}:
            name_of_its_own = f"an effect of your own must have its own name, got '{effect.name}' of {name}"
            raise ScenarioError([f"{name_of_its_own}, which another effect has"])
        chosen[effect.name] = effect
        notes.append(
            f"the effect '{effect.name}' is code of {path}; that file was run (SHA-256 {sha256(path, 'python')})"
        )
    without = left_out(chosen, aircraft, suite) if aircraft is not None else {}
    notes += [f"not searched: {', '.join(names)}, since {why}" for why, names in grouped(without).items()]
    kept = {n: e for n, e in chosen.items() if n not in without}
    return Choice(kept if aircraft is None else {n: e.sized(aircraft) for n, e in kept.items()}, tuple(notes))


def load_effect(path: Path, attribute: str) -> Effect:
    """Run a user's file and return the effect of that name in it.

    Raises:
        ScenarioError: the file cannot be run, or what it names is no effect.
    """
    found = bring.load(path, attribute)
    if not isinstance(found, Effect):
        raise ScenarioError([f"{path.name}:{attribute} must be an Effect, got {type(found).__name__}"])
    amend = Guarded(found.amend, path, f"amend of '{found.name}'")
    return replace(found, amend=amend)


def faults(names: Sequence[str], suite: SensorSuite | None, beside: Path | None) -> list[str]:
    """Return what is wrong with names of effects, as far as the text of their files tells; nothing is run.

    Without a suite, names of the library are not checked.
    """
    out: list[str] = []
    for name in names:
        try:
            if bring.is_brought(name):
                path, attribute = bring.find(name, beside, FOLDER)
                file = bring.declared(path)
                file.need(attribute)  # what a call makes of it is known only when the file runs
                plain = isinstance(file.values.get(attribute), (ast.Constant, ast.List, ast.Dict))
                if plain or attribute in {**file.functions, **file.classes}:
                    raise ScenarioError([f"{path.name}:{attribute} must be an Effect(...), got something else"])
            elif suite is not None:
                _packaged(name, catalogue(suite))
        except ScenarioError as error:
            out += error.faults
    return out


def _packaged(name: str, known: Mapping[str, Effect]) -> Effect:
    if name not in known:
        raise ScenarioError([f"must name an effect of the library or FILE.py:NAME, got '{name}'{nearest(name, known)}"])
    return known[name]
