"""JSBSim's own properties as registers of the rigid body."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

from testbench.flight.batch import registers as r
from testbench.flight.batch.program import Builder, Untranslated, Value

_DEG = 180.0 / math.pi
_SLUG_LB = 32.174049
_KT = 1.0 / (1852.0 / (3600.0 * 0.3048))

_NED = ("north", "east", "down")
Places = dict[str, tuple[int, float]]


def _axes(name: str, axes: Iterable[str], first: int) -> Places:
    """Return a vector's properties, one per axis, whose registers follow each other."""
    return {name.format(a): (first + i, 1.0) for i, a in enumerate(axes)}


def _and_degrees(places: Places) -> Places:
    """Return angles with the same in degrees."""
    return places | {n.replace("-rad", "-deg"): (at, _DEG) for n, (at, _) in places.items()}


CORE: Places = {
    "simulation/dt": (r.DT, 1.0),
    "simulation/sim-time-sec": (r.TIME, 1.0),
    "velocities/h-dot-fps": (r.V_DOWN, -1.0),
    **_axes("velocities/v-{}-fps", _NED, r.V_NORTH),
    **_axes("velocities/{}-fps", "uvw", r.U),
    **_axes("velocities/{}-rad_sec", "pqr", r.P),
    **_axes("velocities/{}i-rad_sec", "pqr", r.RATE),
    **_axes("velocities/{}-aero-fps", "uvw", r.U_AERO),
    **_axes("velocities/{}-aero-rad_sec", "pqr", r.P_AERO),
    "position/h-sl-ft": (r.H_SL, 1.0),
    "position/h-sl-meters": (r.H_SL, 0.3048),
    "position/h-agl-ft": (r.H_AGL, 1.0),
    "position/geod-alt-ft": (r.H_AGL, 1.0),
    "position/radius-to-vehicle-ft": (r.RADIUS, 1.0),
    "position/from-start-neu-n-ft": (r.LOCATION + 2, 1.0),  # flights start over the equator at longitude 0
    "position/from-start-neu-e-ft": (r.LOCATION + 1, 1.0),
    "velocities/vt-fps": (r.VT, 1.0),
    "velocities/vtrue-fps": (r.VT, 1.0),
    "velocities/vtrue-kts": (r.VT, _KT),
    "velocities/mach": (r.MACH, 1.0),
    "velocities/vg-fps": (r.V_GROUND, 1.0),
    **_and_degrees(_axes("aero/{}-rad", ("alpha", "beta"), r.ALPHA)),
    **_and_degrees(_axes("aero/{}dot-rad_sec", ("alpha", "beta"), r.ALPHA_DOT)),
    "aero/qbar-psf": (r.QBAR, 1.0),
    "aero/qbarUW-psf": (r.QBAR_UW, 1.0),
    "aero/qbarUV-psf": (r.QBAR_UV, 1.0),
    "aero/cl-squared": (r.CL_SQUARED, 1.0),
    "aero/bi2vel": (r.BI2VEL, 1.0),
    "aero/ci2vel": (r.CI2VEL, 1.0),
    "aero/alpha-wing-rad": (r.ALPHA_WING, 1.0),
    "aero/qbar-area": (r.QBAR_AREA, 1.0),
    "atmosphere/T-R": (r.TEMPERATURE, 1.0),
    "atmosphere/rho-slugs_ft3": (r.DENSITY, 1.0),
    "atmosphere/P-psf": (r.PRESSURE, 1.0),
    "atmosphere/a-fps": (r.SOUND_SPEED, 1.0),
    "metrics/Sw-sqft": (r.WING_AREA, 1.0),
    "metrics/bw-ft": (r.WING_SPAN, 1.0),
    "metrics/cbarw-ft": (r.CHORD, 1.0),
    "metrics/iw-rad": (r.INCIDENCE, 1.0),
    "inertia/mass-slugs": (r.MASS, 1.0),
    "inertia/weight-lbs": (r.WEIGHT, 1.0),
    **_axes("inertia/i{0}{0}-slugs_ft2", "xyz", r.INERTIA),
    **_axes("metrics/aero-rp-{}-in", "xyz", r.REFERENCE_POINT),
    **_axes("metrics/eyepoint-{}-in", "xyz", r.EYE_POINT),
    **_axes("inertia/cg-{}-in", "xyz", r.CG),
    **_axes("accelerations/{}dot-ft_sec2", "uvw", r.U_DOT),
    **_axes("accelerations/{}dot-rad_sec2", "pqr", r.P_DOT),
    **_axes("accelerations/{}idot-rad_sec2", "pqr", r.RATE_DOT),
    **_axes("atmosphere/total-wind-{}-fps", _NED, r.WIND),
    **_axes("atmosphere/gust-{}-fps", _NED, r.GUST),
    **_axes("forces/fb{}-aero-lbs", "xyz", r.AERO_FORCE),
    **_axes("forces/fw{}-aero-lbs", "xyz", r.WIND_FORCE),
    **_axes("moments/{}-aero-lbsft", "lmn", r.AERO_MOMENT),
    **_axes("forces/fb{}-prop-lbs", "xyz", r.ENGINE_FORCE),
    **_axes("moments/{}-prop-lbsft", "lmn", r.ENGINE_MOMENT),
    **_axes("forces/fb{}-external-lbs", "xyz", r.ADDED_FORCE),
    **_axes("moments/{}-external-lbsft", "lmn", r.ADDED_MOMENT),
    **_axes("forces/fb{}-total-lbs", "xyz", r.FORCE),
    **_axes("moments/{}-total-lbsft", "lmn", r.MOMENT),
}
"""Property -> the register that holds it, and the factor between them."""

