"""Name the missing effect: fit every effect of the library, compare likelihoods, decide with stated error rates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from testbench.core.record import FlightRecord
from testbench.questions.gap.believed import LATERAL_PRIORS, PRIORS, Believed
from testbench.questions.gap.effects import Effect, library
from testbench.questions.gap.search.fit import (
    FALSE_ALARM,
    HOPELESS,
    HOPELESS_AT_FIRST,
    HOPELESS_BESIDE_NOISE,
    EffectFit,
    fit,
)
from testbench.questions.gap.search.gauss_newton import MAX_ROUNDS, retune, within_priors
from testbench.questions.gap.search.gust_search import doubted, sought
from testbench.questions.gap.search.hypothesis import Hypothesis
from testbench.questions.gap.search.likelihood import (
    LEAST,
    STRAINED,
    TOLD_APART,
    believable,
    is_special_case,
    leaves_far_more,
    leaves_noise,
    noise_floor,
    noise_limit,
    score,
)
from testbench.questions.gap.search.parallel import Ahead
from testbench.questions.gap.search.polish import polished
from testbench.questions.gap.search.scatter import scattered
from testbench.questions.gap.search.screening import Screened, flown_best, promising, screen, screen_all, screen_closely
from testbench.questions.gap.search.several import several_at_once

ENOUGH = 0.95  # share of the excess that a named effect must explain, unless it leaves noise,
ENOUGH_ALONE = 0.80  # or this share where nothing but its own other forms
NEAR = 0.5  # gains as much as this share of what it gains: its form may be off, but it is the only one of its kind
TOO_CLOSE = 0.85  # a runner-up with this share of the best gain cannot be told apart while more than noise is left,
TWICE = 2.0  # unless it leaves so many times what the best one leaves above the noise
FOLLOWED = 0.25  # effects that promise less than this share of what the best one promises are not fitted,
FOLLOWED_FAR = 0.1  # of effects with several parameters, of which screening tries few combinations, less than this
PROMISING = 5.0  # nor are effects that promise a smaller gain than this, a third of any threshold; but
AT_LEAST = 3  # this many always are
FROM_BELIEVED = 6  # so many of them,
PATIENCE = 2  # and descents from there are given two rounds to settle before they may be called hopeless,
PATIENCE_BESIDE_NOISE = 1  # or one if another effect leaves noise only
MANY = 4  # more names than these are no answer


@dataclass(frozen=True, eq=False)
class Naming:
    """The outcome of naming.

    Attributes:
        outcome: "no gap", "named", "set" (cannot be told apart) or "unexplained".
        names: the named effect, or the set, best first; empty otherwise. Two effects at once are one name, "A + B".
        ranking: all effects, best first.
        chi2_believed: weighted sum of squares of the believed model, nothing re-tuned.
        chi2_tuned: the same after re-tuning the nuisances within their priors.
        nuisances: nuisance -> value of that re-tuning.
        samples: number of samples in those sums.
        sentence: the outcome in words.
        rejected: effect that was not fitted -> why.
        measured: nuisance -> (value, standard error) of the re-tuning without any effect, the prior left out.
    """

    outcome: str
    names: tuple[str, ...]
    ranking: tuple[EffectFit, ...]
    chi2_believed: float
    chi2_tuned: float
    nuisances: Mapping[str, float]
    samples: int
    sentence: str
    rejected: Mapping[str, str] = field(default_factory=dict)
    measured: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def noise_left(self) -> bool:
        """True if what is left, beside the effect that is added if there is one, is noise in still air."""
        left = self.chi2_tuned if self.best is None else self.best.chi2
        return left <= float(chi2.isf(FALSE_ALARM, self.samples))

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
    for record in records:
        believed.check_commands(record)
    start = Hypothesis.at(believed, believed, tuple(records))
    tuned = retune(start)
    say("screen the library")
    choice = tuple(sought(tuned, e) for e in (library(believed.suite) if effects is None else effects).values())
    linear = tuned.afresh(False)  # tangents of the kind that the effect is predicted with, else the two never cancel
    screened = screen_all([(tuned if e.flown else linear, e) for e in choice])
    rejected = {s.effect.name: s.why for s in screened if not s.seen}
    tested = max(1, len(screened) - len(rejected))
    samples = start.samples
    floor = noise_floor(believed, samples)
    strained = tuned.chi2 > noise_limit(believed, samples) or within_priors(tuned) < STRAINED
    if not strained:
        say("screen the library closely")
        screened = screen_closely(tuned, screened)
    fits = _fit_promising(tuned, start if strained else None, screened, tested, rejected, say)
    base = start if strained else tuned
    scatter = scattered(base, fits, tuned.chi2)
    if scatter is not None:
        fits = [scatter if f.effect is scatter.effect else f for f in fits]
    elif pairs:
        for found in several_at_once(base, tuned.chi2, screened, _ranked(fits, samples), samples, tested, say):
            same = [f for f in fits if {e.name for e in f.effect.singles} == {e.name for e in found.effect.singles}]
            if not any(f.flown and f.chi2 < found.chi2 for f in same):
                fits = [f for f in fits if f not in same] + [found]
    ranking = _ranked(polished(base, _ranked(fits, samples), tuned.chi2), samples)
    outcome, names, sentence = _decide(ranking, tuned.chi2, samples, floor)
    chi2_believed = float(start.exact @ start.exact)
    nuisances, measured = tuned.by_name, tuned.measured()
    said = Naming(outcome, names, ranking, chi2_believed, tuned.chi2, nuisances, samples, sentence, rejected, measured)
    return doubted(said, believed, records)


def _fit_promising(
    tuned: Hypothesis,
    start: Hypothesis | None,
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
    if start is not None:  # these first: where one of them explains all, what re-tuning had to stretch for is soon left
        there = screen_all([(start, s.effect) for s in screened], far=True)
        afresh = promising(there, FOLLOWED, FOLLOWED_FAR, AT_LEAST)[:FROM_BELIEVED]
        # What relieves re-tuned coefficients that explain all but lie far from what is believed promises nothing there.
        relief = [s.effect for s in followed[:AT_LEAST]]
        # Nor does an effect whose work they do, from where they stand: what does most alone may find it out of reach
        # for them, as an elevator that is weak by coefficients cannot be trimmed.
        relief += [s.effect for s in sorted(there, key=lambda s: -s.alone)[:1]]
        afresh += [s for s in there if s.seen and s.effect in relief and s not in afresh]
        queue = [(replace(one, starts=one.starts[:1]), PATIENCE) for one in afresh] + queue
    fits: dict[str, EffectFit] = {}
    noise = noise_limit(tuned.believed, tuned.samples)
    with Ahead() as ahead:
        for i, (one, patience) in enumerate(queue):
            name, asked = one.effect.name, _asked(one, patience, fits, noise)
            if isinstance(asked, str):
                rejected.update({name: asked} if asked else {})
                continue
            # The next ones begin as if this one changed nothing; where it does, they begin anew.
            tasks = {
                (j, told): partial(fit, next_one, tuned.chi2, told.best_gain, tested, *told[1:])
                for j, (next_one, its_patience) in enumerate(queue)
                if j >= i and not isinstance(told := _asked(next_one, its_patience, fits, noise), str)
            }
            ahead.begin_first(tasks)
            say(f"fit {one.effect.title}")
            found = ahead.take((i, asked), tasks[i, asked])
            if found is not None and (name not in fits or found.chi2 < fits[name].chi2):
                fits[name] = replace(found, effect=one.effect)
            elif name not in fits:
                rejected[name] = "nothing on the way to its best fit flies the measured commands"
    _refit_special_cases(tuned if start is None else start, tuned.chi2, screened, tested, fits, say)
    most = max((f.gain for f in fits.values()), default=0.0)
    for one in screened:
        if one.seen and one.effect.name not in fits.keys() | rejected.keys():
            rejected[one.effect.name] = f"promises a gain of {one.promise:.3g} only, against {most:.3g} of the best"
    for name in fits.keys() & rejected.keys():  # it flew from one of the two bases
        del rejected[name]
    return list(fits.values())


class _Asked(NamedTuple):
    """What a fit is told of those before it, in the order of the arguments of :func:`.fit.fit`."""

    best_gain: float
    patience: int
    hopeless: float
    at_first: float | None = None


def _asked(one: Screened, patience: int, fits: Mapping[str, EffectFit], noise: float) -> _Asked | str:
    """Return what a fit is told when ``fits`` have been made, or why there is to be none; "" if there is one."""
    name = one.effect.name
    best = min(fits.values(), key=lambda f: f.chi2, default=None)
    best_gain = 0.0 if best is None else best.gain
    if best is not None and best is fits.get(name) and best.settled:
        return ""  # from the other base it would come to rest at the same place
    # Where one leaves noise and strains nothing, nothing can explain more: what could explain as much?
    if best is None or not leaves_noise(best, noise):
        return _Asked(best_gain, patience, HOPELESS)
    share = FOLLOWED if len(one.effect.parameters) == 1 else FOLLOWED_FAR
    # What was given up far from rest, before it flew, has yet to be tried from where coefficients rest.
    if (name in fits and fits[name].flown) or (len(fits) > 1 and one.promise < share * best_gain):
        return ""
    if one.effect.generalises(best.effect):
        return f"{best.effect.title}, a special case of it, leaves noise only"
    return _Asked(best_gain, PATIENCE_BESIDE_NOISE, HOPELESS_BESIDE_NOISE, HOPELESS_AT_FIRST)


def _refit_special_cases(
    base: Hypothesis,
    chi2_tuned: float,
    screened: Sequence[Screened],
    tested: int,
    fits: dict[str, EffectFit],
    say: Callable[[str], None],
) -> None:
    """Fit the special cases of the best effect to their end, whatever they promise; replaces what ``fits`` has of them.

    A general form may find its way to a special case, or near one, that the special case itself was given up on, or
    where it came to rest elsewhere: it begins anew beside the coefficients that the general form has found.
    """
    best = min(fits.values(), key=lambda f: f.chi2, default=None)
    if best is None:
        return
    near = None
    for one in screened:
        name = one.effect.name
        if not one.seen or one.effect is best.effect or not best.effect.generalises(one.effect):
            continue
        if name not in fits or fits[name].chi2 - best.chi2 > TOLD_APART:
            near = near or base.moved(base.model, base.vector(best.nuisances)) or base
            say(f"fit {one.effect.title}, a special case of {best.effect.title}")
            found = fit(flown_best(near, screen(near, one.effect)), chi2_tuned, 0.0, tested, MAX_ROUNDS, near=True)
            if found is not None and (name not in fits or found.chi2 < fits[name].chi2):
                fits[name] = found


def _ranked(fits: Sequence[EffectFit], samples: int) -> tuple[EffectFit, ...]:
    """Return the best fit of every effect, flown if any of them was, by score."""
    best: dict[str, EffectFit] = {}
    for f in sorted(fits, key=lambda f: (not f.flown, f.chi2)):
        best.setdefault(f.effect.name, f)
    return tuple(sorted(best.values(), key=lambda f: -score(f, samples)))


def _decide(
    ranking: Sequence[EffectFit], chi2_tuned: float, samples: int, floor: float
) -> tuple[str, tuple[str, ...], str]:
    """Return outcome, names and sentence."""
    noise = chi2.isf(FALSE_ALARM, floor)
    significant = [f for f in ranking if f.significant and f.flown and f.gain > LEAST]
    if not significant:
        if chi2_tuned <= noise:
            return "no gap", (), (
                f"no gap: no effect of the library gains more than noise would, and what is left is noise "
                f"(chi-square {chi2_tuned:.0f} over {samples} samples)"
            )  # fmt: skip
        return "unexplained", (), (
            f"unexplained: the residual exceeds the noise (chi-square {chi2_tuned:.0f} over {samples} samples), "
            "but no effect of the library explains any of it"
        )  # fmt: skip
    best = _foremost(significant, samples)
    others = [f for f in ranking if f is not best and f.flown and believable(f)]
    close = [f for f in others if _indistinct(f, best, samples, best.chi2 <= noise)]
    if best.within < STRAINED:
        return "unexplained", (), (
            f"unexplained: {best.effect.title}, {best.size}, comes nearest, but only beside coefficients that are "
            f"farther off than is believed of them: {_stretched(best)}"
        )  # fmt: skip
    if best.beyond:
        return "unexplained", (), (
            f"unexplained: {best.effect.title}, {best.size}, comes nearest, but the records ask for more of it than is "
            f"physically possible: {', '.join(best.beyond)} lies at the end of its range"
        )  # fmt: skip
    strangers = [f for f in ranking if not (f is best or _of_one_kind(f.effect, best.effect))]
    enough = ENOUGH if any(f.gain > NEAR * best.gain for f in strangers) else ENOUGH_ALONE
    if not best.share >= enough and best.chi2 > noise:
        part = f"only {100 * best.share:.0f} % of the excess" if np.isfinite(best.share) else "too little of it"
        return "unexplained", (), f"unexplained: {best.effect.title} comes nearest, but explains {part}"
    if leaves_far_more(best, floor):
        left = best.chi2 - floor
        return "unexplained", (), (
            f"unexplained: {best.effect.title} comes nearest, but of {best.gain + left:.0f} of chi-square above the "
            f"noise it leaves {left:.0f}: a relative of it, or another effect beside it, is the truth"
        )  # fmt: skip
    if len(close) >= MANY:
        near = ", ".join(f.effect.title for f in (best, *close))
        return "unexplained", (), (
            f"unexplained: {1 + len(close)} effects come near and these data do not tell them apart: {near}"
        )  # fmt: skip
    alone = _common(best, close, ranking)
    if alone is not None:
        return "named", (alone.effect.name,), (
            f"{alone.effect.title}: {alone.size}; explains {100 * alone.share:.1f} % of the excess over noise. What it "
            f"leaves is either its form or one of several other effects, which these data cannot tell apart"
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
    if best.chi2 > noise and not best.scatter_s:
        explained += (
            "; what it leaves is more than noise: its form is not quite right, or an effect like it is the truth"
        )
    return "named", (best.effect.name,), f"{best.effect.title}: {best.size}; {explained}"


def _foremost(significant: Sequence[EffectFit], samples: int) -> EffectFit:
    """Return the best of some fits in the order of their scores: the first one, or what does as well in its place.

    Where the first is not believable, that is one that is and trails it by no more than chance would; of either, a
    special case that gains no less than noise or form would make it.
    """
    best = significant[0]
    sound = [f for f in significant if believable(f)]
    if not believable(best):
        best = next((f for f in sound if score(best, samples) - score(f, samples) < TOLD_APART), best)
    return min((f for f in sound if is_special_case(f, best)), key=lambda f: len(f.values), default=best)


def _common(best: EffectFit, close: Sequence[EffectFit], ranking: Sequence[EffectFit]) -> EffectFit | None:
    """Return the fit of what several sets of effects have in common, if they are told apart by nothing else.

    Where it alone explains enough, that each of several others beside it explains the rest speaks for none of them.
    """
    parts = [{p.name for p in f.effect.singles} for f in (best, *close)]
    common = set.intersection(*parts)
    if not close or not common or any(p == common for p in parts):
        return None
    alone = (f for f in ranking if {p.name for p in f.effect.singles} == common)
    return next((f for f in alone if f.flown and believable(f) and f.share >= ENOUGH), None)


def _of_one_kind(a: Effect, b: Effect) -> bool:
    return a.generalises(b) or b.generalises(a)


def _stretched(fit: EffectFit) -> str:
    """Return the coefficients that a fit asks most of, in words."""
    priors = {**PRIORS, **LATERAL_PRIORS}
    off = sorted(((abs(f - 1.0) / priors[n], n, f) for n, f in fit.nuisances.items()), reverse=True)
    told = [o for o in off if o[0] > 0.5 * off[0][0]][:3]
    return ", ".join(f"{n} {f:.3g} times the believed value ({z:.1f} standard deviations)" for z, n, f in told)


def _indistinct(fit: EffectFit, best: EffectFit, samples: int, is_noise: bool) -> bool:
    """Return whether ``fit`` may be the truth although ``best`` leads.

    If the best effect leaves noise only, likelihoods decide: a wrong effect leads the true one by TOLD_APART with a
    probability of FALSE_ALARM at most (Markov's bound on a likelihood ratio, effects of given size). If more than noise
    is left, the form of the best one is not quite right, and then what they gain and leave is all there is to go by. A
    more general form of the best one is another name only if its further parameters gain more than noise or form would;
    a special case of it is none.
    """
    if fit.effect.generalises(best.effect):
        return not is_special_case(best, fit)
    if best.effect.generalises(fit.effect):
        return False  # it would have been named in its place
    behind = score(best, samples) - score(fit, samples)
    near = fit.gain >= TOO_CLOSE * best.gain and fit.chi2 - samples < TWICE * (best.chi2 - samples)
    return behind < TOLD_APART or (not is_noise and near)
