"""Judge answers: what is right, what is off by how much, and why."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from testbench.core.errors import Refusal, nearest
from testbench.questions.exercise.answers import ANSWERS, read_answers
from testbench.questions.exercise.ask import Started, reopen
from testbench.questions.exercise.exercise import Answer, Choice, Mistake, Number, Question

Outcome = Literal["right", "near", "wrong", "missing"]
_NEAR = 3.0  # times the tolerance: a wrong number, but no wrong idea
# Relative: how close to the value of a known mistake an estimate comes that makes it, at most. A slip of units or of a
# factor two is only named where it is nearly exact, for anything may lie near twice the right value.
_MISTAKE, _SLIP = 0.15, 0.07
_CLOSE = 0.04
_SIGNED = ("1/s2", "1/s", "rad", "deg")
_DEGREES = math.degrees(1.0)


@dataclass(frozen=True)
class Verdict:
    """The judgement of one answer."""

    question: Question
    given: float | str | None
    outcome: Outcome
    words: str


@dataclass(frozen=True)
class Result:
    """All verdicts on one folder."""

    name: str
    title: str
    student: str
    verdicts: tuple[Verdict, ...]

    @property
    def right(self) -> int:
        """How many answers are right."""
        return sum(v.outcome == "right" for v in self.verdicts)

    @property
    def passed(self) -> bool:
        """Whether all answers are right."""
        return self.right == len(self.verdicts)


def check(folder: Path, key: str) -> Result:
    """Read answers.toml of a folder that was handed out and judge it against the student's own truth.

    Raises:
        RecordError: it is not such a folder, the key is another one, or there are no answers.
        ScenarioError: the answers are not TOML, or hold a key that no question has.
    """
    started = reopen(folder, key)
    given = read_answers(folder / ANSWERS, started.exercise.questions)
    return judge(started, given)


def check_class(folders: Sequence[Path], key: str) -> dict[Path, Result | Refusal]:
    """Check many folders; one that cannot be judged keeps its error and does not stop the others."""
    results: dict[Path, Result | Refusal] = {}
    for folder in folders:
        try:
            results[folder] = check(folder, key)
        except Refusal as error:
            results[folder] = error
    return results


def judge(started: Started, given: Mapping[str, Any]) -> Result:
    """Judge ``given`` (key -> answer) against the truth of a started exercise."""
    right = started.exercise.answer(started.case)
    verdicts = tuple(verdict(q, given.get(q.key), right[q.key]) for q in started.exercise.questions)
    return Result(started.name, started.exercise.title, started.student, verdicts)


def verdict(question: Question, given: Any, right: Answer) -> Verdict:
    """Judge one answer (None: missing)."""
    if given is None:
        return Verdict(question, None, "missing", "not answered yet")
    if isinstance(question, Choice):
        return _choice(question, given, right)
    return _number(question, given, right)


def _choice(question: Choice, given: Any, right: Answer) -> Verdict:
    word = str(given).strip()
    if word not in question.options:
        return Verdict(question, word, "wrong", f"not one of the words listed{nearest(word, question.options)}")
    if word == right.value:
        return Verdict(question, word, "right", "")
    why = next((m.why for m in right.mistakes if m.value == word), right.hint)
    return Verdict(question, word, "wrong", why or "not the answer of these records")


def _number(question: Number, given: Any, right: Answer) -> Verdict:
    if isinstance(given, bool) or not isinstance(given, (int, float)) or not math.isfinite(given):
        words = f"must be a finite number in {question.unit}, without quotes and unit, got {given!r}"
        return Verdict(question, None if not isinstance(given, str) else given, "wrong", words)
    value, truth = float(given), float(right.value)
    band = question.band(truth)
    error = value - truth
    if abs(error) <= band:
        return Verdict(question, value, "right", "")
    by = off_by(value, truth, question.unit)
    # A mistake is recognised before "near": a slip that happens to lie close is still that slip.
    slip = recognise(value, truth, band, right.mistakes, _MISTAKE)
    slip = slip or recognise(value, truth, band, [*slips(question, truth)], _SLIP)
    if slip is not None:
        return Verdict(question, value, "wrong", f"{by}; {slip}")
    if abs(error) <= _NEAR * band:
        return Verdict(question, value, "near", f"{by}; the idea seems right, the number is not yet accurate enough")
    return Verdict(question, value, "wrong", f"{by}; {right.hint}" if right.hint else by)


def off_by(value: float, truth: float, unit: str) -> str:
    """Say by how much a number is off."""
    if truth == 0.0 or value * truth < 0.0:
        return f"an error of {value - truth:+.3g} {unit}" if truth == 0.0 else "of the wrong sign"
    ratio = value / truth
    if 0.5 < ratio < 2.0:
        return f"{'too large' if ratio > 1.0 else 'too small'} by {100.0 * abs(ratio - 1.0):.0f} %"
    if value == 0.0:
        return "too small: the value is not zero"
    return f"too large by a factor of {ratio:.3g}" if ratio > 1.0 else f"too small by a factor of {1.0 / ratio:.3g}"


def recognise(
    value: float, truth: float, band: float, mistakes: Sequence[Mistake], widest: float = _MISTAKE
) -> str | None:
    """Return why ``value`` is wrong if a known mistake gives it, within the answer's tolerance or ``widest``."""
    tolerance = max(_CLOSE, min(band / abs(truth), widest) if truth else 0.0)
    found = [
        (abs(value - float(m.value)) / abs(float(m.value)), m.why)
        for m in mistakes
        if float(m.value) != 0.0 and abs(float(m.value) - truth) > band
    ]
    close = [pair for pair in found if pair[0] <= tolerance]
    return min(close)[1] if close else None


def slips(question: Number, truth: float) -> Iterator[Mistake]:
    """Yield the mistakes of units, sign and factor two that any number may have."""
    if truth == 0.0:
        return
    unit = question.unit
    turn = 2.0 * math.pi
    if unit == "rad/s":
        yield Mistake(truth / turn, "this is the frequency in Hz; the answer is in rad/s (times 2 pi)")
        yield Mistake(truth * turn, "multiplied by 2 pi once too often: it was in rad/s already")
        yield Mistake(turn / truth, "this is the period in s; the angular frequency is 2 pi over it")
    if unit == "Hz":
        yield Mistake(truth * turn, "this is in rad/s; the answer is in Hz (over 2 pi)")
        yield Mistake(1.0 / truth, "this is the period in s; the frequency is one over it")
    if unit in ("rad", "1/s2", "1/s", "1"):
        yield Mistake(truth * _DEGREES, "57.3 times too large: degrees in place of radians")
        yield Mistake(
            truth / _DEGREES, "57.3 times too small: divided by an angle in degrees, or converted to radians twice"
        )
    if unit == "deg":
        yield Mistake(truth / _DEGREES, "this is in radians; the answer is in degrees")
        yield Mistake(truth * _DEGREES, "converted from radians to degrees twice")
    if unit == "%":
        yield Mistake(truth / 100.0, "this is a fraction; the answer is in percent")
    if unit == "1":
        yield Mistake(truth * 100.0, "this is in percent; the answer is a fraction of one")
    signs = ": elevator is positive trailing edge down (nose down), z points down" if unit in _SIGNED else ""
    yield Mistake(-truth, f"right except for the sign{signs}")
    yield Mistake(
        2.0 * truth,
        "twice the right value: a whole in place of a half, or a variance in place of a standard deviation?",
    )
    yield Mistake(0.5 * truth, "half the right value: a half in place of a whole?")
