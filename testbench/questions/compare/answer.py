"""What a comparison says, in sentences: the answer first."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from testbench.page.labels import number, symbol
from testbench.page.words import listed, some

if TYPE_CHECKING:
    from testbench.questions.compare.result import CompareResult, Failure, Gain, Quantity
    from testbench.sensors import SensorSuite

MOST_WORDS = 25  # of the answer
_FEW_WORDS = 9  # of what a suite adds, if the answer is to say it
_NAMED = 3  # gains and losses that are named one by one
_KINDS = {
    "prediction": "of predictions",
    "mode": "of modes",
    "missed": "of missing a mode",
    "parameter": "of parameters",
}
_TEST = {"wilcoxon": "Wilcoxon's signed rank test", "t": "Student's paired t test"}


def quantity_words(quantity: Quantity) -> str:
    """Return the quantity that an error belongs to: "prediction of θ", "wn of short period", "M_alpha"."""
    if quantity.kind == "missed":
        return f"missing the {quantity.name}"
    return f"prediction of {symbol(quantity.name)}" if quantity.kind == "prediction" else quantity.name


def added(result: CompareResult, suite: SensorSuite) -> str:
    """Return what a suite adds to the first one, and takes away, with price and mass: "alpha (400 €, 80 g)"."""
    base = result.suites[0]
    more = [s.channel for s in suite.sensors if s.channel not in base.channels]
    less = [c for c in base.channels if c not in suite.channels]
    text = _listed(more) if more else "nothing"
    if less:
        text += f", without {_listed(less)}"
    costs = more_of(suite.price_eur, base.price_eur), more_of(suite.mass_g, base.mass_g)
    cost = [f"{value:g} {unit}" for value, unit in zip(costs, ("€", "g"), strict=True) if value is not None]
    return f"{text} ({', '.join(cost)})" if cost else text


def compare_answer(result: CompareResult) -> list[tuple[str, str]]:
    """Return the answer as (kind, sentence): what the best suite buys, in 25 words at most, and the doubts."""
    return [("lead", lead(result)), *(("doubt", text) for text in _doubts(result))]


def lead(result: CompareResult) -> str:
    """Return in one sentence of at most 25 words what the best suite buys."""
    others = result.suites[1:]
    if not others:
        return _within(*_placed_in_short(result))
    if not result.errors:
        best = max(others, key=lambda s: worth(result, s) or 0.0)
        factor = worth(result, best)
        if factor is None:
            return f"no standard error is determined by every suite; {len(others)} compared"
        text = f"by information, {_named_suite(result, best)} divides the standard errors by {number(factor, 2)}"
        return _within(text, ", in the geometric mean")
    found = {s.name: _sure(result, s) for s in others}
    best = max(others, key=lambda s: len(found[s.name][1]) - len(found[s.name][2]))
    tested, better, worse = found[best.name]
    if not better and not worse:
        return _within(f"{_named_suite(result, best)} changes none of {len(tested)} errors by more than chance")
    foremost = better[0] if better else worse[0]
    unit = f" {foremost.quantity.unit}" if foremost.quantity.unit else ""
    return _within(
        f"{_named_suite(result, best)} significantly reduces {len(better) or 'none'} of {len(tested)} errors",
        f" and increases {len(worse) or 'none'}",
        f", foremost {quantity_words(foremost.quantity)}",
        f", from {number(foremost.before)} to {number(foremost.after)}{unit}",
    )


def _named_suite(result: CompareResult, suite: SensorSuite) -> str:
    more = added(result, suite)
    short = len(more.split()) <= _FEW_WORDS and not more.startswith("nothing")
    return f"adding {more}" if short else suite.name


def _placed_in_short(result: CompareResult) -> tuple[str, ...]:
    p = result.placed
    assert p is not None
    ratios = {n: float(b / a) for n, b, a in zip(p.names, p.before, p.after, strict=True) if a > 0.0}
    text = f"{len(p.spots)} sensors at the best stations of the wing"
    if not ratios:
        return (f"{text} give no information on {_listed(p.names)}",)
    best = max(ratios, key=lambda n: ratios[n])
    return f"{text} divide the standard error of {best} by {number(ratios[best], 2)}", f", in addition to {p.base}"


def _within(*clauses: str) -> str:
    """Return the clauses, joined, as long as they have no more than 25 words together."""
    text = clauses[0]
    for clause in clauses[1:]:
        if len((text + clause).split()) > MOST_WORDS:
            break
        text += clause
    return text


def compare_sentences(result: CompareResult) -> list[str]:
    """Return all in detail: per suite what is more than chance, then information, agreement, placement and doubts."""
    out: list[str] = []
    for suite in result.suites[1:]:
        if result.errors:
            out.append(_by_simulation(result, suite))
        out.append(_by_information(result, suite))
    if result.errors:
        out.append(_meaning(result))
    out += _for_the_price(result)
    if result.errors:
        out += _agreement(result)
        out += _biases(result) + _never_found(result)
    if result.placed is not None:
        out.append(_placement(result))
    return out + _doubts(result)


def _by_simulation(result: CompareResult, suite: SensorSuite) -> str:
    """Return how many errors a suite makes surely smaller or larger, kind by kind, and the foremost of them."""
    gains, better, worse = _sure(result, suite)
    text = (
        f"adding {added(result, suite)} to {result.suites[0].name} significantly reduces {len(better) or 'none'} of "
        f"{len(gains)} errors and increases {len(worse) or 'none'} of them"
    )
    parts = []
    for kind, words in _KINDS.items():
        asked = sum(g.quantity.kind == kind for g in gains)
        if asked:
            parts.append(f"{sum(g.quantity.kind == kind for g in better) or 'none'} of {asked} {words}")
    if better:
        text += f" ({', '.join(parts)})"
    for word, found in (("smaller", better), ("larger", worse)):
        if found:
            text += f"; {word}: {some([_named(result, g) for g in found], _NAMED)}"
    return text


def _sure(result: CompareResult, suite: SensorSuite) -> tuple[list[Gain], list[Gain], list[Gain]]:
    """Return all gains of a suite that were tested, those that are surely smaller errors, and surely larger ones."""
    gains = [g for g in result.gains if g.case.suite == suite.name and g.p_holm is not None]
    sure = [g for g in gains if g.significant(result.scenario.level)]
    better = sorted((g for g in sure if _difference(g) > 0.0), key=lambda g: -_share(g))
    return gains, better, sorted((g for g in sure if _difference(g) <= 0.0), key=_share)


def _meaning(result: CompareResult) -> str:
    """Return what "surely" means."""
    s, tested = result.scenario, sum(g.p_holm is not None for g in result.gains)
    missed = " (McNemar's where modes are missed)" if any(g.quantity.kind == "missed" for g in result.gains) else ""
    return (
        f'"significantly" means beyond chance by {_TEST[s.test]}{missed} on up to {s.seeds} pairs of the same flight '
        f"and noise: among all {tested} questions, the chance of even one false finding is at most {100 * s.level:g} % "
        "(Holm)"
    )


def _named(result: CompareResult, gain: Gain) -> str:
    unit = f" {gain.quantity.unit}" if gain.quantity.unit else ""
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
        return f"information gives no standard error with {_listed([s.channel for s in suite.sensors])}"
    mean = {q: float(np.exp(np.mean(np.log(r)))) for q, r in ratios.items()}
    best, least = max(mean, key=lambda q: mean[q]), min(mean, key=lambda q: mean[q])
    return (
        f"by information, adding {added(result, suite)} divides the standard errors by {number(mean[least])} "
        f"({least}) to {number(mean[best])} ({best})"
    )


def _agreement(result: CompareResult) -> list[str]:
    inside, apart, total, far, (least, median, most) = result.agreement
    if not total:
        return []
    factor = max(most, 1.0 / least) if least > 0.0 else np.inf
    level = f"more than chance, at {100 * result.scenario.level:g} % for all {total} together (Holm)"
    verdict = (
        f"{apart} of them {'differs' if apart == 1 else 'differ'} by {level}" if apart else f"none differs by {level}"
    )
    rest = f"; {far} are left out, because the model is nonlinear over their predicted errors" if far else ""
    return [
        f"information and simulation agree to a factor of {number(factor, 2)}: the scatter of the best case is "
        f"{number(least, 2)} to {number(most, 2)} times the predicted standard error, {number(median, 2)} times in the "
        f"median; {inside} of {total} predictions lie within its 95 % interval (by chance alone {0.95 * total:.0f} "
        f"would); {verdict}{rest}"
    ]


def _never_found(result: CompareResult) -> list[str]:
    by_mode: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for s in result.summaries:
        if s.quantity.kind == "mode" and s.quantity.name.startswith("wn of "):
            by_mode.setdefault((s.quantity.name[6:], s.case.estimator), []).append((s.found, s.of))
    out = []
    for (mode, estimator), counts in by_mode.items():
        found, of = (sum(c[k] for c in counts) for k in (0, 1))
        if found < of:
            out.append(f"{estimator} finds the {mode} in {found} of {of}")
    return [f"errors of a mode include only the repetitions in which it was found: {'; '.join(out)}"] if out else []


def _biases(result: CompareResult) -> list[str]:
    """Say how many mean errors of the best case are not zero, and how many of them the flight explains."""
    signed = [s for s in result.summaries if s.ratio is not None and s.mean is not None]
    off = [s for s in signed if s.mean is not None and not s.mean.low <= 0.0 <= s.mean.high]
    if not off:
        return []
    text = (
        f"information does not include bias: {len(off)} of {len(signed)} mean errors of the best case lie beyond their "
        "95 % interval about zero"
    )
    if not result.of_flight:
        return [f"{text}; the causes are a slightly nonlinear flight and noise of the measured inputs"]
    known = [(s.mean, s.of_flight) for s in off if s.mean is not None and s.of_flight is not None]
    same = sum(mean.low <= error <= mean.high for mean, error in known)
    text += (
        f"; {same} of these intervals contain the error of the same flight without noise, which is slightly nonlinear"
    )
    rest = "; the rest is chance, or noise in an estimate that is nonlinear in the noise"
    return [text + ("" if same == len(off) else rest)]


def worth(result: CompareResult, suite: SensorSuite) -> float | None:
    """Return the factor by which information divides the standard errors: the geometric mean over all inputs and
    quantities that every suite tells; None if there are none.
    """
    logs = []
    for name in result.manoeuvres:
        found = {s.name: result.predictions[name, s.name] for s in result.suites}
        for quantity in found[suite.name].names:
            std = {s: p.of(quantity) for s, p in found.items()}
            if all(v is not None and np.isfinite(v) and v > 0.0 for v in std.values()):
                before, after = std[result.suites[0].name], std[suite.name]
                logs.append(float(np.log((before or 1.0) / (after or 1.0))))
    return float(np.exp(np.mean(logs))) if logs else None


def more_of(a: float | None, b: float | None) -> float | None:
    """Return a - b, or None where one of them is not known."""
    return None if a is None or b is None else a - b


def per_hundred(factor: float | None, amount: float | None) -> float | None:
    """Return the factor that 100 of a cost buy at the rate of ``amount``: factor^(100 / amount)."""
    return None if factor is None or amount is None or amount <= 0.0 else factor ** (100.0 / amount)


def _for_the_price(result: CompareResult) -> list[str]:
    """Name the suite whose sensors divide the standard errors by most per euro and per gram."""
    out, base = [], result.suites[0]
    for what, unit in (("price_eur", "€"), ("mass_g", "g")):
        rates = {}
        for s in result.suites[1:]:
            rate = per_hundred(worth(result, s), more_of(getattr(s, what), getattr(base, what)))
            if rate is not None:
                rates[s.name] = rate
        if len(rates) > 1:
            best = max(rates, key=lambda n: rates[n])
            out.append(f"{best} per {unit} (divided by {number(rates[best])} for every 100 {unit})")
    if not out:
        return []
    return [
        "these suites reduce the standard errors most for their cost, by information and in the geometric mean: "
        + "; ".join(out)
    ]


def _placement(result: CompareResult) -> str:
    p = result.placed
    assert p is not None
    sure = zip(p.names, p.before, p.after, strict=True)
    errors = "; ".join(
        f"{n} from {number(float(b), 2)} to {number(float(a), 2)}{'' if n.startswith('zeta') else ' %'}"
        for n, b, a in sure
    )
    return (
        f"the best stations in addition to {p.base} are {', '.join(s.words for s in p.spots)}; they change the "
        f"standard errors of {errors}"
    )


def _doubts(result: CompareResult) -> list[str]:
    out = []
    if result.errors and result.too_few is not None:
        out.append(
            f"{result.scenario.seeds} repetitions cannot show anything beyond chance among {len(result.gains)} "
            f"questions: at least {result.too_few} are needed; raise seeds, or compare fewer quantities"
        )
    cells: dict[tuple[str, str], list[Failure]] = {}
    for failure in result.failures:
        cells.setdefault((failure.case.suite, failure.case.estimator), []).append(failure)
    if cells:
        out.append(f"{len(result.failures)} identifications gave no model; they are left out")
    for (suite, estimator), failures in list(cells.items())[:_NAMED]:
        of = len(result.manoeuvres) * result.scenario.seeds
        out.append(f"{suite}, {estimator} gave no model in {len(failures)} of {of}: {failures[0].reason}")
    if len(cells) > _NAMED:
        out.append(f"{len(cells) - _NAMED} more suites and estimators failed; the table of failures gives the reasons")
    vague = [s.name for s in result.suites if any(not _near(result, m, s.name) for m in result.manoeuvres)]
    if vague:
        out.append(
            f"information assumes that the model is linear over its errors; for some quantities with {_listed(vague)} "
            "it is not, and information gives only their order of magnitude"
        )
    drifts = (s for x in result.suites for s in x.sensors if s.drift_std > 0.0 or s.bias_walk > 0.0 or s.bias_rate)
    drifting = sorted({s.channel for s in drifts})
    if drifting:
        out.append(f"information assumes white noise: its figures do not include the drift of {_listed(drifting)}")
    return out


def _near(result: CompareResult, manoeuvre: str, suite: str) -> bool:
    prediction = result.predictions[manoeuvre, suite]
    return all(prediction.near(name) for name in prediction.names)


def _listed(names: Sequence[str], most: int = 4) -> str:
    if len(names) > most:
        return f"{names[0]} to {names[-1]} ({len(names)} channels)"
    return listed(names)
