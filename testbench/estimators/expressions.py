"""Expressions as text, read into trees by a small parser of their own: nothing of the text is ever run as Python.

    sum     = product {("+" | "-") product}
    product = signed {("*" | "/") signed}
    signed  = ("+" | "-") signed | power
    power   = atom [("^" | "**") signed]
    atom    = number | name | function "(" sum {"," sum} ")" | "(" sum ")"

As in mathematics, ``-x^2`` is -(x^2) and ``2^3^2`` is 2^9.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

from testbench.core.errors import nearest

LONGEST, DEEPEST = 2000, 100
"""Characters of an expression, and levels of its tree."""

FUNCTIONS = {
    **dict.fromkeys(
        ("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "abs"), 1
    ),
    **dict.fromkeys(("atan2", "min", "max"), 2),
}
"""Functions and how many arguments each takes. ``abs``, ``min`` and ``max`` have a derivative everywhere but where they
bend."""

_JUMPS = ("sign", "step", "heaviside", "floor", "ceil", "round", "trunc", "int", "mod", "where", "if")
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_][A-Za-z0-9_]*)|(?P<sign>\*\*|[-+*/^(),]))"
)
_SPACE = re.compile(r"\s*")


class ExpressionError(ValueError):
    """What is wrong with an expression, and at which character."""


@dataclass(frozen=True)
class Number:
    """A number as it stands."""

    value: float


@dataclass(frozen=True)
class Name:
    """A symbol; ``at`` is the index of its first character, -1 if it stands in no text."""

    name: str
    at: int = -1


@dataclass(frozen=True)
class Negative:
    """-of."""

    of: Node


@dataclass(frozen=True)
class Binary:
    """left + right and so on; ``sign`` is one of + - * / ^."""

    sign: str
    left: Node
    right: Node


@dataclass(frozen=True)
class Call:
    """A function of :data:`FUNCTIONS` and its arguments."""

    function: str
    arguments: tuple[Node, ...]


Node = Number | Name | Negative | Binary | Call


def names(node: Node) -> Iterator[Name]:
    """Yield every symbol of an expression, as often as it stands there."""
    if isinstance(node, Name):
        yield node
    for part in parts(node):
        yield from names(part)


def parts(node: Node) -> tuple[Node, ...]:
    """Return the operands or arguments of a node."""
    if isinstance(node, Negative):
        return (node.of,)
    if isinstance(node, Binary):
        return node.left, node.right
    return node.arguments if isinstance(node, Call) else ()


def parse(text: str) -> Node:
    """Return the tree of an expression.

    Raises:
        ExpressionError: it is too long or too deep, has another sign or function, or breaks the grammar.

    Example:
        >>> parse("M_alpha*alpha^2")
        Binary(sign='*', left=Name(name='M_alpha', at=0), right=Binary(sign='^', left=Name(name='alpha', at=8), \
right=Number(value=2.0)))
    """
    if len(text) > LONGEST:
        raise ExpressionError(
            f"an expression must have at most {LONGEST} characters, got {len(text)}; give parts of it names under "
            "definitions"
        )
    return _Reader(text).whole()


def where(text: str, at: int) -> str:
    """Return ``at character 12, "de*alpha"``: a place in a text, with what stands there."""
    there = " ".join(text[at : at + 20].split())
    return f"at character {at + 1}" + (f" ('{there}')" if there else " (its end)")


class _Reader:
    """Reads one text from left to right, one method per line of the grammar."""

    def __init__(self, text: str) -> None:
        self.text, self.level = text, 0
        self.tokens: list[tuple[str, str, int]] = []
        at = 0
        while (start := _SPACE.match(text, at).end()) < len(text):  # type: ignore[union-attr]
            found = _TOKEN.match(text, at)
            if found is None or found.lastgroup is None:
                self.tokens.append(
                    ("strange", text[start], start)
                )  # told when it is reached: what is before comes first
                break
            at = found.end()
            self.tokens.append((found.lastgroup, found[found.lastgroup], start))
        self.tokens.append(("end", "", len(text)))
        self.next = 0

    def strange(self, sign: str) -> str:
        if sign in "<>=!":
            return f"'{sign}' compares, which jumps and has no derivative; write bends with max, min or abs"
        return f"'{sign}' is no sign of an expression (+ - * / ^, brackets, numbers, names)"

    def fault(self, reason: str, at: int) -> ExpressionError:
        return ExpressionError(f"{reason}, {where(self.text, at)}")

    def take(self, *signs: str) -> str:
        """Return the next token if it is one of these signs, else an empty text."""
        kind, token, _ = self.tokens[self.next]
        if kind != "sign" or token not in signs:
            return ""
        self.next += 1
        return token

    def whole(self) -> Node:
        node, _ = self.sum()
        kind, token, at = self.tokens[self.next]
        if kind != "end":
            if kind == "strange":
                raise self.fault(self.strange(token), at)
            before = self.tokens[self.next - 1][1]
            if token == ")":
                raise self.fault("a bracket is closed that was not opened", at)
            if token == ",":
                raise self.fault("a comma stands between arguments of a function only", at)
            raise self.fault(f"a sign must stand between '{before}' and '{token}'", at)
        return node

    # Every method returns a node and the depth of its tree.

    def sum(self) -> tuple[Node, int]:
        left = self.product()
        while sign := self.take("+", "-"):
            left = self.joined(sign, left, self.product())
        return left

    def product(self) -> tuple[Node, int]:
        left = self.signed()
        while sign := self.take("*", "/"):
            left = self.joined(sign, left, self.signed())
        return left

    def signed(self) -> tuple[Node, int]:
        self.deeper()
        if sign := self.take("+", "-"):
            node, depth = self.signed()
            out = (node, depth) if sign == "+" else (Negative(node), depth + 1)
        else:
            out = self.power()
        self.level -= 1
        return out

    def power(self) -> tuple[Node, int]:
        base = self.atom()
        return self.joined("^", base, self.signed()) if self.take("^", "**") else base

    def atom(self) -> tuple[Node, int]:
        kind, token, at = self.tokens[self.next]
        self.next += 1
        if kind == "number":
            if not math.isfinite(float(token)):
                raise self.fault(f"a number must be finite, got '{token}'", at)
            return Number(float(token)), 1
        if kind == "name":
            return self.call(token, at) if self.take("(") else (Name(token, at), 1)
        if token == "(":
            inner = self.sum()
            self.close(at)
            return inner
        if kind == "strange":
            raise self.fault(self.strange(token), at)
        raise self.fault("a number, a name or a bracket must stand here", at)

    def call(self, function: str, at: int) -> tuple[Node, int]:
        if function in _JUMPS:
            raise self.fault(f"'{function}' jumps and has no derivative; write bends with max, min, abs or tanh", at)
        if function not in FUNCTIONS:
            raise self.fault(f"there is no function '{function}'{nearest(function, FUNCTIONS)}", at)
        arguments = [self.sum()]
        while self.take(","):
            arguments.append(self.sum())
        self.close(at)
        if len(arguments) != FUNCTIONS[function]:
            raise self.fault(f"'{function}' takes {FUNCTIONS[function]} argument(s), got {len(arguments)}", at)
        return Call(function, tuple(node for node, _ in arguments)), 1 + max(depth for _, depth in arguments)

    def close(self, opened: int) -> None:
        if not self.take(")"):
            kind, token, at = self.tokens[self.next]
            if kind == "strange":
                raise self.fault(self.strange(token), at)
            raise self.fault("a bracket is not closed", opened)

    def joined(self, sign: str, left: tuple[Node, int], right: tuple[Node, int]) -> tuple[Node, int]:
        depth = 1 + max(left[1], right[1])
        if depth > DEEPEST:
            raise self.too_deep()
        return Binary(sign, left[0], right[0]), depth

    def deeper(self) -> None:
        self.level += 1
        if self.level > DEEPEST:
            raise self.too_deep()

    def too_deep(self) -> ExpressionError:
        at = self.tokens[min(self.next, len(self.tokens) - 1)][2]
        return self.fault(f"at most {DEEPEST} terms or nested brackets may stand here; give parts of them names", at)
