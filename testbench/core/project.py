"""The folder of a campaign: ``project.toml`` says what all its questions share, and keeps what they found.

A file of a question that lies in the folder takes what it leaves out from there. Commands that are run in the folder
add what they found to the end of the file.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from testbench.core.door import read_text, read_toml
from testbench.core.errors import ScenarioError
from testbench.core.escape import table_lines
from testbench.core.files import write_file
from testbench.core.schema import Positive, Strict, Text, parse
from testbench.core.store import one_writer

FILE = "project.toml"
_OWN = {"aircraft", "suite", "speeds_m_s"}  # keys by which a file of this name is told to be of the testbench


class Found(Strict):
    """The result of a command: time, command, folder of results, and first sentence."""

    at: Text
    command: Text
    result: str
    says: str = ""

    @property
    def question(self) -> str:
        """The command without what it was asked about: "design", "plan close", "identify --amend"."""
        first, *more = self.command.split()
        if first == "plan" and more and more[0] in ("rehearse", "close", "new"):
            return f"plan {more[0]}"
        return "identify --amend" if first == "identify" and "--amend" in more else first

    def after(self, option: str) -> str:
        """Return the word after an option of the command; "" without it."""
        words = self.command.split()
        return words[words.index(option) + 1] if option in words[:-1] else ""


class Project(Strict):
    """Keys that the questions of a campaign share.

    ``aircraft``, ``suite`` and ``wings`` are those of scenarios; ``speeds_m_s`` and ``h_m`` where it is flown; ``by``
    who flies; ``air``, ``limits`` and ``simulation`` the tables of a scenario; ``accuracies`` the wanted standard
    errors of derivatives, percent. ``history`` is written by the commands.
    """

    title: Text
    aircraft: Text
    suite: Text
    wings: Literal["flexible", "rigid"] = "flexible"
    speeds_m_s: Annotated[tuple[Positive, ...], Field(min_length=1, strict=False)]
    h_m: float
    by: Literal["pilot", "autopilot"] = "autopilot"
    air: dict[str, Any] = {}
    limits: dict[str, Any] = {}
    simulation: dict[str, Any] = {}
    accuracies: dict[str, Positive] = {}
    history: Annotated[tuple[Found, ...], Field(strict=False)] = ()

    def wanted(self, controls: Collection[str]) -> dict[str, float]:
        """Return the accuracies of the motion that controls move."""
        axes = "YLN" if {"da", "dr"} & set(controls) else "XZM"
        return {name: error for name, error in self.accuracies.items() if name[0] in axes}

    @property
    def defaults(self) -> dict[str, Any]:
        """Key of a scenario -> what it is where the scenario does not say."""
        middle = sorted(self.speeds_m_s)[len(self.speeds_m_s) // 2]
        out: dict[str, Any] = {
            "aircraft": self.aircraft,
            "wings": self.wings,
            "suite": self.suite,
            "suites": [self.suite],
            "by": self.by,
            "condition": {"V_m_s": middle, "h_m": self.h_m},
            "speeds_m_s": list(self.speeds_m_s),
            "heights_m": [self.h_m],
        }
        tables = {"air": self.air, "limits": self.limits, "simulation": self.simulation}
        return out | {key: table for key, table in tables.items() if table}


def project_here() -> Project | None:
    """Return the project of the working directory; None if it is none, or has a file of this name for something else.

    Raises:
        ScenarioError: its file breaks a law.
    """
    file = Path(FILE)
    return read_project(file) if file.is_file() and set(read_toml(file, "project")) >= _OWN else None


def read_project(file: Path) -> Project:
    """Return what a project's file says.

    Raises:
        RecordError: it cannot be read.
        ScenarioError: it breaks a law.
    """
    project, faults = parse(Project, read_toml(file, "project"), file)
    if project is None or faults:
        raise ScenarioError(faults)
    return project


def completed(content: Mapping[str, Any], keys: Mapping[str, Any], file: Path | None) -> Mapping[str, Any]:
    """Return the content of a file of a question with what the project says of keys that it leaves out.

    Args:
        content: as it was read.
        keys: that the question has.
        file: it counts where it lies in the folder of the project; packaged files are as they are.
    """
    if file is None or Path.cwd() not in file.resolve().parents or (project := project_here()) is None:
        return content
    defaults = {**project.defaults, "targets": {"parameters": project.wanted(content.get("controls", ()))}}
    return {**{k: v for k, v in defaults.items() if k in keys and k not in content}, **content}


def remember(result: Path | str, says: str) -> None:
    """Add what the command that runs found to the project of the working directory, if it is one."""
    if project_here() is None:
        return
    file = Path(FILE).resolve()  # a link stays one
    command = " ".join(sys.argv[1:]) or "python"
    found = {"at": time.strftime("%Y-%m-%d %H:%M:%S"), "command": command, "result": str(result), "says": says}
    with one_writer(file):  # of two commands that end at once, neither's entry is lost
        text = read_text(file, "project").rstrip("\n")
        write_file(file, "\n".join([text, "", *table_lines({"history": [found]}), ""]))
