"""Identify from recorded flights: read the records, run the estimators, judge the models."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbench.core.advice import doubt, note
from testbench.core.blas import on_one_thread
from testbench.core.constants import DEG_RAD
from testbench.core.errors import Refusal, ScenarioError, located, nearest
from testbench.core.named import Named, obtain
from testbench.core.record import FlightRecord
from testbench.estimators import estimate
from testbench.estimators.cells import FailedCell
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.settings import OutputErrorEntry, Settings
from testbench.estimators.structured import Servo, Structured
from testbench.evaluation import evaluate
from testbench.flight import load_aircraft
from testbench.inference.causes import with_causes
from testbench.inference.considered import considered
from testbench.inference.form import formed
from testbench.inference.instruments import Agreement, InstrumentFault, agreement, taken_for_sure, without_errors
from testbench.inference.reflown import Reflown, reflown
from testbench.inference.remedies import COLOUR, Rival, Tried, mended, mixed, wanting
from testbench.line import RECORDED, Case, Flight, Keep, Report, identify_and_judge
from testbench.logs.plausible import questions_of
from testbench.logs.read import read_records
from testbench.page.words import listed
from testbench.questions.identify.derivatives import FoundDerivative, before, found_derivatives, scaling_of, servos_of
from testbench.questions.identify.flown import flown_condition
from testbench.questions.identify.instruments import doubts_of, in_doubt, taken_in_words, widened
from testbench.questions.identify.result import Identified
from testbench.questions.identify.scenario import STATED_STD, RecordDescription
from testbench.questions.identify.unpredicted import at_rest, missed

_ESTIMATED = 3.0  # standard errors that an error must be to be taken out of the records


@on_one_thread
def identify(
    description: Named[RecordDescription],
    data_folder: Path | None = None,
    keep: Keep | None = None,
    progress: Report | None = None,
    strict: bool = False,
    again: int | None = 0,
) -> Identified:
    """Run the same estimators and evaluation on recorded flights, once their instruments are compared.

    Where kinematics contradict an instrument that the models use, no derivative is called determined; if its error is
    known well, the derivatives without it stand beside.

    Args:
        description: which file, column and unit is which channel.
        data_folder: where the files lie, instead of the folder that the description names.
        keep: called with a name and each record as soon as it has been read.
        progress: called with a few words as each stage begins.
        strict: refuse records with values that are hardly meant (``questions`` of the result).
        again: how many flights of each model by output error are identified again, to see whether its errors hold;
            None: as many as a second allows.

    Raises:
        TestbenchError: with the file and key of the description that it comes from. An estimator that gives no model is
            an entry of ``failed`` with its reason; only if none gives one it is an error.

    Example:
        >>> import testbench as tb
        >>> tb.identify(tb.load_description("attas_short_period"), data_folder).findings  # doctest: +SKIP
    """
    description = obtain(RecordDescription, description)
    say = progress or (lambda text: None)
    found = _identified(description, data_folder, keep or (lambda name, record: None), say, strict, again)
    fault = None if found.instruments is None else found.instruments.fault
    if not found.contradicted or fault is None or fault.name in description.correct:
        return found
    if not abs(fault.estimate) > _ESTIMATED * fault.std:
        return found
    say("identify once more without the error of the instrument")
    right = _identified(without(description, fault), data_folder, lambda name, record: None, lambda text: None, False)
    return replace(found, corrected=tuple(widened(fault, found.derivatives, right.derivatives)))


def _identified(
    description: RecordDescription,
    data_folder: Path | None,
    keep: Keep,
    say: Report,
    strict: bool,
    again: int | None = 0,
) -> Identified:
    """Return what is identified of the records as they are; no derivative is determined where kinematics contradict."""
    say("read records")
    read = [(n, use, without_errors(r, description.correct)) for n, use, r in read_records(description, data_folder)]
    for name, _, record in read:
        keep(f"{name}_recorded", record)
    say("compare the instruments with one another")
    known_std = description.instrument_std  # where nobody says how far they may err, they are taken as they read
    instruments = agreement([record for _, _, record in read], known_std)
    taken = taken_for_sure(instruments) if known_std else {}
    flights = [
        Flight(name, use, None, {RECORDED: without_errors(record, taken)}, description.trim_s)
        for name, use, record in read
    ]
    with located(description.file, "aircraft"):
        aircraft = None if description.aircraft is None else load_aircraft(description.aircraft)
    inputs = description.identification.inputs
    servos = {} if aircraft is None else servos_of(aircraft, inputs)
    records = [(flight.name, flight.measured[RECORDED]) for flight in flights]
    met = _limits_met(servos, description.believes(servos), [record for _, record in records])
    questions = questions_of(records, description.file, strict)
    failed: list[FailedCell] = []
    cases = identify_and_judge(
        flights,
        [RECORDED],
        description.preparation,
        description.asked_of(servos),
        description.file,
        say,
        causes=True,
        failed=failed,
    )
    say("try what may mend the fit")
    cases, replaced, cured, rivals = _mended(cases, instruments.gusts_felt)
    flown = flown_condition(description, cases[0].identification, aircraft, getattr(cases[0].estimator, "V_m_s", None))
    reflights = _flown_again(cases, replaced, again, say)
    if not instruments.contradicted:
        believed = _Believed(instruments, taken, description, flown.V_m_s or math.nan)
        cases = tuple(_in_doubt_of_all(case, believed, rivals.get(i, ())) for i, case in enumerate(cases))
    known = None if aircraft is None else before(aircraft, flown)
    say("weigh the derivatives")
    derivatives = found_derivatives(
        cases, known, scaling_of(flown, known), description.simulated_errors, replaced, reflights
    )
    found = Identified(
        description.name,
        description.title,
        description.question,
        description,
        0,
        tuple(flights),
        cases,
        failed=tuple(failed),
        reference=description.reference_values,
        derivatives=derivatives,
        before=known,
        flown=flown,
        notes=(
            *_simulated(description, derivatives),
            *_notes(description, cases, servos),
            *dict.fromkeys(
                f"flight only: of the log {text}"
                for _, record in records
                if (text := record.provenance.get("recorded", {}).get("not_flown"))
            ),
            *taken_in_words(instruments, taken),
            *cured,
            *(known.notes if known else ()),
            *flown.notes,
        ),
        doubts=(
            *(
                doubt("servo_ignored", f"{name}: a command is taken for the surface, as if no servo lay between")
                for name in _ignored(cases)
            ),
            *(doubt("rate_limit_met", text) for text in met),
        ),
        questions=questions,
        missed=missed(cases, inputs, {d.case for d in derivatives if d.determined}),
        instruments=instruments,
        replaced=replaced,
        again=reflights,
    )
    if not found.contradicted:
        return found
    doubts = (*found.doubts, *doubts_of(instruments))
    return replace(found, derivatives=in_doubt(derivatives, found.contradicted), doubts=doubts)


def _ignored(cases: Sequence[Case]) -> list[str]:
    """Return the commands that are taken for surfaces, knowingly or by a method that tries no servo."""
    out = dict[str, None]()
    for entry, inputs in ((c.estimator, c.model.inputs) for c in cases if isinstance(c.estimator, Structured)):
        servos = {n: entry.servo.get(n) for n in inputs if n.endswith("_cmd") and n not in {"thr_cmd", *entry.delays_s}}
        untried = not isinstance(entry, OutputErrorEntry)
        out |= dict.fromkeys(n for n, servo in servos.items() if (servo.ignore if servo else untried))
    return list(out)


def _mended(
    cases: Sequence[Case], gusts: bool
) -> tuple[tuple[Case, ...], frozenset[int], list[str], dict[int, tuple[Rival, ...]]]:
    """Return the cases, before each the one that mends it if a cure does, which were mended, what was tried, rivals."""
    out: list[Case] = []
    replaced: set[int] = set()
    said: list[str] = []
    rivals: dict[int, tuple[Rival, ...]] = {}
    for case in cases:
        if isinstance(case.estimator, OutputErrorEntry) and isinstance(case.model, ParametricModel):
            other, tried, rivals[len(out)] = _cured(case.estimator, case.model, case, gusts)
            said += tried_in_words(case, tried)
            if other is not None:
                out.append(other)
                replaced.add(len(out))
                why = note("replaced", f"{other.label} fits better, and what it finds is said instead")
                case = replace(case, model=replace(case.model, advice=(why,)))
        out.append(case)
    return tuple(out), frozenset(replaced), said, rivals


def _cured(
    entry: OutputErrorEntry, model: ParametricModel, case: Case, gusts: bool
) -> tuple[Case | None, tuple[Tried, ...], tuple[Rival, ...]]:
    """Return the case that a cure makes of one, None if none helps, what was tried, and rivals of what is believed."""

    def fit(other: Structured) -> ParametricModel:
        assert isinstance(other, Settings)
        found = estimate(other, case.identification, model.inputs, model.outputs, case.validation)
        assert isinstance(found, ParametricModel)
        return found

    other, better, tried, rivals = mended(entry, model, case.identification, fit, gusts)
    if better is model:
        return None, tried, rivals
    label = f"{entry.shown} with {' and '.join(t.name for t in tried if t.taken)}"
    try:
        best = with_causes(better, case.identification)
        scores = evaluate(best, case.identification, case.validation)
    except Refusal:  # it cannot fly its own records
        return None, tried, ()
    other = other.model_copy(update={"label": label})
    return replace(case, estimator=other, model=best, evaluation=scores), tried, rivals


def _flown_again(
    cases: Sequence[Case], replaced: Collection[int], again: int | None, say: Report
) -> dict[int, Reflown]:
    """Return case -> what flights of its model are identified as, of models by output error."""
    out: dict[int, Reflown] = {}
    for i, case in enumerate(cases):
        if again == 0 or not isinstance(case.model, ParametricModel) or i in replaced:
            continue
        try:
            found = reflown(
                case.model,
                case.identification,
                np.random.default_rng(0),
                again,
                lambda done, of: say(f"fly what was found again ({done} of {of})"),
            )
        except Refusal:
            continue
        if found is not None:
            out[i] = found
    return out


class _Believed(NamedTuple):
    """What is believed of the records of a description, and the airspeed at trim, m/s."""

    instruments: Agreement
    taken: Mapping[str, float]
    description: RecordDescription
    V_m_s: float

    def whole(self, linear: ParametricModel, records: Sequence[FlightRecord]) -> ParametricModel:
        """Return a model with derivatives at trim, and errors that hold those of instruments and of its form."""
        form, errors = self.description.form_std, self.description.instrument_std
        model = formed(linear, records, form, self.V_m_s) if form else linear
        if errors:
            found = considered(linear, records, self.instruments, self.taken, errors)
            model = replace(model, covariance=model.covariance + found.parameters_covariance)
        return model


def _in_doubt_of_all(case: Case, believed: _Believed, rivals: Sequence[Rival]) -> Case:
    """Return a case whose model has errors that hold those of instruments, of its form, and of what may be in it."""
    linear, records = case.model, case.identification
    if not isinstance(linear, ParametricModel):
        return case
    try:
        model = believed.whole(linear, records)
        if rivals:
            model = mixed(model, [replace(r, model=believed.whole(r.model, records)) for r in rivals])
        if np.array_equal(model.params, linear.params):  # it predicts what it did
            return replace(case, model=model)
        return replace(case, model=model, evaluation=evaluate(model, records, case.validation))
    except Refusal:  # what the records do not decide, its own advice says
        return case


def without(description: RecordDescription, fault: InstrumentFault) -> RecordDescription:
    """Return a description that takes an error of an instrument out of its records."""
    so_far = description.correct.get(fault.name, 0.0)
    size = (1.0 + so_far) * (1.0 + fault.estimate) - 1.0 if fault.kind == "scale" else so_far + fault.estimate
    return description.changed(correct={**description.correct, fault.name: size})


def _limits_met(servos: Mapping[str, Servo], estimated: Sequence[str], records: Sequence[FlightRecord]) -> list[str]:
    """Return sentences on stated rate limits that commands meet, of servos whose lag is estimated: it leaves them out.

    A lag of first order turns at most at the command's whole range over the lag.
    """
    out = []
    for name in estimated:
        lag, limit = servos[name].lag_s, servos[name].rate_limit_deg_s
        widest = max((float(np.ptp(r[name])) for r in records if name in r), default=0.0)
        if limit and isinstance(lag, float) and widest > limit * DEG_RAD * lag:
            out.append(
                f"{name} steps by up to {widest / DEG_RAD:.3g} deg, which meets the rate limit of its servo, "
                f"{limit:.3g} deg/s, and the estimated servo has none; give [servo.{name}] with lag_s = {lag:.3g} and "
                f"rate_limit_deg_s = {limit:.3g}"
            )
    return out


def tried_in_words(case: Case, tried: Sequence[Tried]) -> list[str]:
    """Return which cures were tried of a fit whose residuals are not noise, and what they brought."""
    if not tried or not isinstance(case.model, ParametricModel):
        return []
    taken = [f"{t.name} ({t.gain:+.3g})" for t in tried if t.taken]
    others = [
        f"{t.name} ({t.gain:+.3g})" if math.isfinite(t.gain) else f"{t.name} (no fit)" for t in tried if not t.taken
    ]
    what = "its residuals are not white noise" if wanting(case.model) else "a control acts late"
    out = f"{case.label}: {what}. "
    if taken:
        out += f"{listed(taken)} {'mend' if len(taken) > 1 else 'mends'} it (ln of the evidence) and stand in the model"
    elif tried[-1].name == COLOUR and tried[-1].gain > 0.0:
        out += f"{tried[-1].name} ({tried[-1].gain:+.3g}) explains them better than gusts, and the errors hold it"
        others.pop()
    else:
        out += "no cure was found"
    return [out + (f"; tried without help: {listed(others)}" if others else "")]


def _simulated(description: RecordDescription, derivatives: Sequence[FoundDerivative]) -> list[str]:
    """Return a sentence on the errors that are those of simulated flights, and what the estimators state instead.

    Raises:
        ScenarioError: the description gives an error of a derivative that no model has.
    """
    names = [d.name for d in derivatives]
    wrong = [name for name in description.known_errors if name not in names]
    if wrong:
        raise ScenarioError(
            [
                f"{description.file}, simulated_errors.errors.{name}: must be a derivative of a model that is "
                f"identified, got '{name}'{nearest(name, names)}"
                for name in wrong
            ]
        )
    found = [d for d in derivatives if d.simulated]
    if not found or description.simulated_errors is None:
        return []
    larger, stated = listed([d.name for d in found]), listed([f"{d.stated:.2g}" for d in found])
    return [
        f"errors of {larger} are those of {description.simulated_errors.source}, by [simulated_errors]: what lasts in "
        f"every flight is in them; the estimator alone states {stated}"
    ]


def _notes(description: RecordDescription, cases: Sequence[Case], servos: Mapping[str, Servo]) -> list[str]:
    """Return what was recognised, taken from the aircraft and left out, in sentences."""
    out = []
    if not any(case.validation for case in cases):
        out.append("no record is kept back: only those that a model was identified from judge it")
    elif at_rest(cases):
        out.append(
            "no control moves in the records kept back, which test the models little: fly the manoeuvre again and keep "
            "that one back (use = 'validation')"
        )
    for case in cases:
        names = str(case.model.settings.get("held", "")).partition(" (recognised")
        if names[1]:
            out.append(f"recognised as held from sample to sample: {names[0]} (held = [] takes them as linear)")
    believed = description.believes(servos)
    for name, servo in servos.items():
        if name in believed and isinstance(servo.lag_s, float):
            out.append(
                f"the lag of {name} is estimated: {description.aircraft} states {servo.lag_s:.3g} s, which counts as a "
                f"belief (+- {STATED_STD * servo.lag_s:.2g} s) where prior_std asks for one"
            )
        else:
            out += _passed(name, servo, description, cases)
    for case in cases:
        if isinstance(case.model, ParametricModel):
            unused = [n for n in description.outputs if n not in case.model.outputs]
            if unused:
                out.append(f"{case.model.structure.name} has no output {', '.join(unused)}: not used by it")
    return list(dict.fromkeys(out))


def _passed(name: str, servo: Servo, description: RecordDescription, cases: Sequence[Case]) -> list[str]:
    """Return which servo a command was passed through by the models, where the aircraft states one."""
    stated = f"the servo of {description.aircraft} ({_servo_in_words(servo)})"
    out: list[str] = []
    used: dict[str, str | None] = {}
    for case in cases:
        if not isinstance(case.estimator, Structured) or name not in case.model.inputs:
            continue
        own = case.estimator.servo.get(name)
        if own is None:
            late = case.estimator.delays_s.get(name)
            used[case.label] = None if late is None else f"a delay of {1e3 * late:.3g} ms alone"
        else:
            used[case.label] = None if own == servo else _servo_in_words(own)
    for text in dict.fromkeys(used.values()):
        of = [label for label, said in used.items() if said == text]
        which = f" in {', '.join(of)}" if len(of) < len(used) else ""
        passed = f"passes {stated}" if text is None else f"passes {text}, which stands in place of {stated}"
        out.append(f"{name} {passed}{which}")
    return out


def _servo_in_words(servo: Servo) -> str:
    if servo.ignore:
        return "no servo"
    parts = []
    if servo.lag_s is not None:
        parts.append("a lag to be estimated" if servo.lag_s == "estimate" else f"a lag of {servo.lag_s:.3g} s")
    if servo.wn_rad_s is not None:
        parts.append(f"a second order of {servo.wn_rad_s:.3g} rad/s")
    if servo.delay_s == "estimate":
        parts.append("a delay to be estimated")
    elif servo.delay_s:
        parts.append(f"a delay of {1e3 * servo.delay_s:.3g} ms")
    if servo.rate_limit_deg_s:
        parts.append(f"at most {servo.rate_limit_deg_s:.3g} deg/s")
    return ", ".join(parts)


def load_description(path: Path | str) -> RecordDescription:
    """Read a description of recorded flights; see :meth:`RecordDescription.load`.

    Example:
        >>> import testbench as tb
        >>> tb.load_description("attas_short_period").identification.inputs
        ('de',)
    """
    return obtain(RecordDescription, path)
