"""What is doubtful about an estimate of the family, and what to do about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.estimators.subspace import dsr_e_advice

if TYPE_CHECKING:
    from testbench.estimators.subspace.family import Settings

_FEEDBACK = 0.02  # share of the innovations explained by later inputs from which on a loop is suspected


def advice_in_words(found: Mapping[str, Any], outputs: Sequence[str], given: Settings) -> tuple[str, ...]:
    """Return one sentence per doubt: those of DSR_e, whose thresholds are the same, and those of the family.

    The threshold of feedback is judgement: simulated pitch dampers with turbulence give 0.05 and more, open loops with
    noise on the outputs less than 0.01 beyond chance.
    """
    out = list(dsr_e_advice.advice_in_words(found, outputs, given.past_horizon, given.future_horizon))
    robust = given.method in ("ssarx", "pbsid_opt")
    if found["feedback"] > _FEEDBACK and not (robust and given.closed_loop):
        out.append(
            f"later inputs explain {100 * found['feedback']:.0f} % of the innovations: the inputs react to the outputs "
            "(closed loop), which biases "
            + ("B and D; set closed_loop" if robust else f"{given.method}; use ssarx, pbsid_opt or dsr_e")
        )
    if found["predictor_radius"] >= 1.0 and np.any(found["innovations_std"] > 0.0):
        out.append(
            f"the one-step predictor A - K C is unstable (spectral radius {found['predictor_radius']:.3g}): "
            "do not filter with K; lengthen past_horizon or give more data"
        )
    return tuple(out)
