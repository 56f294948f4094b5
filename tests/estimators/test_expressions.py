"""Expressions as text: what they mean, and what is refused, by name and place."""

import math

import numpy as np
import pytest

from testbench.estimators.equations import DEEPEST, LONGEST, Binary, ExpressionError, Name, Number, names, tree
from testbench.estimators.parametric.structures.written import FUNCTIONS, _compiled

SYMBOLS = ("a", "b", "_c", "x1")


def value(text, at=()):
    """Return the value of an expression as it is compiled."""
    function = _compiled([("params", SYMBOLS)], [], [tree(text)])
    return function(np.asarray(at))[0]


def drawn(rng, depth):
    """Return an expression drawn at random, with and without needless brackets and spaces, and the same in Python."""
    kind = rng.integers(7) if depth else rng.integers(2)
    space = " " * int(rng.integers(2))
    if kind == 0:
        return (number := f"{rng.uniform(0.1, 3.0):.{rng.integers(5)}f}"), number
    if kind == 1:
        return (name := str(rng.choice(SYMBOLS))), name
    inner, python = drawn(rng, depth - 1)
    if kind == 2:
        return f"-{space}({inner})", f"-({python})"
    if kind == 3:
        name = str(rng.choice(["sin", "cos", "tanh", "atan", "abs"]))
        return f"{name}({space}{inner})", f"{name}({python})"
    if kind == 4:
        exponent, sign = int(rng.integers(1, 4)), rng.choice(["^", "**"])
        return f"({inner}){space}{sign}{exponent}", f"({python})**{exponent}"
    other, other_python = drawn(rng, depth - 1)
    sign = str(rng.choice(["+", "-", "*", "/"]))
    if rng.integers(2):
        return f"({inner}){space}{sign}{space}({other})", f"({python}){sign}({other_python})"
    return f"{inner}{space}{sign}{other}", f"{python}{sign}{other_python}"


def test_a_thousand_random_expressions_are_worth_what_python_says():
    rng = np.random.default_rng(5)
    known = {"sin": math.sin, "cos": math.cos, "tanh": math.tanh, "atan": math.atan, "abs": abs}
    finite = 0
    for _ in range(1000):
        text, python = drawn(rng, 4)
        at = rng.uniform(-2.0, 2.0, len(SYMBOLS))
        try:
            expected = eval(python, {"__builtins__": {}}, known | dict(zip(SYMBOLS, at.tolist(), strict=True)))
        except (ZeroDivisionError, OverflowError):
            continue
        finite += 1
        assert value(text, at) == pytest.approx(expected, rel=1e-9), text
    assert finite > 900


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("-2^2", -4.0),
        ("2^3^2", 512.0),
        ("2^-1", 0.5),
        ("2**-1*4", 2.0),
        ("-2^-2", -0.25),
        ("8/2/2", 2.0),
        ("8-2-2", 4.0),
        ("+-+1.5e-1", -0.15),
        ("2*-3", -6.0),
        (".5 + 1.", 1.5),
        ("min(2, max(1, 3))", 2.0),
        ("atan2(1, -1)", 0.75 * math.pi),
        ("4^0.5", 2.0),
        ("((((7))))", 7.0),
    ],
)
def test_signs_bind_as_in_mathematics(text, expected):
    assert value(text, np.zeros(4)) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("__import__('os').system('true')", "there is no function '__import__'"),
        ("a.__class__", "'.' is no sign"),
        ("eval(a)", "there is no function 'eval'"),
        ("a[0]", "'[' is no sign"),
        ("lambda: a", "':' is no sign"),
        ("a; b", "';' is no sign"),
        ("'a'", "is no sign"),
        ("a if b else _c", "a sign must stand between 'a' and 'if', at character 3"),
        ("2 alpha", "a sign must stand between '2' and 'alpha'"),
        ("sine(a)", "there is no function 'sine'; did you mean 'sin'?"),
        ("sign(a)", "'sign' is discontinuous and has no derivative"),
        ("a < b", "'<' is a comparison, which is discontinuous"),
        ("a +", "must stand here, at character 4 (its end)"),
        ("", "must stand here, at character 1 (its end)"),
        ("(a + b", "a bracket is not closed, at character 1"),
        ("a + b)", "a bracket is closed that was not opened, at character 6"),
        ("a, b", "a comma stands between arguments of a function only"),
        ("atan2(a)", "'atan2' takes 2 argument(s), got 1"),
        ("1e999", "a number must be finite, got '1e999'"),
        ("α*a", "'α' is no sign"),
        ("a//b", "must stand here, at character 3"),
        ("a" * (LONGEST + 1), f"at most {LONGEST} characters"),
        ("(" * (DEEPEST + 1) + "a", "nested brackets"),
        ("-" * (DEEPEST + 1) + "a", "nested brackets"),
        ("a" + "^a" * (DEEPEST + 1), "nested brackets"),
        ("a" + "+a" * (DEEPEST + 1), f"at most {DEEPEST} terms"),
    ],
)
def test_what_is_no_expression_is_refused_with_its_place(text, said):
    with pytest.raises(ExpressionError) as error:
        tree(text)
    assert said in str(error.value)


def test_a_tree_knows_its_symbols_and_where_they_stand():
    whole = tree("a*x1 + sin(a)")
    assert [(s.name, s.at) for s in names(whole)] == [("a", 0), ("x1", 2), ("a", 11)]
    assert tree("a+1") == Binary("+", Name("a", 0), Number(1.0))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_derivatives_of_functions_are_exact(name):
    rng = np.random.default_rng(3)
    function = FUNCTIONS[name]
    count = 2 if name in ("atan2", "min", "max") else 1
    for _ in range(20):
        at = rng.uniform(0.05, 0.9, count) * (1.0 if name in ("log", "sqrt") else rng.choice([-1.0, 1.0], count))
        for i in range(count):
            step = np.eye(count)[i]
            exact = np.imag(function(*(at + 1e-30j * step))) / 1e-30
            near = (function(*(at + 1e-6 * step)) - function(*(at - 1e-6 * step))) / 2e-6
            assert exact == pytest.approx(near, rel=1e-6, abs=1e-8)
            assert np.real(function(*(at + 1e-30j * step))) == function(*at)


@pytest.mark.parametrize("text", ["sqrt(a)", "log(a)", "a^0.5", "asin(3*a)"])
def test_outside_their_range_functions_give_no_number_even_for_complex_steps(text):
    with np.errstate(all="ignore"):
        for at in (-np.ones(4), -np.ones(4) + 1e-30j):
            assert np.isnan(np.real(value(text, at)))


def test_powers_of_negative_numbers_are_differentiated_exactly():
    at = np.array([-1.7, 0, 0, 0]) + 1e-30j * np.eye(4)[0]
    assert np.imag(value("a^3", at)) / 1e-30 == pytest.approx(3 * 1.7**2, rel=1e-14)
    assert np.imag(value("a^-2", at)) / 1e-30 == pytest.approx(-2 * (-1.7) ** -3, rel=1e-14)
