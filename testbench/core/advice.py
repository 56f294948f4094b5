"""Advice on a result is data: a sentence, how much it weighs, and the name of its cause.

"wrong": do not use what it speaks of. "doubt": use it with the reserve that the sentence states. "note": worth knowing,
and no reason to believe the result less. A clean result of clean data has notes at most.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any, Literal, get_args

Severity = Literal["wrong", "doubt", "note"]
Status = Literal["good", "doubt", "wrong"]

SEVERITIES: tuple[Severity, ...] = get_args(Severity)
"""Worst first."""
OWN = "own"
"""The code of a sentence that gives none, such as one of a user's estimator."""
_CODE = re.compile(r"[a-z][a-z0-9_]*")


class Advice(str):
    """A sentence that carries its severity and the short name of its cause, e.g. "coloured_residuals".

    It equals its sentence; what makes another string of it, such as ``upper`` or an f-string, loses severity and code.

    Attributes:
        severity: "wrong", "doubt" or "note".
        code: lower case with underscores.

    Raises:
        ValueError: another severity, or a code that is no such name.
    """

    __slots__ = ("code", "severity")
    severity: Severity
    code: str

    def __new__(cls, sentence: str, severity: Severity = "doubt", code: str = OWN) -> Advice:
        """Return the sentence with its severity and code."""
        if severity not in SEVERITIES:
            raise ValueError(f"a severity must be one of {', '.join(SEVERITIES)}, got '{severity}'")
        if not _CODE.fullmatch(code):
            raise ValueError(f"a code must be lower case with underscores, got '{code}'")
        out = super().__new__(cls, sentence)
        out.severity, out.code = severity, code
        return out

    def __getnewargs__(self) -> tuple[str, Severity, str]:  # type: ignore[override]
        """Return the arguments of ``__new__``, for copies and pickles."""
        return str(self), self.severity, self.code

    def about(self, name: str) -> Advice:
        """Return "name: sentence" with the same severity and code."""
        return Advice(f"{name}: {self}", self.severity, self.code)


def wrong(code: str, sentence: str) -> Advice:
    """Return advice not to use a result, or the part of it that is named."""
    return Advice(sentence, "wrong", code)


def doubt(code: str, sentence: str) -> Advice:
    """Return advice to use a result with reserve."""
    return Advice(sentence, "doubt", code)


def note(code: str, sentence: str) -> Advice:
    """Return what is worth knowing and takes nothing from a result."""
    return Advice(sentence, "note", code)


class AdviceList(list[Advice]):
    """Advice that is collected: ``said.doubt("few_data", "...")`` adds one piece of it."""

    def wrong(self, code: str, sentence: str) -> None:
        """Add advice not to use a result, or the part of it that is named."""
        self.append(wrong(code, sentence))

    def doubt(self, code: str, sentence: str) -> None:
        """Add advice to use a result with reserve."""
        self.append(doubt(code, sentence))

    def note(self, code: str, sentence: str) -> None:
        """Add what is worth knowing and takes nothing from a result."""
        self.append(note(code, sentence))


def ranked(advice: Iterable[str]) -> tuple[Advice, ...]:
    """Return advice with the worst first, else in its order; a sentence without a severity is a doubt of code "own"."""
    all_of_it = [a if isinstance(a, Advice) else Advice(a) for a in advice]
    return tuple(sorted(all_of_it, key=lambda a: SEVERITIES.index(a.severity)))


def status_of(advice: Iterable[str]) -> Status:
    """Return the worst severity, "good" if there is nothing but notes."""
    worst = next(iter(ranked(advice)), None)
    return "good" if worst is None or worst.severity == "note" else worst.severity


class Advised:
    """A result with ``advice``, from which its ``status`` follows: "wrong", "doubt" or "good"."""

    advice: tuple[str, ...]

    @property
    def status(self) -> Status:
        """The worst severity of ``advice``, "good" if there is nothing but notes."""
        return status_of(self.advice)


def as_json(advice: Iterable[str]) -> list[dict[str, str]]:
    """Return advice as JSON values, the worst first: severity, code and sentence."""
    return [{"severity": a.severity, "code": a.code, "sentence": str(a)} for a in ranked(advice)]


def from_json(items: Iterable[str | Mapping[str, Any]]) -> tuple[Advice, ...]:
    """Return what :func:`as_json` wrote; a plain sentence, as older files hold, is a doubt of code "own".

    Raises:
        KeyError, ValueError: an item is neither.
    """
    return tuple(
        Advice(item) if isinstance(item, str) else Advice(item["sentence"], item["severity"], item["code"])
        for item in items
    )
