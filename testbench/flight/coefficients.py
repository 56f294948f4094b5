"""The aerodynamic coefficients of any model by perturbation: what its forces and moments do when one thing changes.

At trim, time standing still, angles, rates and deflections are moved one by one, and the aerodynamic forces and moments
about the centre of gravity are read from JSBSim. The rate of the angle of attack cannot be set: it follows from the
accelerations. So attitude is moved as well, which changes that rate alone, and the derivatives are the solution of

    C(j) = C(0) + sum over k of C_k x_k(j),        j = 1 ... number of changes,

by least squares, with x_k(j) as read.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.reactions import reacts
from testbench.core.constants import COEFFICIENTS, FT_M
from testbench.core.errors import TrimError
from testbench.core.record import FloatArray
from testbench.flight.condition import FlightCondition, TrimmedFlight
from testbench.flight.executive import Executive, velocity_at
from testbench.flight.trim import horizon_rates, place_at_trim, trim

_FORCES = ("forces/fwz-aero-lbs", "forces/fwx-aero-lbs", "forces/fwy-aero-lbs")
_MOMENTS = ("moments/l-aero-lbsft", "moments/m-aero-lbsft", "moments/n-aero-lbsft")
_ADDED_FORCES = ("forces/fbx-external-lbs", "forces/fby-external-lbs", "forces/fbz-external-lbs")
_ADDED_MOMENTS = ("moments/l-external-lbsft", "moments/m-external-lbsft", "moments/n-external-lbsft")
_VARIABLES = ("alpha", "beta", "p", "q", "r", "de", "da", "dr", "alphadot")
_STEPS = {"alpha": 2e-3, "beta": 2e-3, "p": 1e-2, "q": 1e-2, "r": 1e-2, "de": 2e-3, "da": 2e-3, "dr": 2e-3}
_ATTITUDE = 1.0  # rad
_ALPHADOT = "aero/alphadot-rad_sec"


def coefficients(aircraft: Aircraft, trimmed: TrimmedFlight) -> dict[str, float]:
    """Return the coefficients of a model at trim: CL, CD, ... themselves, and their derivatives CL_alpha to Cn_dr.

    CL0, CD0, ... are what is left of them when every derivative times its variable is taken away.

    Derivatives are per rad of angles and deflections, and per nondimensional rate: p b/2V, q cbar/2V, r b/2V and
    alphadot cbar/2V. Those of lift, drag and pitching moment by lateral motions, and the others by longitudinal ones,
    are included; a symmetric aircraft has none. What the model does not have is zero. Reactions that were
    written into the model by an amendment belong to its coefficients.

    Args:
        aircraft: its elastic modes take their static deflection.
        trimmed: a condition of it.
    """
    bench = _Bench(aircraft, trimmed)
    x0, y0 = bench.at({})
    rows, values = [], []
    names = [n for n in _STEPS if n not in ("de", "da", "dr") or n in aircraft.controls]
    for name in names:
        (x1, y1), (x2, y2) = bench.at({name: _STEPS[name]}), bench.at({name: -_STEPS[name]})
        rows.append((x1 - x2) / (2.0 * _STEPS[name]))
        values.append((y1 - y2) / (2.0 * _STEPS[name]))
    # Gravity turns alpha by g cos(gamma) / V: a small change of attitude in level flight would not be felt.
    x1, y1 = bench.at({"theta": _ATTITUDE})
    rows.append(x1 - x0)
    values.append(y1 - y0)
    X, Y = np.array(rows), np.array(values)
    used = np.flatnonzero(np.abs(X).max(axis=0) > 1e-12)
    found = np.linalg.lstsq(X[:, used], Y, rcond=None)[0]
    out = {c: float(v) for c, v in zip(COEFFICIENTS, y0, strict=True)}
    still = y0 - x0[used] @ found
    out |= {f"{c}0": float(v) for c, v in zip(COEFFICIENTS, still, strict=True)}
    for k, row in zip(used, found, strict=True):
        out |= {f"{c}_{_VARIABLES[k]}": float(v) + 0.0 for c, v in zip(COEFFICIENTS, row, strict=True)}
    return out


class _Bench:
    """A model held at trim."""

    def __init__(self, aircraft: Aircraft, trimmed: TrimmedFlight) -> None:
        self._fdm, self._trimmed = Executive(aircraft, trimmed.rate_hz, trimmed.condition), trimmed
        self._geometry = aircraft.geometry
        self._added = reacts(aircraft.xml)
        place_at_trim(self._fdm, trimmed)

    def at(self, change: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """Return the nondimensional variables (9,) and the six coefficients (6,) with something changed."""
        t, fdm, g = self._trimmed, self._fdm, self._geometry
        V = t.condition.V_m_s
        alpha, beta = t.alpha + change.get("alpha", 0.0), t.beta + change.get("beta", 0.0)
        uvw = velocity_at(V, alpha, beta)
        rates = horizon_rates(t.condition.h_m, t.theta, t.phi, velocity_at(V, t.alpha), fdm.wind_m_s)
        rates = rates + np.array([change.get(n, 0.0) for n in ("p", "q", "r")])
        fdm.command({n: v + change.get(n, 0.0) for n, v in t.controls.items()})
        fdm.place(t.condition.h_m, t.theta + change.get("theta", 0.0), t.phi, uvw, rates)
        fdm.evaluate(to_rest=True, held=True)
        qS = fdm.get("aero/qbar-psf") * fdm.get("metrics/Sw-sqft")
        forces = np.array([fdm.get(n) for n in _FORCES])  # lift and drag as such, JSBSim turns their signs
        lengths = np.array([g.b_m, g.cbar_m, g.b_m]) / FT_M
        moments = np.array([fdm.get(n) for n in _MOMENTS])
        if self._added:
            forces = forces + _lift_drag_side([fdm.get(n) for n in _ADDED_FORCES], alpha, beta)
            moments = moments + np.array([fdm.get(n) for n in _ADDED_MOMENTS])
        forces, moments = forces / qS, moments / (qS * lengths)
        per_span, per_chord = g.b_m / (2.0 * V), g.cbar_m / (2.0 * V)
        p, q, r = (fdm.get(f"velocities/{n}-aero-rad_sec") for n in "pqr")
        alphadot = fdm.get(_ALPHADOT) if self._uses_alphadot else 0.0
        surfaces = [fdm.read().get(n, 0.0) for n in ("de", "da", "dr")]
        x = [alpha, beta, p * per_span, q * per_chord, r * per_span, *surfaces, alphadot * per_chord]
        return np.array(x), np.concatenate([forces, moments])

    @cached_property
    def _uses_alphadot(self) -> bool:
        return self._fdm.reads(_ALPHADOT)


def _lift_drag_side(body: Sequence[float], alpha: float, beta: float) -> FloatArray:
    """Return lift, drag and side force of a force in body axes."""
    x, y, z = body
    forward, side = np.cos(alpha) * x + np.sin(alpha) * z, y
    return np.array(
        [
            np.sin(alpha) * x - np.cos(alpha) * z,
            -np.cos(beta) * forward - np.sin(beta) * side,
            -np.sin(beta) * forward + np.cos(beta) * side,
        ]
    )


@dataclass(frozen=True, eq=False)
class Perturbed(Mapping[str, float]):
    """The coefficients of an aircraft at its design condition, found when they are first asked for."""

    aircraft: Aircraft  # as loaded, without amendments
    _found: dict[str, float] = field(default_factory=dict)

    def _all(self) -> dict[str, float]:
        if not self._found:
            condition = FlightCondition(self.aircraft.design_V_m_s, self.aircraft.design_h_m)
            self._found.update(coefficients(self.aircraft, trim(self.aircraft, condition)))
        return self._found

    def __getitem__(self, name: str) -> float:
        try:
            return self._all()[name]
        except TrimError as error:
            raise KeyError(f"{name}: {error.message}") from error

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())


def in_air(
    force: FloatArray, moment: FloatArray, alpha: FloatArray, beta: FloatArray, qS: FloatArray, lengths: FloatArray
) -> FloatArray:
    """Return the six coefficients (n, 6), of COEFFICIENTS, that forces and moments are.

    Args:
        force: (n, 3) N, body axes; lift, drag and side force are along the air's.
        moment: (n, 3) N m, body axes.
        alpha: (n,) angle of attack, rad.
        beta: (n,) sideslip, rad.
        qS: (n,) dynamic pressure times the wing's area, N.
        lengths: span, chord, span, m.
    """
    x, y, z = force.T
    along, lift = np.cos(alpha) * x + np.sin(alpha) * z, np.sin(alpha) * x - np.cos(alpha) * z
    drag, side = -(np.cos(beta) * along + np.sin(beta) * y), np.cos(beta) * y - np.sin(beta) * along
    return np.column_stack([lift / qS, drag / qS, side / qS, moment / (qS[:, None] * lengths)])
