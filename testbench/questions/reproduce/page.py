"""Write a reproduction into a folder: tables, figures, one page, and the same in Markdown."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from testbench.core.escape import markdown_table
from testbench.core.files import write_file
from testbench.core.store import INDEX as PAGE
from testbench.core.store import ResultFolder
from testbench.page.figure import Plate
from testbench.page.html import Picture, data_uri, render, svg_uri
from testbench.page.labels import file_stem
from testbench.page.page import versions
from testbench.page.publish import asked, publish
from testbench.page.tables import Table
from testbench.page.terminal import print_answer
from testbench.questions.reproduce.section import LAWS, Chapter, Comparison, check_table, comparison_table, tally

if TYPE_CHECKING:
    from rich.console import Console

NOTES = "README.md"
PREFACE = (
    "No parameter was tuned to meet a printed figure, unless the row says so. The papers' figures were not at hand, "
    "only their text; a figure is redrawn from what the text says of it."
)
GROUPS = {
    "agrees": "Comes out",
    "agrees in kind": "Comes out in kind, with another number",
    "differs": "Does not come out",
    "cannot be compared": "Asked by the papers, answered here alone",
}
"""Verdict -> heading of its list on the first screen."""
_SHORT = 14  # letters of a number on the first screen
_COLOURS = 48  # of a figure's palette: lines and text need few, and files become a third of the size


def write_reproduction(chapters: Sequence[Chapter], place: ResultFolder) -> list[Path]:
    """Write tables/*.csv, figures/*.png, README.md and index.html; return where they are made, the page last.

    Raises:
        WriteError: the folder cannot be written to.
    """
    folder = place.new
    out: list[Path] = []
    how = asked()
    pictures: dict[str, Picture] = {}
    for chapter in chapters:
        out += [_write_table(table, folder) for table in (printed_table(chapter), checks_table(chapter))]
        for section in chapter.sections:
            out += [_write_table(table, folder) for table in section.tables]
            for plate in section.plates:
                wide = _palette(plate.draw().png)
                out.append(write_file(folder / "figures" / f"{file_stem(plate.name)}.png", wide))
                pictures[plate.name] = _picture(plate, wide)
                if how is not None:  # beside the PNG that README.md shows
                    out += [path for path in publish(plate, folder / "figures", how) if path not in out]
    out.append(write_file(folder / NOTES, markdown(chapters)))
    page = render(
        "questions/reproduce/page.html.j2",
        chapters=chapters,
        pictures=pictures,
        groups=groups(chapters),
        first=first_screen(chapters),
        shown=[pictures[p.name] for p in shown_first(chapters)],
        summary=summary(chapters),
        answers=answers(chapters),
        laws=LAWS,
        preface=PREFACE,
        versions=", ".join(f"{name} {version}" for name, version in versions()),
    )
    out.append(write_file(folder / PAGE, page))
    return out


def printed_table(chapter: Chapter) -> Table:
    """Return every printed number of a chapter beside ours."""
    return comparison_table(f"{chapter.name}_printed_and_ours", chapter.comparisons)


def checks_table(chapter: Chapter) -> Table:
    """Return every check of a chapter's printed numbers against each other."""
    return check_table(f"{chapter.name}_checks", [c for s in chapter.sections for c in s.checks])


def summary(chapters: Sequence[Chapter]) -> str:
    """Return in one sentence how many comparisons came out how."""
    rows = tuple(c for chapter in chapters for c in chapter.comparisons)
    return f"{len(rows)} numbers and statements of the papers stand beside ours: {tally(rows)}"


def first_screen(chapters: Sequence[Chapter]) -> list[str]:
    """Return the findings of the first screen, what alpha buys first; of chapters without one their first findings."""
    heads = [s.head for chapter in reversed(chapters) for s in chapter.sections if s.head]
    return heads or [s.findings[0] for chapter in chapters for s in chapter.sections][:3]


def shown_first(chapters: Sequence[Chapter]) -> list[Plate]:
    """Return the figure of the first screen: the first of the first finding's section."""
    plates = [s.plates[0] for chapter in reversed(chapters) for s in chapter.sections if s.head and s.plates]
    return plates[:1]


def groups(chapters: Sequence[Chapter]) -> list[tuple[str, str, list[tuple[str, str]]]]:
    """Return (verdict, heading, [(chapter, its headline results in one line)]) in the order of GROUPS."""
    out = []
    for verdict, heading in GROUPS.items():
        lines = []
        for chapter in chapters:
            found = [_brief(c) for c in chapter.comparisons if c.headline and c.verdict == verdict]
            if found:
                lines.append((chapter.title, "; ".join(found)))
        if lines:
            out.append((verdict, heading, lines))
    return out


def _brief(row: Comparison) -> str:
    """Return a headline result, with its two numbers where they are short."""
    ours = row.ours.split(" from rest")[0]
    numbers = f": {row.printed} printed, {ours} here" if len(ours) <= _SHORT and len(row.printed) <= _SHORT else ""
    return f"{row.what}{numbers} ({row.where})"


def answers(chapters: Sequence[Chapter]) -> list[tuple[str, str]]:
    """Return (title, first finding) of every section."""
    return [(section.title, section.findings[0]) for chapter in chapters for section in chapter.sections]


def print_reproduction(chapters: Sequence[Chapter], console: Console, folder: Path | str) -> None:
    """Print the answer, the number of comparisons with each verdict, and where the page is."""
    from rich.text import Text

    for chapter in chapters:
        console.print(Text(chapter.title, style="bold underline"))
        print_answer(console, [("finding", section.findings[0]) for section in chapter.sections])
        console.print(Text(f"Printed and ours: {tally(chapter.comparisons)}"))
        console.print()
    console.print(Text(f"Page: {Path(folder) / PAGE}"), soft_wrap=True)


def _write_table(table: Table, folder: Path) -> Path:
    """Write one table; nine figures of each number, since the last bits hang on how memory happens to lie."""
    rows = tuple(tuple(float(f"{v:.9g}") if isinstance(v, float) else v for v in row) for row in table.rows)
    return write_file(folder / "tables" / f"{file_stem(table.name)}.csv", replace(table, rows=rows).to_csv())


def _picture(plate: Plate, wide: bytes) -> Picture:
    narrow = plate.draw(wide=False)
    smallest = min(data_uri(_palette(narrow.png), "png"), svg_uri(narrow.svg), key=len)
    return Picture(plate.name, plate.title, plate.caption, data_uri(wide, "png"), smallest)


def _palette(png: bytes) -> bytes:
    """Return the image with a palette, which is a third of the size; the same bytes for the same image."""
    from PIL import Image

    small = io.BytesIO()
    with Image.open(io.BytesIO(png)) as image:
        image.convert("RGB").quantize(_COLOURS, method=Image.Quantize.MEDIANCUT).save(small, "png", optimize=True)
    return small.getvalue()


def markdown(chapters: Sequence[Chapter]) -> str:
    """Return first screen, findings, comparisons and tables of all chapters as Markdown, with links to the figures."""
    lines = ["# The papers' results, printed and reproduced", "", "Written by `testbench reproduce`.", ""]
    lines += [*(f"- {text}." for text in first_screen(chapters)), ""]
    for plate in shown_first(chapters):
        lines += [f"![{plate.title}](figures/{file_stem(plate.name)}.png)", ""]
    lines += [f"{summary(chapters)}.", ""]
    for _, heading, found in groups(chapters):
        lines += [f"**{heading}**", "", *(f"- {title}: {text}" for title, text in found), ""]
    lines += [LAWS, "", PREFACE, ""]
    for chapter in chapters:
        lines += [f"## {chapter.title}", "", chapter.source.strip(), "", f"{tally(chapter.comparisons)}.", ""]
        for section in chapter.sections:
            lines += [f"### {section.title}", "", *(f"- {f}." for f in section.findings), ""]
            for e in section.equations:
                lines += [f"- ({e.number}) `{e.text}` {e.words}"]
            lines += [""] if section.equations else []
            for table in section.heads:
                lines += [f"**{_titled(table.title)}** {table.caption}", "", *_markdown_table(table), ""]
            for plate in section.plates:
                lines += [
                    f"![{plate.title}](figures/{file_stem(plate.name)}.png)",
                    "",
                    f"{_titled(plate.title)} {plate.caption}",
                    "",
                ]
            for table in section.tables:
                lines += [f"**{_titled(table.title)}** {table.caption}", "", *_markdown_table(table), ""]
    return "\n".join(lines).rstrip() + "\n"


def _titled(title: str) -> str:
    return title if title.endswith("?") else f"{title}."


def _markdown_table(table: Table) -> list[str]:
    heads = []
    for c in table.columns:
        name = f"{c.group}: {c.head}" if c.group else c.head
        heads.append(name + (f", {c.unit}" if c.unit else ""))
    rule = ["---:" if right else "---" for right in table.numeric()]
    return markdown_table(heads, [[text for text, _ in row] for row in table.cells()], rule)
