"""What the command line checks and lists: any kind of TOML file, and the members of each family."""

from __future__ import annotations

from pathlib import Path

from testbench.errors import RecordError, ScenarioError, nearest
from testbench.paths import SCENARIOS, aircraft_names, find_scenario, suite_names
from testbench.schema import read_toml

COMMANDS = {
    "scenario": "run",
    "gap scenario": "gap",
    "design scenario": "design",
    "flight plan": "plan",
    "campaign": "campaign",
    "comparison": "compare",
    "scenario of flight in turbulence": "modes",
    "description of recorded flights": "identify",
}
FOLDERS = {
    "run": "",
    "gap": "gap",
    "design": "design",
    "plan": "plan",
    "campaign": "campaign",
    "compare": "compare",
    "modes": "modes",
    "identify": "records",
}


def find(path: Path, command: str) -> Path:
    """Return the file that ``path`` means to ``command``: a file, or a packaged one with or without its folder.

    Raises:
        RecordError: there is no such file; the message has the nearest packaged name.
        ScenarioError: it is a file for another command.
    """
    file = path if path.is_file() else find_scenario(Path(FOLDERS[command]) / path)
    if not file.is_file():
        file = find_scenario(path)
    if not file.is_file():
        names = [p.stem for p in (SCENARIOS / FOLDERS[command]).glob("*.toml")]
        raise RecordError(_none(path, names))
    kind = kind_of(file)
    if COMMANDS[kind] != command:
        raise ScenarioError([f"{file} is a {kind}: use testbench {COMMANDS[kind]}"])
    return file


def _none(path: Path, packaged: list[str]) -> str:
    """Return what is wrong with a path that is no file, and the nearest name of a packaged scenario."""
    got = f"'{path}'" + (", which is a folder" if path.is_dir() else "")
    return f"a scenario must be a file or a packaged one, got {got}{nearest(path.stem, packaged)}"


def kind_of(file: Path) -> str:
    """Return which of COMMANDS a file is, told by its keys.

    Raises:
        RecordError, ScenarioError: the file cannot be read, is not TOML or is empty.
    """
    content = read_toml(file)
    if not content:
        raise ScenarioError(
            [f"{file} must say what is asked, but it is empty; `testbench list scenarios` has examples"]
        )
    if "hidden" in content or "measured" in content:
        return "gap scenario"
    if "controls" in content and "manoeuvre" not in content:
        return "design scenario"
    if {"speeds_m_s", "heights_m", "flown_by", "timing"} & set(content):
        return "flight plan"
    if {"seeds", "placement"} & set(content) and "manoeuvre" in content:
        return "comparison"
    if {"flight", "modes"} & set(content):
        return "scenario of flight in turbulence"
    if {"vary", "grid", "runs", "repeats", "base"} & set(content):
        return "campaign"
    return "description of recorded flights" if "record" in content or "channel" in content else "scenario"


def check_file(path: Path) -> str:
    """Check a scenario of any kind or a description of records; return which it is.

    Raises:
        ScenarioError: every fault of the file.
        RecordError: the file cannot be read.
    """
    file = find_scenario(path)
    if not file.is_file():
        raise RecordError(_none(path, _packaged()))
    kind = kind_of(file)
    if kind == "gap scenario":
        from testbench.gap.case import load_gap

        load_gap(file)
    elif kind == "design scenario":
        from testbench.designer import load_design

        load_design(file)
    elif kind == "flight plan":
        from testbench.design.plan import load_plan

        load_plan(file)
    elif kind == "campaign":
        from testbench.campaign import load_campaign

        load_campaign(file)
    elif kind == "comparison":
        from testbench.comparison.compare import load_compare

        load_compare(file)
    elif kind == "scenario of flight in turbulence":
        from testbench.operational import load_modes

        load_modes(file)
    elif kind == "scenario":
        from testbench.pipeline import load_scenario

        load_scenario(file)
    else:
        from testbench.logs import load_description

        load_description(file)
    return kind


def _packaged() -> list[str]:
    """Return the names of all packaged scenarios, with the folders that they are checked by."""
    return [p.relative_to(SCENARIOS).with_suffix("").as_posix() for p in SCENARIOS.rglob("*.toml")]


def describe(kind: str) -> list[tuple[str, ...]]:
    """Return a table (first row: heads) of one family: aircraft, inputs, sensors, estimators, scenarios or effects."""
    if kind == "aircraft":
        return [("aircraft", "what it is"), *((n, str(read_toml_title(n))) for n in aircraft_names())]
    if kind == "inputs":
        from testbench.inputs import FAMILIES

        return [("signal", "what it is"), *((n, text) for n, (_, text) in FAMILIES.items())]
    if kind == "sensors":
        from testbench.sensors import load_suite

        suites = [load_suite(n) for n in suite_names()]
        return [
            ("suite", "rate", "channels", "what it is"),
            *((s.name, f"{s.rate_hz:g} Hz", ", ".join(s.channels), s.title) for s in suites),
        ]
    if kind == "estimators":
        from testbench.estimators import METHODS

        return [("method", "what it is"), *((n, text) for n, text in METHODS.items())]
    if kind == "effects":
        from testbench.gap.effects import EFFECTS

        return [("effect", "physics"), *((n, e.physics) for n, e in EFFECTS.items())]
    rows = [("scenario", "command", "title")]
    for command, folder in FOLDERS.items():
        for path in sorted((SCENARIOS / folder).glob("*.toml")):
            rows.append((f"{folder}/{path.stem}".lstrip("/"), command, str(read_toml(path).get("title", ""))))
    return rows  # type: ignore[return-value]


def read_toml_title(aircraft: str) -> str:
    """Return the title in an aircraft's aircraft.toml."""
    from testbench.paths import AIRCRAFT_MODELS

    return str(read_toml(AIRCRAFT_MODELS / aircraft / "aircraft.toml").get("title", ""))
