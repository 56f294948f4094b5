"""The vocabulary that missing forces and moments are sought in: products and powers of motion and controls, lags, time.

A term is a product of factors, each of which is a quantity of the flight that JSBSim knows as well, so that whatever is
found can be added to the model (:mod:`testbench.questions.gap.open_set`). Quantities are without unit: angles in rad,
rates times b/2V or cbar/2V, the throttle from 0 to 1, the airspeed as its deviation from the
aircraft's design speed over that speed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np

from testbench.core.record import FloatArray
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.felt import Felt
from testbench.sensors.sensor import first_order_lag

CONTROLS = ("de", "da", "dr", "thr")
_LONGITUDINAL = ("alpha", "q", "alphadot", "V", "de", "thr")
_LATERAL = ("beta", "p", "r", "da", "dr")
_LAGS_S = (0.05, 0.1, 0.2, 0.4)
_CUBED = ("alpha", "beta", "de", "da", "dr")
TIME = "t"


@dataclass(frozen=True)
class Factor:
    """A quantity, or its modulus; of a control also what it was, less what it is, through a lag of ``lag_s``."""

    quantity: str
    modulus: bool = False
    lag_s: float = 0.0

    @property
    def label(self) -> str:
        """As in a formula."""
        if self.lag_s:
            return f"({self.quantity} lagged by {self.lag_s:g} s - {self.quantity})"
        return f"|{self.quantity}|" if self.modulus else self.quantity


@dataclass(frozen=True)
class Term:
    """A product of factors."""

    factors: tuple[Factor, ...]

    @property
    def label(self) -> str:
        """As in a formula, such as "alpha*thr", "beta^3", "|dr|"."""
        out = []
        for factor in dict.fromkeys(self.factors):
            power = self.factors.count(factor)
            out.append(factor.label if power == 1 else f"{factor.label}^{power}")
        return "*".join(out)

    @property
    def quantities(self) -> frozenset[str]:
        """What it depends on."""
        return frozenset(f.quantity for f in self.factors)


def vocabulary(lateral: bool, controls: frozenset[str]) -> tuple[Term, ...]:
    """Return the terms.

    Args:
        lateral: whether lateral motion was recorded.
        controls: those that the aircraft has and a record moves.
    """
    known = [n for n in (*_LONGITUDINAL, *(_LATERAL if lateral else ())) if n not in CONTROLS or n in controls]
    plain = {n: Factor(n) for n in known}
    size = {n: Factor(n, True) for n in known if n in _LATERAL}
    terms = [Term((plain[n],)) for n in known]
    terms += [Term((f,)) for f in size.values()]
    terms += [
        Term((plain[a], plain[b])) for a, b in combinations_with_replacement(known, 2) if "alphadot" not in (a, b)
    ]
    terms += [Term((plain[n], f)) for n, f in size.items()]
    terms += [Term((plain[n],) * 3) for n in known if n in _CUBED]
    terms += [Term((Factor(n, lag_s=lag),)) for n in known if n in CONTROLS for lag in _LAGS_S]
    return (*terms, Term((Factor(TIME),)))


def quantities(believed: Believed, felt: Felt) -> Mapping[str, FloatArray]:
    """Return quantity -> its values in every version (versions, n) of a motion; surfaces are those of the model."""
    state, geometry = felt.motion.state, believed.aircraft.geometry
    V = state["V"]
    out = {n: state[n] for n in ("alpha", "beta")}
    out |= {n: state[n] * geometry.b_m / (2.0 * V) for n in "pr"}
    out["q"] = state["q"] * geometry.cbar_m / (2.0 * V)
    u, w = V * np.cos(state["alpha"]), V * np.sin(state["alpha"])  # over cos(beta), which the ratio does not see
    rate = (u * state["wdot"] - w * state["udot"]) / (u * u + w * w)
    out["alphadot"] = rate * geometry.cbar_m / (2.0 * V)
    out["V"] = V / believed.aircraft.design_V_m_s - 1.0
    out |= {n: felt.surfaces[n] for n in CONTROLS if n in felt.surfaces}
    out[TIME] = np.broadcast_to(felt.motion.record.t_s - felt.motion.record.t_s[0], V.shape)
    return out


def columns(terms: tuple[Term, ...], known: Mapping[str, FloatArray], dt_s: float) -> FloatArray:
    """Return the terms' values (versions, n, terms) of quantities (versions, n), ``dt_s`` apart."""
    made: dict[Factor, FloatArray] = {}
    for factor in dict.fromkeys(f for t in terms for f in t.factors):
        x = known[factor.quantity]
        if factor.lag_s:
            made[factor] = np.stack([first_order_lag(each, dt_s, factor.lag_s) - each for each in x])
        else:
            made[factor] = np.abs(x) if factor.modulus else x
    return np.stack([np.prod([made[f] for f in t.factors], axis=0) for t in terms], axis=-1)
