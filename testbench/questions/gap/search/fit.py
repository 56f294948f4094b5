"""Fit one effect from its most promising starts: estimates, errors, gain and the threshold that noise would reach."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from testbench.core.record import FloatArray
from testbench.core.words import with_error
from testbench.effects import Effect
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.search.gauss_newton import Descent, descend, within_priors
from testbench.questions.gap.search.hypothesis import Hypothesis
from testbench.questions.gap.search.screening import Screened

HOPELESS = 0.7  # a fit that gains less than this share of the best gain is not followed to its end
HOPELESS_BESIDE_NOISE = 0.9  # the same if the best fit leaves only noise
HOPELESS_AT_FIRST = 0.5  # share of the best gain that a fit must then promise before its first flight
STARTS = 2  # number of starts that are fitted for an effect with several parameters; with one parameter, only the best


@dataclass(frozen=True, eq=False)
class EffectFit:
    """One effect fitted to the naming records.

    Attributes:
        effect: the effect.
        values: parameter -> estimate.
        errors: parameter -> standard error.
        chi2: weighted sum of squares left, nuisances re-tuned (prior included).
        gain: fall of chi2 against the believed model with its nuisances re-tuned; 0 if it found nothing better.
        threshold: gain that noise alone exceeds with probability FALSE_ALARM / number of effects that could be seen.
        share: share of the excess over the noise that it explains, 0 to 1; NaN if the excess itself is no more than
            four standard deviations of the noise's chi-square.
        nuisances: nuisance -> value, re-tuned beside the effect.
        flown: False if the fit was given up as hopeless on linear predictions, without a flight.
        within: probability that nuisances drawn from their priors lie as far from the believed values as ``nuisances``.
        settled: False if it was given up, flown or not, before it came to rest.
        scatter_s: standard deviation of a delay from command to command, see :mod:`.scatter`. If it is not 0, ``chi2``
            is -2 ln of the likelihood, but for the constant that noise alone has.
        told: part of ``gain`` that recorded surfaces tell, see :mod:`.surface_evidence`.
        work: fall of chi-square that it makes beside its own coefficients: more than ``gain`` where other coefficients,
            far from their priors, could do what it does. 0 where that was not asked for.
    """

    effect: Effect
    values: Mapping[str, float]
    errors: Mapping[str, float]
    chi2: float
    gain: float
    threshold: float
    share: float
    nuisances: Mapping[str, float]
    flown: bool = True
    within: float = 1.0
    settled: bool = True
    scatter_s: float = 0.0
    told: float = 0.0
    work: float = 0.0

    def brought_to(self, x: FloatArray, point: Hypothesis, left: float, chi2_tuned: float) -> EffectFit:
        """Return the fit at parameters ``x`` (p,) and the coefficients of a point flown with them; its errors stay.

        ``left`` is the weighted sum of squares there, ``chi2_tuned`` that without any effect, nuisances re-tuned.
        """
        return replace(
            self,
            values=dict(zip(self.values, x.tolist(), strict=True)),
            chi2=left,
            gain=max(chi2_tuned - left, 0.0),
            share=share_of_excess(chi2_tuned, left, point.samples),
            nuisances=point.by_name,
            within=within_priors(point),
        )

    def added_to(self, believed: Believed) -> Believed:
        """Return ``believed`` re-tuned and with the effect, as they were fitted."""
        return believed.with_nuisances(self.nuisances).with_effect(self.effect, self.values)

    @property
    def significant(self) -> bool:
        """True if noise would hardly ever gain as much."""
        return self.gain > self.threshold

    @property
    def in_motion(self) -> float:
        """Part of its gain that the motion tells."""
        return self.gain - self.told

    @property
    def beyond(self) -> tuple[str, ...]:
        """Sizes that came to rest at the end of what is physically possible: the data ask for more.

        A size is a parameter that has a value without effect. The ends of the other parameters (a damping, a sharpness,
        a share between two forms) are forms of their own.
        """
        return tuple(
            p.name
            for p in self.effect.parameters
            if p.none is not None
            and abs(self.values[p.name] - p.none) > CRITERIA.end_of_range * (p.high - p.low)
            and min(self.values[p.name] - p.low, p.high - self.values[p.name])
            < CRITERIA.end_of_range * (p.high - p.low)
        )

    @property
    def size(self) -> str:
        """Parameters with their standard errors, in words."""
        units = {p.name: p.unit for p in self.effect.parameters}
        said = [
            f"{n} = {with_error(v, self.errors[n])}" + (f" {units[n]}" if units[n] != "1" else "")
            for n, v in self.values.items()
        ]
        if self.scatter_s:
            said.append(f"scattering by {self.scatter_s:.2g} s from command to command (flown: the mean)")
        return ", ".join(said)


def fit(
    screened: Screened,
    chi2_tuned: float,
    best_gain: float,
    tested: int,
    patience: int = 0,
    hopeless_share: float = HOPELESS,
    at_first_share: float | None = None,
    near: bool = False,
) -> EffectFit | None:
    """Fit one of ``tested`` effects from its most promising starts; return the best fit, or None if none flies.

    Args:
        screened: the effect and its starts.
        chi2_tuned: weighted sum of squares without any effect, nuisances re-tuned.
        best_gain: of the fits so far.
        tested: number of effects that are tested.
        patience: rounds before a descent may be given up as hopeless, for a base that is far from rest.
        hopeless_share: a descent ends once it promises to gain no more than this share of ``best_gain``.
        at_first_share: share of ``best_gain`` that the first round must promise; only the best start is fitted then.
        near: the starts are thought to be near the best fit, see :func:`.gauss_newton.descend`.
    """
    effect = screened.effect
    hopeless = chi2_tuned - hopeless_share * best_gain
    at_first = np.inf if at_first_share is None else chi2_tuned - at_first_share * best_gain
    several = len(effect.parameters) > 1 and at_first_share is None
    reached: list[Descent] = []

    def starts() -> Iterator[FloatArray]:
        yield from screened.starts[: STARTS if several else 1]
        if screened.instead is not None and not any(d.settled for d in reached):
            yield screened.instead

    for start in starts():
        descent = descend(screened.signature, start, hopeless, patience, near, at_first)
        if descent is not None:
            reached.append(descent)
            hopeless = min(hopeless, chi2_tuned - hopeless_share * (chi2_tuned - descent.chi2))
    if not reached:
        return None
    return summarise(effect, min(reached, key=lambda f: f.chi2), chi2_tuned, tested, screened.signature.base)


def fitted(
    effect: Effect, values: Mapping[str, float], errors: Mapping[str, float], point: Hypothesis, chi2_tuned: float
) -> EffectFit:
    """Return an effect at ``values``, with coefficients re-tuned beside it at ``point``, as a fit of one effect."""
    return EffectFit(
        effect=effect,
        values=values,
        errors=errors,
        chi2=point.chi2,
        gain=max(chi2_tuned - point.chi2, 0.0),
        threshold=float(chi2.isf(CRITERIA.false_alarm / effect.looks, len(values))),
        share=share_of_excess(chi2_tuned, point.chi2, point.samples),
        nuisances=point.by_name,
        within=within_priors(point),
    )


def summarise(effect: Effect, best: Descent, chi2_tuned: float, tested: int, base: Hypothesis) -> EffectFit:
    """Return the fit that a descent from ``base`` of one of ``tested`` effects ended in."""
    names = [p.name for p in effect.parameters]
    samples = best.jacobian.shape[0] - (base.exact.size - base.samples)
    information = best.jacobian.T @ best.jacobian
    errors = np.sqrt(np.maximum(np.diag(np.linalg.pinv(information)), 0.0) * max(best.chi2 / samples, 1.0))
    return EffectFit(
        effect=effect,
        values=dict(zip(names, best.x.tolist(), strict=True)),
        errors=dict(zip(names, errors.tolist(), strict=True)),
        chi2=best.chi2,
        gain=max(chi2_tuned - best.chi2, 0.0),
        threshold=float(chi2.isf(CRITERIA.false_alarm / (tested * effect.looks), len(names))),
        share=share_of_excess(chi2_tuned, best.chi2, samples),
        nuisances=best.nuisances,
        flown=best.flown,
        within=best.within,
        settled=best.settled,
    )


def share_of_excess(chi2_tuned: float, left: float, samples: int) -> float:
    """Return the share, 0 to 1, of the excess of ``chi2_tuned`` over the noise that is gone if ``left`` is left.

    NaN if it exceeds the noise by no more than four standard deviations of the noise's chi-square.
    """
    excess = chi2_tuned - samples
    if not excess > CRITERIA.visible * np.sqrt(2.0 * samples):
        return float("nan")
    return float(np.clip((chi2_tuned - left) / excess, 0.0, 1.0))
