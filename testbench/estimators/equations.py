"""State equations as text: the table ``identification.structures.NAME`` of a scenario, or a TOML file of its own.

Every reading of a scenario imports this module, so it imports nothing that takes time. What the equations compute is
``parametric.structures.written``.

Expressions as text, read into trees by a small parser of their own: nothing of the text is ever run as Python.

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
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from testbench.core.channels import CHANNELS, CONTROLS, channel
from testbench.core.door import read_toml
from testbench.core.errors import ChannelError, ScenarioError, nearest
from testbench.core.schema import Positive, Strict, parse

# --- expressions as text, read into trees by a small parser of their own ----------------------------------------------


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


def tree(text: str) -> Node:
    """Return the tree of an expression.

    Raises:
        ExpressionError: it is too long or too deep, has another sign or function, or breaks the grammar.

    Example:
        >>> tree("M_alpha*alpha^2")
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
            return (
                f"'{sign}' is a comparison, which is discontinuous and has no derivative; write bends with max, min or "
                "abs"
            )
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
            raise self.fault(
                (f"'{function}' is discontinuous and has no derivative; write bends with max, min, abs or tanh"), at
            )
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


# --- state equations as text ------------------------------------------------------------------------------------------


TRIM = ("V_trim", "alpha_trim", "theta_trim")
"""Symbols for the steady flight that was removed from the records as trim: m/s and rad."""
Meaning = Literal[
    "short_period", "longitudinal", "flexible", "lateral_directional", "lateral_per_speed", "roll_yaw_rates"
]
"""Packaged structures whose parameters are derivatives."""
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_RESERVED = {"pi", *TRIM, *FUNCTIONS}


class WrittenParameter(Strict):
    """A parameter of equations as text: its start value, or its value if it is not free; SI units."""

    value: float
    free: bool = True
    low: float | None = None
    high: float | None = None
    prior_std: Positive | None = None

    @model_validator(mode="after")
    def _inside(self) -> WrittenParameter:
        low = -math.inf if self.low is None else self.low
        high = math.inf if self.high is None else self.high
        if not low <= self.value <= high:
            raise ValueError(f"low <= value <= high must hold, got value {self.value:g} and bounds {low:g} to {high:g}")
        return self


def _table(value: Any) -> Any:
    """Return ``{value = ...}`` for a number alone."""
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number and not isinstance(value, (dict, WrittenParameter)):
        raise ValueError(f"must be a number or a table {{ value = ..., free = ... }}, got {value!r}")
    return {"value": value} if number else value


def _name(value: str) -> str:
    if not _NAME.fullmatch(value):
        raise ValueError(f"a name must be letters, digits and _, beginning with no digit, got '{value}'")
    if value in _RESERVED:
        raise ValueError(f"a name must not be one that has its meaning ({', '.join(sorted(_RESERVED))}), got '{value}'")
    return value


Symbol = Annotated[str, AfterValidator(_name)]
Symbols = Annotated[tuple[Symbol, ...], Field(strict=False)]


