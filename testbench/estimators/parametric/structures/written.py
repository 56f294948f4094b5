"""Structures from equations as text: trees compiled to numpy operations, once, and recognised where they are linear.

The Python code that is compiled is built from the trees of the expressions, node by node; no text of a user's is part
of it, and it sees no names but its own arguments and the dual functions below. Equations that are affine in states and
inputs become a :class:`~..structure.LinearStructure`, which is solved exactly.

Functions that carry exact derivatives through complex steps: f(a + ih) = f(a) + ih f'(a).

Where a function is analytic this is its complex value to first order, which is all that a step of 1e-30 shows. Unlike
the complex function it stays true to the real one where that ends (``sqrt`` and ``log`` of negative numbers are not
numbers), and it holds for functions that bend, ``abs``, ``min`` and ``max``, whose derivative is that of the branch
taken.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from testbench.core.advice import Advice, AdviceList, doubt
from testbench.core.errors import EstimationError, nearest
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.schema import parse
from testbench.estimators.equations import (
    TRIM,
    Binary,
    Call,
    Equations,
    Name,
    Negative,
    Node,
    Number,
    names,
    parts,
    tree,
)
from testbench.estimators.parametric.structure import AnyArray, LinearStructure, Matrices, ModelStructure, Parameter
from testbench.estimators.parametric.structures.settings import Trim

# --- functions that carry exact derivatives through complex steps -----------------------------------------------------


Function = Callable[..., AnyArray]


def _dual(f: Function, slope: Function) -> Function:
    """Return f for real and complex arrays, from the real f and its derivative."""

    def of(z: AnyArray) -> AnyArray:
        if not np.iscomplexobj(z):
            return np.asarray(f(z))
        return _complex(f(z.real), _times(slope(z.real), z.imag))

    return of


def _complex(real: AnyArray, imag: AnyArray) -> AnyArray:
    """Return real + i imag; multiplied by i, an infinite imag would spoil the real part."""
    out = np.empty(np.broadcast_shapes(np.shape(real), np.shape(imag)), complex)
    out.real, out.imag = real, imag
    return out


def _times(slope: AnyArray, step: AnyArray) -> AnyArray:
    """Return slope times step, 0 where there is no step, even if the slope is infinite."""
    return np.where(step == 0.0, 0.0, slope * step)


def atan2(y: AnyArray, x: AnyArray) -> AnyArray:
    """Return the angle of (x, y)."""
    a, b = np.real(y), np.real(x)
    angle = np.arctan2(a, b)
    if not (np.iscomplexobj(y) or np.iscomplexobj(x)):
        return np.asarray(angle)
    return _complex(angle, (b * np.imag(y) - a * np.imag(x)) / (a * a + b * b))


def least(a: AnyArray, b: AnyArray) -> AnyArray:
    """Return the lesser, with its derivative."""
    return np.where(np.real(a) <= np.real(b), a, b)


def largest(a: AnyArray, b: AnyArray) -> AnyArray:
    """Return the larger, with its derivative."""
    return np.where(np.real(a) >= np.real(b), a, b)


def power(base: AnyArray, exponent: AnyArray) -> AnyArray:
    """Return base to a power that is not a whole number; not a number where the base is negative."""
    a, b = np.real(base), np.real(exponent)
    value = np.power(a, b, dtype=float)
    if not (np.iscomplexobj(base) or np.iscomplexobj(exponent)):
        return np.asarray(value)
    by_base, by_exponent = b * np.power(a, b - 1.0, dtype=float), value * np.log(a)
    return _complex(value, _times(by_base, np.imag(base)) + _times(by_exponent, np.imag(exponent)))


def whole_power(base: AnyArray, exponent: int) -> AnyArray:
    """Return base to a whole power, by multiplication: exact for complex steps, and fast."""
    if exponent < 0:
        return 1.0 / whole_power(base, -exponent)
    out, square = None, base
    while exponent:
        if exponent & 1:
            out = square if out is None else out * square
        exponent >>= 1
        square = square * square if exponent else square
    return np.ones_like(base) if out is None else out


FUNCTIONS: dict[str, Function] = {
    "sin": _dual(np.sin, np.cos),
    "cos": _dual(np.cos, lambda a: -np.sin(a)),
    "tan": _dual(np.tan, lambda a: 1.0 / np.cos(a) ** 2),
    "asin": _dual(np.arcsin, lambda a: 1.0 / np.sqrt(1.0 - a * a)),
    "acos": _dual(np.arccos, lambda a: -1.0 / np.sqrt(1.0 - a * a)),
    "atan": _dual(np.arctan, lambda a: 1.0 / (1.0 + a * a)),
    "sinh": _dual(np.sinh, np.cosh),
    "cosh": _dual(np.cosh, np.sinh),
    "tanh": _dual(np.tanh, lambda a: 1.0 - np.tanh(a) ** 2),
    "exp": _dual(np.exp, np.exp),
    "log": _dual(np.log, lambda a: 1.0 / np.where(a > 0.0, a, np.nan)),
    "sqrt": _dual(np.sqrt, lambda a: 0.5 / np.sqrt(a)),
    "abs": _dual(np.abs, np.sign),
    "atan2": atan2,
    "min": least,
    "max": largest,
}
"""The functions of :data:`testbench.estimators.equations.FUNCTIONS`, in numpy."""


# --- structures from equations as text --------------------------------------------------------------------------------


Form = dict[str, Node]
"""Coefficient of each state and input in an affine expression, and under "" what stands alone."""
_ONE = Number(1.0)
_WHOLE = 32  # largest exponent that is multiplied out
_WHOLE_ONLY = ("V", "u", "qbar")  # whose deviations from trim are seldom meant where something multiplies them


@dataclass(frozen=True, eq=False)
class Law:
    """The equations of one structure, ready to be compiled."""

    #: states, inputs, outputs, parameters: names, in the order of the arrays' columns
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    steps: tuple[tuple[str, Node], ...]  #: intermediate quantities and their trees, in the order of computing
    rates: tuple[Node, ...]  #: (n,) trees of the derivatives
    shown: tuple[Node, ...]  #: (p,) trees of the outputs
    initial: tuple[tuple[str, Node], ...] = ()  #: state -> tree of its start, of constants, start values and channels

    @classmethod
    def of(
        cls,
        states: Sequence[str],
        inputs: Sequence[str],
        outputs: Sequence[str],
        parameters: Sequence[Parameter],
        steps: Mapping[str, str],
        shown: Mapping[str, str],
        constants: Mapping[str, float] | None = None,
    ) -> Law:
        """Return the law of these texts.

        Args:
            states: (n,) names.
            inputs: (m,) channels.
            outputs: (p,) channels.
            parameters: all of them.
            steps: name -> text in the order of computing, STATE_dot for every state among them.
            shown: output -> text, of those that are no state.
            constants: name -> value in the texts.
        """
        known = constants or {}
        return cls(
            states=tuple(states),
            inputs=tuple(inputs),
            outputs=tuple(outputs),
            parameters=tuple(p.name for p in parameters),
            steps=tuple((step, _put(tree(text), known)) for step, text in steps.items()),
            rates=tuple(Name(f"{state}_dot") for state in states),
            shown=tuple(_put(tree(shown.get(output, output)), known) for output in outputs),
        )

    def __getstate__(self) -> dict[str, Any]:
        """Compiled functions cannot be pickled; they are compiled again where they are used."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    @cached_property
    def derivative(self) -> Callable[..., tuple[AnyArray, ...]]:
        """Function of x, u, params that returns the n derivatives."""
        return self._function(self.rates)

    @cached_property
    def output(self) -> Callable[..., tuple[AnyArray, ...]]:
        """Function of x, u, params that returns the p outputs."""
        return self._function(self.shown)

    def _function(self, roots: Sequence[Node]) -> Callable[..., tuple[AnyArray, ...]]:
        columns = [("x", self.states), ("u", self.inputs), ("params", self.parameters)]
        return _compiled([c for c in columns if c[1]], _needed(self.steps, roots), roots)

    # --- linear ones ---

    @cached_property
    def forms(self) -> tuple[list[tuple[str, Node]], list[Form | None]]:
        """Steps without states and inputs, and the affine forms of rates, then outputs, None for one that bends.

        Coefficients of steps become steps of their own, so that forms do not grow.
        """
        steps: list[tuple[str, Node]] = []
        found: dict[str, Form | None] = {name: {name: _ONE} for name in (*self.states, *self.inputs)}
        for name, node in self.steps:
            form = _affine(node, found)
            if form is not None:
                for variable, coefficient in form.items():
                    if isinstance(coefficient, Binary | Call):
                        steps.append((str(len(steps)), coefficient))  # no name of a user's is a number
                        form[variable] = Name(steps[-1][0])
            found[name] = form
        return steps, [_affine(node, found) for node in (*self.rates, *self.shown)]

    @property
    def linear(self) -> bool:
        """Whether all is affine in states and inputs."""
        return None not in self.forms[1]

    @cached_property
    def entries(self) -> tuple[list[tuple[str, tuple[int, ...]]], Callable[..., tuple[AnyArray, ...]]]:
        """Of a linear law: which entry of which matrix each coefficient is, and the function that computes them."""
        steps, forms = self.forms
        places: list[tuple[str, tuple[int, ...]]] = []
        roots: list[Node] = []
        n = len(self.states)
        for row, form in enumerate(forms):
            of_state, i = row < n, row if row < n else row - n
            for variable, coefficient in (form or {}).items():
                if variable in self.states:
                    places.append(("A" if of_state else "C", (i, self.states.index(variable))))
                elif variable:
                    places.append(("B" if of_state else "D", (i, self.inputs.index(variable))))
                else:
                    places.append(("bx" if of_state else "by", (i,)))
                roots.append(coefficient)
        return places, _compiled([("params", self.parameters)], _needed(steps, roots), roots)

    def matrices(self, params: AnyArray) -> Matrices:
        """Return the matrices of a linear law, with the leading axes of the parameters (..., k)."""
        n, m, p = len(self.states), len(self.inputs), len(self.outputs)
        shapes = {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m), "bx": (n,), "by": (p,)}
        params = np.asarray(params)
        lead = params.shape[:-1]
        out = {name: np.zeros((*lead, *shape), params.dtype) for name, shape in shapes.items()}
        places, function = self.entries
        with np.errstate(all="ignore"):
            values = function(params)
        for (name, place), value in zip(places, values, strict=True):
            entry: tuple[Any, ...] = (..., *place)
            out[name][entry] = value
        return Matrices(*(out[name] for name in Matrices._fields))

    def multiplies(self, name: str) -> bool:
        """Say whether something that varies multiplies a state or input, or a function takes it, but for sums with it.

        In (V0 + u) q, the deviation u is taken for what it is.
        """
        varies = {*self.states, *self.inputs}
        for step, node in self.steps:
            if any(symbol.name in varies for symbol in names(node)):
                varies.add(step)
        every = (*(node for _, node in self.steps), *self.rates, *self.shown)
        return any(_multiplied(node, name, varies) for node in every)

    # --- the start ---

    def start(self, record: FlightRecord, values: Mapping[str, float]) -> dict[str, float]:
        """Return state -> where ``initial`` says that it begins, from the first sample of a record.

        Raises:
            EstimationError: the record lacks a channel, or the start is no finite number.
        """
        out = {}
        for state, node in self.initial:
            known = dict(values)
            for symbol in names(node):
                if symbol.name not in known:
                    if symbol.name not in record:
                        raise EstimationError(
                            f"initial.{state} needs channel '{symbol.name}', which the record lacks; sense it, or give "
                            "a number"
                        )
                    known[symbol.name] = float(record[symbol.name][0])
            used = tuple(dict.fromkeys(symbol.name for symbol in names(node)))
            with np.errstate(all="ignore"):
                found = _compiled([("params", used)], [], [node])(np.array([known[name] for name in used]))
            out[state] = float(found[0])
            if not math.isfinite(out[state]):
                said = ", ".join(f"{name} = {known[name]:g}" for name in used)
                raise EstimationError(f"initial.{state} must be a finite number, got {out[state]:g} from {said}")
        return out


