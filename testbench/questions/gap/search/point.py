"""A model as flown with its nuisances at some values, and what effects change about it.

Bring the coefficients of a model to rest within their priors: step, fly, repeat.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from testbench.core.differences import ends, slope
from testbench.core.errors import LimitError, ModelError, TrimError
from testbench.core.record import FlightAborted, FlightRecord, FloatArray
from testbench.effects import Effect
from testbench.questions.gap.believed import STEPS, Believed
from testbench.questions.gap.evidence.commanded import starts_freely
from testbench.questions.gap.flights import AT_ONCE, Wanted, flights
from testbench.questions.gap.priors import LATERAL_PRIORS

STEP = 0.01  # of forward differences of flights by the nuisances, which are factors
_MAX_STEP = 1.0  # largest change of a nuisance per round, in standard deviations of its prior
SHORTENED = (1.0, 0.5, 0.2)  # shares of a step that are tried in turn until one flies
NOT_FLOWN = (FlightAborted, LimitError, ModelError, TrimError)


@dataclass(frozen=True, eq=False)
class Point:
    """A model with its nuisances at some values, and its residuals as flown."""

    believed: Believed  # the believed model without any effect
    model: Believed  # the hypothesis (believed, or with an effect), nuisances as believed
    records: tuple[FlightRecord, ...]  # the naming records
    priors: Mapping[str, float]  # nuisance -> relative standard deviation of its prior
    nuisances: FloatArray  # (k,) values of the nuisances, multiples of what is believed, in the order of ``priors``
    exact: FloatArray  # (samples,) residuals flown in JSBSim, in units of the noise; 0 where no sample was taken
    # (samples, k) tangents taken over from another point, or None. If they are a little off, a descent takes longer and
    # rests a fraction of the standard errors away; the residuals there are still JSBSim's.
    slopes: FloatArray | None = None
    # where it begins in records that start freely, by their keys (:meth:`.Believed.begun_at`)
    starts: Mapping[str, FloatArray] = field(default_factory=dict)

    @classmethod
    def at(
        cls,
        believed: Believed,
        model: Believed,
        records: tuple[FlightRecord, ...],
        nuisances: FloatArray | None = None,
        priors: Mapping[str, float] | None = None,
    ) -> Point:
        """Fly ``model`` with its nuisances at the values ``nuisances`` (k,), or as believed.

        ``priors``, if not given, are those that the records ask for (:meth:`.Believed.priors_of`).
        """
        priors = believed.priors_of(records) if priors is None else priors
        nuisances = np.ones(len(priors)) if nuisances is None else nuisances
        tuned = model.with_nuisances(dict(zip(priors, nuisances.tolist(), strict=True)))
        fly_together([tuned], records)
        exact = _left(tuned, records)
        return cls(believed, model, records, priors, nuisances, exact, starts=tuned.begun_at(records))

    @classmethod
    def towards_unknown(
        cls, believed: Believed, records: tuple[FlightRecord, ...], nuisances: Mapping[str, float]
    ) -> Point:
        """Fly the believed model at nuisances that fit beside an unknown motion, or as near to them as it can fly.

        There a coefficient that does what is missing may lie where the aircraft cannot be trimmed.
        """
        priors = believed.priors_of(records)
        far = np.array([nuisances[n] for n in priors]) - 1.0
        for share in SHORTENED:
            with suppress(*NOT_FLOWN):
                return cls.at(believed, believed, records, 1.0 + share * far, priors)
        return cls.at(believed, believed, records, None, priors)

    def named(self, nuisances: FloatArray) -> Mapping[str, float]:
        """Return nuisance -> value of values (k,)."""
        return dict(zip(self.priors, nuisances.tolist(), strict=True))

    def vector(self, nuisances: Mapping[str, float]) -> FloatArray:
        """Return the values (k,) of nuisance -> value."""
        return np.array([nuisances[n] for n in self.priors])

    def by_record(self, values: FloatArray) -> list[FloatArray]:
        """Return values (samples, ...) of all records as those of each, (n, outputs, ...)."""
        p = len(self.believed.outputs)
        ends = np.cumsum([len(r) * p for r in self.records])[:-1]
        return [part.reshape(-1, p, *values.shape[1:]) for part in np.split(values, ends)]

    @property
    def by_name(self) -> Mapping[str, float]:
        """Nuisance -> value of the point."""
        return self.named(self.nuisances)

    @cached_property
    def samples(self) -> int:
        """Number of samples in ``exact`` that were taken, less what unknown starts take; the others are zero there."""
        taken = sum(int(np.count_nonzero(self.believed.taken(r))) for r in self.records)
        return taken - round(sum(self.believed.lost(r) for r in self.records))

    @property
    def lateral(self) -> bool:
        """True if lateral coefficients are among the nuisances, because aileron or rudder moves."""
        return not LATERAL_PRIORS.keys().isdisjoint(self.priors)

    @cached_property
    def prior_std(self) -> FloatArray:
        """Relative standard deviations (k,) of the nuisances' priors."""
        return np.array(list(self.priors.values()))

    @property
    def deviations(self) -> FloatArray:
        """How far each nuisance is re-tuned (k,), in standard deviations of its prior."""
        return (self.nuisances - 1.0) / self.prior_std

    @property
    def chi2(self) -> float:
        """Weighted sum of squares of the flown residuals, plus the price of the nuisances."""
        return float(self.exact @ self.exact + self.deviations @ self.deviations)

    @cached_property
    def tangents(self) -> FloatArray:
        """Return d residuals / d nuisances, (samples, k): ``slopes``, or differences of flights.

        If the model cannot fly on one side, the difference to the other side is taken. If it can on neither, the
        tangent is 0 and the nuisance stays where it is.
        """
        if self.slopes is not None:
            return self.slopes

        def flown(points: Sequence[FloatArray]) -> list[FloatArray | None]:
            models = [self.model.with_nuisances(self.named(x)) for x in points]
            return flown_all(self.from_here(models), self.records)

        found = ends(flown, self.nuisances, np.full(self.nuisances.size, STEP))
        columns = [slope(end, STEP, lambda: self.exact) for end in found]
        return np.column_stack([np.zeros_like(self.exact) if c is None else c for c in columns])

    def from_here(self, models: Sequence[Believed]) -> list[Believed]:
        """Return neighbours that begin where this point does: what their starts would change is taken out anyway."""
        return [m.beginning(self.starts, there=True) for m in models]

    @cached_property
    def _normal(self) -> tuple[FloatArray, tuple[FloatArray, bool]]:
        J = np.vstack([self.tangents, np.diag(1.0 / self.prior_std)])
        return J, cho_factor(J.T @ J)

    def tuned(self, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return residuals after re-tuning the nuisances, extended by the price of it, and their new values (k,).

        Minimises |r + J d|^2 + |(nuisances + d - 1) / s|^2 over d: maximum a posteriori with Gaussian priors of
        standard deviation s about the believed values.
        """
        J, factor = self._normal
        r = np.concatenate([residuals, self.deviations])
        d = -np.asarray(cho_solve(factor, J.T @ r))
        return r + J @ d, self.nuisances + d

    def towards(self, nuisances: FloatArray) -> FloatArray:
        """Return ``nuisances``, or as far on the way to them as one round may go."""
        step = nuisances - self.nuisances
        share = min(1.0, _MAX_STEP / max(float(np.max(np.abs(step / self.prior_std), initial=0.0)), 1e-12))
        return self.nuisances + step * share

    def moved(self, model: Believed, nuisances: FloatArray) -> Point | None:
        """Fly another model at other values of the nuisances with the tangents of this point; None if it cannot fly."""
        return self.moved_all([model], [nuisances])[0]

    def moved_all(self, models: Sequence[Believed], nuisances: Sequence[FloatArray]) -> list[Point | None]:
        """Return :meth:`moved` to each of several places, all flown together."""
        tuned = [m.with_nuisances(self.named(x)) for m, x in zip(models, nuisances, strict=True)]
        tuned = [m.beginning(self.starts) for m in tuned]
        out: list[Point | None] = []
        for model, x, there, exact in zip(models, nuisances, tuned, flown_all(tuned, self.records), strict=True):
            if exact is None:
                out.append(None)
                continue
            starts = there.begun_at(self.records)
            point = replace(self, model=model, nuisances=x, exact=exact, slopes=self.tangents, starts=starts)
            point.__dict__["_normal"] = self._normal  # the same tangents have the same normal equations
            out.append(point)
        return out


def changes(base: Point, effects: Sequence[tuple[Effect, FloatArray]]) -> list[FloatArray | None]:
    """Return what effects, each at parameter values (p,), change in the residuals (samples,) of a point.

    All are flown together; None for one that cannot be.
    """
    each = [(e, dict(zip([p.name for p in e.parameters], x.tolist(), strict=True))) for e, x in effects]
    models = [base.model.with_effect(e, values).with_nuisances(base.by_name) for e, values in each]
    flown = flown_all(base.from_here(models), base.records)
    return [None if end is None else end - base.exact for end in flown]


def flown_all(models: Sequence[Believed], records: tuple[FlightRecord, ...]) -> list[FloatArray | None]:
    """Return the residuals (samples,) of each model as flown, all together; None for one that cannot fly."""
    out: list[FloatArray | None] = []
    each = 1 + (STEPS if any(starts_freely(r) for r in records) else 0)
    some = max(1, AT_ONCE // (each * len(records)))
    for k in range(0, len(models), some):
        fly_together(models[k : k + some], records)
        for model in models[k : k + some]:
            try:
                out.append(_left(model, records))
            except NOT_FLOWN:
                out.append(None)
    return out


def fly_together(models: Sequence[Believed], records: Sequence[FlightRecord]) -> None:
    """Fly models through records, so that they are found when they are asked for; free starts from their origins first.

    A model that cannot be flown is left out.
    """
    free = [r for r in records if starts_freely(r)]
    for steps in range(1 + STEPS if free else 0):
        wanted: list[Wanted] = []
        for model, record in product(models, free):
            if model.begins_there:
                continue
            with suppress(*NOT_FLOWN):
                if steps:
                    model.begun(record, steps - 1)  # it was flown a round before
                x, start = model.next_start(record, steps), model.free_start_of(record)
                wanted += [] if x is None else [model.wanted_to_read(record, x)]
                if start is not None and not steps and x is not start.origin:  # both are tried
                    wanted.append(model.wanted_to_read(record, start.origin))
        if not wanted:
            break
        flights(wanted)
    wanted = []
    for model, record in product(models, records):
        with suppress(*NOT_FLOWN):
            wanted.append(model.wanted_to_read(record))
    flights(wanted)


def _left(model: Believed, records: tuple[FlightRecord, ...]) -> FloatArray:
    return np.concatenate([model.residuals(r).ravel() for r in records])


MAX_ROUNDS = 14
AT_REST = 0.1  # the rounds end when another one promises to lower chi-square by less
KEPT = 0.9  # share of a promised gain that a step must reach for its tangents to be kept


def retune(base: Point) -> Point:
    """Re-tune the nuisances of the model of ``base`` until they rest; return the best point.

    Tangents are those of the first point as long as steps gain what they promise; where they rest, they are taken anew.
    """
    here = _rest(base)
    return here if here.slopes is None else _rest(replace(here, slopes=None))


def _rest(here: Point) -> Point:
    """Take steps until they rest; where tangents have failed, take them anew."""
    for _ in range(MAX_ROUNDS):
        left, nuisances = here.tuned(here.exact)
        if here.chi2 - float(left @ left) < AT_REST:
            break
        there = None
        for share in SHORTENED:
            moved = here.moved(here.model, here.nuisances + share * (here.towards(nuisances) - here.nuisances))
            if moved is not None and moved.chi2 < here.chi2:
                # With tangents that promise too much, re-tuning may swing about the best point for all its rounds.
                kept = share == 1.0 and here.chi2 - moved.chi2 >= KEPT * (here.chi2 - float(left @ left))
                there = moved if kept else replace(moved, slopes=None)
                break
        if there is None:
            break
        here = there
    return here
