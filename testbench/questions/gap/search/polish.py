"""Bring fits to rest on flown tangents; on those of linear predictions, chi-square may rest some units too high."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import lsq_linear

from testbench.core.differences import ends, slope
from testbench.core.record import FloatArray
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.decide import noise_limit, score
from testbench.questions.gap.search.fit import EffectFit
from testbench.questions.gap.search.gauss_newton import AT_REST, SHORTENED
from testbench.questions.gap.search.hypothesis import Hypothesis, Signature
from testbench.questions.gap.search.parallel import spread

_CLOSE = 2.0 * CRITERIA.told_apart  # fits that trail the best by less are polished; tangents cost less than half of it
_SEEN = 0.5 * CRITERIA.weak  # gain below which polishing cannot make a name of a fit
_ROUNDS = 3
_STEP = 0.1  # of differences, in standard errors
_TIGHTER = (0.5, 0.25)  # shares of the priors' deviations that are tried in turn to bring coefficients within them
_WIDEST, _NARROWEST = 1e-2, 1e-6  # of them, of a parameter's range


def polished(base: Hypothesis, ranking: Sequence[EffectFit], chi2_tuned: float) -> list[EffectFit]:
    """Return the fits of ``ranking``; those that compete for the first place are brought to rest on flown tangents.

    So is one that leads alone, if it strains coefficients: short of rest they may lie farther off than they have to.
    One that strains them at rest is brought within their priors, if that costs no more than its form accounts for.

    Args:
        base: a point without any effect.
        ranking: fits, best first.
        chi2_tuned: weighted sum of squares without any effect, nuisances re-tuned.
    """
    flown = [f for f in ranking if f.flown and f.settled and not f.scatter_s and f.gain > _SEEN]
    first = max((score(f, base.samples) for f in flown), default=0.0)
    close = [f for f in flown if first - score(f, base.samples) < _CLOSE]
    if len(close) < 2 and not any(f.within < CRITERIA.strained for f in close):
        return list(ranking)
    rested = spread([partial(_at_rest, base, f, chi2_tuned) for f in close])
    rested = spread([partial(_within_priors, base, f, chi2_tuned) for f in rested])
    found = dict(zip(map(id, close), rested, strict=True))
    return [found.get(id(f), f) for f in ranking]


def slopes(signature: Signature, there: Hypothesis, x: FloatArray, errors: FloatArray) -> FloatArray:
    """Return d residuals / d parameters (samples, p) at a point flown with them, by differences of flights.

    Args:
        signature: the effect, from a point without it.
        there: the point, flown with the effect at ``x``.
        x: (p,) parameters.
        errors: (p,) their standard errors, of which the differences are a tenth.
    """
    low, high = signature.effect.bounds
    width = np.clip(_STEP * errors, _NARROWEST * (high - low), _WIDEST * (high - low))
    steps = np.where(x + width < high, width, -width)

    def flown(points: list[FloatArray]) -> list[FloatArray | None]:
        moved = there.moved_all([signature.model(y) for y in points], [there.nuisances] * len(points), near=True)
        return [None if end is None else end.exact for end in moved]

    found = zip(ends(flown, x, steps), steps, strict=True)
    columns = [slope(end, h, lambda: there.exact) for end, h in found]
    return np.column_stack([np.zeros_like(there.exact) if c is None else c for c in columns])


def _at_rest(base: Hypothesis, fit: EffectFit, chi2_tuned: float) -> EffectFit:
    """Return ``fit`` after Gauss-Newton steps on flown tangents that lower chi-square; its errors stay."""
    signature, (low, high) = Signature(base, fit.effect), fit.effect.bounds
    x, errors = np.array(list(fit.values.values())), np.array(list(fit.errors.values()))
    there = base.moved(signature.model(x), base.vector(fit.nuisances))
    if there is None:
        return fit
    lowest, free = _cost(there, signature, x), np.full(len(base.priors), np.inf)
    for _ in range(_ROUNDS):
        near = there.afresh(True)
        J = block_diag(fit.effect.prior_slopes(x), np.diag(1.0 / base.prior_std))
        J = np.vstack([np.hstack([slopes(signature, there, x, errors), near.tangents]), J])
        r = np.concatenate([there.exact, fit.effect.prior_residuals(x), there.deviations])
        ends = np.concatenate([np.minimum(low - x, -1e-12), -free]), np.concatenate([np.maximum(high - x, 1e-12), free])
        step = lsq_linear(J, -r, ends).x
        if r @ r - np.sum((r + J @ step) ** 2) < AT_REST:
            break
        for share in SHORTENED:
            x_there = np.clip(x + share * step[: len(x)], low, high)
            moved = near.moved(signature.model(x_there), there.nuisances + share * step[len(x) :])
            if moved is not None and _cost(moved, signature, x_there) < lowest:
                there, x, lowest = moved, x_there, _cost(moved, signature, x_there)
                break
        else:
            break
    return fit if lowest >= fit.chi2 else fit.brought_to(x, there, lowest, chi2_tuned)


def _within_priors(base: Hypothesis, fit: EffectFit, chi2_tuned: float) -> EffectFit:
    """Return ``fit``, or one within the priors that is worse by no more than the form of the effect is off.

    Where the form of a large effect leaves more than noise, coefficients go to where they make up for it: a thousandth
    of its gain outweighs any prior.
    """
    if fit.within >= CRITERIA.strained or fit.chi2 <= noise_limit(base.believed, base.samples):
        return fit
    signature = Signature(base, fit.effect)
    for share in _TIGHTER:
        tight = replace(base, priors={n: share * s for n, s in base.priors.items()})
        held = _at_rest(tight, replace(fit, chi2=np.inf), chi2_tuned)
        x = np.array(list(held.values.values()))
        there = base.moved(signature.model(x), base.vector(held.nuisances))
        if there is None or _cost(there, signature, x) - fit.chi2 > CRITERIA.form * fit.gain:
            break
        found = fit.brought_to(x, there, _cost(there, signature, x), chi2_tuned)
        if found.within >= CRITERIA.strained:
            return found
    return fit


def _cost(point: Hypothesis, signature: Signature, x: FloatArray) -> float:
    return point.chi2 + float(np.sum(signature.effect.prior_residuals(x) ** 2))
