"""What users bring (aircraft, suites, ground tests, estimators, structures, effects), tried on the laws of its kind."""

from __future__ import annotations

from pathlib import Path

from testbench.core.bring import find, is_brought, load, short
from testbench.core.contract import Law
from testbench.core.door import read_toml
from testbench.core.errors import ScenarioError
from testbench.core.paths import AIRCRAFT, find_scenario
from testbench.core.processes import apart

LIMIT_S = 600.0
"""How long what a Python file holds may take for all of its laws, s."""


def laws_of(what: Path) -> tuple[str, list[Law]] | None:
    """Return what kind of thing a path is, and for every law of its family whether it is kept.

    Returns:
        None if it is no aircraft folder, no sensor suite, no structure, no ground test and no name in a Python file.

    Raises:
        TestbenchError: it cannot be read.
    """
    if is_brought(str(what)):
        return _in_python(str(what))
    folder = AIRCRAFT.at(what) or (None if find_scenario(what).is_file() else AIRCRAFT.named(Path(), str(what)))
    if folder is not None:
        from testbench.flight import load_aircraft
        from testbench.questions.aircraft.contract import aircraft_laws

        return "aircraft", aircraft_laws(load_aircraft(folder))
    if what.suffix == ".toml" and what.is_file() and "sensor" in read_toml(what):
        from testbench.sensors import load_suite
        from testbench.sensors.contract import suite_laws

        return "sensor suite", suite_laws(load_suite(what))
    if what.suffix == ".toml" and {"states", "equations"} & _keys(what):
        from testbench.estimators.contract import tried

        return "structure", list(tried(str(what)))
    test = find_scenario(what)
    if test.suffix == ".toml" and test.is_file() and {"mode", "normalisation"} <= read_toml(test).keys():
        from testbench.aircraft.strips.contract import ground_test_laws
        from testbench.aircraft.strips.reading import read_ground_test

        return "ground vibration test", ground_test_laws(read_ground_test(test))
    return None


def _keys(path: Path) -> set[str]:
    found = find_scenario(path)
    return set(read_toml(found)) if found.is_file() else set()


def _in_python(name: str) -> tuple[str, list[Law]]:
    """Return the kind of what a Python file holds under a name, and its laws."""
    from testbench.effects.base import Effect
    from testbench.estimators import contract as methods
    from testbench.questions.gap import effect_contract as effects
    from testbench.questions.gap.brought import FOLDER

    try:
        path, attribute = find(name, None, FOLDER)
    except ScenarioError:
        path, attribute = find(name, None, methods.FOLDER)

    def tried() -> tuple[str, list[Law]]:
        what = load(path, attribute)
        if isinstance(what, Effect):
            return "effect", list(effects.tried(path, attribute))
        return methods.kind_of(what), list(methods.tried(f"{path}:{attribute}"))

    return apart(tried, short(name), LIMIT_S)