def _needed(steps: Sequence[tuple[str, Node]], roots: Sequence[Node]) -> list[tuple[str, Node]]:
    """Return the steps that the roots need, in their order."""
    wanted = {symbol.name for root in roots for symbol in names(root)}
    out = []
    for name, node in reversed(steps):
        if name in wanted:
            out.append((name, node))
            wanted |= {symbol.name for symbol in names(node)}
    return out[::-1]


# --- trees to code ----------------------------------------------------------------------------------------------------


def _compiled(
    columns: Sequence[tuple[str, Sequence[str]]], steps: Sequence[tuple[str, Node]], roots: Sequence[Node]
) -> Callable[..., tuple[AnyArray, ...]]:
    """Return a function of arrays that returns the values of the roots.

    Args:
        columns: each argument, and the names of the entries of its last axis.
        steps: what is computed before.
        roots: what is returned.
    """
    used = {symbol.name for node in (*roots, *(node for _, node in steps)) for symbol in names(node)}
    body: list[ast.stmt] = []
    for argument, entries in columns:
        for i, name in enumerate(entries):
            if name in used:
                index = ast.Tuple([ast.Constant(...), ast.Constant(i)], ast.Load())
                body.append(_assign(name, ast.Subscript(_load(argument), index, ast.Load())))
    body += [_assign(name, _code(node)) for name, node in steps]
    body.append(ast.Return(ast.Tuple([_code(root) for root in roots], ast.Load())))
    arguments = ast.arguments([], [ast.arg(name) for name, _ in columns], None, [], [], None, [])
    function = ast.FunctionDef("law", arguments, body, [])
    module = ast.fix_missing_locations(ast.Module([function], []))
    space: dict[str, Any] = {"__builtins__": {}, "power": power, "whole_power": whole_power}
    space |= {f"f_{name}": f for name, f in FUNCTIONS.items()}
    exec(compile(module, "<equations>", "exec"), space)
    law: Callable[..., tuple[AnyArray, ...]] = space["law"]
    return law


