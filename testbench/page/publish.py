"""Figures for a paper: the file formats, the width of a column, a style of the reader's own, text set by LaTeX, data.

What is asked for holds within :func:`published`, and :func:`testbench.page.page.write_plates` obeys it. The page
itself is drawn as always.
"""

from __future__ import annotations

import contextlib
import csv
import io
import logging
import shutil
from collections.abc import Generator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from pprint import pformat
from typing import TYPE_CHECKING, Any

from testbench.core.errors import EstimationError, MissingPackage, RecordError
from testbench.core.escape import csv_cell, one_line, python_docstring
from testbench.core.files import reason_of, write_file
from testbench.page.labels import file_stem

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from testbench.page.figure import Panel, Plate


PREAMBLE = r"\usepackage[T1]{fontenc}\usepackage{textcomp}\usepackage{amsmath}\usepackage{amssymb}"
_GREEK = {
    "α": "alpha", "β": "beta", "γ": "gamma", "δ": "delta", "ε": "varepsilon", "ζ": "zeta", "η": "eta",
    "θ": "theta", "κ": "kappa", "λ": "lambda", "μ": "mu", "ν": "nu", "ξ": "xi", "π": "pi", "ρ": "rho", "σ": "sigma",
    "τ": "tau", "φ": "phi", "χ": "chi", "ψ": "psi", "ω": "omega", "Γ": "Gamma", "Δ": "Delta", "Θ": "Theta",
    "Λ": "Lambda", "Σ": "Sigma", "Φ": "Phi", "Ψ": "Psi", "Ω": "Omega", "µ": "mu", "×": "times", "·": "cdot", "±": "pm",
    "≤": "leq", "≥": "geq", "≈": "approx", "→": "rightarrow", "∞": "infty", "√": "surd", "≠": "neq", "−": "-",
}  # fmt: skip
_PLAIN = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "%": r"\%", "_": r"\_", "&": r"\&", "#": r"\#", "$": r"\$",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
    "|": r"\textbar{}", '"': r"\textquotedbl{}", "°": r"\textdegree{}", "…": r"\ldots{}", "–": "--", "—": "---",
    "\N{NO-BREAK SPACE}": "~", "’": "'",
}  # fmt: skip
_RAISED = dict(zip("⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺", "0123456789-+", strict=True))
_LOWERED = dict(zip("₀₁₂₃₄₅₆₇₈₉", "0123456789", strict=True))
_ACCENTS = {"\N{COMBINING DOT ABOVE}": "dot", "\N{COMBINING CIRCUMFLEX ACCENT}": "hat", "\N{COMBINING MACRON}": "bar"}
FORMATS = ("pdf", "svg", "png")
SINGLE_IN, DOUBLE_IN = 3.5, 7.16  # of the IEEE's journals; a style's figure.figsize says another width
PRINT_DPI = 300
_LEAST_IN, _MOST_IN = 3.0, 20.0  # widths in which the panels have room
_TITLE_IN = 0.2
_METADATA: dict[str, dict[str, None]] = {
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "svg": {"Date": None, "Creator": None},
    "png": {"Software": None},
}


@dataclass(frozen=True)
class Publication:
    """How figures are written for a paper."""

    formats: tuple[str, ...]  # of :data:`FORMATS`
    double: bool = True  # over two columns, panels side by side; else one column, panels below each other
    style: Path | None = None  # a matplotlib style file, laid over the house's style; None for the house's alone
    latex: bool = False  # text is set by LaTeX

    def settings(self) -> dict[str, Any]:
        """Return matplotlib's settings: those of the house, then of the style file, then of LaTeX.

        Raises:
            RecordError: the style file is missing, or matplotlib does not take a line of it.
            MissingPackage: LaTeX is asked for and not found.
        """
        from testbench.page.draw import style

        out = {**style(), "savefig.dpi": PRINT_DPI}
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

    from testbench.page.draw import styled
    from testbench.page.figure import COLOURS, of_width, recoloured

    stem, settings = file_stem(plate.name), how.settings()
    cycle = settings["axes.prop_cycle"].by_key().get("color", ()) if "axes.prop_cycle" in settings else ()
    swap = {colour: _hex(cycle[k % len(cycle)]) for k, colour in enumerate(COLOURS)} if cycle else {}
    told: Any = settings  # matplotlib types its keys one by one
    with rc_context(told), of_width(how.width_in()):
        figure = styled(recoloured(plate.chart_of(how.double), swap), how.double, settings)
        texts = data_of(figure, stem)
        if settings.get("text.usetex"):
            set_by_latex(figure)
        made = {f".{name}": _bytes(figure, name, plate.name) for name in how.formats}
    files: dict[str, str | bytes] = {**made, **texts}
    return [write_file(folder / f"{stem}{end}", content) for end, content in files.items()]


