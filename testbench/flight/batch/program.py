"""A flat program: what a model computes in a frame, as operations on registers.

Translators build it in the order in which JSBSim computes, in single assignment: every result is a new value. What is
computed twice is computed once; what nothing reads is left out; what does not change from frame to frame is computed
before the first. Numbers of the model are registers, too, so that flights of one batch can differ in them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from testbench.core.record import FloatArray
from testbench.flight.batch import registers as r

if TYPE_CHECKING:
    from testbench.flight.batch.machine import Flying


class Untranslated(Exception):
    """A model holds something that the batch does not fly; the message is one clause that says what."""


class Op(IntEnum):
    """Operations. Arithmetic is JSBSim's own: x/0 is its HUGE_VAL, the root of a negative number -HUGE_VAL."""

    COPY = 0
    ADD = 1
    SUB = 2
    MUL = 3
    QUOTIENT = 4
    DIV = 5
    MIN = 6
    MAX = 7
    POW = 8
    SQRT = 9
    EXP = 10
    LN = 11
    LOG2 = 12
    LOG10 = 13
    SIN = 14
    COS = 15
    TAN = 16
    ASIN = 17
    ACOS = 18
    ATAN = 19
    ATAN2 = 20
    ABS = 21
    SIGN = 22
    FLOOR = 23
    CEIL = 24
    FMOD = 25
    MOD = 26
    FRACTION = 27
    INTEGER = 28
    ROUND = 29
    LT = 30
    LE = 31
    GT = 32
    GE = 33
    EQ = 34
    NE = 35
    AND = 36
    OR = 37
    NOT = 38
    SELECT = 39
    CLIP = 40
    TABLE_1 = 41
    TABLE_2 = 42
    TABLE_3 = 43
    NEG = 45
    KINEMATIC = 46
    # stages of the frame
    PROPAGATE = 60
    AUXILIARY = 61
    AIR_DATA = 62
    PITOT = 69
    MOTION_NUMBERS = 63
    AERODYNAMICS = 64
    CLEAR = 65
    REACTION = 66
    THRUSTER = 67
    ACCELERATE = 68
    EULER = 70
    GEOGRAPHY = 71
    EULER_RATES = 72
    ALTITUDES = 73
    HELD = 74  # in place of PROPAGATE, where the motion is given
    # what is not translated: a fault only if something that flies reads it
    UNKNOWN = 99


MOST_DETENTS = 1024
"""Of a kinematic, more than any has: where they lie and how many they are share a number."""

_CORE = "core"
_STATE = "state"
_NUMBER = "number"
_TEMP = "temp"

_ACCELERATIONS = (*range(r.U_DOT, r.GRAVITY), *range(r.RATE_DOT, r.INERTIAL_TO_BODY), *range(r.FORCE, r.COUNT))
WRITES: Mapping[Op, tuple[int, ...]] = {
    Op.PROPAGATE: tuple(x for x in (*range(r.TIME, r.GUST), *range(r.WIND, r.U_AERO)) if x not in _ACCELERATIONS),
    Op.EULER: tuple(range(r.PHI, r.LATITUDE)),
    Op.GEOGRAPHY: tuple(range(r.LATITUDE, r.PHI_DOT)),
    Op.EULER_RATES: tuple(range(r.PHI_DOT, r.DENSITY_ALTITUDE)),
    Op.AUXILIARY: (*range(r.U_AERO, r.GAMMA), *range(r.COS_ALPHA, r.N_X), r.CL_SQUARED),
    Op.AIR_DATA: (r.GAMMA, r.TRACK, *range(r.N_X, r.CL_SQUARED)),
    Op.PITOT: tuple(range(r.TOTAL_TEMPERATURE, r.COS_ALPHA)),
    Op.MOTION_NUMBERS: tuple(range(r.BI2VEL, r.PHI)),
    Op.AERODYNAMICS: tuple(range(r.AERO_FORCE, r.ENGINE_FORCE)),
    Op.CLEAR: (),
    Op.REACTION: tuple(range(r.ADDED_FORCE, r.FORCE)),
    Op.THRUSTER: tuple(range(r.ENGINE_FORCE, r.ADDED_FORCE)),
    Op.ACCELERATE: _ACCELERATIONS,
    Op.ALTITUDES: (r.DENSITY_ALTITUDE, r.PRESSURE_ALTITUDE),
}
"""Stage -> registers of the rigid body that it writes."""


