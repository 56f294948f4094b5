"""Texts and numbers as a TOML file has them."""

from __future__ import annotations

import json
import math


def quoted(text: str) -> str:
    """Return a text as a TOML string on one line; JSON's strings are among them, but for one character."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def real(value: float, digits: int = 10) -> str:
    """Return a number as a TOML float of so many significant digits."""
    text = f"{value + 0.0:.{digits}g}"
    return text if not math.isfinite(value) or any(c in text for c in ".e") else f"{text}.0"
