"""Elastic modes as coupled linear modal states: their equations, and the JSBSim functions that integrate them.

Equations of motion of mode i (M. R. Waszak, D. K. Schmidt, "Flight dynamics of aeroelastic vehicles", J. Aircraft
25(6), 1988, eq. 31, with modal damping), generalised coordinates without unit:

    mass_i (eta_i'' + 2 zeta_i w_i eta_i' + w_i^2 eta_i) = qbar S cbar C_Qi
    C_Qi = zero + alpha alpha + q q cbar/2V + ... + sum_j (eta_ij eta_j + etadot_ij eta_j' cbar/2V)

and each mode adds ``effect`` to the force and moment coefficients of the aircraft.

Inside JSBSim the states step by the exact first-order hold x+ = Ad x + B0 v + B1 v+ of the coupled equations at the
dynamic pressure that the model was generated for; what another dynamic pressure changes in the aerodynamic stiffness
and damping enters as an input, extrapolated by one frame. A force that swings at w runs in an arc and not along the
chord between two frames, and a hold of the chord loses (w dt)^2 / 12 of it, 1.2 % at 30 Hz and 500 frames per second.
Therefore the hold takes the force u less a twelfth of its second difference, v+ = u+ - (u+ - 2 u + u-) / 12 and
v = u - (u+ - 2 u + u-) / 12, which has the mean of the parabola through the last three frames (the Adams-Moulton rule
of third order, E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, section III.1).

The functions stand directly under ``<aerodynamics>``, where alpha, rates, qbar and deflections are already those of the
new frame, and before the axis functions, so that the lift of a frame uses the deflection of that frame. While time
stands still (trim, initial conditions) the modes take their static deflection, or hold what was set in ``modal/eta-i``
and ``modal/etadot-i`` when ``modal/static-ic`` is 0.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import block_diag, expm

from testbench.aircraft.adapter import SURFACES, Adapter
from testbench.aircraft.paths import path_of, read_by_aerodynamics
from testbench.aircraft.reactions import COEFFICIENTS, MOTIONS, element, number, quantity, react
from testbench.core.constants import PSF_PA
from testbench.core.escape import quoted, toml_value
from testbench.core.record import FloatArray

LAGS = ((0.165, 0.0455), (0.335, 0.3))
UNSTEADY = 0.1
"""Reduced frequency w cbar/2V beyond which air is taken to lag."""


@dataclass(frozen=True)
class WingShape:
    """A mode shape at the stations of its model, per unit of eta, on the right wing."""

    bend_m: tuple[float, ...]  # displacement of the elastic axis, up
    twist_rad: tuple[float, ...]  # nose up
    # second derivative of ``bend_m`` along the span; strain is minus this times the height above the neutral axis
    curvature_1_m: tuple[float, ...]


@dataclass(frozen=True)
class ElasticMode:
    """One mode and its aerodynamic coupling; all coefficients without unit, per unit of eta, rad or rate.

    ``force_rotary`` is the part of ``force_etadot`` that does not hang on the wake (wake.py).
    """

    name: str
    f_hz: float
    zeta: float
    mass_kg_m2: float
    symmetry: str
    force: Mapping[str, float] = field(default_factory=dict)
    force_eta: Mapping[int, float] = field(default_factory=dict)
    force_etadot: Mapping[int, float] = field(default_factory=dict)
    effect_eta: Mapping[str, float] = field(default_factory=dict)
    effect_etadot: Mapping[str, float] = field(default_factory=dict)
    shape: WingShape | None = None
    force_rotary: Mapping[int, float] = field(default_factory=dict)

    @property
    def omega_rad_s(self) -> float:
        """Natural frequency in vacuo, rad/s."""
        return 2.0 * np.pi * self.f_hz


@dataclass(frozen=True)
class ElasticModel:
    """The modes of an aircraft, numbered from 1 in this order everywhere, and its reference area and chord.

    ``stations_m`` are the distances y from the centre line, along the right wing, at which mode shapes are given.
    """

    modes: tuple[ElasticMode, ...]
    S_m2: float
    cbar_m: float
    stations_m: tuple[float, ...] = ()

    def __len__(self) -> int:
        return len(self.modes)

    def toml(self, number: Callable[[float], str] = repr, comments: Sequence[str] = ()) -> str:
        """Return the table ``[elastic]`` of aircraft.toml.

        Args:
            number: writes what is computed; stations, frequency and damping are written whole.
            comments: one per mode, or none: lines that stand above it, each beginning with "#".
        """
        keys = ("force", "force_eta", "force_etadot", "force_rotary", "effect_eta", "effect_etadot")
        out = [f"[elastic]\nstations_m = [{', '.join(f'{y:.10g}' for y in self.stations_m)}]\n"]
        for mode, said in zip(self.modes, comments or ("",) * len(self), strict=True):
            block = f"{said}[[elastic.mode]]\nname = {quoted(mode.name)}\nf_hz = {mode.f_hz}\nzeta = {mode.zeta}\n"
            block += f'mass_kg_m2 = {number(float(mode.mass_kg_m2))}\nsymmetry = "{mode.symmetry}"\n'
            tables = {key: getattr(mode, key) for key in keys} | {"shape": vars(mode.shape) if mode.shape else {}}
            out.append(block + "".join(f"{key} = {toml_value(t, number)}\n" for key, t in tables.items() if t))
        return "\n".join(out)

    def matrices(self, qbar_Pa: float, V_m_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return (K, D, G) of eta'' = -K eta - D eta' + G C_rigid at one condition.

        K (n, n) in 1/s2 and D (n, n) in 1/s hold structure and aerodynamics; G (n,) in 1/s2 takes the part of C_Q due
        to the rigid motion to the modal acceleration.
        """
        n = len(self)
        gain = qbar_Pa * self.S_m2 * self.cbar_m / np.array([m.mass_kg_m2 for m in self.modes])
        K = np.diag([m.omega_rad_s**2 for m in self.modes])
        D = np.diag([2.0 * m.zeta * m.omega_rad_s for m in self.modes])
        for i, mode in enumerate(self.modes):
            for j, c in mode.force_eta.items():
                K[i, j - 1] -= gain[i] * c
            for j, c in mode.force_etadot.items():
                D[i, j - 1] -= gain[i] * c * self.cbar_m / (2.0 * V_m_s)
        return K.reshape(n, n), D.reshape(n, n), gain

    def blocks(self) -> list[list[int]]:
        """Return groups of mode indices (from 0) that couple with each other; groups do not couple among themselves."""
        n = len(self)
        group = list(range(n))
        for i, mode in enumerate(self.modes):
            for j in (*mode.force_eta, *mode.force_etadot):
                a, b = group[i], group[j - 1]
                group = [min(a, b) if g in (a, b) else g for g in group]
        return [[i for i in range(n) if group[i] == g] for g in sorted(set(group))]


