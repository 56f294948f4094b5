"""HTML pages: one self-contained file each, from the templates beside this module."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment

    from testbench.pipeline import RunResult
    from testbench.report.plot import Plate

_TEMPLATES = Path(__file__).resolve().parent / "templates"


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

    return Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


def render(template: str, **context: Any) -> str:
    """Return the page made from ``templates/template``; text is escaped, and a name that is not given raises.

    Pages extend ``base.html.j2``, which holds the style and the macros ``show_table`` and ``show_picture``.
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
        answer=answer_lines(result),
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