EULER = _and_degrees(_axes("attitude/{}-rad", ("phi", "theta", "psi"), r.PHI))
EULER |= _axes("attitude/{}-rad", ("roll", "pitch", "heading-true"), r.PHI)
GEOGRAPHY = _and_degrees(_axes("position/{}-rad", ("lat-gc", "lat-geod", "long-gc"), r.LATITUDE))
EULER_RATES = _axes("velocities/{}dot-rad_sec", ("phi", "theta", "psi"), r.PHI_DOT)
AIR_DATA: Places = {
    "aero/Re": (r.REYNOLDS, 1.0),
    **_and_degrees({"flight-path/gamma-rad": (r.GAMMA, 1.0)}),
    "flight-path/psi-gt-rad": (r.TRACK, 1.0),
    **_axes("accelerations/N{}", "xyz", r.N_X),
    "aero/h_b-cg-ft": (r.H_B_CG, 1.0),
    "aero/h_b-mac-ft": (r.H_B_MAC, 1.0),
    **_axes("accelerations/a-pilot-{}-ft_sec2", "xyz", r.PILOT_ACCEL),
    **{f"accelerations/n-pilot-{a}-norm": (r.PILOT_ACCEL + i, 0.3048 / 9.80665) for i, a in enumerate("xyz")},
}
PITOT: Places = {
    "propulsion/tat-r": (r.TOTAL_TEMPERATURE, 1.0),
    "propulsion/pt-lbs_sqft": (r.TOTAL_PRESSURE, 1.0),
    "velocities/vc-fps": (r.VC, 1.0),
    "velocities/vc-kts": (r.VC, _KT),
    "velocities/ve-fps": (r.VE, 1.0),
    "velocities/ve-kts": (r.VE, _KT),
}
ALTITUDES = _axes("atmosphere/{}-altitude", ("density", "pressure"), r.DENSITY_ALTITUDE)
ON_DEMAND = ALTITUDES | EULER | GEOGRAPHY | EULER_RATES | AIR_DATA | PITOT
"""The same for what is computed only if a model or a channel reads it."""

ABSOLUTE = {"aero/mag-beta-rad": "aero/beta-rad", "aero/mag-beta-deg": "aero/beta-deg"}
_SEA_LEVEL = {"atmosphere/delta": (r.PRESSURE, 2116.228), "atmosphere/theta": (r.TEMPERATURE, 518.67)}

# What JSBSim itself moves and this does not know: it must not be taken for a number that stays.
_MOVING = re.compile(
    r"(position|velocities|attitude|accelerations|aero|atmosphere|flight-path|forces|moments|inertia|orbital|"
    r"propulsion|simulation|systems/stall|ic|trim)(/|$)"
)
_STAYING = re.compile(
    r"atmosphere/(T-sl-R|rho-sl-slugs_ft3|a-sl-fps)|propulsion/engine(\[\d+\])?/(set-running|[xyz]-reference-position)|"
    r"inertia/(empty-weight-lbs|pointmass-\S+)|simulation/(integrator/\S+|gravitational-torque|channel-dt)|"
    r"aero/(alpha-max-rad|alpha-min-rad)|propulsion/(fuel_freeze|refuel|magneto_cmd|cutoff_cmd|starter_cmd)|"
    r"propulsion/tank(\[\d+\])?/\S+"
)
_GROUND = re.compile(r"(forces/fb[xyz]-gear-lbs|moments/[lmn]-gear-lbsft)")
ON_GROUND = re.compile(r"gear/unit(\[\d+\])?/WOW|gear/wow")
"""Whether wheels stand on the ground: in flight they do not, but JSBSim keeps it of those that were raised on it."""
# What JSBSim itself calls things of an engine: a model that declares another name means one of its own.
_OF_ENGINES = frozenset({
    "AFR", "advance-ratio", "air-intake-impedance-factor", "atsfc", "blade-angle", "bleed-factor", "boost-speed",
    "boostloss-factor", "boostloss-hp", "bsfc-lbs_hphr", "cht-degF", "combustion_efficiency", "constant-speed-mode",
    "cooling-factor", "egt-degF", "engine-rpm", "engtemp-c", "friction-hp", "fuel-flow-rate-gph",
    "fuel-flow-rate-pps", "fuel-used-lbs", "helical-tip-Mach", "ielu_intervent", "injection_cmd", "isp", "itt-c",
    "map-inhg", "map-pa", "mixture-ratio", "n1", "n2", "oil-pressure-psi", "oil-temperature-degF",
    "oxi-flow-rate-pps", "pct-full", "pitch-angle-rad", "power-hp", "prop-induced-velocity_fps",
    "propeller-power-ftlbps", "propeller-rpm", "propeller-sense", "propeller-torque-ftlb", "ram-air-factor",
    "reverser", "reverser-angle-rad", "seized", "set-running", "stalled", "starter-norm", "thrust-coefficient",
    "thrust-lbs", "torque-lbsft", "total-impulse", "tsfc", "vacuum-thrust_lbs", "volumetric-efficiency",
    "x-position", "y-position", "yaw-angle-rad", "z-position",
})  # fmt: skip


