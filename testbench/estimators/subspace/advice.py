"""What is doubtful about a subspace estimate, and what to do about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.advice import Advice, doubt, wrong
from testbench.core.relative import percent_in_words, share_in_words

if TYPE_CHECKING:
    from testbench.estimators.settings import Subspace

_EXCITED = 1e-6  # weaker directions of the past inputs, relative to the strongest, count as not excited
_WEAK = 5.0  # states below this many noise floors are found, but their poles are not to be trusted
_MOVED = 0.1  # relative change of a pole under another horizon that is worth a warning
_RESTLESS = 2.0  # free-run over one-step errors beyond which something is missing in the model
_POOR = 50.0  # free-run error in percent of the output beyond which a model does not predict
_FEEDBACK = 0.02  # share of the innovations explained by later inputs from which on a loop is suspected


def doubts(found: Mapping[str, Any], outputs: Sequence[str], J: int, L: int) -> tuple[Advice, ...]:
    """Return one sentence per doubt that the diagnostics ``found`` of an estimate with horizons J and L give rise to.

    The thresholds are judgement, set on simulated short periods and phugoids with measurement noise, 10 to 100 Hz:
    there every estimate with a pole off by more than 10 % broke at least one. They err on the side of warning.
    """
    out = []
    n, values = found["order"], found["singular_values"]
    noisy = bool(np.any(found["innovations_std"] > 0.0))
    other = found["other_future_horizon"]
    if found["unknowns"] > found["columns"] / 2:
        out.append(
            doubt(
                "few_data",
                f"step 1 nearly interpolates: {found['unknowns']} unknowns per output from {found['columns']} columns; "
                "shorten past_horizon, give more data or decimate",
            )
        )
    if found["input_excitation"] < _EXCITED:
        out.append(
            doubt(
                "weak_excitation",
                f"the inputs do not excite past_horizon = {J} samples (weakest over strongest direction "
                f"{found['input_excitation']:.1e}): the response is determined only where the input has energy; "
                "decimate, shorten past_horizon or excite a wider band",
            )
        )
    if noisy and values[n - 1] < _WEAK:
        out.append(
            doubt(
                "weak_state",
                f"state {n} stands only {values[n - 1]:.2g} times above the noise floor: poles are unreliable; "
                "lengthen future_horizon, decimate, add a sensor or lower the order",
            )
        )
    if noisy and n < values.size and values[n] > max(_WEAK, 0.1 * values[n - 1]):
        out.append(
            doubt(
                "order_too_low",
                f"order {n} discards a state that stands {values[n]:.2g} times above the noise floor "
                "(turbulence, sensor dynamics, nonlinearity or a structural mode): try a higher order",
            )
        )
    if found["pole_shift_past"] is not None and found["pole_shift_past"] > _MOVED:
        out.append(
            doubt(
                "past_horizon",
                f"with past_horizon = {J // 2} a pole moves by {share_in_words(found['pole_shift_past'])}: "
                f"past_horizon = {J} is too short, or the data do not hold that pole; lengthen it or give more data",
            )
        )
    if found["pole_shift_future"] is not None and found["pole_shift_future"] > _MOVED:
        out.append(
            doubt(
                "future_horizon",
                f"with future_horizon = {other} a pole moves by {share_in_words(found['pole_shift_future'])}: "
                f"future_horizon = {L} is too short to tell the states apart, or the data do not hold that pole; "
                "lengthen it or decimate",
            )
        )
    if found["poles_without_continuous_counterpart"].size:
        z = ", ".join(f"{z.real:.3g}" for z in found["poles_without_continuous_counterpart"])
        out.append(
            doubt(
                "no_continuous_counterpart",
                f"discrete poles at {z} have no continuous counterpart: they model noise, not the aircraft; "
                f"lengthen future_horizon = {L}, lower the order or decimate",
            )
        )
    restless = [
        f"{name} {ratio:.1f}"
        for name, ratio in zip(outputs, found["free_run_over_innovations"], strict=True)
        if ratio > _RESTLESS
    ]
    if restless:
        out.append(
            doubt(
                "free_run",
                f"the free run errs more than the innovations, by factors of {', '.join(restless)}: turbulence, drift, "
                "nonlinearity, noise coloured by a low-pass filter, or a missing state; "
                "compare a higher order and a longer future_horizon",
            )
        )
    poor = [
        f"{name} {percent_in_words(error)}"
        for name, error in zip(outputs, found["output_error_percent"], strict=True)
        if error > _POOR
    ]
    if poor:
        out.append(
            wrong(
                "does_not_predict",
                "in free run the model leaves much of the records that it was fitted to unexplained "
                f"({', '.join(poor)}): do not use it to predict",
            )
        )
    if found["moved_poles"].size:
        z = ", ".join(f"{abs(z):.4g}" for z in found["moved_poles"])
        out.append(
            doubt(
                "poles_moved",
                f"poles of modulus {z} were moved inside the unit circle (stable = true): do not trust their damping",
            )
        )
    return tuple(out)


def advice_in_words(found: Mapping[str, Any], outputs: Sequence[str], given: Subspace) -> tuple[Advice, ...]:
    """Return one sentence per doubt: those of DSR_e, whose thresholds are the same, and those of the family.

    The threshold of feedback is judgement: simulated pitch dampers with turbulence give 0.05 and more, open loops with
    noise on the outputs less than 0.01 beyond chance.
    """
    out = list(doubts(found, outputs, given.past_horizon, given.future_horizon))
    robust = given.method in ("ssarx", "pbsid_opt")
    if found["feedback"] > _FEEDBACK and not (robust and given.closed_loop):
        out.append(
            doubt(
                "closed_loop",
                f"later inputs explain {100 * found['feedback']:.0f} % of the innovations: the inputs react to the "
                "outputs (closed loop), which biases "
                + ("B and D; set closed_loop" if robust else f"{given.method}; use ssarx, pbsid_opt or dsr_e"),
            )
        )
    if found["predictor_radius"] >= 1.0 and np.any(found["innovations_std"] > 0.0):
        out.append(
            doubt(
                "unstable_predictor",
                f"the one-step predictor A - K C is unstable (spectral radius {found['predictor_radius']:.3g}): "
                "do not filter with K; lengthen past_horizon or give more data",
            )
        )
    return tuple(out)
