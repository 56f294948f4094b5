"""A flat program as functions of JAX: the same operations, each with a derivative that is finite."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from testbench.core.channels import channel
from testbench.core.constants import FT_M
from testbench.core.errors import LimitError
from testbench.core.record import FloatArray
from testbench.flight.batch import emit, forces, motion
from testbench.flight.batch import registers as r
from testbench.flight.batch.alone import Alone
from testbench.flight.batch.vector import Lanes, Language, Mask, Rows

Array = Any
"""A number per flight, or a tracer of one."""


def _with(function: Callable[..., Array], *partials: Callable[..., Array]) -> Callable[..., Array]:
    """Return a function with given partial derivatives, zero where one is not finite.

    Both sides of a condition are computed where flights are mapped; what is not taken must not turn the gradient into
    NaN, which zero times infinity is.

    Args:
        function: of numbers.
        partials: takes its value and the numbers, and returns the derivative by each.
    """
    own = jax.custom_jvp(function)

    def tangent(xs: tuple[Array, ...], dxs: tuple[Array, ...]) -> tuple[Array, Array]:
        y = own(*xs)
        slopes = [partial(y, *xs) for partial in partials]
        return y, sum(jnp.where(jnp.isfinite(k), k, 0.0) * dx for k, dx in zip(slopes, dxs, strict=True))

    own.defjvp(tangent)
    return own


@jax.custom_jvp
def _divide(a: Array, b: Array) -> Array:
    return jnp.divide(a, b)


@_divide.defjvp
def _divide_tangent(xs: tuple[Array, Array], dxs: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the quotient and what it changes by, with one division where two partial derivatives take two."""
    y, is_nothing = _divide(*xs), jnp.equal(xs[1], 0.0)
    over = jnp.where(is_nothing, 0.0, 1.0 / jnp.where(is_nothing, 1.0, xs[1]))
    return y, (dxs[0] - jnp.where(is_nothing, 0.0, y) * dxs[1]) * over


_OPERATIONS: Mapping[str, Callable[..., Array]] = {
    "fadd": operator.add, "fsub": operator.sub, "fmul": operator.mul, "fneg": operator.neg,
    "olt": operator.lt, "ole": operator.le, "ogt": operator.gt, "oge": operator.ge, "oeq": operator.eq,
    "une": operator.ne, "and": jnp.logical_and, "or": jnp.logical_or, "not": jnp.logical_not, "select": jnp.where,
    "fabs": jnp.abs, "floor": jnp.floor, "ceil": jnp.ceil, "trunc": jnp.trunc, "copysign": jnp.copysign,
    "exp": jnp.exp, "sin": jnp.sin, "cos": jnp.cos, "tan": jnp.tan, "atan": jnp.arctan, "fmod": jnp.fmod,
    "fdiv": _divide,
    "sqrt": _with(jnp.sqrt, lambda y, x: 0.5 / y),
    "log": _with(jnp.log, lambda y, x: 1.0 / x),
    "log10": _with(jnp.log10, lambda y, x: 1.0 / (np.log(10.0) * x)),
    "asin": _with(jnp.arcsin, lambda y, x: 1.0 / jnp.sqrt(1.0 - x * x)),
    "acos": _with(jnp.arccos, lambda y, x: -1.0 / jnp.sqrt(1.0 - x * x)),
    "atan2": _with(jnp.arctan2, lambda y, a, b: b / (a * a + b * b), lambda y, a, b: -a / (a * a + b * b)),
    "pow": _with(jnp.power, lambda y, a, b: b * jnp.power(a, b - 1.0), lambda y, a, b: y * jnp.log(a)),
}  # fmt: skip