def plain(name: str) -> str:
    """Return a property's name as it is kept: no leading slash, no index of zero."""
    return name.strip().lstrip("/").replace("[0]", "")


class Properties:
    """Reads and writes properties in a program.

    Args:
        builder: of the program.
        computed: properties of the model's own engines, which are not JSBSim's alone to move.
    """

    def __init__(self, builder: Builder) -> None:
        self._b = builder
        self._own: set[str] = set()
        self._written: set[str] = set()

    def declare(self, name: str) -> None:
        """Say that the model itself moves a property, whatever its name."""
        self._own.add(plain(name))

    def declared(self, name: str) -> None:
        """Say that the model names a property as its own: it is, if of an engine and JSBSim has no such word."""
        name = plain(name)
        if name.startswith("propulsion/engine") and name.rpartition("/")[2] not in _OF_ENGINES:
            self._own.add(name)

    def moves(self, name: str) -> bool:
        """Return whether something before this place of the frame moves a property."""
        return plain(name) in self._written

    def hide(self, name: str) -> None:
        """Say that JSBSim computes a property, inside of something else, whose value is not known here."""
        name = plain(re.sub(r"\s", "-", name.strip()))
        self._own.add(name)
        self._b.write(name, self._b.unknown(f"it reads {name}"))

    def read(self, name: str) -> Value:
        """Return a property's value; a name that begins with a minus sign is its negative.

        It is unknown if JSBSim moves the property in a way that is not translated.
        """
        name = name.strip()
        if name.startswith("-"):
            return -self.read(name[1:])
        name = plain(name)
        b = self._b
        if name in self._own:
            return b.read(name)
        if _GROUND.fullmatch(name):
            return b.number(0.0)  # flights that come down to the ground are flown by JSBSim
        if name == "forces/load-factor":  # lift of the last frame over the weight (FGAuxiliary::GetNlf)
            return b.core(r.WIND_FORCE + 2) / (b.core(r.MASS) * _SLUG_LB)
        if name in ABSOLUTE:
            return abs(self.read(ABSOLUTE[name]))
        if name in _SEA_LEVEL:
            register, over = _SEA_LEVEL[name]
            return b.core(register) / over
        if name == "atmosphere/sigma":
            from testbench.flight.batch.air import SEA_LEVEL_RHO

            return b.core(r.DENSITY) / SEA_LEVEL_RHO
        if name in CORE or name in ON_DEMAND:
            register, factor = CORE.get(name) or ON_DEMAND[name]
            value = b.core(register)
            return value if factor == 1.0 else value * factor
        linked = _LINKED.fullmatch(name)
        if linked is not None:
            return self._surface(*linked.groups())
        if _MOVING.match(name) and not _STAYING.fullmatch(name):
            return b.unknown(f"it reads {name}")
        return b.read(name)

    def _surface(self, magnitude: str | None, surface: str, unit: str) -> Value:
        """Return a deflection; JSBSim keeps radians, degrees and magnitude of one in step."""
        angle = self._b.read(f"fcs/{surface}-pos-rad")
        if magnitude:
            return abs(angle)
        return angle if unit == "rad" else angle * _DEG

    def write(self, name: str, value: Value) -> None:
        """Write a property.

        Raises:
            Untranslated: it is one that JSBSim computes.
        """
        name, b = plain(name), self._b
        if re.fullmatch(r"atmosphere/gust-(north|east|down)-fps", name):
            b.store(CORE[name][0], value)
            return
        linked = _LINKED.fullmatch(name)
        if linked is not None and linked.group(3) == "deg":
            b.write(f"fcs/{linked.group(2)}-pos-rad", value * (1.0 / _DEG))
            return
        if name.endswith("/initial-integrator-value"):
            raise Untranslated(f"it writes {name}")
        computed = name in CORE or name in ON_DEMAND or re.match(r"(inertia|ic|simulation)/", name)
        if computed and name not in self._own:
            raise Untranslated(f"it writes {name}")
        self._own.add(name)
        self._written.add(name)
        b.write(name, value)


_LINKED = re.compile(r"fcs/(mag-)?(elevator|left-aileron|right-aileron|rudder|flap|speedbrake|spoiler)-pos-(rad|deg)")
