"""What is doubtful about parameter estimates, and what to do about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbench.core.advice import Advice, doubt, note, wrong
from testbench.core.constants import WHITE
from testbench.core.record import FloatArray
from testbench.core.words import with_error

_LOST = 1e-7  # smallest over largest singular value of the scaled sensitivities below which nothing is decided
_NAMED = 0.3  # share of a null direction that makes a parameter worth naming
_TOGETHER = 0.98  # correlation beyond which two estimates stand for one another
_VAGUE = 0.5  # standard error relative to the value
_MANY = 0.5  # share of the estimates that are vague beyond which the flight, not one small effect, is the reason
_EXACT = 1e-9  # median standard error relative to the value below which the records are free of noise
_BIASED = 5.0  # corrected over plain errors beyond which residuals are no noise but what the model misses (judged)
_FILTERED = ("equation_error", "recursive_fourier")  # whose derivatives colour the residuals of any flight
_WHY = {"not_converged": "the search did not converge", "on_bound": "{} ended on a bound"}


def null_directions(J: FloatArray, size: FloatArray, names: Sequence[str]) -> str:
    """Return in words the unknowns that the sensitivities J (N, k) do not decide; empty if all are decided."""
    dead = [name for name, s in zip(names, size, strict=True) if not s > 0.0]
    if dead:
        return ", ".join(dead)
    _, sigma, Vt = np.linalg.svd(np.linalg.qr(J / size, mode="r"))
    lost = Vt[sigma <= _LOST * sigma[0]]
    return ", ".join(name for name, column in zip(names, lost.T, strict=True) if np.any(np.abs(column) > _NAMED))


def own_poles(model: Any) -> NDArray[np.complex128]:
    """Return the poles (n,), rad/s, of a model without those of its servos.

    A delay that is estimated is a Pade approximation, with poles at 3.5 over the delay: fast, and nothing that moves.
    """
    A = model.linear().A
    n = len(model.structure.states) - len(model.structure.followers)
    return np.asarray(np.linalg.eigvals(A[:n, :n]), complex)


def advice_in_words(model: Any) -> Any:
    """Return the ParametricModel with one piece of advice per doubt that its diagnostics give rise to."""
    found = model.diagnostics
    out: list[Advice] = []
    names = [p.name for p in model.structure.parameters if p.free]
    free = model.structure.free
    values, errors = model.params[free], np.sqrt(np.diag(model.covariance))[free]
    if not found["converged"]:
        out.append(
            wrong(
                "not_converged",
                "the search did not converge: do not believe the estimates; take other start values, fewer free "
                "parameters or more iterations",
            )
        )
    if found["at_bound"]:
        out.append(
            wrong(
                "on_bound",
                f"{', '.join(found['at_bound'])} ended on a bound: the bound sets the value, not the data, and it has "
                "no standard error; widen the bound, or find out why the data lead beyond it",
            )
        )
    if found.get("none_shows"):
        out.append(
            note(
                "none_shows",
                f"{', '.join(found['none_shows'])} ended at the least that is sought: these data show no such time of "
                "a servo; leave it out, or give it as a number",
            )
        )
    # Rounding of noise-free records says nothing of a true zero.
    constants = model.structure.trim_constants
    noisy = float(np.median(errors / np.maximum(np.abs(values), 1e-300))) > _EXACT
    vague = [
        f"{n} {with_error(float(v), float(e))}"
        for n, v, e in zip(names, values, errors, strict=True)
        if noisy and e > _VAGUE * abs(v) and e > 0.0 and n not in constants
    ]
    if vague:
        asked = sum(n not in constants for n in names)
        rank = doubt if len(vague) > _MANY * asked else note  # an error that is stated misleads nobody
        out.append(
            rank(
                "weakly_identifiable",
                f"these data say little about {', '.join(vague)}: fix them at a believed value, or excite them more",
            )
        )
    fast = [abs(s) for s in own_poles(model) if abs(s) > np.pi / model.dt_s]
    if fast:
        out.append(
            doubt(
                "beyond_nyquist",
                f"poles of {', '.join(f'{w:.4g}' for w in fast)} rad/s lie beyond the Nyquist frequency of "
                f"{np.pi / model.dt_s:.4g} rad/s: these samples show only that they are fast; fix the parameters that "
                "make them so",
            )
        )
    correlation = np.abs(np.triu(found["correlation"], 1))
    pairs = [f"{names[i]} and {names[j]} ({correlation[i, j]:.3f})" for i, j in np.argwhere(correlation > _TOGETHER)]
    if pairs:
        out.append(
            doubt(
                "correlated_estimates",
                f"these data cannot tell these estimates apart (correlation): {', '.join(pairs)}; fix one of each "
                "pair, or excite them separately",
            )
        )
    coloured = [o for o, p in zip(model.outputs, found["whiteness_p"], strict=True) if p < WHITE]
    if coloured:
        inflation = np.asarray(found["error_inflation"])
        factor = float(np.max(inflation))
        # a constant takes up every drift, which need not touch the derivatives
        slopes = np.array([0.0 if n in constants else 1.0 for n in names]) * inflation
        # a correction of errors that are not to be believed would lend them weight
        why = [_WHY[a.code].format(", ".join(found["at_bound"])) for a in out if a.code in _WHY]
        if why:
            errors_hold = f"the standard errors are not to be believed, because {' and '.join(why)}"
        elif np.max(slopes) > _BIASED and model.method not in _FILTERED:
            worst, most = names[int(np.argmax(slopes))], float(np.max(slopes))
            errors_hold = (
                f"so much so (a factor {most:.2g} in the error of {worst}) as if the model missed something, which "
                "biases the estimates beyond any standard error: do not believe the errors unless the sensors' noise "
                "itself is that slow"
            )
        else:
            errors_hold = f"standard errors are corrected for it, by up to a factor {factor:.2g}"
        own = model.method in _FILTERED and not why
        out.append(
            (note if own else doubt)(
                "coloured_residuals",
                f"the residuals of {', '.join(coloured)} are not white (turbulence, filtered noise or something "
                f"missing in the model): {errors_hold}",
            )
        )
    return replace(model, advice=tuple(out))
