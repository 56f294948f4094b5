"""The page on an aircraft."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from testbench.page.page import Page
from testbench.questions.aircraft.adopt import found_table
from testbench.questions.aircraft.answer import aircraft_answer, shapes_missing
from testbench.questions.aircraft.figures import aircraft_plates
from testbench.questions.aircraft.tables import aircraft_tables, law_table, mode_table, modes_over_speed, trim_table

if TYPE_CHECKING:
    from testbench.aircraft import Aircraft
    from testbench.flight.adopt import Adopted
    from testbench.questions.aircraft.ask import Survey


def aircraft_page(survey: Survey) -> Page:
    """Return the page of a survey; the modes at all speeds are only in a file."""
    aircraft = survey.envelope.aircraft
    return Page(
        kicker=f"Aircraft: {aircraft.name}",
        title=aircraft.title,
        heading="In short",
        answer=aircraft_answer(survey),
        tables=aircraft_tables(survey),
        more_tables=[modes_over_speed(survey)],
        plates=aircraft_plates(survey),
        template="questions/aircraft/page.html.j2",
        context={"envelope": survey.envelope, "aircraft": aircraft, "shapes_missing": shapes_missing(survey)},
        terminal=[
            trim_table(survey).without("qbar"),
            mode_table(survey).without("motion"),
            *([law_table(survey).without("motion")] if survey.by_law else []),
        ],
    )


def adopted_page(adopted: Adopted, survey: Survey, folder: Path) -> Page:
    """Return the page of an adopted model: that of its survey, with what was found and what was assumed before it."""
    page, table = aircraft_page(survey), found_table(adopted)
    name = survey.envelope.aircraft.name
    return replace(
        page,
        kicker=f"Aircraft adopted: {name}",
        tables=[table, *page.tables],
        terminal=[table, *page.terminal],
        notes=[
            *page.notes,
            f"edit {folder}/aircraft.toml as you like: it is checked when it is loaded",
        ],
        closing=[("Aircraft", f'{folder}, in a scenario: aircraft = "{name}"'), *page.closing],
    )


def folder_name(aircraft: Aircraft, name: str) -> str:
    """Return the name of the folder of results: the aircraft's name, with rigid wings told from flexible ones."""
    return f"aircraft_{name}" + ("_rigid" if "rigid" in aircraft.name.removeprefix(name) else "")
