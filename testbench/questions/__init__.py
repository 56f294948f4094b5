"""The questions that a user can ask: one folder each, and one row of :data:`QUESTIONS`.

The command line, ``testbench check``, ``testbench list``, the kinds of files and the reference in the docs are made
from the table. A new question is one folder and one row; docs/guides/add_a_question.md shows how.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from testbench.core.scenario.base import Asked


@dataclass(frozen=True)
class Question:
    """One question.

    Attributes:
        command: of the command line.
        function: what answers it, "module:name" in its room.
        kind: what a file of it is called; empty if it takes no file of its own.
        folder: where its packaged files lie below ``scenarios/``.
        schema: class of its files, "module:name" in its room.
        room: its folder in testbench/questions; the command's name if not given.
    """

    command: str
    function: str
    kind: str = ""
    folder: str = ""
    schema: str = ""
    room: str = ""

    @property
    def package(self) -> str:
        """The Python package of its room."""
        return f"testbench.questions.{self.room or self.command}"

    def part(self, place: str) -> Any:
        """Return an object of the room, "module:name"; its module is imported now."""
        module, name = place.split(":")
        return getattr(import_module(f"{self.package}.{module}"), name)

    @cached_property
    def file_class(self) -> type[Asked]:
        """The class of its files."""
        found: type[Asked] = self.part(self.schema)
        return found

    @cached_property
    def keys(self) -> frozenset[str]:
        """The keys of its files: they tell the kind of a file."""
        return frozenset(self.file_class.model_fields)


QUESTIONS = (
    Question("run", "ask:run", "scenario", "", "scenario:Scenario"),
    Question("identify", "ask:identify", "description of recorded flights", "records", "scenario:RecordDescription"),
    Question("reproduce", "ask:reproduce"),
    Question("import", "ask:import_log", room="importing"),
    Question("export", "ask:export_record"),
    Question("compatibility", "ask:compatibility"),
    Question("response", "ask:frequency_responses"),
    Question("modes", "ask:fly_modes", "scenario of flight in turbulence", "modes", "scenario:ModesScenario"),
    Question("gap", "case:run_gap", "gap scenario", "gap", "scenario:GapScenario"),
    Question("design", "ask:run_design", "design scenario", "design", "scenario:DesignScenario"),
    Question("compare", "ask:compare", "comparison", "compare", "scenario:CompareScenario"),
    Question("plan", "ask:make_plan", "flight plan", "plan", "scenario:PlanScenario"),
    Question("aircraft", "ask:survey"),
    Question("campaign", "execute:fly_campaign", "campaign", "campaign", "scenario:CampaignSpec"),
    Question("studio", "models:studio_models"),
    Question("exercise", "start:start"),
)
"""All questions, in the order of the help."""
BY_COMMAND = {q.command: q for q in QUESTIONS}
"""Command -> question."""