def _load(name: str) -> ast.Name:
    return ast.Name(name, ast.Load())


def _assign(name: str, value: ast.expr) -> ast.stmt:
    return ast.Assign([ast.Name(f"n_{name}", ast.Store())], value)


_SIGNS: dict[str, type[ast.operator]] = {"+": ast.Add, "-": ast.Sub, "*": ast.Mult, "/": ast.Div}


def _code(node: Node) -> ast.expr:
    """Return the Python expression of a tree; names of users have a prefix, and so can be no others."""
    if isinstance(node, Number):
        return ast.Constant(node.value)
    if isinstance(node, Name):
        return _load(f"n_{node.name}")
    if isinstance(node, Negative):
        return ast.UnaryOp(ast.USub(), _code(node.of))
    if isinstance(node, Call):
        return ast.Call(_load(f"f_{node.function}"), [_code(part) for part in node.arguments], [])
    if node.sign != "^":
        return ast.BinOp(_code(node.left), _SIGNS[node.sign](), _code(node.right))
    whole = _whole(node.right)
    if whole == 2 and isinstance(node.left, Name):
        return ast.BinOp(_code(node.left), ast.Mult(), _code(node.left))
    if whole is not None:
        return ast.Call(_load("whole_power"), [_code(node.left), ast.Constant(whole)], [])
    return ast.Call(_load("power"), [_code(node.left), _code(node.right)], [])


