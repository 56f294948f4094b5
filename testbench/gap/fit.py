"""Screen and fit one effect: what it promises on linear differences, and the best that it does in flight."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.optimize import OptimizeResult, least_squares
from scipy.stats import chi2, norm

from testbench.gap.believed import Believed
from testbench.gap.effects import Effect
from testbench.gap.local import Changes, Local
from testbench.record import FloatArray

FALSE_ALARM = 1e-3  # probability of naming any effect where there is none, all effects of the library together
FRESH_TANGENTS = (2, 5)  # before these rounds tangents of the nuisances are taken anew, where the descent has come to
MAX_ROUNDS = 14  # rounds of fitting on linear differences and flying the result
AT_REST = 0.1  # the rounds end when another one promises to lower chi-square by no more: far below any threshold,
AT_REST_SHARE = 1e-3  # or by no more than this share of what is left above the noise
KEPT = 0.9  # share of a promised gain that a step must reach to be content with its tangents
SHORTENED = (1.0, 0.5, 0.2)  # shares of a step that are tried in turn until one flies and lowers chi-square
OFF_BOUND = 0.1  # share of its start by which a parameter is moved off a bound before a round: there it feels no slope
DIFFERENCE = 1e-3  # step of differences, of a parameter's start
IDLE = 3  # the rounds end, too, when so many in turn have found nothing better
HOPELESS = 0.7  # a fit that gains less than this share of the best one's gain is not followed to its end,
HOPELESS_BESIDE_NOISE = 0.9  # or less than this share where the best one leaves noise only
STARTS = 2  # the most promising starts of an effect with several parameters are fitted, of one with one the best
INVISIBLE = 1e-2  # chi-square by which an effect changes the predictions at its starts: less cannot be seen


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
        tuning: nuisance -> re-tuned factor.
        flown: False if the fit was given up as hopeless on linear predictions, without a flight.
        within: probability that nuisances drawn from their priors lie as far from the believed values as ``tuning``.
        settled: False if it was given up, flown or not, before it came to rest.
    """

    effect: Effect
    values: Mapping[str, float]
    errors: Mapping[str, float]
    chi2: float
    gain: float
    threshold: float
    share: float
    tuning: Mapping[str, float]
    flown: bool = True
    within: float = 1.0
    settled: bool = True

    def added_to(self, believed: Believed) -> Believed:
        """Return ``believed`` re-tuned and with the effect, as they were fitted."""
        return believed.with_tuning(self.tuning).with_effect(self.effect, self.values)

    @property
    def significant(self) -> bool:
        """True if noise would hardly ever gain as much."""
        return self.gain > self.threshold

    @property
    def at_bound(self) -> bool:
        """True if a parameter came to rest at a bound: the physical range does not hold what the data ask for."""
        return any(
            min(self.values[p.name] - p.low, p.high - self.values[p.name]) < 1e-3 * (p.high - p.low)
            for p in self.effect.parameters
            if p.none is None or abs(self.values[p.name] - p.none) > 1e-3 * (p.high - p.low)
        )

    @property
    def size(self) -> str:
        """Parameters with their standard errors, in words."""
        units = {p.name: p.unit for p in self.effect.parameters}
        return ", ".join(
            f"{n} = {v:.4g} ± {self.errors[n]:.2g}" + (f" {units[n]}" if units[n] != "1" else "")
            for n, v in self.values.items()
        )


@dataclass(frozen=True, eq=False)
class Screened:
    """What an effect promises before it is fitted.

    Attributes:
        effect: the effect.
        changes: what it changes.
        starts: those that can be flown, the most promising first.
        promise: gain of the best start, or of the best multiple of what it changes.
        why: why these records cannot show it, or "".
    """

    effect: Effect
    changes: Changes
    starts: tuple[FloatArray, ...]
    promise: float
    why: str

    @property
    def seen(self) -> bool:
        """True if these records could show it."""
        return not self.why


