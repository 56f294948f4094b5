"""Why do the residuals of an identified model look as they do? The same causes, by the same tests, for every method.

The estimates are first taken to the best model of the same kind, by Gauss-Newton steps of the free run: what noise has
done to a method that it biases would else look like missing dynamics. Residuals of the free run are regressed on how
the model moves with its parameters (``tangent``) and on what a cause would leave, in noise that may be coloured
(``coloured_fit``):

==========  ============================================================================================
delay, lag  how the outputs move if an input acts later, or through a first-order lag
held        how well the records are followed if inputs are held from sample to sample
bend        quadratic and cubic terms of a simulated output, through the model's own slow modes
drift       a constant and a line per output and record
order       the inputs of the samples before, through any linear response
feedback    what is new in an input, against the residual of the same sample (``feedback``)
far         nothing of these, but the best of the kind is measurably better
colour      nothing of these, but the innovations are not white
==========  ============================================================================================

All regressors at once must explain more than chance gives in ``_SCREEN`` of records, which bounds the false alarms of
all of them together. Each is then tested by F at ``_CHANCE`` over their number (Bonferroni), in the noise that is left
beside all regressors, and must explain more than its degrees of freedom cost (G. Schwarz, Annals of Statistics 6,
1978). Bend and drift are tested beside any linear response, so that a delay is none of them; that with most left is the
first, what still explains something then the next. The coefficients of the parameters are one step towards the
estimates with the cause in the model: by how much the cause has shifted them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbench.core.advice import Advice, ranked
from testbench.core.blas import on_one_thread
from testbench.core.errors import Refusal
from testbench.core.record import FlightRecord
from testbench.estimators.causes.found import Found, in_words
from testbench.estimators.causes.leavings import Direction, all_poles, busiest, directions, gather
from testbench.estimators.causes.search import search
from testbench.estimators.model import IdentifiedModel

_LONGEST = 3000  # samples of all outputs looked at; of longer records the stretch where the inputs move most
_PER_UNKNOWN = 10.0  # valid output samples per unknown below which data are few
_ROUNDING = 1e-6  # residuals below this share of every output are no noise


@on_one_thread
def with_causes(model: IdentifiedModel, records: Sequence[FlightRecord]) -> IdentifiedModel:
    """Return the model with the causes of its residuals before its own advice, and in ``diagnostics["causes"]``.

    A model without known parameters, such as one of a user's own class, stays as it is, and so does one that cannot fly
    its records.

    Args:
        model: of any method.
        records: those it was identified from.

    Example:
        >>> import testbench as tb
        >>> model = tb.estimate("dsr_e", [record], ["de"], ["q"], past_horizon=20, future_horizon=20)  # doctest: +SKIP
        >>> [a.code for a in tb.with_causes(model, [record]).advice]  # doctest: +SKIP
        ['delay']
    """
    found = directions(model)
    if not found:
        return model
    try:
        advice, causes = _named(model, list(records), found)
    except Refusal:  # it diverges over its records, as its own advice says, or too few samples follow each other
        return model
    if not advice:
        return model
    named = {a.code for a in advice}
    if causes:  # a bend or a delay looks like feedback to the innovations of subspace methods, which know neither
        named.add("closed_loop")
    rest = [a for a in model.advice if getattr(a, "code", "") not in named]
    if any(a.severity != "note" for a in advice):
        rest = [_without_comfort(a) for a in ranked(rest)]
    return replace(
        model, advice=(*advice, *rest), diagnostics={**model.diagnostics, "causes": [c._asdict() for c in causes]}
    )


def _without_comfort(advice: Advice) -> Advice:
    """Return advice on coloured residuals without the word that errors are corrected: no correction holds a bias."""
    if advice.code != "coloured_residuals" or "corrected" not in advice:
        return advice
    said = f"{advice.rpartition(': ')[0]}: standard errors do not hold what the cause above has done"
    return Advice(said, advice.severity, advice.code)


def _named(
    model: IdentifiedModel, records: list[FlightRecord], found: list[Direction]
) -> tuple[list[Advice], list[Found]]:
    advice = _few(model, records, len(found))
    if advice:
        return advice, []
    data = gather(
        model, [busiest(r, model.inputs, _LONGEST // (len(records) * len(model.outputs))) for r in records], found
    )
    size = np.sqrt(np.mean(np.hstack([s.v for s in data.parts]) ** 2, axis=1))
    moved = np.sqrt(np.mean(np.vstack(data.simulated) ** 2, axis=0))
    if not np.all(np.isfinite(size)) or np.all(size <= _ROUNDING * moved):
        return [], []
    causes = search(model, data, found)
    return [in_words(model, c) for c in causes], causes


def _few(model: IdentifiedModel, records: Sequence[FlightRecord], unknowns: int) -> list[Advice]:
    states = len(all_poles(model))
    total = unknowns + states * len(records)
    values = sum(int(r.select(model.outputs).valid.sum()) for r in records)
    if values >= _PER_UNKNOWN * total:
        return []
    return [
        Advice(
            f"{values} output samples for {total} unknowns are few: what is wrong with the model would not show, and "
            "errors are known only roughly; give more records, or free fewer parameters",
            "doubt",
            "few_data",
        )
    ]
