"""Arithmetic over the flights of a block, written down as a program for LLVM: each value is one number per flight.

Strict IEEE arithmetic, one operation at a time: batch size and order change no bit, nor does the processor. What the
stages of a frame are written with is a :class:`Language`; another target is another one.
"""

from __future__ import annotations

import math
import struct
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from functools import partial, wraps
from typing import Any, ClassVar

LANES = 8
"""Flights of a block, always: one row of registers fills one cache line, and one vector where the processor has the
widest."""
LANE = f"<{LANES} x double>"
INT = f"<{LANES} x i64>"
_BOOL = f"<{LANES} x i1>"
_INTRINSICS = {"fabs": 1, "sqrt": 1, "floor": 1, "ceil": 1, "trunc": 1, "copysign": 2, "fma": 3}
_LIBRARY = {"exp": 1, "log": 1, "log10": 1, "sin": 1, "cos": 1, "tan": 1, "asin": 1, "acos": 1, "atan": 1, "pow": 2,
            "fmod": 2, "atan2": 2}  # fmt: skip
_FORMS = {
    **{op: f"{op} {LANE} {{}}, {{}}" for op in ("fadd", "fsub", "fmul", "fdiv")},
    **{how: f"fcmp {how} {LANE} {{}}, {{}}" for how in ("olt", "ole", "ogt", "oge", "oeq", "une")},
    **{op: f"{op} {_BOOL} {{}}, {{}}" for op in ("and", "or")},
    **{n: f"call {LANE} @llvm.{n}.v{LANES}f64({', '.join([f'{LANE} {{}}'] * k)})" for n, k in _INTRINSICS.items()},
    "fneg": f"fneg {LANE} {{}}",
    "not": f"xor {_BOOL} {{}}, <{', '.join(['i1 true'] * LANES)}>",
    "select": f"select {_BOOL} {{}}, {LANE} {{}}, {LANE} {{}}",
}
"""Operation -> how LLVM writes it."""


def double(number: float) -> str:
    """Return a constant."""
    return f"double 0x{struct.pack('>d', number).hex().upper()}"


def splat(number: float) -> str:
    """Return a constant that is the same for every flight."""
    return f"<{', '.join([double(number)] * LANES)}>"


def whole(number: int) -> str:
    """Return a whole number that is the same for every flight."""
    return f"<{', '.join([f'i64 {number}'] * LANES)}>"


class Module:
    """Functions that are compiled together.

    Attributes:
        functions: name -> text.
    """

    def __init__(self) -> None:
        self.functions: dict[str, str] = {}

    def define(self, name: str, head: str, body: Callable[[Code], str]) -> None:
        """Write a function unless it is there.

        Args:
            name: of it.
            head: what stands before its body.
            body: writes it, and returns what is returned.
        """
        if name not in self.functions:
            self.functions[name] = ""
            code = Code(self)
            returned = body(code)
            self.functions[name] = "\n".join([f"define {head} {{", "entry:", *code.lines, f"  ret {returned}", "}", ""])

    @property
    def text(self) -> str:
        """All of it, in LLVM's language."""
        known = [f"declare {LANE} @llvm.{n}.v{LANES}f64({', '.join([LANE] * k)})" for n, k in _INTRINSICS.items()]
        known += [f"declare double @{n}({', '.join(['double'] * k)})" for n, k in _LIBRARY.items()]
        return "\n".join([*known, *self.functions.values()])


class Language(ABC):
    """What a frame is written down in.

    Values are known by what the language calls them: a name in LLVM's language and in C, an array in JAX.

    Attributes:
        polynomials: whether sine, cosine, arctangent and power are computed by polynomials of this module; else they
            are the library's.
    """

    polynomials: ClassVar[bool] = False

    @abstractmethod
    def do(self, op: str, *xs: Any) -> Any:
        """Return the result of an operation, by LLVM's name for it, or of a function of C's library."""

    @abstractmethod
    def constant(self, number: float) -> Any:
        """Return a number that is the same for every flight."""

    @abstractmethod
    def load(self, base: str, row: int) -> Any:
        """Return a row of registers."""

    @abstractmethod
    def store(self, base: str, row: int, x: Any) -> None:
        """Write a row of registers."""

    @abstractmethod
    def branch(self, mask: Any) -> AbstractContextManager[None]:
        """Do what is written only if it is true for any flight, and then for all."""

    @abstractmethod
    def sometimes(self, mask: Mask, work: Callable[[], Lanes], otherwise: Lanes | float) -> Lanes:
        """Return what ``work`` gives where it is true, else ``otherwise``."""

    @abstractmethod
    def stage(self, name: str, work: Callable[[Rows], None], R: Rows) -> None:
        """Do what ``work`` does to rows, as a function of its own where there are any."""


