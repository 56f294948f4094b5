"""A flat program as C: one header and one source in C99, which need nothing but the compiler's own library."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from textwrap import wrap

import numpy as np
import numpy.typing as npt

import testbench
from testbench.aircraft import Aircraft
from testbench.core.constants import FT_M
from testbench.core.escape import c_comment, c_identifier, c_string
from testbench.flight.batch import emit, motion
from testbench.flight.batch import registers as r
from testbench.flight.batch.alone import Alone, Signal
from testbench.flight.batch.program import Op, Program
from testbench.flight.batch.vector import Lanes, Language, Mask, Rows

_WIDE = 110
_FORMS = {
    "fadd": "{} + {}", "fsub": "{} - {}", "fmul": "{} * {}", "fdiv": "{} / {}", "fneg": "-{}",
    "select": "{} ? {} : {}", "olt": "{} < {}", "ole": "{} <= {}", "ogt": "{} > {}", "oge": "{} >= {}",
    "oeq": "{} == {}", "une": "{} != {}", "and": "{} && {}", "or": "{} || {}", "not": "!{}",
}  # fmt: skip
"""Operation -> how C writes it; all others are functions of <math.h> of the same name."""
_VALUE, _NAMES = re.compile(r" *const \w+ (v\d+) = "), re.compile(r"\bv\d+")
_TRUTHS = {"olt", "ole", "ogt", "oge", "oeq", "une", "and", "or", "not"}
_BETWEEN = """/* Tables; beyond the ends the value of the end. They begin at `at`, keys at k, values at v. */
static int interval(int k, int n, double x)
{
    int i = 0, j;
    for (j = 1; j < n - 1; j++) i += T[k + j] < x;
    return i;
}

static double between(int k, int v, int n, double x)
{
    int i;
    if (n == 1 || x <= T[k]) return x == x ? T[v] : NAN;
    if (x >= T[k + n - 1]) return T[v + n - 1];
    i = interval(k, n, x);
    return (x - T[k + i]) / (T[k + i + 1] - T[k + i]) * (T[v + i + 1] - T[v + i]) + T[v + i];
}
"""
_TABLES = (
    """static double table_1(int at, double x)
{
    const int n = (int)T[at];
    return between(at + 1, at + 1 + n, n, x);
}
""",
    """static double fraction(int k, int i, double x)
{
    const double f = (x - T[k + i]) / (T[k + i + 1] - T[k + i]);
    return f < 0.0 ? 0.0 : f > 1.0 ? 1.0 : f;
}

