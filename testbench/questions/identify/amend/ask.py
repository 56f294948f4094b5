"""Write identified derivatives into the user's aircraft, look whether it has them, and fly the records through both.

One motion at several speeds: what its identifications say together of the aircraft.

Every derivative is a factor on what the aircraft had at the condition of its records, by which its trend with speed is
that of the aircraft's model. The factors f_i with covariance P_i of all conditions together are

    f = P sum P_i^-1 f_i,    P^-1 = sum P_i^-1,

and if chi-square of the f_i about f is one that conditions which agree exceed in 1 % only, P grows by chi^2/dof.

The recorded flight through both aircraft: JSBSim from trim with the recorded inputs, in still air.

A record neither begins in equilibrium nor does it say where the equilibrium is. What is fitted to it, of both aircraft
alike, is the state that it begins with, a constant offset of each input and one of each output:

    y = y_JSBSim(u) + C Phi(t) x0 + C (integral Phi B + D) b + c,

by least squares, each output over its own size. Phi, B, C and D are of the linear model about trim of the same
aircraft, so that the nonlinear flight is right to first order in what is fitted. Nothing else is fitted.
"""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2 as chi_square

from testbench.aircraft import Aircraft, SetProperty
from testbench.aircraft.seams import changed, control_path
from testbench.core.blas import on_one_thread
from testbench.core.channels import CONTROLS
from testbench.core.errors import EstimationError, Refusal, ScenarioError
from testbench.core.escape import markdown_cell, markdown_table
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.words import with_error
from testbench.estimators.identification import estimator_name
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.parametric.response import delayed
from testbench.flight import FlightCondition, LinearModel, Manoeuvre, TrimmedFlight, fly, linearise, load_aircraft, trim
from testbench.inputs.signal import InputSignal
from testbench.line import Case, Report
from testbench.page.words import listed
from testbench.questions.identify.amend.choose import (
    REACHED_BY,
    aims_of,
    chosen_case,
    coefficient_errors,
    derivatives_of,
    reached,
    servo_aims,
    with_lag,
)
from testbench.questions.identify.amend.folder import SOURCES, aircraft_files, base_texts, folder_of, write_folder
from testbench.questions.identify.amend.result import Aim, Amended, Coefficient, Replay, ServoAim
from testbench.questions.identify.derivatives import Before, FoundDerivative, covariance_of, servos_of
from testbench.questions.identify.instruments import agreement_in_words
from testbench.questions.identify.mend import without
from testbench.questions.identify.result import Identified
from testbench.questions.identify.scenario import RecordDescription

# --- the recorded flight through both aircraft ------------------------------------------------------------------------


_LONGITUDINAL = ("u", "w", "q", "theta")
_LATERAL = ("v", "p", "r", "phi")
_OUTPUTS_LATERAL = {"beta", "v", "p", "r", "phi", "psi", "pdot", "rdot", "ay"}
_LEVERS = {"ax": ((1, "qdot", 1.0),), "az": ((0, "qdot", -1.0),), "ay": ((0, "rdot", 1.0), (1, "pdot", -1.0))}
"""Accelerometer -> (index in (forward, down), angular acceleration, sign) of what it reads away from the centre of
gravity."""
_SAME_RATE = 0.01
_QUICK_RAD_S = 1e4
_LONGEST = 100_000  # samples; an hour flown without a pilot says nothing more


def replays(
    case: Case, names: Sequence[tuple[str, str]], old: Aircraft, new: Aircraft, condition: FlightCondition
) -> tuple[Replay, ...]:
    """Return every record of a case through both aircraft.

    Args:
        case: its prepared records, the model's inputs and outputs.
        names: (name, use) of its identification and validation records, in this order.
        old: the aircraft as it was.
        new: the amended one.
        condition: that both are trimmed at.
    """
    records = (*case.identification, *case.validation)
    flyers: dict[tuple[str, float], _Flyer | str] = {}
    out = []
    for (name, use), whole in zip(names, records, strict=True):
        record = whole
        flown: dict[str, FloatArray | None] = {}
        notes: list[str] = []
        if len(record) > _LONGEST:
            record = record.between(float(record.t_s[0]), float(record.t_s[_LONGEST]))
            notes.append(f"{name}: the first {_LONGEST} samples are flown")
        for which, aircraft in (("before", old), ("after", new)):
            key = (which, round(record.dt_s, 12))
            if key not in flyers:
                flyers[key] = _flyer(case, aircraft, condition, record.dt_s)
            flyer = flyers[key]
            found = flyer if isinstance(flyer, str) else flyer.through(record)
            flown[which] = None if isinstance(found, str) else found
            if isinstance(found, str):
                notes.append(f"{name}: {aircraft.name} {found}")
        channels = case.model.outputs
        valid = record.valid[:, [record.channels.index(n) for n in channels]]
        measured = record.columns(channels)
        out.append(
            Replay(
                name, use, record.t_s - record.t_s[0], channels, measured, valid, flown["before"], flown["after"],
                tuple(notes),
            )
        )  # fmt: skip
    return tuple(out)