def first_order_hold(A: FloatArray, B: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return Ad, B0, B1 of the exact step x+ = Ad x + B0 u + B1 u+ for inputs that run linearly between samples.

    Source: the augmented matrix exponential of G. F. Franklin, J. D. Powell, M. Workman, Digital Control of Dynamic
    Systems, 3rd ed., section 6.3.2 (triangle hold).
    """
    n, m = B.shape
    M = block_diag(A, np.zeros((2 * m, 2 * m)))
    M[:n, n : n + m] = B
    M[n : n + m, n + m :] = np.eye(m) / dt_s
    E = expm(M * dt_s)
    B1 = E[:n, n + m :]
    return E[:n, :n], E[:n, n : n + m] - B1, B1


def _product(*factors: ET.Element | float | str) -> ET.Element:
    whole = element("product", *factors)
    return whole[0] if len(whole) == 1 else whole


def _sum(*terms: ET.Element | str) -> ET.Element:
    whole = element("sum", *terms)
    return whole if len(whole) > 1 else whole[0] if len(whole) else number(0.0)


def _weighted(weights: FloatArray, names: Sequence[str]) -> list[ET.Element]:
    return [_product(float(w), name) for w, name in zip(weights, names, strict=True) if w != 0.0]


def _function(name: str, body: ET.Element, copyto: str | None = None) -> ET.Element:
    return element("function", body, name=name, **({"copyto": copyto} if copyto else {}))


def _kept(what: str, value: str, where: str) -> ET.Element:
    """Return the function that keeps a value for what comes after."""
    return _function(f"modal/commit-{what}", quantity(f"modal/{value}"), f"modal/{where}")


def add_modes(
    tree: ET.Element, elastic: ElasticModel, dt_s: float, qbar_Pa: float, V_m_s: float, adapter: Adapter | None = None
) -> None:
    """Write the modal states and their coupling into a JSBSim model, in place.

    Args:
        tree: the ``fdm_config`` element of the rigid aircraft, amendments included.
        elastic: the modes.
        dt_s: frame time for which the coefficients are made; the model flies at this rate only.
        qbar_Pa: dynamic pressure for which the exact step is made.
        V_m_s: true airspeed for which it is made.
        adapter: of a foreign model.
    """
    K, D, _ = elastic.matrices(qbar_Pa, V_m_s)
    numbers = range(1, len(elastic) + 1)
    declared = {"modal/static-ic": "1.0", "modal/dt-s": repr(float(dt_s))}
    for i in numbers:
        for name in ("eta", "etadot", "extra", "extra-previous", "input-previous", "input-before"):
            declared[f"modal/{name}-{i}"] = "0.0"
    properties = (element("property", text=name, value=value) for name, value in declared.items())
    aerodynamics = tree.find("aerodynamics")
    assert aerodynamics is not None
    tree.insert(list(tree).index(aerodynamics), element("system", *properties, name="elastic modes"))

    paths = [path for path in (path_of(adapter, control) for control in SURFACES) if path is not None]
    motions = MOTIONS | {path.control: (read_by_aerodynamics(tree, path),) for path in paths}
    functions: list[ET.Element] = [_rigid_force(elastic, i, motions) for i in numbers]
    functions += [
        _function(f"modal/input-{i}", _sum(f"modal/force-{i}", _product(2.0, f"modal/extra-{i}"),
                                           _product(-1.0, f"modal/extra-previous-{i}")))
        for i in numbers
    ]  # fmt: skip
    functions += [f for i in numbers for f in _held(i)]
    for block in elastic.blocks():
        functions += _block_step(K[np.ix_(block, block)], D[np.ix_(block, block)], [i + 1 for i in block], dt_s)
    for i in numbers:  # commits come after all new values, so that every row used the old states
        functions += [_kept(f"{state}-{i}", f"new-{state}-{i}", f"{state}-{i}") for state in ("eta", "etadot")]
    functions += [_kept(f"extra-{i}", f"extra-{i}", f"extra-previous-{i}") for i in numbers]
    functions += [_extra_force(elastic, i, qbar_Pa, V_m_s) for i in numbers]
    for i in numbers:
        functions.append(_kept(f"before-{i}", f"input-previous-{i}", f"input-before-{i}"))
        both = _sum(f"modal/force-{i}", f"modal/extra-{i}")
        functions.append(_function(f"modal/commit-input-{i}", both, f"modal/input-previous-{i}"))
        functions.append(_acceleration(elastic, K, D, i))
    for position, function in enumerate(functions):
        aerodynamics.insert(position, function)
    _add_effects(tree, aerodynamics, elastic, adapter)


def _rigid_force(elastic: ElasticModel, i: int, motions: Mapping[str, tuple[str, ...]]) -> ET.Element:
    mode = elastic.modes[i - 1]
    gain = elastic.S_m2 * elastic.cbar_m * PSF_PA / mode.mass_kg_m2
    terms = [_product(c, *motions[motion]) for motion, c in mode.force.items() if c != 0.0]
    return _function(f"modal/force-{i}", element("product", "aero/qbar-psf", gain, _sum(*terms)))


def _held(i: int) -> list[ET.Element]:
    """Return the functions of the force that the hold takes at the end and at the beginning of a frame."""
    now, previous, before = f"modal/input-{i}", f"modal/input-previous-{i}", f"modal/input-before-{i}"
    weighted = _weighted(np.array([11.0, 2.0, -1.0]) / 12.0, [now, previous, before])
    begin = element("difference", _sum(f"modal/held-{i}", previous), now)
    return [_function(f"modal/held-{i}", _sum(*weighted)), _function(f"modal/held-previous-{i}", begin)]


def _block_step(K: FloatArray, D: FloatArray, numbers: list[int], dt_s: float) -> list[ET.Element]:
    """Return the functions that step one block of coupled modes, without committing the new values."""
    n = len(numbers)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-K, -D]])
    B = np.vstack([np.zeros((n, n)), np.eye(n)])
    Ad, B0, B1 = first_order_hold(A, B, dt_s)
    static = np.vstack([np.linalg.inv(K), np.zeros((n, n))])
    states = [f"modal/eta-{i}" for i in numbers] + [f"modal/etadot-{i}" for i in numbers]
    old, new = [f"modal/held-previous-{i}" for i in numbers], [f"modal/held-{i}" for i in numbers]
    at_rest = [f"modal/input-{i}" for i in numbers]
    out = []
    for row, state in enumerate(states):
        step = _sum(*_weighted(Ad[row], states), *_weighted(B0[row], old), *_weighted(B1[row], new))
        rest = element("ifthen", "modal/static-ic", _sum(*_weighted(static[row], at_rest)), state)
        body = element("ifthen", element("gt", "simulation/dt", 0.0), step, rest)
        out.append(_function(state.replace("modal/", "modal/new-"), body))
    return out


def _extra_force(elastic: ElasticModel, i: int, qbar_Pa: float, V_m_s: float) -> ET.Element:
    """Return the aerodynamic stiffness and damping beyond those of the condition that the exact step is made for."""
    mode = elastic.modes[i - 1]
    gain = elastic.S_m2 * elastic.cbar_m / mode.mass_kg_m2
    now, then = "aero/qbar-psf", qbar_Pa / PSF_PA
    parts: list[ET.Element] = []
    for state, table, here, there in (
        ("eta", mode.force_eta, quantity(now), then),
        ("etadot", mode.force_etadot, _product(now, "aero/ci2vel"), then * elastic.cbar_m / (2.0 * V_m_s)),
    ):
        if table:
            terms = [_product(gain * PSF_PA * c, f"modal/{state}-{j}") for j, c in table.items()]
            parts.append(element("product", element("difference", here, there), _sum(*terms)))
    return _function(f"modal/compute-extra-{i}", _sum(*parts), f"modal/extra-{i}")


def _acceleration(elastic: ElasticModel, K: FloatArray, D: FloatArray, i: int) -> ET.Element:
    numbers = range(1, len(elastic) + 1)
    terms = _weighted(-K[i - 1], [f"modal/eta-{j}" for j in numbers])
    terms += _weighted(-D[i - 1], [f"modal/etadot-{j}" for j in numbers])
    return _function(f"modal/etaddot-{i}", _sum(f"modal/force-{i}", f"modal/extra-{i}", *terms))


def _add_effects(tree: ET.Element, aerodynamics: ET.Element, elastic: ElasticModel, adapter: Adapter | None) -> None:
    for coefficient, (axis_name, length) in COEFFICIENTS.items():
        terms = []
        for i, mode in enumerate(elastic.modes, 1):
            if mode.effect_eta.get(coefficient):
                terms.append(_product(mode.effect_eta[coefficient], f"modal/eta-{i}"))
            if mode.effect_etadot.get(coefficient):
                terms.append(_product(mode.effect_etadot[coefficient], f"modal/etadot-{i}", "aero/ci2vel"))
        if adapter is not None and adapter.cg_in is not None:
            if terms:
                react(tree, coefficient, [_sum(*terms)], adapter.cg_in)
            continue
        axis = next((a for a in aerodynamics.findall("axis") if a.get("name") == axis_name), None)
        if not terms or axis is None:
            continue
        factors = ("aero/qbar-psf", "metrics/Sw-sqft", *([length] if length else []))
        axis.append(_function(f"modal/effect-{coefficient}", element("product", *factors, _sum(*terms))))


# --- air that lags ----------------------------------------------------------------------------------------------------


def reduced_frequency(elastic: ElasticModel, number: int, V_m_s: float) -> float:
    """Return w cbar/2V of a mode's natural frequency."""
    return elastic.modes[number - 1].omega_rad_s * elastic.cbar_m / (2.0 * V_m_s)


def with_wake(
    A: FloatArray, states: Sequence[str], elastic: ElasticModel, qbar_Pa: float, V_m_s: float, share: float = 1.0
) -> FloatArray:
    """Return A (n + 2 m, n + 2 m) of a linear model with the wake of its m modes; their states come last.

    Args:
        A: (n, n) of the quasi-steady model.
        states: (n,) names; eta_i and etadot_i of the modes.
        elastic: the modes.
        qbar_Pa: dynamic pressure of the model.
        V_m_s: its airspeed.
        share: of the lag that there is: 0 leaves the poles of ``A`` as they are.
    """
    numbers = [int(s.removeprefix("etadot_")) for s in states if s.startswith("etadot_")]
    n, gain = len(states), elastic.matrices(qbar_Pa, V_m_s)[2]
    out = np.zeros((n + 2 * len(numbers),) * 2)
    out[:n, :n] = A
    for k, i in enumerate(numbers):
        mode, row = elastic.modes[i - 1], states.index(f"etadot_{i}")
        at_once = {f"eta_{i}": -(mode.omega_rad_s**2), f"etadot_{i}": -2.0 * mode.zeta * mode.omega_rad_s}
        for j, c in mode.force_rotary.items():
            name = f"etadot_{j}"
            at_once[name] = at_once.get(name, 0.0) + float(gain[i - 1]) * c * elastic.cbar_m / (2.0 * V_m_s)
        u = A[row].copy()
        for name, value in at_once.items():
            if name in states:
                u[states.index(name)] -= value
        for lag, (a, p) in enumerate(LAGS):
            y = n + 2 * k + lag
            out[row, :n] -= share * a * u
            out[row, y] = share * a
            rate = p * 2.0 * V_m_s / elastic.cbar_m
            out[y, :n], out[y, y] = rate * u, -rate
    return out
