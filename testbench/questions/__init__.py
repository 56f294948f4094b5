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
    """One question."""

    command: str  #: of the command line
    example: str  #: what follows the command in the help
    words: str  #: what the example does
    function: str  #: the function that answers the question, "module:name" in its room
    kind: str = ""  #: what a file of it is called; empty if it takes no file of its own
    folder: str = ""  #: where its packaged files lie below ``scenarios/``
    schema: str = ""  #: class of its files, "module:name" in its room
    room: str = ""  #: its folder in testbench/questions; the command's name if not given
    #: what a user wants whom the example helps, in few words; "" if ``testbench`` alone does not name it
    want: str = ""

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
    Question(
        "run",
        "eolo_alpha",
        "fly, identify, report",
        "ask:run",
        kind="scenario",
        schema="scenario:Scenario",
        want="test input, sensors",
    ),
    Question(
        "new",
        "mine --aircraft taurus --sensors eolo_alpha",
        "begin a campaign",
        "new:new_project",
        room="project",
        want="begin a campaign",
    ),
    Question(
        "identify",
        "my_records.toml",
        "the same for recorded flights",
        "ask:identify",
        kind="description of recorded flights",
        folder="records",
        schema="scenario:RecordDescription",
        want="identify flights",
    ),
    Question(
        "import",
        "flight.ulg -o my_log",
        "contents of a flight log",
        "ask:import_log",
        room="importing",
        want="look into a log",
    ),
    Question("export", "aircraft taurus --to c", "write a model for other programs", "ask:export_record"),
    Question(
        "global", "log*.nc --aircraft f16", "coefficients over the envelope", "ask:global_model", room="global_model"
    ),
    Question("compatibility", "my_records.toml", "do the instruments agree?", "ask:compatibility"),
    Question("response", "my_records.toml", "frequency responses", "ask:frequency_responses"),
    Question(
        "modes",
        "eolo_turbulence",
        "modes without any input",
        "ask:fly_modes",
        kind="scenario of flight in turbulence",
        folder="modes",
        schema="scenario:ModesScenario",
    ),
    Question(
        "gap",
        "flexible_wings",
        "what the simulation lacks",
        "ask:run_gap",
        kind="gap scenario",
        folder="gap",
        schema="scenario:GapScenario",
        want="explain a mismatch",
    ),
    Question(
        "design",
        "eolo_short_period",
        "which input to fly",
        "ask:run_design",
        kind="design scenario",
        folder="design",
        schema="scenario:DesignScenario",
        want="find an input",
    ),
    Question(
        "compare",
        "eolo_alpha",
        "value of each sensor",
        "ask:compare",
        kind="comparison",
        folder="compare",
        schema="scenario:CompareScenario",
        want="choose sensors",
    ),
    Question(
        "plan",
        "eolo_envelope",
        "flights with cards to print",
        "ask:make_plan",
        kind="flight plan",
        folder="plan",
        schema="scenario:PlanScenario",
        want="plan flights",
    ),
    Question("live", "flight.csv --aircraft taurus", "identify while it flies", "ask:fly_along"),
    Question("sitl", "taurus", "physics for an autopilot", "links:serve"),
    Question(
        "campaign",
        "run taurus_scatter",
        "a scenario many times",
        "ask:fly_campaign",
        kind="campaign",
        folder="campaign",
        schema="scenario:CampaignSpec",
    ),
    Question(
        "dataset",
        "identification -o my_set",
        "flights whose truth is known",
        "ask:draw_dataset",
        kind="data set",
        folder="dataset",
        schema="scenario:DatasetScenario",
    ),
    Question("aircraft", "eolo", "trims, modes, derivatives", "ask:survey", want="study an aircraft"),
    Question("studio", "", "drag an input in a browser", "ask:studio_models"),
    Question("app", "", "drop a log in a browser", "ask:Workbench"),
    Question("results", "results", "results so far", "ask:list_results"),
    Question("reproduce", "all", "the papers' figures and ours", "ask:reproduce"),
    Question("exercise", "list", "exercises for students", "ask:start"),
)
"""All questions, in the order of the help."""
BY_COMMAND = {q.command: q for q in QUESTIONS}
"""Command -> question."""
