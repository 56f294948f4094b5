"""Independent reference for the simulator: six degrees of freedom and elastic modes in plain numpy and scipy.

It shares no code with the package: it reads the numbers of an aircraft from its own two files and writes the textbook
equations anew (B. Etkin, L. D. Reid, Dynamics of Flight, 3rd ed., section 4.7, rigid body over a flat Earth; M. R.
Waszak, D. K. Schmidt, J. Aircraft 25(6), 1988, eq. 31, modes about mean axes).

State: u, v, w (m/s, body axes), p, q, r (rad/s), phi, theta, psi (rad), h (m), deflections de, da, dr (rad), then eta
and eta' of every mode. Forces: lift, drag and side force in wind axes, moments in body axes about the centre of
gravity, thrust along body x through it.

Neglected, with sizes at 16 m/s, and how each can be put back (``beyond``) to show that it alone explains a difference:
- "density": change of density with height, 9.7e-5 of it per metre. It moves the root of height from zero, and the
  phugoid's by V^2 / 4 g times 9.7e-5 per metre: 6e-4 at 16 m/s, 1e-3 at 20 m/s.
- "curvature" of the Earth: a horizon that turns by V / R = 2.5e-6 rad/s, 2e-5 rad in 8 s.
- "rotation" of the Earth: Coriolis acceleration 2 Omega times the velocity east, up or down (the simulator starts at
  the equator, heading north): 1.5e-4 m/s2 for every m/s, 2.3e-3 m/s2 at most. The centrifugal acceleration is in the
  gravity used here. Body rates are relative to the Earth; the gyroscopic moments Omega r (Ixx - Izz) and the like
  bend them by some 1e-5 rad/s2.
- Change of gravity with height, 3e-7 of g per metre: left out always. Gravity is taken at the height of the flight.
"""

import math
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import root

FloatArray = NDArray[np.float64]
RIGID = ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "h")
_MOTIONS = ("0", "alpha", "q", "de", "beta", "p", "r", "da", "dr")  # rates per cbar / 2V or b / 2V
SURFACES = {"de": "elevator", "da": "aileron", "dr": "rudder"}
_FOOT, _POUND_FORCE = 0.3048, 4.4482216152605
_EARTH_RATE = 7.292115e-5  # rad/s, WGS 84
_RADIUS_NORTH, _RADIUS_EAST = 6335439.0, 6378137.0  # m, radii of curvature of the WGS 84 ellipsoid at the equator
_WATTS_TO_FT_LBF_S = 550.0 / 745.7  # JSBSim's horsepower, see the comment in Engines/motor.xml


def standard_density(h_m: float) -> float:
    """Return the density of ISO 2533:1975 below 11 km, kg/m3, from geometric height."""
    geopotential = 6356766.0 * h_m / (6356766.0 + h_m)
    T = 288.15 - 0.0065 * geopotential
    p = 101325.0 * (T / 288.15) ** (9.80665 / (0.0065 * 287.05287))
    return p / (287.05287 * T)


def normal_gravity(h_m: float) -> float:
    """Return gravity at the equator, m/s2: WGS 84 with the free-air reduction (NIMA TR8350.2, section 4.2)."""
    a, f, m = 6378137.0, 1.0 / 298.257223563, 0.00344978650684
    return 9.7803253359 * (1.0 - 2.0 / a * (1.0 + f + m) * h_m + 3.0 * h_m**2 / a**2)


@dataclass(frozen=True)
class Servo:
    """First-order lag (rad/s) with a rate limit (rad/s)."""

    lag: float
    rate: float


