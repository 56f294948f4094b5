"""The answer of an identification: which derivatives the data decide first, then doubts, then what a run says."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.page.labels import number
from testbench.page.words import Line, counted, listed, sentence, some
from testbench.questions.identify.instruments import agreement_in_words, corrected_in_words
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
            lines.append(
                Line("finding", sentence(f"not as before: {some([_changed(d) for d in changed], _MOST, ', ')}"))
            )
        if bad:
            lines.append(
                Line(
                    "finding",
                    sentence(f"not decided by these data: {', '.join(f'{d.name} ({d.believed})' for d in bad)}"),
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
        f"in {len(flights.estimates)} flights of what was found, with noise as it was left, 95 % intervals hold in "
        f"{held.mean():.0f} % (least: {flights.names[own[int(np.argmin(held))]]}, {held.min():.0f} %), and some "
        f"derivative is off by more than four of its errors in {100.0 * flights.wrong:.0f} %"
    )
    if more:
        out += f"; errors of {listed(more)} are widened to what these flights show"
    return out + (f"; {flights.failed} more gave no estimate" if flights.failed else "")


def _said(d: FoundDerivative) -> str:
    return f"{d.name} {number(d.value)} ± {number(d.std, 2)}"


def _changed(d: FoundDerivative) -> str:
    assert d.before is not None
    return f"{d.name} {number(d.value)}, was {number(d.before)}"
