"""A user's text on its way into a file of another language: one function each, so that nothing of it becomes code.

Names that come from files are one line already (core/schema.py); those given from Python, or in a model's JSON, need
not be. HTML is escaped by its templates, TOML by :func:`testbench.core.toml_text.quoted`, LaTeX by
:func:`testbench.page.latex.latex_text`; a literal of Python is ``repr``, a comment of one line
:func:`one_line`; names of files come from :func:`testbench.page.labels.file_stem`.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Sequence
from xml.sax.saxutils import escape, quoteattr

_NOT_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_NUMERIC = re.compile(r"[-+][\d.eE+\-±% ]*")


def one_line(text: str) -> str:
    """Return text as one line: each run of blanks, line ends and what cannot be printed becomes one blank."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def lua_comment(text: str) -> str:
    """Return text as it may follow ``-- `` in Lua: one line, and no bracket that would begin a comment of several."""
    return one_line(text).lstrip("[")


def python_docstring(text: str) -> str:
    """Return text as it may stand between three double quotes in Python: one line, neither end nor escape in it."""
    return one_line(text).replace("\\", "\\\\").replace('"', '\\"')


def xml_text(text: str) -> str:
    """Return text as the text of an element of XML; characters that XML does not have become blanks."""
    return escape(_NOT_XML.sub(" ", text))


def xml_attribute(text: str) -> str:
    """Return text as a value of an attribute of XML, in its quotes."""
    return quoteattr(_NOT_XML.sub(" ", text))


def xml_comment(text: str) -> str:
    """Return text as it may stand in a comment of XML: no two hyphens side by side, none at the end."""
    return re.sub(r"-(?=-)", "- ", one_line(text)).removesuffix("-")


def csv_cell(text: str) -> str:
    """Return text as a cell that a spreadsheet does not take for a formula: what begins as one gets an apostrophe.

    A lone carriage return, which Python's writer does not put in quotes, becomes a line end.
    """
    text = text.replace("\r", "\n") if "\r" in text and "\n" not in text else text
    formula = text[:1] in ("=", "@", "\t", "\r", "\n") or (text[:1] in ("+", "-") and not _NUMERIC.fullmatch(text))
    return f"'{text}" if formula else text


def shell_word(text: str) -> str:
    """Return text as one word of a command that is shown to be copied."""
    return shlex.quote(one_line(text))


def markdown_cell(text: str) -> str:
    """Return text as a cell of a table in Markdown: no end of the cell, no HTML; links and emphasis stay."""
    return re.sub(r"<(?=[A-Za-z/!?])", "&lt;", one_line(text).replace("\\", "\\\\").replace("|", "\\|"))


def markdown_table(
    heads: Sequence[object], rows: Iterable[Sequence[object]], rule: Sequence[str] | None = None
) -> list[str]:
    """Return the lines of a table in Markdown; ``rule`` says how columns are aligned, to the left if not given."""
    lines = [[markdown_cell(str(cell)) for cell in row] for row in (heads, *rows)]
    lines.insert(1, list(rule or ["---"] * len(heads)))
    return ["| " + " | ".join(line) + " |" for line in lines]
