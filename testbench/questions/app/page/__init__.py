"""The page of the workbench as one file: style and script inside, nothing fetched but from its own server."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from testbench.page.html import render
from testbench.questions import Question

_HERE = Path(__file__).resolve().parent
_SCRIPTS = tuple(
    _HERE / name for name in ("app.js", "replay.js", "flights.js", "design.js", "exercises.js", "campaigns.js")
)


def app_page(name: str, questions: Sequence[Question]) -> str:
    """Return the page of a folder of this name, on which these questions may be asked."""
    return render("questions/app/page/app.html.j2", True, _SCRIPTS, name=name, questions=questions)