def _whole(node: Node) -> int | None:
    """Return the exponent if it is a whole number, small enough to multiply it out."""
    if isinstance(node, Negative):
        inner = _whole(node.of)
        return None if inner is None else -inner
    whole = isinstance(node, Number) and node.value.is_integer() and node.value <= _WHOLE
    return int(node.value) if whole and isinstance(node, Number) else None


# --- affine in states and inputs? -------------------------------------------------------------------------------------


def _affine(node: Node, found: Mapping[str, Form | None]) -> Form | None:
    """Return the affine form of a tree, given those of the names that are not constant; None if it has none."""
    if isinstance(node, Name) and node.name in found:
        form = found[node.name]
        return None if form is None else dict(form)
    if not any(symbol.name in found for symbol in names(node)):
        return {"": node}
    if isinstance(node, Negative):
        inner = _affine(node.of, found)
        return None if inner is None else {v: _negative(c) for v, c in inner.items()}
    inner_forms = [_affine(part, found) for part in parts(node)]
    if any(form is None for form in inner_forms):
        return None
    forms = [form for form in inner_forms if form is not None]
    constant = [set(form) <= {""} for form in forms]
    if all(constant):  # steps without states and inputs
        alone = [form.get("", Number(0.0)) for form in forms]
        return {"": Call(node.function, tuple(alone)) if isinstance(node, Call) else Binary(node.sign, *alone)}  # type: ignore[union-attr]
    if not isinstance(node, Binary):
        return None
    left, right = forms
    if node.sign in "+-":
        out = dict(left)
        for v, c in right.items():
            if v in out:
                out[v] = Binary(node.sign, out[v], c)
            else:
                out[v] = c if node.sign == "+" else _negative(c)
        return out
    if node.sign == "*" and any(constant):
        factor, other = (left, right) if constant[0] else (right, left)
        return {v: _product(factor.get("", Number(0.0)), c) for v, c in other.items()}
    if node.sign == "/" and constant[1]:
        return {v: Binary("/", c, right[""]) for v, c in left.items()}
    return left if node.sign == "^" and node.right == _ONE else None


