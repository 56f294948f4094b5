"""What a campaign says, in sentences: bias, scatter and coverage of its estimates, or what failed and how often."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from testbench.page.flown import flown_words
from testbench.page.labels import number
from testbench.page.words import counted
from testbench.questions.campaign.result import ranked_contests
from testbench.questions.campaign.summary import short_name
from testbench.questions.side_by_side import best_words

if TYPE_CHECKING:
    from testbench.questions.campaign.result import CampaignResult
    from testbench.questions.campaign.summary import Accuracy, Summary

_MILLION = 1_000_000
_LINES = 3


def campaign_answer(result: CampaignResult) -> Iterator[tuple[str, str]]:
    """Yield the answer as (kind, sentence), kind "lead", "finding" or "doubt"."""
    counts, summary = result.counts, result.summary
    judged, names = _judged(summary), [a.name for a in summary.accuracies]
    yield "lead", _lead(result)
    if counts.done:
        yield from (("finding", text) for text in best_words(*ranked_contests(result)))
        if len(judged) > 1:
            yield "finding", _spread(judged)
    yield "finding", _progress(result)
    for a in most_biased(summary) if len(judged) != 1 else ():  # of one alone the lead has said it
        text = f"{short_name(a.name, names)}: bias {number(a.bias)} ± {number(a.bias_half, 2)}, {_against(a)}"
        yield "doubt", f"{text}; scatter from run to run {number(a.scatter)}"
    for a in [a for a in summary.accuracies if a.coverage_high < 0.95][:_LINES]:
        text = (
            f"{short_name(a.name, names)}: the stated 95 % intervals contain the truth in {number(100 * a.coverage)} %"
        )
        text += f" of the runs; stated standard error {number(a.stated, 2)}, scatter {number(a.scatter, 2)}"
        yield "doubt", text
    lost = [a for a in summary.accuracies if a.missing > 0.05 * (a.n + a.missing)]
    if lost:
        worst = max(lost, key=lambda a: a.missing)
        of = f"{worst.missing} of {worst.n + worst.missing}"
        yield "doubt", f"{short_name(worst.name, names)} was not found in {of} runs"
    for c in summary.cells[:_LINES]:
        yield "doubt", f"{c.case} gave no model in {c.cause.count} of {counts.done} runs: {c.cause.example}"
    if len(summary.cells) > _LINES:
        yield "doubt", f"{len(summary.cells) - _LINES} more reasons are in the table of failed estimators"
    if summary.causes and counts.done:
        yield "doubt", _cause(result)


def _lead(result: CampaignResult) -> str:
    """Return the answer: what the estimates are worth; without a truth, the predictions; or why there is neither."""
    counts, summary = result.counts, result.summary
    if not counts.finished:
        return f"no result yet: none of {counts.total} runs is finished"
    if not counts.done:
        return f"nothing was identified: all {counts.failed} finished runs failed; {_cause(result)}"
    judged = _judged(summary)
    if len(judged) == 1:
        return _of_one(judged[0])
    if judged:
        return _of_many(judged)
    errors = [f for f in summary.figures if f.n > 0 and "MRSE" in f.name]
    if errors:
        best = min(errors, key=lambda f: f.mean)
        scatter = f" and scatters by {number(best.std, 2)}" if best.n > 1 else ""
        return (
            "the bias is unknown, because no estimate was found in two runs whose true value is known; the smallest "
            f"prediction error, {best.name}, is {number(best.mean)} on average{scatter}"
        )
    names = [f.name for f in summary.figures]
    return f"nothing was identified in the {counts.done} runs that were flown" + (
        f": {', '.join(names[:_LINES])}{' and others' if len(names) > _LINES else ''} was found in none"
        if names
        else ""
    )


def _judged(summary: Summary) -> list[Accuracy]:
    """Return the estimates found twice or more; damping 1 of a root, which is exact by definition, is none."""
    return [a for a in summary.accuracies if a.n > 1 and a.rms > 0.0]


def _of_one(a: Accuracy) -> str:
    bias = f"{number(a.bias)} ± {number(a.bias_half, 2)}"
    said = f"has a bias of {bias}, {_against(a)}," if a.biased else f"shows no bias beyond chance ({bias})"
    covered = (
        f"its stated 95 % interval contains the truth in {number(100 * a.coverage)} % of {a.n} runs"
        if math.isfinite(a.coverage)
        else "its method states no errors"
    )
    return f"{a.name} {said} and scatters by {number(a.scatter, 2)} from run to run; {covered}"


def _against(a: Accuracy) -> str:
    """Return a bias in percent of the truth; where errors exceed the truth, in units of the scatter."""
    if a.near_zero:
        times = f"{number(abs(a.bias) / a.scatter, 2)} times the scatter" if a.scatter > 0.0 else "without scatter"
        return f"{times} (errors exceed the truth, {number(a.true_mean, 2)})"
    return f"{number(100 * a.bias / abs(a.true_mean), 2)} % of the true value"


def _of_many(judged: Sequence[Accuracy]) -> str:
    """Return the answer in one sentence: how many are biased, and by how much."""
    fair = sum(1 for a in judged if not a.biased)
    text = f"{fair or 'none'} of {len(judged)} estimates {'shows' if fair in (0, 1) else 'show'} no bias beyond chance"
    if fair == len(judged):
        return text
    off = [100.0 * _relative(a) for a in judged if a.biased and not a.near_zero]
    return text + (f"; the others have a bias of {_span(off)} % of the true value" if off else "")


def _spread(judged: Sequence[Accuracy]) -> str:
    """Return scatter and coverage of many estimates, and the bias of those whose errors exceed the truth."""
    parts = []
    near = [a for a in judged if a.near_zero]
    off = [abs(a.bias) / a.scatter for a in near if a.biased and a.scatter > 0.0]
    if off:
        parts.append(
            f"{counted(len(off), 'estimate')} whose errors exceed the truth {'is' if len(off) == 1 else 'are'} off by "
            f"{_span(off)} times the scatter"
        )
    scatters = [100.0 * a.scatter / abs(a.true_mean) for a in judged if not a.near_zero]
    if scatters:
        parts.append(f"from run to run they scatter by {_span(scatters)} % of the true value")
    covered = [100.0 * a.coverage for a in judged if math.isfinite(a.coverage)]
    if covered:
        of = "" if len(covered) == len(judged) else f" (of the {len(covered)} estimates that have one)"
        parts.append(f"the stated 95 % interval{of} contains the truth in {_span(covered)} % of the runs")
    else:
        parts.append("their method states no errors")
    return "; ".join(parts)


def _span(values: Sequence[float]) -> str:
    low, high = number(min(values), 2), number(max(values), 2)
    return low if low == high else f"{low} to {high}"


def _cause(result: CampaignResult) -> str:
    c = result.summary.causes[0]
    percent = 100.0 * c.count / max(result.counts.finished, 1)
    return f"the most frequent cause of failure, in {counted(c.count, 'run')} ({number(percent, 2)} %): {c.example}"


def _progress(result: CampaignResult) -> str:
    counts = result.counts
    failed = f", {counts.failed} failed" if counts.failed else ", none failed"
    text = f"{counts.done} of {counts.total} runs are done{failed}"
    if counts.finished < counts.total:
        text += f"; {counts.total - counts.finished} are still to be flown and are not included"
    if words := flown_words(result.summary.tally, "run"):
        text += f"; {words}"
    rule = result.campaign.spec.stop
    if rule is not None and result.stopped is not None:
        text += (
            f"; stopped after {result.stopped}, when the mean of '{rule.quantity}' was known to ± {rule.half_width:g} "
            f"with {100 * rule.confidence:g} % confidence"
        )
    elif rule is not None and counts.finished == counts.total:
        text += f"; the wanted ± {rule.half_width:g} of '{rule.quantity}' was not reached"
    return text


def most_biased(summary: Summary) -> list[Accuracy]:
    """Return the three estimates, at most, with the largest bias beyond its interval: relative to the truth, and where
    that is near zero, after all others, relative to the scatter.
    """
    biased = [a for a in summary.accuracies if a.biased and a.n > 1]
    return sorted(biased, key=lambda a: (a.near_zero, -_relative(a)))[:_LINES]


def _relative(a: Accuracy) -> float:
    against = a.scatter if a.near_zero else abs(a.true_mean)
    return abs(a.bias) / against if against > 0.0 else math.inf


def cost_sentence(result: CampaignResult) -> str:
    """Return what a million runs would cost, if each cost as much as the finished ones."""
    n = result.counts.finished
    if n == 0:
        return "the cost is unknown, because no run is finished yet"
    each = result.seconds / n
    hours = each * _MILLION / 3600.0
    size, records = (number(x / n * _MILLION / 1e9, 2) for x in (result.size, result.records_size))
    histories = f" and {records} GB of time histories" if result.records_size else ""
    return (
        f"a run takes {number(1e3 * each)} ms of one processor; a million like it would take {number(hours)} processor "
        f"hours, {number(hours / 100.0)} h on 100 processors, and about {size} GB of store{histories}"
    )
