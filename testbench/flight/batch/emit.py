"""A flat program as machine code: each operation written down for LLVM, over all flights of a block at once."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt

from testbench.core.record import FloatArray
from testbench.flight.batch import air, forces, motion
from testbench.flight.batch.lookup import table
from testbench.flight.batch.program import MOST_DETENTS, Op, Program
from testbench.flight.batch.vector import (
    LANE,
    Code,
    Lanes,
    Mask,
    Module,
    Rows,
    ceil,
    copysign,
    double,
    fabs,
    floor,
    library,
    loop,
    sometimes,
    spread,
    sqrt,
    trunc,
    where,
)  # fmt: skip

HUGE = math.inf
_ROUNDOFF = 2.0 * float(np.finfo(float).eps)
_TOGETHER = 40  # operations whose results are taken from the processor; what is older is read from memory
_STAGES: dict[Op, Callable[..., None]] = {
    Op.PROPAGATE: motion.propagate,
    Op.AUXILIARY: air.auxiliary,
    Op.AIR_DATA: air.air_data,
    Op.PITOT: air.pitot,
    Op.MOTION_NUMBERS: forces.motion_numbers,
    Op.AERODYNAMICS: forces.aerodynamics,
    Op.CLEAR: forces.clear,
    Op.REACTION: forces.reaction,
    Op.THRUSTER: forces.thruster,
    Op.ACCELERATE: forces.accelerate,
    Op.EULER: motion.euler,
    Op.GEOGRAPHY: motion.geography,
    Op.EULER_RATES: motion.euler_rates,
    Op.ALTITUDES: air.altitudes,
    Op.HELD: motion.held,
}


def module_of(program: Program) -> str:
    """Return the functions of a program in LLVM's language.

    ``before``, ``frame`` and ``logged`` take the registers R (registers, LANES); ``run`` flies, see RUN.
    """
    module = Module()
    for name, rows in (("before", program.before), ("frame", program.frame), ("logged", program.log)):
        body = partial(_body, T=program.tables, rows=rows, scratch=program.scratch if name == "frame" else None)
        module.define(name, f"void @{name}(ptr noalias %R)", body)
    module.define("run", f"void @run({', '.join(RUN)})", _run)
    numbers = ", ".join(map(double, program.tables))
    return f"@T = internal constant [{program.tables.size} x double] [{numbers}]\n{module.text}"


def ground() -> str:
    """Return what prepares flights, in LLVM's language: ``place``, ``settle`` and ``weigh``."""
    module = Module()

    def place(code: Code) -> str:
        motion.place(Rows(code), Rows(code, "%A"))
        return "void"

    def settle(code: Code) -> str:
        with loop(code, "%times"):
            code.lines += ["  call void @place(ptr %R, ptr %A)", "  call void %frame(ptr %R)"]
            motion.begin(Rows(code))  # JSBSim's integrators remember what its second frame begins with
            code.lines.append("  call void %frame(ptr %R)")
        return "void"

    def weigh(code: Code) -> str:
        forces.weigh(Rows(code))
        return "void"

    module.define("place", "void @place(ptr noalias %R, ptr noalias %A)", place)
    module.define("settle", "void @settle(ptr %R, ptr %A, ptr %frame, i64 %times)", settle)
    module.define("weigh", "void @weigh(ptr %R)", weigh)
    return module.text


def _body(code: Code, T: FloatArray, rows: npt.NDArray[np.int64], scratch: int | None) -> str:
    do(Rows(code, scratch=scratch), rows, partial(table, code, T))
    return "void"


def do(R: Rows, rows: npt.NDArray[np.int64], look_up: Callable[..., Lanes]) -> None:
    """Write down operations of a program, in whatever language.

    Args:
        R: registers.
        rows: (n, 6) operations, see :class:`testbench.flight.batch.program.Program`.
        look_up: takes where a table begins, and row, column and plane; returns its value.
    """
    for k, (number, t, *operands, extra) in enumerate(rows.tolist()):
        op = Op(number)
        if k % _TOGETHER == 0:
            R.forget()
        if op in _STAGES:
            _stage(op, R, t, extra)
        elif op is Op.KINEMATIC:
            R[t] = _kinematic(R, operands, extra)
        elif op in _TABLES:
            R[t] = look_up(extra, *(R[x] for x in operands[: _TABLES[op]]))
        else:
            take, work = _OPERATIONS[op]
            R[t] = work(*(R[x] for x in operands[:take]))


