"""What a sum of squares is evidence of: noise, one effect rather than another, coefficients that do not fit."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from testbench.gap.fit import FALSE_ALARM, EffectFit
from testbench.gap.local import Local

MOVING_AIR = 0.02  # share of the samples by which chi-square may be larger in turbulence: its model is not exact
TOLD_APART = 2.0 * np.log(1.0 / FALSE_ALARM)  # gain by which one of two effects must lead to exclude the other
# Re-tuning is strained if coefficients drawn from their priors would lie as far off with no more than this probability.
# Without any effect that, or more than noise left, means that something the model lacks has pulled at it: effects are
# sought from the believed values, too. An effect that strains it does not fit what is believed, and is not named.
STRAINED = 0.01


def noise_floor(point: Local) -> float:
    """Return the chi-square that noise alone would leave."""
    return point.exact.size * (1.0 + (MOVING_AIR if point.believed.whiten is not None else 0.0))


def is_noise(point: Local) -> float:
    """Return the chi-square that noise alone exceeds with a probability of FALSE_ALARM."""
    return float(chi2.isf(FALSE_ALARM, noise_floor(point)))


def score(fit: EffectFit, samples: int) -> float:
    """Return the gain less ln(samples) for each parameter (Schwarz 1978): the simpler of two equal effects leads."""
    return fit.gain - len(fit.values) * float(np.log(samples))
