"""Turboprops as operations (FGTurboProp): a gas generator that follows the throttle, and power by its speed.

JSBSim gives no power while time stands still; flights begin after frames of no length in which it does, and so it does
here at once. An engine that does not run has no fuel.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

from testbench.flight.batch import registers as r
from testbench.flight.batch.mount import Mount
from testbench.flight.batch.program import Op, Untranslated
from testbench.flight.batch.terms import Term

_DOWN_1_S, _UP_1_S = 0.1, 0.05  # rates at which the torque limiter takes the throttle back and gives it again
_FRICTION_HP, _TURNING_RPM = -0.012, 5.0


class Turboprop:
    """One turboprop.

    Args:
        mount: where it runs.
        e: the ``turboprop_engine`` element.

    Raises:
        Untranslated: the model starts, stops or reverses it, or a table of its power is missing.
    """

    def __init__(self, mount: Mount, e: ET.Element) -> None:
        mount.unmoved(
            "propulsion/cutoff_cmd", "propulsion/starter_cmd", "propulsion/engine[#]/set-running",
            "propulsion/engine[#]/reverser", "propulsion/engine[#]/n1",
        )  # fmt: skip
        self._m, self._e = mount, e
        self._tables = {t.get("name") or "": t for t in e.findall("table")}
        if "EnginePowerRPM_N1" not in self._tables:
            raise Untranslated("a turboprop has no table of its power")

    def _number(self, name: str, default: float) -> Term:
        text = self._e.findtext(name)
        return self._m.term(default if text is None else float(text))

    def horsepower(self, rpm: Term) -> Term:
        """Return the power of a frame, hp, at a speed of its shaft, rpm."""
        m = self._m
        functions = m.functions(self._e)
        if "EnginePowerVC" in functions:
            share = functions["EnginePowerVC"]
        elif "EnginePowerVC" in self._tables:
            share = m.looked_up(self._tables["EnginePowerVC"])
        else:
            raise Untranslated("a turboprop has no table of its power over speed and height")
        throttle, running = self._limited(m.lever("throttle")), m.get("set-running")
        idle, lag = self._number("idlen1", 30.0), self._number("n1idle_max_delay", 1.0)
        n1 = m.get("n1")
        follows = self._nearer(n1, idle + throttle * (self._number("maxn1", 100.0) - idle), lag, lag * 2.4)
        windmills = self._nearer(n1, m.core(r.QBAR) / 15.0, lag * 2.5, lag * 5.0)
        n1 = (running > 0.5).then(follows, windmills)
        power = m.table(self._tables["EnginePowerRPM_N1"], rpm, n1) * share
        most = self._number("maxpower", 0.0)
        power = (power > most).then(most, power)
        power = (running > 0.5).then(power, (rpm > _TURNING_RPM).then(_FRICTION_HP, 0.0))
        for name, value in (("n1", n1), ("set-running", running), ("power-hp", power)):
            m.set(name, value)
        return power

    def _limited(self, throttle: Term) -> Term:
        """Return the throttle as the limiter of torque leaves it."""
        m, limit = self._m, self._e.find("ielumaxtorque")
        if limit is None:
            return throttle
        most, old = m.term(float(limit.text or 0.0)), m.hidden("throttle")
        wants, at_work = throttle >= old, m.get("ielu_intervent")
        torque = m.get("propeller-torque-ftlb").apply(Op.ABS)
        back = wants & (torque > most) & (most > 0.0)
        again = wants & at_work
        out = back.then(old - _DOWN_1_S * m.dt, again.then(old + _UP_1_S * m.dt, throttle))
        m.set("ielu_intervent", back.then(1.0, again))
        m.hide("throttle", out)
        return out

    def _nearer(self, value: Term, target: Term, up_s: Term, down_s: Term) -> Term:
        """Return a value that goes towards a target by the time constants of either way (FGTurboProp::ExpSeek)."""
        dt = self._m.dt
        falls = (value - target) * (-dt / down_s).apply(Op.EXP) + target
        rises = (target - value) * (1.0 - (-dt / up_s).apply(Op.EXP)) + value
        return (value > target).then(falls, (value < target).then(rises, value))