class Code(Language):
    """The body of a function while it is written in LLVM's language.

    Attributes:
        module: of the function.
        lines: of it.
        block: label of the basic block that is being written.
    """

    polynomials = True

    def __init__(self, module: Module) -> None:
        self.module = module
        self.lines: list[str] = []
        self.block = "entry"
        self._count = 0

    def name(self) -> str:
        """Return a name that is new."""
        self._count += 1
        return f"v{self._count}"

    def put(self, instruction: str) -> str:
        """Write an instruction; return what names its result."""
        name = f"%{self.name()}"
        self.lines.append(f"  {name} = {instruction}")
        return name

    def label(self, name: str) -> None:
        """Begin a basic block."""
        self.lines += [f"  br label %{name}", f"{name}:"]
        self.block = name

    def do(self, op: str, *xs: Any) -> str:
        """Write an operation; functions of C's library are called flight by flight."""
        if op in _FORMS:
            return self.put(_FORMS[op].format(*xs))
        out = "undef"
        for f in range(LANES):
            each = ", ".join(f"double {self.put(f'extractelement {LANE} {x}, i64 {f}')}" for x in xs)
            y = self.put(f"call double @{op}({each})")
            out = self.put(f"insertelement {LANE} {out}, double {y}, i64 {f}")
        return out

    def constant(self, number: float) -> str:
        """Return a vector."""
        return splat(number)

    def _at(self, base: str, row: int) -> str:
        return self.put(f"getelementptr {LANE}, ptr {base}, i64 {row}")

    def load(self, base: str, row: int) -> str:
        """Read from memory."""
        return self.put(f"load {LANE}, ptr {self._at(base, row)}, align 8")

    def store(self, base: str, row: int, x: Any) -> None:
        """Write into memory."""
        self.lines.append(f"  store {LANE} {x}, ptr {self._at(base, row)}, align 8")

    @contextmanager
    def branch(self, mask: Mask) -> Iterator[None]:
        """Write basic blocks."""
        name = self.name()
        self.lines += [f"  br i1 {mask.any()}, label %{name}, label %{name}e", f"{name}:"]
        self.block = name
        yield
        self.label(f"{name}e")

    def sometimes(self, mask: Mask, work: Callable[[], Lanes], otherwise: Lanes | float) -> Lanes:
        """Write a branch: nothing is computed where it is true nowhere."""
        before = self.block
        with self.branch(mask):
            found = where(mask, work(), otherwise)
            last = self.block
        other = _text(self, otherwise)
        return Lanes(self, self.put(f"phi {LANE} [ {found.text}, %{last} ], [ {other}, %{before} ]"))

    def stage(self, name: str, work: Callable[[Rows], None], R: Rows) -> None:
        """Write a function and call it."""

        def body(inside: Code) -> str:
            work(Rows(inside))
            return "void"

        self.module.define(name, f"internal void @{name}(ptr noalias %R) noinline", body)
        self.lines.append(f"  call void @{name}(ptr {R.base})")