def _hex(colour: str) -> str:
    from matplotlib.colors import to_hex

    return to_hex(colour)


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


# --- what a figure shows, as data, and a program that draws it from them ----------------------------------------------

_SCRIPT = '''\
"""Draws {name} again from {name}.csv: python {name}.py writes {name}_redrawn.png."""

import csv
from pathlib import Path

import matplotlib.pyplot as plt

HERE = Path(__file__).resolve()
plt.rcParams.update({{"font.size": 9, "axes.titlelocation": "left", "axes.titlesize": 9}})
SIZE_IN = {size}
PANELS = {panels}  # place in the figure, and settings of the axes
CURVES = {curves}  # panel, how it is drawn, and how it looks; in the order of the file's columns
MAPS = {maps}  # panel, file of its values, and how they are shown
figure = plt.figure(figsize=SIZE_IN)
panels = [figure.add_axes(place, **settings) for place, settings in PANELS]
with HERE.with_suffix(".csv").open(encoding="utf-8", newline="") as file:
    heads, *rows = csv.reader(file)
for k, (panel, how, look) in enumerate(CURVES):
    points = [(float(row[2 * k]), float(row[2 * k + 1])) for row in rows if row[2 * k]]
    getattr(panels[panel], how)(*zip(*points), **look)
for panel, file, settings in MAPS:
    values = [[float(v) for v in row] for row in csv.reader(HERE.with_name(file).open(encoding="utf-8"))]
    panels[panel].imshow(values, **settings)
for panel, (_, settings) in zip(panels, PANELS):
    panel.set(xlim=settings["xlim"], ylim=settings["ylim"])
    panel.xaxis.set_minor_formatter("")
    panel.yaxis.set_minor_formatter("")
if any("label" in look for _, _, look in CURVES):
    figure.legend(loc="lower left", bbox_to_anchor=(0, {above}), frameon=False)
figure.savefig(HERE.with_name(HERE.stem + "_redrawn.png"), dpi=150, bbox_inches="tight")
'''


def data_of(figure: Figure, name: str) -> dict[str, str]:
    """Return what a figure shows: end of a file's name -> text.

    ".csv" has two columns for each curve: x and y, under "PANEL.CURVE label of the axis", that of y followed by the
    panel's title and the curve's name. It holds what is drawn: long records are drawn by their envelopes, and the
    records themselves hold every sample. "_map_1.csv" has the values of the first image. ".py" is a program that draws
    all of it again; it needs matplotlib alone.
    """
    from testbench.page.draw import artists
    from testbench.page.figure import Image

    heads, columns, looks, maps, panels = list[str](), list[list[str]](), list[Any](), list[Any](), list[Any]()
    out: dict[str, str] = {}
    open_names = {str(text.get_text()) for legend in figure.legends for text in legend.get_texts()}
    shown: list[tuple[Panel, Axes]] = figure.panels  # type: ignore[attr-defined]
    for k, (panel, axes) in enumerate(shown):
        place = tuple(round(float(v), 4) for v in axes.get_position().bounds)
        panels.append((place, _settings(panel, axes)))
        for i, a in enumerate(artists(panel, (axes.get_xlim(), axes.get_ylim())), 1):
            heads.append(f"{k + 1}.{i} {panel.x or 'x'}")
            heads.append(" | ".join(filter(None, (f"{k + 1}.{i} {panel.y or panel.name or 'y'}", panel.title, a.name))))
            columns += [[f"{value:.10g}" for value in values] for values in (a.x, a.y)]
            named = {"label": a.name} if a.name in open_names else {}
            open_names -= {a.name}
            looks.append((k, a.how, {key: v for key, v in a.look.items() if v is not None} | named))
        for image, d in zip(axes.images, (d for d in panel.draws if isinstance(d, Image)), strict=True):
            end = f"_map_{len(maps) + 1}.csv"
            settings: dict[str, Any] = {"cmap": "Blues", "vmin": d.low, "vmax": d.high, "origin": "upper"}
            settings |= {"extent": tuple(float(v) for v in image.get_extent()), "aspect": "auto"}
            settings |= {"norm": "log"} if d.log else {}
            maps.append((k, name + end, settings))
            out[end] = "".join(",".join(f"{v:.10g}" for v in row) + "\n" for row in d.values)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([csv_cell(one_line(head)) for head in heads])
    writer.writerows(zip_longest(*columns, fillvalue=""))
    width, height = (round(float(v), 3) for v in figure.get_size_inches())
    above = max((place[1] + place[3] for place, _ in panels), default=1.0) + _TITLE_IN / height
    parts = [pformat(part, width=116, compact=True, sort_dicts=False) for part in (panels, looks, maps)]
    program = _SCRIPT.format(
        name=python_docstring(name),
        size=(width, height),
        panels=parts[0],
        curves=parts[1],
        maps=parts[2],
        above=round(above, 4),
    )
    return {".csv": text.getvalue(), ".py": program, **out}


