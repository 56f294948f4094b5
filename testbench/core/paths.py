"""Where things lie: packaged aircraft, scenarios and suites, and what users bring themselves.

What a scenario names is a packaged name, a path, ``PACKAGE:NAME`` that an installed package brings, or a name in the
project folder of the user: ``aircraft/NAME`` and ``suites/NAME.toml`` beside the scenario, then in the working folder.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from testbench.core.door import open_file
from testbench.core.errors import RecordError, ScenarioError, nearest
from testbench.core.plugins import installed, is_plugin, place

PACKAGE = Path(__file__).resolve().parents[1]


def _folder(name: str) -> Path:
    packaged = PACKAGE / "data" / name
    return packaged if packaged.is_dir() else PACKAGE.parent / name


AIRCRAFT_MODELS = _folder("aircraft_models")
SCENARIOS = _folder("scenarios")
SUITES = PACKAGE / "sensors" / "suites"


def aircraft_names() -> list[str]:
    """Return the names of the aircraft folders, sorted."""
    return sorted(p.parent.name for p in AIRCRAFT_MODELS.glob("*/aircraft.toml"))


STOCK = "jsbsim:"
"""What the name of an aircraft begins with that comes with JSBSim itself: ``jsbsim:f16``."""


@cache
def stock_root() -> Path | None:
    """Return the root directory of models that JSBSim was installed with; None without it. JSBSim is not imported."""
    found = find_spec("jsbsim")
    root = Path(found.origin).parent if found is not None and found.origin else None
    return root if root is not None and (root / "aircraft").is_dir() else None


@cache
def stock_names() -> tuple[str, ...]:
    """Return the names of the models that come with JSBSim."""
    root = stock_root()
    folders = () if root is None else sorted((root / "aircraft").iterdir())
    return tuple(p.name for p in folders if (p / f"{p.name}.xml").is_file())


def suite_names() -> list[str]:
    """Return the names of the packaged sensor suites, sorted."""
    return sorted(p.stem for p in SUITES.glob("*.toml"))


def find_scenario(name: str | Path) -> Path:
    """Return the file meant by ``name``: a path that exists, else a packaged scenario of that name.

    ``scenarios/eolo_alpha.toml``, ``eolo_alpha.toml`` and ``eolo_alpha`` all find the packaged scenario when no such
    file lies in the working directory; a folder of that name, such as one of results, does not hide it. A name that is
    not found is returned unchanged; opening it says so.
    """
    path = Path(name)
    if path.exists() and not path.is_dir():
        return path
    parts = path.parts[1:] if path.parts[:1] == ("scenarios",) else path.parts
    packaged = SCENARIOS.joinpath(*parts).with_suffix(".toml")
    return packaged if parts and packaged.is_file() else path


def not_found(path: Path, packaged: Sequence[str] = (), files: Callable[[Path], bool] | None = None) -> str:
    """Return what is got where a file is wanted and none is, to end a message: the path, and why it means none.

    Args:
        path: as the user gave it.
        packaged: names that would have meant a packaged file.
        files: whether a file or folder that lies near could be meant; any if not given.
    """
    if path.is_dir():
        inside = [str(found) for found in sorted(path.glob("*.toml"))] if packaged else []
        hint = f"; did you mean '{inside[0]}'?" if inside else nearest(path.name, packaged)
        return f"'{path}', which is a folder{hint if hint.startswith('; did') else ''}"
    if path.exists():
        return f"'{path}', which is neither a file nor a folder"
    missing = path
    while not missing.parent.exists():
        missing = missing.parent
    home = missing.parent
    if not home.is_dir():
        return f"'{path}', but '{home}' is a file"
    what, fits = ("file or folder", files) if missing == path else ("folder", Path.is_dir)
    try:
        beside = [str(found) for found in home.iterdir() if fits is None or fits(found)]
    except OSError:
        beside = []
    name = "of that name" if missing == path else f"'{missing}'"
    hint = nearest(str(missing), beside) if beside else ""
    if not hint.startswith("; did"):  # what else lies there helps nobody
        hint = nearest(path.stem, packaged).replace("; valid:", "; packaged:")
    return f"'{path}', but there is no {what} {name}{hint}"


@dataclass(frozen=True)
class Family:
    """A family whose members are packaged or brought by the user."""

    words: str  # one member in words
    folder: str  # of the user's project that holds members by name
    packaged: Callable[[], list[str]]  # names of the packaged members
    inside: str = ""  # file that makes a folder a member; empty if members are TOML files
    others: Callable[[Path], bool] = lambda path: False  # whether a path without such a file is a member all the same
    # names of members that come with another program, written ``jsbsim:NAME``, or NAME alone if nothing else has it
    stock: Callable[[], Sequence[str]] = tuple

    def at(self, path: Path) -> Path | None:
        """Return the member that lies at a path, or that an installed package brings by that name, or None."""
        from testbench.core.store import settle

        if is_plugin(path.name) and path.name in installed(self.folder):
            path = place(path.name, self.folder)[0]
        if self.inside:
            path = settle(path.parent if path.name == self.inside else path)
            return path if (path / self.inside).is_file() or self.others(path) else None
        return path if path.suffix == ".toml" and path.is_file() else None

    def named(self, place: Path, name: str) -> Path | None:
        """Return the member called ``name`` in the project folder ``place``, or None."""
        return self.at(place / self.folder / (name if self.inside else f"{name}.toml"))

    def own(self, place: Path) -> list[str]:
        """Return the names of the members in the project folder ``place``."""
        if self.inside:
            return sorted(p.name for p in (place / self.folder).glob("*") if self.at(p))
        return sorted(p.stem for p in (place / self.folder).glob("*.toml"))


def is_jsbsim_model(path: Path) -> bool:
    """Return whether a path is a JSBSim model: an XML file that begins with ``fdm_config``, or a folder that holds one.

    Only the first part of a file is read.
    """
    if path.is_file():
        return path.suffix.lower() == ".xml" and holds_jsbsim_model(path)
    return path.is_dir() and any(holds_jsbsim_model(p) for p in sorted(path.glob("*.xml")))


def holds_jsbsim_model(path: Path) -> bool:
    """Return whether the first part of a file begins a JSBSim model."""
    try:
        with open_file(path, "JSBSim model") as file:
            return b"<fdm_config" in file.read(100_000)
    except RecordError:
        return False


AIRCRAFT = Family("an aircraft", "aircraft", aircraft_names, "aircraft.toml", is_jsbsim_model, stock_names)
SENSOR_SUITES = Family("a sensor suite", "suites", suite_names)


def resolve(name: str, family: Family, beside: Path | None = None) -> str:
    """Return what ``name`` means: itself if it is packaged, else the absolute path of what the user brings.

    A path is taken from ``beside``, the folder of the scenario, then from the working directory; a name that is no path
    is looked for in the project folder of both.

    What comes with another program is returned as ``jsbsim:NAME``.

    Raises:
        ScenarioError: there is nothing of that name, or both a packaged member and one of the user's own.
    """
    if name.startswith(STOCK):
        model = name.removeprefix(STOCK)
        if model not in family.stock():
            raise ScenarioError(f"no model '{model}' comes with JSBSim{nearest(model, family.stock())}")
        return name
    places = list(dict.fromkeys(p.resolve() for p in (beside, Path.cwd()) if p is not None))
    named = next((found for p in places if (found := family.named(p, name))), None)
    if name in family.packaged():
        if named is not None:
            raise ScenarioError(
                f"a name must be packaged or your own, got '{name}', which is both: write the path '{named}'"
            )
        return name
    found = next((at for p in places if (at := family.at(p / name))), None) or named
    if found is None and name in family.stock():
        return f"{STOCK}{name}"
    if found is None:
        own = [*family.packaged(), *(n for p in places for n in family.own(p)), *installed(family.folder)]
        hint = nearest(name, [*own, *family.stock()])
        if not hint.startswith("; did"):  # the names that come with another program are too many to list
            hint = nearest("", own)
        there = next((p / name for p in places if (p / name).exists()), None)
        if there is not None and family.stock():
            hint = (
                f": '{there}' is there, but holds neither {family.inside} nor an XML file that begins with <fdm_config>"
            )
        kind = f"a folder with {family.inside}" if family.inside else "a .toml file"
        if family.stock():
            kind += ", a JSBSim model (XML file or folder), one that comes with JSBSim (jsbsim:c172p)"
        raise ScenarioError(
            f"{family.words} must be a packaged name, {kind}, or a name in your folder {family.folder}/, got "
            f"'{name}'{hint}"
        )
    return str(found)


def as_named(name: str, family: Family, project: Path | None = None) -> str:
    """Return how a file of a project names what :func:`resolve` found, so that the project can be moved.

    What lies in its folder of the family is named as it is there, other paths from the folder of the project (the
    working directory if not given); what is packaged keeps its name.
    """
    path, place = Path(name), (project or Path.cwd()).resolve()
    if not path.is_absolute():
        return name
    if path.parent.resolve() == place / family.folder:
        return path.name if family.inside else path.stem
    return Path(os.path.relpath(path, place)).as_posix()