class Lanes:
    """A number per flight; Python's numbers beside it count for every flight."""

    __slots__ = ("code", "text")

    def __init__(self, code: Any, text: Any) -> None:
        self.code, self.text = code, text

    def _do(self, op: str, a: Lanes | float, b: Lanes | float) -> Lanes:
        return Lanes(self.code, self.code.do(op, _text(self.code, a), _text(self.code, b)))

    def _is(self, how: str, other: Lanes | float) -> Mask:
        return Mask(self.code, self.code.do(how, self.text, _text(self.code, other)))

    # fmt: off
    def __add__(self, x: Lanes | float) -> Lanes: return self._do("fadd", self, x)
    def __radd__(self, x: float) -> Lanes: return self._do("fadd", x, self)
    def __sub__(self, x: Lanes | float) -> Lanes: return self._do("fsub", self, x)
    def __rsub__(self, x: float) -> Lanes: return self._do("fsub", x, self)
    def __mul__(self, x: Lanes | float) -> Lanes: return self._do("fmul", self, x)
    def __rmul__(self, x: float) -> Lanes: return self._do("fmul", x, self)
    def __truediv__(self, x: Lanes | float) -> Lanes: return self._do("fdiv", self, x)
    def __rtruediv__(self, x: float) -> Lanes: return self._do("fdiv", x, self)
    def __lt__(self, x: Lanes | float) -> Mask: return self._is("olt", x)
    def __le__(self, x: Lanes | float) -> Mask: return self._is("ole", x)
    def __gt__(self, x: Lanes | float) -> Mask: return self._is("ogt", x)
    def __ge__(self, x: Lanes | float) -> Mask: return self._is("oge", x)
    # fmt: on

    def __neg__(self) -> Lanes:
        return Lanes(self.code, self.code.do("fneg", self.text))

    def equals(self, x: Lanes | float) -> Mask:
        """Return where it equals another number."""
        return self._is("oeq", x)

    def differs(self, x: Lanes | float) -> Mask:
        """Return where it differs from another number, as NaN does from all."""
        return self._is("une", x)

    def bits(self, op: str = "", other: str = "") -> str:
        """Return its bits as whole numbers, or what an operation makes of them."""
        found = self.code.put(f"bitcast {LANE} {self.text} to {INT}")
        return self.code.put(f"{op} {INT} {found}, {other}") if op else found


class Mask:
    """True or false per flight."""

    __slots__ = ("code", "text")

    def __init__(self, code: Any, text: Any) -> None:
        self.code, self.text = code, text

    def __and__(self, other: Mask) -> Mask:
        return Mask(self.code, self.code.do("and", self.text, other.text))

    def __or__(self, other: Mask) -> Mask:
        return Mask(self.code, self.code.do("or", self.text, other.text))

    def __invert__(self) -> Mask:
        return Mask(self.code, self.code.do("not", self.text))

    def any(self) -> str:
        """Return whether it is true for any flight, as one bit of LLVM's."""
        together = self.code.put(f"bitcast {_BOOL} {self.text} to i{LANES}")
        found: str = self.code.put(f"icmp ne i{LANES} {together}, 0")
        return found


def _text(code: Language, x: Lanes | float) -> Any:
    return x.text if isinstance(x, Lanes) else code.constant(x)


def spread(code: Code, number: str) -> Lanes:
    """Return a double of LLVM's as the same number for every flight."""
    one = code.put(f"insertelement {LANE} undef, double {number}, i64 0")
    return Lanes(code, code.put(f"shufflevector {LANE} {one}, {LANE} undef, <{LANES} x i32> zeroinitializer"))


def where(mask: Mask, a: Lanes | float, b: Lanes | float) -> Lanes:
    """Return ``a`` where it is true, else ``b``."""
    code = mask.code
    return Lanes(code, code.do("select", mask.text, _text(code, a), _text(code, b)))


def branch(mask: Mask) -> AbstractContextManager[None]:
    """Do what is written only if it is true for any flight, and then for all."""
    code: Language = mask.code
    return code.branch(mask)


def sometimes(mask: Mask, work: Callable[[], Lanes], otherwise: Lanes | float) -> Lanes:
    """Return what ``work`` gives where it is true, else ``otherwise``; nothing is computed where it is true nowhere."""
    code: Language = mask.code
    return code.sometimes(mask, work, otherwise)


@contextmanager
def loop(code: Code, count: str) -> Iterator[str]:
    """Repeat what is written so many times; gives the number of the turn."""
    k = code.name()
    code.label(f"{k}pre")
    code.label(k)
    code.lines += [
        f"  %{k}i = phi i64 [ 0, %{k}pre ], [ %{k}i1, %{k}next ]",
        f"  %{k}go = icmp slt i64 %{k}i, {count}",
        f"  br i1 %{k}go, label %{k}body, label %{k}end",
        f"{k}body:",
    ]
    code.block = f"{k}body"
    yield f"%{k}i"
    code.label(f"{k}next")
    code.lines += [f"  %{k}i1 = add i64 %{k}i, 1", f"  br label %{k}", f"{k}end:"]
    code.block = f"{k}end"


