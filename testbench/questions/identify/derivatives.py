"""The derivatives found: values with errors, what they were before, coefficients, and whether to believe them.

What an aircraft's model said before the flight: its derivatives at the trim of the records, and its servos.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.adapter import SURFACES
from testbench.core.advice import ranked
from testbench.core.constants import DEG_RAD, WHITE
from testbench.core.errors import Refusal
from testbench.core.record import FloatArray
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.structured import Servo, per_speed
from testbench.evaluation.coefficients import Scaling, coefficient
from testbench.evaluation.derivatives import Derivative, dimensional_derivatives, true_parameters
from testbench.flight import FlightCondition, linearise, trim
from testbench.inference.form import BY_INPUT
from testbench.inference.reflown import Reflown
from testbench.line import Case
from testbench.questions.identify.flown import FlownCondition
from testbench.questions.identify.scenario import SimulatedErrors

# --- what an aircraft's model said before the flight ------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Before:
    """An aircraft at the condition that the records were flown at."""

    aircraft: Aircraft  # the model
    condition: FlightCondition  # airspeed and height of the records, which the model was trimmed at
    qbar_Pa: float  # dynamic pressure of the records
    derivatives: tuple[Derivative, ...] = ()  # of the model there; empty if it cannot be trimmed there
    notes: tuple[str, ...] = ()  # what was assumed, in sentences


def before(aircraft: Aircraft, flown: FlownCondition) -> Before:
    """Return what the model said of the condition of the records.

    Where airspeed or height are not known they are those of the aircraft's design condition.
    """
    V, h, qbar, notes = flown.V_m_s, flown.h_m, flown.qbar_Pa, []
    if V is None:
        V = aircraft.design_V_m_s
        notes.append(f"the records have no airspeed: {aircraft.name} is assumed at its design speed of {V:g} m/s")
    if h is None:
        h = aircraft.design_h_m
        notes.append(f"the records have no height: {aircraft.name} is taken at {h:g} m")
    condition = FlightCondition(V, h)
    qbar = condition.qbar_Pa if qbar is None else qbar
    try:
        trimmed = trim(aircraft, condition)
        found = tuple(dimensional_derivatives(linearise(aircraft, trimmed), trimmed))
    except Refusal as error:
        found = ()
        notes.append(
            f"what {aircraft.name} said before is not known: it does not trim at {V:.3g} m/s, {h:.4g} m ({error})"
        )
    return Before(aircraft, condition, qbar, found, tuple(notes))


def servos_of(aircraft: Aircraft, inputs: Sequence[str]) -> dict[str, Servo]:
    """Return the servos of an aircraft before the surfaces whose commands are inputs."""
    out = {}
    for name in inputs:
        control = name.removesuffix("_cmd")
        if not name.endswith("_cmd") or control not in SURFACES:
            continue
        if aircraft.adapter is None:
            lag, limit = (
                _declared(aircraft.xml, f"fcs/{SURFACES[control]}-{what}-rad_sec") for what in ("lag", "rate-limit")
            )
        else:
            link = aircraft.adapter.link(control)
            lag, limit = (link.lag_rad_s, link.rate_limit_rad_s) if link is not None else (None, None)
        if lag:
            out[name] = Servo(lag_s=1.0 / lag, rate_limit_deg_s=limit / DEG_RAD if limit else None)
    return out


def _declared(xml: str, name: str) -> float | None:
    found = re.search(rf'<property\s+value="([^"]+)"\s*>\s*{re.escape(name)}\s*</property>', xml)
    return float(found.group(1)) if found else None


# --- the derivatives found --------------------------------------------------------------------------------------------


class BeliefCriteria(NamedTuple):
    """What a derivative must be to be believed; judged."""

    weak: float = 0.5  # standard error relative to the value from which the data say little of it
    together: float = 0.98  # correlation from which two estimates stand for one another
    coloured: float = 1.5  # factor by which coloured residuals raise an error from which it is in doubt
    # factor by which they raise the error of some derivative of a fit from which all of its are in doubt, if they are
    # those of more than one output: what moves the states moves all outputs, while the colour of one alone is that of
    # its sensor, and touches the derivatives whose errors it raises
    turbulent: float = 2.0
    changed: float = 3.0  # errors between the value before and the one found from which they are told to differ


CRITERIA = BeliefCriteria()
_OF_RESIDUALS = ("in doubt", "weak")  # what a derivative is by its stated error, and by what its residuals hold


@dataclass(frozen=True)
class FoundDerivative:
    """One derivative of one model."""

    case: int  # index of the model's case
    name: str  # symbol
    # value, std: estimate and standard error
    value: float
    std: float
    stated: float  # standard error that the estimator states; smaller than ``std`` where simulated flights show more
    unit: str  # SI; "" if there is none or it is not known
    before: float | None  # what it was before the flight; None if nobody said
    source: str  # who said so: the aircraft's name, "start" or ""
    # name, value and standard error of the nondimensional coefficient; None if not known
    coefficient: tuple[str, float, float] | None
    # "determined", or why not: "weak", "at bound", "correlated with NAME", "in doubt", "not converged", "replaced" by a
    # model that fits better
    believed: str
    # mean error, scatter and share of 95 % intervals that hold, in flights of what was found; None without
    again: tuple[float, float, float] | None = None
    flown: bool = False  # whether its error is that of simulated flights, which holds what the residuals do

    @property
    def determined(self) -> bool:
        """Whether the data decide it."""
        return self.believed == "determined"

    @property
    def simulated(self) -> bool:
        """Whether ``std`` is what simulated flights show, in place of what the estimator states."""
        return self.std != self.stated

    @property
    def changed(self) -> bool:
        """Whether it differs from what it was before by more than its error explains."""
        if self.before is None or not self.determined:
            return False
        return abs(self.value - self.before) > CRITERIA.changed * self.std


def found_derivatives(
    cases: Sequence[Case],
    known: Before | None,
    scaling: Scaling | None,
    simulated: SimulatedErrors | None = None,
    replaced: Collection[int] = (),
    flights: Mapping[int, Reflown] | None = None,
) -> tuple[FoundDerivative, ...]:
    """Return every free parameter of every model with a structure, but for constants.

    Args:
        cases: of one description.
        known: the aircraft before; None without one.
        scaling: what coefficients are made with; None if that is not known.
        simulated: standard errors that simulated flights show; they count where they are larger, and alone where the
            flights hold what the form of the model hides.
        replaced: cases whose fit another one mends.
        flights: case -> what flights of its model are identified as: errors are widened to what they show.
    """
    out = []
    errors = {} if simulated is None else simulated.errors
    for i, case in enumerate(cases):
        model = case.model
        if not isinstance(model, ParametricModel):
            continue
        whole = simulated is not None and simulated.flights > 0 and not by_input(model)
        names = [p.name for p in model.structure.parameters if p.free]
        beliefs = dict.fromkeys(names, "replaced") if i in replaced else _beliefs(model, names)
        units = {d.name: d.unit for d in known.derivatives} if known else {}
        told = true_parameters(model.structure.meaning, known.derivatives, known.condition.V_m_s) if known else {}
        start: Mapping[str, float] = getattr(case.estimator, "start", {})
        for name in names:
            if name.endswith("_0"):
                continue
            before = told.get(name, start.get(name))
            value, stated = model.values[name], model.standard_errors[name]
            again, added = _again((flights or {}).get(i), name)
            std, belief = max(float(np.sqrt(stated**2 + added)), errors.get(name, 0.0)), beliefs[name]
            if whole and name in errors:
                std, belief = errors[name], "determined" if belief in _OF_RESIDUALS else belief
            scaled = coefficient(model, name, scaling) if scaling else None
            source = known.aircraft.name if known and name in told else "start" if name in start else ""
            out.append(
                FoundDerivative(
                    i,
                    name,
                    value,
                    std,
                    stated,
                    _unit(name, model.structure.meaning) or units.get(name, ""),
                    before,
                    source,
                    scaled and (scaled[0], scaled[1], scaled[2] * std / stated if stated > 0.0 else scaled[2]),
                    "weak" if belief == "determined" and std > CRITERIA.weak * abs(value) else belief,
                    again,
                    whole and name in errors,
                )
            )
    return tuple(out)


def covariance_of(derivatives: Sequence[FoundDerivative], index: int, model: ParametricModel) -> FloatArray:
    """Return the covariance (k, k) of the parameters of a case, with the errors that simulated flights show.

    What these add to the stated ones is independent: nobody says that it goes as the stated ones do.
    """
    own = {d.name: d for d in derivatives if d.case == index and d.simulated and d.stated > 0.0}
    names = model.structure.parameter_names
    less = np.array([min(own[n].std / own[n].stated, 1.0) if n in own else 1.0 for n in names])
    more = np.array([max(own[n].std ** 2 - own[n].stated ** 2, 0.0) if n in own else 0.0 for n in names])
    return np.asarray(less[:, None] * model.covariance * less + np.diag(more))


def by_input(model: ParametricModel) -> bool:
    """Return whether residuals go with the inputs, as those of a servo that is another than believed."""
    return any(a.code in BY_INPUT and a.severity != "note" for a in ranked(model.advice))


def _again(flights: Reflown | None, name: str) -> tuple[tuple[float, float, float] | None, float]:
    """Return mean error, scatter and share of intervals that hold of a parameter, and the variance they add."""
    if flights is None:
        return None, 0.0
    k = flights.names.index(name)
    return (float(flights.bias[k]), float(flights.scatter[k]), float(flights.held[k])), float(flights.added[k])


def _beliefs(model: ParametricModel, names: Sequence[str]) -> dict[str, str]:
    """Return name -> whether the data decide it, and if not why."""
    found = model.diagnostics
    correlation = np.abs(np.asarray(found["correlation"]))
    if len(correlation) == len(model.structure.parameters):
        correlation = correlation[np.ix_(model.structure.free, model.structure.free)]
    inflated = np.asarray(found.get("error_inflation", np.ones(len(names))))
    formed = bool(found.get("formed"))  # errors hold what colours residuals
    turbulent = float(np.max(inflated, initial=1.0)) > CRITERIA.turbulent and _coloured_throughout(model)
    spoilt = model.status == "wrong" or (turbulent and not formed)
    out = {}
    for i, name in enumerate(names):
        value, error = model.values[name], model.standard_errors[name]
        others = np.where(np.arange(len(names)) == i, 0.0, correlation[i, : len(names)])
        partner = int(np.argmax(others)) if len(names) > 1 else i
        if not found.get("converged", True):
            out[name] = "not converged"
        elif name in found.get("at_bound", ()):
            out[name] = "at bound"
        elif error > CRITERIA.weak * abs(value):
            out[name] = "weak"
        elif others[partner] > CRITERIA.together:
            out[name] = f"correlated with {names[partner]}"
        elif spoilt or (inflated[i] > CRITERIA.coloured and not formed):
            out[name] = "in doubt"
        else:
            out[name] = "determined"
    return out


def _coloured_throughout(model: ParametricModel) -> bool:
    """Return whether the residuals of more than one output, or of the only one, are not white."""
    chances = np.atleast_1d(np.asarray(model.diagnostics.get("whiteness_p", 0.0), float))
    return int(np.sum(chances < WHITE)) > 1 or bool(np.all(chances < WHITE))


def _unit(name: str, structure: str) -> str:
    """Return the unit of what no aircraft has: times of servos, and derivatives per speed."""
    if name.startswith(("tau_", "T_")):
        return "s"
    if structure == "lateral_per_speed" and name == "g_V":
        return "1/s"
    axis, _, variable = name.partition("_")
    if per_speed(structure, axis):
        return "" if variable in ("q", "r") else "1/s"
    return _PLAIN.get((name[0] in "LMN", variable), "")


_PLAIN = {
    (moment, variable): unit
    for moment, by in (
        (True, {"V": "1/(m s)", "alpha": "1/s²", "beta": "1/s²", "p": "1/s", "q": "1/s", "r": "1/s"}),
        (False, {"V": "1/s", "alpha": "m/s²", "beta": "m/s²", "p": "m/s", "q": "m/s", "r": "m/s"}),
    )
    for variable, unit in {**by, **dict.fromkeys(("de", "da", "dr", "thr"), by["alpha"])}.items()
}
"""(moment or force, by what) -> unit of a dimensional derivative, angles in rad."""


def scaling_of(flown: FlownCondition, known: Before | None) -> Scaling | None:
    """Return what coefficients are made with; the design condition of the aircraft stands in for what is not known."""
    V = known.condition.V_m_s if flown.V_m_s is None and known else flown.V_m_s
    qbar = known.qbar_Pa if flown.qbar_Pa is None and known else flown.qbar_Pa
    if V is None or qbar is None or flown.geometry is None:
        return None
    return Scaling(V, qbar, flown.geometry, flown.mass)
