"""Which sections make up which chapter, and how they are run."""

from __future__ import annotations

from collections.abc import Callable

from testbench.core.errors import ScenarioError, nearest
from testbench.questions.reproduce import (
    b1_alpha,
    eolo_air_data,
    eolo_bode,
    eolo_closed_loop,
    eolo_flexible,
    eolo_inputs,
    eolo_lost_pole,
    eolo_model,
    paper_checks,
    taurus_campaign,
    taurus_causes,
    taurus_model,
)
from testbench.questions.reproduce.section import Chapter, Say, Section

_EOLO_PAPER = (
    "“Open-Loop Subspace Identification of a Flexible Unmanned Aerial System”, the EOLO paper. Its flight records are "
    "not at hand: everything here is flown on a simulated aircraft of its published mass and geometry, with "
    "aerodynamic "
    "coefficients estimated so that the phugoid is like that of its identified model, and with estimated sensors. "
)

CHAPTERS: dict[str, tuple[str, str, tuple[Callable[[Say], Section], ...]]] = {
    "taurus": (
        "Taurus",
        "Qazi, Ahsan, Ashraf and Ahmad, “Modeling of a UAV Longitudinal Dynamics through System Identification "
        "Technique”, the Taurus paper. Mass, speed and sensors are not printed and are estimated; the aircraft is a "
        "physical one of its span and area, which the printed poles are not.",
        (taurus_model.section, taurus_campaign.section, taurus_causes.section, paper_checks.taurus),
    ),
    "eolo": (
        "EOLO",
        _EOLO_PAPER,
        (
            eolo_inputs.section,
            eolo_model.section,
            eolo_lost_pole.section,
            eolo_bode.section,
            eolo_air_data.section,
            eolo_flexible.section,
            eolo_closed_loop.section,
            paper_checks.eolo,
        ),
    ),
    "b1": (
        "B-1-like",
        "Section 4 of the EOLO paper. The paper's simulation is not at hand; the aircraft is a surrogate of that size, "
        "its data recalled from memory, and named B-1-like for that reason.",
        (b1_alpha.section,),
    ),
}
"""Name -> title, what it rests on, and the sections in order."""


def chosen(name: str) -> tuple[str, ...]:
    """Return the names of the chapters that ``name`` asks for: one, or with "all" every one.

    Raises:
        ScenarioError: there is no such chapter.
    """
    if name != "all" and name not in CHAPTERS:
        raise ScenarioError(
            f"a reproduction must be one of {', '.join(CHAPTERS)} or all, got '{name}'{nearest(name, CHAPTERS)}"
        )
    return tuple(CHAPTERS) if name == "all" else (name,)


def reproduce(name: str = "all", say: Say = lambda text: None) -> tuple[Chapter, ...]:
    """Run the chapter ``name``, or all, and return what was found.

    Raises:
        ScenarioError: there is no such chapter.
    """
    out = []
    for key in chosen(name):
        title, source, sections = CHAPTERS[key]
        out.append(Chapter(key, title, source, tuple(section(say) for section in sections)))
    return tuple(out)
