"""What would mend a fit whose residuals are not noise? Every cure is tried on the same records, and compared.

A cure is a hypothesis: a servo that lags, gusts, or both. Its evidence is that of Schwarz,

    ln p(y | cure) ~ ln L - k / 2 ln N,

with k unknowns and N samples (G. Schwarz, Annals of Statistics 6, 1978), against that of the model as it was asked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import lfilter

from testbench.core.advice import doubt
from testbench.core.errors import Refusal
from testbench.core.record import FlightRecord
from testbench.estimators.parametric.likelihood import Likelihood
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.settings import FilterErrorEntry, OutputErrorEntry
from testbench.estimators.structured import Servo
from testbench.inference.causes import ODDS, P_CAUSE, with_causes
from testbench.inference.considered import at_rest
from testbench.inference.form import BY_INPUT

COLOUR = "coloured noise of the sensors"  # what is said of a fit whose errors hold what its residuals are
COLOURED = 1e-3  # probability of white residuals below which a cure is looked for
_ENOUGH = ODDS + math.log((1.0 - P_CAUSE) / P_CAUSE)
_LATE = 3.0  # standard errors of lateness from which it may be that of a servo
_FASTER, _MOMENTS = 3.0, ("L_", "M_", "N_")
_SAME = 0.1  # in ln of the evidence: two maxima that are one
_SAID, _FAR, _NAMED = 0.05, 2.0, 3  # probability of a rival and shift in errors that are said, and of how many values
_POLES, _WHITE = (0.0, 0.3, 0.6, 0.8, 0.9, 0.95, 0.98, 0.99), (0.0, 0.2, 0.4, 0.6, 0.8, 0.9)  # a; m over a
_UNLIKELY = 1e-4  # probability below which no rival is kept


@dataclass(frozen=True)
class Tried:
    """A cure that was tried."""

    name: str  # what it takes into the model, in words
    gain: float  # of ln evidence over the model without it; -inf where it gave no model
    taken: bool = False  # whether it is in the model that is returned


@dataclass(frozen=True, eq=False)
class Rival:
    """A model that explains the same records, and that was not taken."""

    name: str  # what it takes into the model, in words
    probability: float  # that it is right, of all that were tried
    model: ParametricModel  # what was identified with it


def wanting(model: ParametricModel) -> bool:
    """Return whether the residuals of a fit are not noise, or it is wrong by its own advice."""
    white = np.atleast_1d(np.asarray(model.diagnostics.get("whiteness_p", 1.0), float))
    return model.status == "wrong" or bool(np.any(white < COLOURED))


def _late(model: ParametricModel) -> bool:
    """Return whether an input acts later than it is logged, by more than a sample and than its error."""
    found = model.diagnostics
    return any(
        late[name] > max(model.dt_s, _LATE * std[name])
        for late, std in zip(found.get("lateness_s", ()), found.get("lateness_std_s", ()), strict=True)
        for name in late
    )


def evidence(model: ParametricModel, samples: int) -> float:
    """Return ln L of a model, over valid samples of all outputs, less what its unknowns cost."""
    found = model.diagnostics
    own = sum(len(np.atleast_1d(part)) for key in ("offsets", "input_biases") for part in found.get(key, ()))
    own += sum(len(part) for part in found.get("lateness_s", ()))
    unknowns = int(model.structure.free.sum()) + own + len(found.get("process_noise", {}))
    return -float(found["cost"]) - 0.5 * unknowns * math.log(samples)


def _deterministic(entry: Any, model: ParametricModel) -> Iterator[tuple[str, Any]]:
    """Yield what may mend a fit by output error but for gusts: in words, and the settings that hold it.

    A lag and a fast mode of the aircraft may change places: what the model takes for its mode may be the servo, and the
    aircraft behind it much faster. Both are maxima of one likelihood, so a second start has the moments of the model
    ``_FASTER`` and the lag of its mode. The clock of an input may be late beside its servo.
    """
    for name in model.inputs:
        if name not in entry.servo and name not in entry.delays_s:
            behind = {**entry.servo, name: Servo(lag_s="estimate", delay_s=0.0)}
            yield f"a lag behind {name}", (other := entry.model_copy(update={"servo": behind}))
            poles = np.concatenate([np.zeros(0), *(np.ravel(p) for p in model.poles().values())])
            faster = {n: _FASTER * v for n, v in model.values.items() if n[:2] in _MOMENTS and model.standard_errors[n]}
            if poles.size and faster:
                tau = {f"tau_{name.removesuffix('_cmd')}": float(1.0 / np.abs(poles).max())}
                yield f"a lag behind {name}", other.model_copy(update={"start": {**entry.start, **faster, **tau}})


def mended(
    entry: OutputErrorEntry,
    model: ParametricModel,
    records: Sequence[FlightRecord],
    fit: Callable[[Any], ParametricModel],
    gusts: bool | None,
) -> tuple[Any, ParametricModel, tuple[Tried, ...], tuple[Rival, ...]]:
    """Try cures of a fit; return settings and model of the best, what was tried, and what may be right in its place.

    The model has its causes. A lag is tried where the residuals are not noise, where an input acts late, where nobody
    says when it acts (``late_std_s`` of more than a sample), and behind a command without a servo: the fit may look as
    good. Gusts explain whatever moves the aircraft, a wrong model too: they come after what does not depend on chance,
    beside it, and only where kinematics show them or cannot (``gusts`` is None) and what is left does not go with the
    inputs. They are tried of residuals that look white, too: light gusts are slow, and hide in noise of their size.
    """
    samples = sum(int(r.select(model.outputs).valid.sum()) for r in records)
    best: tuple[Any, ParametricModel] = entry, model
    bare = [n for n in model.inputs if n.endswith("_cmd") and n not in {"thr_cmd", *entry.servo, *entry.delays_s}]
    unsaid = any(s > model.dt_s for s in entry.late_std_s.values())
    late, still = wanting(model) or _late(model) or unsaid or bool(bare), gusts is False
    if still and not late:
        return *best, (), ()
    base = evidence(model, samples)
    ways = [_Way("nothing", 0.0, entry, model)]
    for name, other in _deterministic(entry, model) if late else ():
        way = _tried(fit, name, other, base, samples)
        if not any(abs(way.gain - known.gain) < _SAME for known in ways[1:]):
            ways.append(way)
    lags = sorted(ways[1:], key=lambda way: -way.gain)
    taken = lags[0] if lags and lags[0].settled and lags[0].gain > _enough(lags[0].model) else ways[0]
    assert taken.model is not None
    best, base = (taken.entry, taken.model), base + taken.gain
    seen = lags if wanting(model) or _late(model) or taken is not ways[0] else []
    told = best[1] if still or taken is ways[0] else with_causes(best[1], records)
    if still or BY_INPUT & {c["code"] for c in told.diagnostics.get("causes", ())}:
        return *best, _told(seen, taken), _rivals(taken, ways)
    gusty = []
    white = not wanting(best[1])
    before = [taken, *(way for way in lags if way is not taken and way.settled and not white)]
    for way in before:
        assert way.model is not None
        name, given = "gusts" if way is taken else f"gusts and {way.name}", way.entry
        # The settings of filter error that stand for these of output error.
        own = {key: value for key, value in given if key in FilterErrorEntry.model_fields and key != "method"}
        if white:  # what hides in noise shows no finer form
            own |= {"process_noise_model": "gust", "against_none": False}
        other = FilterErrorEntry.model_construct(**{**own, "method": "filter_error"})
        gusty.append(_tried(fit, name, other, base, samples))
    best_gust = gusty[0]
    for more in gusty[1:]:  # what else it takes must be needed beside gusts
        if not best_gust.settled or (more.settled and more.gain - best_gust.gain > _enough(more.model)):
            best_gust = more
    colour = _Way(COLOUR, max(_by_colour(best[1], records, samples), 0.0), *best)  # or white
    tried = [*seen, *gusty, colour]
    if best_gust.model is None or not best_gust.settled or best_gust.gain <= max(colour.gain, _ENOUGH):
        seen = seen if white else tried
        beside = _rivals(colour, [colour, *gusty])
        left = 1.0 - sum(r.probability for r in beside)
        others = (replace(r, probability=left * r.probability) for r in _rivals(taken, ways))
        return *best, _told(seen, taken), (*beside, *others)
    found = next(i for i, way in enumerate(gusty) if way is best_gust)
    # One that gusts could not be fitted to is as likely beside them as it was without: its model stays in doubt.
    more_likely = best_gust.gain - before[found].gain
    gusty = [
        way if way.settled else way._replace(gain=at.gain + more_likely, entry=at.entry, model=at.model)
        for way, at in zip(gusty, before, strict=True)
    ]
    return best_gust.entry, best_gust.model, _told(tried, taken, best_gust), _rivals(best_gust, [colour, *gusty])


class _Way(NamedTuple):
    """A hypothesis: in words, what ln of the evidence gains by it, its settings and its model; None without a fit."""

    name: str
    gain: float
    entry: Any
    model: ParametricModel | None

    @property
    def settled(self) -> bool:
        """Whether its fit has converged."""
        return self.model is not None and bool(self.model.diagnostics.get("converged", True))


def _told(ways: Sequence[_Way], *taken: _Way) -> tuple[Tried, ...]:
    """Return what was tried, and whether it is among what was taken."""
    return tuple(Tried(way.name, way.gain, any(way is one for one in taken)) for way in ways)


def _rivals(taken: _Way, ways: Sequence[_Way]) -> tuple[Rival, ...]:
    """Return what may be right in place of what was taken.

    Of white noise alone, the first way of the deterministic ones, the prior is what cures leave, and the evidence of
    coloured residuals counts less; with their colour or gusts in the hypotheses, these are alike.
    """
    white = ways[0].name != COLOUR
    prior = [1.0 - P_CAUSE if white else P_CAUSE] + [P_CAUSE / max(len(ways) - 1, 1)] * (len(ways) - 1)
    counts = _enough(taken.model) / _ENOUGH if white else 1.0
    ln_p = np.array([math.log(p) + way.gain / counts for p, way in zip(prior, ways, strict=True)])
    share = np.exp(ln_p - ln_p.max())
    share /= share.sum()
    found = [Rival(w.name, float(p), w.model) for w, p in zip(ways, share, strict=True) if w is not taken and w.model]
    return tuple(r for r in found if r.probability > _UNLIKELY)


def mixed(model: ParametricModel, rivals: Sequence[Rival]) -> ParametricModel:
    """Return a model whose covariance is that of the mixture of it and its rivals, about its own values.

        P = sum_i p_i (P_i + (theta_i - theta) (theta_i - theta)')

    over the parameters that all have (J. A. Hoeting and others, Statistical Science 14, 1999, equation 3, of which the
    mean is that of the most probable). Where a likely rival moves a derivative beyond its error, a doubt says so.
    """
    names = model.structure.parameter_names
    own = 1.0 - sum(r.probability for r in rivals)
    covariance, said = own * model.covariance, []
    for rival in rivals:
        theirs = rival.model.structure.parameter_names
        at = [theirs.index(n) if n in theirs else -1 for n in names]
        free = np.array([i >= 0 and model.covariance[k, k] > 0.0 for k, i in enumerate(at)])
        off = np.where(free, rival.model.params[at] - model.params, 0.0)
        both = np.outer(free, free)
        there = np.where(both, rival.model.covariance[np.ix_(at, at)], model.covariance)
        covariance = covariance + rival.probability * (there + np.outer(off, off))
        moved = np.abs(off) / np.sqrt(np.where(free, np.diag(model.covariance), 1.0))
        if rival.probability > _SAID and moved.max() > _FAR:
            worst = [names[i] for i in np.argsort(-moved) if moved[i] > _FAR][:_NAMED]
            values = ", ".join(f"{n} {rival.model.values[n]:.3g}, not {model.values[n]:.3g}" for n in worst)
            said.append(f"with {rival.name} (probability {rival.probability:.2g}) {values}")
    if said:
        text = f"{'; '.join(said)}: these records do not separate them; log the position of the surface"
        model = replace(model, advice=(doubt("rival_model", text), *model.advice))
    return replace(model, covariance=covariance)


def _enough(model: ParametricModel | None) -> float:
    """Return the ln evidence that a cure must gain; of coloured residuals it counts less, as their errors show."""
    inflation = 1.0 if model is None else float(np.max(model.diagnostics.get("error_inflation", 1.0), initial=1.0))
    return _ENOUGH * inflation**2


def _by_colour(model: ParametricModel, records: Sequence[FlightRecord], samples: int) -> float:
    """Return what ln of the evidence gains if the noise of every sensor by itself is coloured: the rival of gusts.

    It is white noise and a process of first order, e_k - a e_(k-1) = w_k - m w_(k-1) with m < a, of two unknowns for
    each output; the parameters move by one step of least squares in that noise. What gusts do to all outputs together,
    through the modes of the aircraft, it does not follow. An airspeed is left out: gusts along the path are its own
    slow noise, whatever moves the rest.
    """
    likelihood = Likelihood.of(model, records)
    whiten = np.linalg.inv(np.linalg.cholesky(model.noise_covariance))
    _, (left, slopes) = at_rest(likelihood, model.params, whiten)
    shape, back = (-1, len(model.outputs)), np.linalg.inv(whiten)
    ends = np.cumsum([s.y.size for s in likelihood.stretches])[:-1]
    parts = [v.reshape(shape) @ back.T for v in np.split(left, ends)]
    moved = [(back @ s.reshape(*shape, slopes.shape[1])) for s in np.split(slopes, ends)]
    moved = [s.reshape(len(v), len(model.outputs), -1) for s, v in zip(moved, parts, strict=True)]
    for o in (i for i, name in enumerate(model.outputs) if name != "V"):
        polynomials = [([1.0, -a], [1.0, -share * a]) for a in _POLES for share in _WHITE]
        found = min(polynomials, key=lambda ba: sum(float(np.sum(lfilter(*ba, v[:, o]) ** 2)) for v in parts))
        for v, s in zip(parts, moved, strict=True):
            v[:, o], s[:, o] = lfilter(*found, v[:, o]), lfilter(*found, s[:, o], axis=0)
    E, J = np.vstack(parts), np.concatenate(moved)
    before = np.linalg.slogdet(model.noise_covariance)[1]
    for _ in range(2):  # the covariance of what is new, then the step in it
        W = np.linalg.inv(np.linalg.cholesky(E.T @ E / len(E)))
        step = np.linalg.lstsq((W @ J).reshape(-1, J.shape[2]), -(E @ W.T).ravel(), rcond=1e-10)[0]
        E = E + J @ step
    after = np.linalg.slogdet(E.T @ E / len(E))[1]
    return float(0.5 * len(E) * (before - after)) - sum(n != "V" for n in model.outputs) * math.log(samples)


def _tried(fit: Callable[[Any], ParametricModel], name: str, entry: Any, base: float, samples: int) -> _Way:
    try:
        model = fit(entry)
    except Refusal:
        return _Way(name, -math.inf, entry, None)
    if model.diagnostics.get("process_noise_model") == "none":  # no gusts in it
        return _Way(name, -math.inf, entry, None)
    return _Way(name, evidence(model, samples) - base, entry, model)
