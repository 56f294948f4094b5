"""The page of the workbench as one file: style and script inside, nothing fetched but from its own server."""

from __future__ import annotations

from pathlib import Path

_HERE = Path(__file__).resolve().parent


def app_page(name: str) -> str:
    """Return the page of a folder of this name."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(loader=FileSystemLoader(_HERE), autoescape=True, undefined=StrictUndefined)
    return environment.get_template("app.html.j2").render(name=name)
