"""What records say of all explanations at once, in probabilities.

Hypotheses are nothing, the effects that come nearest, each as the whole story or as what imitates an effect that the
library lacks, and an unknown motion alone (:mod:`testbench.inference.compare`). All have the re-tuned coefficients, the
noise scale of every channel and the form error of the effect as unknowns. What is left of the unknown motion beside an
effect tells the whole story from a part of it, whatever the noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import logsumexp

from testbench.core.errors import LimitError, ModelError, TrimError
from testbench.core.record import FlightAborted, FlightRecord, FloatArray
from testbench.core.words import with_error
from testbench.effects import Effect
from testbench.effects import Parameter as EffectParameter
from testbench.inference.compare import Comparison, Hypothesis, compare_hypotheses
from testbench.inference.linear import KAPPAS, Grams, Linearised, fewer, reduced
from testbench.inference.parameters import Noise, Parameter, Source
from testbench.inference.unknown import pulses
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.decide import Naming
from testbench.questions.gap.parts import part_names
from testbench.questions.gap.search.hypothesis import Hypothesis as Point
from testbench.questions.gap.search.hypothesis import Signature, fly_together
from testbench.questions.gap.search.screening import INVISIBLE, ends_of, not_sought, starts_of

# Prior probabilities before any flight; judged. Of the library's effects all are alike, and so are all pairs of them.
P_NOTHING, P_EFFECT, P_PAIR, P_STRANGER = 0.45, 0.35, 0.05, 0.15
P_IMITATED = 0.5  # that an effect of the library imitates one that it lacks, better than an unknown motion alone
P_IN_PART = 0.41  # that it then acts in the same part: 35 of 86 calls of the blind test that named nothing
SIZE = 2.0  # prior standard deviation of a size, in multiples of its usual start
MOST = 6  # effects that are weighed: those that the search brought nearest
SAID = 0.01  # probability from which an effect is spoken of
IMITATES = 0.1  # share of what the library lacks from which an effect is said to imitate it
_NOT_FLOWN = (FlightAborted, LimitError, ModelError, TrimError)


@dataclass(frozen=True, eq=False)
class Weighed:
    """Probabilities of all explanations, together 1.

    Attributes:
        table: the comparison that they follow from, the hypothesis "nothing" in it.
        effects: the effects of the table, by name.
        seen: number of effects that were sought, which share the prior.
    """

    table: Comparison
    effects: Mapping[str, Effect]
    seen: int

    @cached_property
    def _log(self) -> dict[tuple[str, str], float]:
        """Return (hypothesis, "whole" or "imitated") -> ln of its prior times its evidence."""
        pairs = max(self.seen * (self.seen - 1) // 2, 1)
        out = {}
        for row in self.table.rows:
            found = row.posterior
            if row.name == "nothing":
                out["nothing", "whole"] = math.log(P_NOTHING) + found.log_whole
                out["nothing", "imitated"] = math.log(P_STRANGER * (1.0 - P_IMITATED)) + found.log_part
                continue
            several = bool(self.effects[row.name].parts)
            whole = P_PAIR / pairs if several else P_EFFECT / max(self.seen, 1)
            imitated = P_STRANGER * P_IMITATED / (pairs if several else max(self.seen, 1))
            out[row.name, "whole"] = math.log(whole) + found.log_whole
            out[row.name, "imitated"] = math.log(imitated) + found.log_part
        return out

    @cached_property
    def _probability(self) -> dict[tuple[str, str], float]:
        total = float(logsumexp(list(self._log.values())))
        return {key: math.exp(v - total) for key, v in self._log.items()}

    @property
    def nothing(self) -> float:
        """Probability that the model lacks nothing but what re-tuned coefficients are."""
        return self._probability["nothing", "whole"]

    @property
    def unknown(self) -> float:
        """Probability of something that no effect of the library is, whether one imitates it or none."""
        return sum(p for (_, how), p in self._probability.items() if how == "imitated")

    def __getitem__(self, name: str) -> float:
        """Return the probability that an effect is the whole story; 0 if it was not weighed."""
        return self._probability.get((name, "whole"), 0.0)

    def imitates(self, name: str) -> float:
        """Return the probability that what the library lacks does nearly this; of "nothing", that no effect is near."""
        return self._probability.get((name, "imitated"), 0.0)

    def part(self, names: Sequence[str]) -> float:
        """Return the probability that what the model lacks acts in parts of these names and in no others.

        An effect that imitates what the library lacks has the right part with :data:`P_IN_PART`.
        """
        total = 0.0
        for (name, how), p in self._probability.items():
            if name != "nothing" and set(part_names(self.effects[name])) <= set(names):
                total += p * (1.0 if how == "whole" else P_IN_PART)
        return total

    def credible(self, probability: float = 0.95) -> tuple[str, ...]:
        """Return the fewest explanations that hold so much probability together: effects, "nothing", "unknown"."""
        said = {name: self[name] for name in self.effects} | {"nothing": self.nothing, "unknown": self.unknown}
        total, out = 0.0, []
        for name in sorted(said, key=lambda n: -said[n]):
            out.append(name)
            total += said[name]
            if total >= probability:
                break
        return tuple(out)

    def size(self, name: str) -> str:
        """Return the sizes of an effect beside all else that is unknown, with their standard errors, in words."""
        found, said = self.table[name].posterior, []
        for p in found.parameters:
            if p.block == "effect":
                value, error = found[p.name]
                unit = "" if p.unit == "1" else f" {p.unit}"
                said.append(f"{p.name.removeprefix(f'{name}.')} = {with_error(value, error)}{unit}")
        return ", ".join(said)

    @property
    def sentence(self) -> str:
        """The probabilities in words."""
        order = sorted(self.effects, key=lambda n: -self[n])
        said = [f"{self.effects[n].title} {percent(self[n])} ({self.size(n)})" for n in order if self[n] >= SAID]
        near = [self.effects[n].title for n in sorted(self.effects, key=lambda n: -self.imitates(n)) if self._near(n)]
        return (
            "probabilities, noise and coefficients being unknown: "
            + "; ".join([*said, f"nothing {percent(self.nothing)}"])
            + f"; something that the library lacks {percent(self.unknown)}"
            + (f", which {' or '.join(near)} imitates" if near else "")
        )

    def _near(self, name: str) -> bool:
        """Return whether an effect is spoken of as what imitates an effect that the library lacks."""
        return self.unknown >= SAID and self.imitates(name) >= IMITATES * self.unknown


def percent(p: float) -> str:
    """Return a probability in words, never as certain."""
    if p > 0.999:
        return "above 99.9 %"
    return f"{100.0 * p:.3g} %" if p >= 1e-3 else "below 0.1 %"


def weigh(
    believed: Believed,
    records: Sequence[FlightRecord],
    naming: Naming,
    known: Mapping[str, Effect],
    source: Source,
) -> Weighed | None:
    """Weigh nothing and the effects that the search brought nearest against each other.

    Where the search named nothing, those that come nearest by their signatures at their usual sizes are weighed, too.

    Args:
        believed: in the air that was found, with the noise that was found.
        records: that a gap was named from.
        naming: what the search found.
        known: the library that it sought in, by name.
        source: where the noise of the sensors comes from.

    Returns None if the search brought no effect near.

    Raises:
        FlightAborted, TrimError, LimitError: the believed aircraft cannot fly the commands.
    """
    seen = len({f.effect.name for f in naming.ranking if not f.effect.parts}) + len(naming.rejected)
    fits = sorted((f for f in naming.ranking if f.gain > 0.0), key=lambda f: (not f.flown, f.chi2))[:MOST]
    found = {f.effect.name: (f.effect, f.values, f.nuisances) for f in fits}
    asker = _Asker(believed, tuple(records), naming.nuisances, source)
    if naming.outcome == "unexplained":
        for effect, start in asker.near(known)[:MOST]:
            found.setdefault(effect.name, (effect, start, naming.nuisances))
    asked = [asked for one in found.values() if (asked := asker.effect(*one)) is not None]
    if not asked:
        return None
    table = compare_hypotheses(records, [asker.nothing(), *asked], asker.noise, asker.unknown, samples=0)
    return Weighed(table, {h.name: found[h.name][0] for h in asked}, seen)


@dataclass(eq=False)
class _Asker:
    """What the hypotheses about some records have in common."""

    believed: Believed
    records: tuple[FlightRecord, ...]
    nuisances: Mapping[str, float]
    source: Source
    moved: dict[int, FloatArray] = field(default_factory=dict)  # by an unknown motion, of each record

    @cached_property
    def tuned(self) -> Point:
        """The believed model re-tuned, without any effect."""
        priors = self.believed.priors_of(self.records)
        there = np.array([self.nuisances[n] for n in priors])
        return Point.at(self.believed, self.believed, self.records, there, priors)

    @cached_property
    def tangents(self) -> dict[int, dict[str, FloatArray]]:
        """By record: coefficient -> change of the prediction (n, p)."""
        out = {}
        for record, T in zip(self.records, self.tuned.by_record(self.tuned.tangents), strict=True):
            slopes = -T * self.believed.noise_std[:, None]
            out[id(record)] = {name: slopes[:, :, i] for i, name in enumerate(self.tuned.priors)}
        return out

    @cached_property
    def noise(self) -> Noise:
        """What is believed of the noise."""
        b = self.believed
        return Noise(dict(zip(b.outputs, b.noise_std.tolist(), strict=True)), self.source)

    def near(self, known: Mapping[str, Effect]) -> list[tuple[Effect, dict[str, float]]]:
        """Return effects with the sizes to begin with, the most probable first, by what they change at usual sizes.

        To first order residuals are r = X d - a S + U u + e: the coefficients d have their priors, an effect S is seen
        in a multiple a of what it changes, a ~ N(0, SIZE^2), beside an unknown motion u of every size. One
        factorisation a size serves all effects.
        """
        base, b = self.tuned, self.believed
        seen = [(e, x, s) for e in known.values() if not not_sought(base, e) for x, s in _signatures(base, e)]
        X = np.column_stack([-base.tangents, *(-s for *_, s in seen)])
        grams, k = [], base.tangents.shape[1]
        for record, left, columns in zip(self.records, base.by_record(base.exact), base.by_record(X), strict=True):
            taken = b.taken(record)
            U = fewer(self.unknown(record) / b.noise_std[:, None], taken)
            grams.append(Grams.made(Linearised(left, columns, U, taken)))
        mean, std = -base.deviations * base.prior_std, base.prior_std
        logs, multiples = [], []
        for kappa in KAPPAS:
            found = reduced(grams, np.ones(len(b.outputs)), kappa)
            factor = cho_factor(found.A[:k, :k] + np.diag(std**-2.0))
            v = found.b - found.A[:, :k] @ mean
            across = found.A[:k, k:]
            precision = np.diag(found.A)[k:] - np.sum(across * cho_solve(factor, across), axis=0) + SIZE**-2.0
            a = (v[k:] - across.T @ cho_solve(factor, v[:k])) / precision
            alone = found.log_evidence(mean, std, range(k))
            logs.append(alone + 0.5 * a**2 * precision - 0.5 * np.log(SIZE**2 * precision))
            multiples.append(a)
        best = np.argmax(logs, axis=0)
        order = np.argsort(-np.max(logs, axis=0), kind="stable")
        out: dict[str, tuple[Effect, dict[str, float]]] = {}
        for i in order:
            effect, x, _ = seen[i]
            start = _multiplied(effect, x, float(multiples[best[i]][i]))
            out.setdefault(effect.name, (effect, dict(zip((q.name for q in effect.parameters), start, strict=True))))
        return list(out.values())

    def unknown(self, record: FlightRecord) -> FloatArray:
        """Return what an unknown motion does to a record, its mean and what an unknown start changes taken out."""
        if id(record) not in self.moved:
            b, there = self.believed, self.believed.at(record)
            U = pulses(there.linear, b.outputs, there.condition.V_m_s, record)
            own = [b.in_noise_units(record, U[:, :, j]) for j in range(U.shape[2])]
            self.moved[id(record)] = np.stack(own, axis=2) * b.noise_std[:, None]
        return self.moved[id(record)]

    @cached_property
    def coefficients(self) -> tuple[Parameter, ...]:
        """The coefficients that are re-tuned beside every hypothesis."""
        return tuple(Parameter(n, "aircraft", 1.0, s) for n, s in self.tuned.priors.items())

    def nothing(self) -> Hypothesis:
        """Return the hypothesis that coefficients within their priors are all."""
        return self._asked("nothing", (), self.nuisances, lambda values: self.believed)

    def effect(self, effect: Effect, start: Mapping[str, float], nuisances: Mapping[str, float]) -> Hypothesis | None:
        """Return the hypothesis that an effect is what the model lacks, None if it cannot fly ``start``, its first."""
        own = {p.name: f"{effect.name}.{p.name}" for p in effect.parameters}
        sizes = tuple(size_of(own[p.name], p, start[p.name]) for p in effect.parameters)
        begin = {**nuisances, **{own[n]: v for n, v in start.items()}}

        def flown(values: Mapping[str, float]) -> Believed:
            return self.believed.with_effect(effect, {n: values[name] for n, name in own.items()})

        try:
            asked = self._asked(effect.name, sizes, begin, flown, effect.form_error)
        except _NOT_FLOWN:
            return None
        flies = all(np.any(np.isfinite(asked.predict(record, asked.first))) for record in self.records)
        return asked if flies else None

    def _asked(
        self,
        name: str,
        sizes: tuple[Parameter, ...],
        begin: Mapping[str, float],
        flown: Callable[[Mapping[str, float]], Believed],
        form_error: float = 0.0,
    ) -> Hypothesis:
        """Return a hypothesis whose flights begin, where starts are free, as they do at its first point."""
        priors = self.tuned.priors

        def tuned(model: Believed, values: Mapping[str, float]) -> Believed:
            return model.with_nuisances({n: values[n] for n in priors})

        first = {p.name: begin.get(p.name, p.value) for p in (*self.coefficients, *sizes)}
        starts = tuned(flown(first), first).begun_at(self.records)

        def model(values: Mapping[str, float], with_effect: bool = True) -> Believed:
            there = flown(values) if with_effect else self.believed
            return tuned(there, values).beginning(starts, there=True)

        def signature(record: FlightRecord, values: Mapping[str, float]) -> FloatArray:
            change = self._read(model(values), record) - self._read(model(values, False), record)
            return np.asarray(form_error * np.nan_to_num(change))

        return Hypothesis(
            name,
            (*self.coefficients, *sizes),
            lambda record, values: self._read(model(values), record),
            begin=begin,
            slopes=lambda record: self.tangents[id(record)],
            ahead=lambda some: fly_together([model(values) for values in some], self.records),
            form=signature if form_error else None,
        )

    def _read(self, model: Believed, record: FlightRecord) -> FloatArray:
        """Return what a model says the sensors read (n, p), means and unknown starts fitted; NaN if it cannot fly."""
        outputs = self.believed.outputs
        try:
            return np.asarray(record.columns(outputs) - model.residuals(record) * self.believed.noise_std)
        except _NOT_FLOWN:
            return np.full((len(record), len(outputs)), np.nan)


def _signatures(base: Point, effect: Effect) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield the usual sizes of an effect that records can show, and what they change."""
    starts = starts_of(effect)
    for x, change in zip(starts, Signature(base, effect).at_all(starts), strict=True):
        if change is not None and np.all(np.isfinite(change)) and change @ change > INVISIBLE:
            yield x, change


