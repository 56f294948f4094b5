"""Name the missing effect: fit every effect of the library, compare likelihoods, decide with stated error rates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from testbench.core.record import FlightRecord
from testbench.effects import Effect, library
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.decide import (
    Naming,
    decide,
    doubted,
    leaves_noise,
    noise_floor,
    noise_limit,
    score,
    without_structure,
)
from testbench.questions.gap.priors import deviations_of
from testbench.questions.gap.search.fit import HOPELESS, HOPELESS_AT_FIRST, HOPELESS_BESIDE_NOISE, EffectFit, fit
from testbench.questions.gap.search.gauss_newton import MAX_ROUNDS, retune, within_priors
from testbench.questions.gap.search.gust_search import sought
from testbench.questions.gap.search.hypothesis import Hypothesis
from testbench.questions.gap.search.parallel import Ahead
from testbench.questions.gap.search.polish import polished
from testbench.questions.gap.search.scatter import scattered
from testbench.questions.gap.search.screening import Screened, flown_best, promising, screen, screen_all, screen_closely
from testbench.questions.gap.search.several import several_at_once

FOLLOWED = 0.25  # share of the best promise that an effect with one parameter must promise to be fitted
FOLLOWED_FAR = 0.1  # the same for several parameters, of which screening tries few combinations
PROMISING = 5.0  # gain that an effect must promise to be fitted, a third of any threshold
AT_LEAST = 3  # number of effects that are fitted whatever they promise
FROM_BELIEVED = 6  # most effects that are fitted from the believed coefficients
PATIENCE = 2  # rounds before a descent from there may be called hopeless
PATIENCE_BESIDE_NOISE = 1  # the same for any descent if another effect leaves only noise


def name_effect(
    believed: Believed,
    records: Sequence[FlightRecord],
    progress: Callable[[str], None] | None = None,
    effects: Mapping[str, Effect] | None = None,
    pairs: bool = True,
) -> Naming:
    """Fit every effect of the library to ``records`` and decide which, if any, the believed model lacks.

    The noise is known from the sensor suite. If there is no effect, twice the gain in log-likelihood is therefore
    chi-square distributed, with as many degrees of freedom as the effect has parameters (Wilks 1938). Bonferroni's
    bound over all effects that these records could show makes FALSE_ALARM hold for all of them together. This holds in
    still air, or in turbulence if ``believed.whiten`` makes the residuals white.

    Every effect is screened on linear predictions: its signature at its starts, nuisances re-tuned, is compared with
    the residual. The effects that promise most are fitted.

    Args:
        believed: aircraft, sensors and condition as believed.
        records: measured records.
        progress: called with a few words as each stage begins.
        effects: the library, by name; that of the suite if not given.
        pairs: if no single effect explains enough, try two at once.

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
    known = library(believed.suite, believed.aircraft) if effects is None else effects
    choice = tuple(sought(tuned, e) for e in known.values())
    linear = tuned.afresh(False)  # tangents of the kind that the effect is predicted with, else the two never cancel
    screened = screen_all([(tuned if e.flown else linear, e) for e in choice])
    rejected = {s.effect.name: s.why for s in screened if not s.seen}
    tested = max(1, len(screened) - len(rejected))
    samples = start.samples
    floor = noise_floor(believed, samples)
    near_noise = tuned.chi2 <= noise_limit(believed, samples)
    strained = not near_noise or within_priors(tuned) < CRITERIA.strained
    if near_noise:
        say("screen the library closely")
        screened = screen_closely(tuned, screened)
    fits = _fit_promising(tuned, start if strained else None, screened, tested, rejected, say)
    base = start if strained else tuned
    imitated = within_priors(tuned) < CRITERIA.strained
    fits = _with_work(base, fits) if imitated else fits
    scatter = scattered(base, fits, tuned.chi2)
    if scatter is not None:
        fits = [scatter if f.effect is scatter.effect else f for f in fits]
    elif pairs:
        for found in several_at_once(base, tuned.chi2, screened, _ranked(fits, samples), samples, tested, say):
            same = [f for f in fits if {e.name for e in f.effect.singles} == {e.name for e in found.effect.singles}]
            if not any(f.flown and f.chi2 < found.chi2 for f in same):
                fits = [f for f in fits if f not in same] + [found]
    fits = polished(base, _ranked(fits, samples), tuned.chi2)
    ranking = _ranked(_with_work(base, fits) if imitated else fits, samples)
    outcome, names, sentence = decide(ranking, tuned.chi2, samples, floor, deviations_of(believed.aircraft))
    chi2_believed = float(start.exact @ start.exact)
    nuisances, measured = tuned.by_name, tuned.measured()
    said = Naming(outcome, names, ranking, chi2_believed, tuned.chi2, nuisances, samples, sentence, rejected, measured)
    return without_structure(doubted(said, believed, records), believed, records)


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
        start: the believed model as it is, from which effects are fitted, too; None if re-tuning was not strained.
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
        # An effect whose work re-tuned coefficients do, far from their priors, promises nothing beside them.
        relief = [s.effect for s in followed[:AT_LEAST]]
        # It may also promise nothing at the believed values. The one that gains most with coefficients held is fitted
        # all the same: they may not reach as far, as an elevator that is weak by coefficients cannot be trimmed.
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
    """What a fit takes from the fits before it, in the order of the arguments of :func:`.fit.fit`."""

    best_gain: float
    patience: int
    hopeless: float
    at_first: float | None = None