class _Code(Language):
    """A frame while it is computed, or traced.

    Attributes:
        rows: register -> what it holds.
        read: registers that were read before they were written.
        written: registers that were written.
    """

    def __init__(self, T: FloatArray, rows: Mapping[int, Array]) -> None:
        self.rows = dict(rows)
        self.read, self.written = set[int](), set[int]()
        self._T, self._deep = T, 0

    def do(self, op: str, *xs: Array) -> Array:
        """Compute."""
        y = _OPERATIONS[op](*xs)
        if op == "pow" and self._deep:  # of a number that the branch, were it taken, would not have
            y = jnp.where(jnp.isnan(y), 0.0, y)
        return y

    def constant(self, number: float) -> np.float64:
        """Return a number, which stays one until it meets an array."""
        return np.float64(number)

    def load(self, base: str, row: int) -> Array:
        """Return what a register holds."""
        if row not in self.written:
            self.read.add(row)
        return self.rows[row]

    def store(self, base: str, row: int, x: Array) -> None:
        """Let a register hold it from now on."""
        self.written.add(row)
        self.rows[row] = x

    @contextmanager
    def branch(self, mask: Mask) -> Iterator[None]:
        """Do it, and take it back if it was not to be done: of a frame only time is asked for, which is known."""
        before = dict(self.rows)
        yield
        if not bool(mask.text):
            self.rows = before

    def sometimes(self, mask: Mask, work: Callable[[], Lanes], otherwise: Lanes | float) -> Lanes:
        """Compute both and take one."""
        self._deep += 1
        found = work().text
        self._deep -= 1
        other = otherwise.text if isinstance(otherwise, Lanes) else np.float64(otherwise)
        return Lanes(self, jnp.where(mask.text, found, other))

    def stage(self, name: str, work: Callable[[Rows], None], R: Rows) -> None:
        """Do it in place."""
        work(R)

    def look_up(self, at: int, *xs: Lanes) -> Lanes:
        """Return a table's value (see :func:`testbench.flight.batch.emit.table`)."""
        return Lanes(self, _table(self._T, at, *(jnp.asarray(x.text) for x in xs)))


def _table(T: FloatArray, at: int, *xs: Array) -> Array:
    n = int(T[at])
    if len(xs) == 1:
        return _between(T[at + 1 : at + 1 + n], T[at + 1 + n : at + 1 + 2 * n], xs[0])
    if len(xs) == 2:
        return _two(T, at, *xs)
    row, column, depth = xs
    keys, planes = T[at + 1 : at + 1 + n], [at + int(x) for x in T[at + 1 + n : at + 1 + 2 * n]]
    values = jnp.stack([_two(T, plane, row, column) for plane in planes])
    if n == 1:
        return values[0]
    k, K = _interval(keys, depth), jnp.asarray(keys)
    low, high = values[k], values[k + 1]
    y = (depth - K[k]) / (K[k + 1] - K[k]) * (high - low) + low
    return jnp.where(depth <= keys[0], values[0], jnp.where(depth >= keys[-1], values[-1], y))


def _interval(keys: FloatArray, x: Array) -> Array:
    """Return how many keys, but the first and the last, lie below ``x``."""
    return jnp.sum(jnp.asarray(keys[1:-1]) < x, dtype=int)


def _between(keys: FloatArray, values: FloatArray, x: Array) -> Array:
    if len(keys) == 1:
        return jnp.where(x == x, values[0], jnp.nan)
    k, K, Y = _interval(keys, x), jnp.asarray(keys), jnp.asarray(values)
    y = (x - K[k]) / (K[k + 1] - K[k]) * (Y[k + 1] - Y[k]) + Y[k]
    return jnp.where(x <= keys[0], values[0], jnp.where(x >= keys[-1], values[-1], y))


def _two(T: FloatArray, at: int, row: Array, column: Array) -> Array:
    n, m = int(T[at]), int(T[at + 1])
    rows, columns = T[at + 2 : at + 2 + n], T[at + 2 + n : at + 2 + n + m]
    values = T[at + 2 + n + m : at + 2 + n + m + n * m].reshape(n, m)
    if m == 1:
        return _between(rows, values[:, 0], row)
    Y = jnp.asarray(values)
    j, across = _fraction(columns, column)
    if n == 1:
        return across * (Y[0, j + 1] - Y[0, j]) + Y[0, j]
    i, up = _fraction(rows, row)
    left = up * Y[i + 1, j] + (1.0 - up) * Y[i, j]
    right = up * Y[i + 1, j + 1] + (1.0 - up) * Y[i, j + 1]
    return across * (right - left) + left


def _fraction(keys: FloatArray, x: Array) -> tuple[Array, Array]:
    k, K = _interval(keys, x), jnp.asarray(keys)
    f = (x - K[k]) / (K[k + 1] - K[k])
    return k, jnp.where(f < 0.0, 0.0, jnp.where(f > 1.0, 1.0, f))