def library(name: str, *xs: Lanes | float) -> Lanes:
    """Return a function of C's library."""
    code = next(x.code for x in xs if isinstance(x, Lanes))
    return Lanes(code, code.do(name, *(_text(code, x) for x in xs)))


fabs, sqrt, floor, ceil, trunc, copysign, _fma = (partial(library, n) for n in _INTRINSICS)


class Rows:
    """Rows of registers (rows, LANES): what was written or read a moment ago is not read again.

    Args:
        code: in which they are used.
        base: where they lie.
        scratch: first of those that are not kept in memory, because nothing but this code reads them.
    """

    def __init__(self, code: Language, base: str = "%R", scratch: int | None = None) -> None:
        self.code, self.base = code, base
        self._scratch = math.inf if scratch is None else scratch
        self._known: dict[int, Lanes] = {}

    def __getitem__(self, row: int) -> Lanes:
        if row not in self._known:
            self._known[row] = Lanes(self.code, self.code.load(self.base, row))
        return self._known[row]

    def __setitem__(self, row: int, x: Lanes | float) -> None:
        self._known[row] = Lanes(self.code, _text(self.code, x))
        if row < self._scratch:
            self.code.store(self.base, row, self._known[row].text)

    def forget(self) -> None:
        """Read from memory anew what is kept there."""
        self._known = {row: x for row, x in self._known.items() if row >= self._scratch}


def function(name: str) -> Callable[[Callable[..., Lanes]], Callable[..., Lanes]]:
    """Let what computes a function of C's library be one of the module's own, written once however often it is called.

    Args:
        name: of C's function, which takes its place in languages without polynomials.
    """

    def of(work: Callable[..., Lanes]) -> Callable[..., Lanes]:
        own = f"of_{work.__name__}"

        @wraps(work)
        def call(*xs: Lanes | float) -> Lanes:
            code = next(x.code for x in xs if isinstance(x, Lanes))
            if not code.polynomials:
                return library(name, *xs)
            takes = ", ".join(f"{LANE} %a{k}" for k in range(len(xs)))

            def body(inside: Code) -> str:
                return f"{LANE} {work(*(Lanes(inside, f'%a{k}') for k in range(len(xs)))).text}"

            code.module.define(own, f"internal {LANE} @{own}({takes}) noinline", body)
            return Lanes(code, code.put(f"call {LANE} @{own}({', '.join(f'{LANE} {_text(code, x)}' for x in xs)})"))

        return call

    return of


def stage(work: Callable[..., None]) -> Callable[..., None]:
    """Let what a function does to rows be a function of the module; further arguments are known as it is written."""

    @wraps(work)
    def call(R: Rows, *known: int) -> None:
        R.code.stage("_".join(["stage", work.__name__, *map(str, known)]), lambda rows: work(rows, *known), R)
        R.forget()

    return call


def _polynomial(z: Lanes, coefficients: Sequence[float]) -> Lanes:
    """Return a polynomial, its constant first, by halves that do not wait for each other (G. Estrin, 1960)."""
    terms: list[Lanes | float] = list(coefficients)
    while len(terms) > 1:
        pairs = zip(terms[::2], [*terms[1::2], 0.0], strict=False)
        terms = [low if high == 0.0 else z * high + low for low, high in pairs]
        z = z * z
    found = terms[0]
    assert isinstance(found, Lanes)
    return found


_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10  # the first has 33 bits
_SERIES = tuple(1.0 / math.factorial(n) for n in range(2, 14))


def _scaled(x: Lanes, more: Lanes | float) -> Lanes:
    """Return e to the power of the sum of x, |x| < 709, and little more."""
    n = floor(x * (1.0 / math.log(2.0)) + 0.5)
    high, low = x - n * _LN2_HIGH, more - n * _LN2_LOW
    z = high + low
    rest = (high - z) + low
    y = 1.0 + (z + (z * z * _polynomial(z, _SERIES) + rest))
    power_of_two = x.code.put(f"fptosi {LANE} {n.text} to {INT}")
    return _of_bits(x.code, y.bits("add", x.code.put(f"shl {INT} {power_of_two}, {whole(52)}")))


