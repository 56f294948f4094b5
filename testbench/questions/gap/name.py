"""Name what a model lacks: explanations that come near by their signatures are flown to rest and compared.

A first stage sees all of the library at its usual sizes, to first order (:mod:`testbench.inference.first_order`); what
comes nearest there is fitted by flights (:mod:`testbench.inference.evidence`). Where something that the best
explanation does not account for is probable, another beside it is sought and flown likewise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from testbench.aircraft.seams import SHORTEST_S
from testbench.core.record import FlightRecord, FloatArray
from testbench.effects import Effect, left_out, library
from testbench.effects import Parameter as EffectParameter
from testbench.effects.base import SIZE, together
from testbench.inference.evidence import Comparison, Fitting, Row, compare_hypotheses
from testbench.inference.first_order import Columns, FirstOrder, Left, Sums, sum_of
from testbench.inference.fit import Hypothesis, Keeper, Points, Predict
from testbench.inference.linear import Motion, fewer
from testbench.inference.parameters import Noise, Parameter, Source
from testbench.inference.unknown import pulses
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.explain import Explanation, Naming, Weighed, share_of_excess, told, wrong_coefficient
from testbench.questions.gap.open_set import OpenTerm, rank_terms
from testbench.questions.gap.search.gust_search import sought
from testbench.questions.gap.search.point import NOT_FLOWN, Point, changes, fly_together, retune
from testbench.questions.gap.starts import far_apart, times_of

WIDE = 10.0  # the same of a coefficient that is wrong, in multiples of that of its prior
WIDER = (WIDE**2 - 1.0) ** 0.5  # of what it is wrong by, beside its prior
SCALE = 0.7  # least prior standard deviation of ln of a parameter that is a scale: a factor of two either way
MOST, COEFFICIENTS, TERMS = 7, 3, 3  # effects, coefficients and terms that forces follow that are flown, the nearest
SHOWN = 12  # terms that are listed
BEGINS = 2  # points from which an effect is fitted, the best first
BESIDE = 4  # effects that are flown beside each of the best
NEEDS = 0.1  # that an unknown motion is needed, from which another is sought beside the two best, not the best alone
PARTNER = 8.0  # in ln p to first order: what another must gain beside an effect to be flown; neither decides anything
ELSEWHERE = 0.5  # the same probability, from which what begins in flight is tried first
INVISIBLE = 1e-2  # chi-square of what an effect changes at its starts, below which it cannot be seen


@dataclass(frozen=True)
class Sought:
    """All that is weighed as an explanation, and what is known beside the records."""

    effects: Mapping[str, Effect] | None = None  #: the library, by name; that of the suite if not given
    #: effects that are sought only in a place where one of the library comes near
    further: Mapping[str, Effect] = field(default_factory=dict)
    open_terms: bool = False  #: terms that no effect of the library holds are weighed, too (:mod:`.open_set`)
    source: Source = "simulated"  #: where the noise of the sensors comes from
    pairs: bool = True  #: where one effect does not explain all, two at once are tried, or three
    held_out: Sequence[FlightRecord] = ()  #: measured records that judge
    #: (believed, comparison) -> whether what is missing may act in a part of the flights alone, so that no second
    #: effect is sought where no explanation does without an unknown motion (``ELSEWHERE``)
    elsewhere: Callable[[Believed, Comparison], bool] = lambda believed, table: False
    #: of the open set that an earlier search flew, and of how many they were chosen
    terms: tuple[tuple[OpenTerm, ...], int] = ((), 1)
    #: effects that an earlier search flew: they are flown again, and no others are looked for beside none
    near: Sequence[str] = ()
    #: hypothesis -> its parameters where an earlier search, in other air or from other starts, came to rest: its fit
    #: begins there
    rested: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    keeper: Keeper | None = None  #: of fits that are at rest, for a search that is interrupted


def name_effect(
    believed: Believed,
    records: Sequence[FlightRecord],
    what: Sought | None = None,
    progress: Callable[[str], None] | None = None,
) -> Naming:
    """Weigh all that the library explains of ``records``, or ``what`` says, and name what is probable."""
    say, what = progress or (lambda text: None), what or Sought()
    for record in records:
        believed.check_commands(record)
    asker = _Asker(believed, tuple(records), what.source, what.rested)
    say("re-tune the a-priori model")
    base = asker.tuned
    say("fly the nearest explanations again" if what.near else "search the library")
    known = library(believed.suite, believed.aircraft) if what.effects is None else what.effects
    known = {n: sought(base, e) for n, e in known.items()}
    rejected = {n: why for n, e in known.items() if (why := not_sought(base, e))}
    known = {n: e for n, e in known.items() if n not in rejected}
    if what.near:
        near = asker.near([e for n, e in (known | dict(what.further)).items() if n in what.near])
    else:
        near = asker.near(list(known.values()))
        places = {one.effect.place for one in near[:MOST]}
        new = {n: e for n, e in what.further.items() if e.place in places and n not in known}
        new = {n: e for n, e in new.items() if not not_sought(base, e)}
        known |= new
        near = sorted([*near, *asker.near(list(new.values()))], key=lambda one: -one.log)
        rejected |= dict.fromkeys(known.keys() - {one.effect.name for one in near}, "these records cannot show it")
    flown, (terms, tried) = near[:MOST], what.terms
    wrong = asker.wrong()[:COEFFICIENTS]
    say(f"fly {len(flown)} nearest explanations")
    say(told({one.effect.title: one.log for one in flown}, "weighed to first order"))
    asked = {"nothing": asker.nothing(), **{n: asker.coefficient(n) for n in wrong}}
    shown = {n: wrong_coefficient(n) for n in wrong}

    def ask(some: Sequence[_Near]) -> None:
        for one in some:
            if (hypothesis := asker.effect(one)) is None:
                rejected[one.effect.name] = "nothing near its usual sizes flies the measured commands"
            else:
                asked[one.effect.name], shown[one.effect.name] = hypothesis, one.effect

    def ask_terms() -> None:
        ask([_Near(t.effect, (({"size": t.size}, base.by_name),), t.log, t.gain) for t in terms[:TERMS]])

    ask(flown)
    ask_terms()
    seen = max(1, len(known) - len(rejected.keys() & known.keys()))

    def weighed(before: Weighed | None = None) -> Weighed:
        some, known = list(asked.values()), None if before is None else before.table
        moving, new = [0], {h.name for h in some} - (set() if known is None else known.fits.keys())

        def ahead(points: Points) -> None:
            now = len({hypothesis.name for hypothesis, _ in points} & new)
            if now != moving[0] and max(now, moving[0]) > 1:  # the first is fitted alone, for the noise
                say(f"fit explanations, {len(new) - now} of {len(new)} converged")
            moving[0] = now
            asker.ahead(points)

        fitting = Fitting(0, ahead, what.keeper)
        found = compare_hypotheses(asker.records, some, asker.noise, asker.unknown, what.held_out, known, fitting)
        named = tuple(t.name for t in terms if t.name in shown)
        out = Weighed.of(found, dict(shown), seen, len(base.priors), tried, named)
        titles = {n: e.title for n, e in shown.items()} | {"unknown": "something unknown"}
        say(told({titles.get(n, n): np.log(p) for n, p in out.stated.items() if p > 0.0}, "weighed"))
        return out

    out = weighed()
    best = max(out.effects, key=lambda n: out.table[n].log_evidence, default=None)
    if out.nothing <= 0.5 and best is not None:  # does one do without the effect where it brought the coefficients?
        asked["nothing"] = asker.nothing(out.table[best].posterior.by_name)
        out = weighed(out)
    # An effect may be alike to a term, of which it has the form to within the noise; a coefficient has the model's own.
    doubt = out.unknown if best is not None and out.effects[best].parameters else out.needed
    if what.open_terms and out.nothing <= 0.5 and doubt > NEEDS:
        say("search terms outside the library")
        terms, tried = asker.open_terms()
        ask_terms()
        out = weighed(out)
    for several in (1, 2) if what.pairs else ():
        if out.nothing > 0.5 or (several == 1 and out.needed > ELSEWHERE and what.elsewhere(believed, out.table)):
            break
        others = [e for e in known.values() if e.name not in rejected]
        more = _beside_the_best(asker, out, several, others, say)
        if not more:
            break
        asked |= {e.name: hypothesis for e, hypothesis in more}
        shown |= {e.name: e for e, _ in more}
        out = weighed(out)
        best = max(shown, key=lambda n: out.table[n].log_evidence)
        parts = [e.name for e in shown[best].parts if e.name in asked and e.parameters]
        rest = [pair for pair in asker.without_one(shown[best], out.table[best]) if pair[0].name not in asked]
        if parts or rest:  # does one do without the others where they brought it?
            asked |= {n: asker.alone(asked[n], out.table[best]) for n in parts}
            asked |= {e.name: hypothesis for e, hypothesis in rest}
            shown |= {e.name: e for e, _ in rest}
            out = weighed(out)
    behind = {one.effect.name: near[0].log - one.log for one in near}
    rejected |= {
        n: f"ln p of its signature lies {behind[n]:.3g} behind the nearest"
        for n in behind.keys() - shown.keys() - rejected.keys()
    }
    return replace(asker.named(out, rejected, terms), acting=partial(asker.acting, list(known.values())))


def nearest(believed: Believed, records: Sequence[FlightRecord], effects: Sequence[Effect]) -> float:
    """Return what the effect that comes nearest to records gains in ln p, to first order."""
    near = _Asker(believed, tuple(records), "measured").near(effects)
    return near[0].gain if near else -np.inf


def _beside_the_best(
    asker: _Asker, found: Weighed, several: int, others: Sequence[Effect], say: Callable[[str], None]
) -> list[tuple[Effect, Hypothesis]]:
    """Return explanations that have one more than the best of so many effects or coefficients.

    Beside the two best effects another is sought where something unknown is probable, else beside the best.
    """
    order = sorted(found.effects, key=lambda n: -found.table[n].log_evidence)
    best = found.effects[order[0]]
    out: list[tuple[Effect, Hypothesis]] = []
    if not best.parameters and len(best.singles) == several:
        have = [e.name for e in best.singles]
        for name in [n for n in asker.wrong(*have) if n not in have][:COEFFICIENTS]:
            out.append((wrong_coefficient(*have, name), asker.coefficient(*have, name)))
    leading = [found.effects[n] for n in order if found.effects[n].parameters]
    leading = leading[: 2 if several == 1 and found.needed > NEEDS else several]
    known = [{e.name for e in effect.singles} for effect in found.effects.values()]
    for first in [e for e in leading if len(e.singles) == several]:
        say(f"seek another effect in addition to {first.title}")
        near = [one for one in asker.beside(first, found.table, others) if one.gain > PARTNER]
        for one in near[:BESIDE]:
            names = {e.name for e in one.effect.singles}
            if names not in known and (hypothesis := asker.effect(one)) is not None:
                known.append(names)
                out.append((one.effect, hypothesis))
    return out


def not_sought(base: Point, effect: Effect) -> str:
    """Return why an effect is not sought in these records, or ""."""
    if effect.lateral and not base.lateral:
        return "these records cannot show it: neither aileron nor rudder moves"
    if effect.over_time is not None and not far_apart(times_of(base.records)):
        return "these records cannot show it: none is said to be flown a minute or more after another (flown_at_s)"
    return "" if effect.looks else f"looked for in every record, no {effect.name} stands out of one"


@dataclass(frozen=True, eq=False)
class _Near:
    """An effect with the sizes and coefficients that fits begin with, and ln p of the best of them to first order.

    ``gain`` is what it lies above the point about which it was seen.
    """

    effect: Effect
    begins: tuple[tuple[Mapping[str, float], Mapping[str, float]], ...]
    log: float
    gain: float

    def with_(self, other: _Near) -> _Near:
        """Return it with the beginnings of another one of the same effect, which is less probable."""
        return replace(self, begins=(*self.begins, *other.begins)[:BEGINS])


@dataclass(eq=False)
class _Asker:
    """What the hypotheses about some records have in common."""

    believed: Believed
    records: tuple[FlightRecord, ...]
    source: Source
    rested: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    motions: dict[int, Motion] = field(default_factory=dict)  # unknown ones, of each record
    models: dict[Predict, Callable[[Mapping[str, float]], Believed]] = field(default_factory=dict)  # by what predicts
    seen: dict[str, list[tuple[FloatArray, FloatArray]]] = field(default_factory=dict)  # of each effect

    @cached_property
    def start(self) -> Point:
        """The believed model as it is."""
        return Point.at(self.believed, self.believed, self.records)

    @cached_property
    def tuned(self) -> Point:
        """The believed model re-tuned, without any effect."""
        return retune(self.start)

    @cached_property
    def tangents(self) -> list[dict[int, dict[str, FloatArray]]]:
        """Of each of ``bases``, by record: coefficient -> change of the prediction (n, p)."""
        out = []
        for base in self.bases:
            of = zip(self.records, base.by_record(-base.tangents), strict=True)
            slopes = [(id(record), T * self.believed.noise_std[:, None]) for record, T in of]
            out.append({i: {name: T[:, :, k] for k, name in enumerate(base.priors)} for i, T in slopes})
        return out

    @cached_property
    def noise(self) -> Noise:
        """What is believed of the noise."""
        b = self.believed
        return Noise(dict(zip(b.outputs, b.noise_std.tolist(), strict=True)), self.source)

    @property
    def bases(self) -> list[Point]:
        """Where effects are looked for: beside re-tuned coefficients, and believed ones where these are strained.

        An effect whose work re-tuned coefficients do, far from their priors, promises nothing beside them.
        """
        d = self.tuned.deviations
        return [self.tuned, self.start] if float(d @ d) > 2.0 * len(d) else [self.tuned]

    def near(self, effects: Sequence[Effect]) -> list[_Near]:
        """Return effects that can be seen, the most probable first, by what they change at usual sizes."""
        best: dict[str, _Near] = {}
        for base in self.bases:
            for one in self._near(base, effects, np.zeros((base.exact.size, 0)), np.zeros(0), np.zeros(0)):
                name = one.effect.name
                pair = sorted([one, *([best[name]] if name in best else [])], key=lambda n: -n.log)
                best[name] = pair[0].with_(pair[-1]) if len(pair) > 1 else one
        return sorted(best.values(), key=lambda one: -one.log)

    def beside(self, first: Effect, table: Comparison, effects: Sequence[Effect]) -> list[_Near]:
        """Return pairs of an effect that was fitted and another, the most probable first."""
        row, asked = table[first.name], table.fits[first.name][1].hypothesis
        found = row.posterior
        at = found.by_name
        sizes = [p for p in found.parameters if p.block == "effect"]
        values = _split(first, row)[0]
        base = self.tuned.moved(self.believed.with_effect(first, values), self.tuned.vector(at))
        if base is None:
            return []
        points = [at, *({**at, p.name: at[p.name] + _step(p, at[p.name])} for p in sizes)]
        self.ahead([(asked, x) for x in points])
        models = [self.models[asked.predict](x) for x in points]
        flown = [
            np.concatenate([(self._read(m, r) / self.believed.noise_std).ravel() for r in self.records]) for m in models
        ]
        own = [np.nan_to_num((y - flown[0]) / _step(p, at[p.name])) for p, y in zip(sizes, flown[1:], strict=True)]
        columns = np.column_stack(own) if own else np.zeros((base.exact.size, 0))
        offset = np.array([p.value - at[p.name] for p in sizes])
        others = [e for e in effects if e.name not in {s.name for s in first.singles}]
        out = []
        for one in self._near(base, others, -columns, offset, np.array([p.prior_std for p in sizes])):
            both, own_name = together(*first.singles, one.effect), "" if first.parts else f"{first.name}."
            known = {f"{own_name}{n}": v for n, v in values.items()}
            begins = [
                (known | {f"{one.effect.name}.{n}": v for n, v in own_values.items()}, beside)
                for own_values, beside in one.begins
            ]
            out.append(replace(one, effect=both, begins=tuple(begins)))
        return sorted(out, key=lambda one: -one.log)

    def _near(
        self, base: Point, effects: Sequence[Effect], own: FloatArray, offset: FloatArray, std: FloatArray
    ) -> list[_Near]:
        """Return effects with the sizes to begin with by what they change at their usual sizes about a point.

        To first order (:mod:`testbench.inference.first_order`): coefficients and sizes of what the point has already
        have their priors, an effect is seen in a multiple of what it changes, beside an unknown motion of every size.
        """
        known = self._signatures(effects)
        seen = [(effect, *one) for effect in effects for one in known[effect.name]]
        if not seen:
            return []
        shared = -np.column_stack([base.tangents, own])
        mean = np.concatenate([-base.deviations * base.prior_std, offset])
        each = -np.column_stack([s for *_, s in seen])
        found = self._weighed(base, shared, each, mean, np.concatenate([base.prior_std, std]), np.full(len(seen), SIZE))
        best, most = np.argmax(found.logs[:, :, 0], axis=0), np.max(found.logs[:, :, 0], axis=0)
        out: dict[str, _Near] = {}
        for i in np.argsort(-most, kind="stable"):
            effect, x, _ = seen[i]
            start = multiplied(effect, x, float(found.multiples[best[i], i, 0]))
            values = dict(zip((q.name for q in effect.parameters), start, strict=True))
            one = _Near(effect, ((values, base.by_name),), float(most[i]), float(most[i] - np.max(found.alone)))
            out[effect.name] = out[effect.name].with_(one) if effect.name in out else one
        return list(out.values())

    def _signatures(self, effects: Sequence[Effect]) -> Mapping[str, list[tuple[FloatArray, FloatArray]]]:
        """Return effect -> its usual sizes that records can show, and what each changes there.

        They are seen about the re-tuned model, and about the believed one where they do not fly there; to first order
        it makes no difference.
        """
        new = [effect for effect in effects if effect.name not in self.seen]
        each = [(effect, x) for effect in new for x in starts_of(effect)]
        self.seen |= {effect.name: [] for effect in new}
        for base in self.bases:
            flown = list(zip(each, changes(base, each), strict=True))
            for (effect, x), change in flown:
                if change is not None and np.all(np.isfinite(change)) and change @ change > INVISIBLE:
                    self.seen[effect.name].append((x, change))
            each = [one for one, change in flown if change is None]
        return self.seen

    def wrong(self, *wide: str) -> list[str]:
        """Return the coefficients, the one first that gains most by a wide prior, to first order.

        Those of ``wide`` have one already.
        """
        base, names = self.tuned, list(self.tuned.priors)
        mean = -base.deviations * base.prior_std
        std = np.where([n in wide for n in names], WIDE, 1.0) * base.prior_std
        found = self._weighed(base, -base.tangents, -base.tangents, mean, std, WIDER * base.prior_std)
        return [names[i] for i in np.argsort(-np.max(found.logs[:, :, 0], axis=0), kind="stable")]

    def _weighed(
        self, base: Point, shared: FloatArray, each: FloatArray, mean: FloatArray, std: FloatArray, sizes: FloatArray
    ) -> FirstOrder:
        """Weigh columns ``each`` (samples, h) about a point, beside those that all share, (samples, k)."""
        parts = self._columns(base, shared, each)
        return FirstOrder.of(
            sum_of(c.beside(shared.shape[1]) for c, _ in parts), sum_of(c.left(r) for c, r in parts), mean, std, sizes
        )

    def _columns(self, base: Point, shared: FloatArray, each: FloatArray) -> list[tuple[Columns, FloatArray]]:
        """Return of each record its columns about a point and what is left of it there (samples, 1)."""
        parts = columns_of(base, np.column_stack([shared, each]), [self.unknown(r) for r in self.records])
        return [(c, r.reshape(-1, 1)) for c, r in zip(parts, base.by_record(base.exact), strict=True)]

    def acting(
        self, effects: Sequence[Effect], places: Sequence[Sequence[NDArray[np.bool_]]]
    ) -> list[dict[str, float]]:
        """Return of each place effect -> ln p, to first order, if it acts there alone, the most probable first.

        A place are samples (n,) of each record. What an effect did before it began, or does after it ended, is left
        out: a servo or a motion that comes to rest.
        """
        base, known = self.tuned, self._signatures(effects)
        seen = [(e.name, c) for e in effects for _, c in known[e.name]]
        if not seen:
            return [{} for _ in places]
        k = len(base.prior_std)
        parts = self._columns(base, -base.tangents, -np.column_stack([c for _, c in seen]))
        made: dict[tuple[int, bytes], tuple[Sums, Left]] = {}

        def sums(i: int, acts: NDArray[np.bool_]) -> tuple[Sums, Left]:
            if (i, acts.tobytes()) not in made:
                columns, left = parts[i]
                there = columns.acting(np.repeat(acts, len(self.believed.outputs)), k)
                made[i, acts.tobytes()] = there.beside(k), there.left(left)
            return made[i, acts.tobytes()]

        mean, sizes, out = -base.deviations * base.prior_std, np.full(len(seen), SIZE), []
        for place in places:
            every, rest = zip(*(sums(i, acts) for i, acts in enumerate(place)), strict=True)
            found = FirstOrder.of(sum_of(every), sum_of(rest), mean, base.prior_std, sizes)
            logs: dict[str, float] = {}
            for i in np.argsort(-np.max(found.logs[:, :, 0], axis=0), kind="stable"):
                logs.setdefault(seen[i][0], float(np.max(found.logs[:, i, 0])))
            out.append(logs)
        return out

    def open_terms(self) -> tuple[tuple[OpenTerm, ...], int]:
        """Return the terms of the open set that the aircraft can have, the most probable first, and their number."""

        def weigh(columns: FloatArray) -> list[FirstOrder]:
            sizes = np.ones(columns.shape[1])
            return [
                self._weighed(b, -b.tangents, columns, -b.deviations * b.prior_std, b.prior_std, sizes)
                for b in self.bases
            ]

        found, tried = rank_terms(self.tuned, weigh)
        known = left_out({t.name: t.effect for t in found[:SHOWN]}, self.believed.aircraft, self.believed.suite)
        return tuple(t for t in found[:SHOWN] if t.name not in known), tried

    def unknown(self, record: FlightRecord) -> Motion:
        """Return what an unknown motion does to a record, its mean and what an unknown start changes taken out."""
        if id(record) not in self.motions:
            self.motions[id(record)] = fewer(unknown_motion(self.believed, record), self.believed.taken(record))
        return self.motions[id(record)]

    @cached_property
    def coefficients(self) -> tuple[Parameter, ...]:
        """The coefficients that are re-tuned beside every hypothesis."""
        return tuple(Parameter(n, "aircraft", 1.0, s) for n, s in self.tuned.priors.items())

    def nothing(self, begin: Mapping[str, float] | None = None) -> Hypothesis:
        """Return the hypothesis that coefficients within their priors are all."""
        begin = self._begin("nothing") if begin is None else begin
        return self._asked("nothing", self.coefficients, begin, lambda values: self.believed)

    def coefficient(self, *names: str) -> Hypothesis:
        """Return the hypothesis that a coefficient, or several, are wrong, which is all."""
        own = tuple(replace(p, prior_std=WIDE * p.prior_std) if p.name in names else p for p in self.coefficients)
        name = " + ".join(names)
        return self._asked(name, own, self._begin(name), lambda values: self.believed)

    def _begin(self, name: str) -> Mapping[str, float]:
        return self.rested.get(name, self.tuned.by_name)

    def effect(self, one: _Near) -> Hypothesis | None:
        """Return the hypothesis that an effect is what the model lacks; None if it cannot fly where it begins."""
        effect = one.effect
        own = {p.name: f"{effect.name}.{p.name}" for p in effect.parameters}
        scales = {p.name for p in effect.parameters if is_scale(p)}
        sizes = tuple(size_of(own[p.name], p, one.begins[0][0][p.name]) for p in effect.parameters)
        begins = [
            {**beside, **{own[n]: float(np.log(v)) if n in scales else v for n, v in values.items()}}
            for values, beside in one.begins
        ]
        if effect.name in self.rested:
            begins = [dict(self.rested[effect.name])]
        elif scales and not effect.parts:  # several begin where one of them has come to rest
            begins += [
                {own[n]: float(np.log(v)) if n in scales else v for n, v in zip(own, x.tolist(), strict=True)}
                for x in self._scales_of(effect)
            ]

        def flown(values: Mapping[str, float]) -> Believed:
            at = {n: float(np.exp(values[name])) if n in scales else values[name] for n, name in own.items()}
            return self.believed.with_effect(effect, at)

        for k, begin in enumerate(begins):
            try:
                asked = self._asked(effect.name, (*self.coefficients, *sizes), begin, flown, effect.form_error)
            except NOT_FLOWN:
                continue
            if self._flies(asked):
                return replace(asked, more=begins[k + 1 :])
        return None

    def _scales_of(self, effect: Effect) -> list[FloatArray]:
        """Return sizes (p,) whose scales go through all that records can show, a factor of two apart.

        Re-tuned coefficients do most of what a limit takes away that is lower than any usual one. A fit from beside
        them comes to rest there, so that believed coefficients stand beside each. The ends come first: what a fit from
        there passes on its way need not be begun from.
        """
        each = [(effect, x) for x in scaled(effect)]
        shown = zip(each, changes(self.start, each), strict=True)
        out = [x for (_, x), change in shown if change is not None and change @ change > INVISIBLE]
        some = np.array([is_scale(p) for p in effect.parameters])
        far = [float(np.mean(np.log(x[some]))) for x in out]
        middle = 0.5 * (min(far, default=0.0) + max(far, default=0.0))
        return [out[i] for i in np.argsort([-abs(f - middle) for f in far], kind="stable")]

    def ahead(self, points: Points) -> None:
        """Fly points of several hypotheses together; they are found when they are asked for."""
        fly_together([self.models[asked.predict](values) for asked, values in points], self.records)

    def _flies(self, hypothesis: Hypothesis) -> bool:
        first = hypothesis.first
        self.ahead([(hypothesis, first)])
        return all(np.isfinite(hypothesis.predict(r, first)[self.believed.taken(r)]).all() for r in self.records)

    def alone(self, hypothesis: Hypothesis, row: Row) -> Hypothesis:
        """Return the hypothesis of one effect that begins where several, of which it is one, came to rest."""
        at = row.posterior.by_name
        begin = {n: at.get(n, at.get(f"{row.name}.{n}", v)) for n, v in hypothesis.first.items()}
        there = replace(hypothesis, begin=begin, more=())
        return there if self._flies(there) else hypothesis

    def without_one(self, effect: Effect, row: Row) -> list[tuple[Effect, Hypothesis]]:
        """Return what three or more effects are without each of them, from where they came to rest together."""
        if len(effect.parts) < 3 or not effect.parameters:
            return []
        values, _, beside, _ = _split(effect, row)
        out = []
        for gone in effect.parts:
            rest = together(*(e for e in effect.parts if e is not gone))
            begins = (({p.name: values[p.name] for p in rest.parameters}, beside),)
            if (hypothesis := self.effect(_Near(rest, begins, row.log_evidence, 0.0))) is not None:
                out.append((rest, hypothesis))
        return out

    def _asked(
        self,
        name: str,
        parameters: tuple[Parameter, ...],
        begin: Mapping[str, float],
        flown: Callable[[Mapping[str, float]], Believed],
        form_error: float = 0.0,
        starts: Mapping[str, FloatArray] | None = None,
    ) -> Hypothesis:
        """Return a hypothesis whose flights begin, where starts are free, as given, or as suits its first point."""
        priors = self.tuned.priors

        def tuned(model: Believed, values: Mapping[str, float]) -> Believed:
            return model.with_nuisances({n: values[n] for n in priors})

        first = {p.name: begin.get(p.name, p.value) for p in parameters}
        at = self.tuned.vector(first)
        far = [float(np.sum(((b.nuisances - at) / b.prior_std) ** 2)) for b in self.bases]
        tangents = self.tangents[int(np.argmin(far))]  # of the base that lies nearest to where the fit begins
        if starts is None:
            there = tuned(flown(first), first)
            fly_together([there], self.records)
            starts = there.begun_at(self.records)

        def model(values: Mapping[str, float], with_effect: bool = True) -> Believed:
            there = flown(values) if with_effect else self.believed
            return tuned(there, values).beginning(starts, there=True)

        def signature(record: FlightRecord, values: Mapping[str, float]) -> FloatArray:
            without = model(values, False)
            fly_together([without], self.records)
            change = self._read(model(values), record) - self._read(without, record)
            return np.asarray(form_error * np.nan_to_num(change))

        def begun(values: Mapping[str, float]) -> Hypothesis | None:
            try:
                better = model(values).better_starts(self.records)
            except NOT_FLOWN:  # a fit may end where it cannot fly
                return None
            return self._asked(name, parameters, values, flown, form_error, better) if better else None

        def predict(record: FlightRecord, values: Mapping[str, float]) -> FloatArray:
            return self._read(model(values), record)

        self.models[predict] = model
        return Hypothesis(
            name,
            parameters,
            predict,
            begin=begin,
            slopes=lambda record: tangents[id(record)],
            form=signature if form_error else None,
            begun=begun if starts else None,
        )

    def _read(self, model: Believed, record: FlightRecord) -> FloatArray:
        """Return what a model says the sensors read (n, p), means and unknown starts fitted; NaN if it cannot fly."""
        outputs = self.believed.outputs
        try:
            return np.asarray(record.columns(outputs) - model.residuals(record) * self.believed.noise_std)
        except NOT_FLOWN:
            return np.full((len(record), len(outputs)), np.nan)

    def named(self, weighed: Weighed, rejected: Mapping[str, str], terms: tuple[OpenTerm, ...]) -> Naming:
        """Return what is named by the probabilities, all explanations flown at their best points."""
        rows = {row.name: row for row in weighed.table.rows}
        at = {name: _split(weighed.effects.get(name), row) for name, row in rows.items()}
        models = [
            self.believed if name == "nothing" else self.believed.with_effect(weighed.effects[name], values)
            for name, (values, *_) in at.items()
        ]
        points = self.tuned.moved_all(models, [self.tuned.vector(nuisances) for *_, nuisances, _ in at.values()])
        left = {}
        for (name, (*_, nuisances, _)), point in zip(at.items(), points, strict=True):
            d = {n: (f - 1.0) / self.tuned.priors[n] for n, f in nuisances.items() if n not in name.split(" + ")}
            left[name] = np.inf if point is None else float(point.exact @ point.exact + sum(x * x for x in d.values()))
        nothing, samples = min(left["nothing"], self.start.chi2), self.tuned.samples
        fits = []
        for name, effect in weighed.effects.items():
            gain, share = max(nothing - left[name], 0.0), share_of_excess(nothing, left[name], samples)
            whole, imitates, kappa = weighed[name], weighed.imitates(name), rows[name].posterior.kappa
            fits.append(Explanation(effect, *at[name], left[name], gain, share, whole, imitates, kappa))
        outcome, names = weighed.decide()
        ranking = tuple(sorted(fits, key=lambda f: (-f.probability, -rows[f.effect.name].log_evidence)))
        nuisances = at["nothing"][2]
        return Naming(outcome, names, ranking, weighed, self.start.chi2, nothing, nuisances, samples, rejected, terms)


def _split(
    effect: Effect | None, row: Row
) -> tuple[dict[str, float], dict[str, float], dict[str, float], dict[str, float]]:
    """Return sizes and their errors, coefficients and theirs, of a row."""
    found = row.posterior
    at = {p.name: found[p.name] for p in found.parameters}
    own = {} if effect is None else {p.name: at.pop(f"{effect.name}.{p.name}") for p in effect.parameters}
    scales = () if effect is None else [p.name for p in effect.parameters if is_scale(p)]
    own |= {n: (float(np.exp(own[n][0])), float(np.exp(own[n][0])) * own[n][1]) for n in scales}
    values, errors = ({n: of[k] for n, of in own.items()} for k in (0, 1))
    beside, spread = ({n: of[k] for n, of in at.items()} for k in (0, 1))
    return values, errors, beside, spread


def unknown_motion(believed: Believed, record: FlightRecord, deflections: bool = True) -> FloatArray:
    """Return what pulses of an unknown motion do to a record, (n, p, m), in units of the noise.

    Their means, and what an unknown start changes, are taken out. Without ``deflections`` no surface that is compared
    moves by itself.
    """
    there = believed.at(record)
    at = [i for i, c in enumerate(believed.outputs) if deflections or c not in believed.surfaces]
    moved = pulses(there.linear, [believed.outputs[i] for i in at], there.condition.V_m_s, record)
    U = np.zeros((len(record), len(believed.outputs), moved.shape[2]))
    U[:, at] = moved
    return np.stack([believed.in_noise_units(record, U[:, :, j]) for j in range(U.shape[2])], axis=2)


def columns_of(base: Point, columns: FloatArray, directions: Sequence[Motion]) -> list[Columns]:
    """Return columns (samples, K) about a point by record, beside the directions of the unknown motion of each."""
    parts = zip(base.by_record(columns), directions, base.records, strict=True)
    return [Columns.of(X, U, base.believed.taken(record)) for X, U, record in parts]


def starts_of(effect: Effect) -> list[FloatArray]:
    """Return every combination of the parameters' starts, each (p,)."""
    return [np.array(s) for s in product(*(p.starts for p in effect.parameters))]


