"""What other installed packages bring: entry points, named ``PACKAGE:NAME`` in files and on the command line.

A package states them in its pyproject.toml, in the groups of :data:`KINDS`. The value of an aircraft or a sensor suite
is the dotted place of its folder or file, without suffix; that of code is "module:name". Code is found without being
imported, and read and run with the care that code of one's own gets (:mod:`testbench.core.bring`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path

from testbench.core.errors import ScenarioError, nearest

KINDS = {
    "aircraft": "testbench.aircraft",
    "suites": "testbench.sensors",
    "estimators": "testbench.estimators",
    "effects": "testbench.effects",
    "writers": "testbench.writers",
}
"""Folder of a project that holds such things -> group of entry points."""
_NAME = re.compile(r"(?!jsbsim:)[A-Za-z0-9][\w.-]*:\w+")


def is_plugin(name: object) -> bool:
    """Return whether a name has the form ``PACKAGE:NAME``; ``jsbsim:f16`` is a model that comes with JSBSim."""
    return isinstance(name, str) and ".py:" not in name and _NAME.fullmatch(name) is not None


@cache
def installed(kind: str) -> Mapping[str, EntryPoint]:
    """Return ``PACKAGE:NAME`` -> entry point of a kind, sorted by name."""
    found = entry_points(group=KINDS[kind])
    return dict(sorted((f"{e.dist.name}:{e.name}", e) for e in found if e.dist is not None))


def place(name: str, kind: str) -> tuple[Path, str]:
    """Return the file or folder that ``PACKAGE:NAME`` means, and the attribute of its code, if it is code.

    Raises:
        ScenarioError: no installed package brings it, or what its entry point names is not there.
    """
    known = installed(kind)
    if name not in known:
        hint = nearest(name, known) if known else f"; no installed package has entry points {KINDS[kind]}"
        raise ScenarioError(f"'{name}' must be an entry point {KINDS[kind]} of an installed package{hint}")
    entry = known[name]
    top, *rest = entry.module.split(".")
    spec = find_spec(top)  # imports nothing: a top package has no parent
    for home in () if spec is None else spec.submodule_search_locations or (Path(spec.origin or "").parent,):
        at = Path(home, *rest) if spec and spec.submodule_search_locations else Path(home, top)
        ends = (at.with_suffix(".py"), at / "__init__.py") if entry.attr else (at, at.with_suffix(".toml"))
        found = next((path for path in ends if path.exists()), None)
        if found is not None:
            return found.resolve(), entry.attr or ""
    raise ScenarioError(f"the entry point '{entry.value}' of '{name}' must name what is there; mend or reinstall it")
