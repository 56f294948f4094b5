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
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.decide import Naming, decide, doubted, noise_floor, score
from testbench.questions.gap.evidence.control_path import JudgedPath
from testbench.questions.gap.priors import deviations_of
from testbench.questions.gap.search.fit import EffectFit, share_of_excess


def with_surfaces(
    naming: Naming, paths: Sequence[JudgedPath], believed: Believed, records: Sequence[FlightRecord]
) -> Naming:
    """Return ``naming`` decided anew, with what recorded surfaces say added to the likelihood of every effect.

    An effect that the surfaces show, but not the motion, explains nothing of the motion: it does not take the place of
    one that does. It is named only if the motion shows no gap and agrees with it.

    Args:
        naming: what was decided by the motion.
        paths: judged by themselves.
        believed: the believed model in the air that was found.
        records: those that were named from.
    """
    telling = [p for p in paths if p.outcome == "differs"]
    told = {f.effect.name: sum(p.told(f.effect) for p in telling) for f in naming.ranking}
    shown = [f for f in naming.ranking if told[f.effect.name] > 0.0 and f.flown]
    if not shown:
        return naming
    most = max(told[f.effect.name] for f in shown)
    chi2_tuned = naming.chi2_tuned + most
    fits = [_weighed(f, told[f.effect.name], most, chi2_tuned, naming.samples) for f in naming.ranking]
    ranking = tuple(sorted(fits, key=lambda f: -score(f, naming.samples)))
    floor = noise_floor(believed, naming.samples)
    outcome, names, sentence = decide(ranking, chi2_tuned, naming.samples, floor, deviations_of(believed.aircraft))
    weighed = replace(naming, outcome=outcome, names=names, ranking=ranking, chi2_tuned=chi2_tuned, sentence=sentence)
    moves = [f for f in shown if f.gain > CRITERIA.least]
    best = weighed.best
    if best is None:
        counts = bool(moves)
    else:
        agrees = naming.outcome == "no gap" and best.in_motion > CRITERIA.seconded
        counts = agrees or best.in_motion > CRITERIA.least
    return doubted(weighed, believed, records) if counts else naming


def _weighed(fit: EffectFit, told: float, most: float, chi2_tuned: float, samples: int) -> EffectFit:
    """Return a fit of which the surfaces have ``told`` so much, of the ``most`` that any effect explains of them."""
    left = fit.chi2 + most - told
    share = share_of_excess(chi2_tuned, left, samples)
    return replace(fit, chi2=left, gain=fit.gain + told, share=share, told=told)
