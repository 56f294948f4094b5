"""Functions and tables of the batch against JSBSim's own: random ones, nested, and every one at its corners."""

import math

import numpy as np
import pytest
from side_by_side import INPUTS, SideBySide, differences

MOST = 1e-12
ONE = ("sqrt", "exp", "ln", "log2", "log10", "abs", "sin", "cos", "tan", "asin", "acos", "atan", "sign", "floor",
       "ceil", "fraction", "integer", "toradians", "todegrees", "roundmultiple")  # fmt: skip
TWO = ("quotient", "pow", "fmod", "atan2")
MANY = ("sum", "product", "difference", "min", "max", "avg")
COMPARED = ("lt", "le", "gt", "ge", "eq", "nq")
CORNERS = (0.0, -0.0, 1.0, -1.0, 0.5, -0.5, 1.5, 2.5, -2.5, 3.0, 1e-9, 1e-300, 1e300, -1e300,
           0.49999999999999994, 4503599627370497.0, math.inf, -math.inf, math.nan)  # fmt: skip
CONSTANTS = (-3.25, -1.0, -0.5, 0.0, 0.3, 0.5, 1.0, 2.0, 7.5)
KEYS = (-2.0, -1.0, -0.5, 0.0, 0.25, 1.0, 3.0)


def element(tag, *inside):
    return f"<{tag}>{''.join(inside)}</{tag}>"


def value(x):
    return f"<value>{float(x)!r}</value>"


