"""What stands beside a name: wrong parameters, names that held-out flights refute, what is left, largest errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.core.errors import LimitError, TrimError
from testbench.core.record import FlightAborted, FlightRecord
from testbench.core.words import with_error
from testbench.questions.gap.believed import LATERAL_PRIORS, PRIORS, Believed, priors_of
from testbench.questions.gap.effects import Effect
from testbench.questions.gap.search.fit import EffectFit
from testbench.questions.gap.search.hypothesis import Hypothesis
from testbench.questions.gap.search.likelihood import FORM, LEAST
from testbench.questions.gap.search.name import Naming
from testbench.questions.gap.search.screening import SMALL, screen_all
from testbench.questions.gap.search.several import OF_FORM

OFF, FAR = 1.0, 2.0  # a believed parameter is off, or wrong, by more than this many times what is believed of it, and
SURE = 4.0  # by more than this many standard errors, which must be smaller than what is believed of it


@dataclass(frozen=True)
class WrongParameter:
    """A believed coefficient that the records contradict: wrong if it is FAR off, else merely off.

    Attributes:
        name: coefficient, e.g. "Cm_alpha".
        factor: its value over the believed one, as the records alone say it.
        error: standard error of ``factor``.
        prior: relative standard deviation that was believed of it.
    """

    name: str
    factor: float
    error: float
    prior: float

    @property
    def sentence(self) -> str:
        """The finding in words."""
        return (
            f"the believed {self.name} is {'wrong' if self.deviations > FAR else 'off'}: "
            f"{with_error(self.factor, self.error)} times the believed value, {self.deviations:.1f} times what is "
            f"believed of it ({100.0 * self.prior:.0f} %)"
        )

    @property
    def deviations(self) -> float:
        """How far it is off, over what is believed of it."""
        return abs(self.factor - 1.0) / self.prior


def off_parameters(naming: Naming) -> tuple[WrongParameter, ...]:
    """Return the believed parameters that re-tuning without any effect finds off; none if an effect was named.

    What re-tuning reaches beside an effect depends on its form.
    """
    if naming.best is not None:
        return ()
    priors = {**PRIORS, **LATERAL_PRIORS}
    found = (WrongParameter(n, factor, error, priors[n]) for n, (factor, error) in naming.measured.items())
    return tuple(p for p in found if p.error < p.prior and abs(p.factor - 1.0) > SURE * p.error and p.deviations > OFF)


def wrong_parameters(
    naming: Naming, believed: Believed, held_out: Sequence[FlightRecord] = ()
) -> tuple[WrongParameter, ...]:
    """Return the believed parameters that are off by so much that they are wrong, unless held-out flights contradict.

    They do if re-tuning makes them worse.
    """
    wrong = tuple(p for p in off_parameters(naming) if p.deviations > FAR)
    if not wrong or not held_out:
        return wrong
    re_tuned = _sum_of_squares(believed.with_nuisances(naming.nuisances), held_out)
    return wrong if re_tuned < _sum_of_squares(believed, held_out) else ()


def confirmed(naming: Naming, believed: Believed, held_out: Sequence[FlightRecord]) -> Naming:
    """Return ``naming`` without the names that manoeuvres used for neither naming nor fitting refute.

    A name is refuted if it raises the sum of squares there, against re-tuning alone or against the believed model as it
    is, by more than it had to lower it by to be named: an effect that is there does not make worse what it was not
    fitted to. What noise does to the sums is the same in all. Of a gust that one record met the others say nothing.
    """
    fits = [next(f for f in naming.ranking if f.effect.name == name) for name in naming.names]
    if not fits or not held_out:
        return naming
    without = min(_sum_of_squares(m, held_out) for m in (believed, believed.with_nuisances(naming.nuisances)))
    if not np.isfinite(without):
        return naming  # nothing to compare with: without the effect nothing flies there
    worse = {
        f.effect.name: 0.0 if f.effect.met else _sum_of_squares(f.added_to(believed), held_out) - without for f in fits
    }
    kept = [f for f in fits if worse[f.effect.name] <= f.threshold]
    if len(kept) == len(fits):
        return naming
    names = tuple(f.effect.name for f in kept)
    out = [f.effect.title for f in fits if f not in kept]
    if not kept:
        raised = ", ".join(f"{worse[f.effect.name]:.4g}" for f in fits)
        sentence = (
            f"unexplained: {' or '.join(out)} would fit, but on the manoeuvres held out {'each' if out[1:] else 'it'} "
            f"raises chi-square, by {raised} against the model without it"
        )
        return replace(naming, outcome="unexplained", names=(), sentence=sentence)
    told = "; ".join(f"{f.effect.title}, {f.size}" for f in kept)
    head = "one of these, which these data cannot tell apart: " if len(kept) > 1 else ""
    sentence = f"{head}{told}; the manoeuvres held out refute {' and '.join(out)}, which would fit as well"
    return replace(naming, outcome="set" if len(kept) > 1 else "named", names=names, sentence=sentence)


def _sum_of_squares(model: Believed, records: Sequence[FlightRecord]) -> float:
    """Return the weighted sum of squares on ``records``; infinite if the model cannot fly them."""
    try:
        return float(sum(np.sum(model.residuals(r) ** 2) for r in records))
    except (FlightAborted, LimitError, TrimError):
        return float("inf")


@dataclass(frozen=True)
class Rest:
    """What another effect would explain of what a named one leaves.

    Attributes:
        effect: the other one, that which would explain most of it.
        gain: fall of chi-square that its best multiple promises beside the named one, coefficients re-tuned.
        least: what noise, or the form of the named one, may be worth.
    """

    effect: Effect
    gain: float
    least: float

    @property
    def sentence(self) -> str:
        """What that says of the name, in words."""
        return (
            f"of what it leaves, {self.effect.title} beside it would explain {self.gain:.3g} of chi-square, where "
            f"noise or its form are worth {self.least:.3g}: it is not the whole, or an effect like it is the truth"
        )


def more_than_form(left: float, gain: float) -> bool:
    """Return whether another effect would explain more of what a name leaves, ``left``, than its form may leave.

    That refutes a name that gains ``gain``; both are falls of chi-square.
    """
    return left > max(LEAST, OF_FORM * gain)


def rest(
    best: EffectFit, believed: Believed, records: Sequence[FlightRecord], effects: Mapping[str, Effect]
) -> Rest | None:
    """Return which effect of a library would explain most of what the named one leaves, if that is worth a word.

    Every other effect is screened small beside it (:func:`.screening.screen`); forms of the named one have
    been compared with it already. No form is quite right: what refutes a name is more than its form may leave.

    Returns None where a gust or a scattering delay is named, which leave what no model has, or the air moves: residuals
    are white in it only as far as its model goes.
    """
    if best.scatter_s or best.effect.met is not None or believed.whiten is not None:
        return None
    priors = priors_of(records)
    nuisances = np.array([best.nuisances[n] for n in priors])
    point = Hypothesis.at(believed, believed.with_effect(best.effect, best.values), tuple(records), nuisances, priors)
    parts = {e.name for e in best.effect.singles}
    forms = parts.union(*(e.contains for e in best.effect.singles))
    others = [e for n, e in effects.items() if n not in forms and parts.isdisjoint(e.contains) and e.met is None]
    seen = [s for s in screen_all([(point, e) for e in others], SMALL) if s.seen]
    first = max(seen, key=lambda s: s.promise, default=None)
    least = max(LEAST, FORM * best.gain)
    return None if first is None or first.promise <= least else Rest(first.effect, first.promise, least)


def judged(
    naming: Naming,
    believed: Believed,
    records: Sequence[FlightRecord],
    held_out: Sequence[FlightRecord],
    effects: Mapping[str, Effect],
) -> tuple[Naming, Rest | None]:
    """Return ``naming`` without names that held-out flights or its own remainder refute, and what else that holds.

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
    if best is None or left is None or len(naming.names) > 1 or not more_than_form(left.gain, best.gain):
        return naming, left
    sentence = (
        f"unexplained: {best.effect.title}, {best.size}, comes nearest with {best.gain:.4g} of chi-square, but of what "
        f"it leaves {left.effect.title} beside it would explain {left.gain:.3g}, more than its form may leave: a "
        "relative of it, or several effects, are the truth"
    )
    return replace(naming, outcome="unexplained", names=(), sentence=sentence), None


def largest_errors(believed: Believed, records: Sequence[FlightRecord]) -> Mapping[str, float]:
    """Return channel -> largest difference of measurement and prediction, each about its mean over a record, SI.

    Sensor noise and turbulence are in it.
    """
    worst = np.zeros(len(believed.outputs))
    plain = replace(believed, whiten=None)
    for record in records:
        worst = np.maximum(worst, np.max(np.abs(plain.residuals(record)), axis=0) * believed.noise_std)
    return dict(zip(believed.outputs, worst.tolist(), strict=True))