class _Flyer:
    """One aircraft at trim, ready to fly records of one sample time."""

    def __init__(self, case: Case, aircraft: Aircraft, condition: FlightCondition, dt_s: float) -> None:
        model = case.model
        self._inputs = tuple(n for n in model.inputs if n.removesuffix("_cmd") in CONTROLS)
        self._controls = tuple(n.removesuffix("_cmd") for n in self._inputs)
        held = getattr(model, "held", ())
        self._held = tuple(bool(h) for n, h in zip(model.inputs, held, strict=False) if n in self._inputs)
        self._late = np.array([_delay(case, n) for n in self._inputs])
        self._outputs = model.outputs
        self._lever = getattr(case.estimator, "accelerometer_m", (0.0, 0.0))
        self._steps = max(1, math.ceil(aircraft.rate_hz * dt_s - _SAME_RATE))
        bare = [n for n in self._inputs if not n.endswith("_cmd") and n != "thr"]
        self._aircraft = replace(_without_servos(aircraft, bare), limits={})
        self._trimmed: TrimmedFlight = trim(self._aircraft, condition, self._steps / dt_s)
        self._linear: LinearModel = linearise(self._aircraft, self._trimmed)

    def through(self, record: FlightRecord) -> FloatArray | str:
        """Return the outputs (n, p) as deviations, or why the flight ended before its time."""
        u = delayed(record.columns(self._inputs), record.dt_s, self._late)
        if record.provenance.get("prepared", {}).get("bias", "none") == "none":
            u = u - u.mean(axis=0)  # nobody has said where the equilibrium is; what is left of it is fitted
        frames = np.arange((len(record) - 1) * self._steps) / self._steps
        at = np.arange(len(record))
        held = np.column_stack(
            [
                u[frames.astype(int), i] if self._held[i] else np.interp(frames, at, u[:, i])
                for i in range(len(self._inputs))
            ]
        )
        of = [(self._aircraft.controls[n], self._trimmed.controls[n]) for n in self._controls]
        held = np.clip(held, [c.low - x for c, x in of], [c.full - x for c, x in of])
        signal = InputSignal(np.arange(len(held)) / self._trimmed.rate_hz, held, self._controls)
        needed = [n for c in self._outputs for n in (c, *(a for _, a, _ in _LEVERS.get(c, ())))]
        try:
            flown = fly(
                self._aircraft,
                self._trimmed,
                Manoeuvre("recorded inputs", signal, 0.0),
                1.0 / record.dt_s,
                list(dict.fromkeys(needed)),
            )
        except Refusal as error:
            return f"does not fly it to the end: {error.message}"
        y = np.column_stack([self._read(c, lambda n: flown[n] - self._trimmed.state[n]) for c in self._outputs])
        taken = record.valid[:, [record.channels.index(n) for n in self._outputs]]
        measured = record.columns(self._outputs)
        size = np.array([np.std(measured[taken[:, i], i]) if taken[:, i].any() else 0.0 for i in range(y.shape[1])])
        weight = taken / np.where(size > 0.0, size, 1.0)
        return np.asarray(y + self._fitted(measured - y, weight, record.dt_s))

    def _read(self, channel: str, of: Callable[[str], FloatArray]) -> FloatArray:
        """Return what an instrument reads: an accelerometer away from the centre of gravity feels the rotation."""
        out = of(channel)
        for index, name, sign in _LEVERS.get(channel, ()):
            if self._lever[index]:
                out = out + sign * self._lever[index] * of(name)
        return np.asarray(out)

    def _fitted(self, error: FloatArray, weight: FloatArray, dt_s: float) -> FloatArray:
        """Return (n, p) what initial state and constants explain of an error (n, p), with weights (n, p)."""
        from scipy.linalg import expm

        linear = self._linear
        n, size = len(error), len(linear.states)
        lateral = {name in _OUTPUTS_LATERAL for name in self._outputs}
        began = [s for k, group in ((False, _LONGITUDINAL), (True, _LATERAL)) if k in lateral for s in group]
        rows = {name: linear.C[i] for i, name in enumerate(linear.outputs)}
        fed = {name: linear.D[i] for i, name in enumerate(linear.outputs)}
        columns = [linear.inputs.index(name) for name in self._linear_inputs()]
        C = np.array([self._read(c, rows.__getitem__) for c in self._outputs])
        D = np.array([self._read(c, fed.__getitem__) for c in self._outputs])[:, columns]
        m = len(columns)
        whole = np.zeros((size + m, size + m))
        whole[:size, :size], whole[:size, size:] = linear.A, linear.B[:, columns]
        step = expm(whole * dt_s)
        x = np.zeros((size + m, len(began) + m))
        for k, name in enumerate(began):
            x[linear.states.index(name), k] = 1.0
        x[size:, len(began) :] = np.eye(m)
        read = np.hstack([C, D])
        parts = np.empty((n, len(self._outputs), x.shape[1]))
        for i in range(n):
            parts[i] = read @ x
            x = step @ x
        constants = np.broadcast_to(np.eye(len(self._outputs)), (n, len(self._outputs), len(self._outputs)))
        J = np.concatenate([parts, constants], axis=2)
        left = (J * weight[:, :, None]).reshape(-1, J.shape[2])
        norm = np.linalg.norm(left, axis=0)
        norm[norm == 0.0] = 1.0
        found = np.linalg.lstsq(left / norm, (error * weight).ravel(), rcond=1e-9)[0] / norm
        return np.asarray(J @ found)

    def _linear_inputs(self) -> tuple[str, ...]:
        return tuple(n if n in self._linear.inputs else n.removesuffix("_cmd") for n in self._inputs)


