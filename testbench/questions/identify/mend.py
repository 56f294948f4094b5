"""Models of recorded flights, mended where that helps: cures of a fit, flights of what was found, errors that hold all.

Errors of instruments and of the form of a model are in its covariance; a cure that was tried and helps stands in place
of what it cures.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from testbench.core.advice import note
from testbench.core.errors import Refusal
from testbench.core.record import FlightRecord
from testbench.estimators import estimate
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.settings import OutputErrorEntry, Settings
from testbench.estimators.structured import Structured
from testbench.evaluation import evaluate
from testbench.inference.causes import with_causes
from testbench.inference.considered import considered
from testbench.inference.form import formed
from testbench.inference.instruments import Agreement, InstrumentFault
from testbench.inference.reflown import Reflown, reflown
from testbench.inference.remedies import Rival, Tried, mended, mixed
from testbench.line import Case, Report
from testbench.questions.identify.answer import tried_in_words
from testbench.questions.identify.scenario import RecordDescription


def mended_cases(
    cases: Sequence[Case], gusts: bool | None
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
                why = note("replaced", f"{other.label} fits better, and its estimates replace those of this one")
                case = replace(case, model=replace(case.model, advice=(why,)))
        out.append(case)
    return tuple(out), frozenset(replaced), said, rivals


def _cured(
    entry: OutputErrorEntry, model: ParametricModel, case: Case, gusts: bool | None
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


def flown_again(cases: Sequence[Case], replaced: Collection[int], again: int | None, say: Report) -> dict[int, Reflown]:
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
                lambda done, of: say(f"simulate flights of the estimated model ({done} of {of})"),
            )
        except Refusal:
            continue
        if found is not None:
            out[i] = found
    return out


class Believed(NamedTuple):
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


def in_doubt_of_all(case: Case, believed: Believed, rivals: Sequence[Rival]) -> Case:
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
