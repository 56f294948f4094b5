"""Screen the effects of the library: what each promises on linear differences, before any is fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from testbench.core.record import FloatArray
from testbench.effects import Effect, Parameter
from testbench.questions.gap.flights import trims
from testbench.questions.gap.search.hypothesis import Hypothesis, Signature
from testbench.questions.gap.search.parallel import spread
from testbench.questions.gap.starts import far_apart, times_of

SMALL = 0.1  # share of its usual start at which an effect is screened if it can only be small
INVISIBLE = 1e-2  # chi-square of what an effect changes at its starts, below which it cannot be seen


@dataclass(frozen=True, eq=False)
class Screened:
    """What an effect promises before it is fitted.

    Attributes:
        effect: the effect.
        signature: what it changes.
        starts: those that can be flown, the most promising first.
        promise: gain of the best start, or of the best multiple of what it changes.
        why: why these records cannot show it, or "".
        alone: the same gain where no nuisance is re-tuned.
        instead: start that is tried where a descent from the best one is given up, or None. It is the usual size, where
            the best multiple of it lies at the end of the range: so far the signature is no multiple of it.
    """

    effect: Effect
    signature: Signature
    starts: tuple[FloatArray, ...]
    promise: float
    why: str
    alone: float = 0.0
    instead: FloatArray | None = None

    @property
    def seen(self) -> bool:
        """True if these records could show it."""
        return not self.why


def screen(base: Hypothesis, effect: Effect, share: float = 1.0, far: bool = False) -> Screened:
    """Compare the signature d of ``effect`` at its starts with the residual r, nuisances re-tuned in both.

    A start promises the larger of |r|^2 - |r + d|^2 and (r'd)^2 / d'd, the gain of the best multiple of d (score test).
    If one parameter is a size that may have either sign, the start is taken at a ``share`` of that size and then moved
    to the best multiple. From a base that is ``far`` from rest both signs are flown, as the flights change so much that
    the signature of one sign is not minus that of the other.
    """
    signature, size = Signature(base, effect), _size(effect)
    why = not_sought(base, effect)
    if why:
        return Screened(effect, signature, (), 0.0, why)
    starts = starts_of(effect)
    if size is not None:
        if not (far and effect.flown):  # the other sign changes the residuals by minus as much
            starts = [s for s in starts if s[size] == effect.parameters[size].starts[0]]
        none = effect.parameters[size].none or 0.0
        for s in starts:
            s[size] = none + share * (s[size] - none)
    r = base.tuned(base.exact)[0]
    flies, alone, found = False, 0.0, list[tuple[float, float, FloatArray, FloatArray | None]]()
    for x, change in zip(starts, signature.at_all(starts), strict=True):
        if change is None:
            continue
        flies = True
        left = base.tuned(base.exact + change)[0]
        d = left - r
        if d @ d <= INVISIBLE:
            continue
        along = float(base.exact @ change)
        alone = max(alone, -2.0 * along - float(change @ change), along**2 / float(change @ change))
        multiple, cost = -float(r @ d) / float(d @ d), float(left @ left)
        scored = multiple**2 * float(d @ d)
        usual = None
        if size is not None:
            most = _multiplied(x, effect, size, multiple)
            usual = x if _at_an_end(most, effect, size) and multiple > 0.0 else None
            x, cost = most, float(r @ r) - scored
        found.append((cost, max(float(r @ r) - cost, scored), x, usual))
    if not found:
        why = "these records cannot show it: their channels, compared about their means, do not change"
        return Screened(effect, signature, (), 0.0, why if flies else "no start of it flies the measured commands")
    found.sort(key=lambda f: f[0])
    best = tuple(f[2] for f in found)
    return Screened(effect, signature, best, max(f[1] for f in found), "", alone, found[0][3])


def not_sought(base: Hypothesis, effect: Effect) -> str:
    """Return why an effect is not sought in these records, or ""."""
    if effect.lateral and not base.lateral:
        return "these records cannot show it: neither aileron nor rudder moves"
    if effect.over_time is not None and not far_apart(times_of(base.records)):
        return "these records cannot show it: none is said to be flown a minute or more after another (flown_at_s)"
    return "" if effect.looks else f"looked for in every record, no {effect.name} stands out of one"


def screen_all(tasks: Sequence[tuple[Hypothesis, Effect]], share: float = 1.0, far: bool = False) -> list[Screened]:
    """Return :func:`screen` of (point, effect) pairs, on all processes that the search may use."""
    for base in {id(base): base for base, _ in tasks}.values():
        base.prepare()
    if share == 1.0:  # trimmed here, so that what other processes fly in batches is known to this one afterwards
        sought = [(base, e) for base, e in tasks if not not_sought(base, e)]
        models = [(Signature(base, e).tuned_model(starts_of(e)[0]), base.records) for base, e in sought]
        trims([there.flyer for model, records in models for there in model.at_each(records)])
    parts = spread([partial(_parts, base, effect, share, far) for base, effect in tasks])
    both = zip(tasks, parts, strict=True)
    return [Screened(e, Signature(b, e, known), *rest) for (b, e), (known, rest) in both]


def _parts(
    base: Hypothesis, effect: Effect, share: float, far: bool
) -> tuple[dict[bytes, FloatArray | None], tuple[tuple[FloatArray, ...], float, str, float, FloatArray | None]]:
    """Return those parts of a :class:`Screened` that the searching process does not have."""
    s = screen(base, effect, share, far)
    return s.signature.known, (s.starts, s.promise, s.why, s.alone, s.instead)


def screen_closely(base: Hypothesis, screened: Sequence[Screened]) -> list[Screened]:
    """Screen each effect flown, at a small size if it has one; return the better of that result and the one given.

    If little more than noise is left, no effect is large. Of an effect that works like coefficients, only the part that
    re-tuning cannot imitate is left: a pitch damper of some thousandths is Cm_q to a few parts in a thousand, a lag of
    the thrust is a drag of three quarters. So small a difference is lost at the usual size, at which the aircraft flies
    another flight, and in the errors of linear predictions.
    """
    seen = [i for i, s in enumerate(screened) if s.seen]
    sized = [i for i in seen if _size(screened[i].effect) is not None]
    others = [i for i in seen if i not in sized and not screened[i].effect.flown]
    out = list(screened)
    for some, share in ((sized, SMALL), (others, 1.0)):
        close = screen_all([(base, replace(screened[i].effect, flown=True)) for i in some], share)
        for i, s in zip(some, close, strict=True):
            if s.promise > out[i].promise:
                out[i] = s
    return out


def flown_best(base: Hypothesis, screened: Screened) -> Screened:
    """Return ``screened`` with the one start of the effect, of either sign, that leaves least when it is flown."""
    starts = starts_of(screened.effect)
    ends = base.moved_all([screened.signature.model(s) for s in starts], [base.nuisances] * len(starts))
    flown = [(there.chi2, k) for k, there in enumerate(ends) if there]
    return replace(screened, starts=(starts[min(flown)[1]],)) if flown else screened


def starts_of(effect: Effect) -> list[FloatArray]:
    """Return every combination of the parameters' starts, each (p,)."""
    return [np.array(s) for s in product(*(p.starts for p in effect.parameters))]


def _size(effect: Effect) -> int | None:
    """Return the parameter that is a size of either sign, if there is exactly one."""
    sizes = [i for i, p in enumerate(effect.parameters) if p.none is not None and p.low < p.none < p.high]
    return sizes[0] if len(sizes) == 1 else None


def _multiplied(x: FloatArray, effect: Effect, size: int, multiple: float) -> FloatArray:
    """Return the start with a multiple of its size, not quite zero and not beyond its bounds."""
    p, out = effect.parameters[size], x.copy()
    none = p.none or 0.0
    step = math.copysign(float(np.clip(abs(multiple), 0.02, 5.0)), multiple)
    out[size] = np.clip(none + step * (x[size] - none), *ends_of(p))
    return out


def ends_of(p: Parameter) -> tuple[float, float]:
    """Return the smallest and the largest value of a size that a fit starts from."""
    none = p.none or 0.0
    return 0.98 * p.low + 0.02 * none, 0.98 * p.high + 0.02 * none


def _at_an_end(x: FloatArray, effect: Effect, size: int) -> bool:
    return bool(x[size] in ends_of(effect.parameters[size]))


def promising(screened: Sequence[Screened], followed: float, followed_far: float, at_least: int) -> list[Screened]:
    """Return those worth a fit, the most promising first.

    These are the first ``at_least``, and all that promise more than a share ``followed`` of what the best one promises.
    The share is ``followed_far`` for effects with several parameters, of which screening tries few combinations.
    """
    order = sorted((s for s in screened if s.seen), key=lambda s: -s.promise)
    return [
        s
        for i, s in enumerate(order)
        if i < at_least or s.promise > (followed if len(s.effect.parameters) == 1 else followed_far) * order[0].promise
    ]