@dataclass(frozen=True, eq=False, slots=True)
class Value:
    """Something that an operation can read: a number of the model, a property, a register of the body, or a result.

    Formulas are written with values; a number beside one is the same in every model. A condition is 1 or 0.
    """

    builder: Builder
    kind: str
    key: int

    def do(self, op: Op, *others: Value | float) -> Value:
        """Return the result of an operation of which this is the first operand."""
        return self.builder.emit(op, self, *others)

    def _after(self, op: Op, first: float) -> Value:
        return self.builder.emit(op, first, self)

    # fmt: off
    def __add__(self, x: Value | float) -> Value: return self.do(Op.ADD, x)
    def __radd__(self, x: float) -> Value: return self._after(Op.ADD, x)
    def __sub__(self, x: Value | float) -> Value: return self.do(Op.SUB, x)
    def __rsub__(self, x: float) -> Value: return self._after(Op.SUB, x)
    def __mul__(self, x: Value | float) -> Value: return self.do(Op.MUL, x)
    def __rmul__(self, x: float) -> Value: return self._after(Op.MUL, x)
    def __truediv__(self, x: Value | float) -> Value: return self.do(Op.DIV, x)
    def __rtruediv__(self, x: float) -> Value: return self._after(Op.DIV, x)
    def __pow__(self, x: Value | float) -> Value: return self.do(Op.POW, x)
    def __lt__(self, x: Value | float) -> Value: return self.do(Op.LT, x)
    def __le__(self, x: Value | float) -> Value: return self.do(Op.LE, x)
    def __gt__(self, x: Value | float) -> Value: return self.do(Op.GT, x)
    def __ge__(self, x: Value | float) -> Value: return self.do(Op.GE, x)
    def __and__(self, x: Value) -> Value: return self.do(Op.AND, x)
    def __or__(self, x: Value) -> Value: return self.do(Op.OR, x)
    def __neg__(self) -> Value: return self.do(Op.NEG)
    def __abs__(self) -> Value: return self.do(Op.ABS)
    # fmt: on

    def equals(self, x: Value | float) -> Value:
        """Return whether both are equal."""
        return self.do(Op.EQ, x)

    def differs(self, x: Value | float) -> Value:
        """Return whether they are not equal."""
        return self.do(Op.NE, x)

    def at_most(self, x: Value | float) -> Value:
        """Return the lesser of both."""
        return self.do(Op.MIN, x)

    def at_least(self, x: Value | float) -> Value:
        """Return the greater of both."""
        return self.do(Op.MAX, x)

    def then(self, yes: Value | float, no: Value | float) -> Value:
        """Return ``yes`` where this condition holds, else ``no``."""
        return self.do(Op.SELECT, yes, no)


@dataclass
class _Instruction:
    op: Op
    arguments: tuple[Value, ...]
    extra: int
    result: Value | None  # None: a stage, or a write into registers of the body
    target: int = -1  # register of the body that is written


@dataclass(frozen=True)
class Program:
    """What is computed, as numbers."""

    # (n, 6) operations done before the first frame: operation, target, three operands, a further number
    before: npt.NDArray[np.int64]
    frame: npt.NDArray[np.int64]  # (n, 6) of every frame
    log: npt.NDArray[np.int64]  # (n, 6) after frames that are logged
    tables: FloatArray  # all tables, one after the other
    size: int  # number of registers
    scratch: int  # from here on a frame numbers results that only it reads, which are in no memory
    numbers: npt.NDArray[np.int64]  # register of each number of the model, in the order in which they stand there
    properties: Mapping[str, int]  # property -> its register
    logged: Mapping[str, int]  # name -> register, after ``log``

    @cached_property
    def machine(self) -> Flying:
        """The program as it runs."""
        from testbench.flight.batch.machine import machine_of

        return machine_of(self)


