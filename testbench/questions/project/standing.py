"""Where a campaign stands, stage by stage, and the command that comes next."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from testbench.core.door import read_toml
from testbench.core.project import FILE, Found, Project
from testbench.core.store import settle

_SHOWN = 88  # letters of what a command said


def standing(project: Project) -> list[str]:
    """Return ten lines at most: the campaign, its stages, and what comes next."""
    head = f"{project.title}: {project.aircraft} with {project.suite} at {_speeds(project)} m/s"
    return [head, *(f"  {name:<10}{said}" for name, said in _stages(project)), f"Next: {following(project)}"]


def _speeds(project: Project) -> str:
    return ", ".join(f"{V:g}" for V in project.speeds_m_s)


def designs() -> list[Path]:
    """Return the designs of the folder: its files but the project's."""
    files = [p for p in sorted(Path().glob("*.toml"), reverse=True) if p.name != FILE]
    return [p for p in files if "controls" in read_toml(p)]


def _last(project: Project, question: str) -> Found | None:
    return next((f for f in reversed(project.history) if f.question == question), None)


def _stages(project: Project) -> Iterator[tuple[str, str]]:
    asked = designs()
    done = [p.stem for p in asked if settle(Path("results", f"design_{p.stem}")).is_dir()]
    yield "designed", f"{len(done)} of {len(asked)}" + (f": {', '.join(done)}" if done else "")
    for name, question in (
        ("planned", "plan"), ("flown", "plan rehearse"), ("closed", "plan close"), ("amended", "identify --amend"),
        ("gap", "gap"),
    ):  # fmt: skip
        found = _last(project, question)
        yield name, "not yet" if found is None else _short(f"{found.says} ({found.result})")


def _short(text: str) -> str:
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}..."


def following(project: Project) -> str:
    """Return the command that comes next."""
    asked = designs()
    for path in asked:
        if not settle(Path("results", f"design_{path.stem}")).is_dir():
            return f"testbench design {path.name}"
    planned, flown, closed = (_last(project, q) for q in ("plan", "plan rehearse", "plan close"))
    if planned is None:
        return " ".join(["testbench plan", *(f"--from results/design_{p.stem}" for p in asked)])
    name = Path(planned.result).name.removeprefix("plan_")
    plan = f"{planned.result}/{name}.toml"
    if flown is None and not list(Path("logs").glob("*")):
        cards = f"fly the cards of {planned.result}/cards.pdf and put the logs into logs/"
        return f"{cards}; or testbench plan rehearse {plan}"
    if closed is None:
        return f"testbench plan close {plan} logs/*"
    amended = _last(project, "identify --amend")
    if amended is None:
        return f"testbench identify {closed.result}/identify/*.toml --amend {Path(project.aircraft).name}_flown"
    if _last(project, "gap") is None:
        own = amended.after("--amend")
        return f"testbench gap {own} {closed.result}/records/*.nc --sensors {project.suite}"
    return f"the loop is closed; the next flight: testbench design {asked[0].name} --after {closed.result}"
