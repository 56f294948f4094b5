"""Estimators side by side on the same flights and noise: pairs, ranks and the diagram of critical differences."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.record import FloatArray
from testbench.evaluation.calibration import calibration
from testbench.evaluation.ranks import Ranks, ranks
from testbench.evaluation.statistics import LEAST_PAIRS, Test, holm, paired
from testbench.page.plot import COLOURS, INK, MEASURED, Plate, grid, label, new_figure
from testbench.page.tables import Column, Table, Value
from testbench.page.words import listed

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_EXACT = 100
"""Pairs up to which the signed rank test is taken; beyond, the mean of so many differences is normal, and t is apt."""
_MOST_PLATES = 3
_ROW_IN, _HEAD_IN = 0.24, 0.75


@dataclass(frozen=True, eq=False)
class Contest:
    """One figure by several estimators on the same data.

    Attributes:
        where: suite and input, in words.
        figure: what the error is of.
        unit: of the errors; "" for none.
        methods: (k,) names.
        errors: (n, k) sizes of errors, pair by pair; NaN where an estimator gave none.
    """

    where: str
    figure: str
    unit: str
    methods: tuple[str, ...]
    errors: FloatArray

    @property
    def ranked(self) -> Ranks | None:
        """Ranks over all data; None for fewer than three data sets."""
        return ranks(self.errors) if len(self.errors) >= LEAST_PAIRS else None


def best_words(contests: Sequence[Contest], over: str) -> list[str]:
    """Return which method has the smallest errors in each contest that is ranked, and which it cannot be told from.

    Args:
        contests: of methods on the same data.
        over: what they are ranked over, in words.
    """
    out = []
    for c in contests:
        if (ranked := c.ranked) is None:
            continue
        best, *others = np.argsort(ranked.mean, kind="stable").tolist()
        near = [c.methods[k] for k in others if ranked.mean[k] - ranked.mean[best] < ranked.critical]
        beyond = f", within chance of {listed(near)}" if near else ", beyond chance"
        out.append(
            f"{c.methods[best]} did best{f' with {c.where}' if c.where else ''}: mean rank {ranked.mean[best]:.2g} of "
            f"{len(c.methods)} methods in {c.figure} over {ranked.blocks} {over.removeprefix('the ')}{beyond}"
        )
    return out


def pair_table(contests: Sequence[Contest]) -> Table:
    """Return every pair of estimators: the difference of the sizes of their errors, with interval and probability."""
    rows: list[tuple[Value, ...]] = []
    tested: list[int] = []
    chances: list[float] = []
    for c in contests:
        for i, k in combinations(range(len(c.methods)), 2):
            both = np.isfinite(c.errors[:, [i, k]]).all(axis=1)
            first, second = c.errors[both, i], c.errors[both, k]
            test: Test = "wilcoxon" if len(first) <= MOST_EXACT else "t"
            found = paired(first - second, test)
            d = found.difference
            medians = (float(np.median(e)) if e.size else None for e in (first, second))
            if found.p is not None:
                tested.append(len(rows))
                chances.append(found.p)
            figure = c.figure + (f", {c.unit}" if c.unit else "")
            ends = (d.value, d.low, d.high) if d else (None, None, None)
            rows.append(
                (c.where, figure, c.methods[i], c.methods[k], *medians, *ends, found.pairs, test, found.p, None)
            )
    for row, p in zip(tested, holm(chances), strict=True):
        rows[row] = (*rows[row][:-1], p)
    caption = (
        "Size of the error of the first estimator minus that of the second, in the same flight with the same noise: "
        "Hodges-Lehmann pseudo-median with its 95 % interval by Wilcoxon's signed rank test, or beyond "
        f"{MOST_EXACT} pairs the mean by Student's paired t test. Below zero the first is better. p corrected: for all "
        "pairs of this table together (Holm). Data on which one of the two gave nothing are left out."
    )
    columns = (
        Column("where", "suite, input"),
        Column("figure", "error of"),
        Column("first", "first"),
        Column("second", "second"),
        Column("first median", "of the first", "", "median size", digits=3),
        Column("second median", "of the second", "", "median size", digits=3),
        Column("difference", "difference", "", "paired difference", digits=3),
        Column("low", "from", "", "paired difference", digits=3),
        Column("high", "to", "", "paired difference", digits=3),
        Column("pairs", "pairs"),
        Column("test", "test"),
        Column("p", "p", digits=2),
        Column("p_holm", "p corrected", digits=2),
    )
    return Table("pairs", "Estimators side by side", caption, columns, tuple(rows), wide=True)


def rank_table(contests: Sequence[Contest], over: str) -> Table:
    """Return the mean rank of every estimator; ``over`` says what the data sets are."""
    columns = (
        Column("where", "suite, input"),
        Column("figure", "error of"),
        Column("estimator", "estimator"),
        Column("rank", "mean rank", decimals=2),
        Column("critical", "critical difference", decimals=2),
        Column("sets", "data sets"),
        Column("p", "p", digits=2),
    )
    rows: list[tuple[Value, ...]] = []
    for c in contests:
        r = c.ranked
        if r is not None:
            order = np.argsort(r.mean, kind="stable").tolist()
            rows += [(c.where, c.figure, c.methods[k], float(r.mean[k]), r.critical, r.blocks, r.p) for k in order]
    caption = (
        f"Rank 1 is the smallest error of a data set; data sets are {over}. An estimator that gave nothing ranks last. "
        "p: Friedman's test, by the F of Iman and Davenport, that all are alike. Two mean ranks differ at 5 % if they "
        "are further apart than the critical difference (Nemenyi; Demsar 2006)."
    )
    return Table("ranks", "Ranks of the estimators", caption, columns, tuple(rows))


def rank_plates(contests: Sequence[Contest], over: str) -> list[Plate]:
    """Return the diagrams of critical differences of the first few contests that can be ranked."""
    found = [(c, r) for c in contests if (r := c.ranked) is not None][:_MOST_PLATES]
    return [
        Plate(
            f"ranks_{n}" if n else "ranks",
            f"Ranks of the estimators: {c.where}",
            f"Mean rank of the error of {c.figure} over {r.blocks} data sets ({over}); 1 is best. Bars join "
            f"estimators that Nemenyi's test at 5 % cannot tell apart, closer than {r.critical:.2f} (Demsar 2006).",
            _diagram(c, r),
        )
        for n, (c, r) in enumerate(found)
    ]


def _diagram(contest: Contest, found: Ranks) -> Callable[[bool], Figure]:
    k, groups = len(contest.methods), found.groups()

    def make(wide: bool) -> Figure:
        """Draw one row per estimator and one bar per group below."""
        rows = k + len(groups) + 2
        figure = new_figure(wide, 0.2 + _ROW_IN * rows + _HEAD_IN)
        axes = grid(figure, 0.2, [_ROW_IN * rows], left_in=0.2)[0, 0]
        order = np.argsort(found.mean, kind="stable").tolist()
        middle = 0.5 * (1 + k)
        for row, i in enumerate(order):
            rank = float(found.mean[i])
            axes.plot(rank, row, "o", color=COLOURS[0], markersize=6)
            left = rank > middle
            axes.annotate(
                f"{contest.methods[i]}  {rank:.2f}",
                (rank, row),
                xytext=(-8 if left else 8, 0),
                textcoords="offset points",
                ha="right" if left else "left",
                va="center",
                fontsize=8,
                color=INK,
                parse_math=False,
            )
        for row, group in enumerate(groups, start=k):
            ends = [float(found.mean[i]) for i in (group[0], group[-1])]
            axes.plot(ends, [row, row], color=INK, linewidth=3.0, solid_capstyle="butt")
        last = rows - 2
        axes.plot([1.0, 1.0 + found.critical], [last, last], color=COLOURS[1], linewidth=1.5, marker="|", markersize=8)
        axes.annotate(
            f"critical difference {found.critical:.2f}",
            (1.0, last + 1),  # below its line: beside it there may be no room
            va="center",
            fontsize=8,
            color=INK,
        )
        axes.set_xlim(0.85, max(k, 1.0 + found.critical) + 0.15)
        axes.set_ylim(rows - 0.4, -0.6)
        axes.set_yticks([])
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("mean rank")
        return figure

    return make


_TALL_IN, _GAP_IN, _POINTS = 1.75, 0.86, 2000
_TITLE_IN = 0.44  # of two lines
_FEW = 300  # points below which each is drawn large
LEFT_IN = 0.8  # beside the first panel: room for tick labels of seven letters and the label of the axis
CALIBRATION = (
    "Estimate minus truth over the standard error that the estimator states, sorted, against the normal distribution. "
    "On the line the stated errors are true; steeper, the errors are larger than stated; beside it, they are biased. "
    "Shaded: where each point lies with 95 % if they are true. What is beyond 1000 stated errors is drawn there."
)
_MOST_RATIO = 1000.0  # of errors to stated ones that are drawn


def panel_each(names: Sequence[str], draw: Callable[[Axes, str, bool], None]) -> Callable[[bool], Figure]:
    """Return what makes a figure of one panel per name, three to a row of a wide one.

    ``draw`` takes the panel, the name, and whether the panel is the first of its row, which names the axis.
    """

    def make(wide: bool) -> Figure:
        """Draw one panel per name."""
        columns = min(3, len(names)) if wide else 1
        rows = -(-len(names) // columns)
        figure = new_figure(wide, _TITLE_IN + rows * _TALL_IN + (rows - 1) * _GAP_IN + 0.48)
        panels = grid(
            figure, _TITLE_IN, [_TALL_IN] * rows, (1.0,) * columns, gap_in=_GAP_IN, between_in=0.72, left_in=LEFT_IN
        )
        for i, axes in enumerate(panels.ravel()):
            if i >= len(names):
                axes.set_visible(False)
            else:
                draw(axes, names[i], i % columns == 0)
        return figure

    return make


def calibration_plates(of: Mapping[str, FloatArray]) -> list[Plate]:
    """Return the figure of errors over stated errors, one panel per name; none if nothing is stated.

    Args:
        of: name -> (n, 2) errors and stated standard errors.
    """
    if not of:
        return []
    names = list(of)

    def draw(axes: Axes, name: str, first: bool) -> None:
        draw_calibration(axes, *of[name].T)
        label(axes, "normal", "error / stated" if first else "", name, lines=2)

    make = panel_each(names, draw)
    return [Plate("calibration", "Errors over stated errors", CALIBRATION, make)]


def point_size(count: int) -> float:
    """Return the size of a marker, points, at which few points are seen and many do not cover one another."""
    return 3.5 if count > _FEW else 7.0


def draw_calibration(axes: Axes, errors: FloatArray, stated: FloatArray) -> None:
    """Draw errors over stated errors against normal quantiles, with the line and the band of true ones."""
    z = calibration(errors, stated)
    every = max(1, z.found.size // _POINTS)
    axes.fill_between(z.expected, z.low, z.high, color=MEASURED, alpha=0.5, linewidth=0)
    end = float(np.abs(z.expected).max(initial=1.0))
    axes.plot([-end, end], [-end, end], color=INK, linewidth=0.9)
    found = np.clip(z.found[::every], -_MOST_RATIO, _MOST_RATIO)  # a stated error of nearly zero hides all others
    axes.plot(z.expected[::every], found, ".", color=COLOURS[0], markersize=point_size(z.found.size), alpha=0.6)
