"""What would be stated of flights that are not flown yet: truths drawn from the priors, to first order.

Effects are flown at usual sizes and at some that are drawn from their priors. A truth leaves in the residuals what one
of these changes, what coefficients change, an unknown motion and noise. All of the library is asked about it as the
first stage of naming asks; of the truth the right size is among those that are weighed, where a search would rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from testbench.core.record import FlightRecord, FloatArray
from testbench.effects import Effect
from testbench.effects.base import SIZE
from testbench.inference.first_order import Columns, FirstOrder, Left, Sums, sum_of
from testbench.inference.fit import WHOLE, whole_and_part
from testbench.inference.linear import KAPPAS, fewer
from testbench.questions.gap.again import CUT, SEED, sizes_of
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.explain import Weights, wrong_coefficient
from testbench.questions.gap.name import (
    COEFFICIENTS,
    INVISIBLE,
    MOST,
    WIDE,
    WIDER,
    columns_of,
    starts_of,
    unknown_motion,
)
from testbench.questions.gap.search.hypothesis import Hypothesis, changes

# Of nine truths: the priors of explain.py, of one error at a time.
KINDS = ("nothing", "effect", "nothing", "coefficient", "nothing", "effect", "unknown", "nothing", "effect")
SIZES = 3  # of each effect that are drawn from its prior and flown
_TRIED = 4  # times that those which cannot be flown are drawn again
_WHOLE, _PART = (tuple(k for k in KAPPAS if (k <= WHOLE) == whole) for whole in (True, False))
Point = tuple[Effect, FloatArray]
"""An effect and its parameter values (p,)."""


def usual_sizes(effects: Sequence[Effect]) -> list[Point]:
    """Return the usual sizes of effects."""
    return [(e, x) for e in effects for x in starts_of(e)]


@dataclass(frozen=True, eq=False)
class Foreseen:
    """Records and what effects change in them about the believed model.

    Attributes:
        base: the believed model in them.
        points: (h,) whose changes the own columns are: ``usual`` sizes, then those that were drawn.
        parts: of each record, the columns of the k coefficients, the h own ones, and again those of the coefficients,
            each of which may be wrong.
    """

    base: Hypothesis
    points: tuple[Point, ...]
    usual: int
    parts: tuple[Columns, ...]

    @classmethod
    def of(
        cls,
        believed: Believed,
        records: Sequence[FlightRecord],
        points: Sequence[Point],
        priors: Mapping[str, float] | None = None,
        drawn: int = 0,
    ) -> Foreseen:
        """Fly effects through records.

        Args:
            believed: aircraft, sensors and condition.
            records: with commands and motion.
            points: effects and their sizes; those that cannot fly, or are not sought, change nothing.
            priors: coefficient -> relative deviation of its prior; if not given, those that the records ask for.
            drawn: number of sizes of each effect that are drawn from its prior and flown, too.

        Raises:
            FlightAborted, TrimError, LimitError: the believed aircraft cannot fly the records.
        """
        base = Hypothesis.at(believed, believed, tuple(records), priors=priors)
        own = [np.zeros(base.exact.size) if c is None else c for c in _changes(base, points)]
        points, usual = list(points), len(points)
        rng = np.random.default_rng(SEED)
        missing = [e for e in dict.fromkeys(e for e, _ in points) for _ in range(drawn)]
        for _ in range(_TRIED if missing else 0):
            sizes = [(e, np.array(list(sizes_of(e, rng).values()))) for e in missing]
            found = _changes(base, sizes)
            flown = [(x, c) for x, c in zip(sizes, found, strict=True) if c is not None]
            points, own = [*points, *(x for x, _ in flown)], [*own, *(c for _, c in flown)]
            missing = [e for e, c in zip(missing, found, strict=True) if c is None]
        columns = -np.column_stack([base.tangents, *own, base.tangents])
        directions = [fewer(unknown_motion(believed, r), believed.taken(r)) for r in base.records]
        return cls(base, tuple(points), usual, tuple(columns_of(base, columns, directions)))

    @property
    def coefficients(self) -> tuple[str, ...]:
        """The coefficients, each of which may be wrong."""
        return tuple(self.base.priors)

    @cached_property
    def effects(self) -> dict[str, Effect]:
        """The effects that can be seen in these records, by name."""
        return {e.name: e for (e, _), square in zip(self.points, self._squares, strict=True) if square > INVISIBLE}

    @cached_property
    def _squares(self) -> FloatArray:
        k = len(self.coefficients)
        return self.sums.squares[0, k:-k]

    @cached_property
    def sums(self) -> Sums:
        """What the evidence needs of the columns."""
        return sum_of(c.sums for c in self.parts)

    def weighed(
        self, left: Left, sums: Sums | None = None, effects: Mapping[str, Effect] | None = None
    ) -> list[Weights]:
        """Return what is said of residuals, of each apart.

        Naming flies what comes nearest at the usual sizes; so that alone is weighed, at all sizes.

        Args:
            left: of the residuals.
            sums: of all records that these are residuals of; of those here if not given.
            effects: that are sought, by name; those that can be seen here if not given.
        """
        std, k = self.base.prior_std, len(self.coefficients)
        effects = self.effects if effects is None else effects
        sizes = np.concatenate([[_multiple(*point) for point in self.points], WIDER * std])
        found = FirstOrder.of(self.sums if sums is None else sums, left, np.zeros(k), std, sizes)
        owners = np.array([*(e.name for e, _ in self.points), *self.coefficients])
        near = np.arange(len(owners)) < self.usual
        logs = {"nothing": whole_and_part(found.alone)}
        logs |= {n: whole_and_part(found.logs[:, owners == n].max(axis=1)) for n in (*effects, *self.coefficients)}
        first = {n: found.logs[:, (owners == n) & near].max(axis=(0, 1)) for n in effects}
        wrong = {n: found.logs[:, owners == n].max(axis=(0, 1)) for n in self.coefficients}
        named = {**effects, **{n: wrong_coefficient(n) for n in self.coefficients}}
        out = []
        for i in range(left.c.shape[1]):
            flown = [*_nearest(first, i, MOST), *_nearest(wrong, i, COEFFICIENTS)]
            said = {n: (float(logs[n][0, i]), float(logs[n][1, i])) for n in ("nothing", *flown)}
            out.append(Weights(said, {n: named[n] for n in flown}, max(1, len(effects)), k))
        return out

    def stated(self, left: Sequence[Left]) -> list[dict[str, float]]:
        """Return what is stated of each of several residuals: explanation -> probability."""
        return [w.stated for w in self.weighed(Left.beside(left))]

    def drawn(self, numbers: Sequence[int]) -> list[tuple[str, Left]]:
        """Return truths of these numbers, drawn from the priors: name, and the sums of what they leave."""
        return [self._drawn(number) for number in numbers]

    def _drawn(self, number: int) -> tuple[str, Left]:
        rng = np.random.default_rng([SEED, number])
        name, multiples, kappa = self.truth(number, rng)
        pulses = [np.asarray(kappa * rng.standard_normal(c.U.shape[1])) for c in self.parts]
        return name, sum_of(c.drawn(multiples, u, rng) for c, u in zip(self.parts, pulses, strict=True))

    def truth(self, number: int, rng: np.random.Generator) -> tuple[str, FloatArray, float]:
        """Return the truth of a number: name, multiples (K,) of all columns, and size of the unknown motion."""
        turn, place = divmod(number, len(KINDS))
        kind, k = KINDS[place], len(self.coefficients)
        before = turn * KINDS.count(kind) + KINDS[:place].count(kind)  # of its kind
        multiples = np.zeros(2 * k + len(self.points))
        multiples[:k] = self.base.prior_std * np.clip(rng.standard_normal(k), -CUT, CUT)
        kappa = float(rng.choice(_PART if kind == "unknown" else _WHOLE))
        if kind == "coefficient":
            multiples[before % k] *= WIDE
            return self.coefficients[before % k], multiples, kappa
        imitated = kind == "unknown" and before % 2 == 1
        if kind == "nothing" or (kind == "unknown" and not imitated) or not self._truths:
            return "nothing" if kind == "effect" else kind, multiples, kappa
        effect, point = self._truths[(before // 2 if imitated else before) % len(self._truths)]
        multiples[k + point] = 1.0
        return kind if imitated else effect, multiples, kappa

    @cached_property
    def _truths(self) -> list[tuple[str, int]]:
        """Return effects and the places of their sizes that were drawn: each effect in turn, in an order of chance."""
        places: dict[str, list[int]] = {}
        for i, (effect, _) in enumerate(self.points[self.usual :], self.usual):
            if effect.name in self.effects:
                places.setdefault(effect.name, []).append(i)
        names = list(places)
        order = np.random.default_rng(SEED).permutation(len(names))
        return [(names[i], places[names[i]][turn % len(places[names[i]])]) for turn in range(SIZES) for i in order]

    @cached_property
    def few(self) -> Foreseen:
        """The same with the first usual size of each effect alone."""
        k, names = len(self.coefficients), [e.name for e, _ in self.points]
        first = [names.index(n) for n in dict.fromkeys(names)]
        last = range(k + len(names), 2 * k + len(names))
        at = [*range(k), *(k + i for i in first), *last]
        points = tuple(self.points[i] for i in first)
        return replace(self, points=points, usual=len(points), parts=tuple(c.some(at) for c in self.parts))

    def at_usual_size(self, sums: Sums) -> dict[str, float]:
        """Return effect -> probability that it would be given if it were there at its one size here.

        Args:
            sums: of all records that would be flown; the columns are those here.

        Without noise, coefficients as they are believed: ln p is then what it is on average, to first order.
        """
        k = len(self.coefficients)
        seen = sums.squares[0, k:-k] > INVISIBLE
        shown = [(k + i, e) for i, (e, _) in enumerate(self.points) if seen[i]]
        said = self.weighed(sums.left_by([i for i, _ in shown]), sums, {e.name: e for _, e in shown}) if shown else []
        return {e.name: w[e.name] for (_, e), w in zip(shown, said, strict=True)}


def _changes(base: Hypothesis, points: Sequence[Point]) -> list[FloatArray | None]:
    """Return what effects change in the residuals (samples,); None for those that cannot fly or are not sought."""
    sought = [i for i, (effect, _) in enumerate(points) if base.lateral or not effect.lateral]
    found = dict(zip(sought, changes(base, [points[i] for i in sought]), strict=True))
    return [c if (c := found.get(i)) is not None and np.all(np.isfinite(c)) else None for i in range(len(points))]


def _nearest(logs: Mapping[str, FloatArray], i: int, most: int) -> list[str]:
    """Return the names of the largest of ln p (r,) of one residual."""
    return sorted(logs, key=lambda n: -logs[n][i])[:most]


def _multiple(effect: Effect, x: FloatArray) -> float:
    """Return the prior deviation of a multiple of what an effect changes at values (p,)."""
    sizes = [(q, v) for q, v in zip(effect.parameters, x, strict=True) if q.none is not None]
    if len(sizes) != 1:
        return SIZE
    (q, v), none = sizes[0], sizes[0][0].none or 0.0
    return SIZE * max(abs(s - none) for s in q.starts) / max(abs(float(v) - none), 1e-9)
