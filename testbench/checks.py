"""What the command line checks and lists: any kind of TOML file, and the members of each family."""

from __future__ import annotations

from pathlib import Path

from testbench.paths import SCENARIOS, aircraft_names, find_scenario, suite_names
from testbench.schema import read_toml


def check_file(path: Path) -> str:
    """Check a scenario, a description of records or a gap scenario, told apart by their keys; return which it is.

    Raises:
        ScenarioError: every fault of the file.
        RecordError: the file cannot be read.
    """
    file = find_scenario(path)
    content = read_toml(file)
    if "hidden" in content or "measured" in content:
        from testbench.gap.case import load_gap

        load_gap(file)
        return "gap scenario"
    if "record" in content or "channel" in content:
        from testbench.logs import load_description

        load_description(file)
        return "description of recorded flights"
    from testbench.pipeline import load_scenario

    load_scenario(file)
    return "scenario"


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
    for command, folder in (("run", ""), ("identify", "records"), ("gap", "gap")):
        for path in sorted((SCENARIOS / folder).glob("*.toml")):
            rows.append((f"{folder}/{path.stem}".lstrip("/"), command, str(read_toml(path).get("title", ""))))
    return rows  # type: ignore[return-value]


def read_toml_title(aircraft: str) -> str:
    """Return the title in an aircraft's aircraft.toml."""
    from testbench.paths import AIRCRAFT_MODELS

    return str(read_toml(AIRCRAFT_MODELS / aircraft / "aircraft.toml").get("title", ""))
