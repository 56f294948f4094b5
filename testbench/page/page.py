"""Page: the answer to a question, written to a folder and shown on a terminal in one way for all."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testbench.core.door import read_text
from testbench.core.files import write_file
from testbench.core.store import PAGE, ResultFolder
from testbench.page.flown import flown_table, flown_words
from testbench.page.labels import file_stem
from testbench.page.terminal import manner, print_answer, print_table
from testbench.page.words import Answer, answer_lines, sentence

if TYPE_CHECKING:
    from rich.console import Console

    from testbench.core.record import FlightRecord
    from testbench.core.scenario.base import Asked
    from testbench.flight.batch.jobs import Tally
    from testbench.line import Keep
    from testbench.page.figure import Plate
    from testbench.page.html import Picture
    from testbench.page.tables import Table


COMPUTED = ("numpy", "scipy")
FLOWN = (*COMPUTED, "jsbsim")
MOST_LINES, _LEAST_LINES = 20, 5  # of what a terminal shows of a page; of the answer, however long the tables are
Content = str | bytes | Callable[[Path], Any]
"""Of a file beside the page: what it holds, or what writes it to a path."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Page:
    """The answer to one question."""

    kicker: str  # above the title: which question it is, and of what
    title: str  # for people
    answer: Answer  # sentences, or (kind, sentence); the most important first. Capital and full stop are added.
    question: str = ""  # in words, as it was asked; "" if it was not
    heading: str = "The answer"  # of the answer
    tables: Sequence[Table] = ()  # on the page, and as tables/NAME.csv and .json
    more_tables: Sequence[Table] = ()  # written, but shown only if the template does so
    plates: Sequence[Plate] = ()  # figures; the first stands with the answer
    # path in the folder -> what it holds, or a function that writes it
    files: Mapping[str, Content] = field(default_factory=dict)
    # writes what is best made together into the folder, and returns the paths
    more_files: Callable[[Path], Sequence[Path]] = lambda folder: ()
    # of the page; extends "page.html.j2", which shows all this and has blocks for what a question adds
    template: str = "page.html.j2"
    # what a template of a question needs beside the page itself
    context: Mapping[str, Any] = field(default_factory=dict)
    asked: Sequence[tuple[str, str]] = ()  # (what, value) of the section "What was asked"
    packages: Sequence[str] = FLOWN  # those whose versions decide the figures; see COMPUTED and FLOWN
    provenance: Sequence[tuple[str, str]] = ()  # (what, value) of all else that decides them, such as the seed
    # by what flights of many were flown; None if there were none. The page and the terminal say it, and
    # tables/flown.csv and .json.
    flown: Tally | None = None
    source: tuple[str, str] | None = None  # name and text of the scenario file; None if there was none
    terminal: Sequence[Table] = ()  # tables that a terminal shows
    notes: Sequence[str] = ()  # sentences that a terminal shows below the tables
    # (what, text) of the last lines on a terminal; "{}" in a text is the folder
    closing: Sequence[tuple[str, str]] = ()

    @property
    def all_tables(self) -> list[Table]:
        """Every table that the page shows or that lies beside it; none twice."""
        return list({t.name: t for t in (*self.tables, *self.more_tables, *self._by)}.values())

    @property
    def _by(self) -> list[Table]:
        return [] if self.flown is None else [flown_table(self.flown)]

    def to_dict(self) -> dict[str, Any]:
        """Return title, question, answer (kind and text of each sentence), tables by name and notes as JSON values."""
        return {
            "title": self.title,
            "question": self.question,
            "answer": [line._asdict() for line in answer_lines(self.answer)],
            "tables": {table.name: table.to_dict() for table in self.all_tables},
            "notes": [sentence(note) for note in self.notes],
        }

    def excerpt(self) -> str:
        """Return title, answer, key tables and the first figure as a piece of HTML, for a notebook."""
        from testbench.page.html import render, svg_uri

        lines = [line for line in answer_lines(self.answer) if line.kind != "note"]
        drawn = svg_uri(self.plates[0].draw(png=False).svg) if self.plates else ""
        return render("excerpt.html.j2", page=self, lines=lines, picture=drawn)

    def write(self, folder: Path | str | ResultFolder) -> list[Path]:
        """Write tables, figures, the files beside the page and report.html; return the paths, the page last.

        Args:
            folder: where the page goes, in the place of what an older one wrote; or a folder that is being written, of
                which the page becomes a part.

        Raises:
            WriteError: the folder cannot be written to.
        """
        if isinstance(folder, ResultFolder):
            made = [path.relative_to(folder.new) for path in self._write_into(folder.new)]
            return [folder.path / path for path in made]
        with ResultFolder(folder) as place:
            return self.write(place)

    def _write_into(self, folder: Path) -> list[Path]:
        """Write all of the page into a folder; return the paths, the page last."""
        out = write_tables([*self.more_tables, *self.tables, *self._by], folder)
        for name, content in self.files.items():
            if callable(content):
                content(folder / name)
            else:
                write_file(folder / name, content)
            out.append(folder / name)
        out += self.more_files(folder)
        paths, pictures = write_plates(self.plates, folder)
        return [*out, *paths, write_file(folder / PAGE, self.html(pictures))]

    def html(self, pictures: Sequence[Picture]) -> str:
        """Return the page as one HTML file that fetches nothing, with the figures already drawn."""
        from testbench.page.html import render

        made_by = [*versions(self.packages), *self.provenance]
        if self.flown is not None:
            made_by.append(("flights", flown_words(self.flown)))
        live = any(picture.explore for picture in pictures)
        return render(self.template, live, page=self, pictures=pictures, made_by=made_by, **self.context)

    def show(self, console: Console, folder: Path | str | None = None) -> None:
        """Print title, answer, tables and notes; where the page is, if it was written to ``folder``.

        All of it takes at most :data:`MOST_LINES` lines where the tables leave room: sentences are cut to their first
        clauses, and those that do not fit are counted. :func:`testbench.page.terminal.manner` may be another.
        """
        from rich.text import Text

        from testbench.core.project import remember

        if folder is not None:
            remember(folder, next((line.text for line in answer_lines(self.answer)), ""))
        how = manner().how
        places = [(what, text.format(folder)) for what, text in (("Report", f"{{}}/{PAGE}"), *self.closing)]
        if how == "json":
            manner().content.update(self.to_dict(), **({"places": dict(places)} if folder is not None else {}))
            return
        console.print(Text(self.title, style="bold underline"))
        with console.capture() as below:
            self._show_below(console, how, places if folder is not None else ())
        room = {"quiet": 0, "verbose": None}.get(how, max(_LEAST_LINES, MOST_LINES - 1 - below.get().count("\n")))
        print_answer(console, self.answer, room)
        self._show_below(console, how, places if folder is not None else ())

    def _show_below(self, console: Console, how: str, places: Sequence[tuple[str, str]]) -> None:
        """Print what stands below the answer: tables and notes unless "quiet", and where the page is."""
        from rich.text import Text

        notes = [*self.notes, *([] if self.flown is None else [flown_words(self.flown)])]
        if how != "quiet":
            for table in self.terminal:
                console.print()
                print_table(console, table)
            if notes:
                console.print()
            for note in notes:
                console.print(Text(sentence(note), style="dim"))
        if places:
            console.print()
        for what, text in places:
            console.print(Text(f"{what}: {text}"), soft_wrap=True)


