"""The page as one file: models, style and script inside, nothing fetched from anywhere."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

_HERE = Path(__file__).resolve().parent


def studio_page(models: dict[str, Any]) -> str:
    """Return the page that computes from ``models``, see :func:`testbench.questions.studio.ask.studio_models`."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(loader=FileSystemLoader(_HERE), autoescape=True, undefined=StrictUndefined)
    texts = {n: Markup((_HERE / f).read_text("utf-8")) for n, f in _FILES.items()}
    data = json.dumps(models, ensure_ascii=True, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    return environment.get_template("studio.html.j2").render(models=Markup(data), **texts)


_FILES = {"css": "studio.css", "core": "core.js", "script": "studio.js"}
