"""Several effects at once: a second beside the best one, swaps, a third, and what can be left out again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.stats import chi2

from testbench.core.record import FloatArray
from testbench.effects import Effect
from testbench.effects.base import together
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.decide import (
    does_without,
    form_of,
    leads,
    leaves_far_more,
    leaves_noise,
    noise_limit,
    worth_of_form,
)
from testbench.questions.gap.search.fit import EffectFit, summarise
from testbench.questions.gap.search.gauss_newton import MAX_ROUNDS, descend
from testbench.questions.gap.search.hypothesis import Hypothesis, Signature
from testbench.questions.gap.search.parallel import Ahead, spread
from testbench.questions.gap.search.screening import SMALL, Screened, flown_best, promising, screen, screen_all

LEADS = 0.4  # share of the excess that the first of two effects must explain alone
PROMISED = 0.5  # share of what a second effect must gain that it must promise beside doubtful coefficients
COMPANY = 5  # most second effects that are fitted
IN_PLACE = 4  # and most of those that act in the place of a first one that is not the whole
# Coefficients are doubtful if values drawn from their priors lie as far off with less than this probability, and more
# than noise is left. They may then do what another effect does, so that one is sought beside the believed values, too.
DOUBTFUL = 0.05
SWAPPED = 0.5  # share of the first effect's gain with which another may take its place beside the second
PATIENCE = 2  # rounds before a descent of several effects may be given up, as it begins far from rest
PATIENCE_FAR = 6  # the same if coefficients are strained, or a fit that rested alone must rest beside another effect


def several_at_once(
    base: Hypothesis,
    chi2_tuned: float,
    screened: Sequence[Screened],
    ranking: Sequence[EffectFit],
    samples: int,
    tested: int,
    say: Callable[[str], None],
) -> list[EffectFit]:
    """Return fits of the best effect and a second one, or of three, all parameters together, if they leave only noise.

    The first effect is swapped for others that may do as well beside the second. If the best pair leaves more than
    noise, a third effect is sought. Then each part is left out again and the rest refitted. A part may have been found
    only because the others were not known yet, or because they came to rest beside it and had not done so alone.
    """
    noise = noise_limit(base.believed, samples)
    search = _Joint(base, chi2_tuned, screened, samples, tested, noise, say)
    lead = next((f for f in ranking if f.significant and f.flown), None)
    if lead is None or (lead.chi2 > noise and lead.share < LEADS):
        return []
    above = lead.chi2 - chi2.ppf(CRITERIA.rare, samples)  # the least that noise is; if below, the noise is not as said
    if leaves_noise(lead, noise) and 0.0 < above < form_of(CRITERIA.form_of_whole, lead.gain, lead.work):
        return []  # all that it leaves above that would be its form
    found = search.beside(lead, lead.effect, lead)
    best = min(found, key=lambda f: f.chi2, default=None)
    if best is not None:
        found += search.swapped(best, lead, ranking)
        best = min(found, key=lambda f: f.chi2)
        if not leaves_noise(best, noise):
            found += search.beside(best, best.effect, best)
    found = [f for f in found if f.chi2 <= noise]
    best = min(found, key=lambda f: f.chi2, default=None)
    if best is not None:
        simpler = search.simpler(best)
        found += simpler
        # A special case may take over the work of another part, which can then be left out.
        whole = [best, *sorted(simpler, key=lambda f: f.chi2)[:1]]
        while whole:
            rest = spread([partial(search.without, f, part, noise) for f in whole for part in f.effect.parts])
            less = [f for f in rest if f is not None and f.settled]
            found += less
            # Of three effects, two may only have helped the third to find where it rests.
            whole = [f for f in less if f.effect.parts and leaves_noise(f, noise)]
            whole = sorted(whole, key=lambda f: f.chi2)[:1]
        found = [f for f in found if not any(does_without(f, less, samples, noise) for less in (*ranking, *found))]
    return found


@dataclass(frozen=True)
class _Joint:
    """The search for several effects at once, all descents from one base."""

    base: Hypothesis
    chi2_tuned: float
    screened: Sequence[Screened]
    samples: int
    tested: int
    noise: float
    say: Callable[[str], None]

    def beside(self, known: EffectFit, first: Effect, rival: EffectFit) -> list[EffectFit]:
        """Return joint fits of an effect and one more that are clearly better than ``rival``.

        If the form of the first is not quite right, another effect gains beside it, too. The further effect must
        therefore gain more than noise would, more than it takes to tell two effects apart, and a large part of what
        ``rival`` leaves. A rival that strains the coefficients is not the whole.

        Args:
            known: fit whose values and re-tuned coefficients the search begins from.
            first: its effect, or a part of it, beside which the further effect is sought.
            rival: fit that must be beaten; its effects are not tried.
        """
        found: list[EffectFit] = []
        self.say(f"seek another effect beside {first.title}")
        # An effect whose work re-tuned coefficients do, far from their priors, may promise nothing beside them.
        bases = [self._nuisances(known)] + ([np.ones(len(self.base.priors))] if self._doubtful(rival) else [])
        for nuisances in bases:
            self._beside_at(nuisances, known, first, rival, found)
        return found

    def _beside_at(
        self, nuisances: FloatArray, known: EffectFit, first: Effect, rival: EffectFit, found: list[EffectFit]
    ) -> None:
        """Begin from ``nuisances`` (k,); adds to ``found``."""
        values = self._values(known, first)
        point = self._point(first, values, nuisances)
        if point is None:
            return
        taken = {p.name for p in first.singles + rival.effect.singles}
        doubtful, believed = self._doubtful(rival), bool(np.all(nuisances == 1.0))
        free = [s.effect for s in self.screened if s.seen and s.effect.name not in taken]
        others = screen_all([(point, e) for e in free], far=believed)
        if doubtful:  # beside strained coefficients an effect may do little but relieve them
            linear, flown = point.afresh(False), point.afresh(True)
            small = screen_all([(flown if e.flown else linear, e) for e in free], SMALL)
            others = [max(pair, key=lambda s: s.promise) for pair in zip(others, small, strict=True)]
        excess = 0.0 if rival.chi2 <= self.noise else CRITERIA.second * (rival.chi2 - self.samples)
        least = {s.effect.name: max(excess, self._form(rival, s.effect), CRITERIA.told_apart) for s in others}
        re_tuned = float(np.sum(point.tuned(point.exact)[0] ** 2))
        share = PROMISED if doubtful else 1.0
        worth = [s for s in others if s.promise > share * least[s.effect.name] + re_tuned - rival.chi2]
        queue = promising(worth, 0.5, 0.5, 1)
        # It may promise little at the believed values, too. The one that gains most with coefficients held is tried.
        relief = [max(others, key=lambda s: s.alone)] if doubtful and others and believed else []
        # Nor does what acts in the place of the first, which has taken over its work until both are fitted.
        shared = [s for s in others if s.seen and s.effect.place == first.place] if self._not_whole(rival) else []
        shared = sorted(shared, key=lambda s: -s.promise)[:IN_PLACE]
        first_ones = relief + [s for s in shared if s not in relief]
        others_first = first_ones + [s for s in queue if s not in first_ones]
        patience = PATIENCE_FAR if doubtful else PATIENCE

        def task(other: Screened) -> tuple[tuple[str, float], Callable[[], EffectFit | None]]:
            """Return a fit of one more effect, behind a key: the effect, and what the fits found before it require."""
            others_found = (f.chi2 + CRITERIA.told_apart for f in found if f.within >= CRITERIA.strained)
            lowest = min([rival.chi2 - least[other.effect.name], *others_found])
            begin = np.concatenate([values, other.starts[0]])
            effects = (*first.singles, other.effect)
            rounds = PATIENCE_FAR if other in shared else patience
            return (other.effect.name, lowest), partial(self._fit, effects, begin, nuisances, lowest, rounds)

        def known_already(other: Screened) -> bool:
            """Return whether this, or a special case of it, was found to leave noise."""
            both = together(*first.singles, other.effect)
            leaving_noise = (f.effect for f in found if f.chi2 <= self.noise)
            return any(both.name == e.name or both.generalises(e) for e in leaving_noise)

        left = COMPANY + len(first_ones)
        with Ahead() as ahead:
            while left and others_first:
                other, *others_first = others_first
                if known_already(other):
                    continue
                # The next ones begin as if this one found nothing; where it does, they begin anew.
                next_ones = [o for o in others_first if not known_already(o)][: left - 1]
                ahead.begin_first(dict(task(o) for o in (other, *next_ones)))
                both = ahead.take(*task(other))
                left -= 1
                more = least[other.effect.name]
                if both is not None and both.gain - rival.gain > more and leads(both, rival, self.samples, self.noise):
                    found.append(both)

    def _form(self, rival: EffectFit, other: Effect) -> float:
        """Return the gain of another effect beside ``rival`` that the form of ``rival`` may account for."""
        return worth_of_form(rival, other, self.samples, self.noise)

    def _not_whole(self, rival: EffectFit) -> bool:
        """Return whether a single effect leaves far more than its form may."""
        return not rival.effect.parts and leaves_far_more(rival, self.samples)

    def _doubtful(self, rival: EffectFit) -> bool:
        """Return whether re-tuned coefficients may do in ``rival`` what an effect does."""
        return rival.within < (DOUBTFUL if rival.chi2 > self.noise else CRITERIA.strained)

    def swapped(self, pair: EffectFit, lead: EffectFit, ranking: Sequence[EffectFit]) -> list[EffectFit]:
        """Return fits of the second effect of ``pair`` beside those that alone come nearest to its first, ``lead``."""
        second = pair.effect.parts[-1]
        taken = {p.name for p in pair.effect.parts}
        rivals = [f for f in ranking if not f.effect.parts and f.effect.name not in taken]
        rivals = [f for f in rivals if f.gain > SWAPPED * lead.gain]
        # A fit that was given up is known only by its promise, which it may keep beside the second effect.
        given_up = [f for f in rivals if not f.flown and len(f.values) == 1][:COMPANY]
        begun = []
        for rival in [*[f for f in rivals if f.flown][:COMPANY], *given_up]:
            effects = (rival.effect, second)
            if pair.chi2 <= self.noise and together(*effects).generalises(pair.effect):
                continue
            begin = np.concatenate([self._values(rival, rival.effect), self._values(pair, second)])
            task = partial(
                self._fit, effects, begin, self._nuisances(pair), pair.chi2 + CRITERIA.told_apart, PATIENCE_FAR
            )
            begun.append((rival, task))
        found = zip((rival for rival, _ in begun), spread([task for _, task in begun]), strict=True)
        return [
            both
            for rival, both in found
            if both is not None
            and both.gain - rival.gain > self._form(rival, second)
            and leads(both, lead, self.samples, self.noise)
        ]

    def simpler(self, joint: EffectFit) -> list[EffectFit]:
        """Return fits of ``joint`` with one of its parts replaced by a special case of that part, if they leave noise.

        The general form may be the only one that found its way there.
        """
        found = []
        for part in joint.effect.parts:
            rest, values = self._rest(joint, part)
            nuisances = self._nuisances(joint)
            special = [s.effect for s in self.screened if s.seen and part.generalises(s.effect)]
            point = self._point(_one(rest), values, nuisances) if special else None
            if point is None:
                continue
            for screened in (flown_best(point, screen(point, e)) for e in special):
                if screened.seen:
                    begin = np.concatenate([values, screened.starts[0]])
                    found.append(self._fit((*rest, screened.effect), begin, nuisances, self.noise, MAX_ROUNDS))
        return [f for f in found if f is not None and f.chi2 <= self.noise]

    def without(self, joint: EffectFit, part: Effect, hopeless: float) -> EffectFit | None:
        """Return the fit of ``joint`` without one of its parts, from the values that the others have in it."""
        rest, values = self._rest(joint, part)
        return self._fit(rest, values, self._nuisances(joint), hopeless)

    def _rest(self, joint: EffectFit, part: Effect) -> tuple[tuple[Effect, ...], FloatArray]:
        """Return the other parts of a joint fit, and the values (p,) that they have in it."""
        rest = tuple(p for p in joint.effect.parts if p is not part)
        return rest, np.concatenate([self._values(joint, p) for p in rest])

    def _point(self, effect: Effect, values: FloatArray, nuisances: FloatArray) -> Hypothesis | None:
        """Return the point with an effect at values (p,) and coefficients (k,); None if it cannot fly."""
        return self.base.moved(Signature(self.base, effect).model(values), nuisances)

    def _nuisances(self, fit: EffectFit) -> FloatArray:
        return self.base.vector(fit.nuisances)

    @staticmethod
    def _values(fit: EffectFit, effect: Effect) -> FloatArray:
        """Return the values (p,) that a fit gives an effect, its own or a part of it."""
        prefix = "" if effect.name == fit.effect.name else f"{effect.name}."
        return np.array([fit.values[prefix + p.name] for p in effect.parameters])

    def _fit(
        self,
        effects: tuple[Effect, ...],
        begin: FloatArray,
        nuisances: FloatArray,
        hopeless: float,
        patience: int = PATIENCE,
    ) -> EffectFit | None:
        """Descend from values (p,) and coefficients (k,) at which one of the effects, or more, came to rest before."""
        effect = _one(effects)
        near = self.base.moved(self.base.model, nuisances) or self.base
        descent = descend(Signature(near, effect), begin, hopeless, patience, near=True)
        if descent is None or not descent.flown:
            return None
        return summarise(effect, descent, self.chi2_tuned, self.tested ** len(effects), self.base)


def _one(effects: tuple[Effect, ...]) -> Effect:
    """Return several effects put together as one, or the only one itself."""
    return together(*effects) if len(effects) > 1 else effects[0]
