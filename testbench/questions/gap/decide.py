"""The rules that keep or refute a name, in the order in which they are asked; all thresholds stand in criteria.py.

:func:`decide` holds the fits against noise, their priors and each other, by the rules REFUTED_IF and NAMED_AS. A gust
that it names must not be what a command explains (:func:`doubted`), held-out manoeuvres must not refute a name
(:func:`confirmed`), and what the name leaves must not ask for another effect (:func:`judged`). Control flights have the
last word (controls.py).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2

from testbench.core.errors import LimitError, TrimError
from testbench.core.record import FlightAborted, FlightRecord
from testbench.effects import Effect
from testbench.flight.air import Gust
from testbench.questions.gap import tell
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.evidence.commanded import MOVED, commands
from testbench.questions.gap.evidence.gusts import record_key
from testbench.questions.gap.evidence.locate import left_by
from testbench.questions.gap.parts import part_names
from testbench.questions.gap.search.fit import EffectFit
from testbench.questions.gap.search.hypothesis import Hypothesis
from testbench.questions.gap.search.screening import SMALL, screen_all


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
        open_set: True if the names are of terms that forces and moments follow, and of no library.
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
    open_set: bool = False

    @property
    def noise_left(self) -> bool:
        """True if only noise in still air is left, once the effect that is named, if any, is added."""
        left = self.chi2_tuned if self.best is None else self.best.chi2
        return left <= float(chi2.isf(CRITERIA.false_alarm, self.samples))

    @property
    def best(self) -> EffectFit | None:
        """The effect that is added, if any."""
        return next((f for f in self.ranking if self.names and f.effect.name == self.names[0]), None)


def noise_floor(believed: Believed, samples: int) -> float:
    """Return the chi-square that noise alone would leave."""
    return samples * (1.0 + (CRITERIA.moving_air if believed.whiten is not None else 0.0))


def noise_limit(believed: Believed, samples: int) -> float:
    """Return the chi-square that noise alone exceeds with a probability of FALSE_ALARM."""
    return float(chi2.isf(CRITERIA.false_alarm, noise_floor(believed, samples)))


def believable(fit: EffectFit) -> bool:
    """Return whether a fit strains no coefficient and needs no size beyond what is physically possible."""
    return fit.within >= CRITERIA.strained and not fit.beyond


def leaves_noise(fit: EffectFit, noise: float) -> bool:
    """Return whether a fit explains all: chi-square is no more than ``noise``, and no coefficient is strained."""
    return fit.chi2 <= noise and fit.within >= CRITERIA.strained


def leaves_far_more(fit: EffectFit, floor: float) -> bool:
    """Return whether a fit leaves so much more than the ``floor`` of the noise that it cannot be the whole."""
    spread = CRITERIA.remainder * float(np.sqrt(2.0 * floor))
    return fit.chi2 - floor > max(spread, CRITERIA.remaining_share * max(fit.in_motion, fit.work))


def is_special_case(fit: EffectFit, general: EffectFit) -> bool:
    """Return whether ``general`` is a more general form of ``fit`` and gains only what noise or form account for."""
    if not general.effect.generalises(fit.effect):
        return False
    extra = max(len(general.values) - len(fit.values), 1)
    return general.gain - fit.gain <= max(float(chi2.isf(CRITERIA.false_alarm, extra)), CRITERIA.form * general.gain)


def score(fit: EffectFit, samples: int) -> float:
    """Return the gain less ln(samples) for each parameter (Schwarz 1978): the simpler of two equal effects leads."""
    return fit.gain - len(fit.values) * float(np.log(samples))


@dataclass(frozen=True, eq=False)
class Candidates:
    """What the rules are asked about.

    Attributes:
        best: the foremost fit, see :func:`_foremost`.
        close: fits that may be the truth although it leads.
        ranking: all fits, by score.
        floor: chi-square that noise alone would leave.
        noise: chi-square that noise alone hardly exceeds.
        priors: nuisance -> relative standard deviation, for sentences; the general ones if None.
    """

    best: EffectFit
    close: tuple[EffectFit, ...]
    ranking: tuple[EffectFit, ...]
    floor: float
    noise: float
    priors: Mapping[str, float] | None = None


Decision = tuple[str, tuple[str, ...], str]
"""Outcome, names and sentence."""


def decide(
    ranking: Sequence[EffectFit],
    chi2_tuned: float,
    samples: int,
    floor: float,
    priors: Mapping[str, float] | None = None,
) -> Decision:
    """Return outcome, names and sentence.

    If an effect is significant, the foremost is asked each of REFUTED_IF in turn; the first that refutes it ends the
    search, with its reason. What none refutes is named by the first of NAMED_AS that applies.

    Args:
        ranking: fits by score, see :func:`score`.
        chi2_tuned: weighted sum of squares without any effect, nuisances re-tuned.
        samples: number of samples in it.
        floor: what noise alone would leave.
        priors: nuisance -> relative standard deviation, for the sentence; the general ones if not given.
    """
    noise = float(chi2.isf(CRITERIA.false_alarm, floor))
    significant = [f for f in ranking if f.significant and f.flown and f.gain > CRITERIA.least]
    if not significant:
        if chi2_tuned <= noise:
            return "no gap", (), tell.no_gap(chi2_tuned, samples)
        return "unexplained", (), tell.nothing_explains(chi2_tuned, samples)
    best = _foremost(significant, samples)
    others = [f for f in ranking if f is not best and f.flown and believable(f)]
    close = tuple(f for f in others if _indistinct(f, best, samples, best.chi2 <= noise))
    candidates = Candidates(best, close, tuple(ranking), floor, noise, priors)
    for refuted in REFUTED_IF:
        reason = refuted(candidates)
        if reason:
            return "unexplained", (), reason
    return next(decision for named in NAMED_AS if (decision := named(candidates)) is not None)


def _strains_what_is_believed(c: Candidates) -> str:
    """The best effect needs coefficients that lie too far from what is believed."""
    return tell.strained(c.best, c.priors) if c.best.within < CRITERIA.strained else ""


def _asks_for_more_than_there_can_be(c: Candidates) -> str:
    """The best effect has come to rest at the end of what is physically possible."""
    return tell.beyond(c.best) if c.best.beyond else ""


def _explains_too_little(c: Candidates) -> str:
    """It explains too small a share of the excess; less is enough where no effect of another kind comes near."""
    strangers = [f for f in c.ranking if not (f is c.best or _of_one_kind(f.effect, c.best.effect))]
    alone = not any(f.gain > CRITERIA.near * c.best.gain for f in strangers)
    enough = CRITERIA.enough_alone if alone else CRITERIA.enough
    return "" if c.best.share >= enough or c.best.chi2 <= c.noise else tell.too_little(c.best)


def _leaves_more_than_its_form_may(c: Candidates) -> str:
    """It leaves so much more than noise that it cannot be the whole."""
    return tell.leaves_far_more(c.best, c.best.chi2 - c.floor) if leaves_far_more(c.best, c.floor) else ""


def _too_many_come_close(c: Candidates) -> str:
    """So many effects come close to the best that no set of them is an answer."""
    return tell.too_many((c.best, *c.close)) if len(c.close) >= CRITERIA.many else ""


def _company_elsewhere_does_as_well(c: Candidates) -> str:
    """Several effects are needed, and others that act in other parts do as well: one that is not known may do it all.

    In the blind test no two effects that were hidden together were ever told like that. Each such set stood in for one
    effect that was taken out of the library.
    """
    fits = (c.best, *c.close)
    elsewhere = len({frozenset(part_names(f.effect)) for f in fits}) > 1
    doubtful = elsewhere and all(f.effect.parts for f in fits) and _common(c.best, c.close, c.ranking) is None
    return tell.company(fits) if doubtful else ""


REFUTED_IF: tuple[Callable[[Candidates], str], ...] = (
    _strains_what_is_believed,
    _asks_for_more_than_there_can_be,
    _explains_too_little,
    _leaves_more_than_its_form_may,
    _too_many_come_close,
    _company_elsewhere_does_as_well,
)
"""Rules that refute the foremost effect, in the order in which they are asked: each returns why, "" if it does not."""


def _what_all_have_in_common(c: Candidates) -> Decision | None:
    """The one effect that all of several sets have in common."""
    alone = _common(c.best, c.close, c.ranking)
    return None if alone is None else ("named", (alone.effect.name,), tell.in_common(alone))


def _the_set(c: Candidates) -> Decision | None:
    """The best effect and those that these data do not tell from it."""
    fits = (c.best, *c.close)
    return ("set", tuple(f.effect.name for f in fits), tell.one_of(fits)) if c.close else None


def _the_best(c: Candidates) -> Decision | None:
    """The best effect."""
    return "named", (c.best.effect.name,), tell.named(c.best, c.best.chi2 <= c.noise)


NAMED_AS: tuple[Callable[[Candidates], Decision | None], ...] = (_what_all_have_in_common, _the_set, _the_best)
"""Rules that say what is named, in the order in which they are asked; the first that applies decides."""


def _foremost(significant: Sequence[EffectFit], samples: int) -> EffectFit:
    """Return the foremost of some fits, which come in the order of their scores.

    That is the first one. If it is not believable, it is the first believable one that trails it by no more than chance
    would. A special case of either takes its place, if it gains no less than noise or form account for.
    """
    best = significant[0]
    sound = [f for f in significant if believable(f)]
    if not believable(best):
        best = next((f for f in sound if score(best, samples) - score(f, samples) < CRITERIA.told_apart), best)
    return min((f for f in sound if is_special_case(f, best)), key=lambda f: len(f.values), default=best)


def _common(best: EffectFit, close: Sequence[EffectFit], ranking: Sequence[EffectFit]) -> EffectFit | None:
    """Return the fit of the effects that all of several sets have in common, if there is one that explains enough.

    If each of several others explains the rest beside it, that speaks for none of them.
    """
    parts = [{p.name for p in f.effect.singles} for f in (best, *close)]
    common = set.intersection(*parts)
    if not close or not common or any(p == common for p in parts):
        return None
    alone = (f for f in ranking if {p.name for p in f.effect.singles} == common)
    return next((f for f in alone if f.flown and believable(f) and f.share >= CRITERIA.enough), None)


def _of_one_kind(a: Effect, b: Effect) -> bool:
    return a.generalises(b) or b.generalises(a)


def _indistinct(fit: EffectFit, best: EffectFit, samples: int, is_noise: bool) -> bool:
    """Return whether ``fit`` may be the truth although ``best`` leads.

    If the best effect leaves only noise, the likelihood ratio decides: a wrong effect leads the true one by TOLD_APART
    with a probability of FALSE_ALARM at most (Markov's bound on a likelihood ratio, effects of given size). If more
    than noise is left, the form of the best one is not quite right, and only what the two gain and leave can be
    compared. A more general form of the best one is another name only if its further parameters gain more than noise or
    form would. A special case of the best one is no other name.
    """
    if fit.effect.generalises(best.effect):
        return not is_special_case(best, fit)
    if best.effect.generalises(fit.effect):
        return False  # it would have been named in its place
    behind = score(best, samples) - score(fit, samples)
    near = fit.gain >= CRITERIA.too_close * best.gain and fit.chi2 - samples < CRITERIA.twice * (best.chi2 - samples)
    return behind < CRITERIA.told_apart or (not is_noise and near)


def form_of(share: float, gain: float, work: float) -> float:
    """Return what the form of an effect may account for: a share of its ``gain``, or of its ``work`` if that is more.

    What re-tuned coefficients imitate gains little beside them, and its form is off by as much as if they did not. Of
    the gain it is no more than what a second effect would have to make.
    """
    imitated = gain < CRITERIA.imitated * work
    return max(share * gain, min(share * work, CRITERIA.second * gain) if imitated else 0.0)


def worth_of_form(single: EffectFit, other: Effect, samples: int, noise: float) -> float:
    """Return the gain of ``other`` beside ``single`` that the form of ``single`` may account for.

    An effect that leaves far more than its form may is not the whole, however much it gains: of what acts in its place
    no more is asked then than of what acts elsewhere. ``noise`` is the chi-square that noise alone hardly exceeds.
    """
    in_place = any(p.place == other.place for p in single.effect.singles)
    if in_place and not leaves_far_more(single, samples):
        return form_of(CRITERIA.form_in_place, single.gain, single.work)
    if single.within < CRITERIA.strained:
        return 0.0
    share = CRITERIA.form_of_whole if single.chi2 <= noise else CRITERIA.form
    return form_of(share, single.gain, single.work)


def leads(both: EffectFit, single: EffectFit, samples: int, noise: float) -> bool:
    """Return whether ``both`` lead ``single`` clearly; if ``single`` leaves noise, the lead must be worth a name."""
    lead = score(both, samples) - score(single, samples)
    return lead > (CRITERIA.weak if leaves_noise(single, noise) else CRITERIA.told_apart)


def does_without(joint: EffectFit, less: EffectFit, samples: int, noise: float) -> bool:
    """Return whether ``less`` is ``joint`` without one of its parts, which gains no more than form accounts for."""
    kept = {e.name for e in less.effect.singles}
    missing = [e for e in joint.effect.singles if e.name not in kept]
    if len(missing) != 1 or len(kept) != len(joint.effect.singles) - 1:
        return False
    if not (less.flown and less.settled) or less.within < CRITERIA.strained:
        return False
    worth = worth_of_form(less, missing[0], samples, noise)
    return joint.gain - less.gain <= worth or not leads(joint, less, samples, noise)


def doubted(naming: Naming, believed: Believed, records: Sequence[FlightRecord]) -> Naming:
    """Return ``naming`` without a gust that may as well be an answer to a command that the library does not hold.

    If only one manoeuvre is large or fast enough to show an effect of the aircraft, the effect looks like a gust that
    came with the command. A gust that blows while a command is out, or less than ``gust_after_s`` later, is therefore
    named only if its form is proven. It is proven if what may be left of the residual around it, noise taken out (upper
    bound of probability 1 - ``gust_left``), is less than ``gust_proven`` times what it gains.
    """
    for fit in (f for f in naming.ranking if f.effect.name in naming.names):
        model = fit.added_to(believed)
        for met in model.gusts[len(believed.gusts) :]:
            record = next(r for r in records if record_key(r) == met.record)
            part = _unproven(model, record, met.gust) / fit.gain
            if not _commanded(record, met.gust) or part < CRITERIA.gust_proven:
                continue
            names = tuple(n for n in naming.names if n != fit.effect.name)
            sentence = tell.gust_beside_command(fit, part, [f for f in naming.ranking if f.effect.name in names])
            outcome = "set" if len(names) > 1 else "named" if names else "unexplained"
            return replace(naming, outcome=outcome, names=names, sentence=sentence)
    return naming


def without_structure(naming: Naming, believed: Believed, records: Sequence[FlightRecord]) -> Naming:
    """Return ``naming`` without a name that leaves much of what it explains in one band of one channel."""
    best = naming.best
    if best is None or best.scatter_s:  # scattered commands leave what no model has
        return naming
    left = left_by(best.added_to(believed), records)
    if left is None or left.excess <= CRITERIA.structured * max(best.in_motion, best.work):
        return naming
    return replace(naming, outcome="unexplained", names=(), sentence=tell.leaves_structure(best, left))


def _commanded(record: FlightRecord, gust: Gust) -> bool:
    """Return whether a command is out while the gust blows, or was less than ``gust_after_s`` before."""
    t, u = record.t_s - record.t_s[0], commands(record)[1]
    near = (t > gust.start_s - CRITERIA.gust_after_s) & (t < gust.start_s + float(gust.duration_s or 0.0))
    return bool((np.abs(u[near]) > MOVED).any())


def _unproven(model: Believed, record: FlightRecord, gust: Gust) -> float:
    """Return what may be left of the residual, beside noise, while the gust blows and ``gust_rings_s`` after it.

    Noise that happens to be low proves nothing, so the residual is taken to be no less than the mean of the noise.
    """
    t = record.t_s - record.t_s[0]
    blows = (t > gust.start_s) & (t < gust.start_s + float(gust.duration_s or 0.0) + CRITERIA.gust_rings_s)
    r, samples = model.residuals(record)[blows], np.count_nonzero(model.taken(record)[blows])
    return float(max(np.sum(r**2), samples) - chi2.isf(1.0 - CRITERIA.gust_left, samples))


def confirmed(naming: Naming, believed: Believed, held_out: Sequence[FlightRecord]) -> Naming:
    """Return ``naming`` without the names that held-out manoeuvres refute.

    A true effect does not raise the sum of squares of records that it was not fitted to. A name is refuted if it raises
    that sum by more than its threshold, against the better of two models without it: re-tuned, and as believed. Noise
    changes all sums alike. A gust that one record met is never refuted, as other records say nothing of it.
    """
    fits = [next(f for f in naming.ranking if f.effect.name == name) for name in naming.names]
    if not fits or not held_out:
        return naming
    without = min(sum_of_squares(m, held_out) for m in (believed, believed.with_nuisances(naming.nuisances)))
    if not np.isfinite(without):
        return naming  # nothing to compare with: without the effect nothing flies there
    worse = {
        f.effect.name: 0.0 if f.effect.met else sum_of_squares(f.added_to(believed), held_out) - without for f in fits
    }
    kept = [f for f in fits if worse[f.effect.name] <= f.threshold]
    if len(kept) == len(fits):
        return naming
    if not kept:
        sentence = tell.refuted(fits, [worse[f.effect.name] for f in fits])
        return replace(naming, outcome="unexplained", names=(), sentence=sentence)
    names = tuple(f.effect.name for f in kept)
    sentence = tell.refuted_but(kept, [f for f in fits if f not in kept])
    return replace(naming, outcome="set" if len(kept) > 1 else "named", names=names, sentence=sentence)


def sum_of_squares(model: Believed, records: Sequence[FlightRecord]) -> float:
    """Return the weighted sum of squares on ``records``; infinite if the model cannot fly them."""
    try:
        return float(sum(np.sum(model.residuals(r) ** 2) for r in records))
    except (FlightAborted, LimitError, TrimError):
        return float("inf")


@dataclass(frozen=True)
class Rest:
    """What another effect would explain of what a named one leaves.

    Attributes:
        effect: the other effect; of all, it would explain most.
        gain: fall of chi-square that its best multiple promises beside the named effect, coefficients re-tuned.
        least: fall that noise, or the form of the named effect, may account for.
    """

    effect: Effect
    gain: float
    least: float

    @property
    def sentence(self) -> str:
        """What that says of the name, in words."""
        return (
            f"{self.effect.title} beside it would explain another {self.gain:.3g} of chi-square, where noise or its "
            f"form account for {self.least:.3g} at most: it is not the whole, or the true effect is a relative of it"
        )


def more_than_form(left: float, gain: float, work: float = 0.0) -> bool:
    """Return whether another effect would explain more, ``left``, than the form of the named one may leave.

    No form is quite right, so that a small rest refutes nothing. All three are falls of chi-square; see
    :func:`form_of`.
    """
    return left > max(CRITERIA.least, form_of(CRITERIA.form_in_place, gain, work))


def rest(
    best: EffectFit, believed: Believed, records: Sequence[FlightRecord], effects: Mapping[str, Effect]
) -> Rest | None:
    """Return which effect of a library would explain most of what the named one leaves, if it explains enough.

    Every other effect is screened at a small size beside the named one (:func:`.screening.screen`). Forms of the named
    effect are left out: they have been compared with it already.

    Returns None if a gust or a scattering delay is named, as these leave what no model has. Returns None, too, if the
    air moves, as residuals are then white only as far as its model goes.
    """
    if best.scatter_s or best.effect.met is not None or believed.whiten is not None:
        return None
    priors = believed.priors_of(records)
    nuisances = np.array([best.nuisances[n] for n in priors])
    point = Hypothesis.at(believed, believed.with_effect(best.effect, best.values), tuple(records), nuisances, priors)
    parts = {e.name for e in best.effect.singles}
    forms = parts.union(*(e.contains for e in best.effect.singles))
    others = [e for n, e in effects.items() if n not in forms and parts.isdisjoint(e.contains) and e.met is None]
    seen = [s for s in screen_all([(point, e) for e in others], SMALL) if s.seen]
    first = max(seen, key=lambda s: s.promise, default=None)
    least = max(CRITERIA.least, CRITERIA.form * best.in_motion)
    return None if first is None or first.promise <= least else Rest(first.effect, first.promise, least)


def judged(
    naming: Naming,
    believed: Believed,
    records: Sequence[FlightRecord],
    held_out: Sequence[FlightRecord],
    effects: Mapping[str, Effect],
) -> tuple[Naming, Rest | None]:
    """Return ``naming`` without names that held-out flights or the remainder refute, and what the remainder holds.

    Args:
        naming: what was found in ``records``.
        believed: the believed model in the air that was found.
        records: those that were named from.
        held_out: those that were not.
        effects: the library.
    """
    naming = confirmed(naming, believed, held_out)
    best = naming.best
    left = None if best is None else rest(best, believed, records, effects)
    if (
        best is None
        or left is None
        or len(naming.names) > 1
        or not more_than_form(left.gain, best.in_motion, best.work)
    ):
        return naming, left
    sentence = tell.remainder(best, left.effect.title, left.gain)
    return replace(naming, outcome="unexplained", names=(), sentence=sentence), None