def _multiplied(node: Node, name: str, varies: Collection[str]) -> bool:
    """Say whether a bare ``name`` is a factor of what varies, or stands in a function, a power or a denominator."""

    def bare(part: Node) -> bool:
        if isinstance(part, Name):
            return part.name == name
        if isinstance(part, Binary) and part.sign in "+-":
            sides = (part.left, part.right)
            alone = [side for side in sides if not (isinstance(side, Name) and side.name == name)]
            if len(alone) == 1 and not any(symbol.name in varies for symbol in names(alone[0])):
                return False
        return any(bare(p) for p in parts(part))

    if isinstance(node, Call) or (isinstance(node, Binary) and node.sign == "^"):
        return any(bare(p) for p in parts(node))
    if isinstance(node, Binary) and node.sign in "*/":
        left, right = (any(symbol.name in varies for symbol in names(p)) for p in (node.left, node.right))
        if (bare(node.left) and right) or (bare(node.right) and (left or node.sign == "/")):
            return True
    return any(_multiplied(p, name, varies) for p in parts(node))


def _negative(node: Node) -> Node:
    return (
        node.of if isinstance(node, Negative) else Number(-node.value) if isinstance(node, Number) else Negative(node)
    )


def _product(a: Node, b: Node) -> Node:
    return b if a == _ONE else a if b == _ONE else Binary("*", a, b)


# --- whether the speed stayed constant enough for a structure that leaves it out --------------------------------------


_SHARE = 0.3  # of the change of the flight path that speed alone makes
_G = 9.81


