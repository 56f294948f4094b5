"""An exercise: questions, hidden numbers drawn for each student, records made from them, and right answers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from numpy.random import Generator

from testbench.core.record import FlightRecord


@dataclass(frozen=True)
class Number:
    """A question whose answer is a number."""

    key: str  # the answer's name in answers.toml; it carries the unit
    unit: str  # as printed
    text: str  # the question in words
    tolerance: float  # largest relative error that counts as right; estimates from noisy records scatter
    absolute: float = 0.0  # largest error that counts as right whatever the size of the answer, in ``unit``

    def band(self, right: float) -> float:
        """Return the largest error that counts as right, in ``unit``."""
        return max(self.tolerance * abs(right), self.absolute)


@dataclass(frozen=True)
class Choice:
    """A question whose answer is one of ``options`` (name -> what it means)."""

    key: str
    text: str
    options: Mapping[str, str]


Question = Number | Choice


@dataclass(frozen=True)
class Mistake:
    """A wrong answer that people give, and why it is wrong. ``value`` is a number, or the name of an option."""

    value: float | str
    why: str


@dataclass(frozen=True)
class Answer:
    """The right answer to one question, the wrong ones that people give, and a hint for all others."""

    value: float | str
    mistakes: tuple[Mistake, ...] = ()
    hint: str = ""


@dataclass(frozen=True)
class Case:
    """One student's version of an exercise: the hidden numbers, and the seed of the noise."""

    hidden: Mapping[str, Any]
    seed: int

    def __getitem__(self, name: str) -> Any:
        return self.hidden[name]


@dataclass(frozen=True, eq=False)
class Handout:
    """What a student gets beside the text."""

    # name -> measured record, written to records/NAME.nc and records/NAME.csv
    records: Mapping[str, FlightRecord] = field(default_factory=dict)
    # numbers that the student may know, put into the text in place of ``@name@``, and into given.toml
    given: Mapping[str, float] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)  # name -> text of further files


@dataclass(frozen=True, eq=False)
class Exercise:
    """One exercise as its module has it; its text lies beside it as NAME.md, that of its notebook as NAME.steps.md."""

    # title, level, minutes: as listed; level 1 is for a first course, 3 for those who know the methods
    title: str
    level: Literal[1, 2, 3]
    minutes: int
    questions: tuple[Question, ...]  # in the order of the text
    draw: Callable[[Generator], Mapping[str, Any]]  # draws the hidden numbers of one student
    hand_out: Callable[[Case], Handout]  # makes what the student gets, from a case
    # key -> right answer, computed from the case, never from the records
    answer: Callable[[Case], Mapping[str, Answer]]
    # the worked solution: answers from the folder that was handed out, and nothing else
    solve: Callable[[Path], Mapping[str, float | str]]
