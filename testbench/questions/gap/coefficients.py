"""A believed coefficient as a hypothesis among the effects: what it gains alone, and which effects explain as much.

Re-tuning within priors is no hypothesis: it serves all of them. That one coefficient is wrong is one: its prior is
dropped, those of the others stay. The data say m, with standard error e, where its prior says 1, with deviation s.
Chi-square then falls by (m - 1)^2 / (s^2 + e^2), which is the gain of one further parameter, as that of an effect is.
"""

from __future__ import annotations

import numpy as np

from testbench.aircraft import Aircraft
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.decide import Naming, believable, score
from testbench.questions.gap.priors import deviations_of
from testbench.questions.gap.search.fit import EffectFit

_IN_PLACE = 0.5  # share of what a coefficient is off that it may be off beside an effect that stands in for it
SEPARATES = "flights at another airspeed or of another amplitude, or a sensor on the surface"


def gain_of(coefficient: str, naming: Naming, aircraft: Aircraft | None = None) -> float:
    """Return the fall of chi-square if nothing but the prior of one coefficient is dropped."""
    value, error = naming.measured[coefficient]
    return (value - 1.0) ** 2 / (deviations_of(aircraft)[coefficient] ** 2 + error**2)


def rivals(coefficient: str, naming: Naming, aircraft: Aircraft | None = None) -> tuple[EffectFit, ...]:
    """Return the effects that explain as much as a wrong coefficient does, and in its place.

    It does not lead them by enough, and beside them it lies less than half as far from what is believed: what leaves it
    where it is does not stand in for it.
    """
    own = gain_of(coefficient, naming, aircraft) - float(np.log(naming.samples))
    off = abs(naming.measured[coefficient][0] - 1.0)
    sound = (f for f in naming.ranking if f.flown and f.settled and believable(f))
    instead = (f for f in sound if abs(f.nuisances[coefficient] - 1.0) < _IN_PLACE * off)
    return tuple(f for f in instead if own - score(f, naming.samples) < CRITERIA.told_apart)


def led_by_surfaces(coefficient: str, naming: Naming, aircraft: Aircraft | None = None) -> bool:
    """Return whether an effect that a recorded surface shows leads a wrong coefficient by what tells effects apart."""
    own = gain_of(coefficient, naming, aircraft) - float(np.log(naming.samples))
    told = (f for f in naming.ranking if f.told > 0.0 and f.flown and believable(f))
    return any(score(f, naming.samples) - own >= CRITERIA.told_apart for f in told)


def prove_nothing(naming: Naming) -> bool:
    """Return whether re-tuned coefficients are no evidence: something else pulled at them.

    Re-tuning leaves most of what stands above the noise without it, or an effect, named or not, explains most of what
    it leaves.
    """
    left, before = naming.chi2_tuned - naming.samples, naming.chi2_believed - naming.samples
    if leaves_more_than_noise(naming) and left > CRITERIA.proves * before:
        return True
    return any(f.significant and f.flown and f.share > CRITERIA.proves for f in naming.ranking)


def leaves_more_than_noise(naming: Naming) -> bool:
    """Return whether re-tuned coefficients alone visibly leave more than noise."""
    return naming.chi2_tuned - naming.samples > CRITERIA.visible * float(np.sqrt(2.0 * naming.samples))
