"""What would mend a fit whose residuals are not noise? Every cure is tried on the same records, and compared.

A cure is a hypothesis: a servo that lags, gusts, or both. Its evidence is that of Schwarz,

    ln p(y | cure) ~ ln L - k / 2 ln N,

with k unknowns and N samples (G. Schwarz, Annals of Statistics 6, 1978), against that of the model as it was asked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from testbench.core.errors import Refusal
from testbench.core.record import FlightRecord
from testbench.estimators.causes import with_causes
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.settings import FilterErrorEntry, OutputErrorEntry
from testbench.estimators.structured import Servo
from testbench.inference.form import BY_INPUT

COLOURED = 1e-3
"""Probability of white residuals below which a cure is looked for."""
P_CURE, CLEAR = 0.1, 0.9
"""Prior probability of each cure, and probability from which one is taken."""
_ENOUGH = math.log(CLEAR / (1.0 - CLEAR)) + math.log((1.0 - P_CURE) / P_CURE)
_LATE = 3.0  # standard errors of lateness from which it may be that of a servo


@dataclass(frozen=True)
class Tried:
    """A cure that was tried.

    Attributes:
        name: what it takes into the model, in words.
        gain: of ln evidence over the model without it; -inf where it gave no model.
        taken: whether it is in the model that is returned.
    """

    name: str
    gain: float
    taken: bool = False


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
    """Return ln L of a model less what its unknowns cost.

    Args:
        model: by output error or filter error.
        samples: valid values of all outputs.
    """
    found = model.diagnostics
    own = sum(len(np.atleast_1d(part)) for key in ("offsets", "input_biases") for part in found.get(key, ()))
    own += sum(len(part) for part in found.get("lateness_s", ()))
    unknowns = int(model.structure.free.sum()) + own + len(found.get("process_noise", {}))
    return -float(found["cost"]) - 0.5 * unknowns * math.log(samples)


def _deterministic(entry: Any, model: ParametricModel) -> Iterator[tuple[str, Any]]:
    """Yield what may mend a fit by output error but for gusts: in words, and the settings that hold it."""
    for name in model.inputs:
        if name not in entry.servo and name not in entry.delays_s:
            late = {n: s for n, s in entry.late_std_s.items() if n != name}
            behind = {**entry.servo, name: Servo(lag_s="estimate", delay_s=0.0)}
            yield f"a lag behind {name}", entry.model_copy(update={"servo": behind, "late_std_s": late})


def _gusty(entry: OutputErrorEntry, model: ParametricModel) -> FilterErrorEntry:
    """Return the settings of filter error that stand for these of output error, inputs as late as they were found."""
    own = {key: value for key, value in entry if key in FilterErrorEntry.model_fields and key != "method"}
    late = {n: t for n, t in zip(model.inputs, model.delays_s, strict=True) if t != 0.0 and n not in entry.servo}
    return FilterErrorEntry.model_construct(**{**own, "method": "filter_error", "delays_s": late})


def mended(
    entry: OutputErrorEntry,
    model: ParametricModel,
    records: Sequence[FlightRecord],
    fit: Callable[[Any], ParametricModel],
    gusts: bool,
) -> tuple[Any, ParametricModel, tuple[Tried, ...]]:
    """Try cures of a fit whose residuals are not noise; return settings and model of the best, and what was tried.

    Gusts explain whatever moves the aircraft, a wrong model too: they come after what does not depend on chance, beside
    it, and only where kinematics show them and what is left does not go with the inputs.

    Args:
        entry: settings of output error that the model was identified with.
        model: what came out.
        records: that it was identified from.
        fit: identifies by other settings from them.
        gusts: whether kinematics show any, which are not tried otherwise.
    """
    samples = sum(int(r.select(model.outputs).valid.sum()) for r in records)
    tried: list[Tried] = []
    best: tuple[Any, ParametricModel] = entry, model
    if not (wanting(model) or _late(model)):
        return *best, ()
    base, others = evidence(model, samples), []
    for name, other in _deterministic(entry, model):
        there, gain = _gained(fit, other, base, samples)
        tried.append(Tried(name, gain))
        if there is not None:
            others.append((gain, len(tried) - 1, other, there))
    gain, at, other, there = max(others, key=lambda one: one[0], default=(-math.inf, 0, entry, model))
    if gain > _enough(there):
        tried[at] = Tried(tried[at].name, gain, True)
        best, base = (other, there), base + gain
    named = set() if not gusts else {c["code"] for c in with_causes(best[1], records).diagnostics.get("causes", ())}
    if not gusts or not wanting(best[1]) or named & BY_INPUT:
        return *best, tuple(tried)
    ways = [("gusts", best)]
    ways += [(f"gusts and {tried[i].name}", (o, m)) for g, i, o, m in others if m is not best[1] and math.isfinite(g)]
    gusty = []
    for name, (own, found) in ways:
        other = _gusty(own, found)
        there, gain = _gained(fit, other, base, samples)
        tried.append(Tried(name, gain))
        gusty.append((gain, len(tried) - 1, other, there))
    gain, at, other, there = gusty[0]
    for more in gusty[1:]:  # what else it takes must be needed beside gusts
        if there is None or (more[3] is not None and more[0] - gain > _enough(more[3])):
            gain, at, other, there = more
    if there is not None and gain > _ENOUGH:
        tried[at] = Tried(tried[at].name, gain, True)
        best = other, there
    return *best, tuple(tried)


def _enough(model: ParametricModel) -> float:
    """Return the ln evidence that a cure must gain; of coloured residuals it counts less, as their errors show."""
    return _ENOUGH * float(np.max(model.diagnostics.get("error_inflation", 1.0))) ** 2


def _gained(
    fit: Callable[[Any], ParametricModel], other: Any, base: float, samples: int
) -> tuple[ParametricModel | None, float]:
    try:
        there = fit(other)
    except Refusal:
        return None, -math.inf
    if not there.diagnostics.get("converged", True):
        return None, -math.inf
    return there, evidence(there, samples) - base
