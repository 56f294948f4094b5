"""The open set: terms of motion, controls and time that missing forces and moments may follow.

Every term of a vocabulary, in each coefficient, is a hypothesis of one size. What it would change in the readings is
the response of the aircraft, linear about trim, to the force or moment that it makes along the flight of the re-tuned
model: the column of a score test (C. R. Rao, 1948). All are weighed to first order beside coefficients within their
priors and an unknown motion of every size (:mod:`testbench.inference.first_order`); the most probable are added to
the JSBSim model through the coefficient seam, flown, and compared with all that the library holds.

A term is a product of factors, each of which is a quantity of the flight that JSBSim knows as well. Quantities are
without unit: angles in rad, rates times b/2V or cbar/2V, the throttle from 0 to 1, the airspeed as its deviation from
the aircraft's design speed over that speed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations_with_replacement

import numpy as np
from scipy.ndimage import gaussian_filter1d

from testbench.aircraft import Aircraft, Amendment, Increment, Memory
from testbench.aircraft.amend import Change
from testbench.aircraft.reactions import MOTIONS
from testbench.aircraft.seams import product, prop, value
from testbench.core.constants import FT_M
from testbench.core.errors import ModelError
from testbench.core.record import FlightRecord, FloatArray
from testbench.effects.aerodynamics import followed
from testbench.effects.base import SIZE, Effect, Parameter, Values
from testbench.effects.servo import CONTROLS, WORDS
from testbench.inference.first_order import FirstOrder
from testbench.inference.unknown import forced, rms_acceleration
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.search.point import Point
from testbench.sensors import SensorSuite
from testbench.sensors.sensor import first_order_lag

TIME = "t"
PLACES = {
    "CL": "lift",
    "CD": "drag",
    "CY": "side force",
    "Cl": "rolling moment",
    "Cm": "pitching moment",
    "Cn": "yawing moment",
}
_LATERAL_COEFFICIENTS = ("CY", "Cl", "Cn")
_WORDS = {
    **WORDS,
    "alpha": "angle of attack",
    "beta": "sideslip",
    "p": "roll rate",
    "q": "pitch rate",
    "r": "yaw rate",
    "alphadot": "alpha-dot",
    "V": "airspeed",
    TIME: "time",
}
_MISTAKEN = {
    **{c: f"the {word}'s effectiveness, linkage or servo" for c, word in WORDS.items()},
    "thr": "thrust, its line, or the wash of the propeller",
    **dict.fromkeys(("alpha", "beta"), "a vane whose scale bends"),
    "V": "an airspeed error",
    **dict.fromkeys(("p", "q", "r"), "a damper or a gyro error"),
    "alphadot": "a lag of the downwash, or a damper",
    TIME: "fuel that burns, a battery that empties or a sensor that drifts",
}
_LONGITUDINAL = ("alpha", "q", "alphadot", "V", "de", "thr")
_LATERAL = ("beta", "p", "r", "da", "dr")
_CUBED = ("alpha", "beta", "de", "da", "dr")
_LAGS_S = (0.05, 0.1, 0.2, 0.4)
_SEEN_BY = {"CL": "w", "CD": "u", "CY": "v", "Cl": "p", "Cm": "q", "Cn": "r"}
"""Coefficient -> the state whose acceleration tells how large the motion is that it moves."""
_MOTION = ("V", "alpha", "beta", "p", "q", "r")
_SMOOTH_S = 0.05  # standard deviation of Gauss's filter
_READ_AT_ONCE = {"ax": "u", "ay": "v", "az": "w"}
_MORE = 3.0  # the flown size may be so many times what the first look says


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

    @property
    def words(self) -> str:
        """In words."""
        word = f"the size of {_WORDS[self.quantity]}" if self.modulus else _WORDS[self.quantity]
        return f"{word} as it lags by {self.lag_s:g} s" if self.lag_s else word


@dataclass(frozen=True)
class Term:
    """A product of factors."""

    factors: tuple[Factor, ...]

    @property
    def label(self) -> str:
        """As in a formula, such as "alpha*thr", "beta^3", "|dr|"."""
        counted = {f: self.factors.count(f) for f in self.factors}
        return "*".join(f.label if n == 1 else f"{f.label}^{n}" for f, n in counted.items())

    @property
    def words(self) -> str:
        """In words, such as "throttle times the square of rudder"."""
        counted = {f: self.factors.count(f) for f in self.factors}
        power = {1: "", 2: "the square of ", 3: "the cube of "}
        return " times ".join(f"{power[n]}{f.words}" for f, n in counted.items())

    @property
    def quantities(self) -> frozenset[str]:
        """What it depends on."""
        return frozenset(f.quantity for f in self.factors)


@dataclass(frozen=True)
class OpenTerm:
    """A term of a coefficient with what records say of it to first order."""

    coefficient: str  #: which
    term: Term  #: which
    size: float  #: most probable multiple of the term that is added to the coefficient
    usual: float  #: prior standard deviation of that: as large an acceleration as there is in the motion
    log: float  #: ln p of the records with it, to first order
    gain: float  #: ``log`` less that without any term

    @property
    def name(self) -> str:
        """As in "Cl by thr"."""
        return f"{self.coefficient} by {self.term.label}"

    @property
    def effect(self) -> Effect:
        """The term as an effect whose fit begins at ``size``."""
        return effect_of(self.coefficient, self.term, _MORE * abs(self.size), self.usual / SIZE)


def vocabulary(lateral: bool, controls: frozenset[str]) -> tuple[Term, ...]:
    """Return the terms of motion, of lateral motion if that was recorded, and of controls that a record moves."""
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


def along(believed: Believed, record: FlightRecord) -> dict[str, FloatArray]:
    """Return quantity -> its values at trim and then along the flight of a record, (1 + n,)."""
    there, flown = believed.at(record), believed.flown(record)
    state, geometry = there.trimmed.state, there.aircraft.geometry
    surfaces = [n for n in CONTROLS if n in flown and n in state]
    moved = {n: _seen(record, n, flown[n]) for n in _MOTION} | {n: flown[n] for n in surfaces}
    out = {n: np.concatenate([[state[n]], x]) for n, x in moved.items()}
    out["alphadot"] = np.concatenate([[0.0], np.gradient(moved["alpha"], flown.dt_s)])
    span, chord = geometry.b_m, geometry.cbar_m
    for name, length in (("p", span), ("r", span), ("q", chord), ("alphadot", chord)):
        out[name] = out[name] * length / (2.0 * out["V"])
    out["V"] = out["V"] / there.aircraft.design_V_m_s - 1.0
    return out | {TIME: np.concatenate([[0.0], flown.t_s - flown.t_s[0]])}


def _seen(record: FlightRecord, name: str, flown: FloatArray) -> FloatArray:
    """Return a quantity (n,) as it was measured, smoothed, about the mean of a flight, or of that if it was not read.

    Along the motion that was measured, forces that the model lacks are exact but for noise.
    """
    valid = record.valid[:, record.channels.index(name)] if name in record else np.zeros(len(record), bool)
    if not valid.any():
        return flown
    read = np.interp(record.t_s, record.t_s[valid], record[name][valid])
    smooth = gaussian_filter1d(read, max(_SMOOTH_S / record.dt_s, 1e-3), mode="nearest")
    return np.asarray(smooth + np.mean(flown - smooth))


def increments(terms: tuple[Term, ...], known: Mapping[str, FloatArray], dt_s: float) -> FloatArray:
    """Return the terms' values (n, terms), less those at trim, of quantities (1 + n,), ``dt_s`` apart.

    What a term adds at trim, the trim of the aircraft that has it balances.
    """
    made: dict[Factor, FloatArray] = {}
    for factor in dict.fromkeys(f for t in terms for f in t.factors):
        x = known[factor.quantity]
        if factor.lag_s:
            made[factor] = np.concatenate([[0.0], first_order_lag(x[1:], dt_s, factor.lag_s) - x[1:]])
        else:
            made[factor] = np.abs(x) if factor.modulus else x
    out = np.stack([np.prod([made[f] for f in t.factors], axis=0) for t in terms], axis=-1)
    return out[1:] - out[0]


def accelerations(there: Believed, coefficient: str) -> dict[str, float]:
    """Return state -> how fast one unit of a coefficient changes it at trim, SI; of axes of the body, and of the path.

    ``there`` is believed at the start in question, see :meth:`.Believed.at`.
    """
    trim, mass, geometry, V = there.trimmed, there.aircraft.mass, there.aircraft.geometry, there.condition.V_m_s
    force = there.condition.qbar_Pa * geometry.S_m2
    cos, sin = np.cos(trim.alpha), np.sin(trim.alpha)
    along = {"CL": (sin, 0.0, -cos), "CD": (-cos, 0.0, -sin), "CY": (0.0, 1.0, 0.0)}
    about = {"Cl": (geometry.b_m, 0.0, 0.0), "Cm": (0.0, geometry.cbar_m, 0.0), "Cn": (0.0, 0.0, geometry.b_m)}
    inertia = np.array([[mass.Ixx, 0.0, mass.Ixz], [0.0, mass.Iyy, 0.0], [mass.Ixz, 0.0, mass.Izz]])
    none = (0.0, 0.0, 0.0)
    u, v, w = force / mass.mass_kg * np.array(along.get(coefficient, none))
    p, q, r = np.linalg.solve(inertia, force * np.array(about.get(coefficient, none)))
    path = {"V": u * cos + w * sin, "alpha": (w * cos - u * sin) / V, "beta": v / V}
    return {"u": u, "v": v, "w": w, "p": p, "q": q, "r": r, **path}


def response(believed: Believed, record: FlightRecord, coefficient: str, more: FloatArray) -> FloatArray:
    """Return what increments of a coefficient (n, h) do to the compared channels, SI, (n, p, h).

    The aircraft is linear about the trim that the record was flown from; sensors read at once, at the centre of
    gravity.
    """
    there = believed.at(record)
    rates = accelerations(there, coefficient)
    push = np.array([rates.get(s, 0.0) for s in there.linear.states])
    read = np.array([rates[_READ_AT_ONCE[c]] if c in _READ_AT_ONCE else 0.0 for c in believed.outputs])
    return forced(there.linear, believed.outputs, push, read, more, record.dt_s)


def rank_terms(point: Point, weigh: Callable[[FloatArray], Sequence[FirstOrder]]) -> tuple[tuple[OpenTerm, ...], int]:
    """Return the terms that records can show, the most probable to first order first, and how many were weighed.

    Args:
        point: the re-tuned model, along whose flights the terms are evaluated.
        weigh: columns (samples, h) -> what records say of h hypotheses, the prior standard deviation of whose
            multiples is 1, about one point or several.
    """
    tuned = point.model.with_nuisances(point.by_name).beginning(point.starts)
    known = [along(tuned, r) for r in point.records]
    moved = frozenset(n for n in CONTROLS if all(n in k for k in known) and any(np.ptp(k[n]) > 0.0 for k in known))
    terms = vocabulary(point.lateral, moved)
    forcing = [increments(terms, k, r.dt_s) for k, r in zip(known, point.records, strict=True)]
    mean_square = np.concatenate(forcing).var(axis=0)
    out, tried = [], 0
    for coefficient in PLACES:
        if coefficient in _LATERAL_COEFFICIENTS and not point.lateral:
            continue
        shown = [
            i
            for i, t in enumerate(terms)
            if mean_square[i] > 0.0 and f"{coefficient}_{t.label}" not in point.priors  # of which the prior decides
        ]
        # As large an acceleration as there is in the motion of any record: an unknown motion of size 1.
        state = _SEEN_BY[coefficient]
        flown = [(r, point.believed.at(r)) for r in point.records]
        units = [abs(accelerations(there, coefficient)[state]) for _, there in flown]
        rms = [rms_acceleration(state, there.condition.V_m_s, r) for r, there in flown]
        usual = max(a / unit for a, unit in zip(rms, units, strict=True)) / np.sqrt(mean_square[shown])
        columns = []
        for record, x in zip(point.records, forcing, strict=True):
            changes = response(point.believed, record, coefficient, x[:, shown] * usual)
            each = [point.believed.in_noise_units(record, changes[:, :, k]).ravel() for k in range(len(shown))]
            columns.append(np.stack(each, axis=1))
        found = weigh(np.concatenate(columns))
        tried += len(shown)
        logs = np.concatenate([f.logs[:, :, 0] for f in found])
        sizes = np.concatenate([f.multiples[:, :, 0] for f in found]) * usual
        best, alone = np.argmax(logs, axis=0), max(float(np.max(f.alone)) for f in found)
        for k, i in enumerate(shown):
            log, size = float(logs[best[k], k]), float(sizes[best[k], k])
            out.append(OpenTerm(coefficient, terms[i], size, usual[k], log, log - alone))
    return tuple(sorted(out, key=lambda t: -t.log)), tried


def title_of(coefficient: str, term: Term) -> str:
    """Return "a rolling moment that grows with throttle", and its like."""
    place = PLACES[coefficient]
    if coefficient == "CD" and "thr" in term.quantities:
        place = "drag (or lack of thrust)"  # along the path the two are one force
    return f"a {place} that grows with {term.words}"


def effect_of(coefficient: str, term: Term, most: float, usual: float) -> Effect:
    """Return a term of a coefficient as an effect whose size is ``most`` at most, and ``usual`` or so."""
    return Effect(
        name=f"{coefficient} by {term.label}",
        title=title_of(coefficient, term),
        place=PLACES[coefficient],
        physics="No effect of the library has this form.",
        parameters=(Parameter("size", "1", -most, most, (usual,), none=0.0),),
        amend=partial(_amend, coefficient, term),
        mistaken_for=" or ".join(dict.fromkeys(_MISTAKEN[f.quantity] for f in term.factors)),
        separated_by=f"flights in which {', '.join(_WORDS[q] for q in sorted(term.quantities))} moves independently",
        lateral=coefficient in _LATERAL_COEFFICIENTS,
    )


def _amend(
    coefficient: str, term: Term, aircraft: Aircraft, suite: SensorSuite, values: Values
) -> tuple[Aircraft, SensorSuite]:
    label = re.sub(r"\W+", "-", f"{coefficient}-{term.label.replace('|', 'abs')}").strip("-").lower()
    edits: tuple[Change, ...] = ()
    memories: tuple[Memory, ...] = ()
    terms = [value(values["size"])]
    for i, factor in enumerate(term.factors):
        quantity = _quantity(aircraft, factor)
        if factor.lag_s:
            own = f"{label}-{i}"
            more, memory = followed(own, quantity, factor.lag_s, aircraft.rate_hz)
            edits, memories = (*edits, *more), (*memories, memory)
            quantity = f"<difference> {prop(f'gap/{own}')} {quantity} </difference>"
        terms.append(quantity)
    text = f"{title_of(coefficient, term)}: {values['size']:+.3g} {term.label} in {coefficient}"
    change = Increment(coefficient, f"gap/{label}", tuple(terms))
    return aircraft.amended(Amendment("open_term", text, (*edits, change), memories=memories)), suite


def _quantity(aircraft: Aircraft, factor: Factor) -> str:
    """Return the XML of a quantity, or of its modulus, as JSBSim has it."""
    name = factor.quantity
    if name == TIME:
        term = prop("simulation/sim-time-sec")
    elif name == "V":
        relative = product(prop("velocities/vt-fps"), value(FT_M / aircraft.design_V_m_s))
        term = f"<difference> {relative} {value(1.0)} </difference>"
    elif name in CONTROLS:
        source, scale = aircraft.source_of(name)
        if source is None:
            raise ModelError(f"{aircraft.name} has no {_WORDS[name]}")
        term = prop(source) if scale == 1.0 else product(value(scale), prop(source))
    else:
        parts = [prop(n) for n in MOTIONS[name]]
        term = parts[0] if len(parts) == 1 else product(*parts)
    return f"<abs> {term} </abs>" if factor.modulus else term