@dataclass(frozen=True, eq=False)
class Reference:
    """One aircraft at one height; build it with :func:`read_reference`.

    Attributes:
        mass, inertia, S, b, c: kg, (Ixx, Iyy, Izz) in kg m2, m2, m, m.
        rigid: coefficient -> motion -> derivative, e.g. ``rigid["CL"]["alpha"]``.
        polar: CD0, k, CL0 and CL_alpha of CD = CD0 + k (CL0 + CL_alpha alpha)^2.
        thrust: thrust (N) as a function of throttle (0 to 1) and airspeed (m/s).
        servos: by control.
        forces: (n, 9) modal force coefficients: zero, alpha, q, de, beta, p, r, da, dr.
        eta, etadot: (n, n) modal aerodynamic stiffness and damping coefficients.
        effects: coefficient -> (n,) per eta and (n,) per eta' cbar / 2V.
        omega, zeta, modal_mass: (n,).
        g, rho, height: m/s2, kg/m3 and the height (m) that they are taken at.
        beyond: what is added to a flat Earth at rest under air of one density; see the head of this file.
    """

    mass: float
    inertia: tuple[float, float, float]
    S: float
    b: float
    c: float
    rigid: Mapping[str, Mapping[str, float]]
    polar: tuple[float, float, float, float]
    thrust: Callable[[float, float], float]
    servos: Mapping[str, Servo]
    forces: FloatArray
    eta: FloatArray
    etadot: FloatArray
    effects: Mapping[str, tuple[FloatArray, FloatArray]]
    omega: FloatArray
    zeta: FloatArray
    modal_mass: FloatArray
    g: float
    rho: float
    height: float
    beyond: frozenset[str] = frozenset()

    @property
    def modes(self) -> int:
        """Number of elastic modes."""
        return self.omega.size

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states, in order."""
        numbers = range(1, self.modes + 1)
        return (*RIGID, *SURFACES, *(f"eta_{i}" for i in numbers), *(f"etadot_{i}" for i in numbers))

    def rate(self, x: FloatArray, commands: Sequence[float], throttle: float) -> FloatArray:
        """Return xdot (n,) for the state ``x``, the commands of de, da, dr (rad) and the throttle (0 to 1)."""
        deflections = x[10:13].tolist()
        xdot = np.empty_like(x)
        for i, servo in enumerate(self.servos.values()):
            xdot[10 + i] = min(max(servo.lag * (commands[i] - deflections[i]), -servo.rate), servo.rate)
        self._motion(x, deflections, throttle, xdot)
        return xdot

    def _motion(self, x: FloatArray, deflections: Sequence[float], throttle: float, xdot: FloatArray) -> None:
        u, v, w, p, q, r, phi, theta, psi, h = x[:10].tolist()
        n = self.modes
        eta, etadot = x[13 : 13 + n], x[13 + n : 13 + 2 * n]
        V = math.sqrt(u * u + v * v + w * w)
        alpha, beta = math.atan2(w, u), math.atan2(v, math.hypot(u, w))
        rho = self.rho
        if "density" in self.beyond:
            rho *= standard_density(h) / standard_density(self.height)
        qbarS = 0.5 * rho * V * V * self.S
        long_time, wide_time = self.c / (2.0 * V), self.b / (2.0 * V)
        de, da, dr = deflections
        values = 1.0, alpha, q * long_time, de, beta, p * wide_time, r * wide_time, da, dr
        motion = dict(zip(_MOTIONS, values, strict=True))
        C = {
            name: sum(d * motion[m] for m, d in table.items() if m != "alphadot") for name, table in self.rigid.items()
        }
        cd0, k, cl0, cl_alpha = self.polar
        C["CD"] = cd0 + k * (cl0 + cl_alpha * alpha) ** 2
        if n:
            for name, (of_eta, of_etadot) in self.effects.items():
                C[name] += float(of_eta @ eta + of_etadot @ etadot * long_time)
            modal = self.forces @ np.array(values)
            modal += self.eta @ eta + self.etadot @ etadot * long_time
            xdot[13 : 13 + n] = etadot
            xdot[13 + n :] = (
                qbarS * self.c / self.modal_mass * modal - 2.0 * self.zeta * self.omega * etadot - self.omega**2 * eta
            )
        # Wind axes to body axes.
        ca, sa, cb, sb = math.cos(alpha), math.sin(alpha), math.cos(beta), math.sin(beta)
        sp, cp, st, ct = math.sin(phi), math.cos(phi), math.sin(theta), math.cos(theta)
        D, Y, L = qbarS * C["CD"], qbarS * C["CY"], qbarS * C["CL"]
        X = -D * ca * cb - Y * ca * sb + L * sa + self.thrust(throttle, V)
        Z = -D * sa * cb - Y * sa * sb - L * ca
        udot = X / self.mass - self.g * st + r * v - q * w
        wdot = Z / self.mass + self.g * ct * cp + q * u - p * v
        lag = self.rigid["CL"].get("alphadot", 0.0) * qbarS * long_time / self.mass
        if lag:  # lift proportional to alphadot: two equations linear in udot and wdot
            a = 1.0 / (u * u + w * w)
            M = np.array([[1.0 + lag * sa * w * a, -lag * sa * u * a], [-lag * ca * w * a, 1.0 + lag * ca * u * a]])
            udot, wdot = np.linalg.solve(M, [udot, wdot])
        Ixx, Iyy, Izz = self.inertia
        xdot[0] = udot
        xdot[1] = (Y * cb - D * sb) / self.mass + self.g * ct * sp + p * w - r * u
        xdot[2] = wdot
        moments = qbarS * self.b * C["Cl"], qbarS * self.c * C["Cm"], qbarS * self.b * C["Cn"]
        xdot[3] = (moments[0] + (Iyy - Izz) * q * r) / Ixx
        xdot[4] = (moments[1] + (Izz - Ixx) * p * r) / Iyy
        xdot[5] = (moments[2] + (Ixx - Iyy) * p * q) / Izz
        xdot[9] = u * st - v * sp * ct - w * cp * ct
        if self.beyond & {"curvature", "rotation"}:
            (e0, n0), (e1, n1), (e2, n2) = _east_and_north_in_body(phi, theta, psi)
            if "rotation" in self.beyond:
                ox, oy, oz = _EARTH_RATE * n0, _EARTH_RATE * n1, _EARTH_RATE * n2
                xdot[0] -= 2.0 * (oy * w - oz * v)
                xdot[1] -= 2.0 * (oz * u - ox * w)
                xdot[2] -= 2.0 * (ox * v - oy * u)
                # Euler's equations in the inertial rates p + ox, ..., then the rates relative to the turning Earth.
                xdot[3] = (moments[0] + (Iyy - Izz) * (q + oy) * (r + oz)) / Ixx + q * oz - r * oy
                xdot[4] = (moments[1] + (Izz - Ixx) * (p + ox) * (r + oz)) / Iyy + r * ox - p * oz
                xdot[5] = (moments[2] + (Ixx - Iyy) * (p + ox) * (q + oy)) / Izz + p * oy - q * ox
            if "curvature" in self.beyond:
                turn_north = (u * e0 + v * e1 + w * e2) / _RADIUS_EAST
                turn_east = -(u * n0 + v * n1 + w * n2) / _RADIUS_NORTH
                p -= n0 * turn_north + e0 * turn_east
                q -= n1 * turn_north + e1 * turn_east
                r -= n2 * turn_north + e2 * turn_east
        xdot[6] = p + (q * sp + r * cp) * st / ct
        xdot[7] = q * cp - r * sp
        xdot[8] = (q * sp + r * cp) / ct

    def trim(self, V_m_s: float) -> tuple[FloatArray, float]:
        """Return the state (n,) and the throttle of steady, straight, level flight; residual below 1e-11 SI."""
        n = self.modes
        pitch_rate = -V_m_s / _RADIUS_NORTH if "curvature" in self.beyond else 0.0  # that of the horizon, heading north

        def state(z: FloatArray) -> FloatArray:
            x = np.zeros(13 + 2 * n)
            x[4] = pitch_rate
            x[[0, 2, 7, 9, 10]] = V_m_s * math.cos(z[0]), V_m_s * math.sin(z[0]), z[0], self.height, z[1]
            x[13 : 13 + n] = z[3:]
            return x

        def residual(z: FloatArray) -> FloatArray:
            x = state(z)
            xdot = self.rate(x, x[10:13].tolist(), z[2])
            return np.concatenate([xdot[[0, 2, 4]], xdot[13 + n :] / self.omega**2])

        found = root(residual, np.concatenate([[0.05, 0.0, 0.3], np.zeros(n)]), tol=1e-13)
        if not np.max(np.abs(residual(found.x))) < 1e-11:
            raise ArithmeticError(f"the reference finds no trim at {V_m_s:g} m/s: {found.message}")
        return state(found.x), float(found.x[2])

    def jacobian(self, x: FloatArray, throttle: float) -> FloatArray:
        """Return A (n, n) of xdot = A x about a trimmed state, by fourth-order central differences."""
        A = np.empty((x.size, x.size))
        commands = x[10:13].tolist()
        for j, name in enumerate(self.states):
            step = np.zeros(x.size)
            step[j] = {"u": 0.02, "v": 0.02, "w": 0.02, "h": 10.0}.get(name, 1e-3)
            f = [self.rate(x + s * step, commands, throttle) for s in (-2, -1, 1, 2)]
            A[:, j] = (f[0] - 8.0 * f[1] + 8.0 * f[2] - f[3]) / (12.0 * step[j])
        return A

    def poles(self, V_m_s: float) -> NDArray[np.complex128]:
        """Return the eigenvalues (rad/s) about trim, heading left out."""
        A = self.jacobian(*self.trim(V_m_s))
        kept = [i for i, name in enumerate(self.states) if name != "psi"]
        return np.linalg.eigvals(A[np.ix_(kept, kept)]).astype(np.complex128)

    def fly(self, V_m_s: float, t_s: FloatArray, deviations: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return every state (k,) at the frame times ``t_s`` (k,), starting from trim at ``t_s[0]``.

        Args:
            V_m_s: trimmed airspeed.
            t_s: (k,) frame times.
            deviations: control -> (k,) deviation of the command from trim at the frames, linear between them.

        DOP853 with rtol 1e-9, restarted at every corner of a command.
        """
        x, throttle = self.trim(V_m_s)
        u = np.array([x[10 + i] + deviations.get(name, np.zeros(t_s.size)) for i, name in enumerate(SURFACES)]).T
        slopes = np.diff(u, axis=0) / np.diff(t_s)[:, None]
        corners = np.flatnonzero(np.any(np.abs(np.diff(slopes, axis=0)) > 1e-9, axis=1)) + 1
        breaks = [0, *corners.tolist(), t_s.size - 1]
        atol = np.full(x.size, 1e-11)
        out = np.empty((t_s.size, x.size))
        out[0] = x
        for begin, end in pairwise(breaks):
            base, slope, start = u[begin].tolist(), slopes[begin].tolist(), float(t_s[begin])

            def rhs(t: float, y: FloatArray, base: Any = base, slope: Any = slope, start: float = start) -> FloatArray:
                return self.rate(y, [b + s * (t - start) for b, s in zip(base, slope, strict=True)], throttle)

            inside = t_s[begin + 1 : end + 1]
            span, first = (start, float(t_s[end])), float(t_s[begin + 1] - start)
            at = inside if inside.size > 1 else None
            solution = solve_ivp(rhs, span, out[begin], "DOP853", at, rtol=1e-9, atol=atol, first_step=first)
            if not solution.success:
                raise ArithmeticError(f"the reference stops at t = {solution.t[-1]:g} s: {solution.message}")
            out[begin + 1 : end + 1] = solution.y.T if inside.size > 1 else solution.y[:, -1:].T
        return dict(zip(self.states, out.T, strict=True))

    def lift_slope(self, V_m_s: float) -> float:
        """Return the lift slope per rad of the flexible aircraft, its modes residualised, at the trimmed density.

        CL_alpha + CL_eta K^-1 G C_Q,alpha, with K = diag(w^2) - G C_Q,eta and G = qbar S cbar / modal mass.
        """
        gain = 0.5 * self.rho * V_m_s**2 * self.S * self.c / self.modal_mass
        K = np.diag(self.omega**2) - gain[:, None] * self.eta
        static = np.linalg.solve(K, gain * self.forces[:, 1])
        return self.rigid["CL"]["alpha"] + float(self.effects["CL"][0] @ static)


