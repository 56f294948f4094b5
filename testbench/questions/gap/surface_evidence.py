"""What recorded surfaces say, in the likelihood of effects: motion and surfaces are explained together or not at all.

A path whose surface is recorded has a likelihood of its own (:mod:`.evidence.control_path`). A hypothesis that leaves
the path as believed leaves all that the surface does besides; one with the right effect in the path leaves noise. The
two likelihoods are of different readings, so they multiply: chi-square of the motion and that of the surfaces add. A
coefficient, or an effect of the air, that moves the aircraft as a servo would then lags by what the surface shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from testbench.core.record import FlightRecord
from testbench.questions.gap.believed import Believed, deviations_of
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.decide import Naming, decide, doubted, noise_floor, score
from testbench.questions.gap.evidence.control_path import JudgedPath
from testbench.questions.gap.search.fit import EffectFit, share_of_excess


def with_surfaces(
    naming: Naming, paths: Sequence[JudgedPath], believed: Believed, records: Sequence[FlightRecord]
) -> Naming:
    """Return ``naming`` decided anew, with what recorded surfaces say added to the likelihood of every effect.

    As it is, if no path differs; or if no effect of such a path moves the aircraft by what can be named: then the
    surfaces tell of the path alone, and compete with nothing.

    Args:
        naming: what was decided by the motion.
        paths: judged by themselves.
        believed: the believed model in the air that was found.
        records: those that were named from.
    """
    telling = [p for p in paths if p.outcome == "differs"]
    told = {f.effect.name: sum(p.told(f.effect) for p in telling) for f in naming.ranking}
    if not any(told[f.effect.name] > 0.0 and f.flown and f.gain > CRITERIA.least for f in naming.ranking):
        return naming
    all_told = sum(p.gain for p in telling)
    chi2_tuned = naming.chi2_tuned + all_told
    fits = [_weighed(f, told[f.effect.name], all_told, chi2_tuned, naming.samples) for f in naming.ranking]
    ranking = tuple(sorted(fits, key=lambda f: -score(f, naming.samples)))
    floor = noise_floor(believed, naming.samples)
    outcome, names, sentence = decide(ranking, chi2_tuned, naming.samples, floor, deviations_of(believed.aircraft))
    changed = {"outcome": outcome, "names": names, "ranking": ranking, "chi2_tuned": chi2_tuned, "sentence": sentence}
    return doubted(replace(naming, **changed), believed, records)


def _weighed(fit: EffectFit, told: float, all_told: float, chi2_tuned: float, samples: int) -> EffectFit:
    """Return a fit of which the surfaces have ``told`` so much, of ``all_told`` that the best would explain of them."""
    left = fit.chi2 + all_told - told
    share = share_of_excess(chi2_tuned, left, samples)
    return replace(fit, chi2=left, gain=fit.gain + told, share=share, told=told)
