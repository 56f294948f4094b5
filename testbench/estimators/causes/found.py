"""A cause that was found, and what is said of it: how bad it is, and what to do."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from testbench.core.advice import Advice, Severity, ranked
from testbench.estimators.model import IdentifiedModel
from testbench.estimators.parametric.model import ParametricModel

_ERRORS = 4.0  # standard errors of shift beyond which an estimate is wrong if it moves by _TENTH as well
_TENTH = 0.1  # relative
_UNMOVED = 0.05  # standard errors of shift that are no shift
_HARDLY = 2.0  # standard errors of shift that a 95 % interval holds: below them a cause is only worth a note
_SCATTER = 3.0  # the same for what scatter alone may do to any of some five estimates in a hundredth of flights
_MOST = 0.5  # share of the residuals beyond which missing dynamics make a model wrong, and any cause a doubt
_LITTLE = 0.02  # relative shift of the poles below which it is, where there are no standard errors
SLOW = "slow motion"


class Found(NamedTuple):
    """A cause: its code, whom it concerns, what it explains of the residuals, and how far it shifts the estimates.

    Attributes:
        code: "delay", "lag", "held", "bend", "drift", "order_too_low", "closed_loop".
        subject: input or output; empty where all are concerned.
        amount: seconds of delay, lag or half a hold, else 0.
        share: of the squared residuals, or for feedback of what is new in the input, that it explains.
        errors: largest shift of a parameter over its standard error; NaN without standard errors.
        moved: name of that parameter; without standard errors the pole that moves most and its shift, in words.
        relative: its shift over its value; without standard errors that of the pole that moves most.
        statistic: likelihood ratio 2 ln L.
        degrees: of freedom.
    """

    code: str
    subject: str
    amount: float
    share: float
    errors: float
    moved: str
    relative: float
    statistic: float
    degrees: int


def _bears_feedback(model: IdentifiedModel) -> bool:
    """Return whether a loop does not bias the method: it estimates gusts and leaves nothing of them in what is new."""
    return model.method == "filter_error" and "coloured_residuals" not in {a.code for a in ranked(model.advice)}


def in_words(model: IdentifiedModel, c: Found) -> Advice:
    """Return what a cause does, by how much, and what to do, with its rank."""
    slow = "phugoid" if {"V", "u", "w", "alpha", "q", "theta", "az"} & set(model.outputs) else "spiral"
    said = {
        "delay": f"{c.subject} acts some {c.amount:.2g} s later than the model takes it to",
        "lag": f"{c.subject} acts through a lag of some {c.amount:.2g} s, as of a servo, that the model lacks",
        "held": (
            f"{c.subject} acts half a sample later than straight lines between its samples, as if held from one to the "
            "next"
        ),
        "bend": f"the response bends: it is not linear in {c.subject}",
        "drift": (
            "the outputs move slowly in a way that the model does not follow: biases or drifts of the sensors, or a "
            f"slow mode that it lacks, such as the {slow}, which this record does not tell apart"
            if c.subject == SLOW
            else "the outputs carry biases or drifts that the model does not estimate"
        ),
        "far_from_best": (
            "a model of the same kind follows the records better in free run: noise of the outputs has moved these "
            "estimates"
        ),
        "coloured_residuals": (
            f"the innovations of {c.subject} are not white: gusts, or noise of the sensors that is slower than the "
            "model's states, move the poles beyond their scatter in white noise"
        ),
        "order_too_low": "the outputs follow the inputs through dynamics that the model lacks",
        "closed_loop": f"{c.subject} reacts to the outputs (closed loop), and the residuals are coloured",
    }[c.code]
    part = "of what is new in it" if c.code == "closed_loop" else "of the residuals"
    verb = "the residuals explain" if c.code == "closed_loop" else "this explains"
    # estimates far from the best of their kind may fit better by another step than by the cause: no share is said then
    explained = f": {verb} {100.0 * c.share:.0f} % {part}" if c.share > 0.005 else ""
    if c.code == "closed_loop" and _bears_feedback(model):
        return Advice(f"{said}{explained}; {model.method} as it is set here is not biased by it", "note", c.code)
    return Advice(f"{said}{explained}{_shifted(c)}; {_remedy(model, c)}", _severity(c), c.code)


def _shifted(c: Found) -> str:
    if np.isfinite(c.errors) and c.moved:
        if c.errors < _UNMOVED:
            return f", and it shifts no parameter by more than {_UNMOVED:g} of its standard errors"
        share = f"{100.0 * c.relative:.0f} %" if c.relative <= 1.0 else "more than its value"
        errors = float(f"{c.errors:.2g}")  # 210, not 2.1e+02
        return f", and it shifts {c.moved} by some {errors:g} of its standard errors ({share})"
    if not np.isfinite(c.relative):
        return ""
    # percent of a pole near the origin say nothing
    return f", and it shifts {f'a pole by some {100.0 * c.relative:.0f} %' if c.relative <= 1.0 else c.moved}"


def _severity(c: Found) -> Severity:
    by_shift = _severity_of_shift(c)  # which knows no bias that a loop gives to the best of the kind as well
    return "doubt" if by_shift == "note" and (c.share > _MOST or c.code == "closed_loop") else by_shift


def _severity_of_shift(c: Found) -> Severity:
    if c.code == "coloured_residuals":
        return "doubt"
    if c.code == "order_too_low":
        return "wrong" if c.share > _MOST else "doubt"
    if np.isfinite(c.errors):
        if c.errors > _ERRORS and c.relative > _TENTH:
            return "wrong"
        # the best of the kind lies within the scatter of a method that is less efficient, by chance beyond two errors
        return "doubt" if c.errors > (_SCATTER if c.code == "far_from_best" else _HARDLY) else "note"
    return "wrong" if c.relative > _TENTH else "doubt" if c.relative > _LITTLE else "note"


def _remedy(model: IdentifiedModel, c: Found) -> str:
    structured, time = isinstance(model, ParametricModel), f"{c.amount:.2g}"
    if c.code in ("delay", "lag"):
        way = f"set delays_s = {{{c.subject} = {time}}}" if structured else f"give the input {time} s later"
        return f"{way}, or take the position of the surface as the input instead of its command"
    if c.code == "held":
        names = ", ".join(f'"{name}"' for name in c.subject.split(", "))
        return f"set held = [{names}] if a computer made it; a delay of {time} s looks alike"
    if c.code == "bend":
        way = "a structure whose aerodynamics bend" if structured else "a model that bends"
        return f"fly smaller inputs, use the part of the record where {c.subject} stays small, or take {way}"
    if c.code == "drift" and c.subject == SLOW:
        return "estimate offsets where the method can, free the slow mode or raise the order, and see which fits"
    if c.code == "drift":
        if structured:
            return "name the outputs in output_biases and output_trends, or remove the drift"
        have = {"dsr_e", "moesp", "n4sid", "cva", "dsr", "ssarx", "pbsid_opt"}
        if model.method in have:
            return 'set offset = "trend", or remove the drift'
        return "remove biases and drifts from the records first, or estimate them where the method can"
    if c.code == "coloured_residuals":
        return "compare a higher order and prediction_error with disturbances"
    if c.code == "far_from_best":
        return "refine them by " + ("output_error" if structured else "prediction_error")
    if c.code == "order_too_low":
        return "free what is fixed or take a structure with more states" if structured else "raise the order"
    return (
        "take a method that is consistent in closed loop (filter_error with process noise; prediction_error with "
        "disturbances, ssarx or pbsid_opt with closed_loop = true, of an order that holds the gusts as well), and "
        "excite the loop by a signal of its own"
    )
