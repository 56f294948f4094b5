"""The linkage of a control, tried in place of a wrong effectiveness of its surface.

The two are one but for the prior: Cm_de may be 1.4 times the believed one, or the linkage may turn the elevator 1.4
times as far. A descent hardly finds the second beside the first, as they change together along a curved valley. So the
linkage is tried with the factor that the coefficient came to.
"""

from __future__ import annotations

import math
from collections.abc import Container, Sequence

import numpy as np

from testbench.core.errors import LimitError, TrimError
from testbench.core.record import FlightAborted, FlightRecord
from testbench.effects import SERVOS
from testbench.effects.servo import COEFFICIENTS
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.decide import Naming, sum_of_squares
from testbench.questions.gap.evidence.commanded import starts_freely
from testbench.questions.gap.priors import deviations_of
from testbench.questions.gap.search.fit import EffectFit, fitted
from testbench.questions.gap.search.gauss_newton import retune
from testbench.questions.gap.search.hypothesis import Hypothesis
from testbench.questions.gap.windows import begin_freely


def linkage_instead(
    coefficient: str,
    naming: Naming,
    believed: Believed,
    records: Sequence[FlightRecord],
    held_out: Sequence[FlightRecord],
    re_tuned: float,
    known: Container[str],
) -> EffectFit | None:
    """Return the fit of a linkage whose ratio does what a wrong coefficient does; None if there is none.

    Args:
        coefficient: that is wrong.
        naming: by which it is.
        believed: in the air that was found, with the starts of windows.
        records: that it was found in.
        held_out: that judge: a linkage that leaves more of them than the re-tuned aircraft does is refuted.
        re_tuned: weighted sum of squares that this leaves.
        known: names of the effects that may be told.
    """
    control = next((c for c, names in COEFFICIENTS.items() if names[0] == coefficient), None)
    if control is None:
        return None
    effect, (factor, error) = SERVOS["gain", control], naming.measured[coefficient]
    (ratio,) = effect.parameters
    if effect.name not in known or not ratio.low < factor < ratio.high:
        return None
    values, back = {ratio.name: factor}, {**naming.nuisances, coefficient: 1.0}
    windows = {str(i): r for i, r in enumerate((*records, *held_out))}
    try:
        begun = begin_freely(believed, windows, believed.with_effect(effect, values).with_nuisances(back))
        model = begun.with_effect(effect, values)
        at = np.array([back[n] for n in begun.priors_of(records)])
        point = retune(Hypothesis.at(begun, model, tuple(records), at))
    except (FlightAborted, LimitError, TrimError):
        return None
    # Records tell ratio times coefficient; how far each is off, what is believed of the coefficient tells.
    spread = math.hypot(error, factor * deviations_of(believed.aircraft)[coefficient])
    found = fitted(effect, values, {ratio.name: spread}, point, naming.chi2_tuned)
    left = sum_of_squares(model.with_nuisances(point.by_name), held_out)
    allowed = found.threshold
    if any(starts_freely(r) for r in held_out):  # starts that were fitted to another model rest elsewhere
        allowed = CRITERIA.visible * math.sqrt(2.0 * sum(int(believed.taken(r).sum()) for r in held_out))
    return None if held_out and left - re_tuned > allowed else found
