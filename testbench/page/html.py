"""HTML pages: one self-contained file each, from the templates beside this module."""

from __future__ import annotations

import base64
import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.channels import CHANNELS

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
    return Picture(plate.name, plate.title, plate.caption, _uri(wide), _uri(plate.draw(wide=False, png=False).svg))


def _uri(svg: str) -> str:
    return "data:image/svg+xml;base64," + base64.b64encode(svg.encode()).decode()


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
    return out


def first_screen(answer: Sequence[str | tuple[str, str]]) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """Return the (kind, sentence) lines of an answer that stand above its figure, at least one, and those below it.

    Sentences without a kind get "lead" for the first and "" for the others; each gets a capital, unless the name or
    symbol of a channel or a name with an underscore begins it, and a full stop.
    """
    lines = [(("lead", "")[k > 0], s) if isinstance(s, str) else s for k, s in enumerate(answer)]
    lines = [(kind, _sentence(text)) for kind, text in lines]
    rows = np.cumsum([0.4 + math.ceil(len(text) / _LETTERS_PER_ROW) for _, text in lines])
    shown = max(1, int(np.count_nonzero(rows <= _ANSWER_ROWS)))
    if shown == len(lines) - 1 and rows[-1] <= _ANSWER_ROWS + 2.0:  # one short sentence is no continuation
        shown += 1
    return lines[:shown], lines[shown:]


def _sentence(text: str) -> str:
    first = text.split(" ", 1)[0].removesuffix(":")
    name = "_" in first or (first in CHANNELS and first != "a") or not first.isascii()
    capital = text if name else text[:1].upper() + text[1:]
    return capital if capital.endswith((".", "?", "!")) else capital + "."


def render(template: str, **context: Any) -> str:
    """Return the page made from ``templates/template``; text is escaped, and a name that is not given raises.

    Pages extend ``base.html.j2``, which holds the style, the script that sorts tables, and the macros
    ``show_table``, ``show_picture`` and ``show_answer``.
    """
    return _environment().get_template(template).render(**context)