def screen(base: Local, effect: Effect, share: float = 1.0) -> Screened:
    """Set what ``effect`` changes at its starts, d, against the residual r, nuisances re-tuned in both.

    A start promises the larger of |r|^2 - |r + d|^2 and (r'd)^2 / d'd, the gain of the best multiple of d (score test).
    Where one parameter is a size that may have either sign, the start is moved to that multiple; such a start is taken
    at a ``share`` of its size.
    """
    changes, size = Changes(base, effect), _size(effect)
    if effect.lateral and not base.lateral:
        return Screened(effect, changes, (), 0.0, "these records cannot show it: neither aileron nor rudder moves")
    if not effect.looks:
        return Screened(effect, changes, (), 0.0, f"looked for in every record, no {effect.name} stands out of one")
    starts = [np.array(s) for s in product(*(p.starts for p in effect.parameters))]
    if size is not None:  # the other sign changes the residuals by minus as much
        starts = [s for s in starts if s[size] == effect.parameters[size].starts[0]]
        none = effect.parameters[size].none or 0.0
        for s in starts:
            s[size] = none + share * (s[size] - none)
    r = base.tuned(base.exact)[0]
    flies, found = False, []
    for x in starts:
        change = changes.at(x)
        if change is None:
            continue
        flies = True
        left = base.tuned(base.exact + change)[0]
        d = left - r
        if d @ d <= INVISIBLE:
            continue
        multiple, cost = -float(r @ d) / float(d @ d), float(left @ left)
        scored = multiple**2 * float(d @ d)
        if size is not None:
            x, cost = _multiplied(x, effect, size, multiple), float(r @ r) - scored
        found.append((cost, max(float(r @ r) - cost, scored), x))
    if not found:
        why = "these records cannot show it: their channels, compared about their means, do not change"
        return Screened(effect, changes, (), 0.0, why if flies else "no start of it flies the measured commands")
    found.sort(key=lambda f: f[0])
    return Screened(effect, changes, tuple(f[2] for f in found), max(f[1] for f in found), "")


def _size(effect: Effect) -> int | None:
    """Return the parameter that is a size of either sign, if there is exactly one."""
    sizes = [i for i, p in enumerate(effect.parameters) if p.none is not None and p.low < p.none < p.high]
    return sizes[0] if len(sizes) == 1 else None


def _multiplied(x: FloatArray, effect: Effect, size: int, multiple: float) -> FloatArray:
    """Return the start with a multiple of its size, not quite zero and not beyond its bounds."""
    p, out = effect.parameters[size], x.copy()
    none = p.none or 0.0
    step = math.copysign(float(np.clip(abs(multiple), 0.02, 5.0)), multiple)
    out[size] = np.clip(none + step * (x[size] - none), 0.98 * p.low + 0.02 * none, 0.98 * p.high + 0.02 * none)
    return out


def fit(
    screened: Screened,
    chi2_tuned: float,
    best_gain: float,
    tested: int,
    patience: int = 0,
    hopeless_share: float = HOPELESS,
) -> EffectFit | None:
    """Fit one of ``tested`` effects from its most promising starts; return the best fit, or None if none flies.

    Args:
        screened: the effect and its starts.
        chi2_tuned: weighted sum of squares without any effect, nuisances re-tuned.
        best_gain: of the fits so far.
        tested: number of effects that are tested.
        patience: rounds before a descent may be given up as hopeless, for a base that is far from rest.
        hopeless_share: a descent ends once it promises to gain no more than this share of ``best_gain``.
    """
    effect = screened.effect
    hopeless = chi2_tuned - hopeless_share * best_gain
    reached: list[Descent] = []
    for start in screened.starts[: STARTS if len(effect.parameters) > 1 else 1]:
        descent = descend(screened.changes, start, hopeless, patience)
        if descent is not None:
            reached.append(descent)
            hopeless = min(hopeless, chi2_tuned - hopeless_share * (chi2_tuned - descent.chi2))
    return summarise(effect, min(reached, key=lambda f: f.chi2), chi2_tuned, tested) if reached else None


@dataclass(frozen=True, eq=False)
class Descent:
    """Where a descent came to rest: parameters, nuisances, Jacobian (rows, p) and the sum of squares with priors.

    ``within`` is the probability of :func:`within_priors` there; ``settled`` is False if it was given up before.
    """

    x: FloatArray
    tuning: Mapping[str, float]
    jacobian: FloatArray
    chi2: float
    flown: bool
    within: float
    settled: bool = True


