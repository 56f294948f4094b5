"""Tables as machine code (FGTable::GetValue)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial, reduce

from testbench.core.record import FloatArray
from testbench.flight.batch.vector import INT, LANE, LANES, Code, Lanes, Mask, sometimes, splat, spread, where, whole


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
