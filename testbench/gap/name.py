"""Name the missing effect: fit every effect of the library, compare likelihoods, decide with stated error rates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import product

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2

from testbench.errors import FlightAborted, LimitError, TrimError
from testbench.gap.believed import NUISANCES, Believed, tuning
from testbench.gap.effects import EFFECTS, Effect
from testbench.gap.local import Local
from testbench.record import FlightRecord, FloatArray

FALSE_ALARM = 1e-3  # probability of naming any effect where there is none, all effects of the library together
ENOUGH = 0.90  # share of the excess that a named effect must explain, unless what is left is noise
MAX_ROUNDS = 10  # rounds of fitting on linear differences and flying the result
AT_REST = 0.1  # the rounds end when another one promises to lower chi-square by no more: far below any threshold
HOPELESS = 0.5  # a fit that gains less than this share of the best one's gain is not followed to its end
STARTS = 2  # the most promising starts of each effect are fitted
TOO_CLOSE = 0.85  # a runner-up with this share of the best gain cannot be told apart


@dataclass(frozen=True, eq=False)
class EffectFit:
    """One effect fitted to the naming records.

    Attributes:
        effect: the effect.
        values: parameter -> estimate.
        errors: parameter -> standard error.
        chi2: weighted sum of squares left, nuisances re-tuned (prior included).
        gain: fall of chi2 against the believed model with its nuisances re-tuned; 0 if it found nothing better.
        threshold: gain that noise alone exceeds with probability FALSE_ALARM / size of the library.
        share: share of the excess over the noise that it explains, 0 to 1; NaN if the excess itself is no more than
            four standard deviations of the noise's chi-square.
        tuning: nuisance -> re-tuned factor.
    """

    effect: Effect
    values: Mapping[str, float]
    errors: Mapping[str, float]
    chi2: float
    gain: float
    threshold: float
    share: float
    tuning: Mapping[str, float]

    @property
    def significant(self) -> bool:
        """True if noise would hardly ever gain as much."""
        return self.gain > self.threshold

    @property
    def size(self) -> str:
        """Parameters with their standard errors, in words."""
        units = {p.name: p.unit for p in self.effect.parameters}
        return ", ".join(
            f"{n} = {v:.4g} ± {self.errors[n]:.2g}" + (f" {units[n]}" if units[n] != "1" else "")
            for n, v in self.values.items()
        )


@dataclass(frozen=True, eq=False)
class Naming:
    """The outcome of naming.

    Attributes:
        outcome: "no gap", "named", "set" (cannot be told apart) or "unexplained".
        names: the named effect, or the set, best first; empty otherwise.
        ranking: all effects, best first.
        chi2_believed: weighted sum of squares of the believed model, nothing re-tuned.
        chi2_tuned: the same after re-tuning the nuisances within their priors.
        samples: number of samples in those sums.
        sentence: the outcome in words.
    """

    outcome: str
    names: tuple[str, ...]
    ranking: tuple[EffectFit, ...]
    chi2_believed: float
    chi2_tuned: float
    samples: int
    sentence: str
    rejected: Mapping[str, str] = field(default_factory=dict)

    @property
    def best(self) -> EffectFit | None:
        """The effect that is added, if any."""
        return next((f for f in self.ranking if self.names and f.effect.name == self.names[0]), None)


def name_effect(
    believed: Believed, records: Sequence[FlightRecord], progress: Callable[[str], None] | None = None
) -> Naming:
    """Fit every effect of the library to ``records`` and decide which, if any, the believed model lacks.

    The noise is known from the sensor suite, so that twice the gain in log-likelihood is chi-square distributed with as
    many degrees of freedom as the effect has parameters if there is no effect (Wilks 1938); Bonferroni's bound over the
    library makes FALSE_ALARM hold for all of it. This holds in still air: turbulence is not modelled here.

    Raises:
        FlightAborted, TrimError, LimitError: the believed aircraft itself does not survive the measured commands.
    """
    say = progress or (lambda text: None)
    say("re-tune the believed model")
    start = Local.at(believed, believed, tuple(records), np.ones(len(NUISANCES)))
    chi2_believed = float(start.exact @ start.exact)
    tuned = _retune(start)
    samples = int(start.exact.size)
    fits: list[EffectFit] = []
    rejected = {}
    say("screen the library")
    for effect, starts in _screen(tuned):
        say(f"fit {effect.title}")
        if not starts:
            rejected[effect.name] = "no start of this effect flies the measured commands"
            continue
        hopeless = tuned.chi2 - HOPELESS * max((f.gain for f in fits), default=0.0)
        fit = _fit(tuned, effect, starts, hopeless)
        if fit is None:
            rejected[effect.name] = "nothing on the way to its best fit flies the measured commands"
        else:
            fits.append(fit)
    ranking = tuple(sorted(fits, key=lambda f: -f.gain))
    outcome, names, sentence = _decide(ranking, tuned.chi2, samples)
    return Naming(outcome, names, ranking, chi2_believed, tuned.chi2, samples, sentence, rejected)


def _retune(local: Local) -> Local:
    """Re-tune the nuisances of the model of ``local`` until they rest; return the best point."""
    best = local
    for _ in range(MAX_ROUNDS):
        left, factors = local.tuned(local.exact)
        if local.chi2 - float(left @ left) < AT_REST:
            break
        local = Local.at(local.believed, local.model, local.records, local.towards(factors))
        best = min(best, local, key=lambda point: point.chi2)
    return best


def _screen(tuned: Local) -> list[tuple[Effect, list[FloatArray]]]:
    """Return every effect with the starts that can be flown, the most promising effect and start first."""
    screened = []
    for effect in EFFECTS.values():
        starts = [np.array(s) for s in product(*(p.starts for p in effect.parameters))]
        costs = [tuned.cost(effect_model(tuned.believed, effect, x)) for x in starts]
        order = [int(k) for k in np.argsort(costs) if np.isfinite(costs[k])]
        screened.append((min(costs), effect, [starts[k] for k in order]))
    return [(effect, starts) for _, effect, starts in sorted(screened, key=lambda item: item[0])]


def effect_model(believed: Believed, effect: Effect, x: FloatArray) -> Believed:
    """Return the believed model with ``effect`` at the parameter values ``x`` (p,)."""
    return believed.with_effect(effect, dict(zip([p.name for p in effect.parameters], x.tolist(), strict=True)))


def _fit(tuned: Local, effect: Effect, starts: Sequence[FloatArray], hopeless: float) -> EffectFit | None:
    """Fit one effect from its most promising starts; return the best fit, or None if none could be flown.

    A descent is not followed further once even its fit on the linear differences comes no lower than ``hopeless``.
    """
    names = [p.name for p in effect.parameters]
    chi2_tuned, samples = tuned.chi2, tuned.exact.size
    reached: list[_Descent] = []
    for start in starts[:STARTS]:
        descent = _descend(tuned, effect, start, hopeless)
        if descent is not None:
            reached.append(descent)
    if not reached:
        return None
    best = min(reached, key=lambda f: f.chi2)
    information = best.jacobian.T @ best.jacobian
    errors = np.sqrt(np.maximum(np.diag(np.linalg.pinv(information)), 0.0) * max(best.chi2 / samples, 1.0))
    excess = chi2_tuned - samples
    share = (chi2_tuned - best.chi2) / excess if excess > 4.0 * np.sqrt(2.0 * samples) else float("nan")
    return EffectFit(
        effect=effect,
        values=dict(zip(names, best.x.tolist(), strict=True)),
        errors=dict(zip(names, errors.tolist(), strict=True)),
        chi2=best.chi2,
        gain=max(chi2_tuned - best.chi2, 0.0),
        threshold=float(chi2.isf(FALSE_ALARM / len(EFFECTS), len(names))),
        share=float(np.clip(share, 0.0, 1.0)),
        tuning=tuning(best.point.factors),
    )


@dataclass(frozen=True, eq=False)
class _Descent:
    """Where a descent came to rest: parameters, point, Jacobian (rows, p) and the sum of squares with priors."""

    x: FloatArray
    point: Local
    jacobian: FloatArray
    chi2: float


def _descend(local: Local, effect: Effect, start: FloatArray, hopeless: float) -> _Descent | None:
    """Descend from one start: fit on the linear differences, fly the result, repeat until it rests.

    Returns None if nothing on the way could be flown.
    """
    bounds = ([p.low for p in effect.parameters], [p.high for p in effect.parameters])
    scale = np.abs(start)
    model = partial(effect_model, local.believed, effect)
    best: _Descent | None = None
    x, chi2_here = start, np.inf  # of the point that the round starts from; the first one starts without the effect
    for _ in range(MAX_ROUNDS):
        here = local

        def objective(y: FloatArray, here: Local = here) -> FloatArray:
            """Return the weighted residuals at ``y`` (p,), nuisances re-tuned, followed by those of its priors."""
            residuals = here.residuals(model(y))
            left = here.lost if residuals is None else here.tuned(residuals)[0]
            return np.concatenate([left, effect.prior_residuals(y)])

        found = least_squares(
            objective, x, bounds=bounds, x_scale=scale, diff_step=1e-3, ftol=1e-6, xtol=1e-4, max_nfev=12
        )
        residuals = here.residuals(model(found.x))
        if residuals is None:
            break
        factors = here.tuned(residuals)[1]
        try:
            local = Local.at(here.believed, model(found.x), here.records, here.towards(factors))
        except (FlightAborted, TrimError, LimitError):
            break
        still = chi2_here - 2.0 * float(found.cost) < AT_REST
        chi2_here = local.chi2 + float(np.sum(effect.prior_residuals(found.x) ** 2))
        if best is None or chi2_here < best.chi2:
            best = _Descent(found.x, local, found.jac, chi2_here)
        x = found.x
        if still or 2.0 * found.cost > hopeless:
            break
    return best


def _decide(ranking: Sequence[EffectFit], chi2_tuned: float, samples: int) -> tuple[str, tuple[str, ...], str]:
    """Return outcome, names and sentence."""
    is_noise = chi2.isf(FALSE_ALARM, samples)
    significant = [f for f in ranking if f.significant]
    if not significant:
        if chi2_tuned <= is_noise:
            return "no gap", (), (
                f"no gap: no effect of the library gains more than noise would, and what is left is noise "
                f"(chi-square {chi2_tuned:.0f} over {samples} samples)"
            )  # fmt: skip
        return "unexplained", (), (
            f"unexplained: the residual exceeds the noise (chi-square {chi2_tuned:.0f} over {samples} samples), "
            "but no effect of the library explains any of it"
        )  # fmt: skip
    best = significant[0]
    close = [f for f in significant[1:] if f.gain >= TOO_CLOSE * best.gain]
    if best.share < ENOUGH and best.chi2 > is_noise:
        return "unexplained", (), (
            f"unexplained: {best.effect.title} comes nearest, but explains only {100 * best.share:.0f} % of the excess"
        )  # fmt: skip
    if close:
        names = (best.effect.name, *(f.effect.name for f in close))
        return "set", names, f"these cannot be told apart by these data: {', '.join(names)}"
    explained = "what is left is noise"
    if np.isfinite(best.share):
        explained = f"explains {100 * best.share:.1f} % of the excess over noise"
    return "named", (best.effect.name,), f"{best.effect.title}: {best.size}; {explained}"
