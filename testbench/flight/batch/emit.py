"""A flat program as machine code: each operation written down for LLVM, over all flights of a block at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial, reduce

import numpy as np
import numpy.typing as npt

from testbench.core.record import FloatArray
from testbench.flight.batch import air, forces, motion
from testbench.flight.batch.program import MOST_DETENTS, Op, Program
from testbench.flight.batch.vector import (
    INT,
    LANE,
    LANES,
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
    splat,
    spread,
    sqrt,
    trunc,
    where,
    whole,
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


# --- tables -----------------------------------------------------------------------------------------------------------


def table(code: Code, T: FloatArray, begins: int, *xs: Lanes) -> Lanes:
    """Return a table's value at row, column and plane.

    Args:
        code: in which it is read.
        T: all tables. Of one dimension the number of rows, keys, values; of two the numbers of rows and columns, keys
            of rows, keys of columns, values row by row; of three the number of planes, their keys, where each begins,
            from here on.
        begins: where it does.
        xs: row, column, plane.
    """
    n = int(T[begins])
    if len(xs) == 1:
        return _between(code, T, begins + 1, begins + 1 + n, n, xs[0])
    if len(xs) == 2:
        return _two(code, T, begins, *xs)
    row, column, depth = xs
    keys = [float(x) for x in T[begins + 1 : begins + 1 + n]]
    planes = [begins + int(x) for x in T[begins + 1 + n : begins + 1 + 2 * n]]
    if n == 1:
        return _two(code, T, planes[0], row, column)
    above = [depth > key for key in keys[1:-1]]  # interval k is where those below k are true, and that at k is not
    everywhere = Mask(code, f"<{', '.join(['i1 true'] * LANES)}>")
    here = [
        reduce(Mask.__and__, [*above[k - 1 : k], *(~x for x in above[k : k + 1])], everywhere) for k in range(n - 1)
    ]
    at = [
        sometimes(reduce(Mask.__or__, here[max(k - 1, 0) : k + 1]), partial(_two, code, T, p, row, column), 0.0)
        for k, p in enumerate(planes)
    ]
    x0, x1, low, high = Lanes(code, splat(keys[0])), Lanes(code, splat(keys[1])), at[0], at[1]
    for k in range(1, n - 1):
        x0, x1 = where(here[k], keys[k], x0), where(here[k], keys[k + 1], x1)
        low, high = where(here[k], at[k], low), where(here[k], at[k + 1], high)
    y = (depth - x0) / (x1 - x0) * (high - low) + low
    return where(depth <= keys[0], at[0], where(depth >= keys[-1], at[-1], y))


def _between(code: Code, T: FloatArray, keys: int, values: int, n: int, x: Lanes) -> Lanes:
    """Return the value at ``x`` between ``n`` keys; beyond the ends that of the end."""
    first, last = float(T[values]), float(T[values + n - 1])
    if n == 1:
        return where((x <= float(T[keys])) | (x >= float(T[keys])), first, math.nan)

    def body(inside: Code) -> str:
        x = Lanes(inside, "%x")
        places = [("%keys", 0), ("%keys", 1), ("%values", 0), ("%values", 1)]
        x0, x1, y0, y1 = _taken(inside, _interval(inside, x), places)
        return f"{LANE} {((x - x0) / (x1 - x0) * (y1 - y0) + y0).text}"

    head = f"internal {LANE} @between(i64 %keys, i64 %values, i64 %n, {LANE} %x) noinline"
    code.module.define("between", head, body)
    y = Lanes(code, code.put(f"call {LANE} @between(i64 {keys}, i64 {values}, i64 {n}, {LANE} {x.text})"))
    return where(x <= float(T[keys]), first, where(x >= float(T[keys + n - 1]), last, y))


def _two(code: Code, T: FloatArray, begins: int, row: Lanes, column: Lanes) -> Lanes:
    """Return the value of a table of two dimensions; beyond the ends that of the end."""
    n, m = int(T[begins]), int(T[begins + 1])
    rows, columns = begins + 2, begins + 2 + n
    values = columns + m
    if m == 1:
        return _between(code, T, rows, values, n, row)
    c, across = _fraction(code, columns, m, column)
    if n == 1:
        y0, y1 = _taken(code, c, [(values, 0), (values, 1)])
        return across * (y1 - y0) + y0
    k, up = _fraction(code, rows, n, row)
    corner = code.put(f"mul {INT} {k}, {whole(m)}")
    corner = code.put(f"add {INT} {corner}, {c}")
    low, low_next, high, high_next = _taken(code, corner, [(values, further) for further in (0, 1, m, m + 1)])
    left = up * high + (1.0 - up) * low
    right = up * high_next + (1.0 - up) * low_next
    return across * (right - left) + left


def _fraction(code: Code, keys: int, n: int, x: Lanes) -> tuple[str, Lanes]:
    """Return the interval of ``x`` among ``n`` keys, and how far up it ``x`` lies."""

    def body(inside: Code) -> str:
        x = Lanes(inside, "%x")
        k = _interval(inside, x)
        x0, x1 = _taken(inside, k, [("%keys", 0), ("%keys", 1)])
        factor = (x - x0) / (x1 - x0)
        factor = where(factor < 0.0, 0.0, where(factor > 1.0, 1.0, factor))
        half = inside.put(f"insertvalue {both} undef, {INT} {k}, 0")
        return f"{both} {inside.put(f'insertvalue {both} {half}, {LANE} {factor.text}, 1')}"

    both = f"{{ {INT}, {LANE} }}"
    code.module.define("fraction", f"internal {both} @fraction(i64 %keys, i64 %n, {LANE} %x) noinline", body)
    found = code.put(f"call {both} @fraction(i64 {keys}, i64 {n}, {LANE} {x.text})")
    return code.put(f"extractvalue {both} {found}, 0"), Lanes(code, code.put(f"extractvalue {both} {found}, 1"))


def _interval(code: Code, x: Lanes) -> str:
    """Return how many of the ``%n`` keys from ``%keys`` on, but the first and the last, lie below ``x``."""
    last, name = code.put("sub i64 %n, 1"), code.name()
    code.lines += [
        f"  br label %{name}",
        f"{name}:",
        f"  %{name}j = phi i64 [ 1, %{code.block} ], [ %{name}j1, %{name}b ]",
        f"  %{name}k = phi {INT} [ zeroinitializer, %{code.block} ], [ %{name}k1, %{name}b ]",
        f"  %{name}go = icmp slt i64 %{name}j, {last}",
        f"  br i1 %{name}go, label %{name}b, label %{name}e",
        f"{name}b:",
    ]
    key = _number(code, "%keys", f"%{name}j")
    below = code.put(f"zext <{LANES} x i1> {(spread(code, key) < x).text} to {INT}")
    code.lines += [
        f"  %{name}k1 = add {INT} %{name}k, {below}",
        f"  %{name}j1 = add i64 %{name}j, 1",
        f"  br label %{name}",
        f"{name}e:",
    ]
    code.block = f"{name}e"
    return f"%{name}k"


def _taken(code: Code, k: str, places: Sequence[tuple[str | int, int]]) -> list[Lanes]:
    """Return the numbers that lie ``k`` behind places; of all flights at once where all have one ``k``."""
    first, name = code.put(f"extractelement {INT} {k}, i64 0"), code.name()
    one = code.put(f"insertelement {INT} undef, i64 {first}, i64 0")
    same = code.put(f"shufflevector {INT} {one}, {INT} undef, <{LANES} x i32> zeroinitializer")
    apart = Mask(code, code.put(f"icmp ne {INT} {k}, {same}")).any()
    begins = [code.put(f"add i64 {base}, {further}") for base, further in places]
    code.lines += [f"  br i1 {apart}, label %{name}a, label %{name}t", f"{name}a:"]
    alone = [_gathered(code, begin, k) for begin in begins]
    code.lines += [f"  br label %{name}", f"{name}t:"]
    together = [spread(code, _number(code, begin, first)) for begin in begins]
    code.label(name)
    found = zip(alone, together, strict=True)
    return [Lanes(code, code.put(f"phi {LANE} [ {x.text}, %{name}a ], [ {y.text}, %{name}t ]")) for x, y in found]


def _gathered(code: Code, begins: str, k: str) -> Lanes:
    out = "undef"
    for f in range(LANES):
        own = code.put(f"extractelement {INT} {k}, i64 {f}")
        out = code.put(f"insertelement {LANE} {out}, double {_number(code, begins, own)}, i64 {f}")
    return Lanes(code, out)


def _number(code: Code, begins: str, k: str) -> str:
    """Return a number of the tables."""
    place = code.put(f"getelementptr double, ptr @T, i64 {code.put(f'add i64 {begins}, {k}')}")
    return code.put(f"load double, ptr {place}")
