"""Linear filters and integrators of JSBSim's flight control as operations (FGFilter, FGPID).

JSBSim makes them discrete by Tustin's rule, with the frame time for which the model was loaded: they go on while time
stands still.
"""

from __future__ import annotations

from testbench.flight.batch.program import Op, Value
from testbench.flight.batch.scope import Scope

_NO_TRIGGER = 0.000001  # below which it integrates


def lag_coefficients(c: Scope, rate: Value) -> tuple[Value, Value]:
    """Return the share of the inputs and that of the last output of a lag with a corner at ``rate``, rad/s."""
    two, x = c.b.number(2.0), c.emit(Op.MUL, c.channel.dt, rate)
    denominator = c.emit(Op.ADD, two, x)
    return c.emit(Op.DIV, x, denominator), c.emit(Op.DIV, c.emit(Op.SUB, two, x), denominator)


def lag(c: Scope, x: Value, last_input: Value, last_output: Value, rate: Value) -> Value:
    """Return the output of a lag."""
    a, b = lag_coefficients(c, rate)
    return c.emit(Op.ADD, c.emit(Op.MUL, a, c.emit(Op.ADD, x, last_input)), c.emit(Op.MUL, last_output, b))


def lag_filter(c: Scope) -> Value:
    """Translate C1/(s + C1)."""
    x, x1, y1 = _history(c)
    return _remembered(c, x, lag(c, x, x1, y1, c.parameter("c1")))


def lead_lag_filter(c: Scope) -> Value:
    """Translate (C1 s + C2)/(C3 s + C4)."""
    x, x1, y1 = _history(c)
    two, dt = c.b.number(2.0), c.channel.dt
    ahead, behind = (c.emit(Op.MUL, two, c.parameter(n)) for n in ("c1", "c3"))
    still, slow = (c.emit(Op.MUL, dt, c.parameter(n)) for n in ("c2", "c4"))
    denominator = c.emit(Op.ADD, behind, slow)
    a = c.emit(Op.DIV, c.emit(Op.ADD, ahead, still), denominator)
    b = c.emit(Op.DIV, c.emit(Op.SUB, still, ahead), denominator)
    d = c.emit(Op.DIV, c.emit(Op.SUB, behind, slow), denominator)
    y = c.emit(Op.ADD, c.emit(Op.MUL, x, a), c.emit(Op.MUL, x1, b))
    return _remembered(c, x, c.emit(Op.ADD, y, c.emit(Op.MUL, y1, d)))


def washout_filter(c: Scope) -> Value:
    """Translate s/(s + C1)."""
    x, x1, y1 = _history(c)
    two, slow = c.b.number(2.0), c.emit(Op.MUL, c.channel.dt, c.parameter("c1"))
    denominator = c.emit(Op.ADD, two, slow)
    a, b = c.emit(Op.DIV, two, denominator), c.emit(Op.DIV, c.emit(Op.SUB, two, slow), denominator)
    y = c.emit(Op.SUB, c.emit(Op.MUL, x, a), c.emit(Op.MUL, x1, a))
    return _remembered(c, x, c.emit(Op.ADD, y, c.emit(Op.MUL, y1, b)))


def second_order_filter(c: Scope) -> Value:
    """Translate (C1 s² + C2 s + C3)/(C4 s² + C5 s + C6)."""
    x, x1, y1 = _history(c)
    x2, y2 = c.recall("input-2"), c.recall("output-2")
    above, below = ([c.parameter(f"c{i}") for i in three] for three in ((1, 2, 3), (4, 5, 6)))
    denominator = _order_two(c, below)[0]
    (b0, b1, b2), (_, a1, a2) = (
        [c.emit(Op.DIV, z, denominator) for z in _order_two(c, three)] for three in (above, below)
    )
    y = c.emit(Op.ADD, c.emit(Op.MUL, x, b0), c.emit(Op.MUL, x1, b1))
    y = c.emit(Op.ADD, y, c.emit(Op.MUL, x2, b2))
    y = c.emit(Op.SUB, y, c.emit(Op.MUL, y1, a1))
    y = c.once_started(c.emit(Op.SUB, y, c.emit(Op.MUL, y2, a2)), c.b.number(0.0))
    c.keep("input-2", x1)
    c.keep("output-2", y1)
    return _remembered(c, x, y)