def descend(
    changes: Changes, start: FloatArray, hopeless: float, patience: int = 0, near: bool = False
) -> Descent | None:
    """Descend from one start: fit on the linear differences, fly the result, repeat until it rests.

    Residuals near a point x0 that was flown: exact(x0) + change(x) - change(x0) + tangents (factors - factors0).

    Args:
        changes: what the effect changes, from the point that the descent begins at.
        start: parameters (p,) to begin with.
        hopeless: chi-square that a descent must promise to get below.
        patience: rounds before that is asked.
        near: the start is thought to be near the best fit: the first point flown is the start itself, if that is better
            than the point without the effect.

    Returns None if nothing on the way could be flown.
    """
    effect, here = changes.effect, changes.base
    low, high = np.array([p.low for p in effect.parameters]), np.array([p.high for p in effect.parameters])
    scale = np.maximum(np.abs(start), 1e-3 * (high - low))
    off = OFF_BOUND * np.minimum(scale, 0.1 * (high - low))
    known = np.zeros_like(here.exact)  # the change at the point flown last; the first one is the base itself
    curved = effect.flown and changes.model(start).aircraft.amendments != here.model.aircraft.amendments
    best: Descent | None = None
    x, chi2_here, idle, begun = start, np.inf, 0, False
    if near:
        there, change = here.moved(changes.model(start), here.factors), changes.at(start)
        if there is not None and change is not None and there.chi2 < here.chi2:
            here, known, begun = there, change, True
    for k in range(MAX_ROUNDS):
        begun = begun or k > 0  # the point flown last has the effect
        if curved and begun:  # what such an effect changes depends on the coefficients, and they on it
            changes, known, here = _rebased(changes, known, here)
        elif k in FRESH_TANGENTS:
            here = here.afresh(False)
        objective = _Objective(changes, here, known, low - scale, scale)
        inside = np.clip(x, low + off, high - off)
        found = least_squares(
            objective,
            objective.scaled(inside),
            bounds=(objective.scaled(low), objective.scaled(high)),
            diff_step=DIFFERENCE,
            ftol=1e-5,
            xtol=1e-4,
            max_nfev=4 if curved and begun else 8,
            callback=_GiveUp(hopeless) if k >= patience else None,
        )
        promised, x_new = 2.0 * float(found.cost), np.clip(objective.unscaled(found.x), low, high)
        change, jacobian = changes.at(x_new), found.jac / scale
        if change is None:
            break
        asked = here.tuned(here.exact + change - known)[1]
        factors = here.towards(asked)
        if promised > hopeless and k >= patience:
            if best is not None:
                return replace(best, settled=False)
            within = within_priors(replace(here, factors=factors))
            return Descent(x_new, here.named(factors), jacobian, promised, False, within, False)
        x_asked = x_new
        if not np.allclose(factors, asked):  # coefficients go so far in one round only: the effect goes along with them
            share = float(np.linalg.norm(factors - here.factors) / np.linalg.norm(asked - here.factors))
            begin = np.array([s if p.none is None else p.none for s, p in zip(start, effect.parameters, strict=True)])
            origin = x if begun else begin
            x_new = origin + share * (x_new - origin)
        step = _shortened(changes, here, x if begun else None, x_new, factors)
        if step is None:
            break
        before, moved, x, whole = chi2_here, *step
        whole = whole and x_new is x_asked
        after = change if whole else changes.at(x)
        if after is None:
            break
        known = after
        chi2_here = moved.chi2 + float(np.sum(effect.prior_residuals(x) ** 2))
        broken = not whole or _broken(before, promised, chi2_here)
        here = moved.afresh(False) if broken and not curved else moved  # linear predictions have failed: tangents anew
        rest = max(AT_REST, AT_REST_SHARE * (chi2_here - here.exact.size))
        idle = idle + 1 if best is not None and chi2_here > best.chi2 - rest else 0
        if best is None or chi2_here < best.chi2:
            best = Descent(x, here.tuning, jacobian, chi2_here, True, within_priors(here))
        if idle == IDLE or (whole and (before - promised < rest or abs(chi2_here - promised) < rest)):
            break
    return best


def _rebased(changes: Changes, known: FloatArray, here: Local) -> tuple[Changes, FloatArray, Local]:
    """Return what the effect changes at the coefficients of ``here``, that change, and the point with own tangents.

    All of it is flown: linear predictions are taken about trim and see neither the memory of a feedback nor curvature.
    """
    here = here.afresh(True)
    origin = changes.base.moved(changes.base.model, here.factors)
    if origin is None:
        return changes, known, here
    return Changes(origin, changes.effect), here.exact - origin.exact, here


class _GiveUp:
    """Ends a fit on linear differences that more than three steps like its last one would not save."""

    def __init__(self, hopeless: float) -> None:
        self.hopeless, self.last = hopeless, np.inf

    def __call__(self, intermediate_result: OptimizeResult) -> None:
        now = 2.0 * float(intermediate_result.cost)
        if 3.0 * (self.last - now) < now - self.hopeless:
            raise StopIteration
        self.last = now