static double table_2(int at, double row, double column)
{
    const int n = (int)T[at], m = (int)T[at + 1], k = at + 2, c = k + n;
    int i, j, v = c + m;
    double up, across, left, right;
    if (m == 1) return between(k, v, n, row);
    j = interval(c, m, column);
    across = fraction(c, j, column);
    v += j;
    if (n == 1) return across * (T[v + 1] - T[v]) + T[v];
    i = interval(k, n, row);
    up = fraction(k, i, row);
    v += i * m;
    left = up * T[v + m] + (1.0 - up) * T[v];
    right = up * T[v + m + 1] + (1.0 - up) * T[v + 1];
    return across * (right - left) + left;
}
""",
    """static double table_3(int at, double row, double column, double plane)
{
    const int n = (int)T[at], k = at + 1, i = n > 1 ? interval(k, n, plane) : 0;
    const double low = table_2(at + (int)T[k + n + i], row, column);
    double high;
    if (n == 1 || plane <= T[k]) return low;
    high = table_2(at + (int)T[k + n + i + 1], row, column);
    if (plane >= T[k + n - 1]) return high;
    return (plane - T[k + i]) / (T[k + i + 1] - T[k + i]) * (high - low) + low;
}
""",
)


class _Code(Language):
    """The body of a function of C.

    Attributes:
        functions: name -> text of those that are written, in the order in which C wants them.
        lines: of this one.
    """

    def __init__(self, functions: dict[str, str]) -> None:
        self.functions, self.lines = functions, list[str]()
        self._deep, self._count = 1, 0

    def say(self, line: str) -> None:
        """Write a line."""
        self.lines.append("    " * self._deep + line)

    def _new(self) -> str:
        self._count += 1
        return f"v{self._count}"

    def _put(self, kind: str, value: str) -> str:
        name = self._new()
        self.say(f"const {kind} {name} = {value};")
        return name

    def do(self, op: str, *xs: str) -> str:
        """Write an operation or the call of a function."""
        form = _FORMS.get(op, f"{op}({', '.join(['{}'] * len(xs))})")
        return self._put("int" if op in _TRUTHS else "double", form.format(*xs))

    def constant(self, number: float) -> str:
        """Return a constant."""
        return c_number(number)

    def load(self, base: str, row: int) -> str:
        """Read a register."""
        return self._put("double", f"{base.removeprefix('%')}[{row}]")

    def store(self, base: str, row: int, x: str) -> None:
        """Write a register."""
        self.say(f"R[{row}] = {x};")

    def look_up(self, at: int, *xs: Lanes) -> Lanes:
        """Write the call of a table."""
        return Lanes(self, self.do(f"table_{len(xs)}", str(at), *(x.text for x in xs)))

    @contextmanager
    def branch(self, mask: Mask) -> Iterator[None]:
        """Write a condition."""
        self.say(f"if ({mask.text}) {{")
        self._deep += 1
        yield
        self._deep -= 1
        self.say("}")

    def sometimes(self, mask: Mask, work: Callable[[], Lanes], otherwise: Lanes | float) -> Lanes:
        """Write a condition whose result is known behind it."""
        out = self._new()
        self.say(f"double {out} = {otherwise.text if isinstance(otherwise, Lanes) else c_number(otherwise)};")
        with self.branch(mask):
            self.say(f"{out} = {work().text};")
        return Lanes(self, out)

    def stage(self, name: str, work: Callable[[Rows], None], R: Rows) -> None:
        """Write a function, and its call."""
        self.function(name, work)
        self.say(f"{name}(R);")

    def function(self, name: str, work: Callable[[Rows], None]) -> None:
        """Write a function of the registers unless it is there."""
        if name not in self.functions:
            inside = _Code(self.functions)
            work(Rows(inside))
            self.functions[name] = inside.text(f"static void {name}(double *R)")

    def text(self, head: str) -> str:
        """Return the function, without the values that nothing reads."""
        kept, read = list[str](), set[str]()
        for line in reversed(self.lines):
            value = _VALUE.match(line)
            if value is None or value[1] in read:
                kept.append(line)
                read.update(_NAMES.findall(line))
        unused = [] if any("R[" in line or "(R" in line for line in kept) else ["    (void)R;"]
        return "\n".join([head, "{", *unused, *reversed(kept), "}", ""])


def c_number(x: float) -> str:
    """Return a number as C has it, exactly."""
    if math.isnan(x):
        return "NAN"
    text = repr(float(x)) if math.isfinite(x) else "HUGE_VAL" if x > 0.0 else "-HUGE_VAL"
    return f"({text})" if text.startswith("-") else text


def c_files(model: Alone, name: str) -> tuple[str, str]:
    """Return header and source of a model.

    Args:
        model: what flies.
        name: what all names in the code begin with; what C has no letters for is left out.
    """
    stem = c_identifier(name)
    return _header(model, stem), _source(model, stem)


def _header(model: Alone, stem: str) -> str:
    great, at = stem.upper(), model.trimmed.condition

    def names(signals: Sequence[Signal], kind: str) -> list[str]:
        wide = max(len(x.name) for x in signals)
        return [
            f"    {stem}_{kind}_{x.name:<{wide}} = {i}, /* {x.unit}: {c_comment(x.description)} */"
            for i, x in enumerate(signals)
        ]

    return "\n".join([
        *about(model),
        f"#ifndef {great}_H", f"#define {great}_H", "",
        "#ifdef __cplusplus", 'extern "C" {', "#endif", "",
        f"#define {great}_DT {c_number(model.dt_s)} /* s: the frame time, which is fixed */",
        f"#define {great}_INPUTS {len(model.inputs)}",
        f"#define {great}_OUTPUTS {len(model.outputs)}", "",
        "/* Places of the inputs: commands as the control's own deflection, and the velocity of the air. */",
        "enum {", *names(model.inputs, "in"), "};", "",
        "/* Places of the outputs. */",
        "enum {", *names(model.outputs, "out"), "};", "",
        "/* All that an aircraft remembers from frame to frame; a copy of it is a copy of the flight. */",
        f"typedef struct {{ double R[{model.program.scratch}]; }} {stem}_state;", "",
        f"extern const double {stem}_trim[{great}_INPUTS]; /* inputs at the trim */",
        f"extern const char *const {stem}_input_names[{great}_INPUTS], *const {stem}_input_units[{great}_INPUTS];",
        f"extern const char *const {stem}_output_names[{great}_OUTPUTS], *const {stem}_output_units[{great}_OUTPUTS];",
        "",
        f"/* Begin at the trim, {at}, heading north. */",
        f"void {stem}_init({stem}_state *m);", "",
        "/* Begin elsewhere, in a state that has begun at the trim: with inputs, and at height above sea level (m),",
        "   bank, pitch, heading (rad), velocity over the ground (3, m/s) and rates (3, rad/s) in body axes. Engines",
        "   turn, and filters stand, as they did. */",
        f"void {stem}_place({stem}_state *m, const double inputs[{great}_INPUTS], const double at[10]);", "",
        f"/* Fly for {great}_DT seconds with these inputs. */",
        f"void {stem}_step({stem}_state *m, const double inputs[{great}_INPUTS]);", "",
        "/* Return the outputs as they are now. */",
        f"void {stem}_outputs({stem}_state *m, double outputs[{great}_OUTPUTS]);", "",
        "#ifdef __cplusplus", "}", "#endif", "#endif", "",
    ])  # fmt: skip


def about(model: Alone) -> list[str]:
    """Return a comment that says what the model is, whose, and how far it holds."""
    words = [
        f"{model.aircraft.title}.",
        f"Made by flight-testbench {testbench.__version__} from a JSBSim model; the equations of motion are those of "
        f"JSBSim {version('jsbsim')}. In 20 s in which every control moves it departs from JSBSim by "
        f"{max(model.worst, 1e-16):.0e} of the range of a channel at most.",
        "SI units and radians; signs as in the channel table of flight-testbench. There are no wheels and no ground: "
        "it holds in the air, up to 100 000 ft.",
        *provenance(model.aircraft),
    ]
    lines = [line for word in words for line in wrap(c_comment(word), _WIDE, subsequent_indent="  ")]
    return ["/*", *(f" * {line}" for line in lines), " */"]


def provenance(aircraft: Aircraft) -> Iterable[str]:
    """Yield sentences: licence, author, references and notes as the model's file states them, and what was changed."""
    head = ET.fromstring(aircraft.xml).find("fileheader")
    stated = head if head is not None else ET.Element("fileheader")
    authors = [_words(e) for e in stated.findall("author")]
    licences = [" ".join([*e.attrib.values(), _words(e)]).strip() for e in stated.findall("license")]
    own = "flight-testbench" in authors
    stands = "; ".join(x for x in licences if x) or (
        "MIT, as flight-testbench, whose example it is" if own else "none is stated in the model's file; ask its author"
    )
    yield f"Licence of the model: {stands}."
    yield f"Author of the model: {', '.join(x for x in authors if x) or 'not stated'}."
    for e in stated.findall("reference"):
        yield f"Reference: {', '.join(e.get(k, '') for k in ('author', 'title', 'date') if e.get(k))}."
    for tag in ("note", "limitation"):
        for e in stated.findall(tag):
            yield f"{tag.capitalize()}: {_words(e)}"
    for change in aircraft.amendments:
        yield f"Changed: {change.name}, {change.description}."


