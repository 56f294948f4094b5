"""A card after its flights: its runs identified together, and what each target came to.

The description of the runs is a file that `testbench identify` reads again. All good runs are fitted at once, each with
initial states and offsets of its own. Where there are several, each is fitted alone as well: if their estimates scatter
by more than their errors say, sum (x_i - mean)^2 / s_i^2 > chi^2(n - 1), the error grows by the root of that ratio.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from scipy.stats import chi2

from testbench.core.channels import channel
from testbench.core.errors import Refusal
from testbench.core.escape import one_line, table_lines
from testbench.core.files import write_file
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.scenario.base import Preparation
from testbench.estimators import estimate
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.prepare import prepared
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.evaluation.modes import modes_of
from testbench.flight import FlightCondition, LinearModel, TrimmedFlight, linearise, trim
from testbench.inference.form import FORM_STD
from testbench.inference.instruments import sound
from testbench.information.targets import Targets, needed_parameters
from testbench.line import Case
from testbench.questions.design.ready import Promise, read_promise
from testbench.questions.identify.ask import identify
from testbench.questions.identify.derivatives import CRITERIA, FoundDerivative
from testbench.questions.identify.result import Identified
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.importing.recipe import measured_in
from testbench.questions.plan.card_text import card_stem
from testbench.questions.plan.close import Closed, FlownRun
from testbench.questions.plan.flown_recipe import FlownRecipe, design_file, recipe_of
from testbench.questions.plan.repeats import reach
from testbench.questions.plan.response import scaled
from testbench.questions.plan.result import Card, Plan

RECORDS, DESCRIPTIONS = "records", "identify"
FALSE_ALARM = 0.01  # probability that runs which differ by their errors alone are said to scatter
_LEAST_TRIM_S = 0.5  # of undisturbed flight, from which its mean is the trim


@dataclass(frozen=True)
class Estimate:
    """What the runs of a card say of one target."""

    value: float  # of all runs together
    stated: float  # standard error that the estimator states
    scatter: float  # factor on it by which the runs' own estimates differ; 1 if by no more than chance
    believed: str  # whether the data decide it, as :class:`FoundDerivative` says it

    @property
    def error(self) -> float:
        """Standard error, the scatter of the runs included."""
        return self.stated * self.scatter


@dataclass(frozen=True, eq=False)
class FlownCard:
    """A card and what its runs said."""

    card: Card  # of the plan
    runs: tuple[FlownRun, ...]  # that are identified: flown as the card says
    promise: Promise | None  # of its design, or of the plan by information; None if nobody promised anything
    by_design: bool  # whether the promise is that of a design
    reason: str = ""  # why nothing was identified, in words; "" if it was
    # target -> what was found; empty if nothing was identified
    estimates: Mapping[str, Estimate] = field(default_factory=dict)
    # target -> what the estimator finds in the expected response of the card, free of noise and gusts, less the
    # believed value; only where no flights of a design were simulated
    bends: Mapping[str, float] = field(default_factory=dict)
    # target -> believed value over that of the card, at the recorded speed and height; empty if unknown
    here: Mapping[str, float] = field(default_factory=dict)
    V_m_s: float | None = None  # mean airspeed of the runs before their inputs; None if it was not logged
    V_offset_m_s: float = 0.0  # offset that the file of the airspeed sensor states
    recipe: FlownRecipe | None = None  # how it was identified; None if not
    found: Identified | None = None  # the identification; None if there is none
    file: Path | None = None  # description of the runs; None if there is none
    notes: tuple[str, ...] = ()  # in sentences

    @property
    def case(self) -> Case | None:
        """The identified case."""
        return None if self.found is None else self.found.cases[0]

    @property
    def asked(self) -> bool:
        """Whether a design or the plan promised an accuracy; if not, what information says is told, not judged."""
        return self.by_design or bool(self.card.spec.accuracy_percent)

    @property
    def distrusted(self) -> bool:
        """Whether the estimator says of its own model that it must not be used."""
        return self.case is not None and self.case.model.status == "wrong"


def identify_cards(closed: Closed, folder: Path, say: Callable[[str], None] = lambda text: None) -> list[FlownCard]:
    """Write records and descriptions of the runs of every card into a folder, and identify each card.

    A card that cannot be identified says why; the others are not lost.
    """
    out = []
    for card in closed.plan.cards:
        for k, run in enumerate(closed.of(card), 1):
            run.record.save(folder / RECORDS / f"{run_stem(card, k)}.nc")
    for card in closed.plan.cards:
        if closed.good(card):
            say(f"identify card {card.number}")
        out.append(_flown(closed, card, folder))
    return out


def run_stem(card: Card, k: int) -> str:
    """Return the name of the record of the k-th run of a card, without ending."""
    return f"{card_stem(card)}_run_{k}"


def _flown(closed: Closed, card: Card, folder: Path) -> FlownCard:
    plan, runs = closed.plan, tuple(closed.good(card))
    if card.spec.use == "validation":
        return FlownCard(card, runs, None, False, "it is for validation")
    design = design_file(plan, card)
    promise = None if design is None else read_promise(design)
    by_design = promise is not None
    notes: tuple[str, ...] = ()
    if promise is None:
        promise = _promised_by_plan(plan, card)
    else:
        promise, notes = _at_card(plan, card, _scaled(promise, card))
    flown = FlownCard(card, runs, promise, by_design, "no run was flown as on the card")
    if not runs:
        return flown
    records, recipe, file = [r.record for r in runs], None, None
    try:
        recipe = recipe_of(plan, card, records)
        file = folder / DESCRIPTIONS / f"{card_stem(card)}.toml"
        judges = [r for c in plan.cards if _judges(c, card) for r in closed.good(c)]
        judges = [r for r in judges if all(n in measured_in([r.record]) for n in recipe.channels)]
        names = {run_stem(c, k): run for c in plan.cards for k, run in enumerate(closed.of(c), 1)}
        text = description_text(plan, card, (*runs, *judges), names, recipe)
        if promise is None or promise.realised is None:  # simulated flights would hold it
            text += _form_text(recipe, records[0].dt_s)
        write_file(file, text)
        found = identify(RecordDescription.load(file), data_folder=folder / RECORDS)
    except Refusal as error:
        notes = (*notes, *(recipe.notes if recipe else ()))
        return replace(flown, reason=one_line(error.message), recipe=recipe, file=file, notes=notes)
    case = found.cases[0]
    V, h = (_at_trim(case.identification, name) for name in ("V", "h"))
    here, told = _recorded(plan, card, V, h)
    estimates = _estimates(case, found.derivatives, promise)
    notes = (*notes, *recipe.notes, *told)
    offset = max((abs(s.bias) for s in plan.suite.sensors if s.channel == "V"), default=0.0)
    bends = _bends(card, case, promise) if promise is not None and promise.realised is None else {}
    return FlownCard(card, runs, promise, by_design, "", estimates, bends, here, V, offset, recipe, found, file, notes)


def _judges(other: Card, card: Card) -> bool:
    """Return whether a card judges what another one identifies: of one design, at one point."""
    own = (card.spec.design, card.point.number)
    return other.spec.use == "validation" and (other.spec.design, other.point.number) == own


def description_text(
    plan: Plan, card: Card, runs: Sequence[FlownRun], names: Mapping[str, FlownRun], recipe: FlownRecipe
) -> str:
    """Return the description of the runs of a card as `testbench identify` reads it.

    Args:
        plan: that was flown.
        card: of it.
        runs: of the card, which are identified together, and of those that judge it.
        names: of the records of runs, without ending.
        recipe: how they are identified.
    """
    named = [(next(n for n, r in names.items() if r is run), run.card.spec.use) for run in runs]
    settled = min(r.start_s - float(r.record.t_s[0]) for r in runs)
    logs = ", ".join(dict.fromkeys(r.log for r in runs))
    by_trim = settled >= _LEAST_TRIM_S
    point = (("V_m_s", "V", card.point.V_m_s), ("h_m", "h", card.point.h_m))
    told = {key: value for key, channel_, value in point if channel_ not in recipe.channels}
    table = {
        "title": f"{plan.scenario.title}: card {card.number}, {card.title}",
        "source": f"{logs}, cut by testbench plan close",
        "rights": "state here the owner of the data and who may use them",
        "folder": f"../{RECORDS}",
        "trim_s": math.floor(100.0 * settled) / 100.0 if by_trim else 0.0,
        "aircraft": plan.scenario.aircraft,
        "time": {"column": "t"},
        "preparation": {"bias": "trim" if by_trim else "mean"},
        "record": [{"name": n, "file": f"{n}.nc", "use": use} for n, use in named],
        "channel": [{"name": c, "column": c, "unit": channel(c).unit, "missing": "mask"} for c in recipe.channels],
        "condition": told,
        "identification": recipe.identification,
        **({"servo": recipe.servo} if recipe.servo else {}),
    }
    head = [f"# Written by testbench plan close: the runs of card {card.number}, flown as it says."]
    whose = f"of {recipe.design.name}" if recipe.design else "as the channels allow"
    head += [f"# {one_line(text)}" for text in (f"Estimator {whose}.", *recipe.notes)]
    return "\n".join([*head, *table_lines(table), ""])


def _form_text(recipe: FlownRecipe, dt_s: float) -> str:
    """Return the tables of a description that say what sound instruments and a linear model may hide."""
    used = dict.fromkeys(n for n in recipe.channels if n not in ("h", "qbar"))
    stds = {name: std for channel in used for name, std in sound(channel, dt_s).items()}
    return "\n".join([*table_lines({"instrument_std": stds, "form_std": dict(FORM_STD)}), ""])


def _scaled(promise: Promise, card: Card) -> Promise:
    """Return the promise at the amplitude of the card.

    Standard errors go with its inverse. The mean errors of the simulated flights stay: those by the sensors do, and
    those by curvature are no larger.
    """
    if card.factor in (0.0, 1.0):
        return promise
    realised, promised = promise.realised, promise.promised / card.factor
    if realised is not None:
        found, bias = realised.found, realised.found.bias
        errors = bias + (found.errors - bias) / card.factor
        realised = replace(
            realised, promised=promised, found=replace(found, errors=errors, stated=found.stated / card.factor)
        )
    return replace(promise, promised=promised, realised=realised)


def _promised_by_plan(plan: Plan, card: Card) -> Promise | None:
    """Return what information promises of one run of a card that has no design; None if it says nothing."""
    if card.status == "refused":
        return None
    spec, wanted = card.spec, dict(card.spec.accuracy_percent)
    names = tuple(wanted) or spec.estimated or needed_parameters(spec.plane, spec.controls, False, ())
    asked = spec.model_copy(update={"repeats": None, "accuracy_percent": dict.fromkeys(names, 100.0)})
    try:
        inputs, held = scaled(spec.input, card.factor), plan.scenario.held_ms
        _, reached = reach(plan.aircraft, card.point, asked, inputs, plan.suite, held)
    except Refusal:
        return None
    believed = _read(card.point.model, card.point.trimmed, plan, card)
    rows = [r for r in reached if believed.get(r.name)]
    if not rows:
        return None
    values = np.array([believed[r.name] for r in rows])
    goal = np.array([wanted.get(r.name, np.nan) / 100.0 for r in rows]) * np.abs(values)
    one = np.array([r.one for r in rows]) * np.abs(values)
    return Promise(tuple(r.name for r in rows), values, goal, one, {}, card.point.V_m_s, card.point.h_m)


def _at_trim(records: Sequence[FlightRecord], name: str) -> float | None:
    """Return the mean of a channel over the undisturbed flight of prepared records: what was removed from them."""
    values = [r.provenance["prepared"]["removed"][name] for r in records if name in r]
    return float(np.mean(values)) if values else None


def _recorded(plan: Plan, card: Card, V: float | None, h: float | None) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return target -> believed value at the recorded speed and height over that at the card's, and notes."""
    if V is None:
        return {}, (
            "no airspeed was logged: values are compared with those of the a-priori model at the speed of the card",
        )
    try:
        there = _believed(plan, card, V, card.point.h_m if h is None else h)
    except Refusal as error:
        return {}, (f"{plan.aircraft.name} does not trim at the recorded {V:.3g} m/s ({one_line(error.message)})",)
    return _ratios(there, _read(card.point.model, card.point.trimmed, plan, card)), ()


