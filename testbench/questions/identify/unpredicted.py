"""Models whose derivatives the data decide and that still do not predict the records kept back: by how much, and why.

The predicted records give each model their own initial state, and its own constants, so that neither is to blame. What
is tried, in this order: a control that rested before, deflections beyond those of the fit, what a constant or a line
for each output would explain, and the same estimator on the records kept back alone.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from testbench.core.constants import DEG_RAD
from testbench.core.errors import Refusal
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.relative import percent_in_words
from testbench.estimators import estimate
from testbench.estimators.parametric.model import ParametricModel
from testbench.evaluation import evaluate
from testbench.line import Case
from testbench.logs.noise import white_std
from testbench.page.labels import number

MISSED_PERCENT = 50.0
"""MRSE of an output of the validation records, beyond its noise, from which a model does not predict them; judged."""
_RESTS = 0.05  # of the range that a control has in the other records: below it, it rests
_BEYOND = 1.5  # times the largest deflection of the records of the fit
_EXPLAINED = 0.5  # of the energy of the error, from which a constant or a line is the cause
_MOVED = 3.0  # errors between two estimates of one derivative
_NAMED = 3
_AS_BAD = 2.0  # times the error in the records of the fit, up to which a prediction is as bad there


@dataclass(frozen=True)
class Missed:
    """A model that does not predict its validation records."""

    case: int  # index of the model's case
    outputs: dict[str, float]  # output -> MRSE there, percent, of those that are missed
    why: str  # the cause, in a sentence

    def in_words(self) -> str:
        """Return which outputs are missed and by how much."""
        listed = ", ".join(f"{name} {percent_in_words(error)}" for name, error in self.outputs.items())
        return f"the model does not predict its validation records: MRSE of {listed}"


def missed(cases: Sequence[Case], inputs: Sequence[str], decided: Collection[int]) -> tuple[Missed, ...]:
    """Return the models with derivatives that do not predict the records kept back, each with the cause.

    Args:
        cases: of one description.
        inputs: of its models.
        decided: indices of the cases of which the data decide some derivative; of others that is said first.
    """
    out = []
    for i, case in enumerate(cases):
        scores = case.evaluation.validation
        if i not in decided or not isinstance(case.model, ParametricModel) or not scores.predictions:
            continue
        errors = dict(zip(case.model.outputs, _beyond_noise(case).tolist(), strict=True))
        bad = {o: e for o, e in errors.items() if e > MISSED_PERCENT and o not in case.evaluation.untested}
        if bad and not _disturbed(case, bad):
            out.append(Missed(i, bad, _why(case, list(bad), inputs)))
    return tuple(out)


def _beyond_noise(case: Case) -> FloatArray:
    """Return the MRSE (p,) of the records kept back, percent, less the white noise of the errors."""
    scores, outputs = case.evaluation.validation, case.model.outputs
    if scores.rms_error is None:
        return scores.mrse_percent
    errors = []
    for record, predicted in zip(case.validation, scores.predictions, strict=True):
        part = record.select(outputs)
        errors += [np.where(part.valid, part.data - predicted, np.nan), np.full((1, len(outputs)), np.nan)]
    noise = np.array([white_std(error) for error in np.vstack(errors).T])
    left = 1.0 - (noise / np.maximum(scores.rms_error, 1e-300)) ** 2
    return np.asarray(scores.mrse_percent * np.sqrt(np.clip(left, 0.0, 1.0)))


def _disturbed(case: Case, bad: Mapping[str, float]) -> bool:
    """Return whether a filter counted on what moves the outputs: predicted without it, the fit is as bad.

    A prediction from the inputs alone leaves the process noise out, so its error says nothing against the derivatives.
    """
    fit = dict(zip(case.model.outputs, case.evaluation.identification.mrse_percent.tolist(), strict=True))
    noisy = bool(case.model.settings.get("process_noise"))
    return noisy and all(error < _AS_BAD * fit[o] for o, error in bad.items())


def at_rest(cases: Sequence[Case]) -> bool:
    """Return whether no control of any model moves in the records kept back, which then test nothing."""
    kept = [case for case in cases if case.validation]
    return bool(kept) and all(_ranges(case.validation, n) == 0.0 for case in kept for n in case.model.inputs)


def _why(case: Case, bad: Sequence[str], inputs: Sequence[str]) -> str:
    fit = case.evaluation.identification.mrse_percent
    poor = [o for o, e in zip(case.model.outputs, fit, strict=True) if o in bad and e > MISSED_PERCENT]
    if poor:
        return (
            f"nor does it predict the records that it was fitted to ({', '.join(poor)}): the structure lacks the cause "
            "of their motion, such as gusts, an input that was not measured, or a mode"
        )
    for name in case.model.inputs:
        here, there = _ranges(case.validation, name), _ranges(case.identification, name)
        if here > 0.0 and there < _RESTS * here:
            return (
                f"{name} moves in them and rests in the records of the fit, which give no information on its "
                "derivatives"
            )
    for name in case.model.inputs:
        here, there = _largest(case.validation, name), _largest(case.identification, name)
        if here > _BEYOND * there:
            return (
                f"{name} moves by {number(here / DEG_RAD, 2)} deg in them and by {number(there / DEG_RAD, 2)} deg in "
                "the records of the fit: the aircraft may be nonlinear over this range"
            )
    for order, what in ((0, "a constant"), (1, "a line")):
        share = _explained(case, bad, order)
        if share > _EXPLAINED:
            return (
                f"{what} in each output explains {100.0 * share:.0f} % of the error: trim or bias of a sensor differs "
                "in them; name the outputs in output_biases"
                + (" and output_trends" if order else "")
                + ", or take the trim of each record out (trim_s)"
            )
    return _refitted(case, bad, inputs)


def _refitted(case: Case, bad: Sequence[str], inputs: Sequence[str]) -> str:
    """Return what the same estimator finds in the records kept back alone."""
    first: Any = case.model
    try:
        other: Any = estimate(case.estimator, case.validation, inputs, case.model.outputs)
        scores = evaluate(other, case.validation, []).identification
    except Refusal:
        return (
            "the same estimator finds no model in them alone: they contain too little motion, or a motion that the "
            "structure does not describe"
        )
    errors = dict(zip(other.outputs, scores.mrse_percent.tolist(), strict=True))
    still = [o for o in bad if errors[o] > MISSED_PERCENT]
    if still:
        return (
            f"no values of these derivatives reproduce {', '.join(still)} there: the structure lacks the cause of "
            "their motion, such as gusts, an input that was not measured, or a mode"
        )
    apart = [
        (abs(other.values[n] - v) / spread, n)
        for n, v in first.values.items()
        if n in other.values
        and not n.endswith("_0")
        and (spread := float(np.hypot(first.standard_errors[n], other.standard_errors[n]))) > 0.0
    ]
    named = [n for size, n in sorted(apart, reverse=True) if size > _MOVED][:_NAMED]
    if not named:
        return "fitted to them alone the derivatives are the same within their errors: their constants differ"
    listed = ", ".join(f"{n} would be {number(other.values[n])}, not {number(first.values[n])}" for n in named)
    return (
        f"fitted to them alone {listed}: speed, mass, centre of gravity or the scale of a sensor differs in them; "
        "identify each separately, or pool them"
    )


def _ranges(records: Sequence[FlightRecord], name: str) -> float:
    return max((float(np.ptp(record[name])) for record in records), default=0.0)


def _largest(records: Sequence[FlightRecord], name: str) -> float:
    return max((float(np.max(np.abs(record[name] - np.median(record[name])))) for record in records), default=0.0)


def _explained(case: Case, outputs: Sequence[str], order: int) -> float:
    """Return the share of the error of some outputs that a polynomial of that order in each record explains, 0 to 1."""
    before, after = 0.0, 0.0
    for record, predicted in zip(case.validation, case.evaluation.validation.predictions, strict=True):
        part = record.select(case.model.outputs)
        for k, name in enumerate(case.model.outputs):
            taken = part.valid[:, k]
            error: FloatArray = (part.data[:, k] - predicted[:, k])[taken]
            if name not in outputs or error.size <= order + 1 or not np.all(np.isfinite(error)):
                continue
            size = float(np.mean(part.data[taken, k] ** 2)) or 1.0  # of each output alike
            fitted = np.polynomial.Polynomial.fit(record.t_s[taken], error, order)(record.t_s[taken])
            before += float(np.sum(error**2)) / size
            after += float(np.sum((error - fitted) ** 2)) / size
    return 1.0 - after / before if before > 0.0 else 0.0
