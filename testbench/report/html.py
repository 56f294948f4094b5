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

from testbench.channels import CHANNELS

if TYPE_CHECKING:
    from jinja2 import Environment

    from testbench.report.plot import Plate
    from testbench.results import RunResult

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
        loader=FileSystemLoader(_TEMPLATES),
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


def report_page(result: RunResult, pictures: list[Picture]) -> str:
    """Return the report of a run as one HTML page that fetches nothing."""
    from testbench.report.answer import answer_lines
    from testbench.report.flown_tables import flown_tables
    from testbench.report.labels import case_names
    from testbench.report.tables import result_tables

    return render(
        "report.html.j2",
        result=result,
        simulated=result.truth is not None,
        answer=[(line.kind, line.text) for line in answer_lines(result)],
        flown=flown_tables(result),
        pictures=pictures,
        tables=result_tables(result),
        models=list(zip(case_names(result.cases), result.cases, strict=True)),
        provenance=provenance(result),
        source_name=result.source.file.name if result.source.file else "as given",
        source_text=source_text(result),
    )


def provenance(result: RunResult) -> list[tuple[str, str]]:
    """Return (what, value) of all that decides the figures: versions, seed, and what the records say of themselves."""
    from importlib.metadata import version

    from testbench import __version__

    out = [("flight-testbench", __version__)]
    packages = ("numpy", "scipy", *(("jsbsim",) if result.truth is not None else ()))
    out += [(name, version(name)) for name in packages]
    out.append(("seed", str(result.seed) if result.truth is not None else "none: recorded data"))
    for flight in result.flights:
        record = flight.truth if flight.truth is not None else next(iter(flight.measured.values()))
        said = ", ".join(f"{k} {v}" for k, v in sorted(record.provenance.items()) if v not in ([], "", None))
        out.append((f"record {flight.name}", said or "no provenance"))
    return out


def source_text(result: RunResult) -> str:
    """Return the scenario or description as it stands in its file, else as JSON."""
    if result.source.file is not None and result.source.file.is_file():
        return result.source.file.read_text(encoding="utf-8")
    return str(result.source.model_dump_json(indent=1))