def read_reference(folder: Path, height_m: float, beyond: Iterable[str] = ()) -> Reference:
    """Read an aircraft from its XML and TOML files, for flight at one height.

    Raises:
        ValueError: the XML uses a unit, an Ixz or a coefficient that these equations do not know.
    """
    described = tomllib.loads((folder / "aircraft.toml").read_text(encoding="utf-8"))
    tree = ET.parse(folder / described["model"]).getroot()
    if _quantity(tree, "mass_balance/ixz", "KG*M2") != 0.0:
        raise ValueError("Ixz = 0 must hold for the reference equations")
    rigid: dict[str, dict[str, float]] = {name: {} for name in ("CL", "CY", "Cl", "Cm", "Cn", "CD")}
    polar = (0.0, 0.0, 0.0, 0.0)
    for function in tree.iter("function"):
        _, found, name = (function.get("name") or "").partition("aero/coefficient/")
        if not found:
            continue
        values = [float(e.text or "nan") for e in function.iter("value")]
        if name == "CD":
            cd0, k, cl0, cl_alpha, power = values
            if power != 2.0:
                raise ValueError(f"the drag polar must be a parabola, got the power {power:g}")
            polar = (cd0, k, cl0, cl_alpha)
        elif len(values) == 1 and name[:2] in rigid:
            rigid[name[:2]][name[2:].removeprefix("_")] = values[0]
        else:
            raise ValueError(f"coefficient '{name}' is unknown to the reference equations")
    modes = described.get("elastic", {}).get("mode", [])
    order = ("zero", *_MOTIONS[1:])
    n = len(modes)
    return Reference(
        mass=_quantity(tree, "mass_balance/emptywt", "KG"),
        inertia=(
            _quantity(tree, "mass_balance/ixx", "KG*M2"),
            _quantity(tree, "mass_balance/iyy", "KG*M2"),
            _quantity(tree, "mass_balance/izz", "KG*M2"),
        ),
        S=_quantity(tree, "metrics/wingarea", "M2"),
        b=_quantity(tree, "metrics/wingspan", "M"),
        c=_quantity(tree, "metrics/chord", "M"),
        rigid=rigid,
        polar=polar,
        thrust=_thrust(tree, folder),
        servos={name: _servo(tree, long_name) for name, long_name in SURFACES.items()},
        forces=np.array([[m.get("force", {}).get(k, 0.0) for k in order] for m in modes]).reshape(n, len(order)),
        eta=_matrix(modes, "force_eta"),
        etadot=_matrix(modes, "force_etadot"),
        effects={
            name: (
                np.array([m.get("effect_eta", {}).get(name, 0.0) for m in modes]),
                np.array([m.get("effect_etadot", {}).get(name, 0.0) for m in modes]),
            )
            for name in rigid
        },
        omega=np.array([2.0 * math.pi * m["f_hz"] for m in modes]),
        zeta=np.array([m["zeta"] for m in modes]),
        modal_mass=np.array([m["mass_kg_m2"] for m in modes]),
        g=normal_gravity(height_m),
        rho=standard_density(height_m),
        height=height_m,
        beyond=frozenset(beyond),
    )