def _asked(one: Screened, patience: int, fits: Mapping[str, EffectFit], noise: float) -> _Asked | str:
    """Return what a fit takes from ``fits``, or why it is not made; "" if that needs no saying."""
    name = one.effect.name
    best = min(fits.values(), key=lambda f: f.chi2, default=None)
    best_gain = 0.0 if best is None else best.gain
    if best is not None and best is fits.get(name) and best.settled:
        return ""  # from the other base it would come to rest at the same place
    # If one leaves noise and strains nothing, no other can explain more. Those that may explain as much are fitted.
    if best is None or not leaves_noise(best, noise):
        return _Asked(best_gain, patience, HOPELESS)
    share = FOLLOWED if len(one.effect.parameters) == 1 else FOLLOWED_FAR
    # What was given up far from rest, before it gained, has yet to be tried from where coefficients rest.
    if name in fits and (fits[name].settled or fits[name].gain > 0.0):
        return ""
    if len(fits) > 1 and one.promise < share * best_gain:
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
    """Fit the special cases of the best effect to their end, whatever they promise; replace their entries in ``fits``.

    A general form may come to rest at a special case, or near one, although the fit of the special case itself was
    given up or came to rest elsewhere. The special case then begins anew beside the coefficients that the general form
    found.
    """
    best = min(fits.values(), key=lambda f: f.chi2, default=None)
    if best is None:
        return
    near = None
    for one in screened:
        name = one.effect.name
        if not one.seen or one.effect is best.effect or not best.effect.generalises(one.effect):
            continue
        if name not in fits or fits[name].chi2 - best.chi2 > CRITERIA.told_apart:
            near = near or base.moved(base.model, base.vector(best.nuisances)) or base
            say(f"fit {one.effect.title}, a special case of {best.effect.title}")
            found = fit(flown_best(near, screen(near, one.effect)), chi2_tuned, 0.0, tested, MAX_ROUNDS, near=True)
            if found is not None and (name not in fits or found.chi2 < fits[name].chi2):
                fits[name] = found


def _with_work(base: Hypothesis, fits: Sequence[EffectFit]) -> list[EffectFit]:
    """Return ``fits``, those that gain about as much as the best with what they do beside their own coefficients.

    Where coefficients had to be strained to do without any effect, they do most of what the effect does.
    """
    most = max((f.gain for f in fits), default=0.0)
    first = [f.flown and f.settled and f.significant and f.gain > CRITERIA.near * most for f in fits]
    out = []
    for f, leads in zip(fits, first, strict=True):
        without = base.moved(base.model, base.vector(f.nuisances)) if leads else None
        out.append(f if without is None else replace(f, work=max(without.chi2 - f.chi2, 0.0)))
    return out


def _ranked(fits: Sequence[EffectFit], samples: int) -> tuple[EffectFit, ...]:
    """Return the best fit of every effect, flown if any of them was, by score."""
    best: dict[str, EffectFit] = {}
    for f in sorted(fits, key=lambda f: (not f.flown, f.chi2)):
        best.setdefault(f.effect.name, f)
    return tuple(sorted(best.values(), key=lambda f: -score(f, samples)))
