"""What moves surfaces, and what measures, of JSBSim's flight control as operations.

FGKinemat, FGDeadBand, FGActuator; FGSensor with FGAccelerometer and FGGyro; FGAngles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from testbench.core.record import FloatArray
from testbench.flight.batch import registers as r
from testbench.flight.batch.filters import lag
from testbench.flight.batch.program import Op, Untranslated, Value
from testbench.flight.batch.scope import Scope, property_name
from testbench.flight.batch.units import convert, triplet

_RAD = 0.017453293  # JSBSim's own of a degree, in <angle>


def kinematic(c: Scope) -> Value:
    """Translate a movement from detent to detent, each in its time."""
    settings = c.e.findall("traverse/setting")
    detents, times = ([float(s.findtext(n) or "nan") for s in settings] for n in ("position", "time"))
    if len(detents) < 2:
        raise Untranslated(f"the kinematic component {c.name} has fewer than two settings")
    low, *_, high = numbers = [c.b.number(x) for x in (*detents, *times)][: len(detents)]
    x = c.input()
    if c.e.find("noscale") is None:
        x = x * high
    x = x.do(Op.CLIP, low, high)
    return c.b.moved(x, c.p.read(c.outputs[0]), c.channel.dt, numbers, [c.b.number(t) for t in times])


def deadband(c: Scope) -> Value:
    """Translate a band of no answer, with a gain outside of it."""
    return _beside(c.input(), 0.5 * c.parameter("width"), c.number("gain", 1.0))


def _beside(x: Value, half: Value, gain: Value | float = 1.0) -> Value:
    """Return how far a value lies outside of a band of half a width, times a gain."""
    return (x < -half).then((x + half) * gain, (x > half).then((x - half) * gain, 0.0))


def actuator(c: Scope) -> Value:
    """Translate an actuator: lag, rate limit, dead band, hysteresis, bias, delay, in this order; and its failures."""
    x = c.input()
    zero, hardover, stuck = (c.fails(f"fail_{how}") for how in ("zero", "hardover", "stuck"))
    if zero is not None:
        x = zero.then(0.0, x)
    if hardover is not None:
        low, high = c.clip_ends() or (0.0, 0.0)
        x = hardover.then((x < 0.0).then(low, high), x)
    # A stuck one lives on as if it were not, but for what it remembers.
    kept: list[tuple[str, Value]] = []
    if c.e.find("lag") is not None:
        slow = lag(c, x, c.recall("lag-input"), c.recall("lag-output"), c.parameter("lag"))
        y = c.once_started(slow, x)
        kept += [("lag-input", x), ("lag-output", y)]
        x = y
    if c.e.find("rate_limit") is not None:
        x = c.once_started(_limited(c, x), x)
        kept.append(("limited", x))
    if c.e.find("deadband_width") is not None:
        x = _beside(x, c.number("deadband_width") / 2.0)
    if c.e.find("hysteresis_width") is not None:
        x = c.once_started(_hysteresis(c, x), x)
        kept.append(("hysteresis", x))
    if c.e.find("bias") is not None:
        x = x + c.number("bias")
    if c.e.find("delay") is not None and stuck is not None:
        raise Untranslated(f"the actuator {c.name} has a delay and can get stuck")
    x = c.delayed(x)
    for what, value in kept:
        c.keep(what, value if stuck is None else stuck.then(c.recall(what), value))
    if stuck is not None:
        x = stuck.then(c.recall("output"), x)
        c.keep("output", x)
    return x


def saturated(c: Scope, output: Value) -> Value:
    """Return whether an actuator is at one of its limits; one of zero does not count."""
    ends = c.clip_ends()
    if ends is None:
        return c.b.constant(0.0)
    low, high = ends
    return high.differs(0.0) & (output >= high) | low.differs(0.0) & (output <= low)


def _limited(c: Scope, x: Value) -> Value:
    """Return a value that goes no faster than the limits of rate, both of them or one per sense."""
    last = c.recall("limited")
    change, out = x - last, x
    limits: dict[str, str] = {}
    for e in c.e.findall("rate_limit"):
        sense = e.get("sense")
        for way in ("incr", "decr") if sense is None else (sense[:4],):
            limits[way] = e.text or ""
    if "incr" in limits:
        step = c.parameter_of(limits["incr"]) * c.channel.dt
        out = (change > step).then(last + step, out)
    if "decr" in limits:
        step = -c.parameter_of(limits["decr"]) * c.channel.dt
        out = (change < step).then(last + step, out)
    return out


def _hysteresis(c: Scope, x: Value) -> Value:
    last = c.recall("hysteresis")
    half = 0.5 * c.number("hysteresis_width")
    return (x > last).then(last.at_least(x - half), (x < last).then(last.at_most(x + half), x))


def sensor(c: Scope) -> Value:
    """Translate a sensor of a property."""
    return _sensed(c, c.input())


def gyro(c: Scope) -> Value:
    """Translate a sensor of the body's rates against inertial space."""
    return _sensed(c, _along(c, [c.b.core(r.RATE + i) for i in range(3)]))


