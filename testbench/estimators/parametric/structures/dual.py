"""Functions that carry exact derivatives through complex steps: f(a + ih) = f(a) + ih f'(a).

Where a function is analytic this is its complex value to first order, which is all that a step of 1e-30 shows. Unlike
the complex function it stays true to the real one where that ends (``sqrt`` and ``log`` of negative numbers are not
numbers), and it holds for functions that bend, ``abs``, ``min`` and ``max``, whose derivative is that of the branch
taken.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from testbench.estimators.parametric.structure import AnyArray

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
"""The functions of :data:`testbench.estimators.expressions.FUNCTIONS`, in numpy."""
