"""Which model's derivatives are written into the aircraft, and which of them are left as they were.

Of several models the one is taken that predicts the records best that it has not seen. Of its derivatives those are
written that the data tell from what they were. One after the other the least of them is held at what it was, until all
that remain differ by three of their errors or more, each time with the others as the data give them with these held:

    x_w - P_wl P_ll^-1 (x_l - before_l),    P_ww - P_wl P_ll^-1 P_lw,    P the covariance, w written, l held.

So a derivative that is known only together with another is not written for that other's sake.

Increments of coefficients by which a linearised aircraft has the derivatives that were identified.

Chord iteration on what JSBSim's linearised model has, with the slopes of a rigid aircraft in still air,

    dX = -qbar S/m dCD,  dZ = -qbar S/m dCL,  dM = qbar S cbar/Iyy dCm,  dY = qbar S/m dCY,
    [Ixx J; J Izz] [dL; dN] = qbar S b [dCl; dCn],

times cbar/2V or b/2V by rates. What alphadot, elastic modes or a reference point of the aerodynamics away from the
centre of gravity add is what the iteration is for. Of each variable all three forces and moments are aimed at, so that
those not asked for stay as they were. Increments vanish at the trim, which does not move.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.adapter import PREFIX, declare
from testbench.aircraft.amend import AddCoefficient, Change
from testbench.aircraft.seams import with_servo
from testbench.core.advice import ranked
from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.structured import STRUCTURE_NAMES, Structured, per_speed
from testbench.evaluation.derivatives import dimensional_derivatives, true_parameters
from testbench.flight import FlightCondition, TrimmedFlight, linearise, trim
from testbench.line import Case
from testbench.page.words import grouped
from testbench.questions.identify.amend.result import Aim, ServoAim, Targets
from testbench.questions.identify.derivatives import CRITERIA, FoundDerivative, covariance_of, servos_of
from testbench.questions.identify.result import Identified
from testbench.questions.run.labels import case_names

# --- increments of coefficients by which a linearised aircraft has the derivatives that were identified ---------------


_LONGITUDINAL = {"X": "CD", "Z": "CL", "M": "Cm"}
_LATERAL = {"Y": "CY", "L": "Cl", "N": "Cn"}
_VARIABLES = {**dict.fromkeys(("alpha", "q", "de"), _LONGITUDINAL)}
_VARIABLES |= dict.fromkeys(("beta", "p", "r", "da", "dr"), _LATERAL)
REACHED_BY: Mapping[tuple[str, str], str] = {
    (axis, variable): f"{coefficient}_{variable}"
    for variable, axes in _VARIABLES.items()
    for axis, coefficient in axes.items()
}
"""(force or moment, variable) -> coefficient whose increment moves that derivative."""
_RATES = ("p", "q", "r")
_MOST, _ENOUGH = 25, 1e-8


def derivatives_of(aircraft: Aircraft, trimmed: TrimmedFlight, structure: str) -> dict[str, float]:
    """Return what the parameters of a structure are of an aircraft at a trim."""
    found = dimensional_derivatives(linearise(aircraft, trimmed), trimmed)
    return true_parameters(structure, found, trimmed.condition.V_m_s)


def reached(
    aircraft: Aircraft, condition: FlightCondition, structure: str, targets: Targets
) -> tuple[Aircraft, dict[str, float]]:
    """Return the aircraft whose linearised model has the targets, and coefficient -> what was added to it.

    Args:
        aircraft: as believed.
        condition: that the derivatives hold at.
        structure: whose parameters they are.
        targets: parameter -> value.

    Raises:
        TrimError: there is no trim.
        ModelError: the model cannot take an increment.
    """
    trimmed = trim(aircraft, condition)
    before = derivatives_of(aircraft, trimmed, structure)
    variables = list(dict.fromkeys(name.partition("_")[2] for name in targets))
    names = [f"{axis}_{v}" for v in variables for axis in _VARIABLES[v]]
    aim = np.array([targets.get(n, before[n]) for n in names])
    slopes = np.zeros((len(names), len(names)))
    for k, variable in enumerate(variables):
        slopes[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = _slopes(aircraft, condition, structure, variable)
    # A number is as good as the differences that it is found by, which are as good as the largest of its kind.
    size = np.maximum(np.abs(aim), np.abs([before[n] for n in names]))
    size = np.maximum(size, 1e-3 * np.abs(slopes).max(axis=1))
    total, best, least = np.zeros(len(names)), np.zeros(len(names)), np.inf
    now = np.array([before[n] for n in names])
    for _ in range(_MOST):
        error = aim - now
        worst = float(np.max(np.abs(error) / size))
        if worst >= least:
            break
        best, least = total, worst
        if worst <= _ENOUGH:
            break
        total = total + np.linalg.solve(slopes, error)
        found = derivatives_of(with_increments(aircraft, _named(names, total), trimmed), trimmed, structure)
        now = np.array([found[n] for n in names])
    wanted = {
        name: value
        for (name, value), slope in zip(_named(names, best).items(), np.abs(slopes).max(axis=0), strict=True)
        if abs(value) * slope > 1e-7 * float(size.max())
    }
    return with_increments(aircraft, wanted, trimmed), wanted


def _named(names: Sequence[str], values: FloatArray) -> dict[str, float]:
    keys = [REACHED_BY[axis, v] for axis, v in (n.split("_") for n in names)]
    return dict(zip(keys, values.tolist(), strict=True))


def _slopes(aircraft: Aircraft, condition: FlightCondition, structure: str, variable: str) -> FloatArray:
    """Return (3, 3): derivatives by one variable per coefficient by it."""
    g, m, V = aircraft.geometry, aircraft.mass, condition.V_m_s
    force = condition.qbar_Pa * g.S_m2
    by_mass = force / m.mass_kg

    def over(axis: str) -> float:
        return V if per_speed(structure, axis) else 1.0

    if _VARIABLES[variable] is _LONGITUDINAL:
        rate = g.cbar_m / (2.0 * V) if variable in _RATES else 1.0
        return rate * np.diag([-by_mass, -by_mass / over("Z"), force * g.cbar_m / m.Iyy])
    rate = g.b_m / (2.0 * V) if variable in _RATES else 1.0
    out = np.zeros((3, 3))
    out[0, 0] = by_mass / over("Y")
    out[1:, 1:] = force * g.b_m * np.linalg.inv(np.array([[m.Ixx, m.Ixz], [m.Ixz, m.Izz]]))
    return rate * out


def coefficient_errors(aircraft: Aircraft, condition: FlightCondition, structure: str) -> dict[str, float]:
    """Return derivative -> change of its coefficient per change of itself, the others of its variable held."""
    out: dict[str, float] = {}
    for variable, axes in _VARIABLES.items():
        inverse = np.linalg.inv(_slopes(aircraft, condition, structure, variable))
        out |= {f"{axis}_{variable}": abs(float(inverse[k, k])) for k, axis in enumerate(axes)}
    return out


def with_increments(aircraft: Aircraft, added: Mapping[str, float], trimmed: TrimmedFlight) -> Aircraft:
    """Return the aircraft with increments of coefficients in its model itself, which vanish at a trim.

    Args:
        aircraft: its other amendments stay what they are.
        added: coefficient -> increment.
        trimmed: the equilibrium that stays.
    """
    changes = [
        AddCoefficient(name, value, 0.0 if v in _RATES else float(trimmed.state[v]))
        for name, value in added.items()
        for v in (name.partition("_")[2],)
    ]
    return _in_itself(aircraft, changes)


def with_lag(aircraft: Aircraft, control: str, lag_s: float) -> Aircraft:
    """Return the aircraft with another time constant of a servo, in its model itself.

    Raises:
        ModelError: it has no such control.
    """
    aircraft, changes = with_servo(aircraft, control, 1.0 / lag_s)
    return _in_itself(aircraft, changes) if changes else aircraft


def _in_itself(aircraft: Aircraft, changes: Sequence[Change]) -> Aircraft:
    """Return the aircraft with changes made to its model as it is in its file, before adapter and amendments."""
    tree = ET.fromstring(aircraft.xml)
    for change in changes:
        change.apply(tree, aircraft)
    if aircraft.adapter is not None:
        read = {(e.text or "").strip() for e in tree.findall("external_reactions//property")}
        declare(tree, {n: 0.0 for n in sorted(read) if n.startswith(PREFIX)})
    return replace(aircraft, xml=ET.tostring(tree, encoding="unicode"))


# --- which model's derivatives are written into the aircraft, and which of them are left as they were -----------------


_MOVED = 0.05  # standard errors by which a value must move to be said
_NO_COEFFICIENT = {
    "V": "it follows from lift, drag and thrust at trim, and has no coefficient of its own",
    "thr": "the throttle acts through the engine, whose thrust is unchanged",
}


def chosen_case(found: Identified) -> tuple[int, str]:
    """Return the index of the case whose derivatives are written, and the rule in a sentence ("" if it was the only
    one).

    Raises:
        EstimationError: no model has derivatives that an aircraft has, or none is to be believed; says why.
    """
    known = [i for i, case in enumerate(found.cases) if _has_meaning(case) and i not in found.replaced]
    if not known:
        raise EstimationError(
            f"an aircraft is amended by derivatives whose meaning is known, but {found.name} has no model with one of "
            f"the structures {', '.join(n for n in STRUCTURE_NAMES if n != 'aerodynamic_longitudinal')}; if "
            'parameters of equations of your own are those of one of them, state beside their states: means = "..."'
        )
    held = {d.case for d in found.derivatives if d.determined and d.flown}  # in spite of what residuals hold
    good = [i for i in known if found.cases[i].model.status != "wrong" or i in held]
    if not good:
        why = next((str(a) for i in known for a in ranked(found.cases[i].model.advice) if a.severity == "wrong"), "")
        raise EstimationError(
            f"an aircraft is amended by a model that may be used, but {found.name} has none: {why or 'see its advice'}"
        )
    shared = [n for n in found.cases[good[0]].model.outputs if all(n in found.cases[i].model.outputs for i in good)]
    best = min(good, key=lambda i: _miss_of(found.cases[i], shared))
    if len(known) == 1:
        return best, ""
    name = case_names(found.cases)[best]
    if len(good) == 1:
        return best, f"of {len(known)} models only {name} may be used, so its derivatives are used"
    which = "predicts the records that were not used" if found.cases[best].validation else "follows the records"
    return best, f"of {len(known)} models {name} {which} best, so its derivatives are used"


def _has_meaning(case: Case) -> bool:
    return (
        isinstance(case.model, ParametricModel)
        and isinstance(case.estimator, Structured)
        and case.model.structure.meaning not in ("", "aerodynamic_longitudinal")
    )


def _miss_of(case: Case, outputs: Sequence[str]) -> float:
    scores = case.evaluation.validation if case.validation else case.evaluation.identification
    of = dict(zip(case.model.outputs, scores.mrse_percent, strict=True))
    value = float(np.mean([of[n] for n in outputs])) if outputs else float(np.mean(scores.mrse_percent))
    return value if np.isfinite(value) else np.inf


def aims_of(found: Identified, index: int) -> tuple[tuple[Aim, ...], tuple[str, ...]]:
    """Return every derivative of a model with what is aimed at, and what is left though the data contradict it.

    Raises:
        EstimationError: nothing is left to be written.
    """
    model, aircraft = found.cases[index].model, found.before.aircraft if found.before else None
    assert isinstance(model, ParametricModel)
    own = [d for d in found.derivatives if d.case == index and not d.name.startswith(("tau_", "T_"))]
    wrong = model.status == "wrong"
    reasons = {
        d.name: _left(d, aircraft.name if aircraft else "")
        or (d.believed if wrong and not (d.determined and d.flown) else "")
        for d in own
    }
    if all(reasons.values()):
        raise EstimationError(
            f"an aircraft is amended by derivatives that the data determine, but of {found.name} none is left: "
            f"{by_reason(reasons)}; excite the motion more, or follow the advice"
        )
    at = {d.name: d.before for d in own if d.before is not None and d.std > 0.0} | _lags_left(found, index)
    agreeing = [d.name for d in found.derivatives if d.case == index and not _contradicts(d, at.get(d.name))]
    model = replace(model, covariance=covariance_of(found.derivatives, index, model))
    told = _told(model, at, [d.name for d in own if not reasons[d.name]], agreeing)
    aims = []
    for d in own:
        if d.before is None:
            continue
        aimed, why = None, reasons[d.name]
        if not why and d.name not in told:
            why = f"not significantly different from before: within {CRITERIA.changed:g} errors"
        elif not why:
            aimed = told[d.name]
            said = [] if d.determined else [d.believed]
            if abs(aimed - d.value) > _MOVED * d.std:
                said.append("estimated with the others fixed at their value before")
            why = "; ".join(said)
        aims.append(Aim(d.name, d.unit, d.value, d.std, d.before, aimed, why))
    if not told:
        assert aircraft is not None
        raise EstimationError(
            f"an aircraft is amended if a flight contradicts it, but {found.name} contradicts no derivative of "
            f"{aircraft.name} has ({by_reason({a.name: a.why for a in aims})}): there is nothing to write"
        )
    notes = [
        f"{d.name} is left at {d.before:.4g} ({reasons[d.name]}), though the data say {d.value:.4g} ± {d.std:.2g}: the "
        "written ones may compensate for it"
        for d in own
        if d.before is not None and reasons[d.name] and d.std > 0.0 and _contradicts(d)
    ]
    return tuple(aims), tuple(notes)


def by_reason(reasons: Mapping[str, str]) -> str:
    """Return names and why, those with one reason together."""
    return "; ".join(f"{', '.join(names)} ({why})" for why, names in grouped(reasons).items())


def _contradicts(d: FoundDerivative, before: float | None = None) -> bool:
    before = d.before if before is None else before
    return before is not None and abs(d.value - before) > CRITERIA.changed * d.std


def _lags_left(found: Identified, index: int) -> dict[str, float]:
    """Return parameter -> value of the lags that were estimated and are left as the aircraft has them."""
    assert found.before is not None
    servos = servos_of(found.before.aircraft, found.cases[index].model.inputs)
    lags = {f"tau_{n.removesuffix('_cmd')}": s.lag_s for n, s in servos.items()}
    left = [d.name for d in found.derivatives if d.case == index and not d.determined]
    return {n: lag for n, lag in lags.items() if n in left and isinstance(lag, float)}


def _left(d: FoundDerivative, aircraft: str) -> str:
    """Return why a derivative is left as it was, whatever its value, or ""."""
    axis, _, variable = d.name.partition("_")
    if variable in _NO_COEFFICIENT:
        return _NO_COEFFICIENT[variable]
    if d.before is None or d.source != aircraft or (axis, variable) not in REACHED_BY:
        return "the aircraft has no such derivative"
    if d.believed == "weak" and not _contradicts(d):
        return "the data give little information on it"
    return d.believed if d.believed in ("at bound", "not converged") else ""


def _told(
    model: ParametricModel, before: Mapping[str, float], wanted: Sequence[str], agreeing: Sequence[str]
) -> dict[str, float]:
    """Return name -> value of those that the data tell from what they were, the others held at that.

    Args:
        model: estimates and their covariance.
        before: name -> value before.
        wanted: those that may be written.
        agreeing: those that may be held: their values do not contradict what they were.
    """
    names = model.structure.parameter_names
    held = [n for n in agreeing if n in before and n not in wanted]
    while True:
        value, error = _given(model, {n: before[n] for n in held})
        z = {
            n: abs(value[names.index(n)] - before[n]) / max(float(error[names.index(n)]), 1e-300)
            for n in wanted
            if n not in held and n in before
        }
        least = min(z, key=z.__getitem__, default=None)
        if least is None or z[least] >= CRITERIA.changed:
            return {n: float(value[names.index(n)]) for n in wanted if n not in held}
        held.append(least)


def _given(model: ParametricModel, held: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
    """Return parameters (k,) and their errors (k,) if those held have the values given."""
    x, P = model.params, model.covariance
    at = [model.structure.parameter_names.index(n) for n in held]
    if not at:
        return x, np.sqrt(np.diag(P))
    scale = np.sqrt(np.diag(P)[at])
    gain = (P[:, at] / scale) @ np.linalg.pinv(P[np.ix_(at, at)] / np.outer(scale, scale), rcond=1e-9, hermitian=True)
    off = (x[at] - np.array(list(held.values()))) / scale
    left = np.diag(P) - np.sum(gain * (P[:, at] / scale), axis=1)
    return np.asarray(x - gain @ off), np.sqrt(np.maximum(left, 0.0))


def servo_aims(found: Identified, index: int) -> tuple[tuple[ServoAim, ...], tuple[str, ...]]:
    """Return the servos to write, and sentences on what of them is left."""
    case, out, notes = found.cases[index], [], []
    assert found.before is not None
    aircraft, model = found.before.aircraft, case.model
    own = {n.removesuffix("_cmd"): s for n, s in servos_of(aircraft, model.inputs).items()}
    given = getattr(case.estimator, "servo", {})
    by_name = {d.name: d for d in found.derivatives if d.case == index}
    for name, servo in given.items():
        control = name.removesuffix("_cmd")
        had = own[control].lag_s if control in own else None
        before = had if isinstance(had, float) else None
        lag, delay = by_name.get(f"tau_{control}"), by_name.get(f"T_{control}")
        if control not in aircraft.controls or control == "thr" or servo.ignore:
            continue
        if lag is not None and not lag.determined:
            notes.append(f"the lag of {control} is unchanged ({lag.believed})")
        elif lag is not None:
            out.append(ServoAim(control, before, lag.value, lag.std))
        elif isinstance(servo.lag_s, float) and (before is None or abs(servo.lag_s - before) > 1e-6 * before):
            out.append(ServoAim(control, before, servo.lag_s, None))
        elif servo.wn_rad_s is not None:
            notes.append(f"the servo of {control} has two poles here and one lag in an aircraft: it is unchanged")
        late = delay.value if delay is not None else servo.delay_s
        if isinstance(late, float) and late > 0.0:
            notes.append(
                f"the delay of {control}, {1e3 * late:.3g} ms, is not written, because aircraft.toml has no key for "
                "it: in the simulated records the commands act that much later, and in Python SERVOS['delay', "
                f"'{control}'] of testbench.effects adds it to the loaded aircraft, to be flown at its own rate "
                "(another one gives a warning)"
            )
    return tuple(out), tuple(notes)
