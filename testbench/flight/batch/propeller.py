"""Propellers as operations (FGPropeller): thrust and power over advance ratio and blade angle; speed is a state."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

from testbench.flight.batch import registers as r
from testbench.flight.batch.mount import Mount
from testbench.flight.batch.program import Op, Untranslated
from testbench.flight.batch.terms import Term
from testbench.flight.batch.units import convert

_NAMES = {"C_THRUST", "C_POWER", "CT_MACH", "CP_MACH"}
_SLOW_RPM = 200.0  # below which oil pressure turns no blades
_FEATHERING_FRAMES = 300.0


class Propeller:
    """One propeller.

    Args:
        mount: where it turns.
        e: the ``propeller`` element.

    Raises:
        Untranslated: its tables are not those of a propeller.
    """

    def __init__(self, mount: Mount, e: ET.Element) -> None:
        self._m, self._e = mount, e
        self._tables = {(t.get("name") or ""): t for t in e.findall("table") if t.get("name") in _NAMES}
        if not {"C_THRUST", "C_POWER"} <= set(self._tables):
            raise Untranslated("a propeller has no tables of thrust and power")
        self._low, self._high = self._number("minpitch"), self._number("maxpitch")
        self._diameter = max(convert(e.find("diameter"), "FT", math.nan), 0.001)
        self._inertia = mount.term(max(convert(e.find("ixx"), "SLUG*FT2", math.nan), 1e-6))
        gear = e.find("gearratio")
        self._gear = mount.term(1.0 if gear is None else max(self._number("gearratio"), 0.001))
        sense = mount.place.find("sense")
        self._sense = mount.given("propeller-sense", 1.0 if sense is None or float(sense.text or 0.0) >= 0.0 else -1.0)
        self._rpm = mount.get("propeller-rpm")

    def _number(self, name: str, default: float = 0.0) -> float:
        text = self._e.findtext(name)
        return default if text is None else float(text)

    @property
    def engine_rpm(self) -> Term:
        """Speed of the engine's shaft before this frame, rpm."""
        return self._rpm * self._gear

    def turn(self, power: Term) -> None:
        """Add what the propeller does in a frame.

        Args:
            power: of the engine, ft lbf/s.
        """
        m, D = self._m, self._m.term(self._diameter)
        axes = m.axes()
        along, *across = self._air(axes)
        rho, rps = m.core(r.DENSITY), self._rpm / 60.0
        tip = rps * D * math.pi
        mach = (tip * tip + along * along).apply(Op.SQRT) / m.core(r.SOUND_SPEED)
        J = (rps > 0.01).then(along / (D * rps), along / D)
        pitch = self._blade_angle()
        needed = self._power(J, pitch, mach, rho)
        excess = power - needed
        coefficient = self._coefficient("C_THRUST", J, pitch) * m.term(self._number("ct_factor", 1.0))
        if "CT_MACH" in self._tables:
            coefficient = coefficient * m.table(self._tables["CT_MACH"], mach)
        thrust = coefficient * rps * rps * m.term(self._diameter**4) * rho
        induced = self._induced(thrust, along, rho)
        omega = rps * 2.0 * math.pi
        torque = -self._sense * power / omega.at_least(0.01)
        version = float(self._e.get("version") or 1.0)
        momentum = self._inertia * omega * self._sense * m.term(-1.0 if version > 1.0 else 1.0)
        accelerating = (omega > 0.01).then(excess / omega, excess)
        turned = (rps + accelerating / self._inertia / (2.0 * math.pi) * m.dt) * 60.0
        rpm = (turned < 0.0).then(0.0, turned)
        at = self._acting(along, induced, *across)
        for name, value in (
            ("advance-ratio", J), ("helical-tip-Mach", mach), ("thrust-coefficient", coefficient),
            ("propeller-power-ftlbps", needed), ("propeller-torque-ftlb", torque), ("propeller-rpm", rpm),
            ("engine-rpm", rpm * self._gear), ("prop-induced-velocity_fps", induced), ("thrust-lbs", thrust),
        ):  # fmt: skip
            m.set(name, value)
        m.push(thrust, torque, momentum, at, axes)

    def _air(self, axes: list[list[Term]]) -> list[Term]:
        """Return the velocity (3,) through the air at the hub, axes of the propeller, ft/s."""
        m = self._m
        x, y, z = m.location
        dx, dy, dz = (m.core(r.CG) - x) / 12.0, (y - m.core(r.CG + 1)) / 12.0, (m.core(r.CG + 2) - z) / 12.0
        p, q, s = (m.core(r.P_AERO + i) for i in range(3))
        u = m.core(r.U_AERO) + (q * dz - s * dy)
        v = m.core(r.V_AERO) + (s * dx - p * dz)
        w = m.core(r.W_AERO) + (p * dy - q * dx)
        return [axes[0][k] * u + axes[1][k] * v + axes[2][k] * w for k in range(3)]

    def _blade_angle(self) -> Term:
        """Turn the blades, deg; a governor turns them by the speed that is missing times the frame."""
        m = self._m
        pitch = m.get("blade-angle")
        if self._low == self._high:
            return pitch
        low, high = m.term(self._low), m.term(self._high)
        least, most = m.term(self._number("minrpm")), m.term(self._number("maxrpm"))
        missing = least + (most - least) * m.lever("advance") - self._rpm
        governed = (self._rpm > _SLOW_RPM).then(pitch - missing * m.dt, pitch).bounded(low, high)
        feathered = pitch + (high - pitch) / _FEATHERING_FRAMES
        moved = m.lever("feather").equals(0.0).then(governed, feathered)
        out = m.get("constant-speed-mode").equals(0.0).then(pitch, moved)
        m.set("blade-angle", out)
        return out

    def _coefficient(self, name: str, J: Term, pitch: Term) -> Term:
        table = self._tables[name]
        if dimensions(table) == 1:
            return self._m.table(table, J)
        if self._low == self._high:
            raise Untranslated("a propeller of fixed pitch has a table over blade angles")
        return self._m.table(table, J, pitch)

    def _power(self, J: Term, pitch: Term, mach: Term, rho: Term) -> Term:
        """Return the power that the propeller takes, ft lbf/s."""
        m = self._m
        coefficient = self._coefficient("C_POWER", J, pitch) * m.term(self._number("cp_factor", 1.0))
        if "CP_MACH" in self._tables:
            coefficient = coefficient * m.table(self._tables["CP_MACH"], mach)
        rps = self._rpm / 60.0
        rps = (rps < 0.01).then(0.01, rps)
        return coefficient * rps * rps * rps * m.term(self._diameter**5) * rho

    def _induced(self, thrust: Term, along: Term, rho: Term) -> Term:
        """Return the velocity that the propeller adds at its disk, ft/s."""
        area = self._m.term(0.25 * self._diameter * self._diameter * math.pi)
        squared = along * along.apply(Op.ABS) + 2.0 * thrust / (rho * area)
        root = squared.apply(Op.ABS).apply(Op.SQRT)
        return 0.5 * (squared > 0.0).then(-along + root, -along - root)

    def _acting(self, along: Term, induced: Term, v: Term, w: Term) -> list[Term] | None:
        """Return where the thrust acts (3,), in: beside the hub where the air comes in aslant (P-factor)."""
        m, e = self._m, self._m.place.find("p_factor")
        if e is None:
            return None
        shift = m.term(float(e.text or 0.0))
        aslant = (v * v + w * w).apply(Op.SQRT)
        angle = Term(along.builder, along.builder.emit(Op.ATAN2, aslant.value, (along + induced).value))
        factor = self._sense * shift * angle / aslant
        acts = (shift > 0.0001) & (aslant > 0.0001)
        x, y, z = m.location
        out = [acts.then(y + factor * w, m.get("y-position")), acts.then(z + factor * v, m.get("z-position"))]
        for name, value in zip(("y-position", "z-position"), out, strict=True):
            m.set(name, value)
        return [x, *out]


def dimensions(table: ET.Element) -> int:
    """Return how many keys a table has; JSBSim tells it from the first two lines of numbers."""
    lines = [line.split() for line in (table.findtext("tableData") or "").splitlines() if line.strip()]
    return 2 if len(lines) > 1 and len(lines[1]) == len(lines[0]) + 1 else 1