def speed_doubts(records: Sequence[FlightRecord], V_m_s: float | None) -> list[Advice]:
    """Return the doubt that a short-period model without airspeed takes up what the airspeed did.

    Lift grows with the square of speed, so that a speed V0 + v bends the flight path by 2 g v / V0^2. Its integral is
    compared with alpha less the integral of q, which is what the normal force did to the path altogether; a straight
    line is removed from both, since trims and biases make one.

    Args:
        records: prepared, with V, alpha and q; others say nothing.
        V_m_s: trimmed airspeed V0; None: the mean that was removed from V.
    """
    shares, moved = [], []
    for record in records:
        speed = V_m_s or dict(record.provenance.get("prepared", {}).get("removed", {})).get("V")
        if not speed or any(name not in record.channels for name in ("V", "alpha", "q")):
            continue
        part = record.select(("V", "alpha", "q"))
        V, alpha, q = (np.where(ok, z, 0.0) for z, ok in zip(part.data.T, part.valid.T, strict=True))
        V = V - speed if abs(float(np.mean(V))) > 0.5 * speed else V
        by_speed = _bent(np.cumsum(2.0 * _G * V / speed**2) * record.dt_s)
        whole = _bent(alpha - np.cumsum(q) * record.dt_s)
        if whole > 0.0:
            shares.append(by_speed / whole)
            moved.append(float(np.std(V)) / speed)
    if not shares or float(np.median(shares)) < _SHARE:
        return []
    return [
        doubt(
            "speed_left_out",
            f"the structure leaves out the airspeed, which varied by {100 * float(np.median(moved)):.1f} % (rms) and "
            f"through lift alone curved the path {float(np.median(shares)):.1f} times as much as the whole measured "
            "motion: Z_alpha, Z_q and the quantities that depend on them are biased beyond their errors; estimate V "
            "and theta as well (leave out short), or identify from a few seconds after a fast input",
        )
    ]


def _bent(angle: FloatArray) -> float:
    """Return the root mean square of an angle (N,) about its straight line."""
    t = np.linspace(-1.0, 1.0, angle.size)
    return float(np.std(angle - np.polyval(np.polyfit(t, angle, 1), t)))


# --- structures -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, kw_only=True)
class Written(ModelStructure):
    """What structures from text share: their law, and where their states begin."""

    law: Law  #: the equations
    moving: tuple[str, ...]  #: inputs that must move for the parameters to be found
    means: str = ""  #: packaged structure whose parameters these are; "" if that is not said

    @property
    def meaning(self) -> str:
        """What the equations say that their parameters mean."""
        return self.means

    @property
    def must_move(self) -> tuple[str, ...]:
        """Inputs that must move: those declared, else controls."""
        return self.moving

    @property
    def begun(self) -> tuple[str, ...]:
        """States whose start ``initial`` says."""
        return tuple(state for state, _ in self.law.initial)

    def initial_state(self, record: FlightRecord, measured: bool = True) -> FloatArray:
        """Return where the states (n,) begin: as ``initial`` says, else as for any structure."""
        x = super().initial_state(record, measured)
        for state, value in self.law.start(record, dict(zip(self.parameter_names, self.values, strict=True))).items():
            x[self.states.index(state)] = value
        return x

    def doubts(self, records: Sequence[FlightRecord]) -> tuple[Advice, ...]:
        """Return what must be said where a speed was removed as trim, but the equations take it as a whole."""
        begun = {symbol.name for _, node in self.law.initial for symbol in names(node)}
        shown = self.law.forms[1][len(self.states) :]
        bent = {name for name, form in zip(self.outputs, shown, strict=True) if form is None}
        out = AdviceList()
        for name in _WHOLE_ONLY:
            multiplied = name in (*self.states, *self.inputs) and self.law.multiplies(name)
            removed = [dict(r.provenance.get("prepared", {}).get("removed", {})).get(name, 0.0) for r in records]
            if (multiplied or name in begun or name in bent) and any(removed):
                out.doubt(
                    "trim_removed",
                    f"the equations take {name} as a whole, but {max(removed, key=abs):.4g} was removed from it as "
                    f'trim, so that they get deviations; if {name} itself is meant, take preparation.bias = "none", or '
                    f"write the sum of {name} and a constant",
                )
        return tuple(out)