def _at_card(plan: Plan, card: Card, promise: Promise) -> tuple[Promise, tuple[str, ...]]:
    """Return the promise of a design at the speed and height of a card, relative errors as they are, and notes."""
    V, h = promise.V_m_s, promise.h_m
    if card.point.V_m_s == V and h == card.point.h_m:
        return promise, ()
    told = f"its design is for {V:g} m/s and {h:g} m: what it promises is taken in proportion"
    try:
        ratios = _ratios(_read(card.point.model, card.point.trimmed, plan, card), _believed(plan, card, V, h))
    except Refusal:
        return promise, (told,)
    by = np.array([ratios.get(name, 1.0) for name in promise.names])
    size, realised = np.abs(by), promise.realised
    if realised is not None:
        found = replace(realised.found, errors=realised.found.errors * by, stated=realised.found.stated * size)
        realised = replace(realised, promised=realised.promised * size, found=found)
    changed = {"values": promise.values * by, "wanted": promise.wanted * size, "promised": promise.promised * size}
    return replace(promise, **changed, realised=realised), (told,)


def _believed(plan: Plan, card: Card, V: float, h: float) -> dict[str, float]:
    """Return derivatives and modes of the believed aircraft at a speed and height.

    Raises:
        TestbenchError: it does not trim there.
    """
    trimmed = trim(plan.aircraft, FlightCondition(V, h))
    return _read(linearise(plan.aircraft, trimmed), trimmed, plan, card)


