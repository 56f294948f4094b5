"""Formulas as operations: what an engine computes, written as it stands in a book.

A term is a value of the program with Python's arithmetic; each operator adds one operation, from left to right as C++
does. A plain number beside a term is one of the formula, the same in every model.
"""

from __future__ import annotations

from dataclasses import dataclass

from testbench.flight.batch.program import Builder, Op, Value


@dataclass(frozen=True, eq=False)
class Term:
    """A value of a program, with arithmetic.

    Attributes:
        builder: of the program.
        value: what it stands for.
    """

    builder: Builder
    value: Value

    def _with(self, op: Op, other: Term | float) -> Term:
        return Term(self.builder, self.builder.emit(op, self.value, self._of(other).value))

    def _of(self, x: Term | float) -> Term:
        return x if isinstance(x, Term) else Term(self.builder, self.builder.constant(x))

    def __add__(self, other: Term | float) -> Term:
        return self._with(Op.ADD, other)

    def __radd__(self, other: float) -> Term:
        return self._of(other) + self

    def __sub__(self, other: Term | float) -> Term:
        return self._with(Op.SUB, other)

    def __rsub__(self, other: float) -> Term:
        return self._of(other) - self

    def __mul__(self, other: Term | float) -> Term:
        return self._with(Op.MUL, other)

    def __rmul__(self, other: float) -> Term:
        return self._of(other) * self

    def __truediv__(self, other: Term | float) -> Term:
        return self._with(Op.DIV, other)

    def __rtruediv__(self, other: float) -> Term:
        return self._of(other) / self

    def __pow__(self, other: Term | float) -> Term:
        return self._with(Op.POW, other)

    def __neg__(self) -> Term:
        return self.apply(Op.NEG)

    def __lt__(self, other: Term | float) -> Term:
        return self._with(Op.LT, other)

    def __le__(self, other: Term | float) -> Term:
        return self._with(Op.LE, other)

    def __gt__(self, other: Term | float) -> Term:
        return self._with(Op.GT, other)

    def __ge__(self, other: Term | float) -> Term:
        return self._with(Op.GE, other)

    def __and__(self, other: Term) -> Term:
        return self._with(Op.AND, other)

    def equals(self, other: Term | float) -> Term:
        """Return 1 where both are equal, else 0."""
        return self._with(Op.EQ, other)

    def apply(self, op: Op) -> Term:
        """Return the result of an operation on this term alone."""
        return Term(self.builder, self.builder.emit(op, self.value))

    def at_most(self, other: Term | float) -> Term:
        """Return the lesser of both."""
        return self._with(Op.MIN, other)

    def at_least(self, other: Term | float) -> Term:
        """Return the greater of both."""
        return self._with(Op.MAX, other)

    def then(self, yes: Term | float, no: Term | float) -> Term:
        """Return ``yes`` where this condition holds (is 1), else ``no``."""
        return Term(self.builder, self.builder.emit(Op.SELECT, self.value, self._of(yes).value, self._of(no).value))

    def bounded(self, low: Term | float, high: Term | float) -> Term:
        """Return this term between two bounds; the lower one where both are broken, as ``if .. else if`` does."""
        return (self < low).then(low, (self > high).then(high, self))

    def seek(self, target: Term, up: Term | float, down: Term | float, dt: Term) -> Term:
        """Return this term moved towards a target, at no more than a rate each way (FGTurbine::Seek)."""
        lower = (self - dt * down).at_least(target)
        higher = (self + dt * up).at_most(target)
        return (self > target).then(lower, (self < target).then(higher, self))
