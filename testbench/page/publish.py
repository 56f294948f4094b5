"""Figures for a paper: the file formats, the width of a column, a style of the reader's own, text set by LaTeX.

What is asked for holds within :func:`published`, and :func:`testbench.page.write.write_plates` obeys it. The page
itself is drawn as always.
"""

from __future__ import annotations

import contextlib
import io
import logging
from collections.abc import Generator, Mapping
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testbench.core.errors import EstimationError, RecordError
from testbench.core.files import reason_of, write_file
from testbench.page.labels import file_stem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from testbench.page.plot import Plate

FORMATS = ("pdf", "svg", "png")
SINGLE_IN, DOUBLE_IN = 3.5, 7.16  # of the IEEE's journals; a style's figure.figsize says another width
PRINT_DPI = 300
_LEAST_IN, _MOST_IN = 3.0, 20.0  # widths in which the panels have room
_METADATA: dict[str, dict[str, None]] = {
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "svg": {"Date": None, "Creator": None},
    "png": {"Software": None},
}


@dataclass(frozen=True)
class Publication:
    """How figures are written for a paper.

    Attributes:
        formats: of :data:`FORMATS`.
        double: over two columns, panels side by side; else one column, panels below each other.
        style: a matplotlib style file, laid over the house's style; None for the house's alone.
        latex: text is set by LaTeX.
    """

    formats: tuple[str, ...]
    double: bool = True
    style: Path | None = None
    latex: bool = False

    def settings(self) -> dict[str, Any]:
        """Return matplotlib's settings: those of the house, then of the style file, then of LaTeX.

        Raises:
            RecordError: the style file is missing, or matplotlib does not take a line of it.
            MissingPackage: LaTeX is asked for and not found.
        """
        from testbench.page.latex import PREAMBLE, find_latex
        from testbench.page.plot import style

        out = {**style(), "pdf.fonttype": 42, "savefig.dpi": PRINT_DPI}  # 42: journals refuse Type 3 fonts
        if self.style is not None:
            out |= read_style(self.style)
        if self.latex or out.get("text.usetex"):
            find_latex(self.formats)
            out |= {"text.usetex": True, "text.latex.preamble": PREAMBLE + str(out.get("text.latex.preamble", ""))}
        return out

    def width_in(self) -> float:
        """Return the width of a figure, in: of the column, or what the style file says as figure.figsize.

        Raises:
            RecordError: the style file is bad, or its width leaves panels no room.
        """
        found = {} if self.style is None else read_style(self.style)
        width = float(found.get("figure.figsize", (DOUBLE_IN if self.double else SINGLE_IN, 0.0))[0])
        if not _LEAST_IN <= width <= _MOST_IN:
            raise RecordError(
                f"a figure must be from {_LEAST_IN:g} to {_MOST_IN:g} in wide, got {width:g} in '{self.style}'; change "
                "figure.figsize, or leave it out for the width of the column"
            )
        return width


_ASKED: ContextVar[Publication | None] = ContextVar("publication", default=None)


def asked() -> Publication | None:
    """Return how figures are to be written here; None for the PNG that stands beside every page."""
    return _ASKED.get()


@contextlib.contextmanager
def published(publication: Publication | None) -> Generator[None]:
    """Write figures as a publication asks within the block.

    Raises:
        RecordError: see :meth:`Publication.settings`; before anything is flown.
        MissingPackage: LaTeX is asked for and not found.
    """
    if publication is not None:
        publication.settings()
        publication.width_in()
    token = _ASKED.set(publication)
    try:
        yield
    finally:
        _ASKED.reset(token)


