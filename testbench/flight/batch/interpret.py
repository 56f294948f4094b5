"""The interpreter: one loop over the operations of a program, inside it one over the flights of a batch."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from testbench.core.record import FloatArray
from testbench.flight.batch import air, forces, motion
from testbench.flight.batch.compiled import LANES, compiled, lanes
from testbench.flight.batch.program import MOST_DETENTS

HUGE = math.inf
_ROUNDOFF = 2.0 * float(np.finfo(float).eps)


@compiled
def _truth(x: float) -> float:  # pragma: no cover
    """Return 1 or 0 for a condition; NaN for a number above one, at which JSBSim stops (GetBinary of FGFunction)."""
    x = math.fabs(x)
    return 0.0 if x < 1e-9 else (1.0 if x - 1.0 < 1e-9 else math.nan)


@compiled
def _table_1(T: FloatArray, at: int, x: float) -> float:  # pragma: no cover
    """Return a table's value at ``x``: number of rows, keys, values (FGTable::GetValue)."""
    n = int(T[at])
    return _between(T, at + 1, at + 1 + n, n, x)


@compiled
def _between(T: FloatArray, keys: int, values: int, n: int, x: float) -> float:  # pragma: no cover
    """Return the value at ``x`` between ``n`` keys; beyond the ends that of the end."""
    if x <= T[keys]:
        return T[values]
    if x >= T[keys + n - 1]:
        return T[values + n - 1]
    k = 1
    while T[keys + k] < x:
        k += 1
    x0 = T[keys + k - 1]
    factor = (x - x0) / (T[keys + k] - x0)
    y0 = T[values + k - 1]
    return factor * (T[values + k] - y0) + y0


@compiled
def _fraction(T: FloatArray, keys: int, n: int, x: float) -> tuple[int, float]:  # pragma: no cover
    """Return the upper neighbour of ``x`` among ``n`` keys, and how far up to it ``x`` lies."""
    k = 1
    while T[keys + k] < x and k < n - 1:
        k += 1
    x0 = T[keys + k - 1]
    factor = (x - x0) / (T[keys + k] - x0)
    return k, 0.0 if factor < 0.0 else (1.0 if factor > 1.0 else factor)


@compiled
def _table_2(T: FloatArray, at: int, row: float, column: float) -> float:  # pragma: no cover
    """Return a table's value: rows, columns, keys of rows, keys of columns, values row by row."""
    n, m = int(T[at]), int(T[at + 1])
    rows = at + 2
    columns = rows + n
    values = columns + m
    if m == 1:
        return _between(T, rows, values, n, row)
    c, across = _fraction(T, columns, m, column)
    if n == 1:
        y0 = T[values + c - 1]
        return across * (T[values + c] - y0) + y0
    k, up = _fraction(T, rows, n, row)
    high, low = values + k * m, values + (k - 1) * m
    left = up * T[high + c - 1] + (1.0 - up) * T[low + c - 1]
    right = up * T[high + c] + (1.0 - up) * T[low + c]
    return across * (right - left) + left


@compiled
def _table_3(T: FloatArray, at: int, row: float, column: float, depth: float) -> float:  # pragma: no cover
    """Return a table's value: number of planes, their keys, where each begins (from ``at`` on)."""
    n = int(T[at])
    keys, starts = at + 1, at + 1 + n
    if depth <= T[keys]:
        return _table_2(T, at + int(T[starts]), row, column)
    if depth >= T[keys + n - 1]:
        return _table_2(T, at + int(T[starts + n - 1]), row, column)
    k = 1
    while T[keys + k] < depth:
        k += 1
    x0 = T[keys + k - 1]
    factor = (depth - x0) / (T[keys + k] - x0)
    below = _table_2(T, at + int(T[starts + k - 1]), row, column)
    return factor * (_table_2(T, at + int(T[starts + k]), row, column) - below) + below


# Loops with a choice in them stand in functions of their own, in which the compiler finds that they can be vectorised.


@compiled
def _quotient(R: FloatArray, t: int, a: int, b: int) -> None:  # pragma: no cover
    R = lanes(R)
    for f in range(LANES):
        x, y = R[a, f], R[b, f]
        z = x / y
        R[t, f] = z if y != 0.0 else HUGE


@compiled
def _least(R: FloatArray, t: int, a: int, b: int) -> None:  # pragma: no cover
    R = lanes(R)
    for f in range(LANES):
        x, y = R[a, f], R[b, f]
        x = x if x < HUGE else HUGE  # JSBSim's minimum takes no notice of NaN
        R[t, f] = y if y < x else x