def _east_and_north_in_body(phi: float, theta: float, psi: float) -> tuple[tuple[float, float], ...]:
    """Return the body x, y and z components of the unit vectors (east, north)."""
    sp, cp, st, ct = math.sin(phi), math.cos(phi), math.sin(theta), math.cos(theta)
    ss, cs = math.sin(psi), math.cos(psi)
    return (
        (ct * ss, ct * cs),
        (sp * st * ss + cp * cs, sp * st * cs - cp * ss),
        (cp * st * ss - sp * cs, cp * st * cs + sp * ss),
    )


def with_rigid_wings(aircraft: Reference) -> Reference:
    """Return the aircraft with no elastic modes."""
    none, square = np.zeros(0), np.zeros((0, 0))
    return replace(
        aircraft, forces=np.zeros((0, 9)), eta=square, etadot=square, omega=none, zeta=none, modal_mass=none, effects={}
    )


def _quantity(tree: ET.Element, path: str, unit: str) -> float:
    element = tree.find(path)
    if element is None or element.get("unit") != unit:
        raise ValueError(f"<{path}> must be in {unit}")
    return float(element.text or "nan")


def _servo(tree: ET.Element, name: str) -> Servo:
    values = {e.text: float(e.get("value") or "nan") for e in tree.findall("flight_control/property")}
    return Servo(values[f"fcs/{name}-lag-rad_sec"], values[f"fcs/{name}-rate-limit-rad_sec"])