@dataclass(frozen=True, eq=False, kw_only=True)
class WrittenStructure(Written):
    """A structure from equations as text that are not linear."""

    def derivative(self, x: AnyArray, u: AnyArray, params: AnyArray) -> AnyArray:
        """Return dx/dt, shape (..., n); not finite where an expression has no value."""
        return _stacked(self.law.derivative, x, u, params, bool(self.inputs))

    def output(self, x: AnyArray, u: AnyArray, params: AnyArray) -> AnyArray:
        """Return y, shape (..., p)."""
        return _stacked(self.law.output, x, u, params, bool(self.inputs))


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearWrittenStructure(Written, LinearStructure):
    """A structure from equations as text that are linear in states and inputs."""

    def matrices(self, params: AnyArray) -> Matrices:
        """Return the matrices of parameters (..., k)."""
        return self.law.matrices(params)


@dataclass(frozen=True, eq=False, kw_only=True)
class Packaged(LinearWrittenStructure):
    """A packaged structure that is linear; about the trim of the records, where it knows that."""

    trim: Trim | None = None

    @classmethod
    def of(cls, name: str, law: Law, parameters: Sequence[Parameter], trim: Trim | None = None) -> Packaged:
        """Return the structure of a law.

        Args:
            name: in the table of structures.
            law: its equations.
            parameters: all of them.
            trim: steady flight that states and inputs are deviations from.
        """
        return cls(
            name=name,
            states=law.states,
            inputs=law.inputs,
            outputs=law.outputs,
            parameters=tuple(parameters),
            law=law,
            moving=law.inputs,
            means=name,
            trim=trim,
        )

    def doubts(self, records: Sequence[FlightRecord]) -> tuple[Advice, ...]:
        """Return what must be said where the airspeed that is left out did much."""
        if "q" not in self.states or "V" in self.states or "alpha" not in self.states:
            return ()
        return tuple(speed_doubts(records, self.trim.V if self.trim else None))


def _stacked(function: Any, x: AnyArray, u: AnyArray, params: AnyArray, driven: bool) -> AnyArray:
    x, u, params = np.asarray(x), np.asarray(u), np.asarray(params)
    with np.errstate(all="ignore"):  # outside the range that an expression holds in, results are not finite
        values = function(x, u, params) if driven else function(x, params)
    shape = np.broadcast_shapes(x.shape[:-1], u.shape[:-1], params.shape[:-1])
    out = np.empty((*shape, len(values)), np.result_type(x, u, params, float))
    for i, value in enumerate(values):
        out[..., i] = value
    return out


