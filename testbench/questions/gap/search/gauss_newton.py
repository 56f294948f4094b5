"""Bring coefficients, and the parameters of an effect beside them, to rest: fit on linear differences, fly, repeat."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import OptimizeResult, least_squares
from scipy.stats import chi2, norm

from testbench.core.record import FloatArray
from testbench.effects import Effect
from testbench.questions.gap.search.hypothesis import Hypothesis, Signature

FRESH_TANGENTS = (2, 5)  # rounds before which tangents of the nuisances are taken anew, at the point reached
MAX_ROUNDS = 14  # rounds of fitting on linear differences and flying the result
AT_REST = 0.1  # the rounds end when another one promises to lower chi-square by less, far below any threshold
AT_REST_SHARE = 1e-3  # the rounds also end when it promises less than this share of what is left above the noise
KEPT = 0.9  # share of a promised gain that a step must reach for its tangents to be kept
SHORTENED = (1.0, 0.5, 0.2)  # shares of a step that are tried in turn until one flies and lowers chi-square
OFF_BOUND = 0.1  # share of its start by which a parameter is moved off a bound before a round: at it there is no slope
DIFFERENCE = 1e-3  # step of differences, of a parameter's start
IDLE = 3  # the rounds also end when so many in turn have found nothing better


@dataclass(frozen=True, eq=False)
class Descent:
    """Where a descent came to rest: parameters, nuisances, Jacobian (rows, p) and the sum of squares with priors.

    ``within`` is the probability of :func:`within_priors` there. ``settled`` is False if the descent was given up.
    """

    x: FloatArray
    nuisances: Mapping[str, float]
    jacobian: FloatArray
    chi2: float
    flown: bool
    within: float
    settled: bool = True


def descend(
    signature: Signature,
    start: FloatArray,
    hopeless: float,
    patience: int = 0,
    near: bool = False,
    at_first: float = np.inf,
) -> Descent | None:
    """Descend from one start: fit on the linear differences, fly the result, repeat until it rests.

    Residuals near a point x0 that was flown: exact(x0) + change(x) - change(x0) + tangents (nuisances - nuisances0).

    Args:
        signature: what the effect changes, from the point that the descent begins at.
        start: parameters (p,) to begin with.
        hopeless: chi-square that a descent must promise to get below, in this round or in one more like the last.
        patience: rounds before that promise is required.
        near: the start is thought to be near the best fit. The first point flown is then the start itself, if that is
            better than the point without the effect.
        at_first: chi-square that the first round must promise to get below, whatever ``patience`` is.

    Returns None if nothing on the way could be flown.
    """
    effect, here = signature.effect, signature.base
    start = _flyable(signature, start)
    low, high = effect.bounds
    scale = np.maximum(np.abs(start), 1e-3 * (high - low))
    off = OFF_BOUND * np.minimum(scale, 0.1 * (high - low))
    known = np.zeros_like(here.exact)  # the change at the point flown last; the first one is the base itself
    curved = effect.flown and signature.model(start).aircraft.amendments != here.model.aircraft.amendments
    best: Descent | None = None
    x, chi2_here, idle, begun, promised = start, np.inf, 0, False, np.inf
    if near:
        there, change = here.moved(signature.model(start), here.nuisances), signature.at(start)
        if there is not None and change is not None and there.chi2 < here.chi2:
            here, known, begun = there, change, True
    for k in range(MAX_ROUNDS):
        aim = hopeless if k >= patience else at_first if k == 0 else np.inf
        begun = begun or k > 0  # the point flown last has the effect
        if curved and begun:  # what such an effect changes depends on the coefficients, and they on it
            signature, known, here = _rebased(signature, known, here)
        elif k in FRESH_TANGENTS:
            here = here.afresh(False)
        objective = _Objective(signature, here, known, low - scale, scale)
        inside = np.clip(x, low + off, high - off)
        found = least_squares(
            objective,
            objective.scaled(inside),
            bounds=(objective.scaled(low), objective.scaled(high)),
            diff_step=DIFFERENCE,
            ftol=1e-5,
            xtol=1e-4,
            max_nfev=4 if curved and begun else 8,
            callback=_GiveUp(aim),
            workers=objective.at_all,
        )
        fallen, promised = promised - 2.0 * float(found.cost), 2.0 * float(found.cost)
        x_new = np.clip(objective.unscaled(found.x), low, high)
        change, jacobian = signature.at(x_new), found.jac / scale
        if change is None:
            break
        asked = here.tuned(here.exact + change - known)[1]
        nuisances = here.towards(asked)
        if promised > aim and (k == 0 or fallen < promised - aim):
            if best is not None:
                return replace(best, settled=False)
            within = within_priors(replace(here, nuisances=nuisances))
            return Descent(x_new, here.named(nuisances), jacobian, promised, False, within, False)
        within_reach, wanted = np.allclose(nuisances, asked), x_new
        if not within_reach:  # coefficients go so far in one round only: the effect goes along with them
            share = float(np.linalg.norm(nuisances - here.nuisances) / np.linalg.norm(asked - here.nuisances))
            origin = x if begun else _none(effect, start)
            x_new = origin + share * (x_new - origin)
        step = _shortened(signature, here, x if begun else None, x_new, nuisances)
        if not within_reach:
            step = _lower(step, signature, here, wanted)
        if step is None:
            break
        before, moved, x, whole = chi2_here, *step
        whole = whole and within_reach
        after = change if whole else signature.at(x)
        if after is None:
            break
        known = after
        chi2_here = moved.chi2 + float(np.sum(effect.prior_residuals(x) ** 2))
        broken = not whole or _broken(before, promised, chi2_here)
        here = moved.afresh(False) if broken and not curved else moved  # linear predictions have failed: tangents anew
        rest = max(AT_REST, AT_REST_SHARE * (chi2_here - here.samples))
        idle = idle + 1 if best is not None and chi2_here > best.chi2 - rest else 0
        if best is None or chi2_here < best.chi2:
            best = Descent(x, here.by_name, jacobian, chi2_here, True, within_priors(here))
        if idle == IDLE or (whole and (before - promised < rest or abs(chi2_here - promised) < rest)):
            break
    return best


def _none(effect: Effect, x: FloatArray) -> FloatArray:
    """Return parameters ``x`` (p,), each at its value without effect if it has one."""
    return np.array([v if p.none is None else p.none for v, p in zip(x, effect.parameters, strict=True)])


def _flyable(signature: Signature, start: FloatArray) -> FloatArray:
    """Return the largest share of a start (p,), counted from no effect, that can be flown; all of it if none can."""
    none = _none(signature.effect, start)
    shares = (none + share * (start - none) for share in SHORTENED)
    return next((x for x in shares if signature.at(x) is not None), start)


def _rebased(signature: Signature, known: FloatArray, here: Hypothesis) -> tuple[Signature, FloatArray, Hypothesis]:
    """Return the signature at the coefficients of ``here``, the change there, and the point with tangents of its own.

    All of it is flown: linear predictions are taken about trim and see neither the memory of a feedback nor curvature.
    """
    here = here.afresh(True)
    origin = signature.base.moved(signature.base.model, here.nuisances)
    if origin is None:
        return signature, known, here
    return Signature(origin, signature.effect), here.exact - origin.exact, here


class _GiveUp:
    """Ends a fit on linear differences that three more steps like its last one would not save."""

    def __init__(self, hopeless: float) -> None:
        self.hopeless, self.last = hopeless, np.inf

    def __call__(self, intermediate_result: OptimizeResult) -> None:
        now = 2.0 * float(intermediate_result.cost)
        if 3.0 * (self.last - now) < now - self.hopeless:
            raise StopIteration
        self.last = now


def _shortened(
    signature: Signature, here: Hypothesis, x: FloatArray | None, x_new: FloatArray, nuisances: FloatArray
) -> tuple[Hypothesis, FloatArray, bool] | None:
    """Fly the step that linear predictions ask for, or the largest share of it that flies and lowers chi-square.

    Args:
        signature: the effect, from the point that the descent began at.
        here: the point flown last.
        x: the effect's parameters there, None if it was flown without the effect.
        x_new: those asked for.
        nuisances: those asked for, (k,).

    Returns the point, its parameters, and whether it is the whole step; None if nothing of it can be flown. If no share
    lowers chi-square, the whole step is taken, provided that it flies: later rounds may still lower it.
    """
    effect, whole = signature.effect, None
    aim = here.chi2 + (0.0 if x is None else float(np.sum(effect.prior_residuals(x) ** 2)))
    for share in SHORTENED:
        x_there = x_new if x is None else x + share * (x_new - x)
        moved = here.moved(signature.model(x_there), here.nuisances + share * (nuisances - here.nuisances))
        if moved is not None and moved.chi2 + float(np.sum(effect.prior_residuals(x_there) ** 2)) < aim:
            return moved, x_there, share == 1.0
        if moved is not None and share == 1.0:
            whole = moved
    return None if whole is None else (whole, x_new, True)


def _lower(
    step: tuple[Hypothesis, FloatArray, bool] | None, signature: Signature, here: Hypothesis, wanted: FloatArray
) -> tuple[Hypothesis, FloatArray, bool] | None:
    """Return ``step``, or the whole effect with the coefficients left where they are, if chi-square is lower there.

    Coefficients that lie far off may stand in for an effect that has hardly begun.
    """
    whole = here.moved(signature.model(wanted), here.nuisances)
    if whole is None:
        return step

    def cost(point: Hypothesis, x: FloatArray) -> float:
        return point.chi2 + float(np.sum(signature.effect.prior_residuals(x) ** 2))

    return step if step is not None and cost(*step[:2]) <= cost(whole, wanted) else (whole, wanted, True)


@dataclass(frozen=True, eq=False)
class _Objective:
    """Weighted residuals at parameter values, nuisances re-tuned, followed by those of the priors.

    It takes scaled values z = (x - origin) / scale, which are 1 or more: relative steps do not vanish near a bound.
    """

    signature: Signature
    here: Hypothesis
    known: FloatArray
    origin: FloatArray
    scale: FloatArray

    def scaled(self, x: FloatArray) -> FloatArray:
        return (x - self.origin) / self.scale

    def unscaled(self, z: FloatArray) -> FloatArray:
        return self.origin + self.scale * z

    def __call__(self, z: FloatArray) -> FloatArray:
        x = self.unscaled(z)
        change = self.signature.at(x)
        left = self.here.lost if change is None else self.here.tuned(self.here.exact + change - self.known)[0]
        return np.concatenate([left, self.signature.effect.prior_residuals(x)])

    def at_all(self, function: Callable[[FloatArray], FloatArray], points: Iterable[FloatArray]) -> list[FloatArray]:
        """Return ``function``, which is this one in scipy's wrapping, at points whose changes are made together."""
        some = list(points)
        self.signature.at_all([self.unscaled(z) for z in some])
        return [function(z) for z in some]


