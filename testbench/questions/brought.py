"""What users bring themselves, held against the contract of its family: aircraft, suites, estimators, structures."""

from __future__ import annotations

from pathlib import Path

from testbench.core.bring import is_brought
from testbench.core.contract import Law
from testbench.core.paths import AIRCRAFT
from testbench.core.schema import read_toml


def laws_of(what: Path) -> tuple[str, list[Law]] | None:
    """Return what kind of thing a path is, and every law of its family with what it makes of it.

    Returns:
        None if it is no aircraft folder, no sensor suite and no name in a Python file.

    Raises:
        TestbenchError: it cannot be read.
    """
    if is_brought(str(what)):
        from testbench.estimators.contract import tried

        return "estimator", [Law(words, not failed, failed) for words, failed in tried(str(what))]
    folder = AIRCRAFT.at(what)
    if folder is not None:
        from testbench.aircraft import load_aircraft
        from testbench.questions.aircraft.contract import aircraft_laws

        return "aircraft", aircraft_laws(load_aircraft(folder))
    if what.suffix == ".toml" and what.is_file() and "sensor" in read_toml(what):
        from testbench.sensors import load_suite
        from testbench.sensors.contract import suite_laws

        return "sensor suite", suite_laws(load_suite(what))
    return None