def _shortened(
    changes: Changes, here: Local, x: FloatArray | None, x_new: FloatArray, factors: FloatArray
) -> tuple[Local, FloatArray, bool] | None:
    """Fly the step that linear predictions ask for, or as much of it as flies and lowers chi-square.

    Args:
        changes: the effect, from the point that the descent began at.
        here: the point flown last.
        x: the effect's parameters there, None if it was flown without the effect.
        x_new: those asked for.
        factors: nuisance factors asked for.

    Returns the point, its parameters, and whether it is the whole step; None if nothing of it can be flown. A step that
    cannot be made to lower chi-square is made whole, if it flies: the rounds after it may still.
    """
    effect, whole = changes.effect, None
    aim = here.chi2 + (0.0 if x is None else float(np.sum(effect.prior_residuals(x) ** 2)))
    for share in SHORTENED:
        x_there = x_new if x is None else x + share * (x_new - x)
        moved = here.moved(changes.model(x_there), here.factors + share * (factors - here.factors))
        if moved is not None and moved.chi2 + float(np.sum(effect.prior_residuals(x_there) ** 2)) < aim:
            return moved, x_there, share == 1.0
        if moved is not None and share == 1.0:
            whole = moved
    return None if whole is None else (whole, x_new, True)


@dataclass(frozen=True, eq=False)
class _Objective:
    """Weighted residuals at parameter values, nuisances re-tuned, followed by those of the priors.

    Of scaled values z = (x - origin) / scale, which are 1 or more, so that relative steps do not vanish near a bound.
    """

    changes: Changes
    here: Local
    known: FloatArray
    origin: FloatArray
    scale: FloatArray

    def scaled(self, x: FloatArray) -> FloatArray:
        return (x - self.origin) / self.scale

    def unscaled(self, z: FloatArray) -> FloatArray:
        return self.origin + self.scale * z

    def __call__(self, z: FloatArray) -> FloatArray:
        x = self.unscaled(z)
        change = self.changes.at(x)
        left = self.here.lost if change is None else self.here.tuned(self.here.exact + change - self.known)[0]
        return np.concatenate([left, self.changes.effect.prior_residuals(x)])


def summarise(effect: Effect, best: Descent, chi2_tuned: float, tested: int) -> EffectFit:
    """Return the fit that a descent of one of ``tested`` effects ended in."""
    names = [p.name for p in effect.parameters]
    samples = best.jacobian.shape[0]
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
        threshold=float(chi2.isf(FALSE_ALARM / (tested * effect.looks), len(names))),
        share=float(np.clip(share, 0.0, 1.0)),
        tuning=best.tuning,
        flown=best.flown,
        within=best.within,
        settled=best.settled,
    )


def retune(base: Local) -> Local:
    """Re-tune the nuisances of the model of ``base`` until they rest; return the best point."""
    here = base
    for _ in range(MAX_ROUNDS):
        left, factors = here.tuned(here.exact)
        if here.chi2 - float(left @ left) < AT_REST:
            break
        there = None
        for share in SHORTENED:
            moved = here.moved(here.model, here.factors + share * (here.towards(factors) - here.factors))
            if moved is not None and moved.chi2 < here.chi2:
                kept = share == 1.0 and not _broken(here.chi2, float(left @ left), moved.chi2)
                there = moved if kept else replace(moved, slopes=None)
                break
        if there is None:
            break
        here = there
    return here


def _broken(before: float, promised: float, flown: float) -> bool:
    """Return whether a step gained so much less than linear predictions promised that they need new tangents.

    Chi-square before it (infinite if that is not known, as for the first step), as promised and as flown.
    With those of the beginning re-tuning may swing from one side of the best point to the other for all its rounds.
    """
    return before - flown < KEPT * (before - promised)


def within_priors(point: Local) -> float:
    """Return the probability that nuisances drawn from their priors lie as far from the believed values as here.

    Far are all of them together (chi-square) or one of them alone; Bonferroni's bound holds for both tests.
    """
    z = point.deviations
    one = 2.0 * z.size * float(norm.sf(np.max(np.abs(z))))
    return min(2.0 * min(float(chi2.sf(z @ z, z.size)), one), 1.0)


def promising(screened: Sequence[Screened], followed: float, followed_far: float, at_least: int) -> list[Screened]:
    """Return those worth a fit, the most promising first.

    Followed are the first ``at_least`` and those that promise a share ``followed`` of what the best one promises, or of
    effects with several parameters, of which screening tries a few combinations only, ``followed_far``.
    """
    order = sorted((s for s in screened if s.seen), key=lambda s: -s.promise)
    return [
        s
        for i, s in enumerate(order)
        if i < at_least or s.promise > (followed if len(s.effect.parameters) == 1 else followed_far) * order[0].promise
    ]
