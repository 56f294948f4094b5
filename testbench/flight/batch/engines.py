"""Engines and thrusters as operations (FGPropulsion and what it drives).

Turbines as operations (FGTurbine): two spools that seek what the throttle wants, and thrust by tables.

While time stands still JSBSim gives the thrust of the throttle at once, and the first frame afterwards puts the spools
where the throttle wants them. An engine that does not run has no fuel: its spools windmill and it gives nothing.

Turboprops as operations (FGTurboProp): a gas generator that follows the throttle, and power by its speed.

JSBSim gives no power while time stands still; flights begin after frames of no length in which it does, and so it does
here at once. An engine that does not run has no fuel.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping

from testbench.flight.batch import registers as r
from testbench.flight.batch.air import SEA_LEVEL_RHO
from testbench.flight.batch.functions import Functions
from testbench.flight.batch.mount import Mount
from testbench.flight.batch.piston import Piston
from testbench.flight.batch.program import Builder, Op, Untranslated, Value
from testbench.flight.batch.properties import Properties
from testbench.flight.batch.units import convert

_NAMES = {"C_THRUST", "C_POWER", "CT_MACH", "CP_MACH"}
_SLOW_RPM = 200.0  # below which oil pressure turns no blades
_FEATHERING_FRAMES = 300.0
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

    def _number(self, name: str, default: float) -> Value:
        text = self._e.findtext(name)
        return self._m.b.number(default if text is None else float(text))

    def horsepower(self, rpm: Value) -> Value:
        """Return the power of a frame, hp, at a speed of its shaft, rpm."""
        m = self._m
        functions = m.functions(self._e)
        if "EnginePowerVC" in functions:
            share = functions["EnginePowerVC"]
        elif "EnginePowerVC" in self._tables:
            share = m.f.table(self._tables["EnginePowerVC"])
        else:
            raise Untranslated("a turboprop has no table of its power over speed and height")
        throttle, running = self._limited(m.lever("throttle")), m.get("set-running")
        idle, lag = self._number("idlen1", 30.0), self._number("n1idle_max_delay", 1.0)
        n1 = m.get("n1")
        follows = self._nearer(n1, idle + throttle * (self._number("maxn1", 100.0) - idle), lag, lag * 2.4)
        windmills = self._nearer(n1, m.b.core(r.QBAR) / 15.0, lag * 2.5, lag * 5.0)
        n1 = (running > 0.5).then(follows, windmills)
        power = m.f.looked_up(self._tables["EnginePowerRPM_N1"], [rpm, n1]) * share
        most = self._number("maxpower", 0.0)
        power = (power > most).then(most, power)
        power = (running > 0.5).then(power, (rpm > _TURNING_RPM).then(_FRICTION_HP, 0.0))
        for name, value in (("n1", n1), ("set-running", running), ("power-hp", power)):
            m.set(name, value)
        return power

    def _limited(self, throttle: Value) -> Value:
        """Return the throttle as the limiter of torque leaves it."""
        m, limit = self._m, self._e.find("ielumaxtorque")
        if limit is None:
            return throttle
        most, old = m.b.number(float(limit.text or 0.0)), m.hidden("throttle")
        wants, at_work = throttle >= old, m.get("ielu_intervent")
        torque = abs(m.get("propeller-torque-ftlb"))
        back = wants & (torque > most) & (most > 0.0)
        again = wants & at_work
        out = back.then(old - _DOWN_1_S * m.dt, again.then(old + _UP_1_S * m.dt, throttle))
        m.set("ielu_intervent", back.then(1.0, again))
        m.hide("throttle", out)
        return out

    def _nearer(self, value: Value, target: Value, up_s: Value, down_s: Value) -> Value:
        """Return a value that goes towards a target by the time constants of either way (FGTurboProp::ExpSeek)."""
        dt = self._m.dt
        falls = (value - target) * (-dt / down_s).do(Op.EXP) + target
        rises = (target - value) * (1.0 - (-dt / up_s).do(Op.EXP)) + value
        return (value > target).then(falls, (value < target).then(rises, value))


_MOST_LBS = 10000.0
_LAST_PERCENT, _NEAR_FULL_N2 = 0.99, 97.0  # from which throttle and N2 the burner of method 1 lights
_BY_LAST_PERCENT, _BY_FCS = 1, 2


class Turbine:
    """One turbine.

    Args:
        mount: where it runs.
        e: the ``turbine_engine`` element.

    Raises:
        Untranslated: it has no tables of thrust, or water is injected into it.
    """

    def __init__(self, mount: Mount, e: ET.Element) -> None:
        self._m, self._e = mount, e
        if int(self._number("injected", 0.0)) == 1:
            mount.unmoved("propulsion/engine[#]/injection_cmd")
        mount.unmoved(
            "propulsion/cutoff_cmd", "propulsion/starter_cmd", "propulsion/engine[#]/set-running",
            "propulsion/engine[#]/stalled", "propulsion/engine[#]/seized",
        )  # fmt: skip
        self._idle_1, self._idle_2 = (
            mount.b.number(self._number("idlen1", 30.0)),
            mount.b.number(self._number("idlen2", 60.0)),
        )
        self._most_1 = mount.given("MaxN1", self._number("maxn1", 100.0))
        self._most_2 = mount.given("MaxN2", self._number("maxn2", 100.0))

    def _number(self, name: str, default: float) -> float:
        text = self._e.findtext(name)
        return default if text is None else float(text)

    def thrust(self) -> Value:
        """Return the thrust of a frame, lbf."""
        m = self._m
        functions = m.functions(self._e)
        if not {"IdleThrust", "MilThrust"} <= set(functions):
            raise Untranslated("a turbine has no tables of idle and military thrust")
        lever = m.lever("throttle")
        augmenting = (lever > 1.0).then(lever - 1.0, 0.0)
        throttle = (lever > 1.0).then(lever - augmenting, lever)
        still, was_still = m.dt.equals(0.0), m.hidden("still")
        running = m.get("set-running")
        span_1, span_2 = self._most_1 - self._idle_1, self._most_2 - self._idle_2
        want_1, want_2 = self._idle_1 + throttle * span_1, self._idle_2 + throttle * span_2
        turning = self._spools(functions, want_1, want_2, was_still)
        n1, n2 = (
            still.then(m.get(n), (running > 0.5).then(fast, slow))
            for n, fast, slow in zip(("n1", "n2"), turning, self._windmill(), strict=True)
        )
        speed = still.then(want_2, n2)
        norm = (speed - self._idle_2) / span_2
        m.hide("n2-norm", still.then(m.hidden("n2-norm"), norm))
        most = m.b.number(convert(self._e.find("milthrust"), "LBS", _MOST_LBS))
        idle = most * functions["IdleThrust"]
        rest = (most - idle) * functions["MilThrust"]
        dry = idle + rest * norm * norm
        force = self._augmented(functions, dry, throttle, augmenting, speed, still)
        force = (running > 0.5).then(force, 0.0)
        m.hide("still", still)
        m.set("n1", n1)
        m.set("n2", n2)
        m.set("set-running", running)
        return force

    def _spools(
        self, functions: Mapping[str, Value], want_1: Value, want_2: Value, was_still: Value
    ) -> tuple[Value, Value]:
        """Return N1 and N2 of a running engine, %, after a frame."""
        m = self._m
        n = (m.hidden("n2-norm") + 0.1).at_most(1.0)
        left = 1.0 - n
        thin = 1.0 - m.b.core(r.DENSITY) / SEA_LEVEL_RHO
        slow = 1.0 + 3.0 * left * left * left + thin
        bypass = self._number("bypassratio", 0.0)

        def rate(name: str, factor: float) -> Value:
            """Return by how much a spool may change, %/s."""
            return functions[name] if name in functions else m.b.number(factor * 90.0 / (bypass + 3.0)) / slow

        wanted = (("1", want_1, 2.4), ("2", want_2, 3.0))
        n1, n2 = (
            self._sought(
                was_still.then(want, m.get(f"n{i}")), want, rate(f"N{i}SpoolUp", 1.0), rate(f"N{i}SpoolDown", fall)
            )
            for i, want, fall in wanted
        )
        return n1, n2

    def _sought(self, n: Value, target: Value, up: Value, down: Value) -> Value:
        """Return a value moved towards a target, at no more than a rate each way (FGTurbine::Seek)."""
        lower = (n - self._m.dt * down).at_least(target)
        higher = (n + self._m.dt * up).at_most(target)
        return (n > target).then(lower, (n < target).then(higher, n))

    def _windmill(self) -> tuple[Value, Value]:
        """Return N1 and N2 of an engine that does not run, %, after a frame."""
        m, out = self._m, []
        if (self._e.findtext("disable-windmill") or "0").strip() not in {"0", "false"}:
            raise Untranslated("a turbine does not windmill")
        for name, over in (("n1", 10.0), ("n2", 15.0)):
            n = m.get(name)
            down = n / m.b.number(self._number(f"{name}spindown", 2.0))
            out.append(self._sought(n, m.b.core(r.QBAR) / over, n / 2.0 + 0.1, down))
        return out[0], out[1]

    def _augmented(
        self, functions: Mapping[str, Value], dry: Value, throttle: Value, augmenting: Value, n2: Value, still: Value
    ) -> Value:
        """Return the thrust with bleed air taken off and the afterburner lit, lbf."""
        m = self._m
        method, fitted = int(self._number("augmethod", 0.0)), int(self._number("augmented", 0.0)) == 1
        bled = dry * (1.0 - m.given("bleed-factor", self._number("bleed", 0.0)))
        if "AugThrust" not in functions:
            if fitted or method == _BY_FCS:
                raise Untranslated("an afterburner has no table of thrust")
            return bled
        most = m.b.number(convert(self._e.find("maxthrust"), "LBS", _MOST_LBS)) * functions["AugThrust"]
        lit = m.hidden("augmented")
        force = still.then(bled, (lit > 0.5).then(dry, bled))
        if method == _BY_LAST_PERCENT:
            lit = (throttle > _LAST_PERCENT) & (n2 > _NEAR_FULL_N2)
            m.hide("augmented", lit)
            return (lit > 0.5).then(most, force) if fitted else force
        if method == _BY_FCS:
            burns = augmenting > 0.0
            m.hide("augmented", still.then(lit, burns))
            return burns.then(force + (most - force) * augmenting.at_most(1.0), force)
        return force


FT_LBF_S = 550.0  # of a horsepower
_BURNING = {"turbine_engine", "piston_engine", "turboprop_engine", "rocket_engine"}
_KINDS = {"electric_engine"} | _BURNING
_MOVED = {
    "electric_engine": ("power-hp",),
    "turbine_engine": ("n1", "n2", "set-running"),
    "piston_engine": ("set-running", "fuel-flow-rate-pps", "power-hp", "map-pa", "map-inhg", "boost-speed"),
    "turboprop_engine": ("n1", "set-running", "power-hp", "ielu_intervent"),
    "propeller": (
        "advance-ratio", "helical-tip-Mach", "thrust-coefficient", "propeller-power-ftlbps", "propeller-torque-ftlb",
        "propeller-rpm", "engine-rpm", "prop-induced-velocity_fps", "blade-angle", "y-position", "z-position",
    ),
}  # fmt: skip
"""Kind of engine or thruster -> properties that it moves."""
_TURNED = ("reverser-angle-rad", "pitch-angle-rad", "yaw-angle-rad")
"""Properties of any thruster, which stay as they are unless the model moves them."""
_ASIDE = {"location", "orient", "feed", "thruster", "sense", "p_factor", "pointing"}


class Engines:
    """Translates the propulsion of a model into a program.

    Args:
        builder: of the program.
        properties: that engines read and write.
        functions: translates their functions and tables.
        files: name -> text of each file of an engine or thruster.
        frozen: whether fuel stays, and mass with it.
    """

    def __init__(
        self, builder: Builder, properties: Properties, functions: Functions, files: Mapping[str, str], frozen: bool
    ) -> None:
        self._b, self._p, self._f, self._frozen = builder, properties, functions, frozen
        self._files = {name.removesuffix(".xml").lower(): text for name, text in files.items()}

    def breathed(self, propulsion: ET.Element | None) -> set[str]:
        """Return the properties of the air that engines read by themselves: pistons breathe at total pressure."""
        engines = propulsion.findall("engine") if propulsion is not None else []
        pistons = any(self._read(i, e).tag == "piston_engine" for i, e in enumerate(engines))
        return {"propulsion/pt-lbs_sqft"} if pistons else set()

    def declare(self, propulsion: ET.Element | None) -> None:
        """Say which properties engines move, so that control systems before them can read what the last frame left."""
        for i, e in enumerate(propulsion.findall("engine") if propulsion is not None else ()):
            place = e.find("thruster")
            kinds = [self._read(i, x).tag for x in (e, place) if x is not None]
            for function in self._read(i, e).findall("function"):
                self._p.declared(function.get("name") or "")
            for name in (*_TURNED, "thrust-lbs", *(n for kind in kinds for n in _MOVED.get(kind, ()))):
                self._p.declare(f"propulsion/engine[{i}]/{name}")

    def add(self, propulsion: ET.Element | None) -> None:
        """Translate all engines, in the place of the frame where JSBSim runs them.

        Raises:
            Untranslated: an engine or a thruster is of a kind that is not translated.
        """
        self._b.stage(Op.CLEAR, block=r.ENGINE_FORCE)
        for i, engine in enumerate(propulsion.findall("engine") if propulsion is not None else ()):
            self._engine(i, engine)

    def _engine(self, i: int, e: ET.Element) -> None:
        place = e.find("thruster")
        if place is None:
            raise Untranslated("an engine has no thruster")
        model, thruster = self._read(i, e), self._read(i, place)
        mount = Mount(self._b, self._p, self._f, i, place)
        if model.tag not in _KINDS:
            raise Untranslated(f"it has a <{model.tag}>")
        if model.tag in _BURNING and not self._frozen:
            raise Untranslated("it has an engine that burns its fuel")
        if model.tag == "rocket_engine":
            if model.find("thrust_table") is not None:
                raise Untranslated("it has a rocket with solid fuel")
            mount.set("thrust-lbs", mount.b.constant(0.0))  # that of the fuel that flows, and none does
            return
        if thruster.tag not in {"direct", "propeller"}:
            raise Untranslated(f"it has a <{thruster.tag}>")
        propeller = Propeller(mount, thruster) if thruster.tag == "propeller" else None
        if model.tag == "turbine_engine":
            force = Turbine(mount, model).thrust()
            if propeller is None:
                thrust(mount, force)
            else:
                propeller.turn(force)  # JSBSim hands on what an engine gives, whatever it is
        else:
            rpm = propeller.engine_rpm if propeller is not None else mount.b.constant(0.0)
            _drive(mount, propeller, _shaft_power(mount, model, rpm), rpm)
        mount.functions(model, "post")

    def _read(self, i: int, e: ET.Element) -> ET.Element:
        """Return the root of the file that an element names, or what stands in the element itself."""
        name = (e.get("file") or "").removesuffix(".xml").lower()
        if name in self._files:
            return ET.fromstring(self._files[name].replace("[#]", f"[{i}]"))
        inside = [x for x in e if x.tag not in _ASIDE]
        if not inside:
            raise Untranslated(f"the file {e.get('file')} of an engine is not among those read")
        return inside[0]


def _shaft_power(mount: Mount, model: ET.Element, rpm: Value) -> Value:
    """Return what an engine gives at a speed of its shaft, hp."""
    if model.tag == "piston_engine":
        return Piston(mount, model).horsepower(rpm)
    if model.tag == "turboprop_engine":
        return Turboprop(mount, model).horsepower(rpm)
    return _electric(mount, model)


def _drive(mount: Mount, propeller: Propeller | None, horsepower: Value, rpm: Value) -> None:
    """Let an engine's shaft turn a propeller; a direct thruster takes the power for thrust, as JSBSim does."""
    power = horsepower * FT_LBF_S
    power = (rpm <= 0.1).then(power.at_least(0.0), power)
    if propeller is None:
        thrust(mount, power)
    else:
        propeller.turn(power)


