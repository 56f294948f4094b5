"""Believed coefficients as hypotheses: one that is wrong competes with the effects, with the same thresholds.

Re-tuning within priors is no hypothesis: it serves all of them. That one coefficient is wrong is one: its prior is
dropped, those of the others stay. The data say m, with standard error e, where its prior says 1, with deviation s.
Chi-square then falls by (m - 1)^2 / (s^2 + e^2), which is the gain of one further parameter, as that of an effect is.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from testbench.aircraft import Aircraft, Amendment, ScaleCoefficient
from testbench.questions.gap import tell
from testbench.questions.gap.believed import deviations_of
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.decide import Naming, believable, score
from testbench.questions.gap.effects import Effect
from testbench.questions.gap.effects.base import Parameter, Values
from testbench.questions.gap.search.fit import EffectFit, share_of_excess
from testbench.questions.gap.search.gauss_newton import retune, within_priors
from testbench.questions.gap.search.hypothesis import Hypothesis
from testbench.sensors import SensorSuite

FLAT = 10.0  # relative deviation of a prior that is dropped; its price is far below any threshold
SEPARATES = "flights at another airspeed or of another amplitude, or a sensor on the surface"
_PLACES = {"CL": "lift", "CD": "drag", "Cm": "pitching moment", "Cl": "wing", "CY": "fin", "Cn": "fin"}


def gain_of(coefficient: str, naming: Naming, aircraft: Aircraft | None = None) -> float:
    """Return the fall of chi-square if nothing but the prior of one coefficient is dropped."""
    value, error = naming.measured[coefficient]
    return (value - 1.0) ** 2 / (deviations_of(aircraft)[coefficient] ** 2 + error**2)


def far_off(naming: Naming, aircraft: Aircraft | None = None) -> tuple[str, ...]:
    """Return the coefficients that re-tuning without any effect finds far off, the one that gains most first."""
    priors = deviations_of(aircraft)
    found = [
        n
        for n, (value, error) in naming.measured.items()
        if error < priors[n] and abs(value - 1.0) > max(CRITERIA.sure * error, CRITERIA.far * priors[n])
    ]
    return tuple(sorted(found, key=lambda n: -gain_of(n, naming, aircraft)))


def rivals(coefficient: str, naming: Naming, aircraft: Aircraft | None = None) -> tuple[EffectFit, ...]:
    """Return the effects that explain as much as a wrong coefficient does: it does not lead them by enough."""
    own = gain_of(coefficient, naming, aircraft) - float(np.log(naming.samples))
    return tuple(
        f
        for f in naming.ranking
        if f.flown and f.settled and believable(f) and own - score(f, naming.samples) < CRITERIA.told_apart
    )


def compete(naming: Naming, tuned: Hypothesis, noise: float) -> Naming:
    """Return ``naming`` after one wrong coefficient has competed with the effect that is named.

    If neither leads by enough, they are a set. If the coefficient leads, nothing is named, and it is accused
    (:func:`.parameters.wrong_parameters`). If the effect leads, nothing changes.

    Args:
        naming: what was decided among the effects.
        tuned: the believed model re-tuned without any effect.
        noise: chi-square that noise alone hardly exceeds.
    """
    best, aircraft = naming.best, tuned.believed.aircraft
    if best is None or best.scatter_s or best.effect.met is not None:
        return naming
    rank = score(best, naming.samples)
    first = next(iter(far_off(naming, aircraft)), None)
    near = rank - CRITERIA.told_apart
    if first is None or gain_of(first, naming, aircraft) - float(np.log(naming.samples)) <= near:
        return naming
    alone = fit_alone(first, tuned)
    behind = rank - score(alone, naming.samples)
    if not believable(alone) or behind >= CRITERIA.told_apart:
        return naming
    if behind <= -CRITERIA.told_apart:
        outcome = "no gap" if alone.chi2 <= noise else "unexplained"
        return replace(naming, outcome=outcome, names=(), sentence=tell.coefficient_leads(alone, best))
    fits = sorted(
        [alone, *(f for f in naming.ranking if f.effect.name in naming.names)],
        key=lambda f: -score(f, naming.samples),
    )
    ranking = sorted([*naming.ranking, alone], key=lambda f: -score(f, naming.samples))
    names = tuple(f.effect.name for f in fits)
    return replace(naming, outcome="set", names=names, ranking=tuple(ranking), sentence=tell.one_of(fits))


def fit_alone(coefficient: str, tuned: Hypothesis) -> EffectFit:
    """Return the fit of the hypothesis that one coefficient is wrong, flown; the others keep their priors."""
    free = retune(replace(tuned, priors={**tuned.priors, coefficient: FLAT}, slopes=tuned.tangents))
    error = free.measured()[coefficient][1]
    kept = {n: f for n, f in free.by_name.items() if n != coefficient}
    return EffectFit(
        effect=as_effect(coefficient),
        values={"factor": free.by_name[coefficient]},
        errors={"factor": error},
        chi2=free.chi2,
        gain=max(tuned.chi2 - free.chi2, 0.0),
        threshold=CRITERIA.least,
        share=share_of_excess(tuned.chi2, free.chi2, tuned.samples),
        nuisances={**kept, coefficient: 1.0},
        within=within_priors(free),
    )


def as_effect(coefficient: str) -> Effect:
    """Return the effect that one believed coefficient is wrong by a factor."""
    return Effect(
        name=f"wrong {coefficient}",
        title=f"a wrong {coefficient}",
        place=_PLACES[coefficient[:2]],
        physics=f"The believed {coefficient} is wrong by a factor. Nothing is missing beside it.",
        parameters=(Parameter("factor", "1", 0.0, 10.0, (1.2, 0.8), none=1.0),),
        amend=partial(_scaled, coefficient),
        mistaken_for="an effect of the same part that grows with the same motion: a damper, a linkage",
        separated_by=SEPARATES,
    )


def _scaled(coefficient: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    change = ScaleCoefficient(coefficient, values["factor"])
    return aircraft.amended(Amendment(f"wrong_{coefficient}", f"{coefficient} corrected", (change,))), suite
