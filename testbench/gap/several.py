"""Several effects at once: a second beside the best one, swaps, a third, and what can be left out again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.gap.effects import Effect
from testbench.gap.effects.base import together
from testbench.gap.evidence import STRAINED, TOLD_APART, is_noise, score
from testbench.gap.fit import EffectFit, Screened, descend, promising, screen, summarise
from testbench.gap.local import Changes, Local
from testbench.record import FloatArray

LEADS = 0.4  # of two effects, the first alone explains this share of the excess at least,
SECOND = 0.35  # and the second this share of what the first leaves above the noise, and
FORM = 5e-4  # more than this share of what the first gains, as no form is exactly right
COMPANY = 3  # so many second effects are fitted
SWAPPED = 0.5  # what alone gains this share of what the first does may take its place beside the second
PATIENCE = 2  # rounds before a descent of several may be given up: it begins far from rest


def several_at_once(
    base: Local,
    chi2_tuned: float,
    screened: Sequence[Screened],
    ranking: Sequence[EffectFit],
    samples: int,
    tested: int,
    say: Callable[[str], None],
) -> list[EffectFit]:
    """Return fits of the best effect and a second one, or of three, all parameters together, if they leave only noise.

    What was named first is swapped for what may do as well beside the second, and where the best pair leaves more than
    noise, a third is sought. Of what is found each part but the last is left out again and the rest refitted: it may
    have been named only because the others were not known yet.
    """
    noise = is_noise(base)
    search = _Joint(base, chi2_tuned, screened, samples, tested, noise, say)
    lead = next((f for f in ranking if f.significant and f.flown), None)
    if lead is None or (lead.chi2 > noise and lead.share < LEADS):
        return []
    found = search.beside(lead, lead.effect, lead)
    best = min(found, key=lambda f: f.chi2, default=None)
    if best is not None:
        found += search.swapped(best, lead, ranking)
        best = min(found, key=lambda f: f.chi2)
        if best.chi2 > noise or best.within < STRAINED:
            found += search.beside(best, best.effect, best)
    found = [f for f in found if f.chi2 <= noise]
    best = min(found, key=lambda f: f.chi2, default=None)
    if best is not None:
        fitted = {f.effect.name for f in (*ranking, *found) if f.flown}
        rest = [search.without(best, part, noise) for part in best.effect.parts[:-1]]
        found += [f for f in rest if f is not None and f.settled and f.effect.name not in fitted]
    return found


@dataclass(frozen=True)
class _Joint:
    """The search for several effects at once, all descents from one base."""

    base: Local
    chi2_tuned: float
    screened: Sequence[Screened]
    samples: int
    tested: int
    noise: float
    say: Callable[[str], None]

    def beside(self, known: EffectFit, first: Effect, rival: EffectFit) -> list[EffectFit]:
        """Return joint fits of an effect and one more that are clearly better than ``rival``.

        A form of the first that is not quite right finds company, too: the further effect must gain more than noise
        would, more than it takes to tell two effects apart, and most of what ``rival`` leaves. A rival that strains
        what is believed of the coefficients has shown that it is not the whole.

        Args:
            known: fit whose values and re-tuning are begun from.
            first: its effect, or a part of it: what the further effect is sought beside.
            rival: what must be beaten; its effects are not tried.
        """
        values = self._values(known, first)
        named = dict(zip((p.name for p in first.parameters), values.tolist(), strict=True))
        tuning = self._tuning(known)
        point = self.base.moved(self.base.model.with_effect(first, named), tuning)
        if point is None:
            return []
        self.say(f"seek another effect beside {first.title}")
        taken = {p.name for p in _parts(first) + _parts(rival.effect)}
        others = [screen(point, s.effect) for s in self.screened if s.seen and s.effect.name not in taken]
        form = 0.0 if rival.within < STRAINED else FORM * rival.gain
        least = max(SECOND * (rival.chi2 - self.samples), form, TOLD_APART)
        found: list[EffectFit] = []
        worth = [s for s in others if s.promise > least + point.chi2 - rival.chi2]
        tried = 0
        for other in promising(worth, 0.5, 0.5, 1):
            effects = (*_parts(first), other.effect)
            if tried == COMPANY:
                break
            if any(f.chi2 <= self.noise and together(*effects).generalises(f.effect) for f in found):
                continue
            tried += 1
            lowest = min([rival.chi2 - least, *(f.chi2 + TOLD_APART for f in found)])
            both = self._fit(effects, np.concatenate([values, other.starts[0]]), tuning, lowest)
            if both is not None and both.gain - rival.gain > least and self._ahead(both, rival):
                found.append(both)
        return found

    def swapped(self, pair: EffectFit, lead: EffectFit, ranking: Sequence[EffectFit]) -> list[EffectFit]:
        """Return fits of the second effect of ``pair`` beside those that alone come nearest to its first, ``lead``."""
        second = pair.effect.parts[-1]
        taken = {p.name for p in pair.effect.parts}
        rivals = [f for f in ranking if f.flown and not f.effect.parts and f.gain > SWAPPED * lead.gain]
        found = []
        for rival in [f for f in rivals if f.effect.name not in taken][:COMPANY]:
            effects = (rival.effect, second)
            if pair.chi2 <= self.noise and together(*effects).generalises(pair.effect):
                continue
            begin = np.concatenate([self._values(rival, rival.effect), self._values(pair, second)])
            both = self._fit(effects, begin, self._tuning(pair), pair.chi2 + TOLD_APART)
            if both is not None and self._ahead(both, lead):
                found.append(both)
        return found

    def _ahead(self, both: EffectFit, single: EffectFit) -> bool:
        return score(both, self.samples) - score(single, self.samples) > TOLD_APART

    def without(self, joint: EffectFit, part: Effect, hopeless: float) -> EffectFit | None:
        """Return the fit of ``joint`` without one of its parts, from the values that the others have in it."""
        rest = tuple(p for p in joint.effect.parts if p is not part)
        values = np.concatenate([self._values(joint, p) for p in rest])
        return self._fit(rest, values, self._tuning(joint), hopeless)

    def _tuning(self, fit: EffectFit) -> FloatArray:
        return np.array([fit.tuning[n] for n in self.base.priors])

    @staticmethod
    def _values(fit: EffectFit, effect: Effect) -> FloatArray:
        """Return the values (p,) that a fit gives an effect, its own or a part of it."""
        prefix = "" if effect.name == fit.effect.name else f"{effect.name}."
        return np.array([fit.values[prefix + p.name] for p in effect.parameters])

    def _fit(
        self, effects: tuple[Effect, ...], begin: FloatArray, tuning: FloatArray, hopeless: float
    ) -> EffectFit | None:
        """Descend from values (p,) and coefficients (k,) at which one of the effects, or more, came to rest before."""
        effect = together(*effects) if len(effects) > 1 else effects[0]
        near = self.base.moved(self.base.model, tuning) or self.base
        descent = descend(Changes(near, effect), begin, hopeless, PATIENCE)
        if descent is None or not descent.flown:
            return None
        return summarise(effect, descent, self.chi2_tuned, self.tested ** len(effects))


def _parts(effect: Effect) -> tuple[Effect, ...]:
    return effect.parts or (effect,)
