"""Texts and numbers as a TOML file has them."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from typing import Any

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
    out = [f"{_key(k)} = {_value(v)}" for k, v in table.items() if v is not None and k not in inner and k not in listed]
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


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_value, value))}]"
    return repr(value)
