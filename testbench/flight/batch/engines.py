"""Engines and thrusters as operations (FGPropulsion and what it drives)."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping

from testbench.flight.batch import registers as r
from testbench.flight.batch.functions import Functions
from testbench.flight.batch.mount import Mount
from testbench.flight.batch.piston import Piston
from testbench.flight.batch.program import Builder, Op, Untranslated
from testbench.flight.batch.propeller import Propeller
from testbench.flight.batch.properties import Properties
from testbench.flight.batch.terms import Term
from testbench.flight.batch.turbine import Turbine
from testbench.flight.batch.turboprop import Turboprop
from testbench.flight.batch.units import convert

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
            mount.set("thrust-lbs", mount.constant(0.0))  # that of the fuel that flows, and none does
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
            rpm = propeller.engine_rpm if propeller is not None else mount.constant(0.0)
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


def _shaft_power(mount: Mount, model: ET.Element, rpm: Term) -> Term:
    """Return what an engine gives at a speed of its shaft, hp."""
    if model.tag == "piston_engine":
        return Piston(mount, model).horsepower(rpm)
    if model.tag == "turboprop_engine":
        return Turboprop(mount, model).horsepower(rpm)
    return _electric(mount, model)


def _drive(mount: Mount, propeller: Propeller | None, horsepower: Term, rpm: Term) -> None:
    """Let an engine's shaft turn a propeller; a direct thruster takes the power for thrust, as JSBSim does."""
    power = horsepower * FT_LBF_S
    power = (rpm <= 0.1).then(power.at_least(0.0), power)
    if propeller is None:
        thrust(mount, power)
    else:
        propeller.turn(power)


def thrust(mount: Mount, force: Term) -> None:
    """Add the force (lbf) of a direct thruster, turned about by its reverser (FGThruster)."""
    force = mount.given("reverser-angle-rad", 0.0).apply(Op.COS) * force
    mount.set("thrust-lbs", force)
    mount.push(force)


def _electric(mount: Mount, model: ET.Element) -> Term:
    """Return the power of an electric motor, hp (FGElectric)."""
    mount.functions(model)
    watts = mount.term(convert(model.find("power"), "WATTS", 745.7))
    horsepower = watts * mount.lever("throttle") / 745.7
    mount.set("power-hp", horsepower)
    return horsepower