def _words(e: ET.Element) -> str:
    return " ".join(" ".join(e.itertext()).split())


def _source(model: Alone, stem: str) -> str:
    great, program = stem.upper(), model.program
    functions: dict[str, str] = {}

    def part(head: str, write: Callable[[_Code, Rows], None], scratch: int | None = None) -> None:
        code = _Code(functions)
        write(code, Rows(code, scratch=scratch))
        functions[head] = code.text(f"static void {head}")

    def does(rows: npt.NDArray[np.int64]) -> Callable[[_Code, Rows], None]:
        return lambda code, R: emit.do(R, rows, code.look_up)

    def logged(code: _Code, R: Rows) -> None:
        emit.do(R, program.log, code.look_up)
        for i, x in enumerate(model.outputs):
            code.say(f"y[{i}] = {(R[x.register] * x.factor).text};")

    def settle(code: _Code, R: Rows) -> None:
        code.say("place(R, A);")
        code.say("frame(R);")
        motion.begin(R)
        code.say("frame(R);")

    part("before(double *R)", does(program.before))
    part("frame(double *R)", does(program.frame), program.scratch)
    part("logged(double *R, double *y)", logged, program.scratch)
    part("place(double *R, const double *A)", lambda code, R: motion.place(R, Rows(code, "A")))
    part("settle(double *R, const double *A)", settle)

    def texts(name: str, signals: Sequence[Signal], size: str, what: str) -> list[str]:
        values = ", ".join(c_string(getattr(x, what)) for x in signals)
        return [f"const char *const {stem}_{name}_{what}s[{great}_{size}] =", *_list(f"{{{values}}};")]

    feet = c_number(FT_M)
    return "\n".join([
        *about(model),
        f'#include "{stem}.h"', "#include <math.h>", "",
        *_tables(program),
        f"static const double AT_TRIM[{program.scratch}] =",
        *_list(f"{{{', '.join(map(c_number, model.registers[: program.scratch]))}}};"), "",
        f"const double {stem}_trim[{great}_INPUTS] =",
        *_list(f"{{{', '.join(c_number(x.at_trim) for x in model.inputs)}}};"),
        *texts("input", model.inputs, "INPUTS", "name"), *texts("input", model.inputs, "INPUTS", "unit"),
        *texts("output", model.outputs, "OUTPUTS", "name"), *texts("output", model.outputs, "OUTPUTS", "unit"), "",
        *functions.values(),
        "static void command(double *R, const double *u)", "{",
        *(f"    R[{x.register}] = u[{i}] / {c_number(x.factor)};" for i, x in enumerate(model.inputs)), "}", "",
        f"void {stem}_init({stem}_state *m)", "{",
        "    int i;", f"    for (i = 0; i < {program.scratch}; i++) m->R[i] = AT_TRIM[i];", "}", "",
        f"void {stem}_place({stem}_state *m, const double inputs[{great}_INPUTS], const double at[10])", "{",
        "    double A[10];", "    int i;",
        f"    for (i = 0; i < 10; i++) A[i] = i == 0 || (i >= 4 && i < 7) ? at[i] / {feet} : at[i];",
        f"    m->R[{r.DT}] = 0.0; /* time stands still */", "    command(m->R, inputs);", "    before(m->R);",
        f"    for (i = 0; i < {model.iterations}; i++) settle(m->R, A);",
        f"    m->R[{r.DT}] = {great}_DT;", "    before(m->R);", "}", "",
        f"void {stem}_step({stem}_state *m, const double inputs[{great}_INPUTS])", "{",
        "    command(m->R, inputs);", "    frame(m->R);", "}", "",
        f"void {stem}_outputs({stem}_state *m, double outputs[{great}_OUTPUTS])", "{",
        "    logged(m->R, outputs);", "}", "",
    ])  # fmt: skip


def _tables(program: Program) -> list[str]:
    """Return the tables and what reads them, as far as the program does."""
    ops = {Op(x) for rows in (program.before, program.frame, program.log) for x in rows[:, 0].tolist()}
    of = Op.TABLE_1 in ops, bool(ops & {Op.TABLE_2, Op.TABLE_3}), Op.TABLE_3 in ops
    if not any(of):
        return []
    values = _list(f"{{{', '.join(map(c_number, program.tables))}}};")
    return [
        "static const double T[] =",
        *values,
        "",
        _BETWEEN,
        *(x for x, is_read in zip(_TABLES, of, strict=True) if is_read),
    ]


def _list(values: str) -> list[str]:
    return wrap(
        values, _WIDE, initial_indent="    ", subsequent_indent="    ", break_long_words=False, break_on_hyphens=False
    )
