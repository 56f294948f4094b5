"""Results that show themselves: in a notebook, as tables of pandas, as figures, as JSON, as a folder with a page."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from testbench.core.errors import RecordError, nearest

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from testbench.page.page import Page


class Shown:
    """What a question found, which shows what the page of the question shows.

    A subclass names what makes its page: ``class RunResult(Shown, page="testbench.questions.run.page:run_page")``.
    """

    _page_by: ClassVar[str] = ""

    def __init_subclass__(cls, page: str = "", **more: Any) -> None:
        super().__init_subclass__(**more)
        if page:
            cls._page_by = page

    @property
    def page(self) -> Page:
        """The page of the result: its answer, tables and figures; made anew each time."""
        module, name = self._page_by.split(":")  # by name: a page knows its result
        made: Page = getattr(import_module(module), name)(self)
        return made

    def to_pandas(self, table: str = "") -> pd.DataFrame:
        """Return one of the tables of the page, with the units of its columns in their names; the first if not named.

        Raises:
            RecordError: there is no table of that name; the message has the names.
        """
        tables = {t.name: t for t in self.page.all_tables}
        return _named("table", tables, table).to_pandas()

    def plot(self, figure: str = "") -> Figure:
        """Return one of the figures of the page, drawn by matplotlib; the first if not named.

        Raises:
            RecordError: there is no figure of that name; the message has the names.
        """
        return _named("figure", {p.name: p for p in self.page.plates}, figure).make()

    def to_dict(self) -> dict[str, Any]:
        """Return title, question, answer and tables as JSON values, as ``--json`` of the command line prints them."""
        return self.page.to_dict()

    def _repr_html_(self) -> str:
        """Return the answer, the tables and the first figure of the page, as a notebook shows them."""
        return self.page.excerpt()


def _named(what: str, held: dict[str, Any], name: str) -> Any:
    if not held:
        raise RecordError(f"the page of this result must have a {what}, but it has none")
    if name and name not in held:
        raise RecordError(f"a {what} must be one that the page has, got '{name}'{nearest(name, held)}")
    return held[name or next(iter(held))]


def write_results(result: Shown, folder: Path | str) -> list[Path]:
    """Write tables, models, figures and report.html of a result into a folder; return the paths, the page last.

    Raises:
        WriteError: the folder cannot be written to.

    Example:
        >>> import testbench as tb
        >>> tb.write_results(tb.run("eolo_alpha"), "results/eolo_alpha")  # doctest: +SKIP
    """
    return result.page.write(folder)
