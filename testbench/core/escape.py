"""A user's text on its way into a file of another language: one function each, so that nothing of it becomes code.

Names that come from files are one line already (core/schema.py); those given from Python, or in a model's JSON, need
not be. HTML is escaped by its templates, TOML by :func:`testbench.core.escape.quoted`, LaTeX by
:func:`testbench.page.publish.latex_text`; a literal of Python is ``repr``, a comment of one line
:func:`one_line`; names of files come from :func:`testbench.page.labels.file_stem`.

Texts and numbers as a TOML file has them.
"""

from __future__ import annotations

import json
import math
import re
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any
from xml.sax.saxutils import escape, quoteattr

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def quoted(text: str) -> str:
    """Return a text as a TOML string on one line; JSON's strings are among them, but for one character."""
    known = text.encode("utf-8", "replace").decode()  # TOML has no lone surrogates, not even by their codes
    return json.dumps(known, ensure_ascii=False).replace("\x7f", "\\u007f")


def real(value: float, digits: int = 10) -> str:
    """Return a number as a TOML float of so many significant digits."""
    text = f"{value + 0.0:.{digits}g}"
    return text if not math.isfinite(value) or any(c in text for c in ".e") else f"{text}.0"


def table_lines(table: Mapping[str, Any], at: str = "") -> list[str]:
    """Return a table as lines of TOML: its values, then the tables in it; what is None is left out.

    Args:
        table: of texts, numbers, booleans, lists of them, tables, and lists of tables.
        at: its dotted name; "" for the whole file.
    """
    inner = {k: v for k, v in table.items() if isinstance(v, Mapping)}
    listed = {k: v for k, v in table.items() if isinstance(v, (list, tuple)) and v and isinstance(v[0], Mapping)}
    plain = {k: v for k, v in table.items() if v is not None and k not in inner and k not in listed}
    out = [f"{_key(k)} = {toml_value(v)}" for k, v in plain.items()]
    for k, v in inner.items():
        name = f"{at}.{_key(k)}".lstrip(".")
        bare = v and all(isinstance(x, Mapping) for x in v.values())
        out += [*([] if bare else ["", f"[{name}]"]), *table_lines(v, name)]
    for k, entries in listed.items():
        name = f"{at}.{_key(k)}".lstrip(".")
        for entry in entries:
            out += ["", f"[[{name}]]", *table_lines(entry, name)]
    return out


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else quoted(name)


def toml_value(value: Any, number: Callable[[float], str] = repr) -> str:
    """Return a text, number or boolean, or a list or table of them on one line, as TOML; a table without its None.

    Args:
        value: what is written.
        number: writes floats.
    """
    if isinstance(value, Mapping):
        said = (f"{_key(str(k))} = {toml_value(v, number)}" for k, v in value.items() if v is not None)
        return f"{{ {', '.join(said)} }}"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(toml_value(v, number) for v in value)}]"
    return number(float(value)) if isinstance(value, float) else repr(value)


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


def c_identifier(text: str) -> str:
    """Return text as what names of C begin with: ASCII letters, digits and single underscores, a letter first."""
    plain = re.sub(r"_+", "_", re.sub(r"[^A-Za-z0-9]", "_", text)).strip("_")[:40] or "model"
    return plain if plain[0].isalpha() else f"m_{plain}"


def c_comment(text: str) -> str:
    """Return text as it may stand in a comment of C: one line of ASCII that neither begins nor ends one."""
    plain = one_line(text).encode("ascii", "replace").decode()
    return re.sub(r"\*(?=/)|/(?=\*)|\?(?=\?)", lambda found: f"{found[0]} ", plain)


def c_string(text: str) -> str:
    """Return text as a string of C, in its quotes: ASCII, quotes and backslashes escaped, no trigraph."""
    plain = one_line(text).encode("ascii", "replace").decode()
    return '"' + re.sub(r'["\\?]', lambda found: f"\\{found[0]}", plain) + '"'


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
