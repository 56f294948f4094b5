"""The page of the workbench as one file: style and script inside, nothing fetched but from its own server."""

from __future__ import annotations

from pathlib import Path

from testbench.page.html import render

_HERE = Path(__file__).resolve().parent
_SCRIPTS = tuple(_HERE / name for name in ("app.js", "replay.js", "flights.js", "campaigns.js"))


def app_page(name: str) -> str:
    """Return the page of a folder of this name."""
    return render("questions/app/page/app.html.j2", True, _SCRIPTS, name=name)
