"""The answer of an identification: which derivatives the data decide first, then doubts, then what a run says."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.constants import DEG_RAD
from testbench.core.errors import ScenarioError, nearest
from testbench.core.record import FlightRecord
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.settings import OutputErrorEntry
from testbench.estimators.structured import Servo, Structured
from testbench.inference.reflown import Reflown
from testbench.inference.remedies import COLOUR, Tried, wanting
from testbench.line import Case
from testbench.page.labels import number
from testbench.page.words import Line, counted, listed, sentence, some
from testbench.questions.identify.derivatives import FoundDerivative
from testbench.questions.identify.instruments import agreement_in_words, corrected_in_words
from testbench.questions.identify.result import Identified
from testbench.questions.identify.scenario import STATED_STD, RecordDescription
from testbench.questions.identify.unpredicted import at_rest
from testbench.questions.run.answer import run_answer
from testbench.questions.run.labels import case_names

if TYPE_CHECKING:
    from testbench.inference.reflown import Reflown
    from testbench.questions.identify.derivatives import FoundDerivative
    from testbench.questions.identify.result import Identified

_MOST = 6
_LEADING = 4  # derivatives that the first sentence names, so that it can be read at once


def identify_answer(found: Identified) -> list[Line]:
    """Return the derivatives of each model with errors, those that are not to be believed, doubts, notes, the fit."""
    lines: list[Line] = []
    names = case_names(found.cases)
    if found.instruments is not None and found.contradicted:
        lines.append(Line("lead", sentence(agreement_in_words(found.instruments)[0])))
        fault = found.instruments.fault
        if fault is not None and found.corrected:
            lines.append(Line("finding", sentence(corrected_in_words(fault, found.derivatives, found.corrected))))
    for m in found.missed:
        of = f"{names[m.case]}: " if len(found.cases) > 1 else ""
        lines.append(Line("finding" if lines else "lead", sentence(f"{of}{m.in_words()}")))
        lines.append(Line("wrong", sentence(f"do not use: {of}{m.why}")))
    for i in dict.fromkeys(d.case for d in found.derivatives if d.case not in found.replaced):
        own = [d for d in found.derivatives if d.case == i]
        good, bad = [d for d in own if d.determined], [d for d in own if not d.determined]
        of = f"{names[i]}: " if len({d.case for d in found.derivatives} - found.replaced) > 1 else ""
        text = f"{of}{len(good) or 'none'} of {counted(len(own), 'derivative')} determined"
        if good:
            text += f": {some([_said(d) for d in good], _LEADING, ', ')}"
        lines.append(Line("finding" if lines else "lead", sentence(text)))
        if good[_LEADING:]:
            also = some([_said(d) for d in good[_LEADING:]], _MOST, ", ")
            lines.append(Line("finding", sentence(f"{of}also determined: {also}")))
        changed = [d for d in good if d.changed]
        if changed:
            lines.append(Line("finding", sentence(f"changed: {some([_changed(d) for d in changed], _MOST, ', ')}")))
        if bad:
            lines.append(
                Line(
                    "finding",
                    sentence(f"not determined by these data: {', '.join(f'{d.name} ({d.believed})' for d in bad)}"),
                )
            )
    lines += [Line("finding", sentence(f"{names[i]}: {_again(f)}")) for i, f in found.again.items()]
    if not lines and _asked(found):
        lines.append(Line("lead", "No derivative was found: no estimator with a structure gave a model."))
    lines += [Line(text.severity, sentence(text)) for text in found.doubts]
    lines += [Line("note", sentence(text)) for text in found.notes]
    rest = run_answer(found)
    if not any(line.kind == "lead" for line in lines):
        return rest[:1] + lines + rest[1:]
    return lines + [Line("finding" if a == "lead" else a, b) for a, b in rest]


def _asked(found: Identified) -> bool:
    """Return whether derivatives were asked for: by an estimator of a structure, or by an aircraft to compare with."""
    asked = found.source.identification.estimators
    return found.before is not None or any(getattr(e, "structure", None) is not None for e in asked)


def _again(flights: Reflown) -> str:
    """Return what flights of what was found say of its errors."""
    own = [k for k, name in enumerate(flights.names) if not name.endswith("_0")]
    held = 100.0 * flights.held[own]
    more = [flights.names[k] for k in own if flights.added[k] > 0.0]
    out = (
        f"in {len(flights.estimates)} simulated flights of the estimated model, with the noise of the residuals, 95 % "
        f"intervals contain the truth in {held.mean():.0f} % (least: {flights.names[own[int(np.argmin(held))]]}, "
        f"{held.min():.0f} %), and some derivative has an error of more than four of its standard errors in "
        f"{100.0 * flights.wrong:.0f} %"
    )
    if more:
        out += f"; errors of {listed(more)} are widened accordingly"
    return out + (f"; {flights.failed} more gave no estimate" if flights.failed else "")


def _said(d: FoundDerivative) -> str:
    return f"{d.name} {number(d.value)} ± {number(d.std, 2)}"


def _changed(d: FoundDerivative) -> str:
    assert d.before is not None
    return f"{d.name} {number(d.value)}, was {number(d.before)}"


def tried_in_words(case: Case, tried: Sequence[Tried]) -> list[str]:
    """Return which cures were tried of a fit whose residuals are not noise, and what they brought."""
    if not tried or not isinstance(case.model, ParametricModel):
        return []
    taken = [f"{t.name} ({t.gain:+.3g})" for t in tried if t.taken]
    others = [
        f"{t.name} ({t.gain:+.3g})" if math.isfinite(t.gain) else f"{t.name} (no fit)" for t in tried if not t.taken
    ]
    hidden = any(t.taken and t.name == "gusts" for t in tried)
    late = "light gusts are hidden in its noise" if hidden else "a control acts late"
    what = "its residuals are not white noise" if wanting(case.model) else late
    out = f"{case.label}: {what}. "
    if taken:
        out += (
            f"{listed(taken)} {'mend' if len(taken) > 1 else 'mends'} this (ln of the evidence) and are included in "
            "the model"
        )
    elif tried[-1].name == COLOUR and tried[-1].gain > 0.0:
        out += f"{tried[-1].name} ({tried[-1].gain:+.3g}) explains them better than gusts, and the errors include it"
        others.pop()
    else:
        out += "no remedy was found"
    return [out + (f"; tried without help: {listed(others)}" if others else "")]


def ignored_servos(cases: Sequence[Case]) -> list[str]:
    """Return the commands that are taken for surfaces, knowingly or by a method that tries no servo."""
    out = dict[str, None]()
    for entry, inputs in ((c.estimator, c.model.inputs) for c in cases if isinstance(c.estimator, Structured)):
        servos = {n: entry.servo.get(n) for n in inputs if n.endswith("_cmd") and n not in {"thr_cmd", *entry.delays_s}}
        untried = not isinstance(entry, OutputErrorEntry)
        out |= dict.fromkeys(n for n, servo in servos.items() if (servo.ignore if servo else untried))
    return list(out)


def limits_met(servos: Mapping[str, Servo], estimated: Sequence[str], records: Sequence[FlightRecord]) -> list[str]:
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


def simulated_in_words(description: RecordDescription, derivatives: Sequence[FoundDerivative]) -> list[str]:
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
        f"errors of {larger} are those of {description.simulated_errors.source}, by [simulated_errors], and include "
        f"the mean error of all flights; the estimator alone states {stated}"
    ]


def notes_of(description: RecordDescription, cases: Sequence[Case], servos: Mapping[str, Servo]) -> list[str]:
    """Return what was recognised, taken from the aircraft and left out, in sentences."""
    out = []
    if not any(case.validation for case in cases):
        out.append("no record is held out: each model is judged only by the records that it was identified from")
    elif at_rest(cases):
        out.append(
            "no control moves in the held-out records, which are a weak test of the models: fly the manoeuvre again "
            "and hold that record out (use = 'validation')"
        )
    for case in cases:
        names = str(case.model.settings.get("held", "")).partition(" (recognised")
        if names[1]:
            out.append(f"recognised as held from sample to sample: {names[0]} (held = [] treats them as linear)")
    believed = description.believes(servos)
    for name, servo in servos.items():
        if name in believed and isinstance(servo.lag_s, float):
            out.append(
                f"the lag of {name} is estimated: {description.aircraft} states {servo.lag_s:.3g} s, which is its "
                f"prior (+- {STATED_STD * servo.lag_s:.2g} s) if prior_std is given"
            )
        else:
            out += passed(name, servo, description, cases)
    for case in cases:
        if isinstance(case.model, ParametricModel):
            unused = [n for n in description.outputs if n not in case.model.outputs]
            if unused:
                out.append(f"{case.model.structure.name} has no output {', '.join(unused)}: not used by it")
    return list(dict.fromkeys(out))


def passed(name: str, servo: Servo, description: RecordDescription, cases: Sequence[Case]) -> list[str]:
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
        passed = f"passes {stated}" if text is None else f"passes {text}, which replaces {stated}"
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
