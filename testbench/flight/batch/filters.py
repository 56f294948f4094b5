"""Linear filters and integrators of JSBSim's flight control as operations (FGFilter, FGPID).

JSBSim makes them discrete by Tustin's rule, with the frame time for which the model was loaded: they go on while time
stands still.
"""

from __future__ import annotations

from testbench.flight.batch.program import Value
from testbench.flight.batch.scope import Scope

_NO_TRIGGER = 0.000001  # below which it integrates


def lag(c: Scope, x: Value, last_input: Value, last_output: Value, rate: Value) -> Value:
    """Return the output of a lag with a corner at ``rate``, rad/s."""
    step = c.channel.dt * rate
    below = 2.0 + step
    return step / below * (x + last_input) + last_output * ((2.0 - step) / below)


def lag_filter(c: Scope) -> Value:
    """Translate C1/(s + C1)."""
    x, x1, y1 = _history(c)
    return _remembered(c, x, lag(c, x, x1, y1, c.parameter("c1")))


def lead_lag_filter(c: Scope) -> Value:
    """Translate (C1 s + C2)/(C3 s + C4)."""
    x, x1, y1 = _history(c)
    ahead, behind = (2.0 * c.parameter(n) for n in ("c1", "c3"))
    still, slow = (c.channel.dt * c.parameter(n) for n in ("c2", "c4"))
    below = behind + slow
    y = x * ((ahead + still) / below) + x1 * ((still - ahead) / below) + y1 * ((behind - slow) / below)
    return _remembered(c, x, y)


def washout_filter(c: Scope) -> Value:
    """Translate s/(s + C1)."""
    x, x1, y1 = _history(c)
    slow = c.channel.dt * c.parameter("c1")
    below = 2.0 + slow
    a, b = 2.0 / below, (2.0 - slow) / below
    return _remembered(c, x, x * a - x1 * a + y1 * b)


def second_order_filter(c: Scope) -> Value:
    """Translate (C1 s² + C2 s + C3)/(C4 s² + C5 s + C6)."""
    x, x1, y1 = _history(c)
    x2, y2 = c.recall("input-2"), c.recall("output-2")
    above, below = ([c.parameter(f"c{i}") for i in three] for three in ((1, 2, 3), (4, 5, 6)))
    whole = _order_two(c, below)[0]
    (b0, b1, b2), (_, a1, a2) = ([z / whole for z in _order_two(c, three)] for three in (above, below))
    y = c.once_started(x * b0 + x1 * b1 + x2 * b2 - y1 * a1 - y2 * a2)
    c.keep("input-2", x1)
    c.keep("output-2", y1)
    return _remembered(c, x, y)


def _order_two(c: Scope, s: list[Value]) -> tuple[Value, Value, Value]:
    """Return the three coefficients in z of s[0] s² + s[1] s + s[2], times dt²."""
    dt = c.channel.dt
    fast, middle, slow = 4.0 * s[0], 2.0 * s[1] * dt, s[2] * dt * dt
    return fast + middle + slow, 2.0 * s[2] * dt * dt - 8.0 * s[0], fast - middle + slow


def _history(c: Scope) -> tuple[Value, Value, Value]:
    """Return input, last input, last output; the first run of a filter reads nothing and gives zero."""
    return c.once_started(c.input()), c.recall("input"), c.recall("output")


def _remembered(c: Scope, x: Value, y: Value) -> Value:
    y = c.once_started(y)
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
    x, x1 = c.input(), c.recall("input")
    trigger = c.p.read(c.e.findtext("trigger") or "") if c.e.find("trigger") is not None else None
    gain = c.e.find(integral)
    total, before = c.recall("integral"), x1
    if trigger is not None:
        total, before = ((trigger < 0.0).then(0.0, held) for held in (total, x1))
    if gain is not None:
        change = _rule(c, gain.get("type") or rule, x, x1)
        if trigger is not None:
            change = (abs(trigger) < _NO_TRIGGER).then(change, 0.0)
        total = total + c.parameter(integral) * c.channel.dt * change
    c.keep("integral", total)
    c.keep("input-2", before)
    c.keep("input", x)
    return _summed(c, x, x1, total)


def _rule(c: Scope, rule: str, x: Value, x1: Value) -> Value:
    """Return what is integrated over a frame; Adams and Bashforth's of second order if the rule has no name."""
    if rule == "rect":
        return x
    if rule == "trap":
        return 0.5 * (x + x1)
    if rule == "ab3":
        return (23.0 * x - 16.0 * x1 + 5.0 * c.recall("input-2")) / 12.0
    return 1.5 * x - 0.5 * x1


def _summed(c: Scope, x: Value, x1: Value, integral: Value) -> Value:
    """Return proportion, integral and derivative together; of the standard form, all times the proportional gain."""
    standard, proportional = c.e.get("type") == "standard", c.parameter("kp")
    out = integral
    if standard:
        out = x + integral
    elif c.e.find("kp") is not None:
        out = proportional * x + integral
    if c.e.find("kd") is not None:
        rate = c.e.findtext("pvdot")
        slope = c.p.read(rate) if rate else (x - x1) / c.channel.dt
        out = out + c.parameter("kd") * slope
    return proportional * out if standard else out
