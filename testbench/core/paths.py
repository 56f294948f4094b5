"""Where the aircraft models, scenarios and sensor suites lie, in a checkout and in an installed package."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]


def _folder(name: str) -> Path:
    packaged = _PACKAGE / "data" / name
    return packaged if packaged.is_dir() else _PACKAGE.parent / name


AIRCRAFT_MODELS = _folder("aircraft_models")
SCENARIOS = _folder("scenarios")
SUITES = _PACKAGE / "sensors" / "suites"


def aircraft_names() -> list[str]:
    """Return the names of the aircraft folders, sorted."""
    return sorted(p.parent.name for p in AIRCRAFT_MODELS.glob("*/aircraft.toml"))


def suite_names() -> list[str]:
    """Return the names of the packaged sensor suites, sorted."""
    return sorted(p.stem for p in SUITES.glob("*.toml"))


def find_scenario(name: str | Path) -> Path:
    """Return the file meant by ``name``: a path that exists, else a packaged scenario of that name.

    ``scenarios/eolo_alpha.toml``, ``eolo_alpha.toml`` and ``eolo_alpha`` all find the packaged scenario when no such
    file lies in the working directory. A name that is not found is returned unchanged; opening it says so.
    """
    path = Path(name)
    if path.exists():
        return path
    parts = path.parts[1:] if path.parts[:1] == ("scenarios",) else path.parts
    packaged = SCENARIOS.joinpath(*parts).with_suffix(".toml")
    return packaged if parts and packaged.is_file() else path
