"""Explanations of what a model lacks, by their probabilities; what is said of them is decided here and nowhere else.

Hypotheses are nothing, each effect that comes near, pairs of them, each coefficient that may be wrong and each term
that forces follow; each as the whole story, or as what imitates something that the library lacks; and an unknown motion
alone (:mod:`testbench.inference.evidence`). All have the re-tuned coefficients, the noise scale of every channel and
the form error of the effect as unknowns. What is left of the unknown motion beside an effect tells the whole story from
a part of it, whatever the noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import exp1, logsumexp

from testbench.aircraft import Aircraft
from testbench.core.words import with_error
from testbench.effects import Effect
from testbench.effects.base import Values, together
from testbench.inference.calibrate import CREDIBLE, SURE, fewest
from testbench.inference.evidence import Comparison
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.parts import part_names
from testbench.questions.gap.priors import LATERAL_PRIORS
from testbench.sensors import SensorSuite

if TYPE_CHECKING:
    from testbench.questions.gap.open_set import OpenTerm

# Prior probabilities before any flight; judged. Those of one kind share them alike.
P_NOTHING, P_EFFECT, P_PAIR, P_COEFFICIENT, P_OPEN, P_STRANGER = 0.40, 0.30, 0.05, 0.10, 0.05, 0.10
P_ONSET = 0.1  # that what is missing does not act in all of the records, but begins or ends in flight
P_IMITATED = 0.5  # that something which the library lacks is imitated, better than by an unknown motion alone
P_IN_PART = 0.41  # that it then acts in the same part: 35 of 86 calls of the blind test that named nothing
FORMS = (0.003, 1.0 / 3.0)  # between which the relative error of what imitates lies, log-uniform
_LEAST = 1e-300  # of which a logarithm is taken
LACKING = "something that the library lacks"
SAID = 0.01  # probability from which an explanation is spoken of
_TOLD, _SURE = 4, 0.9999  # explanations, while others are sought, none of which is told to be more probable
IMITATES = 0.1  # share of what the library lacks from which an effect is said to imitate it
SEPARATES = "flights at another airspeed or of another amplitude, or a sensor on the surface"


def _as_it_is(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    return aircraft, suite


def wrong_coefficient(*names: str) -> Effect:
    """Return "this is far off" as an explanation among the effects: its prior is wide, nothing is added to the model.

    Several coefficients are one explanation, as several effects are.
    """
    if len(names) > 1:
        both = together(*map(wrong_coefficient, names))
        return replace(both, amend=_as_it_is)
    (name,) = names
    lateral = name in LATERAL_PRIORS
    place = {"CL": "lift", "CD": "drag", "Cm": "pitching moment", "Cn": "fin"}.get(name.partition("_")[0], "wing")
    return Effect(
        name=name,
        title=f"a wrong {name}",
        place=place,
        physics=f"The a-priori {name} has an error larger than its prior allows.",
        parameters=(),
        amend=_as_it_is,
        mistaken_for="an effect that grows with the same motion",
        separated_by=SEPARATES,
        lateral=lateral,
        form_error=0.0,
    )


@dataclass(frozen=True, eq=False)
class Explanation:
    """One explanation at its best point."""

    effect: Effect  #: what the model lacks; of a wrong coefficient, see :func:`wrong_coefficient`
    #: values, errors: parameter -> estimate and standard error, all else being unknown
    values: Mapping[str, float]
    errors: Mapping[str, float]
    nuisances: Mapping[str, float]  #: coefficient -> factor on what is believed, re-tuned beside it
    spread: Mapping[str, float]  #: coefficient -> standard error of the factor
    chi2: float  #: weighted sum of squares that it leaves as flown, and the price of the coefficients
    gain: float  #: fall of ``chi2`` against the believed model with its coefficients re-tuned
    share: float  #: share of the excess over the noise that it explains, 0 to 1; NaN if there hardly is one
    probability: float  #: that it is the whole story
    imitates: float  #: probability that something which the library lacks does nearly this
    kappa: float  #: share of the motion that an unknown motion still needs beside it

    def added_to(self, believed: Believed) -> Believed:
        """Return ``believed`` re-tuned and with the effect, as they were fitted."""
        return believed.with_nuisances(self.nuisances).with_effect(self.effect, self.values)

    @property
    def coefficients(self) -> tuple[str, ...]:
        """The coefficients that are wrong, if that is what is explained; none of an effect."""
        return () if self.effect.parameters else tuple(e.name for e in self.effect.singles)

    @property
    def size(self) -> str:
        """Parameters with their standard errors, in words."""
        if self.coefficients:
            told = [with_error(self.nuisances[name], self.spread[name]) for name in self.coefficients]
            return f"{' and '.join(told)} times the a-priori value"
        units = {p.name: p.unit for p in self.effect.parameters}
        return ", ".join(
            f"{n} = {with_error(v, self.errors[n])}" + (f" {units[n]}" if units[n] != "1" else "")
            for n, v in self.values.items()
        )


@dataclass(frozen=True, eq=False)
class Weights:
    """Probabilities of all explanations, together 1."""

    #: hypothesis, "nothing" among them -> ln p of the records if it is the whole story, and if it is a part
    logs: Mapping[str, tuple[float, float]]
    effects: Mapping[str, Effect]  #: what the other hypotheses say, by name
    seen: int  #: number of effects that were sought, which share the prior
    coefficients: int  #: number of coefficients that may be wrong, likewise
    tried: int = 1  #: number of terms that forces might follow, likewise
    terms: tuple[str, ...] = ()  #: names of the hypotheses that are such terms

    def _prior(self, name: str) -> tuple[float, float]:
        """Return the prior of an explanation as the whole story, and how many share that of imitation."""
        effect = self.effects[name]
        several = len(effect.singles)
        one, count = (P_EFFECT, self.seen) if effect.parameters else (P_COEFFICIENT, self.coefficients)
        if name in self.terms:
            one, count = P_OPEN, self.tried
        ways = max(math.comb(count, several), 1)
        alike = max(math.comb(self.seen, several), 1) if not effect.parameters else ways
        return one * (P_PAIR / P_EFFECT) ** (several - 1) / ways, alike

    @cached_property
    def _log(self) -> dict[tuple[str, str], float]:
        """Return (hypothesis, how) -> ln of its prior times its evidence.

        It is the "whole" story, "alike" to it within the noise, or "imitated" by it beside an unknown motion, whichever
        of the two is the larger.
        """
        out = {}
        for name, (log_whole, log_part) in self.logs.items():
            if name == "nothing":
                out["nothing", "whole"] = math.log(P_NOTHING) + log_whole
                out["nothing", "imitated"] = math.log(P_STRANGER * (1.0 - P_IMITATED)) + log_part
                continue
            whole, alike = self._prior(name)
            begins = math.log(math.prod(P_ONSET / e.looks for e in self.effects[name].singles if e.later))
            out[name, "whole"] = math.log(whole) + log_whole + begins
            stranger = math.log(P_STRANGER * P_IMITATED / alike) + begins
            hidden = math.log(max(within_noise(log_whole - self.logs["nothing"][0]), _LEAST)) + log_whole
            # The mean over sizes of the unknown motion has those that noise hides, too. Beside that motion, which is
            # any force, a term of forces says nothing more.
            term = any(e.name in self.terms for e in self.effects[name].singles)
            how = "alike" if term or hidden >= log_part else "imitated"
            out[name, how] = stranger + (hidden if how == "alike" else log_part)
        return out

    @cached_property
    def _probability(self) -> dict[tuple[str, str], float]:
        total = float(logsumexp(list(self._log.values())))
        return {key: math.exp(v - total) for key, v in self._log.items()}

    @property
    def nothing(self) -> float:
        """Probability that the model lacks nothing but what coefficients within their priors are."""
        return self._probability["nothing", "whole"]

    @property
    def unknown(self) -> float:
        """Probability of something that no effect of the library is, whether one imitates it or none."""
        return sum(p for (_, how), p in self._probability.items() if how != "whole")

    @property
    def needed(self) -> float:
        """Probability that no explanation does without an unknown motion beside it."""
        return sum(p for (_, how), p in self._probability.items() if how == "imitated")

    @property
    def open(self) -> bool:
        """Whether a term that no effect of the library holds is more probable than not."""
        return sum(self[name] for name in self.terms if name in self.logs) > 0.5

    def __getitem__(self, name: str) -> float:
        """Return the probability that an explanation is the whole story; 0 if it was not weighed."""
        return self._probability.get((name, "whole"), 0.0)

    def imitates(self, name: str) -> float:
        """Return the probability that what the library lacks does nearly this; of "nothing", that no effect is near."""
        return sum(self._probability.get((name, how), 0.0) for how in ("alike", "imitated"))

    def part(self, names: Sequence[str]) -> float:
        """Return the probability that what the model lacks acts in parts of these names and in no others.

        An effect that imitates what the library lacks has the right part with :data:`P_IN_PART`.
        """
        return self._where(lambda effect: set(part_names(effect)) <= set(names))

    def holds(self, names: Sequence[str]) -> float:
        """Return the probability that an effect of these names is among what the model lacks, likewise."""
        return self._where(lambda effect: any(e.name in names for e in effect.singles))

    def _where(self, holds: Callable[[Effect], bool]) -> float:
        total = 0.0
        for (name, how), p in self._probability.items():
            if name != "nothing" and holds(self.effects[name]):
                total += p * (1.0 if how == "whole" else P_IN_PART)
        return total

    @property
    def stated(self) -> dict[str, float]:
        """Explanation -> probability: each that was weighed as the whole story, "nothing" and "unknown"."""
        return {name: self[name] for name in self.effects} | {"nothing": self.nothing, "unknown": self.unknown}

    def credible(self) -> tuple[str, ...]:
        """Return the fewest explanations that hold 95 % together: effects, "nothing", "unknown"."""
        return fewest(self.stated)

    def decide(self) -> tuple[str, tuple[str, ...]]:
        """Return outcome and names, see :class:`Naming`: what is most probable, of nothing, the library and neither."""
        own = {name: self[name] for name in self.effects}
        known = sum(own.values())
        if self.nothing >= max(known, self.unknown):
            return "no gap", ()
        if known >= self.unknown:
            names = fewest(own, CREDIBLE * known)
            return ("named" if own[names[0]] >= SURE else "set"), names
        near = max(own, key=self.imitates, default="")
        if near and self.imitates(near) > 0.5 * self.unknown:
            return "partial", (near,)
        return "unexplained", ()


def within_noise(gain: float) -> float:
    """Return the probability that what an effect imitates cannot be told from it, by its ``gain`` in ln p over nothing.

    A relative error d of its form costs d^2 gain, so that it is the mean of exp(-d^2 gain) over d (:data:`FORMS`).
    """
    if gain <= 0.0:
        return 1.0
    low, high = (exp1(d * d * gain) for d in FORMS)
    return float((low - high) / (2.0 * math.log(FORMS[1] / FORMS[0])))


@dataclass(frozen=True, eq=False)
class Weighed(Weights):
    """Probabilities of explanations that were flown: those of ``table``."""

    table: Comparison = field(kw_only=True)

    @classmethod
    def of(cls, table: Comparison, *others: Any, **more: Any) -> Weighed:
        """Return the probabilities by a comparison; the rest is that of :class:`Weights`.

        Differences of ln p count as the likelihood of the best deserves (:attr:`.Posterior.misfit`).

        One of so many terms may fit what is left by chance of its form: where it foretells the records held out worse
        than nothing does, it is no explanation.
        """
        out = cls({}, *others, **more, table=table)
        kept = [row for row in table.rows if row.name not in out.terms or row.held_out is None or row.held_out >= 0.0]
        top = max((row.posterior for row in kept), key=lambda found: found.log_evidence).misfit
        return replace(out, logs={r.name: (r.posterior.log_whole / top, r.posterior.log_part / top) for r in kept})


def told(logs: Mapping[str, float], how: str) -> str:
    """Return what is probable so far, while others are sought: "weighed: symmetric wing bending 99.3 %; ..."."""
    total = float(logsumexp(list(logs.values()))) if logs else 0.0
    first = sorted(logs.items(), key=lambda item: -item[1])[:_TOLD]
    return f"{how}: " + "; ".join(f"{name} {100.0 * min(math.exp(log - total), _SURE):.2f} %" for name, log in first)


def percent(p: float) -> str:
    """Return a probability in words, never as certain."""
    if p > 0.999:
        return "above 99.9 %"
    return f"{100.0 * p:.3g} %" if p >= 1e-3 else "below 0.1 %"


@dataclass(frozen=True, eq=False)
class Naming:
    """What was named."""

    #: "no gap"; "named"; "set": one of several, which are not told apart; "partial": something that the library lacks,
    #: which an effect imitates; "unexplained": something that nothing imitates
    outcome: str
    #: the named explanation, or the set, the most probable first; empty otherwise; two effects at once are "A + B"
    names: tuple[str, ...]
    ranking: tuple[Explanation, ...]  #: all explanations that were flown, the most probable first
    weighed: Weighed  #: their probabilities
    chi2_believed: float  #: weighted sum of squares of the believed model, nothing re-tuned
    chi2_tuned: float  #: the same after re-tuning the nuisances within their priors
    nuisances: Mapping[str, float]  #: nuisance -> value of that re-tuning
    samples: int  #: number of samples in those sums
    rejected: Mapping[str, str] = field(default_factory=dict)  #: effect that was not flown -> why
    terms: tuple[OpenTerm, ...] = ()  #: of the open set that come nearest to first order, the most probable first
    #: samples (n,) of each record, of several places -> of each, effect -> ln p to first order if it acts there alone
    acting: Callable[[Sequence[Sequence[NDArray[np.bool_]]]], list[dict[str, float]]] | None = None

    @property
    def best(self) -> Explanation | None:
        """The explanation that is added, if any."""
        return next((f for f in self.ranking if self.names and f.effect.name == self.names[0]), None)

    @property
    def flown_terms(self) -> tuple[tuple[OpenTerm, ...], int]:
        """Terms of the open set that were flown, and of how many they were chosen."""
        return tuple(t for t in self.terms if t.name in self.weighed.terms), self.weighed.tried

    @property
    def rested(self) -> dict[str, dict[str, float]]:
        """Hypothesis -> its parameters where it came to rest."""
        return {row.name: row.posterior.by_name for row in self.weighed.table.rows}

    @property
    def beside_unknown(self) -> dict[str, float]:
        """Coefficient -> factor on what is believed, where an unknown motion does what is missing."""
        return self.weighed.table["nothing"].posterior.by_name

    @property
    def measured(self) -> dict[str, tuple[float, float]]:
        """Coefficient -> (factor on what is believed, standard error) by these records alone, without any effect."""
        return self.weighed.table["nothing"].posterior.by_records

    @property
    def off(self) -> dict[str, tuple[float, float]]:
        """Coefficients re-tuned by more than their prior deviation, with what the records alone say of them."""
        found = self.weighed.table["nothing"].posterior
        far = [p.name for p in found.parameters if abs(found[p.name][0] - p.value) > p.prior_std]
        return {n: v for n, v in self.measured.items() if n in far}

    @property
    def coefficients(self) -> tuple[Explanation, ...]:
        """Coefficients that are wrong, if that is what is named, or one of the set."""
        return tuple(f for f in self.ranking if f.coefficients and f.effect.name in self.names)

    def _strained(self, best: Explanation) -> list[str]:
        """Return coefficients beside an effect that lie beyond two standard deviations of their priors, in words."""
        beside = [p for p in self.weighed.table[best.effect.name].posterior.parameters if p.name in best.nuisances]
        far = [p.name for p in beside if abs(best.nuisances[p.name] - p.value) > 2.0 * p.prior_std]
        return [f"{n} {with_error(best.nuisances[n], best.spread[n])}" for n in far if n not in best.coefficients]

    @property
    def sentence(self) -> str:
        """The outcome in words."""
        w, best = self.weighed, self.best
        off = [f"{n} {with_error(f, e)}" for n, (f, e) in self.off.items()]
        if best is None:
            sure = percent(w.nothing if self.outcome == "no gap" else w.unknown)
            if self.outcome == "no gap":
                out = f"no gap: coefficients within their priors and noise explain the records, probability {sure}"
            else:
                out = f"unexplained: {LACKING} and that no effect of it imitates, probability {sure}"
            return f"{out}; re-tuned, times the a-priori value: {', '.join(off)}" if off else out
        far = self._strained(best) or (off if self.outcome == "partial" else [])
        beside = f", with {', '.join(far)} times the a-priori value" if far else ""
        what = f"{best.effect.title}: {best.size}{beside}"
        explained = "" if math.isnan(best.share) else f"; it explains {100 * best.share:.1f} % of the excess over noise"
        if self.outcome == "named":
            return f"{what}; probability {percent(best.probability)}{explained}"
        if self.outcome == "partial":
            return (
                f"unexplained as a whole: {LACKING}, probability {percent(w.unknown)}; the "
                f"nearest effect is {what}{explained}. It is added as a partial model: {100.0 * best.kappa:.2g} % of "
                "the motion is still needed in addition"
            )
        named = [f for f in self.ranking if f.effect.name in self.names]
        among = [(f.effect.title, f.probability) for f in named]
        among += [(what, p) for what, p in (("nothing", w.nothing), (LACKING, w.unknown)) if p >= SAID]
        *most, last = (f"{what} ({percent(p)})" for what, p in among)
        head = "these data do not separate" if len(named) > 1 else "probably:"
        sizes = "; ".join(f"{f.effect.title}: {f.size}" for f in named)
        told = f"{', '.join(most)} or {last}" if most else last
        return f"{head} {told}; {sizes}{beside}. To separate them: {best.effect.separated_by}"

    @property
    def probabilities(self) -> str:
        """All probabilities in words."""
        w = self.weighed
        said = [f"{f.effect.title} {percent(f.probability)} ({f.size})" for f in self.ranking if f.probability >= SAID]
        near = [
            f.effect.title
            for f in sorted(self.ranking, key=lambda f: -f.imitates)
            if w.unknown >= SAID and f.imitates >= IMITATES * w.unknown
        ]
        return (
            "probabilities, noise and coefficients being unknown: "
            + "; ".join([*said, f"nothing {percent(w.nothing)}"])
            + f"; {LACKING} {percent(w.unknown)}"
            + (f", which {' or '.join(near)} imitates" if near else "")
        )


def share_of_excess(chi2_tuned: float, left: float, samples: int) -> float:
    """Return the share, 0 to 1, of the excess of ``chi2_tuned`` over the noise that is gone if ``left`` is left.

    NaN if it exceeds the noise by no more than four standard deviations of the noise's chi-square.
    """
    excess = chi2_tuned - samples
    if not excess > CRITERIA.visible * np.sqrt(2.0 * samples):
        return float("nan")
    return float(np.clip((chi2_tuned - left) / excess, 0.0, 1.0))
