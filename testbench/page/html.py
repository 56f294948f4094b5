"""HTML pages: one self-contained file each, from the templates beside this module; and texts in Markdown as pages."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from testbench.page.terminal import PLAIN
from testbench.page.words import Answer, Line, advice_lines, answer_lines, brief, sentence, typeset

if TYPE_CHECKING:
    from jinja2 import Environment

    from testbench.page.figure import Plate

_TEMPLATES = Path(__file__).resolve().parent / "templates"
_UPLOT = _TEMPLATES.parent / "uplot"


_WIDE_PT = 72.0 * 8.6  # of drawings that are as wide as a sheet
_HALF_SHEET, _LEGIBLE = 0.61, 0.88  # height over width: of half a sheet less a caption, of what keeps 5 points there
LONGEST_WORD = 20
"""Characters of a word in a cell that does not break."""


@dataclass(frozen=True)
class Picture:
    """A figure on a page: ``wide`` and ``narrow`` are data URIs of SVG images, ``explore`` its numbers as JSON.

    ``tall`` is one of which two fill a printed sheet if they are drawn a little smaller.
    """

    name: str
    title: str
    caption: str
    wide: str
    narrow: str
    explore: str = ""
    tall: bool = False


def picture(plate: Plate, wide_svg: str | None = None) -> Picture:
    """Return ``plate`` as a picture; ``wide_svg`` is its wide form if it has been drawn already."""
    from testbench.page.explore import to_json

    wide = wide_svg if wide_svg is not None else plate.draw(png=False).svg
    numbers = to_json(plate.views) if plate.views else ""
    # What is explored fits any screen as it is; its drawing is for print, and for readers without a script.
    narrow = "" if numbers else svg_uri(plate.draw(wide=False, png=False).svg)
    return Picture(plate.name, plate.title, plate.caption, svg_uri(wide), narrow, numbers, _is_tall(wide))


def _is_tall(svg: str) -> bool:
    """Return whether a drawing as wide as a sheet takes more than half of it, and stays legible in a half."""
    box = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', svg)
    return box is not None and _HALF_SHEET < float(box[2]) / max(float(box[1]), _WIDE_PT) < _LEGIBLE


BULLETS = 3
"""Sentences of an answer that stand above its first figure."""
_PATH_DATA = re.compile(r' d="[^"]*"')
_TAG = re.compile(r"<[^>]*>")
_NOT_AS_IS = re.compile(r"[^!$'()*+,\-./0-9:;=?@A-Z_a-z~]")  # of an address, in double quotes, in a list of addresses


def svg_uri(svg: str) -> str:
    """Return a drawing as an address that holds it, an eighth smaller than in base64; safe in an attribute."""
    from markupsafe import Markup

    text = _PATH_DATA.sub(lambda data: data[0][0] + data[0][1:].replace(" ", ","), svg)
    text = _TAG.sub(lambda tag: tag[0].replace("'", "&#39;").replace('"', "'"), text)
    text = _NOT_AS_IS.sub(lambda letter: quote(letter[0]), text)
    return Markup("data:image/svg+xml," + text)  # it holds no <, >, & or double quote


def data_uri(image: bytes, kind: str) -> str:
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
    # The one script of a page: named by its hash, so that no other runs, not even one smuggled in by a text.
    out.globals.update(script_of=lambda *of: Markup(_script(*of)), hash_of=lambda *of: Markup(_hash(*of)))
    out.globals.update(first_screen=first_screen, notes_of=notes_of, advice_lines=advice_lines)
    out.globals.update(plot_style=Markup((_UPLOT / "uPlot.min.css").read_text(encoding="utf-8")))
    out.filters.update(sentence=sentence, typeset=typeset, breakable=_breakable)
    return out


def _breakable(text: str) -> str:
    """Return a text of a cell, escaped, whose long names may break behind an underscore, a point or a stroke."""
    from markupsafe import Markup, escape

    words = (re.sub(r"(?<=[_./])(?=[\w])", "\0", w) if len(w) > LONGEST_WORD else w for w in text.split(" "))
    return Markup(escape(" ".join(words)).replace("\0", Markup("<wbr>")))


@lru_cache(maxsize=3)
def _script(live: bool, more: tuple[Path, ...] = ()) -> str:
    """Return the script of a page: of its tables, if ``live`` of figures that are explored, with uPlot, and more."""
    own = [_TEMPLATES / name for name in ("sort.js", "page.js", *(["explore.js"] if live else []))]
    parts = [file.read_text(encoding="utf-8") for file in (*own, *more)]
    if live:
        licence = (_UPLOT / "LICENSE").read_text(encoding="utf-8")
        parts = [f"/* uPlot\n{licence}*/", (_UPLOT / "uPlot.iife.min.js").read_text(encoding="utf-8"), *parts]
    return "\n".join(parts)


def _hash(*of: Any) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(_script(*of).encode()).digest()).decode()}"


def first_screen(answer: Answer) -> tuple[list[Line], list[Line]]:
    """Return the lines of an answer that stand above its figure and those that fold below them, without notes.

    Above stand the first :data:`BULLETS` sentences, cut to their first clauses if they are long, with the first that
    says "do not use" among them; the page says how many of the others are doubts.
    """
    lines = [line for line in answer_lines(answer) if line.kind != "note"]
    above = set(range(min(BULLETS, len(lines))))
    worst = next((k for k, line in enumerate(lines) if line.kind == "wrong"), 0)
    if worst >= BULLETS:
        above = {*range(BULLETS - 1), worst}
    shown, folded = [], []
    for k, (kind, text) in enumerate(lines):
        first, rest = brief(text) if k in above else ("", text)
        shown += [Line(kind, first)] if first else []
        folded += [Line("finding" if kind == "lead" else kind, rest)] if rest else []
    return shown, folded


def notes_of(answer: Answer) -> list[str]:
    """Return the notes of an answer."""
    return [line.text for line in answer_lines(answer) if line.kind == "note"]


def render(template: str, live: bool = False, scripts: Sequence[Path] = (), **context: Any) -> str:
    """Return the page made from ``templates/template``; text is escaped, and a name that is not given raises.

    ``live`` gives it the script of figures that are explored, ``scripts`` those of its own.

    Pages of questions extend ``page.html.j2``; others ``base.html.j2``, which holds the style, the script that sorts
    tables, and the macros ``show_table``, ``show_picture``, ``show_answer``, ``show_facts`` and ``show_section``.
    """
    return _environment().get_template(template).render(live=live, scripts=tuple(scripts), **context)


_SYMBOL = re.compile(r"([A-Za-z]+?)(dot)?(?:_(\w+|\([^)]*\)))?(?:\^(-?\w+|\([^)]*\)))?(?![A-Za-z_])")


def _equation(text: str) -> str:
    """Return equations that were written in letters as on paper: ω_n for wn, α with its dot, sub- and superscripts."""
    greek = {word: sign for sign, word in PLAIN.items() if len(word) > 1 and word.isalpha()}
    names = {word: f"<i>{sign}</i>" for word, sign in greek.items()}
    names |= {"wn": "<i>ω</i><sub>n</sub>", "wd": "<i>ω</i><sub>d</sub>", "sqrt": "√"}

    def shown(found: re.Match[str]) -> str:
        word, dot, below, above = found.groups()
        out = names.get(word, f"<i>{word}</i>" if len(word) == 1 or below else word)
        out = out.replace("</i>", "\u0307</i>") if dot else out
        out += f"<sub>{greek.get(below, below)}</sub>" if below else ""
        return out + (f"<sup>{above.replace('-', '−')}</sup>" if above else "")

    safe = text.replace("<=", "≤").replace(">=", "≥").replace(" - ", " − ").replace("(-", "(−").replace("= -", "= −")
    return "".join(
        _SYMBOL.sub(shown, part) if k % 2 == 0 else {"<": "&lt;", ">": "&gt;", "&": "&amp;"}[part]
        for k, part in enumerate(re.split("([<>&])", safe))
    )


def _indented(reader: Any, tokens: Sequence[Any], k: int, *rest: Any) -> str:
    return f'<pre class="equation">{_equation(tokens[k].content)}</pre>'


def text_page(kicker: str, text: str) -> str:
    """Return Markdown as one HTML file that fetches nothing; its first heading is the title.

    Indented lines are equations, written as on paper; code stands between fences. HTML in the text is shown as it
    stands, and links that run code are no links.

    Args:
        kicker: above the title: what it is.
        text: Markdown (CommonMark with tables) that begins with a heading.
    """
    from markdown_it import MarkdownIt
    from markupsafe import Markup

    first, _, rest = text.lstrip().partition("\n")
    reader = MarkdownIt("commonmark", {"html": False}).enable("table")
    reader.add_render_rule("code_block", _indented)
    body, *parts = reader.render(rest).split("<table>")
    for k, part in enumerate(parts, start=1):
        body += f'<figure class="table"><div class="scroll" tabindex="0" role="region" aria-label="table {k}"><table>'
        body += part.replace("</table>", "</table></div></figure>")
    return render("text.html.j2", kicker=kicker, title=first.lstrip("# ").strip(), body=Markup(body))