def source_of(asked: Asked) -> tuple[str, str]:
    """Return name and text of the file of a question; if it has no file, all its values as JSON."""
    if asked.file is not None and asked.file.is_file():
        return asked.file.name, read_text(asked.file, "scenario")
    return "as given", str(asked.model_dump_json(indent=1))


def versions(packages: Sequence[str] = FLOWN) -> list[tuple[str, str]]:
    """Return (name, version) of the testbench and of packages that decide its figures."""
    from importlib.metadata import version

    from testbench import __version__

    return [("flight-testbench", __version__), *((name, version(name)) for name in packages)]


# --- files of a folder ------------------------------------------------------------------------------------------------


def record_keeper(place: ResultFolder) -> Keep:
    """Return a function that saves each record as records/NAME.nc of a result, for ``run(keep=...)``."""

    def keep(name: str, record: FlightRecord) -> None:
        """Save one record under its name."""
        record.save(place.new / "records" / f"{file_stem(name)}.nc")

    return keep


def write_tables(tables: Iterable[Table], folder: Path) -> list[Path]:
    """Write each table as folder/tables/NAME.csv and NAME.json; return the paths."""
    out = []
    for table in tables:
        stem = file_stem(table.name)
        out.append(write_file(folder / "tables" / f"{stem}.csv", table.to_csv()))
        out.append(write_file(folder / "tables" / f"{stem}.json", table.to_json()))
    return out


def write_plates(plates: Iterable[Plate], folder: Path) -> tuple[list[Path], list[Picture]]:
    """Write each plate as folder/figures/NAME.png, return the paths and the pictures for a page.

    Within :func:`testbench.page.publish.published` they are written as it asks, with their data beside them.
    """
    from testbench.page.html import picture
    from testbench.page.publish import asked, publish

    how = asked()
    paths, pictures = [], []
    for plate in plates:
        if how is not None:
            paths += publish(plate, folder / "figures", how)
            pictures.append(picture(plate))
            continue
        drawing = plate.draw()
        paths.append(write_file(folder / "figures" / f"{file_stem(plate.name)}.png", drawing.png))
        pictures.append(picture(plate, drawing.svg))
    return paths, pictures


def json_text(content: Mapping[str, Any]) -> str:
    """Return a model or another set of named values as the text of a JSON file; infinite numbers are refused."""
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