def _thrust(tree: ET.Element, folder: Path) -> Callable[[float, float], float]:
    engine = tree.find("propulsion/engine")
    law = tree.find(".//fcs_function[@name='fcs/thrust-fraction']")
    power = ET.parse(folder / "Engines" / f"{engine.get('file')}.xml").find("power") if engine is not None else None
    if law is None or power is None or power.get("unit") != "WATTS":
        raise ValueError("thrust must be that of an electric engine with a function 'fcs/thrust-fraction'")
    nominal = float(power.text or "nan") * _WATTS_TO_FT_LBF_S * _POUND_FORCE
    share = _expression(law.findall("function/*")[-1])
    low, high = (float(law.findtext(f"clipto/{end}") or limit) for end, limit in (("min", "-inf"), ("max", "inf")))
    return lambda throttle, V: nominal * min(max(share(throttle, V / _FOOT), low), high)


def _expression(element: ET.Element) -> Callable[[float, float], float]:
    """Return a JSBSim expression as a function of throttle and airspeed in ft/s."""
    text = (element.text or "").strip()
    if element.tag == "value":
        value = float(text)
        return lambda thr, V: value
    if element.tag == "property" and text in ("fcs/throttle-cmd-norm", "velocities/vt-fps"):
        return (lambda thr, V: thr) if text.startswith("fcs") else (lambda thr, V: V)
    join: dict[str, Callable[[list[float]], float]] = {
        "product": math.prod,
        "sum": sum,
        "difference": lambda terms: terms[0] - sum(terms[1:]),
        "max": max,
        "min": min,
    }
    if element.tag not in join:
        raise ValueError(f"the thrust law must be made of {', '.join(join)}, got <{element.tag}>{text}")
    operation, parts = join[element.tag], [_expression(child) for child in element]
    return lambda thr, V: operation([part(thr, V) for part in parts])


def _matrix(modes: Sequence[Mapping[str, Any]], key: str) -> FloatArray:
    out = np.zeros((len(modes), len(modes)))
    for i, mode in enumerate(modes):
        for j, value in mode.get(key, {}).items():
            out[i, int(j) - 1] = value
    return out
