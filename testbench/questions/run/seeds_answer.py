"""What the seeds of a run say, as tables and in sentences."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from testbench.evaluation.modes import words_of
from testbench.evaluation.statistics import Interval
from testbench.page.labels import number
from testbench.page.tables import Column, Table, Value
from testbench.page.words import MOST_WORDS, listed
from testbench.questions.run.seeds import Gain, Repeats

_FOUND_TO = 100.0  # %; a mean error beyond the value itself is of a value that was not found


def seeds_table(repeats: Repeats | None) -> Table | None:
    """Return one row per error, and per model its mean over the seeds, half the interval, and the seeds with one."""
    if repeats is None:
        return None
    columns = [Column("error", "error")]
    for suite, estimator in repeats.errors:
        name = f"{suite}, {estimator}"
        columns += [Column(f"{name} mean", "mean", "%", name), Column(f"{name} half", "±", "%", name, digits=2)]
        columns.append(Column(f"{name} found", "found", "", name))
    rows: list[tuple[Value, ...]] = []
    for quantity in repeats.quantities:
        row: list[Value] = [quantity]
        for key in repeats.errors:
            mean = repeats.mean(key, quantity)
            row += [None, None] if mean is None else [mean.value, 0.5 * (mean.high - mean.low)]
            row.append(repeats.found(key, quantity))
        rows.append(tuple(row))
    caption = (
        "Mean error over the seeds with its 95 % interval, and how many seeds gave one. Of a mode: distance of its "
        "pole from the true one, relative to that."
    )
    return Table("seeds", f"Errors over {repeats.count} seeds", caption, tuple(columns), tuple(rows))


def seeds_in_short(repeats: Repeats) -> Table:
    """Return one row per model and one column per error, as a terminal shows it."""
    columns = (Column("model", "model"), *(Column(q, words_of(q).removeprefix("the ")) for q in repeats.quantities))
    rows = []
    for key in repeats.errors:
        means = (repeats.mean(key, q) for q in repeats.quantities)
        rows.append((", ".join(key), *(None if m is None else _span(m) for m in means)))
    return Table("seeds", f"Mean errors over {repeats.count} seeds, %", "", columns, tuple(rows))


# --- in words ---------------------------------------------------------------------------------------------------------


def seeds_findings(repeats: Repeats, channels: Mapping[str, Sequence[str]]) -> list[str]:
    """Return what the seeds say: the largest sure gain first, then all of each estimator.

    Args:
        repeats: of :func:`repeat`.
        channels: suite -> what it senses.
    """
    gains = repeats.gains()
    if not gains:
        return [_alone(repeats)]
    # Percent of a truth near zero are large whatever a suite does: the largest fall of what is found comes first.
    sure = sorted((g for g in gains if g.sure and not _near_zero(g)), key=lambda g: g.after.value - g.before.value)
    base = next(iter(dict.fromkeys(suite for suite, _ in repeats.errors)))
    if sure and sure[0].after.value < sure[0].before.value:
        g = sure[0]
        text = (
            f"{g.estimator}: {_added(base, g.suite, channels)} lowers the error of {words_of(g.quantity)} from "
            f"{_span(g.before)} to {_span(g.after)} %"
        )
        over = f"{repeats.count} seeds, {text}"
        out = [over if len(over.split()) <= MOST_WORDS else text]
    elif any(g.sure and g.after.value < g.before.value for g in gains):
        out = [f"over {repeats.count} seeds another suite lowers only errors above {_FOUND_TO:g} % of the true value"]
    else:
        out = [f"over {repeats.count} seeds no other suite reduces an error by more than chance"]
    for suite, estimator in repeats.errors:
        mine = [g for g in gains if (g.suite, g.estimator) == (suite, estimator)]
        if mine or suite != base:
            out.append(_of_estimator(repeats, base, suite, estimator, mine, _added(base, suite, channels)))
    out.append(
        f"± is the 95 % interval of the mean error over {repeats.count} seeds; what is called lowered or raised "
        f"differs by more than chance (signed rank test, seed by seed, 5 % for all {len(gains)} questions together)"
    )
    return out


def _of_estimator(repeats: Repeats, base: str, suite: str, estimator: str, gains: Sequence[Gain], added: str) -> str:
    parts = []
    gains, lost = [g for g in gains if not _near_zero(g)], [g for g in gains if _near_zero(g)]
    for word, chosen in (
        ("lowers", [g for g in gains if g.sure and g.after.value < g.before.value]),
        ("raises", [g for g in gains if g.sure and g.after.value >= g.before.value]),
    ):
        if chosen:
            changes = (f"{words_of(g.quantity)} from {_span(g.before)} to {_span(g.after)} %" for g in chosen)
            parts.append(f"{added} {word} the error of {'; of '.join(changes)}")
    same = [g for g in gains if not g.sure]
    if same:
        kept = listed([f"{words_of(g.quantity)} ({_span(g.before)} and {_span(g.after)} %)" for g in same])
        parts.append(f"{added} changes the error of {kept} by no more than chance")
    if lost:
        names = listed([words_of(g.quantity) for g in lost])
        parts.append(f"{names}: errors of more than {_FOUND_TO:g} % of the true value, without {added} and with it")
    for quantity in repeats.quantities:
        without, with_ = (repeats.found((s, estimator), quantity) for s in (base, suite))
        if max(without, with_) == 0:
            parts.append(f"{words_of(quantity)} is found in none of {repeats.count} seeds")
        elif min(without, with_) < repeats.count:
            parts.append(
                f"{words_of(quantity)} is found in {without} of {repeats.count} seeds without and in {with_} with it"
            )
    return f"{estimator}: {'; '.join(parts)}"


def _alone(repeats: Repeats) -> str:
    """Return the errors of each model, where there is nothing to compare."""
    parts = []
    for (suite, estimator), series in repeats.errors.items():
        last = list(series)[-1]
        mean = repeats.mean((suite, estimator), last)
        if mean is not None:
            parts.append(f"{estimator} has an error in {words_of(last)} of {_span(mean)} %")
    return f"over {repeats.count} seeds {listed(parts)}"


def _near_zero(gain: Gain) -> bool:
    """Return whether nothing is found with either suite: the truth is near zero, or the flights do not show it."""
    return min(gain.before.value, gain.after.value) > _FOUND_TO


def _added(base: str, suite: str, channels: Mapping[str, Sequence[str]]) -> str:
    """Return the sensors that a suite has and the first has not, or the name of the suite."""
    if suite not in channels or base not in channels:
        return suite
    more = [c for c in channels[suite] if c not in channels[base]]
    return listed(more) if more else suite


def _span(mean: Interval) -> str:
    """Return a mean and half its interval, both to the second digit of that."""
    half = 0.5 * (mean.high - mean.low)
    if not half > 0.0:
        return f"{number(mean.value, 2)} ± 0"
    decimals = max(0, 1 - math.floor(math.log10(half)))
    return f"{mean.value:.{decimals}f} ± {half:.{decimals}f}"