def _stage(op: Op, R: Rows, t: int, extra: int) -> None:
    if op is Op.AERODYNAMICS:
        _STAGES[op](R, extra % 16, extra // 16)
    elif op is Op.REACTION:
        _STAGES[op](R, t, extra % 16, extra // 16)
    elif op in (Op.CLEAR, Op.THRUSTER, Op.HELD):
        _STAGES[op](R, t)
    else:
        _STAGES[op](R)


def _truth(x: Lanes) -> Lanes:
    """Return 1 or 0 for a condition; NaN for a number above one, at which JSBSim stops (GetBinary of FGFunction)."""
    x = fabs(x)
    return where(x < 1e-9, 0.0, where(x - 1.0 < 1e-9, 1.0, math.nan))


def _select(x: Lanes, y: Lanes, z: Lanes) -> Lanes:
    x = fabs(x)
    return where(x - 1.0 >= 1e-9, math.nan, where(x < 1e-9, z, y))  # what is neither true nor false: see _truth


def _least(x: Lanes, y: Lanes) -> Lanes:
    x = where(x < HUGE, x, HUGE)  # JSBSim's minimum takes no notice of NaN
    return where(y < x, y, x)


def _greatest(x: Lanes, y: Lanes) -> Lanes:
    x = where(x > -HUGE, x, -HUGE)
    return where(y > x, y, x)


def _both(x: Lanes, y: Lanes) -> Lanes:
    x, y = _truth(x), _truth(y)
    return where(x.equals(1.0), y, x)


def _either(x: Lanes, y: Lanes) -> Lanes:
    x, y = _truth(x), _truth(y)
    return where(x.equals(0.0), y, x)


def _clip(x: Lanes, low: Lanes, high: Lanes) -> Lanes:
    y = where(x < low, low, x)
    return where(high - low >= 0.0, where(y > high, high, y), x)


def _one(mask: Mask) -> Lanes:
    return where(mask, 1.0, 0.0)


def _positive(x: Lanes, y: Lanes) -> Lanes:
    """Return a logarithm of ``x``, where it has one."""
    return where(x > 0.0, y, -HUGE)


def _inside(x: Lanes, y: Lanes) -> Lanes:
    return where(fabs(x) <= 1.0, y, math.nan)


def _fraction_of(x: Lanes) -> Lanes:
    return copysign(where(fabs(x).differs(HUGE), x - trunc(x), 0.0), x)


def _round(x: Lanes) -> Lanes:
    """Round halves away from zero, as C does."""
    z = trunc(x)
    return where(fabs(x - z) >= 0.5, z + copysign(1.0, x), z)


# What stands in a model is C's library's, as JSBSim's is: a tangent or an arc cosine makes a last bit a large one.
_OPERATIONS: dict[Op, tuple[int, Callable[..., Lanes]]] = {
    Op.COPY: (1, lambda x: x),
    Op.ADD: (2, lambda x, y: x + y),
    Op.SUB: (2, lambda x, y: x - y),
    Op.MUL: (2, lambda x, y: x * y),
    Op.QUOTIENT: (2, lambda x, y: where(y.differs(0.0), x / y, HUGE)),
    Op.DIV: (2, lambda x, y: x / y),
    Op.MIN: (2, _least),
    Op.MAX: (2, _greatest),
    Op.POW: (2, partial(library, "pow")),
    Op.SQRT: (1, lambda x: where(x >= 0.0, sqrt(x), -HUGE)),
    Op.EXP: (1, partial(library, "exp")),
    Op.LN: (1, lambda x: _positive(x, library("log", x))),
    Op.LOG2: (1, lambda x: _positive(x, library("log10", x) * (1.0 / math.log10(2.0)))),
    Op.LOG10: (1, lambda x: _positive(x, library("log10", x))),
    Op.SIN: (1, partial(library, "sin")),
    Op.COS: (1, partial(library, "cos")),
    Op.TAN: (1, partial(library, "tan")),
    Op.ASIN: (1, lambda x: _inside(x, library("asin", x))),
    Op.ACOS: (1, lambda x: _inside(x, library("acos", x))),
    Op.ATAN: (1, partial(library, "atan")),
    Op.ATAN2: (2, partial(library, "atan2")),
    Op.ABS: (1, fabs),
    Op.SIGN: (1, lambda x: where(x < 0.0, -1.0, 1.0)),
    Op.FLOOR: (1, floor),
    Op.CEIL: (1, ceil),
    Op.FMOD: (2, lambda x, y: where(y.differs(0.0), library("fmod", x, y), HUGE)),
    Op.MOD: (2, lambda x, y: library("fmod", trunc(x), trunc(y)) + 0.0),  # integers have no zero with a sign
    Op.FRACTION: (1, _fraction_of),
    Op.INTEGER: (1, trunc),
    Op.ROUND: (1, _round),
    Op.LT: (2, lambda x, y: _one(x < y)),
    Op.LE: (2, lambda x, y: _one(x <= y)),
    Op.GT: (2, lambda x, y: _one(x > y)),
    Op.GE: (2, lambda x, y: _one(x >= y)),
    Op.EQ: (2, lambda x, y: _one(x.equals(y))),
    Op.NE: (2, lambda x, y: _one(x.differs(y))),
    Op.AND: (2, _both),
    Op.OR: (2, _either),
    Op.NOT: (1, lambda x: 1.0 - _truth(x)),
    Op.SELECT: (3, _select),
    Op.CLIP: (3, _clip),
    Op.NEG: (1, lambda x: -x),
}
_TABLES = {Op.TABLE_1: 1, Op.TABLE_2: 2, Op.TABLE_3: 3}


def _kinematic(R: Rows, operands: list[int], extra: int) -> Lanes:
    """Move from detent to detent until the time is over or the end is reached (FGKinemat)."""
    n, detents = extra % MOST_DETENTS, extra // MOST_DETENTS
    x, y, left = (R[k] for k in operands)
    keys, times = [R[detents + i] for i in range(n)], [R[detents + n + i] for i in range(n)]

    def is_there(y: Lanes) -> Mask:
        size, other = fabs(x), fabs(y)
        return fabs(x - y) <= _ROUNDOFF * where(other > size, other, size)

    def moved() -> Lanes:
        at, time = y, left
        going = ~(time <= 0.0) & ~is_there(at)
        for _ in range(2 * n):  # as many as there are detents on the way
            low, high, takes = keys[0], keys[1], times[1]
            up, further = x < at, going
            for i in range(1, n - 1):
                further = further & ((up & (keys[i] < at)) | (~up & (keys[i] <= at)))
                low, high = where(further, keys[i], low), where(further, keys[i + 1], high)
                takes = where(further, times[i + 1], takes)
            rate = (high - low) / takes
            end = where(x < low, low, where(x > high, high, x))
            needed = fabs((end - at) / rate)
            ends = time < needed
            needed = where(ends, time, needed)
            step = needed * rate
            then = where(ends, where(at < x, at + step, at - step), end)
            # above the last detent JSBSim reads past its list, and is there at once, as where no time is needed
            jumps = (at > keys[-1]) | (takes <= 0.0)
            at = where(going, where(jumps, x, then), at)
            time = where(going, time - needed, time)
            going = going & ~jumps & ~(time <= 0.0) & ~is_there(at)
        return at

    return sometimes(~(left <= 0.0) & ~is_there(y), moved, y)


RUN = (
    "ptr %R", "ptr %inputs", "ptr %targets", "i64 %n_inputs", "i64 %stride", "ptr %logged", "i64 %n_logged",
    "ptr %scale", "ptr %rows", "i64 %n_rows", "ptr %watched", "i64 %n_watched", "ptr %low", "ptr %high", "ptr %left",
    "ptr %broken", "ptr %value",
)  # fmt: skip
"""What ``run`` takes: registers; what is written before each frame (frames, inputs, LANES), and into which registers;
frames of a row; registers that make one, their factors (logged, LANES), the rows (rows, logged, LANES) that are filled;
registers that have limits, and these (watched, LANES); the row at which each flight left them, or -1, which limit it
broke, and with what (LANES)."""


def _run(code: Code) -> str:
    """Fly: inputs, frame, after every ``stride`` frames a row; until all flights have left their limits."""

    def number(base: str, i: str) -> str:
        return code.put(f"load i64, ptr {code.put(f'getelementptr i64, ptr {base}, i64 {i}')}")

    def row(base: str, i: str) -> str:
        return code.put(f"getelementptr {LANE}, ptr {base}, i64 {i}")

    def lanes(base: str, i: str = "0") -> Lanes:
        return Lanes(code, code.put(f"load {LANE}, ptr {row(base, i)}, align 8"))

    def store(x: Lanes, base: str, i: str = "0") -> None:
        code.lines.append(f"  store {LANE} {x.text}, ptr {row(base, i)}, align 8")

    with loop(code, "%n_rows") as k:
        with loop(code, "%stride") as s:
            frame = code.put(f"add i64 {code.put(f'mul i64 {k}, %stride')}, {s}")
            first = code.put(f"mul i64 {frame}, %n_inputs")
            with loop(code, "%n_inputs") as i:
                store(lanes("%inputs", code.put(f"add i64 {first}, {i}")), "%R", number("%targets", i))
            code.lines.append("  call void @frame(ptr %R)")
        code.lines.append("  call void @logged(ptr %R)")
        first = code.put(f"mul i64 {k}, %n_logged")
        with loop(code, "%n_logged") as i:
            x = lanes("%R", number("%logged", i)) * lanes("%scale", i)
            store(x, "%rows", code.put(f"add i64 {first}, {i}"))
        now = spread(code, code.put(f"sitofp i64 {k} to double"))
        with loop(code, "%n_watched") as i:
            x, left = lanes("%R", number("%watched", i)), lanes("%left")
            which = spread(code, code.put(f"sitofp i64 {i} to double"))
            leaves = ~((lanes("%low", i) <= x) & (x <= lanes("%high", i))) & (left < 0.0)
            store(where(leaves, now, left), "%left")
            store(where(leaves, which, lanes("%broken")), "%broken")
            store(where(leaves, x, lanes("%value")), "%value")
        flying, name = (lanes("%left") < 0.0).any(), code.name()
        code.lines += [f"  br i1 {flying}, label %{name}, label %{name}no", f"{name}no:", "  ret void", f"{name}:"]
        code.block = name
    return "void"
