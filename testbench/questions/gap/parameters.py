"""Believed parameters that the records contradict: off, or so far off that they are wrong."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.record import FlightRecord
from testbench.core.words import with_error
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.coefficients import (
    SEPARATES,
    leaves_more_than_noise,
    led_by_surfaces,
    prove_nothing,
    rivals,
)
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.decide import Naming, sum_of_squares
from testbench.questions.gap.linkage import linkage_instead
from testbench.questions.gap.priors import deviations_of
from testbench.questions.gap.search.fit import EffectFit


@dataclass(frozen=True)
class WrongParameter:
    """A believed coefficient that the records contradict: wrong if it is far off, else merely off.

    Attributes:
        name: coefficient, e.g. "Cm_alpha".
        factor: its value over the believed one, as the records alone say it.
        error: standard error of ``factor``.
        prior: relative standard deviation of its prior.
        rivals: fits of effects that explain as much as this coefficient does.
    """

    name: str
    factor: float
    error: float
    prior: float
    rivals: tuple[EffectFit, ...] = ()

    @property
    def sentence(self) -> str:
        """The finding in words: the coefficient, or the set of it and the effects that do the same in these flights."""
        if not self.rivals:
            return self._alone
        others = "; or ".join(f"{f.effect.title}, {f.size}" for f in self.rivals)
        return (
            f"one of these, which these data cannot tell apart: {self._alone}; or {others}. "
            f"What separates them: {SEPARATES}"
        )

    @property
    def _alone(self) -> str:
        return (
            f"the believed {self.name} is {'wrong' if self.deviations > CRITERIA.far else 'off'}: "
            f"{with_error(self.factor, self.error)} times the believed value, off by {self.deviations:.1f} standard "
            f"deviations of its prior ({100.0 * self.prior:.0f} %)"
        )

    @property
    def deviations(self) -> float:
        """How far it is off, in standard deviations of its prior."""
        return abs(self.factor - 1.0) / self.prior


def off_parameters(naming: Naming, aircraft: Aircraft | None = None) -> tuple[WrongParameter, ...]:
    """Return the believed parameters that re-tuning without any effect finds off.

    None is if an effect was named, or where they prove nothing (:func:`.coefficients.prove_nothing`).

    Off by how much is counted in the deviations of the believed aircraft's own priors, if it has some.

    Coefficients re-tuned beside an effect depend on the form of that effect, so they prove nothing.
    """
    if naming.best is not None or prove_nothing(naming):
        return ()
    priors = deviations_of(aircraft)
    found = [WrongParameter(n, factor, error, priors[n]) for n, (factor, error) in naming.measured.items()]
    off = tuple(
        p
        for p in found
        if p.error < p.prior and abs(p.factor - 1.0) > CRITERIA.sure * p.error and p.deviations > CRITERIA.off
    )
    many = sum(p.deviations > CRITERIA.far for p in off) > CRITERIA.at_once
    return () if many and leaves_more_than_noise(naming) else off


def wrong_parameters(
    naming: Naming,
    believed: Believed,
    held_out: Sequence[FlightRecord] = (),
    records: Sequence[FlightRecord] = (),
    known: Container[str] = (),
) -> tuple[WrongParameter, ...]:
    """Return the believed parameters that are so far off that they are wrong.

    Each is told with the effects that explain as much, unless held-out flights refute them, as they refute a name. With
    the ``records`` that named, the linkage of its control is tried among them, which a search may miss, if it is one of
    the ``known`` effects. None is wrong if held-out flights contradict: re-tuning makes the residuals larger there. Nor
    is one that trails an effect which a recorded surface shows: it explains the motion, but not the surface.
    """
    far = [
        p
        for p in off_parameters(naming, believed.aircraft)
        if p.deviations > CRITERIA.far and not led_by_surfaces(p.name, naming, believed.aircraft)
    ]
    re_tuned = np.inf
    if far and held_out:
        re_tuned = sum_of_squares(believed.with_nuisances(naming.nuisances), held_out)
        if not re_tuned < sum_of_squares(believed, held_out):
            return ()

    def refuted(fit: EffectFit) -> bool:
        return bool(held_out) and sum_of_squares(fit.added_to(believed), held_out) - re_tuned > fit.threshold

    def linkage(p: WrongParameter) -> tuple[EffectFit, ...]:
        found = linkage_instead(p.name, naming, believed, records, held_out, re_tuned, known)
        return () if found is None else rivals(p.name, replace(naming, ranking=(found,)), believed.aircraft)

    told = []
    for p in far:
        alike = tuple(f for f in rivals(p.name, naming, believed.aircraft) if not refuted(f))
        told.append(replace(p, rivals=alike or linkage(p)))
    return tuple(told)