def _flyer(case: Case, aircraft: Aircraft, condition: FlightCondition, dt_s: float) -> _Flyer | str:
    try:
        return _Flyer(case, aircraft, condition, dt_s)
    except Refusal as error:
        return f"cannot be flown there: {error.message}"


def _delay(case: Case, name: str) -> float:
    """Return the delay of an input that its estimate was made with or found, s."""
    estimator, model = case.estimator, case.model
    servo = getattr(estimator, "servo", {}).get(name)
    said = 0.0 if servo is None or servo.ignore else servo.delay_s
    if said == "estimate":
        values: Mapping[str, float] = getattr(model, "values", {})
        said = values.get(f"T_{name.removesuffix('_cmd')}", 0.0)
    return dict(zip(model.inputs, getattr(model, "delays_s", ()), strict=False)).get(name, 0.0) + float(said)


def _without_servos(aircraft: Aircraft, controls: Sequence[str]) -> Aircraft:
    """Return the aircraft with surfaces that are where their commands are: these were measured, whatever law flew."""
    aircraft = aircraft.commanded_at("surface") if controls else aircraft
    for control in controls:
        if control not in aircraft.controls:
            continue
        path = control_path(aircraft, control)
        if aircraft.adapter is not None:
            links = tuple(
                replace(x, lag_rad_s=None, rate_limit_rad_s=None) if x.control == control else x
                for x in aircraft.adapter.links
            )
            aircraft = replace(aircraft, adapter=replace(aircraft.adapter, links=links))
        elif path.lag is not None and path.rate_limit is not None:
            quick = (SetProperty(path.lag, _QUICK_RAD_S), SetProperty(path.rate_limit, _QUICK_RAD_S))
            aircraft = changed(aircraft, f"{control} measured", "no servo before a measured surface", *quick)
    return aircraft


# --- one motion at several speeds -------------------------------------------------------------------------------------


_CHANCE = 0.01
_BELIEF = ("determined", "in doubt", "weak")
"""From the best to the worst; what is none of them is worse."""


class Told(NamedTuple):
    """An identification at one condition and the number of its case.

    ``doubts`` are sentences on conditions that disagree; ``others`` the identifications at other conditions that it
    speaks for.
    """

    found: Identified
    case: int
    doubts: tuple[str, ...] = ()
    others: tuple[tuple[Identified, int], ...] = ()

    @property
    def model(self) -> ParametricModel:
        """The model of the case."""
        model = self.found.cases[self.case].model
        assert isinstance(model, ParametricModel)
        return model