class Equations(Strict):
    """State equations as text, with their parameters.

    ``equations`` has one for every state, called STATE_dot. ``outputs`` has one for every output that is not a state;
    states that are channels are outputs by their names, and so are their derivatives that are channels (qdot of q).
    ``definitions`` give names to intermediate quantities. ``inputs`` are those that must move; any channel that stands
    in the equations is an input. ``initial`` says where states begin: numbers, or expressions of channels at the first
    sample; states that are channels begin at their first sample, others at zero. ``means`` says that parameters with
    names of a packaged structure are what they are there: the values before a flight, coefficients and amendments need
    to know it.
    """

    title: str = ""
    means: Meaning | None = None
    states: Annotated[Symbols, Field(min_length=1)]
    inputs: Symbols | None = None
    equations: dict[str, str]
    outputs: dict[str, str] = {}
    parameters: Annotated[dict[Symbol, Annotated[WrittenParameter, BeforeValidator(_table)]], Field(min_length=1)]
    constants: dict[Symbol, float] = {}
    definitions: dict[Symbol, str] = {}
    initial: dict[str, float | str] = {}

    @model_validator(mode="after")
    def _consistent(self) -> Equations:
        faults = list(self._faults()) if self is not STAND_IN else ()
        if faults:
            raise ValueError("; ".join(faults))
        return self

    @cached_property
    def trees(self) -> dict[str, Node]:
        """Name -> tree, of the state equations and of the definitions."""
        texts = {**self.definitions, **{f"{s}_dot": self.equations[f"{s}_dot"] for s in self.states}}
        return {name: tree(text) for name, text in texts.items()}

    @cached_property
    def output_trees(self) -> dict[str, Node]:
        """Channel -> tree, of the outputs that have an equation."""
        return {name: tree(text) for name, text in self.outputs.items()}

    @property
    def begins(self) -> dict[str, Node]:
        """State -> tree of where it begins, of those that ``initial`` names."""
        given = self.initial.items()
        return {state: tree(start) if isinstance(start, str) else Number(float(start)) for state, start in given}

    @property
    def possible_outputs(self) -> tuple[str, ...]:
        """All outputs that there can be: those with an equation, states and derivatives that are channels."""
        own = [s for s in self.states if _is_channel(s)]
        rates = [f"{s}dot" for s in self.states if f"{s}dot" in CHANNELS]
        return tuple(dict.fromkeys([*own, *self.outputs, *rates]))

    def output(self, name: str) -> Node:
        """Return the tree of one of :attr:`possible_outputs`."""
        if name in self.outputs:
            return self.output_trees[name]
        return tree(name if name in self.states else f"{name.removesuffix('dot')}_dot")

    def reached(self, roots: Iterable[Node]) -> tuple[list[str], list[str]]:
        """Return what expressions need: equations and definitions in the order of computing, and all other symbols.

        Raises:
            ExpressionError: a quantity needs itself.
        """
        steps: dict[str, None] = {}
        others: dict[str, None] = {}
        open_: list[str] = []

        def visit(node: Node) -> None:
            for symbol in names(node):
                name = symbol.name
                if name in self.trees:
                    if name in open_:
                        circle = " needs ".join([*open_[open_.index(name) :], name])
                        raise ExpressionError(f"no quantity may need itself, got {circle}")
                    if name not in steps:
                        open_.append(name)
                        visit(self.trees[name])
                        open_.pop()
                        steps[name] = None
                else:
                    others[name] = None

        for root in roots:
            visit(root)
        return list(steps), list(others)

    def driven_by(self, symbols: Collection[str]) -> tuple[str, ...]:
        """Return those of the symbols that are inputs: declared ones first, then channels that nothing else defines."""
        declared = [name for name in self.inputs or () if name in symbols]
        known = {*self.states, *self.parameters, *self.constants, *_RESERVED, *declared}
        return (*declared, *(name for name in symbols if name not in known))

    def must_move(self, inputs: Collection[str]) -> tuple[str, ...]:
        """Return the inputs that must move: those declared, else controls and commands, else all."""
        declared = [name for name in inputs if name in (self.inputs or ())]
        controls = [name for name in inputs if name in CONTROLS or name.endswith("_cmd")]
        return tuple(declared or controls or inputs)

    # --- what can be wrong ---

    def _faults(self) -> Iterator[str]:
        yield from self._faults_of_names()
        wanted = [f"{s}_dot" for s in self.states]
        for name in self.equations:
            if name not in wanted:
                yield f"equations.{name}: must be the derivative of a state, {', '.join(wanted)}{nearest(name, wanted)}"
        for name in wanted:
            if name not in self.equations:
                yield f"equations: state '{name.removesuffix('_dot')}' needs an equation '{name}'"
        for name in self.outputs:
            if not _is_channel(name):
                yield f"outputs.{name}: an output must be a channel{nearest(name, CHANNELS)}"
            elif name in (self.inputs or ()):
                yield f"outputs.{name}: an input cannot be an output too"
        for name in self.initial:
            if name not in self.states:
                yield f"initial.{name}: must be a state, {', '.join(self.states)}{nearest(name, self.states)}"
        broken = list(self._faults_of_texts())
        yield from broken
        if broken or set(wanted) - set(self.equations):
            return
        if not self.possible_outputs:
            yield 'outputs: no state is a channel, so that an output needs an equation, e.g. V = "sqrt(u^2 + w^2)"'
        try:
            _, used = self.reached([*(self.trees[name] for name in wanted), *self.output_trees.values()])
        except ExpressionError as error:
            yield str(error)
            return
        for kind, declared in (("parameters", self.parameters), ("inputs", self.inputs or ())):
            for name in declared:
                if name not in used:
                    yield f"{kind}.{name}: no equation and no output uses it; use it or leave it out"

    def _faults_of_names(self) -> Iterator[str]:
        kinds: dict[str, Iterable[str]] = {
            "states": self.states,
            "inputs": self.inputs or (),
            "parameters": self.parameters,
            "constants": self.constants,
            "definitions": self.definitions,
            "equations": [f"{s}_dot" for s in dict.fromkeys(self.states)],
        }
        seen: dict[str, str] = {}
        for kind, given in kinds.items():
            for name in given:
                if name in seen:
                    yield f"{kind}: names must differ, got '{name}', which stands under {seen[name]} too"
                seen.setdefault(name, kind)
        for name in self.inputs or ():
            if not _is_channel(name):
                yield f"inputs: an input must be a channel, got '{name}'{nearest(name, CHANNELS)}"

    def _faults_of_texts(self) -> Iterator[str]:
        """Yield what is wrong with each expression alone: its grammar, or a name that nothing defines."""
        own = {*self.states, *self.parameters, *self.constants, "pi"}
        rates = {f"{s}_dot" for s in self.states}
        known = {*own, *(self.inputs or ()), *self.definitions, *rates, *TRIM}
        begins = {*self.parameters, *self.constants, "pi"}
        tables: tuple[tuple[str, Mapping[str, float | str], set[str]], ...] = (
            ("definitions", self.definitions, known),
            ("equations", self.equations, known),
            ("outputs", self.outputs, known),
            ("initial", self.initial, begins),
        )
        for key, texts, valid in tables:
            for name, text in texts.items():
                if not isinstance(text, str):
                    continue
                try:
                    found = list(names(tree(text)))
                except ExpressionError as error:
                    yield f"{key}.{name}: {error}"
                    continue
                for symbol in {s.name: s for s in reversed(found)}.values():
                    if symbol.name not in valid and not _is_channel(symbol.name):
                        close = nearest(symbol.name, valid)
                        close = close if close.startswith("; did") else f"; known here: {', '.join(sorted(valid))}"
                        yield (
                            f"{key}.{name}: '{symbol.name}' {where(text, symbol.at)} is no state, input, parameter, "
                            f"constant, definition or channel{close}"
                        )


STAND_IN = Equations.model_construct(states=(), equations={}, parameters={})
"""Takes the place of equations whose faults have been told."""


def _is_channel(name: str) -> bool:
    try:
        channel(name)
    except ChannelError:
        return False
    return True


def read_equations(path: Path) -> Equations:
    """Read equations from a TOML file of their own.

    Raises:
        ScenarioError: it breaks a law; all faults are listed with the file.
        RecordError: it cannot be read.
    """
    made, faults = parse(Equations, read_toml(path, "structure"), path)
    if made is None or faults:
        raise ScenarioError(faults)
    return made