def _settings(panel: Panel, axes: Axes) -> dict[str, Any]:
    """Return the settings of a panel that ``Figure.add_axes`` takes."""
    out: dict[str, Any] = {"title": panel.title, "xlabel": axes.get_xlabel(), "ylabel": axes.get_ylabel()}
    out["frame_on"] = not panel.bare
    ticks = {"x": [] if panel.bare else panel.x_ticks, "y": [] if panel.bare else panel.y_ticks}
    for which in "xy":
        out[f"{which}scale"] = str(getattr(axes, f"get_{which}scale")())
        out[f"{which}lim"] = tuple(float(f"{v:.6g}") for v in getattr(axes, f"get_{which}lim")())
        places = ticks[which]
        if places is not None:
            out[f"{which}ticks"] = [float(at) for at, _ in places]
            out[f"{which}ticklabels"] = [text for _, text in places]
    return out


# --- text set by LaTeX ------------------------------------------------------------------------------------------------


def find_latex(formats: Sequence[str]) -> None:
    """Check that what matplotlib needs to set text by LaTeX is installed.

    Raises:
        MissingPackage: a program is not found.
    """
    needed = ["latex", "kpsewhich", *(["dvipng"] if "png" in formats else [])]
    missing = [name for name in needed if shutil.which(name) is None]
    if missing:
        raise MissingPackage(
            f"LaTeX text in figures needs the programs {', '.join(needed)}, got no {' and no '.join(missing)}; install "
            "LaTeX (on Debian: apt install texlive-latex-extra cm-super dvipng), or leave out --latex"
        )


def latex_text(text: str) -> str:
    """Return a text of ours as LaTeX that reads the same: nothing in it is a command.

    Example:
        >>> latex_text("δe, % of 10⁻²")
        '$\\\\delta$e, \\\\% of 10$^{-2}$'
    """
    out: list[str] = []
    k = 0
    while k < len(text):
        letter = text[k]
        family = next((f for f in (_RAISED, _LOWERED) if letter in f), None)
        if family is not None:
            end = k
            while end < len(text) and text[end] in family:
                end += 1
            out.append(f"${'^' if family is _RAISED else '_'}{{{''.join(family[c] for c in text[k:end])}}}$")
            k = end
            continue
        accent = _ACCENTS.get(text[k + 1 : k + 2])
        maths = _GREEK.get(letter)
        maths = maths if maths in (None, "-") else f"\\{maths}"
        if accent is not None:
            out.append(f"$\\{accent}{{{maths or letter}}}$")
            k += 1
        else:
            out.append(_PLAIN.get(letter, letter) if maths is None else f"${maths}$")
        k += 1
    return "".join(out)


def set_by_latex(figure: Figure) -> None:
    """Make LaTeX of every text of a figure, and of those that its axes make of their ticks when they are drawn."""
    from matplotlib.text import Text

    ticks: set[int] = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter(_formatter(axis.get_major_formatter()))
            ticks |= {id(text) for tick in axis.get_major_ticks() for text in (tick.label1, tick.label2)}
    for text in {id(text): text for text in figure.findobj(Text)}.values():
        if id(text) not in ticks and isinstance(text, Text):
            text.set_text("\n".join(latex_text(line) for line in text.get_text().split("\n")))


def _formatter(inner: Any) -> Any:
    """Return a formatter of ticks that makes LaTeX of what another returns."""
    from matplotlib.ticker import Formatter

    class OfLatex(Formatter):
        """The other's labels, as LaTeX; numbers that matplotlib has set for LaTeX already stay."""

        def __call__(self, x: float, pos: int | None = None) -> str:
            return _tick(inner(x, pos))

        def format_ticks(self, values: Any) -> list[str]:
            return [_tick(text) for text in inner.format_ticks(values)]

        def set_locs(self, locs: Any) -> None:
            inner.set_locs(locs)

        def get_offset(self) -> str:
            return str(inner.get_offset())

    inner_axis = getattr(inner, "axis", None)
    out = OfLatex()
    if inner_axis is not None:
        out.set_axis(inner_axis)
    return out


def _tick(text: str) -> str:
    return text if "\\mathdefault" in text else latex_text(text)