class Draw:
    """Draws functions and tables."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)

    def one_of(self, things):
        return things[self.rng.integers(len(things))]

    def keys(self, least=1):
        n = self.rng.integers(least, 5)
        return sorted(float(k) for k in self.rng.choice(KEYS, n, replace=False))

    def grid(self):
        columns = self.keys(2)
        numbers = self.rng.normal(0.0, 3.0, (8, len(columns))).tolist()
        lines = [columns, *([k, *row] for k, row in zip(self.keys(), numbers, strict=False))]
        return "\n".join(" ".join(map(repr, line)) for line in lines)

    def table(self):
        dimensions = self.rng.integers(1, 4)
        axes = zip(("row", "column", "table"), self.rng.permutation(INPUTS)[:dimensions], strict=False)
        by = [f'<independentVar lookup="{axis}">{name}</independentVar>' for axis, name in axes]
        if dimensions == 1:
            data = [element("tableData", "\n".join(f"{k!r} {self.rng.normal()!r}" for k in self.keys()))]
        elif dimensions == 2:
            data = [element("tableData", self.grid())]
        else:
            data = [f'<tableData breakPoint="{k!r}">{self.grid()}</tableData>' for k in self.keys(2)]
        return element("table", *by, *data)

    def leaf(self):
        kind = self.rng.random()
        if kind < 0.5:
            return f"<property>{self.one_of(INPUTS)}</property>"
        return value(self.one_of(CONSTANTS)) if kind < 0.8 else self.table()

    def condition(self, depth):
        kind = self.rng.integers(5)
        if kind == 0 or depth == 0:
            return value(self.one_of((0.0, 1.0, -1.0, 0.3, 1e-10)))
        if kind == 1:
            return element("not", self.condition(depth - 1))
        if kind == 2:
            n = self.rng.integers(2, 4)
            return element(self.one_of(("and", "or")), *(self.condition(depth - 1) for _ in range(n)))
        return element(self.one_of(COMPARED), self.function(depth - 1), self.function(depth - 1))

    def function(self, depth):
        if depth == 0 or self.rng.random() < 0.1:
            return self.leaf()
        x, y = self.function(depth - 1), self.function(depth - 1)
        multiple = value(self.one_of((1.0, 2.5, -3.0, 4.9)))
        kind = self.one_of(("one", "one", "one", "two", "many", "many", *_OTHERS))
        if kind == "one":
            return element(self.one_of(ONE), x)
        if kind == "two":
            return element(self.one_of(TWO), x, y)
        if kind == "many":
            return element(self.one_of(MANY), *[x, y, self.leaf(), self.leaf()][: self.rng.integers(1, 5)])
        if kind == "roundmultiple":
            return element(kind, x, multiple)
        if kind == "mod":  # of what is an integer in C
            return element(kind, element("max", element("min", x, value(1e4)), value(-1e4)), multiple)
        if kind == "switch":
            index = element("ifthen", self.condition(depth - 1), value(1.4), value(0.0))
            return element(kind, index, x, y, self.leaf())
        if kind == "interpolate1d":
            ends = np.cumsum(self.rng.choice([0.3, 0.5, 1.0, 2.0], self.rng.integers(2, 5))) - 1.5
            points = (part for k in ends.tolist() for part in (value(k), self.leaf()))
            return element(kind, element("min", x, value(1e9)), *points)  # NaN left out
        return element("ifthen", self.condition(depth - 1), x, y) if kind == "ifthen" else self.condition(depth)


_OTHERS = ("roundmultiple", "mod", "switch", "interpolate1d", "ifthen", "ifthen", "condition")


def spread(seed):
    """Points (60, 4): every corner and key on every axis, among random ones."""
    rng = np.random.default_rng(seed)
    out = np.concatenate([rng.normal(0.0, 1.5, (20, 4)), rng.choice(KEYS, (14, 4)), rng.choice(CORNERS, (26, 4))])
    out[-len(CORNERS) :, 0] = CORNERS
    return out


def compare(taurus, functions, inputs):
    names = [f"test/f{i}" for i in range(len(functions))]
    text = "".join(f'<function name="{n}">{f}</function>' for n, f in zip(names, functions, strict=True))
    side = SideBySide.of(taurus, f'<system name="test">{text}</system>', names)
    truth, got = side.points(inputs)
    apart = differences(truth, got)
    worst = np.unravel_index(np.argmax(apart), apart.shape)
    assert apart[worst] < MOST, (
        f"{functions[worst[1]]} at {inputs[worst[0]]}: {truth[worst]!r} in JSBSim, {got[worst]!r} in the batch"
    )
    return truth


@pytest.mark.sampled(30)  # LLVM takes a second to compile sixty functions
@pytest.mark.parametrize("seed", range(30))
def test_nested_functions(taurus, seed):
    draw = Draw(seed)
    compare(taurus, [draw.function(4) for _ in range(60)], spread(seed))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(4))
def test_tables(taurus, seed):
    draw = Draw(100 + seed)
    compare(taurus, [draw.table() for _ in range(100)], spread(seed))


def test_every_function_at_every_corner(taurus):
    x, y = (f"<property>{n}</property>" for n in INPUTS[:2])
    functions = [element(tag, x) for tag in ONE]
    functions += [element(tag, x, y) for tag in (*TWO, *MANY, *COMPARED)]
    functions += [element(tag, x, y, x) for tag in ("min", "max")] + [element("min", y, x, value(2.0))]
    functions += [element("ifthen", element(tag, x, y), value(1.0), value(2.0)) for tag in COMPARED]
    inputs = np.zeros((len(CORNERS) ** 2, 4))
    inputs[:, 0], inputs[:, 1] = np.repeat(CORNERS, len(CORNERS)), np.tile(CORNERS, len(CORNERS))
    truth = compare(taurus, functions, inputs)
    quotient = truth[:, functions.index(element("quotient", x, y))].reshape(len(CORNERS), -1)
    assert np.all(quotient[:, :2] == np.inf)  # by zero
    root = truth[:, functions.index(element("sqrt", x))]
    assert np.all(root[inputs[:, 0] < 0.0] == -np.inf)


def test_a_condition_that_jsbsim_refuses_gives_nothing(taurus):
    x, one = f"<property>{INPUTS[0]}</property>", value(1.0)
    refused = [element("ifthen", x, one, one), element("and", x, one), element("or", x, one), element("not", x),
               element("switch", x, one, one)]  # fmt: skip
    for function in refused:
        section = f'<system name="test"><function name="test/f">{function}</function></system>'
        side = SideBySide.of(taurus, section, ["test/f"])
        side.fdm.set(INPUTS[0], 2.0)
        with pytest.raises(RuntimeError, match=r"[Mm]alformed|selected a value"):
            side.fdm.fdm.run_ic()
        side.fdm.set(INPUTS[0], 0.0)  # JSBSim evaluates functions once more when it forgets a model, and would end
        assert np.isnan(side.computed(np.array([[2.0, 0.0, 0.0, 0.0]])))