def scaled(effect: Effect) -> list[FloatArray]:
    """Return its usual starts (p,), and on from the ends of these with all scales a factor of two apart, in bounds."""
    out, some = starts_of(effect), np.array([is_scale(p) for p in effect.parameters])
    low, high = (np.array([getattr(p, end) for p in effect.parameters]) for end in ("low", "high"))
    for ends, factor in ((min, np.exp(-SCALE)), (max, np.exp(SCALE))):
        x = np.array([ends(p.starts) if s else p.starts[0] for p, s in zip(effect.parameters, some, strict=True)])
        while np.all((low <= (x := np.where(some, factor * x, x))) & (x <= high)):
            out.append(x)
    return out


def multiplied(effect: Effect, x: FloatArray, multiple: float) -> list[float]:
    """Return usual sizes with that of the one size of the effect multiplied, within its bounds."""
    out, sizes = x.tolist(), [i for i, q in enumerate(effect.parameters) if q.none is not None]
    for i in sizes if len(sizes) == 1 else ():
        q = effect.parameters[i]
        none = q.none or 0.0
        least = -3.0 if q.low < none < q.high else 0.1
        size = none + float(np.clip(multiple, least, 3.0)) * (x[i] - none)
        out[i] = float(np.clip(size, 0.98 * q.low + 0.02 * none, 0.98 * q.high + 0.02 * none))
    return out