def read_style(file: Path) -> dict[str, Any]:
    """Return the settings of a matplotlib style file, those alone that it names.

    Raises:
        RecordError: it cannot be read, or matplotlib does not take a line of it, of which it only warns.
    """
    from matplotlib import rc_params_from_file

    law = "a style must be a file of matplotlib's settings, a line each such as 'font.size: 8',"
    if not file.is_file():
        raise RecordError(f"{law} got '{file}', which is no file; see --style")
    told = _Told()
    log = logging.getLogger("matplotlib")
    heard = log.propagate
    log.addHandler(told)
    log.propagate = False
    try:
        read: Any = rc_params_from_file(file, use_default_template=False)
        out: dict[str, Any] = dict(read)
    except Exception as error:
        raise RecordError(f"{law} got '{file}': {reason_of(error)}") from error
    finally:
        log.removeHandler(told)
        log.propagate = heard
    if told.lines:
        raise RecordError(f"{law} got '{file}': {told.lines[0]}; mend or remove the line")
    if not out:
        raise RecordError(f"{law} got '{file}', which has none")
    return out


class _Told(logging.Handler):
    """Keeps what matplotlib warns of while it reads a style."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a warning as one line."""
        self.lines.append(" ".join(record.getMessage().split()).split(" You probably need")[0])


def publish(plate: Plate, folder: Path, how: Publication) -> list[Path]:
    """Write a figure in each format, its data as NAME.csv and NAME.py, which draws it from them; return the paths.

    Raises:
        WriteError: the folder cannot be written to.
        EstimationError: LaTeX fails at a text.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from testbench.page.figure_data import csv_of, curves_of, maps_of, script_of
    from testbench.page.latex import set_by_latex
    from testbench.page.plot import of_width

    stem, settings = file_stem(plate.name), how.settings()
    told: Any = settings  # matplotlib types its keys one by one
    with rc_context(told), of_width(how.width_in()):
        figure = plate.make(how.double)
        FigureCanvasAgg(figure)
        _recolour(figure, settings)
        curves = curves_of(figure)
        texts = {".csv": csv_of(figure, curves), ".py": script_of(figure, curves, stem)}
        maps = {file.removeprefix(stem): text for _, file, _, text in maps_of(figure, stem)}
        if settings.get("text.usetex"):
            set_by_latex(figure)
        made = {f".{name}": _bytes(figure, name, plate.name) for name in how.formats}
    files: dict[str, str | bytes] = {**made, **texts, **maps}
    return [write_file(folder / f"{stem}{end}", content) for end, content in files.items()]


def _recolour(figure: Figure, settings: Mapping[str, Any]) -> None:
    """Draw what has the house's colours of curves in those of a style's axes.prop_cycle, if it has one."""
    from matplotlib.colors import to_hex, to_rgba_array

    from testbench.page.plot import COLOURS

    cycle = settings["axes.prop_cycle"].by_key().get("color", ()) if "axes.prop_cycle" in settings else ()
    if not cycle:
        return
    swap = {colour.lower(): cycle[k % len(cycle)] for k, colour in enumerate(COLOURS)}
    for artist in figure.findobj():
        for name in ("color", "facecolor", "edgecolor", "markerfacecolor", "markeredgecolor"):
            found = getattr(artist, f"get_{name}", lambda: None)()
            if found is None or not hasattr(artist, f"set_{name}"):
                continue
            rows = to_rgba_array(found)
            if any(to_hex(row) in swap and row[3] > 0.0 for row in rows):
                new = [swap.get(to_hex(row), to_hex(row)) if row[3] > 0.0 else "none" for row in rows]
                getattr(artist, f"set_{name}")(new[0] if len(new) == 1 else new)


def _bytes(figure: Figure, name: str, of: str) -> bytes:
    """Return a figure in a format; the same bytes for the same figure."""
    out = io.BytesIO()
    try:
        figure.savefig(out, format=name, metadata=_METADATA[name])
    except RuntimeError as error:
        if "latex" not in str(error).lower():
            raise
        raise EstimationError(
            f"LaTeX must set every text of a figure, it failed at '{of}': {reason_of(error)}; leave out --latex, or "
            "install the LaTeX package that it names"
        ) from error
    return out.getvalue()