def accelerometer(c: Scope) -> Value:
    """Translate a sensor of the acceleration without gravity at its place."""
    b = c.b
    place = [b.number(x) for x in triplet(c.e.find("location"), "IN")]
    cg = [b.core(r.CG + i) for i in range(3)]
    arms = ((cg[0], place[0]), (place[1], cg[1]), (cg[2], place[2]))
    arm = [1.0 / 12.0 * (x - y) for x, y in arms]
    rate, turning = ([b.core(first + i) for i in range(3)] for first in (r.RATE, r.RATE_DOT))
    parts = [b.core(r.BODY_ACCEL + i) for i in range(3)], _cross(turning, arm), _cross(rate, _cross(rate, arm))
    return _sensed(c, _along(c, [x + y + z for x, y, z in zip(*parts, strict=True)]))


def _cross(x: Sequence[Value], y: Sequence[Value]) -> list[Value]:
    return [x[i] * y[j] - x[j] * y[i] for i, j in ((1, 2), (2, 0), (0, 1))]


def _along(c: Scope, vector: Sequence[Value]) -> Value:
    """Return what a sensor feels of a vector in body axes along its own axis (FGSensorOrientation)."""
    axis = "xyz".find((c.e.findtext("axis") or "x").strip().lower())
    orient, numbers = c.e.find("orientation"), np.eye(3)
    if orient is not None:
        angles = [convert(orient.find(n), "RAD", 0.0, orient.get("unit")) for n in ("roll", "pitch", "yaw")]
        numbers = _turned(*angles)
    x, y, z = (c.b.number(k) * v for k, v in zip(numbers[max(axis, 0)], vector, strict=True))
    return x + y + z


def _turned(roll: float, pitch: float, yaw: float) -> FloatArray:
    """Return the matrix (3, 3) from body axes to those of a sensor."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(x), math.cos(x)) for x in (roll, pitch, yaw))
    return np.array([
        [cp * cy, cp * sy, -sp],
        [sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp],
        [cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp],
    ])  # fmt: skip


def _sensed(c: Scope, x: Value) -> Value:
    """Return what a sensor makes of a value: lag, drift, gain, bias, delay, failures, quantization, in this order.

    A lag, a gain or a number of bits of zero stands for none.

    Raises:
        Untranslated: it has noise.
    """
    if c.constant("noise") != 0.0:
        raise Untranslated(f"the sensor {c.name} has noise")
    low, high, stuck = (c.fails(f"fail_{how}") for how in ("low", "high", "stuck"))
    if stuck is not None:
        raise Untranslated(f"the sensor {c.name} can get stuck")
    y = x
    if c.e.find("lag") is not None:
        rate = c.number("lag")
        has = rate.differs(0.0)
        slow = lag(c, x, c.recall("input"), c.recall("lagged"), rate)
        c.keep("input", has.then(x, 0.0))
        c.keep("lagged", has.then(slow, 0.0))
        y = has.then(slow, x)
    if c.e.find("drift_rate") is not None:
        drift = c.recall("drift") + c.number("drift_rate") * c.channel.dt
        c.keep("drift", drift)
        y = y + drift
    if c.e.find("gain") is not None:
        gain = c.number("gain")
        y = gain.differs(0.0).then(y * gain, y)
    if c.e.find("bias") is not None:
        y = y + c.number("bias")
    y = c.delayed(y)
    for failed, end in ((low, -math.inf), (high, math.inf)):
        if failed is not None:
            y = failed.then(end, y)
    return _quantized(c, y) if c.e.find("quantization") is not None else y


def _quantized(c: Scope, y: Value) -> Value:
    b = c.b
    bits, least, most = (c.constant(f"quantization/{n}") for n in ("bits", "min", "max"))
    low, high, step = (b.number(x) for x in (least, most, (most - least) / 2.0 ** int(bits)))
    within = (y < low).then(low, y)
    within = (within > high).then(high, within)
    count = ((within - low) / step).do(Op.INTEGER)
    has = b.number(int(bits)).differs(0.0)
    name = (c.e.find("quantization").get("name") or "").strip()  # type: ignore[union-attr]
    if name and "/" not in name:
        c.write(property_name(name), has.then(count, 0.0))
    return has.then(count * step + low, y)


def angle(c: Scope) -> Value:
    """Translate the angle from one direction to another, the short way."""
    ends = []
    for name in ("source_angle", "target_angle"):
        e = c.e.find(name)
        if e is None:
            raise Untranslated(f"the component {c.name} has no <{name}>")
        ends.append(c.p.read(e.text or "") * (_RAD if e.get("unit") == "DEG" else 1.0))
    (x1, y1), (x2, y2) = ((end.do(Op.COS), end.do(Op.SIN)) for end in ends)
    between = (x1 * x2 + y1 * y2).do(Op.CLIP, -1.0, 1.0).do(Op.ACOS)
    between = between * (180.0 / math.pi if c.e.get("unit") == "DEG" else 1.0)
    return (x1 * y2 >= x2 * y1).then(between, -between)