class Frames:
    """A model's frame and its channels, as functions of what changes from frame to frame.

    Args:
        model: what flies.
        changed: register that a parameter changes -> its slopes by the parameters.
        parameters: values at which the model's registers hold.

    Attributes:
        rows: registers that make the state, those that a frame or the outputs read and a frame or an input writes.
        state: (rows,) at the trim.
    """

    def __init__(self, model: Alone, changed: Mapping[int, FloatArray], parameters: FloatArray) -> None:
        self._model, self._changed, self._at = model, changed, parameters
        self._known = dict(enumerate(model.registers[: model.program.scratch]))
        self._per_mass = np.array([channel(x.name).per_mass for x in model.outputs])
        frame, log = _Code(model.program.tables, self._known), _Code(model.program.tables, self._known)
        jax.eval_shape(lambda: self._fly(frame))
        jax.eval_shape(lambda: self._read(log))
        given = {x.register for x in model.inputs}
        self.rows = sorted((frame.read & frame.written) | (log.read & (frame.written | given)))
        moved = sorted(set(changed) & frame.written)
        if moved:
            raise LimitError(f"a parameter must change no state of {model.aircraft.name}, but one changes {len(moved)}")
        self.state = jnp.asarray(model.registers[self.rows])
        self.step = jax.checkpoint(self._step)  # backwards, a frame is computed anew: to keep all of it takes longer

    def _step(self, state: Array, inputs: Array, parameters: Array = None) -> Array:
        """Return the state after a frame."""
        with np.errstate(all="ignore"):
            code = self._begun(state, parameters)
            for k, x in enumerate(self._model.inputs):
                code.rows[x.register] = inputs[k] / x.factor
            self._fly(code)
            return jnp.stack([code.rows[k] for k in self.rows])

    def begin(self, parameters: Array = None) -> Array:
        """Return the state at the motion and the commands of the trim, at which other parameters have other forces."""
        h_m, phi, theta, psi, u, v, w, *pqr = self._model.at_trim()
        at = [h_m / FT_M, phi, theta, psi, u / FT_M, v / FT_M, w / FT_M, *pqr]
        place = Rows(_Code(self._model.program.tables, dict(enumerate(map(np.float64, at)))))

        def settle(_: int, state: Array) -> Array:
            with np.errstate(all="ignore"):
                code = self._begun(state, parameters, stands=True)
                R = Rows(code)
                motion.place(R, place)
                self._fly(code)
                motion.begin(Rows(code))
                return jnp.stack([code.rows[k] for k in self.rows])

        return jax.lax.fori_loop(0, 2 * self._model.iterations, settle, self.state)

    def outputs(self, state: Array, parameters: Array = None) -> Array:
        """Return the channels."""
        with np.errstate(all="ignore"):
            code = self._begun(state, parameters)
            values = self._read(code)
            lighter = self._model.registers[r.WEIGHT] / code.rows[r.WEIGHT]
            return jnp.stack(values) * jnp.where(self._per_mass, lighter, 1.0)

    def _begun(self, state: Array, parameters: Array, stands: bool = False) -> _Code:
        """Return a frame that begins: constants, for parameters that are given anew, and the state."""
        code = _Code(self._model.program.tables, self._known)
        if stands:
            code.rows[r.DT] = np.float64(0.0)
        if self._changed and parameters is not None:
            away = jnp.asarray(parameters) - self._at
            for row, slopes in self._changed.items():
                code.rows[row] = code.rows[row] + jnp.dot(slopes, away)
            forces.weigh(Rows(code))
        if stands or (self._changed and parameters is not None):
            emit.do(Rows(code), self._model.program.before, code.look_up)
        code.rows.update(zip(self.rows, jnp.asarray(state), strict=True))
        return code

    def _fly(self, code: _Code) -> Array:
        program = self._model.program
        emit.do(Rows(code, scratch=program.scratch), program.frame, code.look_up)
        return code.rows[r.TIME]

    def _read(self, code: _Code) -> list[Array]:
        program = self._model.program
        R = Rows(code, scratch=program.scratch)
        emit.do(R, program.log, code.look_up)
        return [R[x.register].text * x.factor for x in self._model.outputs]