def _order_two(c: Scope, s: list[Value]) -> tuple[Value, Value, Value]:
    """Return the three coefficients in z of s[0] s² + s[1] s + s[2], times dt²."""
    b, dt = c.b, c.channel.dt
    fast = c.emit(Op.MUL, b.number(4.0), s[0])
    middle = c.emit(Op.MUL, c.emit(Op.MUL, b.number(2.0), s[1]), dt)
    slow = c.emit(Op.MUL, c.emit(Op.MUL, s[2], dt), dt)
    twice = c.emit(Op.MUL, c.emit(Op.MUL, c.emit(Op.MUL, b.number(2.0), s[2]), dt), dt)
    return (
        c.emit(Op.ADD, c.emit(Op.ADD, fast, middle), slow),
        c.emit(Op.SUB, twice, c.emit(Op.MUL, b.number(8.0), s[0])),
        c.emit(Op.ADD, c.emit(Op.SUB, fast, middle), slow),
    )


def _history(c: Scope) -> tuple[Value, Value, Value]:
    """Return input, last input, last output; the first run of a filter reads nothing and gives zero."""
    return c.once_started(c.input(), c.b.number(0.0)), c.recall("input"), c.recall("output")


def _remembered(c: Scope, x: Value, y: Value) -> Value:
    y = c.once_started(y, c.b.number(0.0))
    c.keep("input", x)
    c.keep("output", y)
    return y


def integrator(c: Scope) -> Value:
    """Translate C1/s: a controller of nothing but this integral, by the trapezoidal rule if not told otherwise."""
    return _controller(c, "c1", "trap")


def pid(c: Scope) -> Value:
    """Translate a controller of proportion, integral and derivative."""
    return _controller(c, "ki", "ab2")


def _controller(c: Scope, integral: str, rule: str) -> Value:
    b, x, x1 = c.b, c.input(), c.recall("input")
    zero = b.number(0.0)
    trigger = c.p.read(c.e.findtext("trigger") or "") if c.e.find("trigger") is not None else None
    gain = c.e.find(integral)
    total, before = c.recall("integral"), x1
    if trigger is not None:
        reset = c.emit(Op.LT, trigger, zero)
        total, before = c.choose(reset, zero, total), c.choose(reset, zero, x1)
    if gain is not None:
        change = _rule(c, gain.get("type") or rule, x, x1)
        if trigger is not None:
            free = c.emit(Op.LT, c.emit(Op.ABS, trigger), b.number(_NO_TRIGGER))
            change = c.choose(free, change, zero)
        slope = c.emit(Op.MUL, c.parameter(integral), c.channel.dt)
        total = c.emit(Op.ADD, total, c.emit(Op.MUL, slope, change))
    c.keep("integral", total)
    c.keep("input-2", before)
    c.keep("input", x)
    return _summed(c, x, x1, total)


def _rule(c: Scope, rule: str, x: Value, x1: Value) -> Value:
    """Return what is integrated over a frame; Adams and Bashforth's of second order if the rule has no name."""
    b = c.b
    if rule == "rect":
        return x
    if rule == "trap":
        return c.emit(Op.MUL, b.number(0.5), c.emit(Op.ADD, x, x1))
    if rule == "ab3":
        x2 = c.recall("input-2")
        total = c.emit(Op.SUB, c.emit(Op.MUL, b.number(23.0), x), c.emit(Op.MUL, b.number(16.0), x1))
        return c.emit(Op.DIV, c.emit(Op.ADD, total, c.emit(Op.MUL, b.number(5.0), x2)), b.number(12.0))
    return c.emit(Op.SUB, c.emit(Op.MUL, b.number(1.5), x), c.emit(Op.MUL, b.number(0.5), x1))


def _summed(c: Scope, x: Value, x1: Value, integral: Value) -> Value:
    """Return proportion, integral and derivative together; of the standard form, all times the proportional gain."""
    standard, proportional = c.e.get("type") == "standard", c.parameter("kp")
    out = integral
    if standard:
        out = c.emit(Op.ADD, x, integral)
    elif c.e.find("kp") is not None:
        out = c.emit(Op.ADD, c.emit(Op.MUL, proportional, x), integral)
    if c.e.find("kd") is not None:
        rate = c.e.findtext("pvdot")
        slope = c.p.read(rate) if rate else c.emit(Op.DIV, c.emit(Op.SUB, x, x1), c.channel.dt)
        out = c.emit(Op.ADD, out, c.emit(Op.MUL, c.parameter("kd"), slope))
    return c.emit(Op.MUL, proportional, out) if standard else out