def _step(parameter: Parameter, value: float) -> float:
    """Return the step of a difference that stays within the bounds of a parameter."""
    step = parameter.difference
    return step if value + step <= parameter.high else -step


def is_scale(parameter: EffectParameter) -> bool:
    """Return whether a parameter is positive and known to no more than its order: a lag, a limit, a frequency."""
    known = parameter.none is not None or parameter.prior is not None
    return not known and parameter.low > 0.0 and parameter.high >= 10.0 * parameter.low


def size_of(name: str, parameter: EffectParameter, value: float) -> Parameter:
    """Return the prior of a parameter of an effect, whose fit begins at ``value``.

    A size has its prior about no effect, as wide as the usual starts; what is no size, about its starts. Of a scale it
    is the prior of its logarithm.
    """
    low, high = parameter.low, parameter.high
    if is_scale(parameter):
        starts = np.log(parameter.starts)
        std = max(float(np.ptp(starts)), SCALE)
        return Parameter(
            name, "effect", float(np.mean(starts)), std, "1", float(np.log(low)), float(np.log(high)), 1e-3
        )
    if parameter.prior is not None:
        mean, std = parameter.prior[0], parameter.prior[0] * parameter.prior[1]
    elif parameter.none is not None:
        mean, std = parameter.none, SIZE * max(abs(s - parameter.none) for s in parameter.starts)
    else:
        mean = float(np.mean(parameter.starts))
        std = max(float(np.ptp(parameter.starts)), 0.5 * abs(mean), 0.1 * (high - low))
    step = 1e-3 * max(abs(value), 1e-2 * std)
    if parameter.unit == "s" and parameter.low == parameter.none == 0.0:
        step = max(step, SHORTEST_S)  # a lag within a frame changes nothing, and its slope there would be none
    return Parameter(name, "effect", min(max(mean, low), high), std, parameter.unit, low, high, step)