def _read(model: LinearModel, trimmed: TrimmedFlight, plan: Plan, card: Card) -> dict[str, float]:
    """Return name -> value of the derivatives, and of frequency and damping ratio of the modes of a card's motion."""
    out = {d.name: d.held if d.static is None else d.static for d in dimensional_derivatives(model, trimmed)}
    for name, pole in modes_of(model, plan.aircraft, card.spec.plane).items():
        out[f"wn of {name}"], out[f"zeta of {name}"] = abs(pole), -pole.real / max(abs(pole), 1e-300)
    return out


def _ratios(values: Mapping[str, float], of: Mapping[str, float]) -> dict[str, float]:
    return {name: value / of[name] for name, value in values.items() if of.get(name)}


def _estimates(case: Case, derivatives: Sequence[FoundDerivative], promise: Promise | None) -> dict[str, Estimate]:
    """Return target -> estimate; without a promise the targets are all derivatives."""
    model = case.model
    assert isinstance(model, ParametricModel)
    own = {d.name: d for d in derivatives if d.case == 0}
    names = tuple(own) if promise is None else promise.names
    modes = {} if promise is None else promise.modes
    known = tuple(n for n in names if n in own or any(n.endswith(f" of {m}") for m in modes))
    if not known:
        return {}
    read = _Reading(known, modes)
    values, stds = read.of(model)
    scatter = _scatter(case, read, values) if len(case.identification) > 1 else np.ones(len(known))
    out = {}
    for name, value, std, factor in zip(known, values.tolist(), stds.tolist(), scatter.tolist(), strict=True):
        believed = own[name].believed if name in own else "determined" if math.isfinite(std) else "weak"
        if believed in ("determined", "in doubt") and std * factor > CRITERIA.weak * abs(value):
            believed = "weak"
        out[name] = Estimate(value, std, factor, believed)
    return out


