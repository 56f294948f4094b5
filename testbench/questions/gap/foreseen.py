"""What would be stated of flights that are not flown yet: truths drawn from the priors, to first order.

Effects are flown at usual sizes and at some that are drawn from their priors. A truth leaves in the residuals what one
of these changes, what coefficients change, an unknown motion and noise. All of the library is asked about it as the
first stage of naming asks; of the truth the right size is among those that are weighed, where a search would rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from testbench.core.record import FlightRecord, FloatArray
from testbench.effects import Effect
from testbench.inference.compare import WHOLE
from testbench.inference.first_order import Columns, FirstOrder, Left, Sums, sum_of
from testbench.inference.linear import KAPPAS, fewer
from testbench.questions.gap.again import CUT, SEED, sizes_of
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.explain import Weights, wrong_coefficient
from testbench.questions.gap.name import INVISIBLE, SIZE, WIDE, WIDER, columns_of, starts_of, unknown_motion
from testbench.questions.gap.search.hypothesis import Hypothesis, changes

# Of nine truths: the priors of explain.py, of one error at a time.
KINDS = ("nothing", "effect", "nothing", "coefficient", "nothing", "effect", "unknown", "nothing", "effect")
SIZES = 5  # of each effect that are drawn from its prior and flown
_TRIED = 4  # times that those which cannot be flown are drawn again
_MOST_STARTS = 4
_WHOLE, _PART = (tuple(k for k in KAPPAS if (k <= WHOLE) == whole) for whole in (True, False))
Point = tuple[Effect, FloatArray]
"""An effect and its parameter values (p,)."""


def usual(effects: Sequence[Effect]) -> list[Point]:
    """Return the usual sizes of effects."""
    return [(e, x) for e in effects for x in starts_of(e)[:_MOST_STARTS]]


@dataclass(frozen=True, eq=False)
class Foreseen:
    """Records and what effects change in them about the believed model.

    Attributes:
        base: the believed model in them.
        points: (h,) whose changes the own columns are.
        parts: of each record, the columns of the k coefficients, the h own ones, and again those of the coefficients,
            each of which may be wrong.
    """

    base: Hypothesis
    points: tuple[Point, ...]
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
        points = list(points)
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
        return cls(base, tuple(points), tuple(columns_of(base, columns, directions)))

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
        return np.asarray(np.diag(self.sums.A[0])[k:-k])

    @cached_property
    def sums(self) -> Sums:
        """What the evidence needs of the columns."""
        return sum_of([c.sums for c in self.parts])

    def weighed(
        self, left: Left, sums: Sums | None = None, effects: Mapping[str, Effect] | None = None
    ) -> list[Weights]:
        """Return what is said of residuals, of each apart.

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
        whole = np.array(KAPPAS) <= WHOLE
        logs = {}
        for name in ("nothing", *effects, *self.coefficients):
            ln = found.alone if name == "nothing" else found.logs[:, owners == name].max(axis=1)
            logs[name] = [logsumexp(ln[some], axis=0) - np.log(np.count_nonzero(some)) for some in (whole, ~whole)]
        named = {**effects, **{n: wrong_coefficient(n) for n in self.coefficients}}
        return [
            Weights({n: (float(w[i]), float(p[i])) for n, (w, p) in logs.items()}, named, max(1, len(effects)), k)
            for i in range(left.c.shape[1])
        ]

    def stated(self, residuals: Sequence[FloatArray]) -> list[dict[str, float]]:
        """Return what is stated of residuals, each (samples,): explanation -> probability."""
        ends = np.cumsum([len(c.X) for c in self.parts])[:-1]
        by_record = np.split(np.column_stack(residuals), ends)
        sums = [c.left(r) for c, r in zip(self.parts, by_record, strict=True)]
        return [w.stated for w in self.weighed(sum(sums[1:], sums[0]))]

    def drawn(self, numbers: Sequence[int]) -> list[tuple[str, FloatArray]]:
        """Return truths of these numbers, drawn from the priors: name and residuals (samples,)."""
        return [self._drawn(number) for number in numbers]

    def _drawn(self, number: int) -> tuple[str, FloatArray]:
        turn, place = divmod(number, len(KINDS))
        name = KINDS[place]
        before = turn * KINDS.count(name) + KINDS[:place].count(name)  # of its kind
        rng = np.random.default_rng([SEED, number])
        base, k = self.base, len(self.coefficients)
        multiples = np.zeros(self.parts[0].X.shape[1])
        multiples[:k] = base.prior_std * np.clip(rng.standard_normal(k), -CUT, CUT)
        kappa = float(rng.choice(_PART if name == "unknown" else _WHOLE))
        if name == "coefficient":
            name = self.coefficients[before % k]
            multiples[before % k] *= WIDE
        elif self.effects and (name == "effect" or (name == "unknown" and before % 2)):  # which an effect imitates
            effect, place = self._truths[(before // (2 if name == "unknown" else 1)) % len(self._truths)]
            multiples[k + place] = 1.0
            name = effect if name == "effect" else name
        elif name == "effect":
            name = "nothing"
        out = []
        for record, part in zip(base.records, self.parts, strict=True):
            moved = part.X @ multiples + kappa * part.U @ rng.standard_normal(part.U.shape[1])
            taken = base.believed.taken(record)
            noise = np.where(taken, rng.standard_normal(taken.shape), 0.0)
            if base.believed.whiten is None:  # about the mean, as residuals are
                noise = np.where(taken, noise - noise.sum(axis=0) / np.maximum(taken.sum(axis=0), 1), 0.0)
            out.append(moved + noise.ravel())
        return name, np.concatenate(out)

    @cached_property
    def _truths(self) -> list[tuple[str, int]]:
        """Return effects and the places of their sizes that were drawn: each effect in turn, in an order of chance."""
        places: dict[str, list[int]] = {n: [] for n in self.effects}
        for i, (effect, _) in reversed(list(enumerate(self.points))):  # those that were drawn are the last
            if effect.name in places and len(places[effect.name]) < SIZES:
                places[effect.name].append(i)
        names = list(places)
        order = np.random.default_rng(SEED).permutation(len(names))
        return [(names[i], places[names[i]][turn % len(places[names[i]])]) for turn in range(SIZES) for i in order]


def _changes(base: Hypothesis, points: Sequence[Point]) -> list[FloatArray | None]:
    """Return what effects change in the residuals (samples,); None for those that cannot fly or are not sought."""
    sought = [i for i, (effect, _) in enumerate(points) if base.lateral or not effect.lateral]
    found = dict(zip(sought, changes(base, [points[i] for i in sought]), strict=True))
    return [c if (c := found.get(i)) is not None and np.all(np.isfinite(c)) else None for i in range(len(points))]


def _multiple(effect: Effect, x: FloatArray) -> float:
    """Return the prior deviation of a multiple of what an effect changes at values (p,)."""
    sizes = [(q, v) for q, v in zip(effect.parameters, x, strict=True) if q.none is not None]
    if len(sizes) != 1:
        return SIZE
    (q, v), none = sizes[0], sizes[0][0].none or 0.0
    return SIZE * max(abs(s - none) for s in q.starts) / max(abs(float(v) - none), 1e-9)