def written(
    equations: Equations, name: str, outputs: Sequence[str], trim: Trim | None = None
) -> WrittenStructure | LinearWrittenStructure:
    """Return the structure of equations as text, with those parameters and inputs that its outputs need.

    Args:
        equations: as they were read.
        name: what tables call it.
        outputs: (p,) some of ``equations.possible_outputs``.
        trim: what V_trim, alpha_trim and theta_trim are; None where no airspeed is known.

    Raises:
        EstimationError: no output, one that there is not, or equations need a trim that is not known.
    """
    possible = equations.possible_outputs
    if not outputs:
        raise EstimationError(f"structure '{name}' needs an output; there can be {', '.join(possible)}")
    for output in outputs:
        if output not in possible:
            raise EstimationError(
                f"structure '{name}' has no output '{output}'{nearest(output, possible)}; give it an equation under "
                "outputs"
            )
    rates = [f"{state}_dot" for state in equations.states]
    shown = [equations.output(output) for output in outputs]
    steps, symbols = equations.reached([*(Name(rate) for rate in rates), *shown])
    constants = {"pi": math.pi, **equations.constants}
    if trim is not None:
        constants |= dict(zip(TRIM, (trim.V, trim.alpha, trim.theta), strict=True))
    for symbol in symbols:
        if symbol in TRIM and symbol not in constants:
            raise EstimationError(
                f"structure '{name}' uses {symbol}, but no trim is known: give V_m_s, or sense V and remove its trim "
                "value"
            )
    inputs = equations.driven_by(symbols)
    parameters = tuple(
        Parameter(
            key,
            p.value,
            p.free,
            -math.inf if p.low is None else p.low,
            math.inf if p.high is None else p.high,
            p.prior_std,
        )
        for key, p in equations.parameters.items()
        if key in symbols
    )
    law = Law(
        states=equations.states,
        inputs=inputs,
        outputs=tuple(outputs),
        parameters=tuple(p.name for p in parameters),
        steps=tuple((step, _put(equations.trees[step], constants)) for step in steps),
        rates=tuple(Name(rate) for rate in rates),
        shown=tuple(_put(node, constants) for node in shown),
        initial=tuple((state, _put(node, constants)) for state, node in equations.begins.items()),
    )
    kind = LinearWrittenStructure if law.linear else WrittenStructure
    return kind(
        name=name,
        states=equations.states,
        inputs=inputs,
        outputs=tuple(outputs),
        parameters=parameters,
        law=law,
        moving=equations.must_move(inputs),
        means=equations.means or "",
    )


def _put(node: Node, constants: Mapping[str, float]) -> Node:
    """Return a tree with the values of constants in the place of their names."""
    if isinstance(node, Name):
        return Number(float(constants[node.name])) if node.name in constants else node
    if isinstance(node, Negative):
        return _negative(_put(node.of, constants))
    if isinstance(node, Binary):
        return Binary(node.sign, _put(node.left, constants), _put(node.right, constants))
    if isinstance(node, Call):
        return Call(node.function, tuple(_put(part, constants) for part in node.arguments))
    return node


def structure_from_equations(
    *, name: str = "own", trim: Trim | None = None, **table: Any
) -> WrittenStructure | LinearWrittenStructure:
    """Return a structure from state equations as text, for ``output_error.estimate`` and the other methods.

    Args:
        name: what tables call it.
        trim: what V_trim, alpha_trim and theta_trim are.
        table: ``states``, ``equations``, ``parameters`` and the other keys of a file of equations, see
            :class:`~testbench.estimators.equations.Equations`. States that are channels are outputs too.

    Raises:
        EstimationError: an expression is wrong, a name unknown, an equation missing; all faults are listed.

    Example:
        >>> import testbench as tb
        >>> structure = tb.structure_from_equations(
        ...     states=["alpha", "q"],
        ...     equations={
        ...         "alpha_dot": "Z_alpha*alpha + q",
        ...         "q_dot": "M_alpha*alpha + M_alpha2*alpha^2 + M_q*q + M_de*de",
        ...     },
        ...     parameters={"Z_alpha": -1.0, "M_alpha": -4.0, "M_alpha2": 0.0, "M_q": -2.0, "M_de": -5.0},
        ... )
        >>> structure.inputs, structure.outputs
        (('de',), ('alpha', 'q'))
        >>> structure.jacobians([0.1, 0.0], [0.0], structure.values).fx.round(3).tolist()
        [[-1.0, 1.0], [-4.0, -2.0]]
    """
    made, faults = parse(Equations, table, None)
    if made is None or faults:
        raise EstimationError("; ".join(faults))
    states_shown = [output for output in made.possible_outputs if output in made.states or output in made.outputs]
    return written(made, name, states_shown, trim)
