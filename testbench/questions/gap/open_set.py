"""The open set: a term that forces and moments follow, as an effect that no library holds.

Regression proposes (:mod:`testbench.questions.gap.evidence.stepwise`), the flown likelihood confirms: every term, and
what may stand in its place, becomes an effect of one size, is added to the JSBSim model through the coefficient seam,
and is fitted, compared and refuted by the rules that hold for the library.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from testbench.aircraft import Aircraft, Amendment, Increment, Memory
from testbench.aircraft.amend import Change
from testbench.aircraft.reactions import MOTIONS
from testbench.aircraft.reroute import product, prop, value
from testbench.core.blas import on_one_thread
from testbench.core.constants import FT_M
from testbench.core.errors import ModelError, Refusal
from testbench.core.record import FlightRecord
from testbench.core.words import with_error
from testbench.effects import left_out
from testbench.effects.aerodynamics import followed
from testbench.effects.base import Effect, Parameter, Values
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.felt import Felt, felt
from testbench.questions.gap.evidence.stepwise import (
    CONTROLS,
    COPIES,
    TIME,
    Factor,
    FoundTerm,
    Regression,
    Term,
    regress,
)
from testbench.sensors import SensorSuite

PLACES = {
    "CL": "lift",
    "CD": "drag",
    "CY": "side force",
    "Cl": "rolling moment",
    "Cm": "pitching moment",
    "Cn": "yawing moment",
}
_WORDS = {
    "alpha": "angle of attack",
    "beta": "sideslip",
    "p": "roll rate",
    "q": "pitch rate",
    "r": "yaw rate",
    "alphadot": "alpha-dot",
    "V": "airspeed",
    "de": "elevator",
    "da": "aileron",
    "dr": "rudder",
    "thr": "throttle",
    TIME: "time",
}
_MISTAKEN = {
    "thr": "thrust, its line, or the wash of the propeller",
    "de": "the elevator's effectiveness, linkage or servo",
    "da": "the aileron's effectiveness, linkage or servo",
    "dr": "the rudder's effectiveness, linkage or servo",
    "alpha": "a vane whose scale bends",
    "beta": "a vane whose scale bends",
    "V": "an airspeed that is off",
    "p": "a damper or a gyro that is off",
    "q": "a damper or a gyro that is off",
    "r": "a damper or a gyro that is off",
    "alphadot": "downwash that comes late, or a damper",
    TIME: "fuel that burns, a battery that empties or a sensor that drifts",
}
_MORE = 3.0  # the flown size may be so many times what regression says
_TOLD = 3  # terms in a sentence
_INSTEAD = 2  # terms in the place of each that are fitted beside it


@dataclass(frozen=True, eq=False)
class FirstLook:
    """What forces and moments say before anything is flown.

    Attributes:
        flights: coefficients felt in each record that is named from; none if they cannot be computed.
        found: what they follow, or None.
        why_not: why they cannot be computed, "" if they are.
    """

    flights: tuple[Felt, ...] = ()
    found: Regression | None = None
    why_not: str = ""

    @property
    def terms(self) -> tuple[FoundTerm, ...]:
        """What they follow, the surest first."""
        return () if self.found is None else self.found.terms

    @property
    def sentences(self) -> tuple[str, ...]:
        """That in words."""
        if self.found is None:
            return (f"forces and moments were not looked at: {self.why_not}",) if self.why_not else ()
        if not self.terms:
            tried = f"{self.found.tried} terms of motion, controls and time"
            return (f"forces and moments at every sample follow none of {tried}",)
        told = "; ".join(told_of(f) for f in self.terms[:_TOLD])
        if len(self.terms) > _TOLD:
            told += f"; and {len(self.terms) - _TOLD} less sure ones"
        return (f"forces and moments at every sample, before anything is flown, follow {told}",)


@on_one_thread
def first_look(believed: Believed, records: Mapping[str, FlightRecord]) -> FirstLook:
    """Return what forces and moments of records say of the believed model; nothing is flown for that.

    Args:
        believed: aircraft, sensors and condition as believed.
        records: name -> measured record, all with V, alpha, q and theta.

    Example:
        >>> import testbench as tb
        >>> first = tb.first_look(believed, {"doublet": record, "sweep": other})  # doctest: +SKIP
        >>> first.flights[0].felt, first.flights[0].std  # (n, coefficients), standard errors  # doctest: +SKIP
        >>> first.sentences  # doctest: +SKIP
    """
    try:
        flights = felt(believed, records, COPIES)
        if len({f.coefficients for f in flights}) > 1:
            return FirstLook((), None, "not all records hold the same channels")
        return FirstLook(tuple(flights), regress(believed, flights))
    except Refusal as error:
        return FirstLook((), None, error.message)


def told_of(found: FoundTerm) -> str:
    """Return a term in words, with its size and what may stand in its place."""
    size = with_error(found.size, found.error)
    out = f"{title_of(found.coefficient, found.term)} ({found.coefficient} {size} per {found.term.label})"
    if found.instead:
        labels = [t.label for t, _ in found.instead]
        more = f" and {len(labels) - 4} more" if len(labels) > 4 else ""
        out += f", or {', '.join(labels[:4])}{more} in its place: these flights do not tell them apart"
    return out


def title_of(coefficient: str, term: Term) -> str:
    """Return "a rolling moment that grows with throttle", and its like."""
    factors = list(dict.fromkeys(term.factors))
    said = []
    for f in factors:
        word = _WORDS[f.quantity]
        word = f"the size of {word}" if f.modulus else word
        word = f"{word} as it lags by {f.lag_s:g} s" if f.lag_s else word
        power = term.factors.count(f)
        said.append(word if power == 1 else f"the {'square' if power == 2 else 'cube'} of {word}")
    place = PLACES[coefficient]
    if coefficient == "CD" and "thr" in term.quantities:
        place = "drag (or lack of thrust)"  # along the path the two are one force
    return f"a {place} that grows with {' times '.join(said)}"


def effect_of(coefficient: str, term: Term, size: float) -> Effect:
    """Return a term of a coefficient as an effect whose fit starts from ``size``."""
    most = _MORE * abs(size)
    return Effect(
        name=f"{coefficient} by {term.label}",
        title=title_of(coefficient, term),
        place=PLACES[coefficient],
        physics="No effect of the library does this. Forces and moments follow it at every sample of the records.",
        parameters=(Parameter("size", "1", -most, most, (size,), none=0.0),),
        amend=partial(_amend, coefficient, term),
        mistaken_for=" or ".join(dict.fromkeys(_MISTAKEN[f.quantity] for f in term.factors)),
        separated_by=f"flights in which {', '.join(_WORDS[q] for q in sorted(term.quantities))} moves by itself",
        flown=True,
        lateral=coefficient in ("CY", "Cl", "Cn"),
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
    """Return the XML of a quantity, or of its modulus, as JSBSim has it.

    Raises:
        ModelError: the aircraft has no such control.
    """
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


def proposals(first: FirstLook, believed: Believed) -> dict[str, Effect]:
    """Return the effects that a first look proposes: each term, and what may stand in its place."""
    out: dict[str, Effect] = {}
    for found in first.terms:
        for term, size in ((found.term, found.size), *found.instead[:_INSTEAD]):
            effect = effect_of(found.coefficient, term, size)
            out.setdefault(effect.name, effect)
    known = left_out(out, believed.aircraft, believed.suite)
    return {n: e for n, e in out.items() if n not in known}
