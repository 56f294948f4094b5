"""Name the missing effect: fit every effect of the library, compare likelihoods, decide with stated error rates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import chi2

from testbench.gap.believed import NUISANCES, Believed
from testbench.gap.effects import Effect, library
from testbench.gap.effects.base import together
from testbench.gap.fit import (
    FALSE_ALARM,
    EffectFit,
    Screened,
    descend,
    fit,
    promising,
    retune,
    screen,
    summarise,
    within_priors,
)
from testbench.gap.local import Changes, Local
from testbench.record import FlightRecord

ENOUGH = 0.90  # share of the excess that a named effect must explain, unless what is left is noise
TOO_CLOSE = 0.85  # a runner-up with this share of the best gain cannot be told apart while more than noise is left
TOLD_APART = 2.0 * np.log(1.0 / FALSE_ALARM)  # gain by which one of two effects must lead to exclude the other
FOLLOWED = 0.25  # effects that promise less than this share of what the best one promises are not fitted,
FOLLOWED_FAR = 0.1  # of effects with several parameters, of which screening tries few combinations, less than this
PROMISING = 5.0  # nor are effects that promise a smaller gain than this, a third of any threshold; but
AT_LEAST = 3  # this many always are
# Where re-tuning leaves the priors with a probability below this, something that the model lacks has strained it, and
# effects are sought from the believed values, too:
STRAINED = 0.01
FROM_BELIEVED = 6  # so many of them,
PATIENCE = 2  # and descents from there are given two rounds to settle before they may be called hopeless
LEADS = 0.4  # of two effects, the first alone explains this share of the excess at least


@dataclass(frozen=True, eq=False)
class Naming:
    """The outcome of naming.

    Attributes:
        outcome: "no gap", "named", "set" (cannot be told apart) or "unexplained".
        names: the named effect, or the set, best first; empty otherwise. Two effects at once are one name, "A + B".
        ranking: all effects, best first.
        chi2_believed: weighted sum of squares of the believed model, nothing re-tuned.
        chi2_tuned: the same after re-tuning the nuisances within their priors.
        samples: number of samples in those sums.
        sentence: the outcome in words.
        rejected: effect that was not fitted -> why.
    """

    outcome: str
    names: tuple[str, ...]
    ranking: tuple[EffectFit, ...]
    chi2_believed: float
    chi2_tuned: float
    samples: int
    sentence: str
    rejected: Mapping[str, str] = field(default_factory=dict)

    @property
    def best(self) -> EffectFit | None:
        """The effect that is added, if any."""
        return next((f for f in self.ranking if self.names and f.effect.name == self.names[0]), None)


def name_effect(
    believed: Believed,
    records: Sequence[FlightRecord],
    progress: Callable[[str], None] | None = None,
    effects: Mapping[str, Effect] | None = None,
    pairs: bool = True,
) -> Naming:
    """Fit every effect of the library to ``records`` and decide which, if any, the believed model lacks.

    The noise is known from the sensor suite, so that twice the gain in log-likelihood is chi-square distributed with as
    many degrees of freedom as the effect has parameters if there is no effect (Wilks 1938); Bonferroni's bound over
    all effects that these records could show makes FALSE_ALARM hold for all of them. This holds in still air, or in
    turbulence if ``believed.whiten`` makes the residuals white.

    Every effect is screened on linear predictions: what it would change at its starts, nuisances re-tuned, is set
    against the residual. Those that promise most are fitted.

    Args:
        believed: aircraft, sensors and condition as believed.
        records: measured records.
        progress: called with a few words as each stage begins.
        effects: the library, by name; that of the suite if not given.
        pairs: where no single effect explains enough, two at once are tried.

    Raises:
        FlightAborted, TrimError, LimitError: the believed aircraft itself does not survive the measured commands.
    """
    say = progress or (lambda text: None)
    say("re-tune the believed model")
    start = Local.at(believed, believed, tuple(records), np.ones(len(NUISANCES)))
    tuned = retune(start)
    say("screen the library")
    choice = tuple((library(believed.suite) if effects is None else effects).values())
    screened = [screen(tuned, e) for e in choice]
    rejected = {s.effect.name: s.why for s in screened if not s.seen}
    tested = max(1, len(screened) - len(rejected))
    strained = within_priors(tuned) < STRAINED
    fits = _fit_promising(tuned, start if strained else None, screened, tested, rejected, say)
    samples = int(start.exact.size)
    if pairs:
        base = start if strained else tuned
        fits += _two_at_once(base, tuned.chi2, screened, _ranked(fits, samples), samples, tested, say)
    ranking = _ranked(fits, samples)
    outcome, names, sentence = _decide(ranking, tuned.chi2, samples)
    chi2_believed = float(start.exact @ start.exact)
    return Naming(outcome, names, ranking, chi2_believed, tuned.chi2, samples, sentence, rejected)


def _fit_promising(
    tuned: Local,
    start: Local | None,
    screened: Sequence[Screened],
    tested: int,
    rejected: dict[str, str],
    say: Callable[[str], None],
) -> list[EffectFit]:
    """Fit the effects that promise most, and say in ``rejected`` why the others are left out.

    Args:
        tuned: the believed model re-tuned.
        start: the believed model as it is, to descend from there, too; None if re-tuning was not strained.
        screened: every effect, screened at ``tuned``.
        tested: number of effects that are tested.
        rejected: effect -> why it was not fitted; added to.
        say: called with a few words as each fit begins.
    """
    followed = promising(screened, FOLLOWED, FOLLOWED_FAR, AT_LEAST)
    queue = [(one, 0) for i, one in enumerate(followed) if i < AT_LEAST or one.promise >= PROMISING]
    if start is not None:
        afresh = promising([screen(start, s.effect) for s in screened], FOLLOWED, FOLLOWED_FAR, AT_LEAST)
        queue += [(one, PATIENCE) for one in afresh[:FROM_BELIEVED]]
    fits: dict[str, EffectFit] = {}
    for one, patience in queue:
        say(f"fit {one.effect.title}")
        name, best_gain = one.effect.name, max((f.gain for f in fits.values()), default=0.0)
        found = fit(one, tuned.chi2, best_gain, tested, patience)
        if found is not None and (name not in fits or found.chi2 < fits[name].chi2):
            fits[name] = found
        elif name not in fits:
            rejected[name] = "nothing on the way to its best fit flies the measured commands"
    for one in screened:
        if one.seen and one.effect.name not in fits.keys() | rejected.keys():
            rejected[one.effect.name] = (
                f"promises a gain of {one.promise:.3g} only, against {followed[0].promise:.3g} of "
                f"{followed[0].effect.name}"
            )
    for name in fits.keys() & rejected.keys():  # it flew from one of the two bases
        del rejected[name]
    return list(fits.values())


def _ranked(fits: Sequence[EffectFit], samples: int) -> tuple[EffectFit, ...]:
    return tuple(sorted(fits, key=lambda f: -_score(f, samples)))


def _two_at_once(
    base: Local,
    chi2_tuned: float,
    screened: Sequence[Screened],
    ranking: Sequence[EffectFit],
    samples: int,
    tested: int,
    say: Callable[[str], None],
) -> list[EffectFit]:
    """Return the best pairs of effects if no single one leaves noise only; parameters of both are fitted together."""
    first = [f for f in ranking if f.significant and f.flown and f.share >= LEADS]
    if not first or _explains(first[0], samples, ENOUGH):
        return []
    pairs: list[EffectFit] = []
    for lead in first[:1]:
        say(f"fit a second effect beside {lead.effect.title}")
        factors = np.array([lead.tuning[n] for n in NUISANCES])
        point = base.moved(base.model.with_effect(lead.effect, lead.values), factors)
        if point is None:
            continue
        others = [screen(point, s.effect) for s in screened if s.seen and s.effect is not lead.effect]
        best_gain = max((f.gain for f in (*pairs, *ranking)), default=0.0)
        for other in promising(others, 0.5, 0.5, 1)[:3]:
            both = together(lead.effect, other.effect)
            begin = np.concatenate([np.array(list(lead.values.values())), other.starts[0]])
            descent = descend(Changes(base, both), begin, chi2_tuned - best_gain, PATIENCE)
            if descent is not None and descent.flown:
                found = summarise(both, descent, chi2_tuned, tested**2)
                if found.chi2 <= chi2.isf(FALSE_ALARM, samples):  # a form not quite right finds company, too
                    pairs.append(found)
                    best_gain = max(best_gain, found.gain)
    return pairs


def _explains(fit: EffectFit, samples: int, share: float) -> bool:
    """Return whether an effect explains a share of the excess, or leaves noise only."""
    return fit.chi2 <= chi2.isf(FALSE_ALARM, samples) or fit.share >= share


def _decide(ranking: Sequence[EffectFit], chi2_tuned: float, samples: int) -> tuple[str, tuple[str, ...], str]:
    """Return outcome, names and sentence."""
    is_noise = chi2.isf(FALSE_ALARM, samples)
    significant = [f for f in ranking if f.significant and f.flown]
    if not significant:
        if chi2_tuned <= is_noise:
            return "no gap", (), (
                f"no gap: no effect of the library gains more than noise would, and what is left is noise "
                f"(chi-square {chi2_tuned:.0f} over {samples} samples)"
            )  # fmt: skip
        return "unexplained", (), (
            f"unexplained: the residual exceeds the noise (chi-square {chi2_tuned:.0f} over {samples} samples), "
            "but no effect of the library explains any of it"
        )  # fmt: skip
    best = significant[0]
    close = [f for f in ranking if f is not best and f.flown and _indistinct(f, best, samples, best.chi2 <= is_noise)]
    if best.share < ENOUGH and best.chi2 > is_noise:
        return "unexplained", (), (
            f"unexplained: {best.effect.title} comes nearest, but explains only {100 * best.share:.0f} % of the excess"
        )  # fmt: skip
    if close:
        names = (best.effect.name, *(f.effect.name for f in close))
        told = "; ".join(f"{f.effect.title}, {f.size} (gain {f.gain:.4g})" for f in (best, *close))
        return "set", names, (
            f"one of these, which these data cannot tell apart: {told}. What separates them: {best.effect.separated_by}"
        )  # fmt: skip
    explained = "what is left is noise"
    if np.isfinite(best.share):
        explained = f"explains {100 * best.share:.1f} % of the excess over noise"
    return "named", (best.effect.name,), f"{best.effect.title}: {best.size}; {explained}"


def _score(fit: EffectFit, samples: int) -> float:
    """Return the gain less ln(samples) for each parameter (Schwarz 1978): the simpler of two equal effects leads."""
    return fit.gain - len(fit.values) * float(np.log(samples))


def _indistinct(fit: EffectFit, best: EffectFit, samples: int, is_noise: bool) -> bool:
    """Return whether ``fit`` may be the truth although ``best`` leads.

    If the best effect leaves noise only, likelihoods decide: a wrong effect leads the true one by TOLD_APART with a
    probability of FALSE_ALARM at most (Markov's bound on a likelihood ratio, effects of given size). If more than noise
    is left, the form of the best one is not quite right, and then a share of the gain is all there is to go by. A more
    general form of the best one is another name only if its further parameters gain more than noise would.
    """
    if best.effect.name in fit.effect.contains:
        extra = len(fit.values) - len(best.values)
        return fit.gain - best.gain > chi2.isf(FALSE_ALARM, max(extra, 1))
    behind = _score(best, samples) - _score(fit, samples)
    return behind < TOLD_APART or (not is_noise and fit.gain >= TOO_CLOSE * best.gain)