def thrust(mount: Mount, force: Value) -> None:
    """Add the force (lbf) of a direct thruster, turned about by its reverser (FGThruster)."""
    force = mount.given("reverser-angle-rad", 0.0).do(Op.COS) * force
    mount.set("thrust-lbs", force)
    mount.push(force)


def _electric(mount: Mount, model: ET.Element) -> Value:
    """Return the power of an electric motor, hp (FGElectric)."""
    mount.functions(model)
    watts = mount.b.number(convert(model.find("power"), "WATTS", 745.7))
    horsepower = watts * mount.lever("throttle") / 745.7
    mount.set("power-hp", horsepower)
    return horsepower


# --- propellers -------------------------------------------------------------------------------------------------------


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
        self._inertia = mount.b.number(max(convert(e.find("ixx"), "SLUG*FT2", math.nan), 1e-6))
        gear = e.find("gearratio")
        self._gear = mount.b.number(1.0 if gear is None else max(self._number("gearratio"), 0.001))
        sense = mount.place.find("sense")
        self._sense = mount.given("propeller-sense", 1.0 if sense is None or float(sense.text or 0.0) >= 0.0 else -1.0)
        self._rpm = mount.get("propeller-rpm")

    def _number(self, name: str, default: float = 0.0) -> float:
        text = self._e.findtext(name)
        return default if text is None else float(text)

    @property
    def engine_rpm(self) -> Value:
        """Speed of the engine's shaft before this frame, rpm."""
        return self._rpm * self._gear

    def turn(self, power: Value) -> None:
        """Add what the propeller does in a frame.

        Args:
            power: of the engine, ft lbf/s.
        """
        m, D = self._m, self._m.b.number(self._diameter)
        axes = m.axes()
        along, *across = self._air(axes)
        rho, rps = m.b.core(r.DENSITY), self._rpm / 60.0
        tip = rps * D * math.pi
        mach = (tip * tip + along * along).do(Op.SQRT) / m.b.core(r.SOUND_SPEED)
        J = (rps > 0.01).then(along / (D * rps), along / D)
        pitch = self._blade_angle()
        needed = self._power(J, pitch, mach, rho)
        excess = power - needed
        coefficient = self._coefficient("C_THRUST", J, pitch) * m.b.number(self._number("ct_factor", 1.0))
        if "CT_MACH" in self._tables:
            coefficient = coefficient * m.f.looked_up(self._tables["CT_MACH"], [mach])
        thrust = coefficient * rps * rps * m.b.number(self._diameter**4) * rho
        induced = self._induced(thrust, along, rho)
        omega = rps * 2.0 * math.pi
        torque = -self._sense * power / omega.at_least(0.01)
        version = float(self._e.get("version") or 1.0)
        momentum = self._inertia * omega * self._sense * m.b.number(-1.0 if version > 1.0 else 1.0)
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

    def _air(self, axes: list[list[Value]]) -> list[Value]:
        """Return the velocity (3,) through the air at the hub, axes of the propeller, ft/s."""
        m = self._m
        x, y, z = m.location
        dx, dy, dz = (m.b.core(r.CG) - x) / 12.0, (y - m.b.core(r.CG + 1)) / 12.0, (m.b.core(r.CG + 2) - z) / 12.0
        p, q, s = (m.b.core(r.P_AERO + i) for i in range(3))
        u = m.b.core(r.U_AERO) + (q * dz - s * dy)
        v = m.b.core(r.V_AERO) + (s * dx - p * dz)
        w = m.b.core(r.W_AERO) + (p * dy - q * dx)
        return [axes[0][k] * u + axes[1][k] * v + axes[2][k] * w for k in range(3)]

    def _blade_angle(self) -> Value:
        """Turn the blades, deg; a governor turns them by the speed that is missing times the frame."""
        m = self._m
        pitch = m.get("blade-angle")
        if self._low == self._high:
            return pitch
        low, high = m.b.number(self._low), m.b.number(self._high)
        least, most = m.b.number(self._number("minrpm")), m.b.number(self._number("maxrpm"))
        missing = least + (most - least) * m.lever("advance") - self._rpm
        turned = (self._rpm > _SLOW_RPM).then(pitch - missing * m.dt, pitch)
        governed = (turned < low).then(low, (turned > high).then(high, turned))
        feathered = pitch + (high - pitch) / _FEATHERING_FRAMES
        moved = m.lever("feather").equals(0.0).then(governed, feathered)
        out = m.get("constant-speed-mode").equals(0.0).then(pitch, moved)
        m.set("blade-angle", out)
        return out

    def _coefficient(self, name: str, J: Value, pitch: Value) -> Value:
        table = self._tables[name]
        if dimensions(table) == 1:
            return self._m.f.looked_up(table, [J])
        if self._low == self._high:
            raise Untranslated("a propeller of fixed pitch has a table over blade angles")
        return self._m.f.looked_up(table, [J, pitch])

    def _power(self, J: Value, pitch: Value, mach: Value, rho: Value) -> Value:
        """Return the power that the propeller takes, ft lbf/s."""
        m = self._m
        coefficient = self._coefficient("C_POWER", J, pitch) * m.b.number(self._number("cp_factor", 1.0))
        if "CP_MACH" in self._tables:
            coefficient = coefficient * m.f.looked_up(self._tables["CP_MACH"], [mach])
        rps = self._rpm / 60.0
        rps = (rps < 0.01).then(0.01, rps)
        return coefficient * rps * rps * rps * m.b.number(self._diameter**5) * rho

    def _induced(self, thrust: Value, along: Value, rho: Value) -> Value:
        """Return the velocity that the propeller adds at its disk, ft/s."""
        area = self._m.b.number(0.25 * self._diameter * self._diameter * math.pi)
        squared = along * abs(along) + 2.0 * thrust / (rho * area)
        root = abs(squared).do(Op.SQRT)
        return 0.5 * (squared > 0.0).then(-along + root, -along - root)

    def _acting(self, along: Value, induced: Value, v: Value, w: Value) -> list[Value] | None:
        """Return where the thrust acts (3,), in: beside the hub where the air comes in aslant (P-factor)."""
        m, e = self._m, self._m.place.find("p_factor")
        if e is None:
            return None
        shift = m.b.number(float(e.text or 0.0))
        aslant = (v * v + w * w).do(Op.SQRT)
        angle = aslant.do(Op.ATAN2, along + induced)
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
