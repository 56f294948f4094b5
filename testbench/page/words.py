"""Sentences: the lines of an answer, lists in words, and how many entries of a long list are left out."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from testbench.core.advice import ranked
from testbench.core.channels import CHANNELS
from testbench.page.labels import superscript

_BEFORE_UNIT = re.compile(r"([\d⁰¹²³⁴⁵⁶⁷⁸⁹]) (%|rad/s|Hz|dB|s\b)")
_POWER = re.compile(r"(?<![\w.=])(?<!= )(\d+(?:\.\d+)?)e([+-]?\d+)\b")  # not of a key, to be copied to a file
_SQUARED = re.compile(r"\b(m|deg|rad)/s2\b")
_SHORTENED = ("imu", "gps", "ekf")  # are in capitals where a sentence begins with them
_WORDS_TOO = ("thrust", "north", "east")  # channels whose names are words of the language


MOST_WORDS = 25
"""Words of the sentence that answers on the first screen of a page."""
_LEAST_WORDS = 4  # of a clause that can stand alone
_CUTS = (r"(?:\.|;) ", r": ", r", | \(")

_RANK = {"wrong": "do not use: ", "doubt": "doubt: ", "note": ""}


class Line(NamedTuple):
    """One sentence of an answer: kind "lead" stands in bold, "wrong" and "doubt" are set off, "finding" is not.

    A "note" stands under a heading of its own on the page, and not on the terminal.
    """

    kind: str
    text: str


Answer = Sequence[str | tuple[str, str]]
"""Sentences, or (kind, sentence); of sentences alone the first is the lead."""


def answer_lines(answer: Answer) -> list[Line]:
    """Return an answer as lines that are whole sentences; those without a kind are findings, the first the lead."""
    lines = [(("lead", "finding")[k > 0], s) if isinstance(s, str) else s for k, s in enumerate(answer)]
    return [Line(kind, sentence(text)) for kind, text in lines]


def advice_lines(advice: Iterable[str]) -> list[Line]:
    """Return advice as lines, the worst first, whose kinds are the severities; all but notes begin with that in words.

    Advice that is given several times is said once.
    """
    return [Line(a.severity, _RANK[a.severity] + a) for a in ranked(dict.fromkeys(advice))]


def sentence(text: str) -> str:
    """Return ``text`` with a capital, a full stop, and each number beside its unit (by a space that does not break).

    The name or symbol of a channel, or a name with an underscore, stays as it is at the beginning.
    """
    first = text.split(" ", 1)[0].removesuffix(":")
    name = "_" in first or (first in CHANNELS and first not in _WORDS_TOO) or not first.isascii()
    capital = len(first) if first in _SHORTENED else 1
    whole = typeset(text if name else text[:capital].upper() + text[capital:])
    return whole if whole.endswith((".", "?", "!")) else whole + "."


def typeset(text: str) -> str:
    """Return ``text`` with ± for +-, s² for s2, 7·10⁻⁶ for 7e-06, and no break between a number and its unit."""
    text = _POWER.sub(lambda found: f"{found[1]}·10{superscript(int(found[2]))}", text)
    text = _SQUARED.sub("\\1/s²", text.replace("+- ", "±\u00a0"))
    return _BEFORE_UNIT.sub("\\1\u00a0\\2", text)


def brief(text: str) -> tuple[str, str]:
    """Return the first clauses of a sentence, :data:`MOST_WORDS` words at most, and the rest as a sentence or "".

    It is cut where a sentence or a clause ends, at the last such place that is early enough: full stop or semicolon,
    else colon, else comma or bracket. A text without such a place stays whole.
    """
    if len(text.split()) <= MOST_WORDS:
        return text, ""
    for marks in _CUTS:
        places = [m.start() for m in re.finditer(marks, text)]
        ends = [k for k in places if _LEAST_WORDS <= len(text[:k].split()) <= MOST_WORDS and _closed(text[:k])]
        if ends:
            cut = re.match(marks, text[ends[-1] :])
            assert cut is not None
            rest = text[ends[-1] + cut.end() :]
            return sentence(text[: ends[-1]]), sentence(f"({rest}" if cut[0].endswith("(") else rest)
    return text, ""


def how_many_more(lines: Sequence[Line]) -> str:
    """Return how many lines of an answer are not shown, and how many of them are wrong or doubtful, in words."""
    wrong, doubts = (sum(line.kind == kind for line in lines) for kind in ("wrong", "doubt"))
    of_them = [*([f"{wrong} say do not use"] if wrong else []), *([counted(doubts, "doubt")] if doubts else [])]
    return f"{len(lines)} more{f' ({listed(of_them)})' if of_them else ''}"


def _closed(text: str) -> bool:
    return text.count("(") == text.count(")")


def listed(words: Sequence[str]) -> str:
    """Return "a", "a and b" or "a, b and c"; "none" of none."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words) or "none"


def grouped(reasons: Mapping[str, str]) -> dict[str, list[str]]:
    """Return reason -> the names that have it, of name -> reason; names without any ("") are left out."""
    out: dict[str, list[str]] = {}
    for name, why in reasons.items():
        if why:
            out.setdefault(why, []).append(name)
    return out


def some(items: Iterable[str], most: int = 3, between: str = "; ") -> str:
    """Return the first ``most`` items, and how many more there are: "a; b; c; and 2 more"."""
    items = list(items)
    more = [f"and {len(items) - most} more"] if len(items) > most else []
    return between.join([*items[:most], *more])


def counted(n: int, one: str, many: str = "") -> str:
    """Return "1 flight" or "3 flights"; ``many`` is the plural where it is not made by an s."""
    return f"{n} {one if n == 1 else many or one + 's'}"