@dataclass(frozen=True, eq=False)
class _Reading:
    """Targets read off models: parameters by name, modes by the pole that lies nearest to the believed one."""

    names: tuple[str, ...]
    modes: Mapping[str, complex | tuple[complex, complex]]

    def of(self, model: ParametricModel) -> tuple[FloatArray, FloatArray]:
        """Return values (t,) and stated standard errors (t,); NaN where a mode is not there."""
        params, structure = model.params, cast("Any", model.structure)
        if self.modes:
            t = len(self.names)
            read = Targets(self.names, np.zeros(t), np.zeros(t), np.zeros((t, params.size)), self.modes)
            values = read.at(structure, params)
            slopes = read.slopes(structure, params, np.flatnonzero(np.diag(model.covariance) > 0.0).tolist())
        else:
            at = [structure.parameter_names.index(n) for n in self.names]
            values, slopes = params[at], np.eye(params.size)[at]
        variance = np.einsum("ti,ij,tj->t", slopes, model.covariance, slopes)
        return values, np.sqrt(np.maximum(variance, 0.0))


def _bends(card: Card, case: Case, promise: Promise) -> dict[str, float]:
    """Return target -> what the estimator finds in the expected response less the believed value.

    The simulator has all the aircraft's nonlinearity, and the speed changes in it; instruments are perfect, the air is
    still. Nothing is known where the response lacks what was logged, or gives no estimate.
    """
    truth = card.expected
    told = {}
    for name in case.model.inputs:
        control = name.removesuffix("_cmd")
        if name.endswith("_cmd") and control in card.signal.channels:
            told[name] = card.point.trimmed.controls[control] + card.signal.at(card.t_s, [control])[:, 0]
    record = replace(truth.with_columns(told), kind="measured")
    assert isinstance(case.model, ParametricModel)
    names = tuple(n for n in promise.names if n in case.model.structure.parameter_names)
    if not names or any(n not in record for n in (*case.model.inputs, *case.model.outputs)):
        return {}
    still = max(card.spec.settle_s, 2.0 * truth.dt_s)
    try:
        model = estimate(
            case.estimator, [prepared(record, still, Preparation())], case.model.inputs, case.model.outputs
        )
    except Refusal:
        return {}
    assert isinstance(model, ParametricModel)
    believed = dict(zip(promise.names, promise.values.tolist(), strict=True))
    return {n: model.values[n] - believed[n] for n in names}


def _scatter(case: Case, read: _Reading, values: FloatArray) -> FloatArray:
    """Return the factors (t,) by which the runs' own estimates differ more than their errors; 1 where by no more."""
    found, errors = [], []
    for record in case.identification:
        try:
            model = estimate(case.estimator, [record], case.model.inputs, case.model.outputs)
        except Refusal:
            continue
        assert isinstance(model, ParametricModel)
        one, std = read.of(model)
        found.append(one)
        errors.append(std)
    if len(found) < 2:
        return np.ones(values.size)
    x, s = np.array(found), np.array(errors)
    with np.errstate(divide="ignore", invalid="ignore"):
        weight = 1.0 / s**2
        mean = np.sum(weight * x, axis=0) / np.sum(weight, axis=0)
        total = np.sum(weight * (x - mean) ** 2, axis=0)
    dof = len(x) - 1
    beyond = np.nan_to_num(total) > chi2.ppf(1.0 - FALSE_ALARM, dof)
    return np.where(beyond, np.sqrt(np.nan_to_num(total) / dof), 1.0)
