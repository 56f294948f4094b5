"""Designs taken over into a plan: the folder that `testbench design` wrote, or one scenario of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from testbench.core.door import read_text
from testbench.core.errors import RecordError, ScenarioError
from testbench.core.paths import not_found
from testbench.core.scenario.base import Manoeuvre
from testbench.core.store import settle
from testbench.questions.design.scenario import DesignScenario
from testbench.questions.plan.scenario import PlanLimits, PlannedManoeuvre
from testbench.questions.run.scenario import Scenario


@dataclass(frozen=True)
class Taken:
    """A designed manoeuvre: its file, the scenario in it, the manoeuvre to identify from, and what was promised.

    ``judge`` is the manoeuvre that the design is judged by, None without one; ``asked`` the design scenario that lies
    beside, with limits and who flies, None where it does not.
    """

    file: Path
    scenario: Scenario
    manoeuvre: Manoeuvre
    judge: Manoeuvre | None
    promised: tuple[str, ...]
    asked: DesignScenario | None


def take(paths: Sequence[Path]) -> list[Taken]:
    """Return the designs of folders (the best of each) or files.

    Raises:
        RecordError: a path holds no design.
        ScenarioError: designs that one plan cannot hold: of several aircraft or suites, or what no plan can fly.
    """
    out = [_taken(path) for path in paths]
    for key, found in (
        ("aircraft", {(t.scenario.aircraft, t.scenario.wings) for t in out}),
        ("suites", {t.scenario.suites[0] for t in out}),
    ):
        if len(found) > 1:
            words = sorted(" with wings ".join(x) if isinstance(x, tuple) else x for x in found)
            raise ScenarioError(
                f"the designs of one plan must have the same {key}, got {', '.join(words)}; make a plan of each"
            )
    return out


def _taken(path: Path) -> Taken:
    file = settle(path)
    if path.is_dir():
        folder = path / "designs" if (path / "designs").is_dir() else path
        ranked = sorted((p for p in folder.glob("*.toml") if p.stem[:1].isdigit()), key=lambda p: (_rank(p), p.name))
        if not ranked:
            raise RecordError(
                f"a folder with designs must hold designs/1_*.toml, as `testbench design` writes them, got '{path}'"
            )
        file = ranked[0]
    if not file.is_file():
        raise RecordError(f"a design must be a file or a folder that `testbench design` wrote, got {not_found(file)}")
    scenario = Scenario.load(file)
    flown = [m for m in scenario.manoeuvre if m.use != "validation"]
    if not flown:
        raise ScenarioError(f"{file}, manoeuvre: a design must have one with use = 'identification'")
    lines = read_text(file, "scenario").splitlines()
    promised = tuple(line.lstrip("# ") for line in lines[: _comments(lines)] if line.startswith("#  "))
    asked = file.parent.parent / "design.toml"
    judge = next((m for m in scenario.manoeuvre if m.use == "validation"), None)
    return Taken(file, scenario, flown[0], judge, promised, DesignScenario.load(asked) if asked.is_file() else None)


def limits_of_designs(taken: Sequence[Taken]) -> dict[str, object]:
    """Return the limits that all designs keep, key -> value as a plan has it: the narrowest of each that is given."""
    out: dict[str, object] = {}
    for design in taken:
        if design.asked is None:
            continue
        for key, value in design.asked.limits.model_dump(exclude_none=True).items():
            if key not in PlanLimits.model_fields or value == {}:
                continue
            had = out.get(key)
            if isinstance(value, dict):
                surfaces = {c: v for c, v in value.items() if c != "thr"}
                both = had if isinstance(had, dict) else {}
                out[key] = {c: min(v, both.get(c, v)) for c, v in {**both, **surfaces}.items()}
            elif isinstance(value, tuple):
                out[key] = value if not isinstance(had, tuple) else (max(had[0], value[0]), min(had[1], value[1]))
            else:
                out[key] = value if not isinstance(had, float) else min(had, value)
    return out


def _rank(path: Path) -> int:
    digits = path.stem.split("_")[0]
    return int(digits) if digits.isdigit() else 0


def _comments(lines: Sequence[str]) -> int:
    """Return how many lines the comment at the head of a file has."""
    return next((i for i, line in enumerate(lines) if not line.startswith("#")), len(lines))


def planned(taken: Taken, manoeuvre: Manoeuvre) -> PlannedManoeuvre:
    """Return a manoeuvre of a design as a plan has it.

    Raises:
        ScenarioError: a plan cannot fly it.
    """
    made = {
        "name": manoeuvre.name,
        "duration_s": manoeuvre.duration_s,
        "settle_s": manoeuvre.settle_s,
        "repeats": 1,
        "design": taken.file.as_posix(),
        "use": "validation" if manoeuvre.use == "validation" else "identification",
        "input": [i.model_dump() for i in manoeuvre.input],
    }
    try:
        return PlannedManoeuvre.model_validate(made)
    except ValueError as error:
        said = str(error).splitlines()
        why = next((line.strip() for line in said if "Value error" in line), said[-1]).replace("Value error, ", "")
        raise ScenarioError(f"{taken.file}, manoeuvre: a plan cannot fly it: {why.split(' [type=')[0]}") from error
