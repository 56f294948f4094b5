"""What a sum of squares is evidence of: noise, one effect rather than another, coefficients that do not fit."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from testbench.questions.gap.believed import Believed
from testbench.questions.gap.search.fit import FALSE_ALARM, EffectFit

MOVING_AIR = 0.02  # share of the samples by which chi-square may be larger in turbulence: its model is not exact
TOLD_APART = 2.0 * np.log(1.0 / FALSE_ALARM)  # gain by which one of two effects must lead to exclude the other
# Re-tuning is strained if coefficients drawn from their priors would lie as far off with no more than this probability.
# Without any effect that, or more than noise left, means that something the model lacks has pulled at it: effects are
# sought from the believed values, too. An effect that strains it does not fit what is believed, and is not named.
STRAINED = 0.01
FORM = 5e-4  # no form is right to this share of what an effect gains: what gains no more beside it is no other effect
LEAST = 25.0  # gain below which nothing is named: noise reaches it less often than any threshold
WEAK = 40.0  # the same of a second effect, or of moving air, beside an effect that leaves noise already
# What leaves more than so many standard deviations of the noise's chi-square, and this share of what it gains, is not
# the whole: a relative of it, or an effect beside it, leaves as much.
_REMAINDER, _REMAINING_SHARE = 10.0, 2e-3


def noise_floor(believed: Believed, samples: int) -> float:
    """Return the chi-square that noise alone would leave."""
    return samples * (1.0 + (MOVING_AIR if believed.whiten is not None else 0.0))


def noise_limit(believed: Believed, samples: int) -> float:
    """Return the chi-square that noise alone exceeds with a probability of FALSE_ALARM."""
    return float(chi2.isf(FALSE_ALARM, noise_floor(believed, samples)))


def believable(fit: EffectFit) -> bool:
    """Return whether a fit strains no coefficient and asks for no more of its effect than there can be."""
    return fit.within >= STRAINED and not fit.beyond


def leaves_noise(fit: EffectFit, noise: float) -> bool:
    """Return whether a fit explains all: chi-square is within that of ``noise``, and no coefficient is strained."""
    return fit.chi2 <= noise and fit.within >= STRAINED


def leaves_far_more(fit: EffectFit, floor: float) -> bool:
    """Return whether a fit leaves so much more than the ``floor`` of the noise that it cannot be the whole."""
    return fit.chi2 - floor > max(_REMAINDER * float(np.sqrt(2.0 * floor)), _REMAINING_SHARE * fit.gain)


def is_special_case(fit: EffectFit, general: EffectFit) -> bool:
    """Return whether ``general`` is a more general form of ``fit`` that gains no more than noise, or form, would."""
    if not general.effect.generalises(fit.effect):
        return False
    extra = max(len(general.values) - len(fit.values), 1)
    return general.gain - fit.gain <= max(float(chi2.isf(FALSE_ALARM, extra)), FORM * general.gain)


def score(fit: EffectFit, samples: int) -> float:
    """Return the gain less ln(samples) for each parameter (Schwarz 1978): the simpler of two equal effects leads."""
    return fit.gain - len(fit.values) * float(np.log(samples))