@dataclass(eq=False)
class Builder:
    """Collects a program."""

    inputs: frozenset[str] = frozenset()  # properties that are written from outside in every frame
    numbers: list[float] = field(default_factory=list)  # of the model
    # (number, element whose text it is, what it is multiplied by) of those that may differ
    places: list[tuple[int, ET.Element, float]] = field(default_factory=list)
    tables: list[float] = field(default_factory=list)  # one after the other
    _frame: list[_Instruction] = field(default_factory=list)
    _log: list[_Instruction] = field(default_factory=list)
    _logging: bool = False
    _known: dict[tuple[object, ...], Value] = field(default_factory=dict)
    _current: dict[str, Value] = field(default_factory=dict)
    _states: dict[str, Value] = field(default_factory=dict)
    _cores: dict[int, Value] = field(default_factory=dict)
    _temps: int = 0
    _blocks: list[int] = field(default_factory=list)
    _logged: dict[str, Value] = field(default_factory=dict)
    _stored: set[int] = field(default_factory=set)
    _reasons: list[str] = field(default_factory=list)
    _constants: dict[float, Value] = field(default_factory=dict)

    def number(self, x: float, at: ET.Element | None = None, factor: float = 1.0) -> Value:
        """Return the value of a number of the model; each has a register of its own, whatever it is.

        Args:
            x: the number.
            at: element whose text it is, times ``factor``; another model may have another number there.
            factor: to the unit of ``x``.
        """
        self.numbers.append(float(x))
        if at is not None:
            self.places.append((len(self.numbers) - 1, at, factor))
        return Value(self, _NUMBER, len(self.numbers) - 1)

    def constant(self, x: float) -> Value:
        """Return the value of a number that is the same in every model; it has one register however often it stands."""
        if x not in self._constants:
            self._constants[x] = self.number(x)
        return self._constants[x]

    def core(self, register: int) -> Value:
        """Return the value that a register of the body has at this place of the frame."""
        if register not in self._cores:
            self._cores[register] = Value(self, _CORE, register)
        return self._cores[register]

    def read(self, name: str) -> Value:
        """Return the value that a property has at this place of the frame."""
        return self._current[name] if name in self._current else self._state(name)

    @property
    def present(self) -> Mapping[str, Value]:
        """Properties that have been written -> their values, at this place of the frame."""
        return self._current

    def unknown(self, reason: str) -> Value:
        """Return a value that is not translated; the program cannot be built if anything that counts reads it."""
        self._reasons.append(reason)
        return self.emit(Op.UNKNOWN, extra=len(self._reasons) - 1)

    def _state(self, name: str) -> Value:
        if name not in self._states:
            self._states[name] = Value(self, _STATE, len(self._states))
        return self._states[name]

    def write(self, name: str, value: Value) -> None:
        """Give a property a value, from this place of the frame on."""
        self._state(name)
        self._current[name] = value if value.kind == _TEMP else self.emit(Op.COPY, value)

    def emit(self, op: Op, *operands: Value | float, extra: int = 0) -> Value:
        """Return the result of an operation, the former one if it has been done already."""
        arguments = tuple(x if isinstance(x, Value) else self.constant(x) for x in operands)
        key = (op, arguments, extra)
        if key not in self._known:
            self._temps += 1
            result = Value(self, _TEMP, self._temps)
            self._known[key] = result
            self._list.append(_Instruction(op, arguments, extra, result))
        return self._known[key]

    @property
    def _list(self) -> list[_Instruction]:
        return self._log if self._logging else self._frame

    def moved(self, x: Value, y: Value, dt: Value, detents: Sequence[Value], times: Sequence[Value]) -> Value:
        """Return where a kinematic at ``y`` is after ``dt`` on its way to ``x``, from detent to detent."""
        first = self.block([*detents, *times])
        return self.emit(Op.KINEMATIC, x, y, dt, extra=first * MOST_DETENTS + len(detents))

    def store(self, register: int, value: Value) -> None:
        """Write a register of the body."""
        self._list.append(_Instruction(Op.COPY, (value,), 0, None, register))
        self._bump((register,))
        self._stored.add(register)

    def stage(self, op: Op, *extra: int, block: int = -1) -> None:
        """Do a stage of the frame.

        Args:
            op: which.
            extra: up to two numbers that it takes.
            block: of registers that it reads, see ``block``; or the register itself for CLEAR.
        """
        packed = extra[0] if len(extra) == 1 else extra[0] + 16 * extra[1] if extra else 0
        self._list.append(_Instruction(op, (), packed, None, block))
        self._bump(WRITES[op])

    def block(self, values: Sequence[Value]) -> int:
        """Lay values into registers that follow each other; return the first."""
        first = r.COUNT + sum(self._blocks)
        self._blocks.append(len(values))
        for i, value in enumerate(values):
            self._list.append(_Instruction(Op.COPY, (value,), 0, None, first + i))
        return first

    def _bump(self, registers: Iterable[int]) -> None:
        for register in registers:
            self._cores.pop(register, None)

    def table(self, numbers: Sequence[float]) -> int:
        """Keep a table; return where it begins."""
        self.tables.extend(float(x) for x in numbers)
        return len(self.tables) - len(numbers)

    def begin_log(self) -> None:
        """End the frame: what follows reads what it has left."""
        self._ended = dict(self._current)
        self._logging = True
        self._known, self._current = {}, {}
        self._bump(range(r.COUNT))

    def log(self, name: str, value: Value) -> None:
        """Log a value."""
        self._logged[name] = value

    def build(self) -> Program:
        """Return the program.

        Raises:
            Untranslated: something that flies reads a value that is not translated.
        """
        return _Assembly(self).program()


