"""HTML pages: one self-contained file each, from the templates beside this module."""

from __future__ import annotations

import base64
import hashlib
import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.page.words import Answer, Line, advice_lines, answer_lines, sentence

if TYPE_CHECKING:
    from jinja2 import Environment

    from testbench.page.plot import Plate

_TEMPLATES = Path(__file__).resolve().parent / "templates"
_ANSWER_ROWS, _LETTERS_PER_ROW = 9.0, 88  # of the answer above its figure, so that both stand on a screen of 900 px


@dataclass(frozen=True)
class Picture:
    """A figure on a page: ``wide`` and ``narrow`` are data URIs of SVG images."""

    name: str
    title: str
    caption: str
    wide: str
    narrow: str


def picture(plate: Plate, wide_svg: str | None = None) -> Picture:
    """Return ``plate`` as a picture; ``wide_svg`` is its wide form if it has been drawn already."""
    wide = wide_svg if wide_svg is not None else plate.draw(png=False).svg
    narrow = plate.draw(wide=False, png=False).svg
    return Picture(plate.name, plate.title, plate.caption, data_uri(wide.encode()), data_uri(narrow.encode()))


def data_uri(image: bytes, kind: str = "svg+xml") -> str:
    """Return an image as an address that holds it."""
    return f"data:image/{kind};base64,{base64.b64encode(image).decode()}"


@lru_cache(maxsize=1)
def _environment() -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    out = Environment(
        loader=FileSystemLoader([_TEMPLATES, _TEMPLATES.parents[1]]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    script = (_TEMPLATES / "sort.js").read_text(encoding="utf-8")
    # The one script of a page: named by its hash, so that no other runs, not even one smuggled in by a text.
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    out.globals.update(sort_script=Markup(script), sort_hash=Markup(f"sha256-{digest}"), first_screen=first_screen)
    out.globals.update(notes_of=notes_of, advice_lines=advice_lines)
    out.filters["sentence"] = sentence
    return out


def first_screen(answer: Answer) -> tuple[list[Line], list[Line]]:
    """Return the lines of an answer that stand above its figure, at least one, and those below it, without notes."""
    lines = [line for line in answer_lines(answer) if line.kind != "note"]
    rows = np.cumsum([0.4 + math.ceil(len(line.text) / _LETTERS_PER_ROW) for line in lines])
    shown = max(1, int(np.count_nonzero(rows <= _ANSWER_ROWS)))
    if shown == len(lines) - 1 and rows[-1] <= _ANSWER_ROWS + 2.0:  # one short sentence is no continuation
        shown += 1
    return lines[:shown], lines[shown:]


def notes_of(answer: Answer) -> list[str]:
    """Return the notes of an answer."""
    return [line.text for line in answer_lines(answer) if line.kind == "note"]


def render(template: str, **context: Any) -> str:
    """Return the page made from ``templates/template``; text is escaped, and a name that is not given raises.

    Pages of questions extend ``page.html.j2``; others ``base.html.j2``, which holds the style, the script that sorts
    tables, and the macros ``show_table``, ``show_picture``, ``show_answer``, ``show_facts`` and ``show_section``.
    """
    return _environment().get_template(template).render(**context)
