"""What users bring (aircraft, suites, ground tests, estimators, structures, effects), tried on the laws of its kind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from testbench.core.bring import find, is_brought, load, short
from testbench.core.contract import Law
from testbench.core.door import read_toml
from testbench.core.errors import ScenarioError
from testbench.core.paths import AIRCRAFT, SENSOR_SUITES, find_scenario
from testbench.core.processes import apart
from testbench.core.schema import parse
from testbench.questions.files import file_classes, kind_of

LIMIT_S = 600.0
"""How long what a Python file holds may take for all of its laws, s."""


def laws_of(what: Path) -> tuple[str, list[Law]] | None:
    """Return what kind of thing a path is, and for every law of its family whether it is kept.

    Returns:
        None if it is no aircraft folder, no sensor suite, no structure, no ground test and no name in a Python file.

    Raises:
        TestbenchError: it cannot be read.
    """
    found = found_at(what)
    if found is None and is_brought(str(what)):
        return _in_python(str(what))
    return None if found is None else (found.kind, found.laws())


@dataclass(frozen=True)
class Found:
    """What a path means: what kind of thing, what reads it, and what tries it on the laws of its kind."""

    kind: str
    read: Callable[[], Any]
    laws: Callable[[], list[Law]]


def found_at(what: Path) -> Found | None:
    """Return what users bring that a path means: an aircraft, a sensor suite, a structure, a ground vibration test."""
    folder = AIRCRAFT.at(what) or (None if find_scenario(what).is_file() else AIRCRAFT.named(Path(), str(what)))
    if folder is not None:
        from testbench.flight import load_aircraft
        from testbench.questions.aircraft.contract import aircraft_laws

        return Found("aircraft", lambda: load_aircraft(folder), lambda: aircraft_laws(load_aircraft(folder)))
    suite = SENSOR_SUITES.at(what)
    if suite is not None and "sensor" in read_toml(suite):
        from testbench.sensors import load_suite
        from testbench.sensors.contract import suite_laws

        return Found("sensor suite", lambda: load_suite(suite), lambda: suite_laws(load_suite(suite)))
    file = find_scenario(what)
    kind = kind_of(file) if file.suffix == ".toml" and file.is_file() else ""
    if kind == "structure":
        from testbench.estimators.contract import tried
        from testbench.estimators.equations import read_equations

        return Found(kind, lambda: read_equations(file), lambda: list(tried(str(what))))
    if kind == "ground test":
        from testbench.aircraft.strips.ground_test import ground_test_laws, read_ground_test

        return Found(
            "ground vibration test", lambda: read_ground_test(file), lambda: ground_test_laws(read_ground_test(file))
        )
    if kind in _DESCRIBED:
        read = partial(_described, kind, file)
        return Found(kind, read, lambda: [Law("its values are lawful", bool(read()))])
    return None


_DESCRIBED = ("aircraft", "geometry", "masses beside AVL", "prior", "project", "writer")


def _described(kind: str, file: Path) -> Any:
    """Return what a file of such a kind says, once its keys and, where there are more, its laws have been checked."""
    if kind == "geometry":
        from testbench.aircraft.geometry.read import read_plan

        return read_plan(file)
    if kind == "prior":
        from testbench.pooling.prior import prior_of_file

        return prior_of_file(file)
    said, faults = parse(file_classes()[kind], read_toml(file), file)
    if said is None or faults:
        raise ScenarioError(faults)
    return said


def place_of(name: str) -> tuple[Path, str]:
    """Return file and attribute of ``FILE.py:NAME``, an effect or an estimator.

    Raises:
        ScenarioError: there is no such file.
    """
    from testbench.estimators import contract as methods
    from testbench.questions.gap.brought import FOLDER

    try:
        return find(name, None, FOLDER)
    except ScenarioError:
        return find(name, None, methods.FOLDER)


def _in_python(name: str) -> tuple[str, list[Law]]:
    """Return the kind of what a Python file holds under a name, and its laws."""
    from testbench.effects.base import Effect
    from testbench.estimators import contract as methods
    from testbench.questions.gap import effect_contract as effects

    path, attribute = place_of(name)

    def tried() -> tuple[str, list[Law]]:
        what = load(path, attribute)
        if isinstance(what, Effect):
            return "effect", list(effects.tried(path, attribute))
        return methods.kind_of(what), list(methods.tried(f"{path}:{attribute}"))

    return apart(tried, short(name), LIMIT_S)
