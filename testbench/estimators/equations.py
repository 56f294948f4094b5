"""State equations as text: the table ``identification.structures.NAME`` of a scenario, or a TOML file of its own.

Every reading of a scenario imports this module, so it imports nothing that takes time. What the equations compute is
``parametric.structures.written``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from testbench.core.channels import CHANNELS, CONTROLS, channel
from testbench.core.door import read_toml
from testbench.core.errors import ChannelError, ScenarioError, nearest
from testbench.core.schema import Positive, Strict, parse
from testbench.estimators.expressions import FUNCTIONS, ExpressionError, Node, Number, names, where
from testbench.estimators.expressions import parse as tree

TRIM = ("V_trim", "alpha_trim", "theta_trim")
"""Symbols for the steady flight that was removed from the records as trim: m/s and rad."""
Meaning = Literal[
    "short_period", "longitudinal", "flexible", "lateral_directional", "lateral_per_speed", "roll_yaw_rates"
]
"""Packaged structures whose parameters are derivatives."""
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_RESERVED = {"pi", *TRIM, *FUNCTIONS}


class WrittenParameter(Strict):
    """A parameter of equations as text: where its estimate starts, or its value if it is not free; SI units."""

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