def _of_bits(code: Code, bits: str) -> Lanes:
    return Lanes(code, code.put(f"bitcast {INT} {bits} to {LANE}"))


_ROOT_HALF = 0x3FE6A09E667F3BCD
_ARTANH = tuple(2.0 / (2.0 * n + 1.0) for n in range(1, 11))


def _log(x: Lanes) -> tuple[Lanes, Lanes]:
    """Return the logarithm of a positive, normal number as a sum of two, the second small.

    With x = 2^k (1 + f) and s = f / (2 + f): log(1 + f) = f - f^2/2 + s (f^2/2 + R), R = 2/3 s^2 + 2/5 s^4 + ...
    """
    code = x.code
    away = x.bits("sub", whole(_ROOT_HALF))
    k = code.put(f"ashr {INT} {away}, {whole(52)}")
    shifted = code.put(f"shl {INT} {k}, {whole(52)}")
    f = _of_bits(code, x.bits("sub", shifted)) - 1.0
    n = Lanes(code, code.put(f"sitofp {INT} {k} to {LANE}"))
    s, half = f / (2.0 + f), 0.5 * f * f
    z = s * s
    high = f - half
    low = ((f - high) - half) + s * (half + z * _polynomial(z, _ARTANH)) + n * _LN2_LOW
    twos = n * _LN2_HIGH
    total = twos + high
    return total, where(fabs(twos) > fabs(high), (twos - total) + high, (high - total) + twos) + low


@function("pow")
def power(x: Lanes, y: Lanes) -> Lanes:
    """Return x to the power of y."""
    usual = (x >= 2.3e-308) & (x < math.inf)
    high, low = _log(where(usual, x, 1.0))
    product = y * high
    usual = usual & (fabs(product) < 700.0)
    product = where(usual, product, 0.0)
    rest = _fma(y, high, -product) + y * low
    return sometimes(~usual, lambda: library("pow", x, y), _scaled(product, where(usual, rest, 0.0)))


_QUARTER = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)  # the first two: 33 bits
_SINE = tuple((-1.0) ** n / math.factorial(2 * n + 1) for n in range(1, 9))
_COSINE = tuple((-1.0) ** n / math.factorial(2 * n) for n in range(2, 9))


def sincos(x: Lanes) -> tuple[Lanes, Lanes]:
    """Return sine and cosine."""
    if not x.code.polynomials:
        return library("sin", x), library("cos", x)
    usual = fabs(x) < 1e5
    a = where(usual, x, 0.0)
    q = floor(a * (2.0 / math.pi) + 0.5)  # quarters of a turn
    first = a - q * _QUARTER[0]
    r = first - q * _QUARTER[1]
    rest = (first - r) - q * _QUARTER[1] - q * _QUARTER[2]
    z = r * r
    half = 0.5 * z
    top = 1.0 - half
    s = r + (z * r * _polynomial(z, _SINE) + rest * top)
    c = top + (((1.0 - top) - half) + (z * z * _polynomial(z, _COSINE) - r * rest))
    q = q - 4.0 * floor(0.25 * q)
    odd, turned = q.equals(1.0) | q.equals(3.0), (q.equals(1.0) | q.equals(2.0))
    sine, cosine = where(odd, c, s), where(odd, s, c)
    return (
        sometimes(~usual, partial(library, "sin", x), where(q >= 2.0, -sine, sine)),
        sometimes(~usual, partial(library, "cos", x), where(turned, -cosine, cosine)),
    )


_ARCTAN = tuple((-1.0) ** n / (2.0 * n + 1.0) for n in range(21))
"""Coefficients of the series of atan(x) / x in x^2; for |x| <= tan 22.5 deg the rest is below 1e-17."""


@function("atan2")
def atan2(y: Lanes, x: Lanes) -> Lanes:
    """Return the angle of (x, y), 0 if both are 0."""
    a, b = fabs(x), fabs(y)
    flat = b <= a
    small, large = where(flat, b, a), where(flat, a, b)
    above = small > 0.41421356237309503 * large
    t = where(above, small - large, small) / (where(above, small + large, large) + 1e-300)
    p = _polynomial(t * t, _ARCTAN) * t
    p = where(above, p + 0.25 * math.pi, p)
    p = where(flat, p, 0.5 * math.pi - p)
    return copysign(where(x < 0.0, math.pi - p, p), y)