def together(told: Sequence[Told]) -> list[Told]:
    """Return one of the identifications of each motion, with what all of that motion say at its condition.

    Identifications belong together if their models have the same derivatives; that of the middle speed is returned.
    """
    groups: dict[tuple[str, tuple[str, ...]], list[Told]] = {}
    for one in told:
        names = tuple(p.name for p in one.model.structure.parameters if p.free)
        groups.setdefault((one.model.structure.meaning, names), []).append(one)
    return [group[0] if len(group) == 1 else _pooled(group) for group in groups.values()]


def _pooled(group: Sequence[Told]) -> Told:
    middle = sorted(group, key=_speed)[len(group) // 2]
    own = {d.name: d for d in _derivatives(middle)}
    names = [n for n, d in own.items() if all(_before(one, n) for one in group) and d.std > 0.0]
    factors, information = [], []
    for one in group:
        at = [one.model.structure.parameter_names.index(n) for n in names]
        before = np.array([_before(one, n) for n in names])
        P = covariance_of(one.found.derivatives, one.case, one.model)[np.ix_(at, at)] / np.outer(before, before)
        factors.append(np.array([{d.name: d.value for d in _derivatives(one)}[n] for n in names]) / before)
        information.append(_inverse(P))
    P = _inverse(np.sum(information, axis=0))
    f = P @ np.sum([M @ x for M, x in zip(information, factors, strict=True)], axis=0)
    chi2 = float(sum((x - f) @ M @ (x - f) for M, x in zip(information, factors, strict=True)))
    dof = len(names) * (len(group) - 1)
    doubts: tuple[str, ...] = ()
    if chi_square.sf(chi2, dof) < _CHANCE:
        P = P * chi2 / dof
        doubts = (
            f"{listed([one.found.name for one in group])} differ by {np.sqrt(chi2 / dof):.2g} times their errors: the "
            "aircraft varies with speed in another way than its model, or the errors of the records are too small",
        )
    return _read(middle, group, names, f, P, doubts)


def _read(
    middle: Told, group: Sequence[Told], names: Sequence[str], f: FloatArray, P: FloatArray, doubts: tuple[str, ...]
) -> Told:
    """Return the middle identification with factors (k,) and their covariance (k, k) in place of its own."""
    model = middle.model
    at = [model.structure.parameter_names.index(n) for n in names]
    before = np.array([_before(middle, n) for n in names])
    params, covariance = model.params.copy(), np.diag(np.diag(model.covariance))
    params[at], covariance[np.ix_(at, at)] = f * before, P * np.outer(before, before)
    std = dict(zip(names, np.sqrt(np.diag(P)) * np.abs(before), strict=True))
    value = dict(zip(names, (f * before).tolist(), strict=True))
    beliefs = {n: _best([d.believed for one in group for d in _derivatives(one) if d.name == n]) for n in names}
    derivatives = tuple(
        replace(d, value=value[d.name], std=float(std[d.name]), stated=float(std[d.name]), believed=beliefs[d.name])
        if d.case == middle.case and d.name in value
        else d
        for d in middle.found.derivatives
    )
    cases = list(middle.found.cases)
    cases[middle.case] = replace(cases[middle.case], model=replace(model, params=params, covariance=covariance))
    others = tuple((one.found, one.case) for one in group if one is not middle)
    return Told(replace(middle.found, cases=tuple(cases), derivatives=derivatives), middle.case, doubts, others)


def _derivatives(one: Told) -> list[FoundDerivative]:
    return [d for d in one.found.derivatives if d.case == one.case]


def _before(one: Told, name: str) -> float:
    """Return what the aircraft had; 0 if that is not known, or nothing that a factor could be of."""
    d = next((d for d in _derivatives(one) if d.name == name), None)
    return 0.0 if d is None or d.before is None or abs(d.before) <= 1e-3 * d.std else d.before


def _speed(one: Told) -> float:
    assert one.found.before is not None
    return one.found.before.condition.V_m_s


def _best(beliefs: Sequence[str]) -> str:
    return min(beliefs, key=lambda b: _BELIEF.index(b) if b in _BELIEF else len(_BELIEF))


def _inverse(P: FloatArray) -> FloatArray:
    size = np.sqrt(np.diag(P))
    return np.asarray(np.linalg.pinv(P / np.outer(size, size), rcond=1e-12, hermitian=True) / np.outer(size, size))


# --- write the derivatives, look whether the aircraft has them, and fly the records through both ----------------------


_FAR = 0.01
"""Distance from an aim, relative to it, from which it is said; judged."""


@dataclass(frozen=True, eq=False)
class _Part:
    """What one identification gives to the aircraft."""

    found: Identified
    known: Before
    index: int
    rule: str
    aims: tuple[Aim, ...]
    servos: tuple[ServoAim, ...]
    notes: tuple[str, ...]
    doubts: tuple[str, ...]
    others: tuple[tuple[Identified, int], ...]

    @property
    def condition(self) -> FlightCondition:
        return self.known.condition

    @property
    def label(self) -> str:
        """The model, in words."""
        case = self.found.cases[self.index]
        return f"{estimator_name(case.estimator)}, structure {self.structure}"

    @property
    def structure(self) -> str:
        model = self.found.cases[self.index].model
        assert isinstance(model, ParametricModel)
        return model.structure.meaning


@on_one_thread
def amend(found: Sequence[Identified], name: str, progress: Report | None = None) -> dict[str, Amended]:
    """Write the derivatives that were identified into a new aircraft.

    Args:
        found: identifications with one and the same aircraft, such as that of the longitudinal and of the lateral
            motion of one log.
        name: of the new aircraft, which goes to ``aircraft/NAME``, or a path.
        progress: called with a few words as each stage begins.

    Returns:
        Name of the identification -> its part; those that gave nothing are left out, and said in the notes.

    Raises:
        ScenarioError: an identification has no aircraft, or they have several.
        EstimationError: kinematics contradict an instrument, no derivative is to be believed, or none is one that an
            aircraft has.
        WriteError: the folder has an aircraft that the testbench did not write, or cannot be written to.
        TrimError, ModelError: the aircraft cannot be trimmed there, or cannot take what is to be written.

    Example:
        >>> import testbench as tb
        >>> found = tb.identify(tb.load_description("flight/flight_longitudinal.toml"))  # doctest: +SKIP
        >>> tb.amend([found], "mine")[found.name].written  # doctest: +SKIP
    """
    say = progress or (lambda text: None)
    named = check_aircraft(found)
    folder = folder_of(name, named)
    for each in found:
        check_instruments(each)
    parts, refused = _parts(found)
    base = parts[0].known.aircraft
    new, coefficients = base, dict[str, float]()
    say("fit the coefficients to the derivatives")
    for part in parts:
        targets = {a.name: a.aimed for a in part.aims if a.aimed is not None}
        new, added = reached(new, part.condition, part.structure, targets)
        for key, value in added.items():
            coefficients[key] = coefficients.get(key, 0.0) + value
        for servo in part.servos:
            new = with_lag(new, servo.control, servo.lag_s)
    text, sources = base_texts(named)
    lags = {s.control: s.lag_s for p in parts for s in p.servos} if base.adapter is not None else {}
    files = aircraft_files(
        new, folder.name, text, f"derivatives of {', '.join(p.found.name for p in parts)}", "", lags,
        _deviations(parts, new),
    )  # fmt: skip
    say("load and linearise the amended aircraft")
    with tempfile.TemporaryDirectory() as place:
        write_folder(files, Path(place) / folder.name)
        loaded = load_aircraft(Path(place) / folder.name)
    parts = [_with_reached(p, loaded) for p in parts]
    changed = tuple(
        Coefficient(key, value, _number(base, key), _number(loaded, key)) for key, value in coefficients.items()
    )
    origin = _origin(folder.name, base, parts, changed, sources)
    write_folder({**files, SOURCES: origin}, folder)
    out = {}
    for part in parts:
        say(f"simulate the records of {part.found.name} through both")
        own = {a.name.partition("_")[2] for a in part.aims if a.aimed is not None}
        out[part.found.name] = Amended(
            folder.name,
            folder,
            base,
            loaded,
            part.label,
            part.rule,
            part.condition.V_m_s,
            part.condition.h_m,
            part.aims,
            part.servos,
            tuple(c for c in changed if c.name.partition("_")[2] in own),
            tuple(_flown(part, base, loaded)),
            part.notes,
            (*part.doubts, *refused),
        )
    return out


def _flown(part: _Part, old: Aircraft, new: Aircraft) -> Iterator[Replay]:
    """Yield the records of all conditions that a part speaks for, through both aircraft."""
    outputs = part.found.cases[part.index].model.outputs
    for found, index in ((part.found, part.index), *part.others):
        case = found.cases[index]
        if case.model.outputs == outputs and found.before is not None:
            yield from replays(case, _names(found), old, new, found.before.condition)


def check_aircraft(found: Sequence[Identified]) -> str:
    """Return the aircraft that all identifications name, as it is resolved.

    Raises:
        ScenarioError: one names none, or they name several.
        EstimationError: it has no trim at the condition of the records.
    """
    named = [f.source.aircraft for f in found]
    for f, name in zip(found, named, strict=True):
        if name is None:
            raise ScenarioError(no_aircraft(f.name))
    if len(set(named)) > 1:
        raise ScenarioError(f"one aircraft is amended at a time, got {', '.join(sorted(set(map(str, named))))}")
    for f in found:
        if f.before is not None and not f.before.derivatives:
            raise EstimationError(f"an aircraft is amended where it flies, but {f.before.notes[-1]}")
    return str(named[0])


def check_instruments(found: Identified) -> None:
    """Refuse derivatives from an instrument that kinematics contradict.

    Raises:
        EstimationError: names the instrument, its error, and how to take it out of the records.
    """
    if found.instruments is None or not found.contradicted:
        return
    assert isinstance(found.source, RecordDescription)
    fault, where = found.instruments.fault, found.source.file
    if fault is None:
        raise EstimationError(
            f"an aircraft is amended by instruments that agree, but of {found.name} "
            f"{agreement_in_words(found.instruments)[0]}; correct the instruments, or leave the channel out of the "
            "outputs"
        )
    size = without(found.source, fault).correct[fault.name]
    raise EstimationError(
        f"an aircraft is amended by instruments that agree, but of {found.name} "
        f"{agreement_in_words(found.instruments)[0]}; correct the instrument, or put this into {where} before its "
        f"first table, which corrects the records: correct = {{ {fault.name} = {size:.4g} }}"
    )


def no_aircraft(name: str) -> str:
    """Return what is said where there is nothing to amend."""
    return f'an aircraft is amended, but {name} names none: give --aircraft, or aircraft = "..." in the description'


def _parts(found: Sequence[Identified]) -> tuple[list[_Part], list[str]]:
    """Return what each identification gives, and why others give nothing.

    Raises:
        EstimationError: none gives anything.
    """
    parts: list[_Part] = []
    errors: list[EstimationError] = []
    told, rules = [], dict[str, str]()
    for f in found:
        try:
            index, rules[f.name] = chosen_case(f)
        except EstimationError as error:
            errors.append(error)
            continue
        told.append(Told(f, index))
    for f, index, doubts, others in together(told):
        assert f.before is not None
        try:
            aims, contradicted = aims_of(f, index)
            servos, left = servo_aims(f, index)
        except EstimationError as error:
            errors.append(error)
            continue
        parts.append(_Part(f, f.before, index, rules[f.name], aims, servos, left, (*doubts, *contradicted), others))
    if not parts:
        raise errors[0]
    return parts, [f"nothing of another motion is written: {e.message}" for e in errors]


def _with_reached(part: _Part, loaded: Aircraft) -> _Part:
    """Return a part with what the aircraft has, and what is said of what is far from its aim and of the equilibrium."""
    trimmed = trim(loaded, part.condition)
    has = derivatives_of(loaded, trimmed, part.structure)
    aims = tuple(replace(a, reached=has[a.name]) for a in part.aims)
    own = servos_of(loaded, [f"{s.control}_cmd" for s in part.servos])
    lags = {n.removesuffix("_cmd"): s.lag_s for n, s in own.items()}
    servos = tuple(replace(s, reached_s=_float(lags.get(s.control))) for s in part.servos)
    far = [
        f"{a.name} is {a.reached:.4g}, not {a.aimed:.4g}: increments of coefficients by the linearised model do not "
        "reach it; the aerodynamics of the model is nonlinear about this trim"
        for a in aims
        if a.off is not None
        and a.off > _FAR
        and a.aimed is not None
        and abs((a.reached or 0.0) - a.aimed) > 0.1 * a.std
    ]
    notes = (*part.notes, _trim_note(part, trimmed))
    return replace(part, aims=aims, servos=servos, notes=notes, doubts=(*part.doubts, *far))


def _float(value: object) -> float | None:
    return value if isinstance(value, float) else None


def _names(found: Identified) -> list[tuple[str, str]]:
    """Return name and use of the records of a case: those to identify on, then those to judge on."""
    split = [f.name for f in found.flights if f.use == "split"]
    fit = [f.name for f in found.flights if f.use == "identification"]
    judge = [f.name for f in found.flights if f.use == "validation"]
    return [*((n, "identification") for n in (*fit, *split)), *((n, "validation") for n in (*judge, *split))]


def _trim_note(part: _Part, trimmed: TrimmedFlight) -> str:
    """Say that the equilibrium is left as it was, beside what was recorded of it."""
    records = part.found.cases[part.index].identification
    said = []
    for name in ("alpha", "de"):
        values = [
            float(r.provenance["prepared"]["removed"][name])
            for r in records
            if name in r and name in r.provenance.get("prepared", {}).get("removed", {})
        ]
        if values and name in trimmed.state:
            degrees = np.degrees([float(np.mean(values)), float(trimmed.state[name])])
            said.append(f"{name} {degrees[0]:.1f} deg in the records and {degrees[1]:.1f} deg in the aircraft")
    beside = f": {', '.join(said)}" if said else ""
    return (
        f"the equilibrium at {part.condition.V_m_s:.4g} m/s is unchanged, because derivatives give no information on "
        f"it{beside}"
    )


def _number(aircraft: Aircraft, name: str) -> float | None:
    try:
        return aircraft.coefficient(name)
    except Refusal:
        return None


def _deviations(parts: Sequence[_Part], new: Aircraft) -> dict[str, float]:
    """Return coefficient -> relative standard deviation of those that are stated and that the flight told."""
    out = {}
    for part in parts:
        errors = coefficient_errors(new, part.condition, part.structure)
        for a in part.aims:
            key = REACHED_BY.get((a.name[0], a.name[2:]), "")
            value = _number(new, key) if key in new.uncertainty else None
            if a.aimed is not None and value:
                out[key] = max(a.std * errors[a.name] / abs(value), 1e-6)
    return out


def _origin(name: str, base: Aircraft, parts: Sequence[_Part], changed: Sequence[Coefficient], sources: str) -> str:
    """Return SOURCES.md: what changed, by which flight, and what the sources of the aircraft before say."""
    lines = [
        f"# {markdown_cell(name)}: sources",
        "",
        f"{base.name}, amended by derivatives that were identified from recorded flights. Where it differs from "
        f"{base.name} is in the tables; all else is {base.name}'s.",
    ]
    for part in parts:
        files = dict.fromkeys(
            (str(r.provenance.get("file", "?")), str(r.provenance.get("sha256", "?")))
            for f in part.found.flights
            for r in f.measured.values()
        )
        lines += [
            "",
            f"## {markdown_cell(f'{part.found.name}: {part.found.title}')}",
            "",
            f"Model: {part.label}. Condition: {part.condition}. Records:",
            "",
            *(f"- {markdown_cell(file)}, SHA-256 {digest}" for file, digest in files),
            "",
            *markdown_table(
                ("derivative", "before", "identified", "written", "reached", "unit", "remark"),
                [
                    (
                        a.name, f"{a.before:.5g}", with_error(a.identified, a.std),
                        "left" if a.aimed is None else f"{a.aimed:.5g}",
                        "" if a.reached is None else f"{a.reached:.5g}", a.unit, a.why,
                    )
                    for a in part.aims
                ],
            ),
        ]  # fmt: skip
        if part.servos:
            lines += ["", *(f"- servo of {s.control}: a lag of {s.lag_s:.4g} s" for s in part.servos)]
        lines += ["", *(f"- {markdown_cell(text)}" for text in (*part.doubts, *part.notes))]
    lines += [
        "",
        "## Coefficients",
        "",
        "Per rad, or per p b/2V, q c/2V, r b/2V; what is added vanishes at the trim of the condition above.",
        "",
        *markdown_table(
            ("coefficient", "before", "after", "added"),
            [
                (c.name, *("" if v is None else f"{v:.6g}" for v in (c.before, c.after)), f"{c.added:.6g}")
                for c in changed
            ],
        ),
    ]
    if sources:
        lines += ["", f"# {base.name}: sources, as they were", "", re.sub(r"^#", "##", sources, flags=re.MULTILINE)]
    return "\n".join(lines).rstrip() + "\n"