@compiled
def _greatest(R: FloatArray, t: int, a: int, b: int) -> None:  # pragma: no cover
    R = lanes(R)
    for f in range(LANES):
        x, y = R[a, f], R[b, f]
        x = x if x > -HUGE else -HUGE
        R[t, f] = y if y > x else x


@compiled
def _select(R: FloatArray, t: int, a: int, b: int, c: int) -> None:  # pragma: no cover
    R = lanes(R)
    for f in range(LANES):
        x, y, z = math.fabs(R[a, f]), R[b, f], R[c, f]
        chosen = z if x < 1e-9 else y
        R[t, f] = math.nan if x - 1.0 >= 1e-9 else chosen  # what is neither true nor false: see _truth


@compiled
def _both(R: FloatArray, t: int, a: int, b: int) -> None:  # pragma: no cover
    R = lanes(R)
    for f in range(LANES):
        x, y = _truth(R[a, f]), _truth(R[b, f])
        R[t, f] = y if x == 1.0 else x


@compiled
def _either(R: FloatArray, t: int, a: int, b: int) -> None:  # pragma: no cover
    R = lanes(R)
    for f in range(LANES):
        x, y = _truth(R[a, f]), _truth(R[b, f])
        R[t, f] = y if x == 0.0 else x


@compiled
def _clip(R: FloatArray, t: int, a: int, b: int, c: int) -> None:  # pragma: no cover
    R = lanes(R)
    for f in range(LANES):
        x, low, high = R[a, f], R[b, f], R[c, f]
        y = low if x < low else x
        z = high if y > high else y
        R[t, f] = z if high - low >= 0.0 else x


@compiled
def _scalar_product(
    R: FloatArray, t: int, n: int, start: int, flat: npt.NDArray[np.int64], at: int
) -> None:  # pragma: no cover
    """Sum ``n`` products from the first to the last, eight flights at a time, which stay in the processor."""
    R = lanes(R)
    for f in range(0, LANES, 8):
        if start >= 0:
            first = 0
            s0, s1, s2, s3 = R[start, f], R[start, f + 1], R[start, f + 2], R[start, f + 3]
            s4, s5, s6, s7 = R[start, f + 4], R[start, f + 5], R[start, f + 6], R[start, f + 7]
        else:
            first, x, y = 1, flat[at], flat[at + 1]
            s0, s1, s2, s3 = (
                R[x, f] * R[y, f],
                R[x, f + 1] * R[y, f + 1],
                R[x, f + 2] * R[y, f + 2],
                R[x, f + 3] * R[y, f + 3],
            )
            s4, s5, s6, s7 = (
                R[x, f + 4] * R[y, f + 4],
                R[x, f + 5] * R[y, f + 5],
                R[x, f + 6] * R[y, f + 6],
                R[x, f + 7] * R[y, f + 7],
            )
        for j in range(first, n):
            x, y = flat[at + 2 * j], flat[at + 2 * j + 1]
            s0 = R[x, f] * R[y, f] + s0
            s1 = R[x, f + 1] * R[y, f + 1] + s1
            s2 = R[x, f + 2] * R[y, f + 2] + s2
            s3 = R[x, f + 3] * R[y, f + 3] + s3
            s4 = R[x, f + 4] * R[y, f + 4] + s4
            s5 = R[x, f + 5] * R[y, f + 5] + s5
            s6 = R[x, f + 6] * R[y, f + 6] + s6
            s7 = R[x, f + 7] * R[y, f + 7] + s7
        R[t, f], R[t, f + 1], R[t, f + 2], R[t, f + 3] = s0, s1, s2, s3
        R[t, f + 4], R[t, f + 5], R[t, f + 6], R[t, f + 7] = s4, s5, s6, s7


