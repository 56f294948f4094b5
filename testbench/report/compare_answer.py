"""What a comparison says, in sentences: the answer first."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from testbench.report.labels import number, symbol

if TYPE_CHECKING:
    from testbench.comparison.result import CompareResult, Gain, Quantity
    from testbench.sensors import SensorSuite

_AGREE = 0.75  # share of predicted standard errors inside the intervals; judgement
_NAMED = 3  # gains and losses that are named one by one
_TEST = {"wilcoxon": "Wilcoxon's signed rank test", "t": "Student's paired t test"}


def quantity_words(quantity: Quantity) -> str:
    """Return what an error is of: "prediction of θ", "wn of short period", "M_alpha"."""
    return f"prediction of {symbol(quantity.name)}" if quantity.kind == "prediction" else quantity.name


def added(result: CompareResult, suite: SensorSuite) -> str:
    """Return what a suite adds to the first one, and takes away, with price and mass: "alpha (400 €, 80 g)"."""
    base = result.suites[0]
    more = [s.channel for s in suite.sensors if s.channel not in base.channels]
    less = [c for c in base.channels if c not in suite.channels]
    text = _listed(more) if more else "nothing"
    if less:
        text += f", without {_listed(less)}"
    cost = [
        f"{a - b:g} {unit}"
        for a, b, unit in ((suite.price_eur, base.price_eur, "€"), (suite.mass_g, base.mass_g, "g"))
        if a is not None and b is not None
    ]
    return f"{text} ({', '.join(cost)})" if cost else text


def compare_sentences(result: CompareResult) -> list[str]:
    """Return the answer: per suite what is more than chance, then information, agreement, placement and doubts."""
    out: list[str] = []
    for suite in result.suites[1:]:
        if result.errors:
            out.append(_by_simulation(result, suite))
        out.append(_by_information(result, suite))
    if result.errors:
        inside, total = result.agreement
        if total:
            word = "agree" if inside >= _AGREE * total else "part"
            out.append(
                f"information and simulation {word}: {inside} of the {total} standard errors predicted for the best "
                f"case lie within the 95 % interval of the scatter found (by chance alone {0.95 * total:.0f} would)"
            )
        out += _never_found(result)
    if result.placed is not None:
        out.append(_placement(result))
    return out + _doubts(result)


def _by_simulation(result: CompareResult, suite: SensorSuite) -> str:
    s = result.scenario
    gains = [g for g in result.gains if g.case.suite == suite.name and g.paired.difference is not None]
    sure = [g for g in gains if g.significant(s.level)]
    better = sorted((g for g in sure if _difference(g) > 0.0), key=lambda g: -_share(g))
    worse = sorted((g for g in sure if _difference(g) <= 0.0), key=_share)
    text = (
        f"adding {added(result, suite)} to {result.suites[0].name} makes {len(better)} of {len(gains)} errors smaller "
        f"and {len(worse)} larger beyond chance ({_TEST[s.test]} on {s.seeds} pairs, {100 * s.level:g} % for all "
        f"{len(result.gains)} questions together, Holm)"
    )
    for word, found in (("smaller", better), ("larger", worse)):
        if found:
            named = [_named(result, g) for g in found[:_NAMED]]
            rest = f", and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
            text += f"; {word}: {'; '.join(named)}{rest}"
    return text


def _named(result: CompareResult, gain: Gain) -> str:
    unit = " %" if gain.quantity.unit else ""
    where = f"{gain.case.estimator}, {gain.case.manoeuvre}" if len(result.manoeuvres) > 1 else gain.case.estimator
    return f"{quantity_words(gain.quantity)} from {number(gain.before)} to {number(gain.after)}{unit} ({where})"


def _difference(gain: Gain) -> float:
    assert gain.paired.difference is not None
    return gain.paired.difference.value


def _share(gain: Gain) -> float:
    return _difference(gain) / gain.before if gain.before > 0.0 else 0.0


def _by_information(result: CompareResult, suite: SensorSuite) -> str:
    ratios: dict[str, list[float]] = {}
    for name in result.manoeuvres:
        before, after = (result.predictions[name, s.name] for s in (result.suites[0], suite))
        for quantity, a, b in zip(before.names, before.std, after.std, strict=True):
            if np.isfinite(a) and np.isfinite(b) and b > 0.0:
                ratios.setdefault(quantity, []).append(float(a / b))
    if not ratios:
        return f"by information, nothing can be told of {_listed([s.channel for s in suite.sensors])}"
    mean = {q: float(np.exp(np.mean(np.log(r)))) for q, r in ratios.items()}
    best, least = max(mean, key=lambda q: mean[q]), min(mean, key=lambda q: mean[q])
    return (
        f"by information, {added(result, suite)} divides the standard errors by {number(mean[least])} ({least}) to "
        f"{number(mean[best])} ({best})"
    )


def _never_found(result: CompareResult) -> list[str]:
    by_mode: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for s in result.summaries:
        if s.quantity.kind == "mode" and s.quantity.name.startswith("wn of "):
            by_mode.setdefault((s.quantity.name[6:], s.case.estimator), []).append((s.found, s.of))
    out = []
    for (mode, estimator), counts in by_mode.items():
        found, of = (sum(c[k] for c in counts) for k in (0, 1))
        if found < of:
            out.append(f"{estimator} finds the {mode} in {found} of {of} repetitions; only those count in its errors")
    return out


def _placement(result: CompareResult) -> str:
    p = result.placed
    assert p is not None
    sure = zip(p.names, p.before, p.after, strict=True)
    errors = "; ".join(
        f"{n} {number(float(b), 2)} to {number(float(a), 2)}{'' if n.startswith('zeta') else ' %'}" for n, b, a in sure
    )
    return f"best stations beside {p.base}: {', '.join(s.words for s in p.spots)}; standard errors {errors}"


def _doubts(result: CompareResult) -> list[str]:
    out = []
    if result.errors and result.too_few is not None:
        out.append(
            f"{result.scenario.seeds} repetitions cannot show anything beyond chance among {len(result.gains)} "
            f"questions: {result.too_few} are needed at least; raise seeds, or ask for less"
        )
    if result.failures:
        first = result.failures[0]
        out.append(
            f"{len(result.failures)} identifications gave no model, the first one by {first.case.estimator} through "
            f"{first.case.suite}: {first.reason}"
        )
    drifting = sorted({s.channel for x in result.suites for s in x.sensors if s.drift_std > 0.0 or s.bias_walk > 0.0})
    if drifting:
        out.append(f"information takes noise as white: the drift of {_listed(drifting)} is not in its figures")
    return out


def _listed(names: Sequence[str], most: int = 4) -> str:
    if len(names) > most:
        return f"{names[0]} to {names[-1]} ({len(names)} channels)"
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
