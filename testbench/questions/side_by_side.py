"""Estimators side by side on the same flights and noise: pairs, ranks and the diagram of critical differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.record import FloatArray
from testbench.evaluation.statistics import LEAST_PAIRS, Ranks, Test, calibration, holm, paired, ranks
from testbench.page.figure import COLOURS, Chart, Curve, Drawn, Panel, Plate, Words, band, grid
from testbench.page.tables import Column, Table, Value
from testbench.page.words import listed

if TYPE_CHECKING:
    from collections.abc import Mapping

MOST_EXACT = 100
"""Pairs up to which the signed rank test is taken; beyond, the mean of so many differences is normal, and t is apt."""
_MOST_PLATES = 3
_ROW_IN = 0.24
_FEW, _POINTS = 300, 2000  # points below which each is drawn large; most that are drawn
CALIBRATION = (
    "Estimate minus truth over the standard error that the estimator states, sorted, against the normal distribution. "
    "On the line the stated errors are correct; steeper, the errors are larger than stated; beside it, they are "
    "biased. Shaded: where each point lies with 95 % if they are correct. Points beyond 1000 stated errors are drawn "
    "at that value."
)
_MOST_RATIO = 1000.0  # of errors to stated ones that are drawn


@dataclass(frozen=True, eq=False)
class Contest:
    """One figure by several estimators on the same data."""

    where: str  # suite and input, in words
    figure: str  # what the error is of
    unit: str  # of the errors; "" for none
    methods: tuple[str, ...]  # (k,) names
    errors: FloatArray  # (n, k) sizes of errors, pair by pair; NaN where an estimator gave none

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
    said: dict[str, list[tuple[str, str]]] = {}
    for c in contests:
        if (ranked := c.ranked) is None:
            continue
        best, *others = np.argsort(ranked.mean, kind="stable").tolist()
        near = [c.methods[k] for k in others if ranked.mean[k] - ranked.mean[best] < ranked.critical]
        beyond = f", within chance of {listed(near)}" if near else ", beyond chance"
        rank = (
            f"mean rank {ranked.mean[best]:.2g} of {len(c.methods)} methods in {c.figure} over {ranked.blocks} "
            f"{over.removeprefix('the ')}{beyond}"
        )
        said.setdefault(c.methods[best], []).append((c.where, rank))
    return [
        f"the method {best} did best{f' with {listed(where)}' if (where := [w for w, _ in won if w]) else ''}: "
        + "; ".join(rank for _, rank in won)
        for best, won in said.items()
    ]


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
        f"Hodges-Lehmann pseudo-median with its 95 % interval by Wilcoxon's signed rank test, or beyond {MOST_EXACT} "
        "pairs the mean by Student's paired t test. Below zero the first is better. p corrected: for all pairs of "
        "this table together (Holm). Data without a result of one of the two are left out."
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
        f"Rank 1 is the smallest error of a data set; data sets are {over}. An estimator without a result ranks last. "
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
            f"Mean rank of the error of {c.figure} over {r.blocks} data sets ({over}); 1 is best. Bars join estimators "
            f"that Nemenyi's test at 5 % does not distinguish, closer than {r.critical:.2f} (Demsar 2006).",
            _diagram(c, r),
        )
        for n, (c, r) in enumerate(found)
    ]


def _diagram(contest: Contest, found: Ranks) -> Chart:
    """Return one row per estimator and one bar per group below."""
    k, groups = len(contest.methods), found.groups()
    middle, draws = 0.5 * (1 + k), list[Drawn]()
    for row, i in enumerate(np.argsort(found.mean, kind="stable").tolist()):
        rank = float(found.mean[i])
        side = -1 if rank > middle else 1
        draws.append(Curve(x=[rank], y=[row], colour=COLOURS[0], marker="o", size=6.0))
        draws.append(Words(x=rank, y=row, text=f"{contest.methods[i]}  {rank:.2f}", shift=(8 * side, 0),
                           across="right" if side < 0 else "left"))  # fmt: skip
    for row, group in enumerate(groups, start=k):
        draws.append(Curve(x=[float(found.mean[i]) for i in (group[0], group[-1])], y=[row, row], width=3.0))
    last = k + len(groups)
    draws.append(Curve(x=[1.0, 1.0 + found.critical], y=[last, last], colour=COLOURS[1], width=1.5, marker="|",
                       size=8.0, joined=True))  # fmt: skip
    # Below its line: beside it there may be no room.
    draws.append(Words(x=1.0, y=last + 1, text=f"critical difference {found.critical:.2f}"))
    return Chart([[Panel(
        draws=draws, x="mean rank", x_range=(0.85, max(k, 1.0 + found.critical) + 0.15), y_ticks=[],
        y_range=(last + 1.6, -0.6), tall_in=_ROW_IN * (last + 2),
    )]])  # fmt: skip


def calibration_plates(of: Mapping[str, FloatArray]) -> list[Plate]:
    """Return the figure of errors over stated errors, one panel per name; none if nothing is stated.

    Args:
        of: name -> (n, 2) errors and stated standard errors.
    """
    if not of:
        return []
    panels = [calibration_panel(name, *pair.T) for name, pair in of.items()]
    return [Plate("calibration", "Errors over stated errors", CALIBRATION, grid(panels, 3))]


def points(x: FloatArray, y: FloatArray) -> Curve:
    """Return one sign each of at most some thousand points; few are seen, and many do not cover one another."""
    every = slice(None, None, max(1, x.size // _POINTS))
    size = 3.5 if x.size > _FEW else 7.0
    return Curve(x=x[every], y=y[every], colour=COLOURS[0], marker=".", size=size, alpha=0.6)


def calibration_panel(name: str, errors: FloatArray, stated: FloatArray) -> Panel:
    """Return errors over stated errors against normal quantiles, with the line and the band of true ones."""
    z = calibration(errors, stated)
    end = float(np.abs(z.expected).max(initial=1.0))
    found = np.clip(z.found, -_MOST_RATIO, _MOST_RATIO)  # a stated error of nearly zero hides all others
    line = Curve(x=[-end, end], y=[-end, end], width=0.9)
    draws: list[Drawn] = [band(z.expected, z.low, z.high, alpha=0.5), line, points(z.expected, found)]
    return Panel(draws=draws, title=name, x="normal", y="error / stated", tall_in=1.75)
