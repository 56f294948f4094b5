"""A user's text on its way into a file of another language: one function each, so that nothing of it becomes code.

Names that come from files are one line already (core/schema.py); those given from Python need not be. HTML is escaped
by its templates, TOML by :func:`testbench.core.toml_text.quoted`, elements of XML by ``xml.sax.saxutils``; names of
files come from :func:`testbench.page.labels.file_stem`.
"""

from __future__ import annotations

import re

_NUMERIC = re.compile(r"[-+][\d.eE+\-±% ]*")


def one_line(text: str) -> str:
    """Return text as one line: each run of blanks, line ends and what cannot be printed becomes one blank."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def lua_comment(text: str) -> str:
    """Return text as it may follow ``-- `` in Lua: one line, and no bracket that would begin a comment of several."""
    return one_line(text).lstrip("[")


def xml_comment(text: str) -> str:
    """Return text as it may stand in a comment of XML: no two hyphens side by side, none at the end."""
    return re.sub(r"-(?=-)", "- ", one_line(text)).removesuffix("-")


def csv_cell(text: str) -> str:
    """Return text as a cell that a spreadsheet does not take for a formula: what begins as one gets an apostrophe."""
    formula = text[:1] in ("=", "@", "\t", "\r") or (text[:1] in ("+", "-") and not _NUMERIC.fullmatch(text))
    return f"'{text}" if formula else text