def _multiplied(effect: Effect, x: FloatArray, multiple: float) -> list[float]:
    """Return usual sizes with that of the one size of the effect multiplied, within its bounds."""
    out, sizes = x.tolist(), [i for i, q in enumerate(effect.parameters) if q.none is not None]
    for i in sizes if len(sizes) == 1 else ():
        q = effect.parameters[i]
        none = q.none or 0.0
        least = -3.0 if q.low < none < q.high else 0.1
        size = none + float(np.clip(multiple, least, 3.0)) * (x[i] - none)
        out[i] = float(np.clip(size, *ends_of(q)))
    return out


def size_of(name: str, parameter: EffectParameter, value: float) -> Parameter:
    """Return the prior of a parameter of an effect, about which a fit has found ``value``.

    A size has its prior about no effect, as wide as the usual starts; what is no size, about its starts.
    """
    low, high = parameter.low, parameter.high
    if parameter.prior is not None:
        mean, std = parameter.prior[0], parameter.prior[0] * parameter.prior[1]
    elif parameter.none is not None:
        mean, std = parameter.none, SIZE * max(abs(s - parameter.none) for s in parameter.starts)
    else:
        mean = float(np.mean(parameter.starts))
        std = max(float(np.ptp(parameter.starts)), 0.5 * abs(mean), 1e-3 * (high - low))
    step = 1e-3 * max(abs(value), 1e-2 * std)
    return Parameter(name, "effect", min(max(mean, low), high), std, parameter.unit, low, high, step)