class _Assembly:
    """Turns what a builder collected into a program."""

    def __init__(self, b: Builder) -> None:
        self._b = b
        self._frame, self._log = list(b._frame), list(b._log)
        self._names = {state.key: name for name, state in b._states.items()}
        self._commit = {b._states[name].key: value for name, value in b._ended.items()}
        self._live()

    def _live(self) -> None:
        """Leave out operations whose results nothing reads; keep the properties that something reads."""
        b, needed, states = self._b, set[Value](), set[int]()
        makes = {item.result: item for item in (*self._frame, *self._log) if item.result is not None}
        wanted = [*b._logged.values()]
        wanted += [v for item in (*self._frame, *self._log) if item.result is None for v in item.arguments]
        while wanted:
            value = wanted.pop()
            if value.kind == _TEMP and value not in needed:
                needed.add(value)
                wanted += makes[value].arguments
            elif value.kind == _STATE and value.key not in states:
                states.add(value.key)
                wanted += [self._commit[value.key]] if value.key in self._commit else []
        kept = [[i for i in items if i.result is None or i.result in needed] for items in (self._frame, self._log)]
        self._frame, self._log = kept
        unknown = [i for i in (*self._frame, *self._log) if i.op is Op.UNKNOWN]
        if unknown:
            raise Untranslated(b._reasons[unknown[0].extra])
        self._states = states
        self._commit = {s: v for s, v in self._commit.items() if s in states}

    def _hoist(self) -> tuple[list[_Instruction], list[_Instruction]]:
        """Return what can be done before the first frame, and what cannot."""
        b = self._b
        changing = set(range(r.TIME, r.WING_AREA)) | set(range(r.NATIVE, r.COUNT)) | b._stored
        moving = {b._states[n].key for n in b.inputs if n in b._states} | set(self._commit)
        fixed: set[Value] = set()

        def still(value: Value) -> bool:
            if value.kind == _NUMBER or value in fixed:
                return True
            if value.kind == _STATE:
                return value.key not in moving
            return value.kind == _CORE and value.key not in changing

        before, frame = [], []
        written: dict[int, int] = {}
        for item in self._frame:
            if item.target >= 0 and item.op is Op.COPY:
                written[item.target] = written.get(item.target, 0) + 1
        for item in self._frame:
            if item.result is not None and all(still(v) for v in item.arguments):
                fixed.add(item.result)
                before.append(item)
            elif (
                item.op is Op.COPY
                and item.result is None
                and item.target >= r.COUNT
                and written[item.target] == 1
                and all(still(v) for v in item.arguments)
            ):
                before.append(item)  # a number in a block
            else:
                frame.append(item)
        return before, frame

    def program(self) -> Program:
        """Return the program with registers given out."""
        b = self._b
        before, frame = self._hoist()
        next_free = r.COUNT + sum(b._blocks)
        state_register = {}
        for s in sorted(self._states):
            state_register[s] = next_free
            next_free += 1
        first_number = next_free
        next_free += len(b.numbers)
        place: dict[Value, int] = {}

        def of(value: Value) -> int:
            if value.kind == _NUMBER:
                return first_number + value.key
            if value.kind == _STATE:
                return state_register[value.key]
            return value.key if value.kind == _CORE else place[value]

        base = next_free + sum(item.result is not None for item in before)
        code: dict[str, list[tuple[int, ...]]] = {}
        for part, items, first in (("before", before, next_free), ("frame", frame, base), ("log", self._log, base)):
            place |= {result: first + k for k, result in enumerate(i.result for i in items if i.result is not None)}
            code[part] = [_coded(item, of) for item in items]
        code["frame"] += [(int(Op.COPY), state_register[s], of(v), 0, 0, 0) for s, v in self._commit.items()]
        most = base + sum(item.result is not None for item in self._log)  # a frame's results are in no memory
        return Program(
            **{n: np.array(rows, np.int64).reshape(-1, 6) for n, rows in code.items()},
            tables=np.array([*b.tables, 0.0]),
            size=most,
            scratch=base,
            numbers=np.arange(first_number, first_number + len(b.numbers)),
            properties={self._names[s]: register for s, register in state_register.items()},
            logged={name: of(v) for name, v in b._logged.items()},
        )


def _coded(item: _Instruction, of: Callable[[Value], int]) -> tuple[int, ...]:
    operands = [of(v) for v in item.arguments]
    target = of(item.result) if item.result is not None else item.target
    operands += [0] * (3 - len(operands))
    return (int(item.op), target, *operands, item.extra)