@compiled
def execute(code: npt.NDArray[np.int64], T: FloatArray, R: FloatArray) -> None:  # pragma: no cover
    """Run a program once, for every flight.

    Args:
        code: (n, 6) operations.
        T: tables.
        R: (registers, LANES).
    """
    R = lanes(R)
    flat, k = code.reshape(code.size), -1
    while k + 1 < code.shape[0]:
        k += 1
        op, t, a, b, c, e = code[k, 0], code[k, 1], code[k, 2], code[k, 3], code[k, 4], code[k, 5]
        if op == 3:
            for f in range(LANES):
                R[t, f] = R[a, f] * R[b, f]
        elif op == 1:
            for f in range(LANES):
                R[t, f] = R[a, f] + R[b, f]
        elif op == 47:
            _scalar_product(R, t, a, b, flat, 6 * (k + 1))
            k += (2 * a + 5) // 6
        elif op == 44:
            for f in range(LANES):
                R[t, f] = R[a, f] * R[b, f] + R[c, f]
        elif op == 0:
            for f in range(LANES):
                R[t, f] = R[a, f]
        elif op == 2:
            for f in range(LANES):
                R[t, f] = R[a, f] - R[b, f]
        elif op == 4:
            _quotient(R, t, a, b)
        elif op == 5:
            for f in range(LANES):
                R[t, f] = R[a, f] / R[b, f]
        elif op == 6:
            _least(R, t, a, b)
        elif op == 7:
            _greatest(R, t, a, b)
        elif op == 39:
            _select(R, t, a, b, c)
        elif op == 40:
            _clip(R, t, a, b, c)
        elif op == 41:
            for f in range(LANES):
                R[t, f] = _table_1(T, e, R[a, f])
        elif op == 42:
            for f in range(LANES):
                R[t, f] = _table_2(T, e, R[a, f], R[b, f])
        elif op == 43:
            for f in range(LANES):
                R[t, f] = _table_3(T, e, R[a, f], R[b, f], R[c, f])
        elif op == 30:
            for f in range(LANES):
                R[t, f] = 1.0 if R[a, f] < R[b, f] else 0.0
        elif op == 31:
            for f in range(LANES):
                R[t, f] = 1.0 if R[a, f] <= R[b, f] else 0.0
        elif op == 32:
            for f in range(LANES):
                R[t, f] = 1.0 if R[a, f] > R[b, f] else 0.0
        elif op == 33:
            for f in range(LANES):
                R[t, f] = 1.0 if R[a, f] >= R[b, f] else 0.0
        elif op == 34:
            for f in range(LANES):
                R[t, f] = 1.0 if R[a, f] == R[b, f] else 0.0
        elif op == 35:
            for f in range(LANES):
                R[t, f] = 1.0 if R[a, f] != R[b, f] else 0.0
        elif op == 36:
            _both(R, t, a, b)
        elif op == 37:
            _either(R, t, a, b)
        elif op == 38:
            for f in range(LANES):
                R[t, f] = 1.0 - _truth(R[a, f])
        elif op == 45:
            for f in range(LANES):
                R[t, f] = -R[a, f]
        elif op == 21:
            for f in range(LANES):
                R[t, f] = math.fabs(R[a, f])
        elif op == 10:
            for f in range(LANES):
                R[t, f] = math.exp(R[a, f])
        elif op == 8:
            for f in range(LANES):
                R[t, f] = math.pow(R[a, f], R[b, f])
        elif op == 9:
            for f in range(LANES):
                x = R[a, f]
                R[t, f] = math.sqrt(x) if x >= 0.0 else -HUGE
        elif op == 14:
            for f in range(LANES):
                R[t, f] = math.sin(R[a, f])
        elif op == 15:
            for f in range(LANES):
                R[t, f] = math.cos(R[a, f])
        elif op == 46:
            _kinematic(R, t, a, b, c, e)
        elif op < 60:
            _rare(op, t, a, b, R)
        elif op == 60:
            motion.propagate(R)
        elif op == 61:
            air.auxiliary(R)
        elif op == 62:
            air.air_data(R)
        elif op == 63:
            forces.motion_numbers(R)
        elif op == 64:
            forces.aerodynamics(R, e % 16, e // 16)
        elif op == 65:
            forces.clear(R, t)
        elif op == 66:
            forces.reaction(R, t, e % 16, e // 16)
        elif op == 67:
            forces.thruster(R, t)
        elif op == 68:
            forces.accelerate(R)
        elif op == 70:
            motion.euler(R)
        elif op == 71:
            motion.geography(R)
        elif op == 72:
            motion.euler_rates(R)
        elif op == 73:
            air.altitudes(R)
        elif op == 74:
            motion.held(R, t)


@compiled
def _kinematic(R: FloatArray, t: int, a: int, b: int, c: int, e: int) -> None:  # pragma: no cover
    """Move from detent to detent until the time is over or the end is reached (FGKinemat)."""
    R = lanes(R)
    n, detents = e % MOST_DETENTS, e // MOST_DETENTS
    times = detents + n
    for f in range(LANES):
        x, y, left = R[a, f], R[b, f], R[c, f]
        for _ in range(2 * n):  # as many as there are detents on the way
            if left <= 0.0 or math.fabs(x - y) <= _ROUNDOFF * max(math.fabs(x), math.fabs(y)):
                break
            if y > R[detents + n - 1, f]:  # above the last detent: JSBSim reads past its list, and is there at once
                y = x
                break
            i = 1
            while i < n - 1 and (R[detents + i, f] < y if x < y else R[detents + i, f] <= y):
                i += 1
            if R[times + i, f] <= 0.0:
                y = x
                break
            low, high = R[detents + i - 1, f], R[detents + i, f]
            rate = (high - low) / R[times + i, f]
            end = low if x < low else (high if x > high else x)
            needed = math.fabs((end - y) / rate)
            if left < needed:
                needed = left
                y = y + needed * rate if y < x else y - needed * rate
            else:
                y = end
            left -= needed
        R[t, f] = y


@compiled
def _rare(op: int, t: int, a: int, b: int, R: FloatArray) -> None:  # pragma: no cover
    """Operations that few models have."""
    R = lanes(R)
    for f in range(LANES):
        x, y = R[a, f], R[b, f]
        z = math.nan
        if op == 11:
            z = math.log(x) if x > 0.0 else -HUGE
        elif op == 12:
            z = math.log10(x) * (1.0 / math.log10(2.0)) if x > 0.0 else -HUGE
        elif op == 13:
            z = math.log10(x) if x > 0.0 else -HUGE
        elif op == 16:
            z = math.tan(x)
        elif op == 17:
            z = math.asin(x) if math.fabs(x) <= 1.0 else math.nan
        elif op == 18:
            z = math.acos(x) if math.fabs(x) <= 1.0 else math.nan
        elif op == 19:
            z = math.atan(x)
        elif op == 20:
            z = math.atan2(x, y)
        elif op == 22:
            z = -1.0 if x < 0.0 else 1.0
        elif op == 23:
            z = np.floor(x)
        elif op == 24:
            z = np.ceil(x)
        elif op == 25:
            z = np.fmod(x, y) if y != 0.0 else HUGE
        elif op == 26:
            z = np.fmod(np.trunc(x), np.trunc(y)) + 0.0  # integers have no zero with a sign
        elif op == 27:
            z = math.copysign(x - np.trunc(x) if math.fabs(x) != HUGE else 0.0, x)
        elif op == 28:
            z = np.trunc(x)
        elif op == 29:
            z = np.trunc(x)  # C's round: halves away from zero
            if math.fabs(x - z) >= 0.5:
                z += math.copysign(1.0, x)
        R[t, f] = z


@compiled
def run(
    before: npt.NDArray[np.int64],
    frame: npt.NDArray[np.int64],
    log: npt.NDArray[np.int64],
    T: FloatArray,
    R: FloatArray,
    inputs: FloatArray,
    targets: npt.NDArray[np.int64],
    stride: int,
    logged: npt.NDArray[np.int64],
    scale: FloatArray,
    rows: FloatArray,
    watched: npt.NDArray[np.int64],
    low: FloatArray,
    high: FloatArray,
    left: npt.NDArray[np.int64],
    broken: npt.NDArray[np.int64],
    value: FloatArray,
    first: int,
) -> None:  # pragma: no cover
    """Fly: inputs, frame, and every ``stride`` frames a row.

    Args:
        before: operations before the first frame.
        frame: operations of every frame.
        log: operations before each row.
        T: tables.
        R: (registers, LANES); flights beyond those of ``rows`` are flown without inputs, and not looked at.
        inputs: (frames, inputs, flights) what is written before each frame, of this call.
        targets: register of each input.
        stride: frames per row.
        logged: registers that make a row.
        scale: (logged, flights) factor of each.
        rows: (flights, rows, logged) filled.
        watched: registers that have limits.
        low: (watched, flights) the lower ones.
        high: (watched, flights) the upper ones.
        left: (flights,) row at which a flight left its limits, or -1; kept if it has left already.
        broken: (flights,) which limit it broke.
        value: (flights,) with what.
        first: number of the first row.
    """
    m = rows.shape[0]
    execute(before, T, R)
    k = 0
    for row in range(first, rows.shape[1]):
        for _ in range(stride):
            for i in range(targets.size):
                t = targets[i]
                for f in range(m):
                    R[t, f] = inputs[k, i, f]
            execute(frame, T, R)
            k += 1
        execute(log, T, R)
        for f in range(m):
            for i in range(logged.size):
                rows[f, row, i] = R[logged[i], f] * scale[i, f]
        flying = False
        for f in range(m):
            if left[f] < 0:
                for i in range(watched.size):
                    x = R[watched[i], f]
                    if not (low[i, f] <= x and x <= high[i, f]):
                        left[f] = row
                        broken[f] = i
                        value[f] = x
                        break
            if left[f] < 0:
                flying = True
        if not flying:
            break