def retune(base: Hypothesis) -> Hypothesis:
    """Re-tune the nuisances of the model of ``base`` until they rest; return the best point.

    It uses tangents of linear predictions first and flown ones then. Tangents of a linearisation about trim may rest a
    few units of chi-square too high, which a false effect would gain.
    """
    here = _rest(base)
    return _rest(here.afresh(True), flown=True)


def _rest(here: Hypothesis, flown: bool = False) -> Hypothesis:
    """Take steps until they rest; where tangents have failed, take them anew, ``flown`` or from linear predictions."""
    for _ in range(MAX_ROUNDS):
        left, nuisances = here.tuned(here.exact)
        if here.chi2 - float(left @ left) < AT_REST:
            break
        there = None
        for share in SHORTENED:
            moved = here.moved(here.model, here.nuisances + share * (here.towards(nuisances) - here.nuisances))
            if moved is not None and moved.chi2 < here.chi2:
                kept = share == 1.0 and not _broken(here.chi2, float(left @ left), moved.chi2)
                there = moved if kept else moved.afresh(flown)
                break
        if there is None:
            break
        here = there
    return here


def _broken(before: float, promised: float, flown: float) -> bool:
    """Return whether a step gained so much less than linear predictions promised that new tangents are needed.

    Its arguments are chi-square before the step (infinite if not known, as for the first step), as promised, and as
    flown. With old tangents, re-tuning may swing about the best point for all its rounds.
    """
    return before - flown < KEPT * (before - promised)


def within_priors(point: Hypothesis) -> float:
    """Return the probability that nuisances drawn from their priors lie as far from the believed values as here.

    Two tests are made, of all of them together (chi-square) and of the farthest one alone; Bonferroni's bound covers
    both.
    """
    z = point.deviations
    one = 2.0 * z.size * float(norm.sf(np.max(np.abs(z))))
    return min(2.0 * min(float(chi2.sf(z @ z, z.size)), one), 1.0)
